//! Numbers drawn by chance, from any generator of bits.

use rand_core::Rng;

/// A number drawn evenly from 0 to 1, 1 not included: 53 bits.
pub fn unit(rng: &mut impl Rng) -> f64 {
    (rng.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
}

/// A standard normal number (Box and Muller).
pub fn gaussian(rng: &mut impl Rng) -> f64 {
    // Half a step up, so that the logarithm has never 0.
    let [u, v] = [0, 1].map(|_| unit(rng) + 0.5 / (1_u64 << 53) as f64);
    (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}
