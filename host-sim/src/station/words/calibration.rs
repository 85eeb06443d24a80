//! What was learnt: damage that came with the change of a track, and whether more passages would teach more of it, and others.

use spanwatch::identify::estimate::{ALARM_DAMAGE, ALARM_DEVIATIONS};

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

/// Which elements are damaged beyond doubt, as a logger would say of their losses with these standard deviations.
pub fn damage(losses: &[[f64; 2]]) -> String {
    let [least, sure] = [ALARM_DAMAGE, ALARM_DEVIATIONS].map(f64::from);
    let named = |is: &dyn Fn(f64, f64) -> bool| -> Vec<String> {
        (losses.iter().enumerate())
            .filter(|(_, [loss, deviation])| is(*loss, *deviation))
            .map(|(e, [loss, _])| format!("element {} by {:.1} %", e + 1, 100.0 * loss.abs()))
            .collect()
    };
    let gained = named(&|loss, deviation| -loss > sure * deviation);
    if !gained.is_empty() {
        return format!(
            "Not to be relied on: stiffer than before beyond doubt would be {}. Trains, speeds, sensors or the bridge are not what is told.",
            gained.join(", ")
        );
    }
    let lost = named(&|loss, deviation| loss > least && loss > sure * deviation);
    if !lost.is_empty() {
        return format!("DAMAGE beyond doubt: softer are {}.", lost.join(", "));
    }
    let hidden = (losses.iter()).fold(least, |most, [_, deviation]| most.max(sure * deviation));
    format!(
        "No damage beyond doubt. A loss of up to {:.0} % in one element could have gone unseen.",
        100.0 * hidden.min(1.0)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn damage_is_named_if_it_is_large_and_sure_and_no_element_has_gained() {
        let mut losses = [[0.01, 0.01]; 3];
        assert!(damage(&losses).contains("No damage beyond doubt. A loss of up to 5 %"));
        losses[1] = [0.3, 0.08];
        assert!(damage(&losses).contains("No damage beyond doubt. A loss of up to 40 %"));
        losses[1] = [0.3, 0.05];
        assert_eq!(damage(&losses), "DAMAGE beyond doubt: softer are element 2 by 30.0 %.");
        losses[0] = [-0.1, 0.01];
        assert!(
            damage(&losses)
                .contains("Not to be relied on: stiffer than before beyond doubt would be element 1 by 10.0 %")
        );
    }

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
