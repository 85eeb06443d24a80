//! Promises of the base station: many loggers at once, each message stored once, and confirmed only once it is; what cannot be stored is not
//! confirmed; killed and started again it loses nothing; strangers are refused; what is stored can be asked for.

mod program;

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use host_sim::channel::pc::{PcFlash, PcLogger};
use host_sim::channel::{Console, tcp};
use host_sim::keys::KeyFile;
use host_sim::replay::{self, Prepared};
use host_sim::station::Station;
use host_sim::station::store::{Cell, Origin, Store, Topic};
use program::host_sim;
use rusqlite::Connection;
use spanwatch::session::Device;
use spanwatch::settings::Settings;
use tempfile::TempDir;

/// Passages that the tests can wait for.
const PATIENCE: Duration = Duration::from_secs(60);

/// The program, running in a folder; killed at the end.
struct Program {
    child: Child,
    loggers: String,
    console: String,
}

impl Program {
    fn start(folder: &Path, loggers: &str, console: &str) -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_host-sim"))
            .current_dir(folder)
            .args(["base-station", "--json", "--listen", loggers, "--console", console])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("it starts");
        let mut lines = BufReader::new(child.stdout.take().expect("piped"));
        let mut first = String::new();
        lines.read_line(&mut first).expect("a line");
        let first: serde_json::Value = serde_json::from_str(&first).expect("JSON");
        // Nobody reads the rest, and it must not fill the pipe.
        thread::spawn(move || lines.lines().for_each(drop));
        let address = |key: &str| first[key].as_str().expect("an address").to_owned();
        Self {
            child,
            loggers: address("loggers"),
            console: address("console"),
        }
    }

    fn new(folder: &Path) -> Self {
        Self::start(folder, "127.0.0.1:0", "127.0.0.1:0")
    }

    /// SIGKILL, and another one at the same addresses.
    fn restart(self, folder: &Path) -> Self {
        let (loggers, console) = (self.loggers.clone(), self.console.clone());
        drop(self);
        Self::start(folder, &loggers, &console)
    }

    fn station(&self, folder: &Path, logger: Device) -> Station {
        let console = Console::connect(&self.console, logger).expect("it listens");
        let ring = KeyFile::at(&folder.join("spanwatch-keys.toml")).ring().expect("reads");
        Station::with_keys(Box::new(console), ring.for_console())
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A base station in a folder of its own, whose console has a key.
fn with_console() -> (TempDir, Program) {
    let folder = TempDir::new().expect("a folder");
    KeyFile::at(&folder.path().join("spanwatch-keys.toml"))
        .add_console()
        .expect("made");
    let base = Program::new(folder.path());
    (folder, base)
}

fn case1() -> Prepared {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("recordings/case1-60kmh.csv");
    replay::prepare(&path, None, replay::DEFAULT_SEED).expect("a shipped recording")
}

/// A logger with a key of its own, that connects to the base station as long as the test runs.
fn logger(folder: &Path, device: Device, address: &str) {
    let keys = KeyFile::at(&folder.join("spanwatch-keys.toml"));
    let identity = keys.add(device, Some(format!("Viaduct {device}"))).expect("made");
    let flash = PcFlash::in_memory();
    let [_, partition] = flash.clone();
    Settings::new(partition).set_identity(&identity).expect("installed");
    let address = address.to_owned();
    thread::spawn(move || tcp::call(&address, &mut PcLogger::start(flash).expect("a flash in memory")));
}

/// The train passes; what the logger has said of it, as told by the base station.
fn pass(station: &mut Station, prepared: &Prepared) -> usize {
    let mut told = 0;
    prepared
        .replay(station, None, None, |_| {
            told += 1;
            Ok(())
        })
        .expect("it passes");
    told
}

fn rows(folder: &Path, topic: Topic, logger: Option<u32>, since: Option<&str>) -> Vec<Vec<Cell>> {
    let store = Store::open(&folder.join("spanwatch.sqlite")).expect("a database");
    store.query(topic, logger, since).expect("an answer").rows
}

#[test]
fn what_several_loggers_say_is_stored_once_and_can_be_asked_for() {
    let (folder, base) = with_console();
    let folder = folder.path();
    let prepared = case1();
    for device in [12, 13, 14] {
        logger(folder, device, &base.loggers);
    }
    thread::scope(|scope| {
        for device in [12, 13, 14] {
            let (base, prepared) = (&base, &prepared);
            scope.spawn(move || assert_eq!(pass(&mut base.station(folder, device), prepared), 2));
        }
    });
    for device in [12, 13, 14] {
        assert_eq!(rows(folder, Topic::Alerts, Some(device), Some("1h")).len(), 1);
        assert_eq!(rows(folder, Topic::Passages, Some(device), None).len(), 1);
    }
    assert_eq!(rows(folder, Topic::Loggers, None, None).len(), 3);
    assert_eq!(rows(folder, Topic::Elements, Some(12), None).len(), 10);
    assert!(!rows(folder, Topic::Health, Some(12), None).is_empty());
    assert!(rows(folder, Topic::Alerts, None, Some("2100-01-01")).is_empty());
    assert!(rows(folder, Topic::Gaps, None, None).is_empty());
    // As a user asks.
    let asked = |arguments: &[&str]| {
        let output = host_sim(folder, arguments);
        assert!(output.status.success(), "{output:?}");
        String::from_utf8(output.stdout).expect("UTF-8")
    };
    let text = asked(&["query", "alerts", "--logger", "12", "--since", "monday"]);
    assert!(text.contains("ALERT, bridge girder50, passage 1: element 5"), "{text}");
    let json: serde_json::Value =
        serde_json::from_str(&asked(&["query", "passages", "--logger", "13", "--json"])).expect("JSON");
    assert_eq!((&json["logger"], &json["verdict"]), (&13.into(), &"damaged".into()));
    assert_eq!(asked(&["query", "alerts", "--csv"]).lines().count(), 4);
    let loggers = asked(&["query", "loggers", "--since", "2100-01-01"]);
    assert!(loggers.contains("Viaduct 12") && loggers.contains("heard"), "{loggers}");
    for when in ["someday", "36", "2026-02-30"] {
        let wrong = host_sim(folder, &["query", "alerts", "--since", when]);
        assert_eq!(wrong.status.code(), Some(2));
        assert!(String::from_utf8_lossy(&wrong.stderr).contains("is no time"), "{when}");
    }
}

#[test]
fn killed_and_started_again_it_loses_nothing() {
    let (folder, mut base) = with_console();
    let folder = folder.path();
    logger(folder, 12, &base.loggers);
    let prepared = case1();
    for passages in 1..=3 {
        let mut station = base.station(folder, 12);
        assert_eq!(pass(&mut station, &prepared), 2);
        base = base.restart(folder);
        assert_eq!(rows(folder, Topic::Alerts, Some(12), None).len(), passages);
        assert_eq!(rows(folder, Topic::Passages, Some(12), None).len(), passages);
    }
}

#[test]
fn orders_reach_a_logger_through_it_and_end_when_they_are_done() {
    let (folder, base) = with_console();
    let folder = folder.path();
    logger(folder, 12, &base.loggers);
    let via = format!("station:{}/12", base.console);
    let order = |arguments: &[&str]| {
        let output = host_sim(folder, &[arguments, &["--via", &via]].concat());
        (
            output.status.success(),
            String::from_utf8_lossy(&output.stderr).into_owned(),
        )
    };
    let recording = Path::new(env!("CARGO_MANIFEST_DIR")).join("recordings/case1-60kmh.csv");
    let recording = recording.to_str().expect("UTF-8");
    assert!(order(&["setup", "write", "--like", recording]).0);
    assert!(order(&["keys", "rotate", "--logger", "12"]).0);
    assert!(
        host_sim(folder, &["keys", "remove", "--logger", "12", "--number", "1"])
            .status
            .success()
    );
    assert!(order(&["setup", "restart"]).0);
    assert!(order(&["setup", "read", "--out", "kept"]).0);
    assert!(folder.join("kept/bridge.blob").exists() && folder.join("kept/configuration.json").exists());
    assert!(order(&["replay", recording]).0);
    assert_eq!(rows(folder, Topic::Alerts, Some(12), None).len(), 1);
    // Afterwards it watches with what it keeps.
    let status = base.station(folder, 12).status().expect("an answer");
    assert_eq!((status.setup.generation, status.key, status.starts), (1, 2, 2));
    // A slip of the pen makes no logger another.
    let (done, text) = order(&["keys", "rotate", "--logger", "13"]);
    assert!(!done && text.contains("--via names logger 12"), "{text}");
}

#[test]
fn what_cannot_be_stored_is_not_confirmed_and_comes_again() {
    let (folder, base) = with_console();
    let folder = folder.path();
    logger(folder, 12, &base.loggers);
    let prepared = case1();
    let mut station = base.station(folder, 12);
    pass(&mut station, &prepared);
    // Somebody holds the database while the next train passes.
    let other = Connection::open(folder.join("spanwatch.sqlite")).expect("a database");
    other.execute_batch("BEGIN EXCLUSIVE").expect("locks");
    for (block, counts) in prepared.recording.to_counts().chunks(96).enumerate() {
        let first = prepared.recording.rows() + block * 96;
        station.offer(first as u64, counts).expect("taken");
    }
    station.end_passage().expect("taken");
    thread::sleep(Duration::from_secs(8));
    let status = station.status().expect("an answer");
    assert!(!status.busy && status.waiting == 1, "{status:?}");
    other.execute_batch("ROLLBACK").expect("lets go");
    let start = Instant::now();
    while rows(folder, Topic::Passages, Some(12), None).len() < 2 {
        assert!(start.elapsed() < PATIENCE, "it has not come again");
        thread::sleep(Duration::from_millis(200));
    }
}

#[test]
fn a_logger_whose_key_is_not_known_is_not_heard() {
    let (folder, base) = with_console();
    let folder = folder.path();
    // One has a key of another file, one the key that everybody knows.
    let others = TempDir::new().expect("a folder");
    logger(others.path(), 12, &base.loggers);
    let address = base.loggers.clone();
    thread::spawn(move || tcp::call(&address, &mut PcLogger::new()));
    thread::sleep(Duration::from_secs(3));
    assert!(rows(folder, Topic::Loggers, None, None).is_empty());
}

#[test]
fn a_disk_that_is_full_takes_nothing_half() {
    let folder = TempDir::new().expect("a folder");
    let path = folder.path().join("base.sqlite");
    let mut store = Store::open(&path).expect("made");
    let origin = |number| Origin {
        logger: 1,
        series: 5,
        number,
        previous: number - 1,
    };
    // Messages of another version are kept as they come.
    let message = [0xFF; 300];
    assert!(store.keep(origin(1), &message, "line", None, 0).expect("stored"));
    assert!(!store.keep(origin(1), &message, "line", None, 0).expect("known"));
    store.limit_pages(1).expect("as large as it is");
    let mut stored = 1;
    let full = loop {
        match store.keep(origin(stored + 1), &message, "line", None, 0) {
            Ok(_) => stored += 1,
            Err(error) => break error,
        }
    };
    assert!(format!("{full:#}").contains("full"), "{full:#}");
    assert_eq!(store.stored(1, 5).expect("reads"), stored);
    drop(store);
    let mut store = Store::open(&path).expect("opens");
    assert!(
        store
            .keep(origin(stored + 1), &message, "line", None, 0)
            .expect("there is room again")
    );
    assert_eq!(store.stored(1, 5).expect("reads"), stored + 1);
}

#[test]
fn a_file_of_the_first_version_is_taken_over() {
    let folder = TempDir::new().expect("a folder");
    let path = folder.path().join("old.sqlite");
    let old = Connection::open(&path).expect("made");
    old.execute_batch(include_str!("../host-sim/src/station/store/1.sql"))
        .expect("made");
    old.execute_batch(
        "PRAGMA user_version = 1;
         INSERT INTO alert (source, bridge, passage, start_s, objective, objective_healthy, forward_solves, text)
             VALUES ('rec.csv', 'girder50', 3, 1.5, 1e-6, 1e-3, 99, 'an old alert');
         INSERT INTO alert_element VALUES (1, 5, 0.11, 0.01, 1);",
    )
    .expect("written");
    drop(old);
    let store = Store::open(&path).expect("taken over");
    let alerts = store.query(Topic::Alerts, None, None).expect("an answer");
    let text = alerts
        .columns
        .iter()
        .position(|column| column == "text")
        .expect("a column");
    assert_eq!(alerts.rows.len(), 1);
    assert_eq!(alerts.rows[0][text], Cell::Text("an old alert".to_owned()));
    assert_eq!(
        store.query(Topic::Elements, None, None).expect("an answer").rows.len(),
        1
    );
    drop(store);
    Connection::open(&path)
        .and_then(|newer| newer.pragma_update(None, "user_version", 99))
        .expect("written");
    let refused = Store::open(&path).err().expect("it is of a later version");
    assert!(format!("{refused:#}").contains("later program"), "{refused:#}");
}
