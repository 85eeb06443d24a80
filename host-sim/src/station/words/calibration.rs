//! Whether more passages would teach more of a track, and others.

use crate::calibrate::Calibration;

/// What is unknown of the profile matters if it is this part of an element's floor.
const MATTERS: f64 = 0.5;
/// Twice as many passages help if a floor falls to this part at most; independent ones would take it to 0.71.
const HELPS: f64 = 0.9;
/// Speeds are alike if they lie within this part of each other.
const ALIKE: f64 = 0.1;

/// What limits later passages, in the element that is limited most.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gain {
    /// The element, from 1.
    pub element: usize,
    /// Its floor, points: now, and after twice as many passages.
    pub floor: [f64; 2],
    /// What is unknown of the profile in it.
    pub of_profile: [f64; 2],
    /// Slowest and fastest passage, km/h.
    pub speeds_kmh: [f64; 2],
}

impl Gain {
    /// Of what was learnt about so many elements.
    pub fn of(calibration: &Calibration, elements: usize, speeds_kmh: [f64; 2]) -> Self {
        let floor = &calibration.floor[..elements];
        let worst = (0..elements)
            .max_by(|&a, &b| floor[a].total_cmp(&floor[b]))
            .unwrap_or(0);
        let [twice, of_profile_twice] = calibration.floors_twice;
        Self {
            element: worst + 1,
            floor: [calibration.floor[worst], twice[worst]].map(|floor| 100.0 * floor),
            of_profile: [calibration.floor_learnt[worst], of_profile_twice[worst]].map(|floor| 100.0 * floor),
            speeds_kmh,
        }
    }

    /// Whether more passages like these would teach more that matters.
    pub fn more_passages(&self) -> bool {
        self.floor[1] <= HELPS * self.floor[0]
    }

    /// Whether trains at other speeds would.
    pub fn other_speeds(&self) -> bool {
        let [low, high] = self.speeds_kmh;
        let spent = self.of_profile[1] > HELPS * self.of_profile[0];
        self.of_profile[0] > MATTERS * self.floor[0] && (spent || high - low <= ALIKE * high)
    }
}

/// The same as a sentence.
pub fn gain(gain: &Gain) -> String {
    let Gain {
        element,
        floor: [now, twice],
        of_profile: [of_profile, _],
        speeds_kmh: [low, high],
    } = gain;
    let more = if gain.more_passages() {
        "would help"
    } else {
        "would help little"
    };
    let speeds = match gain.other_speeds() {
        true => format!("; trains at other speeds than {low:.0} to {high:.0} km/h would help"),
        false => String::new(),
    };
    format!(
        "More passages like these {more}: twice as many would take the floor of element {element} from {now:.2} points to \
         {twice:.2}{speeds}.\nWhat is unknown of the profile makes {of_profile:.2} points of it; the rest is what the rails may change without \
         its being seen."
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_passages_help_while_they_teach_and_other_speeds_where_these_teach_no_more() {
        let with = |floor, of_profile, speeds_kmh| {
            let gain = Gain {
                element: 3,
                floor,
                of_profile,
                speeds_kmh,
            };
            (gain.more_passages(), gain.other_speeds())
        };
        assert_eq!(with([2.0, 1.9], [0.3, 0.2], [200.0, 270.0]), (false, false));
        assert_eq!(with([2.0, 1.4], [1.9, 1.3], [200.0, 270.0]), (true, false));
        assert_eq!(with([2.0, 1.4], [1.9, 1.3], [250.0, 255.0]), (true, true));
        assert_eq!(with([2.0, 1.9], [1.9, 1.8], [200.0, 270.0]), (false, true));
    }
}
