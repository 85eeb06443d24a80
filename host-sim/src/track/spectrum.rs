//! Standard spectra of track irregularity.
//!
//! All are one-sided densities over the number of waves a metre `s`, so that the mean square over a band of waves is the
//! integral of the density over it. `S_v` is of the mean height of the rails (profile), `S_a` of their mean lateral place
//! (alignment), `S_c` of the difference of their heights (cross-level); all in m², and so m³ as densities.
//!
//! The Federal Railroad Administration's classes 1 (worst) to 6 (best), with one roughness `A` a class:
//!
//! ```text
//! S_v = S_a = A W2^2 (s^2 + W1^2) / (s^4 (s^2 + W2^2))          S_c = A W2^2 / ((s^2 + W1^2) (s^2 + W2^2))
//! ```
//!
//! `W1` = 0.0233 and `W2` = 0.131 waves a metre, wavelengths 1.524 to 304.8 m. Forms after Hamid and Yang, Analytical
//! descriptions of track-geometry variations, Transportation Research Record 838, 1981; constants of profile and
//! alignment as in Fryba, Dynamics of Railway Bridges, 1996. That cross-level has them too is declared here; at short
//! waves it makes the difference of the rails as large as their mean.
//!
//! The German spectra of low irregularity (ERRI B176), over `W = 2 pi s` in rad/m with `S(s) = 2 pi S(W)`:
//!
//! ```text
//! S_v, S_a = A Wc^2 / ((W^2 + Wr^2) (W^2 + Wc^2))               S_c = 4 S_v W^2 / (W^2 + Ws^2)
//! ```
//!
//! `Wc` = 0.8246, `Wr` = 0.0206, `Ws` = 0.4380 rad/m; `A` = 4.032e-7 m rad for profile, 2.119e-7 m rad for alignment.
//! Sources give cross-level as an angle, `S_v / b^2` in place of `4 S_v`, of rails `2 b` apart: as a difference of heights
//! `b` falls out. Wavelengths 1 to 100 m are declared here: sources stop at 0.5 to 3 m and at 80 to 100 m.
//!
//! Sources differ in whether such densities are one-sided; read as two-sided they would make tracks rougher by 1.41.
//!
//! Root mean square of the profile, mm, from the shortest wave to 80 m and to the longest:
//!
//! | fra1 | fra2 | fra3 | fra4 | fra5 | fra6 | erri-low |
//! |---|---|---|---|---|---|---|
//! | 4.97 | 3.75 | 2.80 | 2.09 | 1.58 | 1.25 | 2.07 |
//! | 29.0 | 21.9 | 16.3 | 12.2 | 9.2 | 7.3 | 2.34 |
//!
//! Long waves rule these numbers, not the shaking: up to 60 m class 6 has 0.92 mm, up to 25 m 0.42 mm.

use std::f64::consts::TAU;

use clap::ValueEnum;

/// A standard spectrum; its names on the command line are those of its variants.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Spectrum {
    /// FRA class 1, the worst
    Fra1,
    /// FRA class 2
    Fra2,
    /// FRA class 3
    Fra3,
    /// FRA class 4
    Fra4,
    /// FRA class 5
    Fra5,
    /// FRA class 6, the best
    Fra6,
    /// German spectra of low irregularity (ERRI B176)
    ErriLow,
}

/// What is irregular.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// The mean height of the rails.
    Profile,
    /// The mean lateral place of the rails.
    Alignment,
    /// The left rail's height less the right one's.
    CrossLevel,
}

/// FRA: the waves a metre at which the spectrum bends.
const FRA_W1: f64 = 0.0233;
const FRA_W2: f64 = 0.131;
/// FRA: shortest and longest wave, m.
const FRA_WAVES_M: [f64; 2] = [1.524, 304.8];

/// German spectra: the rad/m at which they bend.
const ERRI_WC: f64 = 0.8246;
const ERRI_WR: f64 = 0.0206;
const ERRI_WS: f64 = 0.4380;
/// German spectra of low irregularity: roughness of profile and alignment, m rad.
const ERRI_PROFILE: f64 = 4.032e-7;
const ERRI_ALIGNMENT: f64 = 2.119e-7;
/// German spectra: shortest and longest wave, m.
const ERRI_WAVES_M: [f64; 2] = [1.0, 100.0];

impl Spectrum {
    /// Shortest and longest wave that it tells of, m.
    pub fn waves_m(self) -> [f64; 2] {
        match self.fra_roughness_m() {
            Some(_) => FRA_WAVES_M,
            None => ERRI_WAVES_M,
        }
    }

    /// One-sided density at `s` waves a metre, m³.
    pub fn density(self, quantity: Quantity, s: f64) -> f64 {
        match self.fra_roughness_m() {
            Some(a) => {
                let (s2, w1, w2) = (s * s, FRA_W1 * FRA_W1, FRA_W2 * FRA_W2);
                match quantity {
                    Quantity::Profile | Quantity::Alignment => a * w2 * (s2 + w1) / (s2 * s2 * (s2 + w2)),
                    Quantity::CrossLevel => a * w2 / ((s2 + w1) * (s2 + w2)),
                }
            }
            None => {
                let w = (TAU * s).powi(2);
                let wc = ERRI_WC * ERRI_WC;
                let shape = TAU * wc / ((w + ERRI_WR * ERRI_WR) * (w + wc));
                match quantity {
                    Quantity::Profile => ERRI_PROFILE * shape,
                    Quantity::Alignment => ERRI_ALIGNMENT * shape,
                    Quantity::CrossLevel => 4.0 * ERRI_PROFILE * shape * w / (w + ERRI_WS * ERRI_WS),
                }
            }
        }
    }

    /// The FRA class whose level is nearest to `level`, a part of class 6's mean square, and its own level.
    pub fn nearest_class(level: f64) -> (u32, f64) {
        let classes = [Self::Fra1, Self::Fra2, Self::Fra3, Self::Fra4, Self::Fra5, Self::Fra6];
        let roughness = |class: Self| class.fra_roughness_m().unwrap_or(f64::INFINITY);
        let levels = classes.map(|class| roughness(class) / roughness(Self::Fra6));
        let distance = |class: f64| (class / level).ln().abs();
        (1..)
            .zip(levels)
            .reduce(|best, next| {
                if distance(next.1) < distance(best.1) {
                    next
                } else {
                    best
                }
            })
            .unwrap_or((6, 1.0))
    }

    fn fra_roughness_m(self) -> Option<f64> {
        Some(match self {
            Self::Fra1 => 15.53e-8,
            Self::Fra2 => 8.85e-8,
            Self::Fra3 => 4.92e-8,
            Self::Fra4 => 2.75e-8,
            Self::Fra5 => 1.57e-8,
            Self::Fra6 => 0.98e-8,
            Self::ErriLow => return None,
        })
    }
}
