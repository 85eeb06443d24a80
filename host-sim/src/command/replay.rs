//! `host-sim replay`: recordings through a logger, and what it says of them.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clap::Args;
use host_sim::recording::Recording;
use host_sim::replay::{self, Keep, Told};
use host_sim::station::{store::Store, words};
use host_sim::{calibrate, output};
use serde_json::json;
use spanwatch::wire::message::{Alert, PassageReport, Quantity, Status, TrackState, Verdict};

use super::reach::Reach;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Recordings, each a CSV with a TOML of the same stem beside it
    #[arg(required = true, value_name = "REC.csv")]
    recordings: Vec<PathBuf>,
    #[command(flatten)]
    reach: Reach,
    /// The bridge, where it is not the one that the recording names: a name or a bridge file NAME.toml
    #[arg(long)]
    bridge: Option<String>,
    /// One JSON object a line instead of sentences
    #[arg(long)]
    json: bool,
    /// SQLite file that alerts are appended to
    #[arg(long, default_value = "spanwatch.sqlite", value_name = "FILE")]
    database: PathBuf,
    /// What all passages say of the bridge: the logger goes on from this file and leaves what it knows then in it. Without it each
    /// recording stands alone
    #[arg(long, value_name = "FILE")]
    evidence: Option<PathBuf>,
    /// A track that was learnt (host-sim calibrate): the logger monitors with it
    #[arg(long, value_name = "FILE.blob")]
    track: Option<PathBuf>,
    /// Folder for the passages that the learnt track does not explain, as recordings to learn it anew from
    #[arg(long, value_name = "DIR", requires = "track")]
    keep: Option<PathBuf>,
    /// Seed of the logger's search
    #[arg(long, default_value_t = replay::DEFAULT_SEED)]
    seed: u64,
}

pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let mut prepared = arguments
        .recordings
        .iter()
        .map(|path| replay::prepare(path, arguments.bridge.as_deref(), arguments.seed))
        .collect::<Result<Vec<_>>>()?;
    let track = match &arguments.track {
        Some(path) => {
            prepared.iter_mut().for_each(replay::Prepared::loosen);
            // Before anything is replayed: it must be of all their bridges.
            for bridge in prepared.iter().filter_map(|prepared| prepared.bridge.as_ref()) {
                calibrate::read(path, bridge)?;
            }
            Some(std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?)
        }
        None => {
            prepared.iter().try_for_each(replay::Prepared::refuse_irregular)?;
            None
        }
    };
    // An alert must not be lost because its file turns out to be no place for it; without an alert none is made.
    let mut store = match arguments.database.exists() {
        true => Some(Store::open(&arguments.database)?),
        false => {
            output::check(&arguments.database)?;
            None
        }
    };
    let mut evidence = match &arguments.evidence {
        Some(path) if path.exists() => {
            Some(std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?)
        }
        Some(path) => {
            output::check(path)?;
            None
        }
        None => None,
    };
    // The base station has stored what comes through it.
    let by_station = arguments.reach.by_station();
    let mut station = arguments.reach.station()?;
    if track.is_none() && station.status()?.track != TrackState::Unknown {
        eprintln!("note: the logger has been given a learnt track before, and monitors its bridge with that");
    }
    let (mut samples, mut passages, mut alerts) = (0, 0, 0);
    let mut last = None;
    for prepared in &prepared {
        let source = prepared.path.display().to_string();
        if !arguments.json {
            let open = prepared.missing_keys();
            let open = match open.as_slice() {
                [] => String::new(),
                keys => format!(" (without {}: nothing will be identified)", keys.join(", ")),
            };
            super::print(&format!("{source}{open}\n"))?;
        }
        let before = passages;
        let tell = |told: &Told| match told {
            Told::Passage { report, start_s, end_s } => {
                passages += 1;
                if arguments.json {
                    super::print_json(&passage_json(report, &prepared.quantities(), *start_s, *end_s, &source))
                } else {
                    super::print(&format!(
                        "  {}\n",
                        words::passage(report, &prepared.quantities(), *start_s, *end_s)
                    ))
                }
            }
            Told::Track { report, start_s } => {
                if arguments.json {
                    super::print_json(&json!({
                        "event": "track",
                        "recording": source,
                        "state": "changed",
                        "passage": report.passage,
                        "since": report.since,
                        "start_s": start_s,
                        "misfit": report.misfit,
                        "mean_misfit": report.mean_misfit,
                    }))
                } else {
                    super::print(&format!("  {}\n", words::track_changed(report, *start_s)))
                }
            }
            Told::Alert { heard, alert, start_s } => {
                alerts += 1;
                let text = words::alert(alert);
                if !by_station {
                    open_store(&mut store, &arguments.database)?.keep_heard(heard, &source, *start_s)?;
                }
                if arguments.json {
                    super::print_json(&alert_json(alert, *start_s, &source))
                } else {
                    super::print(&format!("  {text}\n"))
                }
            }
        };
        let mut write = |recording: &Recording, number: u32| match &arguments.keep {
            Some(folder) => keep(folder, &prepared.path, recording, number),
            None => Ok(()),
        };
        let write: &mut Keep<'_> = &mut write;
        let kept = arguments.keep.is_some().then_some(write);
        let status = prepared.replay_keeping(&mut station, track.as_deref(), evidence.as_deref(), tell, kept)?;
        if status.passages == 0 && !arguments.json {
            super::print(&format!(
                "  {}\n",
                words::no_passage(&prepared.recording, &prepared.configuration.trigger)
            ))?;
        }
        let unheard = status.passages.saturating_sub(passages - before);
        if unheard > 0 {
            eprintln!(
                "note: {source}: of {} passages {unheard} were not reported here; where a base station was away meanwhile, it has them now (host-sim \
                 query passages)",
                status.passages
            );
        }
        samples += status.samples;
        // The logger counts anew with each recording.
        last = Some(Status {
            samples,
            passages,
            alerts,
            ..status
        });
        if let Some(path) = arguments.evidence.as_ref().filter(|_| prepared.bridge.is_some()) {
            let bytes = station.evidence()?;
            output::write(&[(path, &bytes)])?;
            evidence = Some(bytes);
        }
    }
    let Some(status) = last else { return Ok(()) };
    if status.setup.generation > 0 {
        // It was given what the recordings need; it goes on with what it keeps.
        station.reload_setup()?;
    }
    let rejected = u64::from(station.rejected()) + u64::from(status.rejected);
    if arguments.json {
        return super::print_json(&json!({
            "event": "summary",
            "samples": samples,
            "passages": passages,
            "alerts": alerts,
            "frames": station.frames() + u64::from(status.frames),
            "rejected": rejected,
            "overruns": status.health.overruns,
            "restart": format!("{:?}", status.health.restart),
        }));
    }
    let stored = match alerts {
        0 => String::new(),
        _ if by_station => " The base station has stored the alerts.".to_owned(),
        _ => format!(" The alerts are stored in {}.", arguments.database.display()),
    };
    super::print(&format!("{}{stored}\n", words::status(&status)))
}

/// Writes a passage that the learnt track did not explain into `folder`, named by the recording it is of and its number.
fn keep(folder: &Path, source: &Path, recording: &Recording, number: u32) -> Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    let stem = source.file_stem().unwrap_or_default().to_string_lossy();
    let path = folder.join(format!("{stem}-passage{number}.csv"));
    let remark =
        format!("Passage {number} of {stem}, as a logger kept it: the track that it had learnt does not explain it.");
    recording.write(&path, &[remark])
}

fn open_store<'s>(store: &'s mut Option<Store>, path: &Path) -> Result<&'s mut Store> {
    match store {
        Some(store) => Ok(store),
        none => Ok(none.insert(Store::open(path)?)),
    }
}

/// Peaks are one a channel: of an acceleration in `peak_mps2`, of a displacement in `peak_mm`, else null.
fn passage_json(
    report: &PassageReport,
    quantities: &[Quantity],
    start_s: f64,
    end_s: f64,
    source: &str,
) -> serde_json::Value {
    let (verdict, fit, hidden) = match report.verdict {
        Verdict::Healthy { fit, hidden_permille } => ("healthy".to_owned(), Some(fit), Some(hidden_permille)),
        Verdict::Undecided { fit, hidden_permille } => ("undecided".to_owned(), Some(fit), Some(hidden_permille)),
        Verdict::Damaged { fit } => ("damaged".to_owned(), Some(fit), None),
        Verdict::NotIdentified(reason) => (format!("not identified: {reason:?}"), None, None),
    };
    let peaks = |quantity: Quantity, factor: f32| -> Vec<Option<f32>> {
        let of_channel = report.peak.iter().zip(quantities);
        of_channel
            .map(|(&peak, &of)| (of == quantity).then_some(factor * peak))
            .collect()
    };
    json!({
        "event": "passage",
        "recording": source,
        "passage": report.passage,
        "start_s": start_s,
        "end_s": end_s,
        "verdict": verdict,
        "objective": fit.map(|fit| fit.objective),
        "unexplained": fit.map(|fit| fit.unexplained),
        "speed_kmh": fit.map(|fit| 3.6 * fit.speed_mps),
        "entry_stream_s": fit.map(|fit| fit.entry_time_s),
        "load_factor": fit.map(|fit| fit.load_factor),
        "stiffness_factor": fit.map(|fit| fit.stiffness),
        "change": fit.map(|fit| format!("{:?}", fit.change).to_lowercase()),
        "hidden": hidden.map(|permille| f64::from(permille) / 1000.0),
        "peak_mps2": peaks(Quantity::Acceleration, 1.0),
        "peak_mm": peaks(Quantity::Displacement, 1e3),
        "level_db": report.level_db,
        "missing": report.quality.missing,
        "saturated": report.quality.saturated,
        "stuck": report.quality.stuck,
    })
}

fn alert_json(alert: &Alert, start_s: f64, source: &str) -> serde_json::Value {
    let fraction = |permille: &u16| f64::from(*permille) / 1000.0;
    json!({
        "event": "alert",
        "recording": source,
        "bridge": alert.bridge.as_str(),
        "passage": alert.passage,
        "start_s": start_s,
        "damage": alert.damage_permille.iter().map(fraction).collect::<Vec<_>>(),
        "damage_std": alert.std_permille.iter().map(fraction).collect::<Vec<_>>(),
        "damage_low": alert.low_permille.iter().map(fraction).collect::<Vec<_>>(),
        "damage_high": alert.high_permille.iter().map(fraction).collect::<Vec<_>>(),
        "certain": super::certain_elements(alert.certain),
        "passages": alert.passages,
        "rival": alert.rival.as_ref().map(|rival| json!({
            "whole_element": rival.whole,
            "damage": rival.damage_permille.iter().map(fraction).collect::<Vec<_>>(),
            "loses_by": rival.loses_by,
        })),
        "objective": alert.objective,
        "objective_healthy": alert.objective_healthy,
        "forward_solves": alert.forward_solves,
    })
}
