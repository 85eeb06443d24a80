//! What a logger reports, as sentences for an engineer.

use std::fmt::Write as _;

use spanwatch::identify::evidence::Change;
use spanwatch::wire::message::{
    Alert, Fit, PassageReport, Quality, Quantity, Reason, Restart, Status, TrackReport, Trigger, Verdict,
};

use crate::recording::Recording;

pub mod calibration;
pub mod identification;

/// Damage below this, per mille, is not worth a word.
const WORTH_A_WORD_PERMILLE: u16 = 20;

/// A passage, with times in the recording's own clock; `quantities` are those of its channels.
pub fn passage(report: &PassageReport, quantities: &[Quantity], start_s: f64, end_s: f64) -> String {
    let peak = |quantity: Quantity| {
        let of_it = report.peak.iter().zip(quantities).filter(|(_, of)| **of == quantity);
        of_it.map(|(&peak, _)| peak).reduce(f32::max)
    };
    let mut text = format!(
        "Passage {}: {start_s:.2} s to {end_s:.2} s, peak {:.3} m/s²",
        report.passage,
        peak(Quantity::Acceleration).unwrap_or(0.0)
    );
    if let Some(peak_m) = peak(Quantity::Displacement) {
        let _ = write!(text, " and {:.3} mm", 1e3 * peak_m);
    }
    let _ = write!(
        text,
        ", level {:.0} dB re 1 µm/s².{}",
        report.level_db,
        judgement(report)
    );
    text
}

/// A passage, where nothing is known of its recording.
pub fn verdict(report: &PassageReport) -> String {
    format!("Passage {}.{}", report.passage, judgement(report))
}

/// What the logger makes of a passage; begins with a space.
fn judgement(report: &PassageReport) -> String {
    let mut text = String::new();
    let _ = match &report.verdict {
        Verdict::Healthy { fit, hidden_permille } => write!(
            text,
            " Healthy: no damage beyond doubt. A loss of up to {:.0} % in one element could have gone unseen; {}.",
            f64::from(*hidden_permille) / 10.0,
            left(fit)
        ),
        Verdict::Undecided { fit, hidden_permille } => write!(
            text,
            " Undecided: no damage beyond doubt, but a loss of up to {:.0} % in one element could have gone unseen; {}.",
            f64::from(*hidden_permille) / 10.0,
            left(fit)
        ),
        Verdict::Damaged { fit } => write!(text, " Damage: see the alert; {}.", left(fit)),
        Verdict::NotIdentified(reason) => write!(text, " Nothing was identified: {}.", why(reason)),
    };
    if let Some(fit) = report.verdict.fit() {
        let _ = write!(text, "{}", changed(fit.change));
    }
    if report.quality.total() > 0 {
        let _ = write!(text, " Among its samples {}.", faults(&report.quality));
    }
    text
}

/// The track has changed.
pub fn track_changed(report: &TrackReport, start_s: f64) -> String {
    let since = match report.since {
        0 => String::new(),
        since if since == report.passage => String::new(),
        since => format!(", perhaps since passage {since}"),
    };
    format!(
        "TRACK CHANGED, seen in passage {} at {start_s:.2} s{since}. Passages leave more unexplained than healthy ones did: in \
         standard deviations {:+.1} this one, {:+.1} the last twenty that were believed, on average. The rails were changed, or trains, speeds or a sensor are not what is told; whether there is damage \
         beside that is not known. Nothing is identified until the track is learnt anew from passages \
         after the change (host-sim calibrate --since OLD.blob, which looks for damage, too); what was known of the bridge is kept.",
        report.passage, report.misfit, report.mean_misfit
    )
}

/// What a passage changed in what is believed of the bridge.
fn changed(change: Change) -> &'static str {
    match change {
        Change::None => "",
        Change::Outlier => {
            " It contradicts the passages before it and is kept apart until another one agrees: the bridge has changed, or it was \
             another train."
        }
        Change::Sudden => " The bridge has changed suddenly: what was known of it before is given up.",
        Change::Unusable => " It says nothing of any element.",
    }
}

/// A recording in which no passage was found.
pub fn no_passage(recording: &Recording, trigger: &Trigger) -> String {
    let accelerations = (recording.channels.iter()).filter(|channel| channel.unit.quantity() == Quantity::Acceleration);
    let strongest = accelerations.map(|channel| {
        let mean = channel.values.iter().sum::<f64>() / channel.values.len().max(1) as f64;
        channel
            .values
            .iter()
            .fold(0.0_f64, |most, value| most.max((value - mean).abs()))
    });
    format!(
        "No passage was found. The strongest motion in the file is {:.4} m/s²; a passage begins where the level stays above {} \
         times the quiet level, and above {:.4} m/s², for {} s, and the quiet level is learnt from half a second before it. If \
         there was a train, check the channels' units and that the file begins before it.",
        strongest.fold(0.0, f64::max),
        trigger.on_ratio,
        trigger.on_ratio * trigger.floor_mps2,
        trigger.on_duration_s
    )
}

/// How well the passage is explained.
fn left(fit: &Fit) -> String {
    format!(
        "the model leaves {} of the signal's power unexplained",
        percent(f64::from(fit.unexplained))
    )
}

/// A fraction in per cent, with two digits however small it is.
pub fn percent(fraction: f64) -> String {
    match fraction * 100.0 {
        percent if percent < 0.01 => "less than 0.01 %".to_owned(),
        percent if percent < 1.0 => format!("{percent:.2} %"),
        percent => format!("{percent:.0} %"),
    }
}

/// Why nothing was identified.
pub fn why(reason: &Reason) -> String {
    match reason {
        Reason::NoModel => "the logger has no model of this bridge".to_owned(),
        Reason::NoTraffic => "the logger was not told which train passes".to_owned(),
        Reason::TooLong => "the passage is longer than the logger can keep or identify".to_owned(),
        Reason::Busy => "the logger was still identifying an earlier passage".to_owned(),
        Reason::AnotherTrack => {
            "it is explained worse than any healthy passage on the track that was learnt: the track has changed, or it was another train"
                .to_owned()
        }
        Reason::Uncalibrated => {
            "no train of this kind, speed and direction was among those that the track was learnt from; learn it from such trains, too".to_owned()
        }
        Reason::Interrupted => "another model of the bridge came before the search was over".to_owned(),
        Reason::BadQuality => "too many of its samples cannot be used".to_owned(),
        Reason::NotThisTrain => {
            "the train that was announced did not enter the bridge during it, or takes longer to cross it".to_owned()
        }
        Reason::Setup(error) => format!("train, bridge and sensors do not go together ({error})"),
        Reason::OutOfTime => {
            "the search could not be ended in time; give speed and entry time, or a narrower range of them".to_owned()
        }
        Reason::Implausible => {
            "the record is explained only if elements have gained stiffness, so train, speed, track or bridge are not those of \
             the model"
                .to_owned()
        }
        Reason::Unexplained => {
            "no pattern of damage explains the record; check train, speed, entry time, and the node, unit and sign of \
             each channel; a rough rail can be the reason too"
                .to_owned()
        }
    }
}

/// Faults of samples.
pub fn faults(quality: &Quality) -> String {
    let parts: Vec<String> = [
        (quality.missing, "missing"),
        (quality.saturated, "saturated"),
        (quality.stuck, "stuck"),
    ]
    .into_iter()
    .filter(|(count, _)| *count > 0)
    .map(|(count, what)| format!("{count} {what}"))
    .collect();
    if parts.is_empty() {
        "none bad".to_owned()
    } else {
        parts.join(", ")
    }
}

/// An alert.
pub fn alert(alert: &Alert) -> String {
    let percent = |permille: u16| f64::from(permille) / 10.0;
    let is_certain = |e: usize| alert.certain >> e & 1 == 1;
    let ranges = || alert.low_permille.iter().zip(&alert.high_permille);
    let elements = || {
        (alert.damage_permille.iter().zip(&alert.std_permille))
            .zip(ranges())
            .enumerate()
    };
    let loss = |damage: u16, (&low, &high): (&u16, &u16)| {
        format!("{:.1} % ({:.1} to {:.1})", percent(damage), percent(low), percent(high))
    };
    let certain: Vec<String> = elements()
        .filter(|(e, _)| is_certain(*e))
        .map(|(e, ((&damage, _), range))| format!("element {} has lost {}", e + 1, loss(damage, range)))
        .collect();
    let possible: Vec<String> = elements()
        .filter(|(e, ((damage, std), _))| !is_certain(*e) && **damage >= WORTH_A_WORD_PERMILLE && *damage > *std)
        .map(|(e, ((&damage, _), range))| format!("element {} {}", e + 1, loss(damage, range)))
        .collect();
    let mut text = format!(
        "ALERT, bridge {}, passage {}: {} of its bending stiffness, beyond doubt.",
        alert.bridge,
        alert.passage,
        certain.join("; ")
    );
    if !possible.is_empty() {
        let _ = write!(text, " Possible, not certain: {}.", possible.join("; "));
    }
    let _ = match alert.passages {
        passages if passages > 1.0 => write!(text, " It rests on {passages:.0} passages; the ranges hold 95 %."),
        _ => write!(text, " It rests on this passage alone; the ranges hold 95 %."),
    };
    if let Some(rival) = &alert.rival {
        let _ = write!(
            text,
            " If element {} were whole, this passage would be explained worse by {:.0} standard deviations at best.",
            rival.whole, rival.loses_by
        );
    }
    let _ = write!(
        text,
        " Without damage the misfit would be {:.0} times larger; {} forward solves.",
        alert.objective_healthy / alert.objective.max(f32::MIN_POSITIVE),
        alert.forward_solves
    );
    text
}

/// How a logger is.
pub fn status(status: &Status) -> String {
    let mut text = format!(
        "Logger: {} samples ({}), {}, {}; {} frames taken, {} refused, {} bytes lost.",
        status.samples,
        faults(&status.quality),
        counted(status.passages, "passage"),
        counted(status.alerts, "alert"),
        status.frames,
        status.rejected,
        status.health.overruns
    );
    if status.health.stack_peak_bytes > 0 {
        let _ = write!(text, " Stack {} bytes at most.", status.health.stack_peak_bytes);
    }
    if status.setup.generation > 0 {
        let _ = write!(text, " It keeps setup {}.", status.setup.generation);
    }
    if status.setup.rolled_back {
        text += " That is not its newest: it has refused that one at its start.";
    }
    if status.health.restart != Restart::PowerOn {
        let _ = write!(text, " It has restarted {}.", restart(status.health.restart));
    }
    text
}

/// So many of them.
fn counted(number: u32, what: &str) -> String {
    format!("{number} {what}{}", if number == 1 { "" } else { "s" })
}

/// Why a logger has restarted.
pub fn restart(restart: Restart) -> &'static str {
    match restart {
        Restart::PowerOn => "because its power came on",
        Restart::Request => "because somebody reset it",
        Restart::Panic => "after a panic",
        Restart::Fault => "after a processor fault",
        Restart::Watchdog => "because it hung",
    }
}
