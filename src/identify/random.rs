//! Draws that the searches need, from any [`rand_core`] generator.

use rand_core::Rng;

/// A number below `n`, each as likely (to `n / 2^32`).
pub fn below<R: Rng>(rng: &mut R, n: usize) -> usize {
    ((u64::from(rng.next_u32()) * n as u64) >> 32) as usize
}

/// True with probability `p`.
pub fn chance<R: Rng>(rng: &mut R, p: f32) -> bool {
    unit(rng) < p
}

/// A number in 0..1, a multiple of 2^-24 and so exact.
pub fn unit<R: Rng>(rng: &mut R) -> f32 {
    (rng.next_u32() >> 8) as f32 / (1 << 24) as f32
}
