//! When the strong motion began and ended: the bracketed duration of earthquake engineering, found in constant memory.
//!
//! The strong motion is the time between the first and the last sample at which the level exceeds a fifth of its peak.
//! The peak is known at the end only, so first and last crossings are kept for a ladder of levels, each twice the one
//! below, and the highest rung that is not above a fifth of the peak is taken: 10 to 20 % of it.

/// Rungs: from a level of 1 to 2^19 times the quiet one.
const RUNGS: usize = 20;
/// Square of the part of the peak level that counts as strong.
const STRONG_SQUARED: f32 = 0.04;

/// First and last crossings of each rung since the motion began.
#[derive(Debug, Clone, Copy)]
pub struct Bracket {
    /// Square of the lowest rung.
    lowest_squared: f32,
    peak_squared: f32,
    rungs: [Option<(u64, u64)>; RUNGS],
}

impl Bracket {
    /// A motion that begins; its lowest rung is the square root of `lowest_squared`.
    pub fn new(lowest_squared: f32) -> Self {
        Self {
            lowest_squared,
            peak_squared: 0.0,
            rungs: [None; RUNGS],
        }
    }

    /// Takes the squared level ratio of sample `index`.
    pub fn push(&mut self, index: u64, ratio_squared: f32) {
        self.peak_squared = self.peak_squared.max(ratio_squared);
        let mut rung_squared = self.lowest_squared;
        for rung in &mut self.rungs {
            if ratio_squared < rung_squared {
                break;
            }
            let first = rung.map_or(index, |(first, _)| first);
            *rung = Some((first, index));
            rung_squared *= 4.0;
        }
    }

    /// First and last sample of the strong motion; none if the lowest rung was never reached.
    pub fn strong(&self) -> Option<(u64, u64)> {
        let strong_squared = STRONG_SQUARED * self.peak_squared;
        let mut rung_squared = self.lowest_squared;
        let mut strong = *self.rungs.first()?;
        for rung in &self.rungs {
            if rung_squared > strong_squared || rung.is_none() {
                break;
            }
            strong = *rung;
            rung_squared *= 4.0;
        }
        strong
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weak_motion_before_and_after_is_left_out_and_a_weak_passage_is_kept_whole() {
        let level = |index: u64| match index {
            10..20 => 2.0_f32,
            20..30 => 100.0,
            30..40 => 3.0,
            _ => 1.0,
        };
        let mut bracket = Bracket::new(1.5 * 1.5);
        for index in 10..50 {
            bracket.push(index, level(index) * level(index));
        }
        assert_eq!(bracket.strong(), Some((20, 29)));

        let mut weak = Bracket::new(1.5 * 1.5);
        for index in 10..20 {
            weak.push(index, level(index) * level(index));
        }
        assert_eq!(weak.strong(), Some((10, 19)));
        assert_eq!(Bracket::new(1.0).strong(), None);
    }
}
