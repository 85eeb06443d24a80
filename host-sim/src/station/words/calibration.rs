//! Whether more passages would teach more of a track, and others.

use crate::calibrate::Calibration;

/// The profile is known well enough if what is unknown of it is this part of an element's floor.
const SMALL_PART: f64 = 0.5;
/// Twice as many passages help if the floor falls to this part at most; independent ones would take it to 0.71.
const HELPS: f64 = 0.9;
/// Speeds are alike if they lie within this part of each other.
const ALIKE: f64 = 0.1;

/// What limits later passages, in the element that is limited most by the profile.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gain {
    /// The element, from 1.
    pub element: usize,
    /// Its floor, points: in all, by what is unknown of the profile, by that after twice as many passages.
    pub floor: [f64; 3],
    /// Slowest and fastest passage, km/h.
    pub speeds_kmh: [f64; 2],
}

impl Gain {
    /// Of what was learnt about so many elements.
    pub fn of(calibration: &Calibration, elements: usize, speeds_kmh: [f64; 2]) -> Self {
        let floors = (calibration.floor.iter())
            .zip(&calibration.floor_learnt)
            .zip(&calibration.floor_twice);
        let worst = (floors.take(elements).enumerate())
            .map(|(e, ((all, learnt), twice))| (e + 1, [*all, *learnt, *twice].map(|floor| 100.0 * floor)))
            .max_by(|a, b| a.1[1].total_cmp(&b.1[1]));
        let (element, floor) = worst.unwrap_or((1, [0.0; 3]));
        Self {
            element,
            floor,
            speeds_kmh,
        }
    }

    fn profile_is_known(&self) -> bool {
        self.floor[1] <= SMALL_PART * self.floor[0]
    }

    /// Whether more passages like these would teach more that matters.
    pub fn more_passages(&self) -> bool {
        !self.profile_is_known() && self.floor[2] <= HELPS * self.floor[1]
    }

    /// Whether trains at other speeds would.
    pub fn other_speeds(&self) -> bool {
        let [low, high] = self.speeds_kmh;
        !self.profile_is_known() && (!self.more_passages() || high - low <= ALIKE * high)
    }
}

/// The same as a sentence.
pub fn gain(gain: &Gain) -> String {
    let Gain {
        element,
        floor: [all, learnt, twice],
        speeds_kmh: [low, high],
    } = gain;
    let speeds = format!("{low:.0} to {high:.0} km/h");
    match (gain.more_passages(), gain.other_speeds()) {
        (false, false) => format!(
            "More passages would help little: of element {element}'s {all:.2} points what is unknown of the profile makes {learnt:.2}; the \
             rest is what the rails are taken to change unseen (--drift-mm)."
        ),
        (true, false) => format!(
            "More passages would help: twice as many like these would take what is unknown of the profile from {learnt:.2} to {twice:.2} \
             points in element {element}."
        ),
        (true, true) => format!(
            "More passages would help, the more so at other speeds than {speeds}: twice as many like these would take what is unknown of \
             the profile from {learnt:.2} to {twice:.2} points in element {element}."
        ),
        (false, true) => format!(
            "More passages at {speeds} would help little, trains at other speeds would help: what is unknown of the profile makes {learnt:.2} \
             points in element {element}, and twice as many passages like these would leave {twice:.2}."
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_passages_help_while_they_teach_and_other_speeds_where_these_teach_no_more() {
        let with = |floor, speeds_kmh| {
            let gain = Gain {
                element: 3,
                floor,
                speeds_kmh,
            };
            (gain.more_passages(), gain.other_speeds())
        };
        assert_eq!(with([2.0, 0.3, 0.2], [200.0, 270.0]), (false, false));
        assert_eq!(with([2.0, 1.9, 1.4], [200.0, 270.0]), (true, false));
        assert_eq!(with([2.0, 1.9, 1.4], [250.0, 255.0]), (true, true));
        assert_eq!(with([2.0, 1.9, 1.85], [200.0, 270.0]), (false, true));
    }
}
