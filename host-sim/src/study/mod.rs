//! Studies: the numbers that choices and claims of this project rest on, each made again by one command
//! (`host-sim evaluate`), shipped as a page under `docs/` and held by `tests/studies.rs`.

pub mod accuracy;
pub mod node_maxima;
pub mod noise;
pub mod precision;
pub mod sources;
pub mod track;

/// Root of the sum of squares of the difference of two signals over that of the second, over all channels together.
///
/// Not finite if a signal is not; so a solution that has exploded is not mistaken for a good one.
pub fn relative_rms(found: &[Vec<f64>], exact: &[Vec<f64>]) -> f64 {
    let mut squares = [0.0; 2];
    for (a, b) in found.iter().zip(exact) {
        for (a, b) in a.iter().zip(b) {
            squares[0] += (a - b).powi(2);
            squares[1] += b.powi(2);
        }
    }
    (squares[0] / squares[1]).sqrt()
}
