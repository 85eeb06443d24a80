//! What an identification found and how surely, as sentences for an engineer who has to decide whether somebody goes and looks.
//!
//! The verdict begins with what is beyond doubt, then comes what is suspect, what else could explain the passage and by
//! how much it does so worse, which elements cannot be told apart, and what could have gone unseen.
//!
//! Ranges are 95 %. A loss cannot be negative, so that of an element that seems whole is no `0 ± 3 %` but `at most 3 %`
//! ([`interval`](spanwatch::identify::interval)).

use std::fmt::Write as _;

use spanwatch::bridge::{Damage, MAX_DAMAGE};
use spanwatch::capacity::ELEMENTS;
use spanwatch::identify::Identification;
use spanwatch::identify::estimate::{ALARM_DAMAGE, ALARM_DEVIATIONS, RESOLUTION, TOLD_APART};
use spanwatch::identify::hybrid::{HIDDEN, Rival};
use spanwatch::identify::refine::Stop;
use spanwatch::identify::unknowns::{Theta, with_losses};

use super::percent;

/// A loss below this is not worth a word.
const WORTH_A_WORD: f32 = 0.02;
/// Losses of another explanation that are told; the rest are counted.
const TOLD: usize = 4;
/// Standard deviations to either side of a Gaussian that hold 95 %.
const TWO_SIDED: f64 = 1.96;
/// A bound of an interval is the most that is looked for, if no further from it than this.
const AT_THE_END: f32 = 1e-4;

/// A number of the run, and how it is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Number {
    /// Its value.
    pub value: f64,
    /// How it is known.
    pub how: How,
}

/// How a number of the run is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum How {
    /// The recording gives it, and it was held.
    Given,
    /// A first guess by the passage, and held.
    Guessed,
    /// Estimated with the damage.
    Estimated {
        /// Standard deviation.
        std: f64,
    },
}

/// How the train ran, in the recording's units and time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ran {
    /// Speed as it enters, km/h.
    pub speed_kmh: Number,
    /// When the first axle enters, s of file time.
    pub entry_s: Number,
    /// Load factor.
    pub load: Number,
    /// Stiffness of the whole bridge, as a part of its model's.
    pub stiffness: Number,
}

/// The verdict on a bridge of so many elements, sentence after sentence in one line.
pub fn verdict(found: &Identification, elements: usize) -> String {
    let elements = elements.min(ELEMENTS);
    if !found.explained() {
        return format!(
            "No damage explains this passage: the best leaves {} of the signal's power unexplained. Check train, speed, entry time, \
             load, and the node, unit and sign of each channel; a rough rail can be the reason too.",
            percent(found.unexplained.into())
        );
    }
    let certain = found.certain();
    let is_certain = |e: usize| certain >> e & 1 == 1;
    let estimate = &found.estimate;
    let suspect: Vec<usize> = (0..elements)
        .filter(|&e| !is_certain(e) && estimate.damage[e] >= WORTH_A_WORD && estimate.significance[e] >= TOLD_APART)
        .collect();
    let healthy_loses_by = whole_loses_by(found);
    let lost_somewhere = certain == 0 && suspect.is_empty() && healthy_loses_by > ALARM_DEVIATIONS;

    let mut sentences = vec![];
    for e in (0..elements).filter(|&e| is_certain(e)) {
        sentences.push(format!(
            "Element {} has lost {} of its bending stiffness, beyond doubt.",
            e + 1,
            loss(found, e)
        ));
    }
    if certain == 0 && !suspect.is_empty() {
        sentences.push("No damage is beyond doubt.".to_owned());
    }
    for &e in &suspect {
        sentences.push(if estimate.significance[e] > ALARM_DEVIATIONS {
            format!(
                "Element {} has lost {}: surely something, but less than the {:.0} % that raise an alarm.",
                e + 1,
                loss(found, e),
                100.0 * ALARM_DAMAGE
            )
        } else {
            format!(
                "Element {} is suspect: it may have lost {}, which is {:.1} standard deviations from whole where {:.0} are \
                 beyond doubt.",
                e + 1,
                loss(found, e),
                estimate.significance[e],
                ALARM_DEVIATIONS
            )
        });
    }
    let groups = groups(found, elements);
    if lost_somewhere && !groups.is_empty() {
        sentences.push(format!(
            "No element is damaged beyond doubt, but the bridge is not as it was: undamaged, it would explain the passage worse by {}.",
            deviations(healthy_loses_by)
        ));
    }
    sentences.extend(
        (found.rival.as_ref())
            .filter(|rival| estimate.damage[rival.whole] >= WORTH_A_WORD)
            .map(|rival| other_explanation(rival, certain.count_ones() as usize + suspect.len() == 1, elements)),
    );
    for group in groups {
        let each: Vec<String> = (0..elements)
            .filter(|e| group >> e & 1 == 1)
            .map(|e| format!("element {}: {}", e + 1, range(estimate.low[e], estimate.high[e])))
            .collect();
        sentences.push(format!(
            "Elements {} cannot be told apart at this noise ({}).",
            listed(&numbers(group)),
            each.join(", ")
        ));
    }
    sentences.push(unseen(found, elements, !suspect.is_empty() || lost_somewhere));
    sentences.join(" ")
}

/// `11.1 % (95 %: 9.2 to 13.0 %)`.
fn loss(found: &Identification, e: usize) -> String {
    let estimate = &found.estimate;
    format!(
        "{} (95 %: {})",
        tenths(estimate.damage[e]),
        range(estimate.low[e], estimate.high[e])
    )
}

/// A part in per cent, to a tenth.
fn tenths(part: f32) -> String {
    format!("{:.1} %", 100.0 * part)
}

/// An interval of a loss. Ends that are bounds of what is looked for are no ends.
fn range(low: f32, high: f32) -> String {
    let open = high >= MAX_DAMAGE as f32 - AT_THE_END;
    match (low > 0.0, open) {
        (true, true) => format!("{} or more", tenths(low)),
        (true, false) => format!("{:.1} to {}", 100.0 * low, tenths(high)),
        (false, true) => "anything".to_owned(),
        (false, false) => format!("at most {}", tenths(high)),
    }
}

fn deviations(number: f32) -> String {
    let decimals = usize::from(number < 9.95);
    format!("{number:.decimals$} standard deviations")
}

/// Standard deviations by which the undamaged bridge explains the passage worse, the run being free.
fn whole_loses_by(found: &Identification) -> f32 {
    let flexibilities = with_losses(Theta::zeros(), &found.estimate.damage);
    let flexibilities = flexibilities.fixed_rows::<ELEMENTS>(0).into_owned();
    let information = &found.information;
    // Less what rounding may have made, as in the elements' significance.
    let rise = -2.0 * information.value(&flexibilities) - RESOLUTION * information.size(&flexibilities);
    if rise > 0.0 { rise.sqrt() } else { 0.0 }
}

fn other_explanation(rival: &Rival, it: bool, elements: usize) -> String {
    let whole = if it {
        "it".to_owned()
    } else {
        format!("element {}", rival.whole + 1)
    };
    let by = deviations(rival.loses_by);
    let only = if rival.loses_by < ALARM_DEVIATIONS { "only " } else { "" };
    format!(
        "Were {whole} whole, the next best explanation ({}) would explain the passage worse by {only}{by}.",
        losses(&rival.damage, elements)
    )
}

/// The losses that are worth a word, the largest first.
fn losses(damage: &Damage<f32>, elements: usize) -> String {
    let mut worth: Vec<usize> = (0..elements).filter(|&e| damage[e] >= WORTH_A_WORD).collect();
    worth.sort_by(|&a, &b| damage[b].total_cmp(&damage[a]));
    let more = worth.len().saturating_sub(TOLD);
    let told: Vec<String> = (worth.iter().take(TOLD))
        .map(|&e| format!("element {}: {}", e + 1, tenths(damage[e])))
        .collect();
    match (told.is_empty(), more) {
        (true, _) => format!("no element less than {:.0} % off", 100.0 * WORTH_A_WORD),
        (false, 0) => told.join(", "),
        (false, more) => format!("{} and less in {more} more", told.join(", ")),
    }
}

/// Elements (bits, from 0) that cannot be told apart from element `e` (from 0).
pub fn inseparable(found: &Identification, elements: usize, e: usize) -> u16 {
    found.information.inseparable(elements, e)
}

/// Sets of elements (bits) that cannot be told apart, one of which at least has a loss that is worth a word; none within another.
fn groups(found: &Identification, elements: usize) -> Vec<u16> {
    let mut groups: Vec<u16> = (0..elements)
        .filter(|&e| found.estimate.damage[e] >= WORTH_A_WORD)
        .map(|e| (e, inseparable(found, elements, e)))
        .filter(|&(_, others)| others != 0)
        .map(|(e, others)| others | 1 << e)
        .collect();
    groups.sort_by_key(|group| std::cmp::Reverse(group.count_ones()));
    let mut largest: Vec<u16> = vec![];
    for group in groups {
        if !largest.iter().any(|larger| larger & group == group) {
            largest.push(group);
        }
    }
    largest
}

/// Numbers of the elements, from 1, whose bit is set.
pub fn numbers(bits: u16) -> Vec<u32> {
    (0..u16::BITS).filter(|e| bits >> e & 1 == 1).map(|e| e + 1).collect()
}

/// `1, 2 and 3`.
fn listed(numbers: &[u32]) -> String {
    let texts: Vec<String> = numbers.iter().map(u32::to_string).collect();
    match texts.split_last() {
        Some((last, before)) if !before.is_empty() => format!("{} and {last}", before.join(", ")),
        _ => texts.concat(),
    }
}

/// What could have gone unseen; headed by the verdict if there is none yet.
fn unseen(found: &Identification, elements: usize, headed: bool) -> String {
    let certain = found.certain();
    // What an element that is not certain can hide, the most first.
    let mut hidden: Vec<(usize, f32)> = (0..elements)
        .filter(|e| certain >> e & 1 == 0)
        .map(|e| (e, (ALARM_DEVIATIONS * found.estimate.std[e]).max(ALARM_DAMAGE)))
        .collect();
    hidden.sort_by(|a, b| b.1.total_cmp(&a.1));
    let (Some(&(most_at, most)), Some(&(least_at, least))) = (hidden.first(), hidden.last()) else {
        return "Every element is damaged.".to_owned();
    };
    let amount = |hidden: f32| {
        if hidden >= MAX_DAMAGE as f32 {
            "any loss".to_owned()
        } else {
            format!("a loss of up to {:.0} %", 100.0 * hidden)
        }
    };
    let mut limits = format!("{} in element {}", amount(most), most_at + 1);
    // Both read the same where they differ by less than a point.
    if amount(most) != amount(least) {
        let _ = write!(limits, " (of {:.0} % in element {})", 100.0 * least, least_at + 1);
    }
    if certain != 0 {
        format!("Elsewhere, {limits} could have gone unseen.")
    } else if headed {
        format!("Otherwise, {limits} could have gone unseen.")
    } else if most > HIDDEN {
        format!("Undecided: no damage is beyond doubt, but {limits} could have gone unseen.")
    } else {
        format!("Healthy: no damage is beyond doubt, and none is suspect; {limits} could have gone unseen.")
    }
}

/// How the train ran, and what of that was given.
pub fn ran(ran: &Ran) -> String {
    let mut text = format!(
        "Train: speed {}, first axle enters at {}, load {}",
        known(&ran.speed_kmh, 2, " km/h"),
        known(&ran.entry_s, 3, " s"),
        known(&ran.load, 3, "")
    );
    if ran.stiffness.how != How::Given {
        let _ = write!(
            text,
            "; whole bridge {}",
            known(&ran.stiffness, 3, " of its model's stiffness")
        );
    }
    text + ".\n"
}

/// A value with its range, to as many decimals as the range has meaning.
fn known(number: &Number, decimals: usize, unit: &str) -> String {
    let value = number.value;
    match number.how {
        How::Given => format!("{value:.decimals$}{unit} (given)"),
        How::Guessed => format!("{value:.decimals$}{unit} (guessed)"),
        How::Estimated { std } if std.is_finite() && std > 0.0 => {
            const MOST_DECIMALS: f64 = 6.0;
            let half = TWO_SIDED * std;
            let decimals = (1.0 - half.log10().floor()).clamp(0.0, MOST_DECIMALS) as usize;
            format!("{value:.decimals$} ± {half:.decimals$}{unit} (estimated)")
        }
        How::Estimated { .. } => format!("{value:.decimals$}{unit} (estimated, how surely is not known)"),
    }
}

/// A table of the elements, and what its columns are.
pub fn table(found: &Identification, elements: usize) -> String {
    let estimate = &found.estimate;
    let mut text = format!(
        "{:>7}  {:>7}  {:>16}  {:>9}  {:>12}\n",
        "element", "loss", "95 % interval", "deviation", "significance"
    );
    for e in 0..elements.min(ELEMENTS) {
        let significance = match estimate.significance[e] {
            none if none < 0.05 => "none".to_owned(),
            some if some < 99.95 => format!("{some:.1}"),
            large => format!("{large:.0}"),
        };
        let verdict = if found.certain() >> e & 1 == 1 {
            "  damaged beyond doubt"
        } else {
            ""
        };
        let _ = writeln!(
            text,
            "{:>7}  {:>7}  {:>16}  {:>9}  {significance:>12}{verdict}",
            e + 1,
            tenths(estimate.damage[e]),
            range(estimate.low[e], estimate.high[e]),
            tenths(estimate.std[e]),
        );
    }
    let _ = write!(
        text,
        "loss: of bending stiffness, {:.0} % at most. 95 % interval: holds the true loss 95 times of 100 as far as the model is \
         right; a loss cannot be\nnegative, so an element that seems whole has an upper limit only (Feldman and Cousins). deviation: \
         standard deviation of the loss if\nall other elements may be stiffer or softer than found. significance: standard \
         deviations by which the passage contradicts that the\nelement is whole, the others softer in its place if need be; \
         above {ALARM_DEVIATIONS:.0}, with a loss above {:.0} %, it is beyond doubt.\n",
        100.0 * MAX_DAMAGE,
        100.0 * ALARM_DAMAGE
    );
    text
}

/// How the search ended, what it cost, and what is left unexplained.
pub fn search(found: &Identification) -> String {
    format!(
        "{}, after {} forward solves and {} generations. The model leaves {} of the signal's power unexplained (misfit {:.2e} (m/s²)²).\n",
        match found.stop {
            Stop::Converged => "The search converged",
            Stop::NoProgress => "The search ended where no step, however short, explains the passage better",
            Stop::Budget => "The search did NOT converge: it used up its budget, and there may be a better answer",
        },
        found.forward_solves,
        found.generations,
        percent(found.unexplained.into()),
        found.objective
    )
}

/// Why a search ended, in a word or two.
pub fn stop(stop: Stop) -> &'static str {
    match stop {
        Stop::Converged => "converged",
        Stop::NoProgress => "no progress",
        Stop::Budget => "budget",
    }
}
