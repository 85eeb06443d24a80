//! The whole way, killed: the firmware's image in QEMU on a flash that outlives it, a faulty line, and the program `base-station`. Image and
//! base station are killed with SIGKILL at any moment and started again, while trains pass.
//!
//! What must have arrived is known from the image's own log: it logs each alert and report just before it puts it on its flash. Of each of its
//! runs, what the base station has stored must be that, in that order, without the last if the kill fell between.

use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use spanwatch::session::Device;
use spanwatch::settings::Settings;
use spanwatch::wire::message::{BLOCK_COUNTS, Event, Notice};

use super::line::Chance;
use crate::channel::pc::PcFlash;
use crate::channel::{Console, Qemu, tcp};
use crate::keys::KeyFile;
use crate::replay::{self, Prepared};
use crate::station::Station;
use crate::station::store::Store;

/// The logger's number.
const LOGGER: Device = 7;
/// Longest time between two kills, ms.
const LONGEST_RUN_MS: u64 = 12_000;
/// Part of the pieces on the line to which something happens.
const FAULT_RATE: f64 = 0.01;
/// After the last kill everything has arrived within this time.
const END_TIMEOUT: Duration = Duration::from_secs(120);

/// What happened.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Outcome {
    /// Kills of the image.
    pub logger_kills: u32,
    /// Kills of the base station.
    pub station_kills: u32,
    /// Faults of the line.
    pub faults: u64,
    /// Alerts and reports that the image has logged.
    pub logged: u32,
    /// Alerts among them.
    pub alerts: u32,
    /// Those that are stored.
    pub stored: u32,
    /// The last of a run, logged and not on the flash when the image was killed.
    pub cut_off: u32,
    /// Missing.
    pub lost: u32,
    /// Stored twice, in another order, or never logged.
    pub wrong: u32,
    /// Seconds.
    pub seconds: u32,
}

impl Outcome {
    /// Nothing was lost, and nothing invented.
    pub fn is_clean(&self) -> bool {
        self.lost == 0 && self.wrong == 0
    }
}

/// The image and the line to it.
struct Logger {
    stop: Arc<AtomicBool>,
    thread: JoinHandle<Vec<String>>,
}

/// What every run of it needs.
struct World {
    program: PathBuf,
    image: PathBuf,
    folder: PathBuf,
    loggers: u16,
    console: u16,
    faults: Arc<AtomicU64>,
}

/// An alert or a report, by its kind and the number of its passage.
type Word = (&'static str, u32);

/// Kills image or base station `kills` times while the passage of `recording` comes again and again. `program` is this program,
/// for its command `base-station`; everything lies in `folder`, which is empty.
pub fn run(
    program: &Path,
    image: &Path,
    recording: &Path,
    folder: &Path,
    kills: u32,
    seed: u64,
    mut done: impl FnMut(u32),
) -> Result<Outcome> {
    let start = Instant::now();
    let prepared = replay::prepare(recording, None, replay::DEFAULT_SEED)?;
    let [loggers, console] = free_ports()?;
    let world = World {
        program: program.to_owned(),
        image: image.to_owned(),
        folder: folder.to_owned(),
        loggers,
        console,
        faults: Arc::default(),
    };
    let keys = world.keys();
    let identity = keys.add(LOGGER, None)?;
    keys.add_console()?;
    let [_, settings] = PcFlash::in_file(&world.flash())?;
    Settings::new(settings).set_identity(&identity)?;

    let mut chance = Chance::new(seed);
    let mut outcome = Outcome::default();
    let mut logged: Vec<Vec<Word>> = vec![];
    let mut station = world.start_station()?;
    let mut logger = world.start_logger(chance.below(u64::MAX));
    provide(&world, &prepared)?;
    let passing = Trains::start(&world, prepared)?;
    for kill in 0..kills {
        thread::sleep(Duration::from_millis(chance.below(LONGEST_RUN_MS)));
        let whom = chance.below(3);
        if whom != 1 {
            logged.extend(logger.kill()?);
            outcome.logger_kills += 1;
            logger = world.start_logger(chance.below(u64::MAX));
        }
        if whom != 0 {
            station
                .kill()
                .and_then(|()| station.wait())
                .context("the base station cannot be killed")?;
            outcome.station_kills += 1;
            station = world.start_station()?;
        }
        done(kill);
    }
    passing.end()?;
    let deadline = Instant::now() + END_TIMEOUT;
    while !world.is_all_here()? && Instant::now() < deadline {
        thread::sleep(Duration::from_millis(200));
    }
    logged.extend(logger.kill()?);
    station
        .kill()
        .and_then(|()| station.wait())
        .context("the base station cannot be killed")?;
    let killed_runs = logged.len().saturating_sub(1);
    for (run, words) in logged.iter().enumerate() {
        compare(words, &world.stored(run as u32 + 1)?, run < killed_runs, &mut outcome);
    }
    outcome.faults = world.faults.load(Ordering::Relaxed);
    outcome.seconds = start.elapsed().as_secs() as u32;
    Ok(outcome)
}

/// Counts what is missing, or should not be there, of one run of the image.
fn compare(logged: &[Word], stored: &[Word], killed: bool, outcome: &mut Outcome) {
    outcome.logged += logged.len() as u32;
    outcome.alerts += logged.iter().filter(|(kind, _)| *kind == "alert").count() as u32;
    outcome.stored += stored.len() as u32;
    let same = logged
        .iter()
        .zip(stored)
        .take_while(|(one, other)| one == other)
        .count();
    outcome.wrong += (stored.len() - same) as u32;
    let mut missing = (logged.len() - same) as u32;
    if killed && missing > 0 {
        missing -= 1;
        outcome.cut_off += 1;
    }
    outcome.lost += missing;
}

impl World {
    fn keys(&self) -> KeyFile {
        KeyFile::at(&self.folder.join("keys.toml"))
    }

    fn flash(&self) -> PathBuf {
        self.folder.join("flash.bin")
    }

    fn database(&self) -> PathBuf {
        self.folder.join("base.sqlite")
    }

    fn start_station(&self) -> Result<Child> {
        let child = Command::new(&self.program)
            .arg("base-station")
            .arg("--listen")
            .arg(format!("127.0.0.1:{}", self.loggers))
            .arg("--console")
            .arg(format!("127.0.0.1:{}", self.console))
            .arg("--database")
            .arg(self.database())
            .arg("--keys")
            .arg(self.keys().path())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .context("the base station cannot be started")?;
        let deadline = Instant::now() + Duration::from_secs(10);
        while TcpStream::connect((Ipv4Addr::LOCALHOST, self.loggers)).is_err() {
            if Instant::now() > deadline {
                bail!("the base station does not listen");
            }
            thread::sleep(Duration::from_millis(20));
        }
        Ok(child)
    }

    fn start_logger(&self, seed: u64) -> Logger {
        let stop = Arc::new(AtomicBool::new(false));
        let (image, flash) = (self.image.clone(), self.flash());
        let address = format!("127.0.0.1:{}", self.loggers);
        let (ended, faults) = (Arc::clone(&stop), Arc::clone(&self.faults));
        let thread = thread::spawn(move || {
            let mut chance = Chance::new(seed);
            let mut mangle = |bytes: &[u8]| spoil(bytes, &mut chance, &faults);
            let mut qemu = match Qemu::start_on(&image, &flash, false, false) {
                Ok(qemu) => qemu,
                Err(error) => return vec![format!("{error:#}")],
            };
            // It ends when it is told to, or the image has.
            let _ = tcp::relay(&mut qemu, &address, &mut mangle, &ended);
            qemu.kill()
        });
        Logger { stop, thread }
    }

    fn station(&self) -> Result<Station> {
        let console = Console::connect(&format!("127.0.0.1:{}", self.console), LOGGER)?;
        Ok(Station::with_keys(Box::new(console), self.keys().ring()?.for_console()))
    }

    /// Whether the logger has nothing that is not confirmed.
    fn is_all_here(&self) -> Result<bool> {
        let status = self.station()?.status()?;
        Ok(status.waiting == 0 && !status.busy)
    }

    /// What is stored of a run of the image, in the order in which it came.
    fn stored(&self, start: u32) -> Result<Vec<Word>> {
        let store = Store::open(&self.database())?;
        let (mut place, mut words) = (0, vec![]);
        while let Some((next, message)) = store.message_after(LOGGER, place)? {
            place = next;
            let notice: Notice = postcard::from_bytes(&message).context("a message that cannot be read is stored")?;
            if notice.start == start {
                words.push(match notice.event {
                    Event::Alert(alert) => ("alert", alert.passage),
                    Event::Passage(report) => ("passage", report.passage),
                    Event::Track(report) => ("track", report.passage),
                });
            }
        }
        Ok(words)
    }
}

impl Logger {
    /// Kills the image; what it has logged in each of its runs.
    fn kill(self) -> Result<Vec<Vec<Word>>> {
        self.stop.store(true, Ordering::Relaxed);
        let Ok(log) = self.thread.join() else {
            bail!("the relay to the image has failed");
        };
        let mut runs: Vec<Vec<Word>> = vec![];
        for line in log {
            if line.contains(" started") {
                runs.push(vec![]);
            } else if let (Some(run), Some(word)) = (runs.last_mut(), word(&line)) {
                run.push(word);
            }
        }
        if runs.is_empty() {
            // It was killed before it had said anything, and had not counted its start.
            return Ok(vec![]);
        }
        Ok(runs)
    }
}

/// The alert or report that a line of the log tells of.
fn word(line: &str) -> Option<Word> {
    let number = |text: &str| text.split([',', ':']).next()?.parse().ok();
    if let Some((_, rest)) = line.split_once(" alert of passage ") {
        return Some(("alert", number(rest)?));
    }
    let (_, rest) = line.split_once(" passage ")?;
    let kind = if rest.contains("the track has changed") {
        "track"
    } else {
        "passage"
    };
    Some((kind, number(rest)?))
}

/// Gives the logger what it keeps over its kills.
fn provide(world: &World, prepared: &Prepared) -> Result<()> {
    let mut station = world.station()?;
    station.begin_setup()?;
    station.load(prepared.bridge.as_ref().context("the recording names no bridge")?)?;
    // With the speed told a passage takes a second.
    let mut configuration = prepared.configuration.clone();
    if let Some(traffic) = &mut configuration.traffic {
        traffic.entry_time_s = None;
    }
    station.configure(&configuration)?;
    station.keep_setup()
}

/// Trains that pass until they are told to end.
struct Trains {
    stop: Arc<AtomicBool>,
    thread: JoinHandle<Result<()>>,
}

impl Trains {
    fn start(world: &World, prepared: Prepared) -> Result<Self> {
        let stop = Arc::new(AtomicBool::new(false));
        let ended = Arc::clone(&stop);
        let mut station = world.station()?;
        let thread = thread::spawn(move || {
            let counts = prepared.recording.to_counts();
            let channels = prepared.recording.channels.len();
            let block = BLOCK_COUNTS / channels * channels;
            let mut first = 0;
            while !ended.load(Ordering::Relaxed) {
                for counts in counts.chunks(block) {
                    station.offer(first, counts)?;
                    first += (counts.len() / channels) as u64;
                }
                // The train has left the bridge. The next comes at once: while one is identified the others are reported as found.
                station.end_passage()?;
                while station.next_heard().is_some() {}
                station.confirm()?;
            }
            Ok(())
        });
        Ok(Self { stop, thread })
    }

    fn end(self) -> Result<()> {
        self.stop.store(true, Ordering::Relaxed);
        match self.thread.join() {
            Ok(ended) => ended.context("the trains have stopped"),
            Err(_) => bail!("the trains have stopped"),
        }
    }
}

/// What a faulty line makes of a piece.
fn spoil(bytes: &[u8], chance: &mut Chance, faults: &AtomicU64) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    if bytes.is_empty() || !chance.happens(FAULT_RATE) {
        return bytes;
    }
    faults.fetch_add(1, Ordering::Relaxed);
    match chance.below(4) {
        0 => bytes.clear(),
        1 => bytes.extend_from_within(..),
        2 => {
            let bit = chance.below(8 * bytes.len() as u64) as usize;
            bytes[bit / 8] ^= 1 << (bit % 8);
        }
        _ => {
            let length = 1 + chance.below(40) as usize;
            bytes.extend(chance.bytes(length));
        }
    }
    bytes
}

/// Two ports that nobody has now.
fn free_ports() -> Result<[u16; 2]> {
    let listeners = [0; 2].map(|port| TcpListener::bind((Ipv4Addr::LOCALHOST, port)));
    let [one, other] = listeners.map(|listener| listener.and_then(|listener| listener.local_addr()));
    Ok([one?.port(), other?.port()])
}
