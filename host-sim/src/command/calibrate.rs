//! `host-sim calibrate`: the rails' profile, and the bridge under it, from recordings of passages while the bridge was healthy.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clap::Args;
use host_sim::calibrate::known::{HALF_WAVE_M, ShortWaves};
use host_sim::calibrate::{self, Calibration, DRIFT_M, FINE_M, Options, Outcome, Passage, calibrate, coarse_m};
use host_sim::replay::{self, Prepared};
use host_sim::station::words::calibration::{self as words, Gain};
use host_sim::track::{Spectrum, table};
use host_sim::{model, output, picture, terminal};
use serde_json::{Value, json};
use spanwatch::bridge::ReducedBridge;

/// Length of the stretches by which is told how well the profile is known, m; before the bridge there are so many.
const STRETCH_M: f64 = 10.0;
const STRETCHES_BEFORE: f64 = 3.0;
/// Largest drift of the rails that makes sense, mm: more is a track that needs tamping.
const MOST_DRIFT_MM: f64 = 1.0;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Recordings of one bridge, a CSV with a TOML of the same stem each; at least five, better sixty
    #[arg(value_name = "REC.csv", required = true)]
    recordings: Vec<PathBuf>,
    /// Where to write what was learnt, for the logger
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// The bridge, where it is not the one that the recordings name: a name or a bridge file NAME.toml
    #[arg(long)]
    bridge: Option<String>,
    /// The bridge may be damaged: look for that, too. Else it is healthy by definition, and later damage counts from there
    #[arg(long)]
    damaged: bool,
    /// What was learnt before the rails were changed: the bridge is as stiff as it was then but for damage, which is looked for and counts
    /// from there
    #[arg(long, value_name = "OLD.blob", conflicts_with = "damaged")]
    since: Option<PathBuf>,
    /// What the rails may change before the next calibration without its being seen, RMS of waves below 20 m, mm
    #[arg(long, default_value_t = 1e3 * DRIFT_M)]
    drift_mm: f64,
    /// Seed of the searches
    #[arg(long, default_value_t = replay::DEFAULT_SEED)]
    seed: u64,
    /// One JSON object instead of sentences
    #[arg(long)]
    json: bool,
    /// Draw the profile and how well it is known into this file, too
    #[arg(long, value_name = "FILE.svg")]
    svg: Option<PathBuf>,
    /// The true track, to be drawn beside it
    #[arg(long, value_name = "FILE.csv", requires = "svg")]
    truth: Option<PathBuf>,
    /// Draw a passage, measured and fitted on the smooth and on the learnt track, into this file, too
    #[arg(long, value_name = "FILE.svg")]
    passage_svg: Option<PathBuf>,
}

impl Arguments {
    fn looks_for_damage(&self) -> bool {
        self.damaged || self.since.is_some()
    }
}

pub(super) fn run(arguments: &Arguments) -> Result<()> {
    check_names(arguments)?;
    if !(0.0..=MOST_DRIFT_MM).contains(&arguments.drift_mm) {
        bail!("--drift-mm must be 0 to {MOST_DRIFT_MM}, not {}", arguments.drift_mm);
    }
    let truth = arguments.truth.as_deref().map(table::read).transpose()?;
    let bar = terminal::progress(arguments.recordings.len() as u64, "reading");
    let mut recordings = Vec::new();
    for path in &arguments.recordings {
        recordings.push(replay::prepare(path, arguments.bridge.as_deref(), arguments.seed)?);
        bar.inc(1);
    }
    bar.finish_and_clear();
    let bridge = one_bridge(&recordings)?.clone();
    for path in [
        Some(&arguments.output),
        arguments.svg.as_ref(),
        arguments.passage_svg.as_ref(),
    ]
    .into_iter()
    .flatten()
    {
        output::check(path)?;
    }

    // A recording in which there is no such passage is left out, as one that is unlike the others is.
    let mut outcomes: Vec<Option<Outcome>> = Vec::new();
    let mut passages = Vec::new();
    for prepared in &mut recordings {
        let name = format!("{}: ", prepared.path.display());
        match Passage::recorded(prepared) {
            Ok(passage) => {
                passages.push(passage);
                outcomes.push(None);
            }
            Err(error) => {
                let reason = format!("{error:#}");
                let reason = reason.strip_prefix(&name).unwrap_or(&reason).to_owned();
                outcomes.push(Some(Outcome::LeftOut(reason)));
            }
        }
    }
    if passages.is_empty()
        && let (Some(Some(Outcome::LeftOut(reason))), Some(prepared)) = (outcomes.first(), recordings.first())
    {
        bail!("{}: {reason}; nothing is left to learn from", prepared.path.display());
    }
    let before = match &arguments.since {
        Some(path) => {
            let old = calibrate::read(path, &bridge)?;
            Some([f64::from(old.stiffness), f64::from(old.damping)])
        }
        None => None,
    };
    let options = Options {
        drift_m: 1e-3 * arguments.drift_mm,
        healthy: !arguments.looks_for_damage(),
        before,
        seed: arguments.seed,
    };
    let bar = terminal::progress(0, "learning");
    let calibration = calibrate(&passages, &options, &|done, of| {
        bar.set_length(of as u64);
        bar.set_position(done as u64);
    })?;
    bar.finish_and_clear();
    let mut told = calibration.passages.iter().cloned();
    let outcomes: Vec<Outcome> = (outcomes.into_iter())
        .filter_map(|before| before.or_else(|| told.next()))
        .collect();

    // Before anything is written: what cannot be kept is no result.
    let blob = calibration.to_blob(&bridge)?;
    let elements = passages[0].observed.bridge.elements;
    let length_m = f64::from(passages[0].observed.bridge.path.length_m());
    let short = calibration.short_waves();
    let stretches = stretches(&short, length_m);
    if let Some(path) = &arguments.svg {
        let title = format!(
            "Track over {}, learnt from its trains",
            passages[0].observed.bridge.name
        );
        picture::track::learnt(path, &title, &calibration, length_m, truth.as_ref())?;
    }
    if let Some(path) = &arguments.passage_svg {
        draw_passage(path, &passages, &calibration, arguments.seed)?;
    }
    output::write(&[(&arguments.output, &blob)])?;
    let names: Vec<String> = recordings
        .iter()
        .map(|prepared| prepared.path.display().to_string())
        .collect();
    let told: Vec<(&str, &Outcome)> = names.iter().map(String::as_str).zip(&outcomes).collect();
    if arguments.json {
        return super::print_json(&as_json(
            &calibration,
            &told,
            &stretches,
            elements,
            arguments.looks_for_damage(),
            arguments.drift_mm,
        ));
    }
    super::print(&in_words(&calibration, &told, &stretches, elements, arguments))
}

/// Nothing is read twice, and nothing that is written may take the place of something that is read, or of something else that is written.
fn check_names(arguments: &Arguments) -> Result<()> {
    for (i, recording) in arguments.recordings.iter().enumerate() {
        let place = place(recording);
        if place.is_some()
            && arguments.recordings[..i]
                .iter()
                .any(|before| self::place(before) == place)
        {
            bail!("{} is given twice, and would count twice", recording.display());
        }
    }
    let mut written: Vec<(&str, &Path)> = vec![("-o", &arguments.output)];
    written.extend(arguments.svg.as_deref().map(|path| ("--svg", path)));
    written.extend(arguments.passage_svg.as_deref().map(|path| ("--passage-svg", path)));
    let descriptions: Vec<PathBuf> = arguments
        .recordings
        .iter()
        .map(|path| path.with_extension("toml"))
        .collect();
    let read = (arguments.recordings.iter().chain(&descriptions).map(PathBuf::as_path))
        .chain(arguments.truth.as_deref())
        .chain(arguments.since.as_deref())
        .chain(arguments.bridge.as_deref().map(Path::new));
    let read: Vec<PathBuf> = read.filter_map(place).collect();
    for (i, (flag, path)) in written.iter().enumerate() {
        if place(path).is_some_and(|place| read.contains(&place)) {
            bail!(
                "{flag} {} would overwrite what is read; choose another name",
                path.display()
            );
        }
        let same = |before: &Path| before == *path || place(before).is_some_and(|before| place(path) == Some(before));
        if let Some((other, _)) = written[..i].iter().find(|(_, before)| same(before)) {
            bail!("{other} and {flag} name the same file {}", path.display());
        }
    }
    Ok(())
}

/// A file by its place, whether it is there or not, and however its folder is named.
fn place(path: &Path) -> Option<PathBuf> {
    path.canonicalize().ok().or_else(|| {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        let folder = folder.unwrap_or(Path::new(".")).canonicalize().ok()?;
        Some(folder.join(path.file_name()?))
    })
}

/// The bridge that all recordings are of.
fn one_bridge(recordings: &[Prepared]) -> Result<&ReducedBridge<f64>> {
    let mut first: Option<(&Prepared, &ReducedBridge<f64>, Vec<u8>)> = None;
    for prepared in recordings {
        let name = prepared.path.display();
        let missing = prepared.missing_keys();
        if !missing.is_empty() {
            bail!("{name}: to learn from it its TOML must give {}", missing.join(" and "));
        }
        let Some(bridge) = prepared
            .bridge
            .as_ref()
            .filter(|_| prepared.configuration.traffic.is_some())
        else {
            let train = prepared.recording.train.as_ref().map_or("", |train| train.name());
            bail!("{name}: the logger does not know train \"{train}\"");
        };
        let blob = model::to_blob(bridge)?;
        match &first {
            None => first = Some((prepared, bridge, blob)),
            Some((other, of, known)) if *known != blob => bail!(
                "{} is of bridge \"{}\", {name} of \"{}\"; a track is learnt from recordings of one bridge",
                other.path.display(),
                of.name,
                bridge.name
            ),
            Some(_) => {}
        }
    }
    let bridge = first.map(|(_, bridge, _)| bridge);
    bridge.context("there is no recording to learn from")
}

/// Draws the passage that is neither the best nor the worst explained.
fn draw_passage(path: &Path, passages: &[Passage], calibration: &Calibration, seed: u64) -> Result<()> {
    let mut used: Vec<(f32, &Passage)> = (passages.iter().zip(&calibration.passages))
        .filter_map(|(passage, outcome)| match outcome {
            Outcome::Used { unexplained, .. } => Some((unexplained[1], passage)),
            Outcome::LeftOut(_) => None,
        })
        .collect();
    used.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (_, passage) = used.get(used.len() / 2).context("no passage was learnt from")?;
    picture::passage_on_tracks(path, passage, calibration, seed)
}

/// A bridge whose stiffness is farther off its model's is worth a word: heat and cold make some per cent.
const FAR_OFF: f32 = 0.05;

/// Rougher than the worst standard class, which has 36, by more than chance.
const ROUGHEST: f64 = 45.0;

/// What makes a result doubtful that looks like one.
fn warnings(found: &Calibration) -> Vec<String> {
    let mut warnings = vec![];
    if !found.settled {
        warnings.push(
            "The last step still changed something: do not rely on this; look for a passage whose train, speed or sensors are not as told."
                .to_owned(),
        );
    }
    if found.level > ROUGHEST {
        warnings.push(
            "That is rougher than any standard track: are the units of the channels right, and what is told of the trains?".to_owned(),
        );
    }
    if let Some(span_m) = coarse_m(&found.knots) {
        warnings.push(format!(
            "For so long a bridge the logger has memory for knots {span_m:.2} m apart, where {FINE_M} m are needed: waves below {:.1} m are learnt in \
             part, and elements may seem off by some points for it.",
            4.0 * span_m
        ));
    }
    warnings
}

/// How well the profile is known over a stretch, by its waves shorter than [`HALF_WAVE_M`].
struct Known {
    from_m: f64,
    to_m: f64,
    /// Root mean squares, m.
    height_m: f64,
    deviation_m: f64,
}

/// The approach as one, then stretches of [`STRETCH_M`] from shortly before the bridge until behind it.
fn stretches(short: &[ShortWaves], length_m: f64) -> Vec<Known> {
    let Some(first) = short.first() else {
        return Vec::new();
    };
    let count = STRETCHES_BEFORE + (length_m / STRETCH_M).ceil() + 1.0;
    let near = (0..=count as usize).map(|i| STRETCH_M * (i as f64 - STRETCHES_BEFORE));
    let bounds: Vec<f64> = std::iter::once(first.x_m).chain(near).collect();
    (bounds.windows(2))
        .filter_map(|pair| {
            let inside: Vec<&ShortWaves> = short.iter().filter(|at| (pair[0]..pair[1]).contains(&at.x_m)).collect();
            let rms = |of: fn(&ShortWaves) -> f64| {
                (inside.iter().map(|at| of(at).powi(2)).sum::<f64>() / inside.len() as f64).sqrt()
            };
            (!inside.is_empty()).then(|| Known {
                from_m: pair[0],
                to_m: pair[1],
                height_m: rms(|at| at.height_m),
                deviation_m: rms(|at| at.deviation_m),
            })
        })
        .collect()
}

fn speeds_kmh(outcomes: &[(&str, &Outcome)]) -> [f64; 2] {
    let speeds = outcomes.iter().filter_map(|(_, outcome)| match outcome {
        Outcome::Used { run, .. } => Some(3.6 * f64::from(run.speed_mps)),
        Outcome::LeftOut(_) => None,
    });
    speeds.fold([f64::INFINITY, 0.0], |[low, high], speed| {
        [low.min(speed), high.max(speed)]
    })
}

fn gain(calibration: &Calibration, outcomes: &[(&str, &Outcome)], elements: usize) -> Gain {
    Gain::of(calibration, elements, speeds_kmh(outcomes))
}

fn mean_unexplained(outcomes: &[(&str, &Outcome)]) -> [f64; 2] {
    let parts: Vec<[f32; 2]> = (outcomes.iter())
        .filter_map(|(_, outcome)| match outcome {
            Outcome::Used { unexplained, .. } => Some(*unexplained),
            Outcome::LeftOut(_) => None,
        })
        .collect();
    [0, 1].map(|i| parts.iter().map(|both| f64::from(both[i])).sum::<f64>() / parts.len() as f64)
}

fn in_words(
    found: &Calibration,
    outcomes: &[(&str, &Outcome)],
    stretches: &[Known],
    elements: usize,
    arguments: &Arguments,
) -> String {
    let mut text = format!(
        "Learnt from {} of {} recordings, {} Gauss-Newton steps; wrote {}.\n",
        found.learnt.passages,
        outcomes.len(),
        found.steps,
        arguments.output.display()
    );
    for (name, outcome) in outcomes {
        if let Outcome::LeftOut(reason) = outcome {
            let _ = writeln!(text, "Left out {name}: {reason}.");
        }
    }
    let (class, level) = Spectrum::nearest_class(found.level);
    let [smooth, learnt] = mean_unexplained(outcomes).map(|part| 100.0 * part);
    let speeds = speeds_kmh(outcomes);
    let _ = writeln!(
        text,
        "\nspeeds       {:.0} to {:.0} km/h\n\
         track        {:.2} of the mean square of FRA class 6, nearest to class {class} ({level:.2})\n\
         stiffness    {:.4} ± {:.4} of the model's\n\
         damping      {:.3} ± {:.3} of the model's\n\
         unexplained  {smooth:.2} % of a passage's power on a smooth track, {learnt:.2} % on the learnt one (mean)",
        speeds[0],
        speeds[1],
        found.level,
        found.learnt.stiffness,
        2.0 * found.bridge_std[0],
        found.learnt.damping,
        2.0 * found.bridge_std[1]
    );
    for warning in warnings(found) {
        let _ = writeln!(text, "{warning}");
    }
    let off = found.learnt.stiffness - 1.0;
    if off.abs() > FAR_OFF {
        let _ = writeln!(
            text,
            "The bridge is {:.0} % {} than its model: are the model's mass and stiffness those of this bridge, or is it damaged already?",
            100.0 * off.abs(),
            if off < 0.0 { "softer" } else { "stiffer" }
        );
    }
    let _ = writeln!(
        text,
        "\nprofile, waves shorter than {HALF_WAVE_M:.0} m, rms     height      known to (standard deviation)"
    );
    for known in stretches {
        let _ = writeln!(
            text,
            "{:>7.0} m to {:>4.0} m                      {:8.3} mm   {:8.4} mm",
            known.from_m,
            known.to_m,
            1e3 * known.height_m,
            1e3 * known.deviation_m
        );
    }
    if arguments.looks_for_damage() {
        let _ = writeln!(text, "\nelement  loss of bending stiffness, ± two standard deviations");
        for (e, [loss, deviation]) in found.damage.iter().take(elements).enumerate() {
            let _ = writeln!(text, "{:>7}  {:5.1} % ± {:.1}", e + 1, 100.0 * loss, 200.0 * deviation);
        }
        let _ = writeln!(text, "{}", words::damage(&found.damage[..elements]));
    }
    let unseen_mm = 1e3 * found.unseen_m;
    let _ = writeln!(
        text,
        "\nelement  no number of later passages knows its loss better than, in points (standard deviation)\n\
         {:>7}  by what is left unknown of the profile   if the rails change by {:.3} mm   by {unseen_mm:.3} mm",
        "", arguments.drift_mm
    );
    let floors = (found.floor.iter().zip(&found.floor_learnt)).zip(&found.floor_unseen);
    for (e, ((all, of_profile), unseen)) in floors.take(elements).enumerate() {
        let [of_profile, all, unseen] = [of_profile, all, unseen].map(|floor| 100.0 * floor);
        let _ = writeln!(text, "{:>7}  {of_profile:19.2} {all:42.2} {unseen:13.2}", e + 1);
    }
    let _ = writeln!(
        text,
        "\nThe logger believes the middle one: {:.3} mm rms in waves below 20 m is what the rails may change until the next calibration \
         (--drift-mm). It sees a lasting change of such waves itself from {unseen_mm:.3} mm on; one between the two can pass for losses of the \
         size in the last column.",
        arguments.drift_mm
    );
    let _ = writeln!(text, "\n{}", words::gain(&gain(found, outcomes, elements)));
    text
}

fn as_json(
    found: &Calibration,
    outcomes: &[(&str, &Outcome)],
    stretches: &[Known],
    elements: usize,
    damaged: bool,
    drift_mm: f64,
) -> Value {
    let passages: Vec<Value> = (outcomes.iter())
        .map(|(name, outcome)| match outcome {
            Outcome::Used { run, unexplained } => json!({
                "recording": name,
                "used": true,
                "speed_kmh": 3.6 * run.speed_mps,
                "load_factor": run.load_factor,
                "unexplained_smooth": unexplained[0],
                "unexplained": unexplained[1],
            }),
            Outcome::LeftOut(reason) => json!({ "recording": name, "used": false, "reason": reason }),
        })
        .collect();
    let profile: Vec<Value> = (stretches.iter())
        .map(|known| {
            json!({
                "from_m": known.from_m,
                "to_m": known.to_m,
                "height_rms_mm": 1e3 * known.height_m,
                "std_rms_mm": 1e3 * known.deviation_m,
            })
        })
        .collect();
    let of_damage = |i: usize| {
        let values = found.damage.iter().take(elements).map(|both| both[i]);
        damaged.then(|| values.collect::<Vec<f64>>())
    };
    let [smooth, learnt] = mean_unexplained(outcomes);
    let (class, _) = Spectrum::nearest_class(found.level);
    let gain = gain(found, outcomes, elements);
    json!({
        "used": found.learnt.passages,
        "steps": found.steps,
        "warnings": warnings(found),
        "level": found.level,
        "nearest_fra_class": class,
        "stiffness_factor": found.learnt.stiffness,
        "stiffness_std": found.bridge_std[0],
        "damping_factor": found.learnt.damping,
        "damping_std": found.bridge_std[1],
        "unexplained_smooth": smooth,
        "unexplained": learnt,
        "damage": of_damage(0),
        "damage_std": of_damage(1),
        "floor": &found.floor[..elements],
        "floor_of_profile": &found.floor_learnt[..elements],
        "floor_unseen_change": &found.floor_unseen[..elements],
        "drift_mm": drift_mm,
        "unseen_change_mm": 1e3 * found.unseen_m,
        "profile": profile,
        "more_passages_help": gain.more_passages(),
        "other_speeds_help": gain.other_speeds(),
        "passages": passages,
    })
}
