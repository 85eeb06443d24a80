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
use spanwatch::identify::estimate::{ALARM_DAMAGE, ALARM_DEVIATIONS, CONTRADICTION, RESOLUTION, TOLD_APART};
use spanwatch::identify::hybrid::{HIDDEN, Rival};
use spanwatch::identify::refine::Stop;
use spanwatch::identify::unknowns::{Theta, with_losses};

use super::percent;

/// A loss below this is not worth a word.
const WORTH_A_WORD: f32 = 0.02;
/// Losses of another explanation, and elements that cannot be told apart, that are told one by one.
const TOLD: usize = 4;
/// Standard deviations to either side of a Gaussian that hold 95 %.
const TWO_SIDED: f64 = 1.96;
/// A bound of an interval is the most that is looked for, if no further from it than this.
const AT_THE_END: f32 = 1e-4;

/// A loss that is none, when it is written.
const NO_LOSS: f32 = 5e-4;

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
#[derive(Debug, Clone, PartialEq)]
pub struct Ran {
    /// Speed as it enters, km/h.
    pub speed_kmh: Number,
    /// When the first axle enters, s of file time.
    pub entry_s: Number,
    /// Load factor.
    pub load: Number,
    /// Stiffness of the whole bridge, as a part of its model's.
    pub stiffness: Number,
    /// Load of each car, front first, as a part of what its kind says; none where they were not weighed.
    pub cars: Vec<f32>,
}

/// The verdict on a bridge of so many elements, sentence after sentence in one line.
pub fn verdict(found: &Identification, elements: usize) -> String {
    let elements = elements.min(ELEMENTS);
    if found.stop == Stop::Budget {
        return "Nothing is decided: the search ran out of time before it had converged. Give speed and entry time, or a narrower range \
                of them."
            .to_owned();
    }
    if !found.explained() {
        return format!(
            "No damage explains this passage: the best leaves {} of the signal's power unexplained. Check train, speed, entry time, \
             load, and the node, unit and sign of each channel; a rough rail can be the reason too.",
            percent(found.unexplained.into())
        );
    }
    if found.estimate.contradiction > CONTRADICTION {
        return format!(
            "Nothing is certain: the passage is explained only if elements have gained stiffness (by {}), so train, speed, track or \
             bridge are not those of the model.",
            deviations(found.estimate.contradiction)
        );
    }
    let certain = found.certain();
    let is_certain = |e: usize| certain >> e & 1 == 1;
    let estimate = &found.estimate;
    let suspect: Vec<usize> = (0..elements)
        .filter(|&e| !is_certain(e) && estimate.damage[e] >= WORTH_A_WORD && estimate.significance[e] >= TOLD_APART)
        .collect();
    let healthy_loses_by = whole_loses_by(found);
    let groups = groups(found, elements);
    // Something is lost, but in which of several elements is not to be told.
    let lost_somewhere =
        certain == 0 && suspect.is_empty() && !groups.is_empty() && healthy_loses_by > ALARM_DEVIATIONS;

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
    if lost_somewhere {
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
    if certain != 0 || !suspect.is_empty() || lost_somewhere {
        sentences.extend(
            groups
                .into_iter()
                .map(|group| cannot_be_told_apart(found, elements, group)),
        );
    }
    sentences.push(unseen(found, elements, !suspect.is_empty() || lost_somewhere));
    sentences.join(" ")
}

/// The verdict as a word, for programs: `out of time`, `unexplained`, `implausible`, `damaged`, `undecided` or `healthy`, as a logger decides
/// whom no learnt track makes doubt.
pub fn kind(found: &Identification, elements: usize) -> &'static str {
    if found.stop == Stop::Budget {
        "out of time"
    } else if !found.explained() {
        "unexplained"
    } else if found.estimate.contradiction > CONTRADICTION {
        "implausible"
    } else if found.certain() != 0 {
        "damaged"
    } else if found.hidden(elements) > HIDDEN {
        "undecided"
    } else {
        "healthy"
    }
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
    match (low > NO_LOSS, open) {
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

/// Sets of elements (bits) that cannot be told apart, one of which at least has a loss that is worth a word. Sets that have an
/// element in common are one. An element that is damaged beyond doubt is in none.
fn groups(found: &Identification, elements: usize) -> Vec<u16> {
    let certain = found.certain();
    let mut groups: Vec<u16> = vec![];
    for e in (0..elements).filter(|&e| found.estimate.damage[e] >= WORTH_A_WORD) {
        let others = inseparable(found, elements, e) & !certain;
        if others == 0 || certain >> e & 1 == 1 {
            continue;
        }
        let (joined, apart): (Vec<u16>, Vec<u16>) =
            (groups.into_iter()).partition(|group| group & (others | 1 << e) != 0);
        groups = apart;
        groups.push(joined.into_iter().fold(others | 1 << e, |all, group| all | group));
    }
    groups
}

fn cannot_be_told_apart(found: &Identification, elements: usize, group: u16) -> String {
    let estimate = &found.estimate;
    let ranges = |which: &dyn Fn(usize) -> bool| -> String {
        let each: Vec<String> = (0..elements)
            .filter(|&e| group >> e & 1 == 1 && which(e))
            .map(|e| format!("element {}: {}", e + 1, range(estimate.low[e], estimate.high[e])))
            .collect();
        each.join(", ")
    };
    if group.count_ones() as usize > TOLD {
        let lost = ranges(&|e| estimate.damage[e] >= WORTH_A_WORD);
        return format!(
            "It cannot be told at this noise whether what else is lost lies where it was found ({lost}) or elsewhere."
        );
    }
    format!(
        "Elements {} cannot be told apart at this noise ({}).",
        listed(&numbers(group)),
        ranges(&|_| true)
    )
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
    let up_to = |hidden: f32| {
        if hidden >= MAX_DAMAGE as f32 {
            "any loss".to_owned()
        } else {
            format!("up to {:.0} %", 100.0 * hidden)
        }
    };
    let limits = if up_to(least) == up_to(most) {
        format!("a loss of {} in any element", up_to(most)).replace("a loss of any", "any")
    } else {
        format!(
            "a loss of {} in element {} and {} in element {}",
            up_to(least),
            least_at + 1,
            up_to(most),
            most_at + 1
        )
    };
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
    text += ".\n";
    if !ran.cars.is_empty() {
        let cars: Vec<String> = ran.cars.iter().map(|load| format!("{load:.3}")).collect();
        let _ = writeln!(
            text,
            "Cars weighed, front first, by their kind's load: {}.",
            cars.join(" ")
        );
    }
    text
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
         standard deviation of the loss. Both\nlet the other elements be stiffer or softer; the loss itself lets none be stiffer than \
         new, and may therefore lie beside its interval.\nsignificance: standard deviations by which the passage contradicts that the \
         element is whole, the others softer in its place if\nneed be; above {ALARM_DEVIATIONS:.0}, with a loss above {:.0} %, it is beyond doubt.\n",
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

#[cfg(test)]
mod tests {
    use spanwatch::capacity::CARS;
    use spanwatch::identify::DamageCode;
    use spanwatch::identify::estimate::Information;
    use spanwatch::identify::unknowns::flexibility;
    use spanwatch::interaction::Run;

    use super::*;

    const GIRDER: usize = 10;

    /// What a search would say of these losses, elements from 1, each flexibility known to `deviation`.
    fn made(lost: &[(usize, f32)], deviation: f32) -> Identification {
        made_of(lost, |information| {
            for e in 0..GIRDER {
                information.matrix[(e, e)] = deviation.powi(-2);
            }
        })
    }

    fn made_of(lost: &[(usize, f32)], matrix: impl Fn(&mut Information)) -> Identification {
        let mut information = Information::ZERO;
        matrix(&mut information);
        let mut damage = [0.0; ELEMENTS];
        for &(element, loss) in lost {
            damage[element - 1] = loss;
        }
        let found = with_losses(Theta::zeros(), &damage)
            .fixed_rows::<ELEMENTS>(0)
            .into_owned();
        information.vector = information.matrix * found;
        Identification {
            estimate: information.estimate(GIRDER),
            information,
            code: DamageCode::nearest(&damage),
            run: Run::at(20.0),
            stiffness: 1.0,
            cars: [1.0; CARS],
            std: [0.0; 4],
            objective: 1e-6,
            objective_healthy: 1e-4,
            unexplained: 0.002,
            mean_squares: Default::default(),
            rival: None,
            forward_solves: 93,
            generations: 6,
            stop: Stop::Converged,
        }
    }

    #[test]
    fn a_certain_loss_comes_first_then_what_else_it_could_be_and_what_is_hidden() {
        let mut found = made(&[(5, 0.111), (6, 0.0)], 0.012);
        let mut damage = [0.0; ELEMENTS];
        (damage[5], damage[9]) = (0.109, 0.02);
        found.rival = Some(Rival {
            whole: 4,
            damage,
            loses_by: 14.2,
        });
        assert_eq!(
            verdict(&found, GIRDER),
            "Element 5 has lost 11.1 % (95 %: 9.2 to 12.9 %) of its bending stiffness, beyond doubt. Were it whole, the next best \
             explanation (element 6: 10.9 %, element 10: 2.0 %) would explain the passage worse by 14 standard deviations. \
             Elsewhere, a loss of up to 6 % in any element could have gone unseen."
        );
        // With a second one the first must be named; a rival that is nearly as good is said to be.
        let mut found = made(&[(1, 0.21), (5, 0.41)], 0.012);
        found.rival = Some(Rival {
            whole: 4,
            damage: [0.0; ELEMENTS],
            loses_by: 2.34,
        });
        let said = verdict(&found, GIRDER);
        assert!(said.starts_with("Element 1 has lost 21.0 % (95 %: "), "{said}");
        assert!(said.contains(" beyond doubt. Element 5 has lost 41.0 %"), "{said}");
        assert!(
            said.contains(
                "Were element 5 whole, the next best explanation (no element less than 2 % off) would explain the passage worse by \
                 only 2.3 standard deviations."
            ),
            "{said}"
        );
    }

    #[test]
    fn what_is_likely_and_not_beyond_doubt_is_suspect() {
        let said = verdict(&made(&[(3, 0.12)], flexibility(0.12) / 4.2), GIRDER);
        assert!(
            said.starts_with(
                "No damage is beyond doubt. Element 3 is suspect: it may have lost 12.0 % (95 %: 6.8 to 16.7 %), which is 4.2 standard \
                 deviations from whole where 5 are beyond doubt. Otherwise, "
            ),
            "{said}"
        );
        let said = verdict(&made(&[(3, 0.04)], 0.005), GIRDER);
        assert!(
            said.contains("Element 3 has lost 4.0 % (95 %: 3.1 to 4.9 %): surely something, but less than the 5 % that raise an alarm."),
            "{said}"
        );
        // A little that is nothing is not spoken of.
        let said = verdict(&made(&[(3, 0.01)], 0.001), GIRDER);
        assert!(said.starts_with("Healthy: "), "{said}");
    }

    #[test]
    fn nothing_found_is_healthy_or_undecided_by_what_it_could_hide() {
        assert_eq!(
            verdict(&made(&[], 0.02), GIRDER),
            "Healthy: no damage is beyond doubt, and none is suspect; a loss of up to 10 % in any element could have gone unseen."
        );
        let blind = made_of(&[], |information| {
            for e in 0..GIRDER {
                information.matrix[(e, e)] = if e == 9 { 50.0 } else { 400.0 };
            }
        });
        assert_eq!(
            verdict(&blind, GIRDER),
            "Undecided: no damage is beyond doubt, but a loss of up to 25 % in element 9 and any loss in element 10 could have gone unseen."
        );
    }

    /// The sum of the flexibilities of some elements is known to 0.01, their differences hardly, the other elements to 0.01.
    fn only_their_sum(information: &mut Information, elements: &[usize]) {
        for e in 0..GIRDER {
            let among = elements.contains(&(e + 1));
            information.matrix[(e, e)] = if among { 100.0 } else { 1e4 };
            for other in elements.iter().filter(|_| among) {
                information.matrix[(e, other - 1)] += 1e4;
            }
        }
    }

    #[test]
    fn elements_that_can_stand_in_for_each_other_are_named_though_none_is_certain() {
        let found = made_of(&[(5, 0.1), (6, 0.1)], |information| {
            only_their_sum(information, &[5, 6])
        });
        assert_eq!(found.certain(), 0);
        let said = verdict(&found, GIRDER);
        assert!(
            said.starts_with(
                "No element is damaged beyond doubt, but the bridge is not as it was: undamaged, it would explain the passage worse by 22 \
                 standard deviations. Elements 5 and 6 cannot be told apart at this noise (element 5: at most "
            ),
            "{said}"
        );
        let found = made_of(&[(5, 0.1), (6, 0.1)], |information| {
            only_their_sum(information, &[4, 5, 6, 7, 8]);
        });
        let said = verdict(&found, GIRDER);
        assert!(
            said.contains("whether what else is lost lies where it was found (element 5: at most ")
                && said.contains(" or elsewhere."),
            "{said}"
        );
    }

    #[test]
    fn what_no_damage_explains_has_no_verdict_and_no_alarm() {
        let found = Identification {
            unexplained: 0.34,
            ..made(&[(5, 0.4)], 0.01)
        };
        let said = verdict(&found, GIRDER);
        assert!(
            said.starts_with(
                "No damage explains this passage: the best leaves 34 % of the signal's power unexplained."
            ),
            "{said}"
        );
        assert!(!said.contains("beyond doubt"), "{said}");
    }

    #[test]
    fn an_element_at_a_bound_has_a_limit_and_not_a_range_to_either_side() {
        for (low, high, words) in [
            (0.0, 0.032, "at most 3.2 %"),
            (1e-5, 0.032, "at most 3.2 %"),
            (0.092, 0.13, "9.2 to 13.0 %"),
            (0.45, 0.7, "45.0 % or more"),
            (0.0, 0.7, "anything"),
        ] {
            assert_eq!(range(low, high), words);
        }
        let text = table(&made(&[(5, 0.3)], 0.01), GIRDER);
        let rows: Vec<&str> = text.lines().skip(1).take(GIRDER).collect();
        assert!(rows[0].contains("at most 1.9 %") && rows[0].ends_with("none"), "{text}");
        assert!(
            rows[4].contains("29.0 to 30.9 %") && rows[4].ends_with("damaged beyond doubt"),
            "{text}"
        );
        assert!(!text.contains('±'), "{text}");
    }

    #[test]
    fn a_number_of_the_run_says_where_it_comes_from_and_how_sure_it_is() {
        let number = |value, how| Number { value, how };
        let estimated = |value, std| number(value, How::Estimated { std });
        let text = ran(&Ran {
            speed_kmh: estimated(60.0213, 0.0102),
            entry_s: number(1.0, How::Given),
            load: number(1.04, How::Guessed),
            stiffness: estimated(0.951, f64::INFINITY),
            cars: vec![0.976, 1.0402],
        });
        assert_eq!(
            text,
            "Train: speed 60.021 ± 0.020 km/h (estimated), first axle enters at 1.000 s (given), load 1.040 (guessed); whole bridge \
             0.951 of its model's stiffness (estimated, how surely is not known).\nCars weighed, front first, by their kind's load: 0.976 1.040.\n"
        );
    }

    #[test]
    fn the_reason_for_which_a_search_ended_is_said() {
        for (stop, words) in [
            (
                Stop::Converged,
                "The search converged, after 93 forward solves and 6 generations.",
            ),
            (Stop::NoProgress, "no step, however short, explains the passage better"),
            (Stop::Budget, "did NOT converge: it used up its budget"),
        ] {
            let text = search(&Identification {
                stop,
                ..made(&[], 0.01)
            });
            assert!(text.contains(words), "{text}");
        }
    }
}
