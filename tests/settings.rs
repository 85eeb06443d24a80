//! Promises of the settings: whatever is written, a power cut at any byte leaves the old or the new, whole; a logger goes on over a restart
//! with the setup and the evidence that it had; a setup that it does not take is passed over for the one before; what it keeps can be read
//! back.

use std::path::Path;

use host_sim::campaign::power::TEARS;
use host_sim::channel::InProcess;
use host_sim::channel::pc::PcFlash;
use host_sim::flash::SimulatedFlash;
use host_sim::model;
use host_sim::replay::{self, Prepared};
use host_sim::station::Station;
use spanwatch::session::Key;
use spanwatch::settings::{Identity, Part, Settings, SettingsError};
use spanwatch::wire::message::{BLOCK_COUNTS, Event, SetupState};

const PAGES: usize = 6;
const SEED: u64 = 1;

fn identity(number: u8) -> Identity {
    Identity {
        device: 12,
        key_number: number,
        key: Key::new([number; 32]),
    }
}

fn number(identity: &Option<Identity>) -> Option<u8> {
    let identity = identity.as_ref()?;
    assert_eq!(identity.key.bytes(), &[identity.key_number; 32]);
    assert_eq!(identity.device, 12);
    Some(identity.key_number)
}

/// Cuts the power at every byte of `change`, and once more while it is made again; `check` is given what is left each time.
fn cut_everywhere<const WORD: usize>(
    prepare: impl Fn(&mut Settings<SimulatedFlash<WORD, 512>>),
    change: impl Fn(&mut Settings<SimulatedFlash<WORD, 512>>) -> Result<(), SettingsError>,
    check: impl Fn(&mut Settings<SimulatedFlash<WORD, 512>>, bool),
) {
    for tear in TEARS {
        let mut before = Settings::new(SimulatedFlash::new(PAGES, tear, SEED));
        prepare(&mut before);
        let mut cuts = 0;
        loop {
            let mut settings = before.clone();
            settings.flash_mut().reseed(SEED + cuts);
            settings.flash_mut().cut_after(cuts);
            let done = change(&mut settings);
            let off = settings.flash_mut().is_off();
            assert_eq!(done.is_err(), off, "cut {cuts}");
            settings.flash_mut().restore();
            check(&mut settings, !off);
            // And once more in the middle of the next try.
            settings.flash_mut().cut_after(cuts / 2);
            let again = change(&mut settings).is_ok();
            settings.flash_mut().restore();
            check(&mut settings, again);
            change(&mut settings).expect("the power is back");
            check(&mut settings, true);
            if !off {
                break;
            }
            cuts += 1;
        }
        assert!(cuts > 500, "{cuts}");
    }
}

fn an_identity_is_the_old_or_the_new<const WORD: usize>() {
    cut_everywhere::<WORD>(
        |settings| settings.set_identity(&identity(1)).expect("power"),
        |settings| settings.set_identity(&identity(2)),
        |settings, done| {
            let found = number(&settings.identity().expect("reads"));
            assert!(found == Some(2) || found == Some(1) && !done, "{found:?}");
        },
    );
}

#[test]
fn a_power_cut_leaves_the_old_key_or_the_new() {
    an_identity_is_the_old_or_the_new::<1>();
    an_identity_is_the_old_or_the_new::<4>();
    an_identity_is_the_old_or_the_new::<32>();
}

fn write_setup<const WORD: usize>(
    settings: &mut Settings<SimulatedFlash<WORD, 512>>,
    value: u8,
) -> Result<(), SettingsError> {
    settings.begin()?;
    settings.stage(Part::Model, &[value; 300])?;
    // It came again, its answer lost.
    settings.stage(Part::Model, &[value; 300])?;
    settings.stage(Part::Configuration, &[value; 45])?;
    settings.commit().map(|_| ())
}

#[test]
fn a_power_cut_leaves_the_old_setup_or_the_new() {
    cut_everywhere::<8>(
        |settings| write_setup(settings, 1).expect("power"),
        |settings| write_setup(settings, 2),
        |settings, done| {
            let [newest, _] = settings.setups().expect("reads");
            let newest = newest.expect("one of them");
            let mut buffer = [0; 512];
            let mut part = |part| {
                let extent = settings.find(newest, part).expect("reads")?;
                let bytes = settings.read(extent, 0, &mut buffer).expect("reads");
                assert!(bytes.iter().all(|byte| *byte == bytes[0]));
                Some((bytes[0], bytes.len()))
            };
            let value = part(Part::Model).expect("a model").0;
            assert_eq!(part(Part::Model), Some((value, 300)));
            assert_eq!(part(Part::Configuration), Some((value, 45)));
            assert_eq!(part(Part::Track), None);
            assert!(value == 2 || value == 1 && !done);
        },
    );
}

#[test]
fn what_has_no_room_changes_nothing() {
    let mut settings: Settings<SimulatedFlash<4, 512>> = Settings::new(SimulatedFlash::new(PAGES, TEARS[0], SEED));
    write_setup(&mut settings, 1).expect("room");
    settings.begin().expect("power");
    assert_eq!(settings.stage(Part::Model, &[2; 2000]), Err(SettingsError::Full));
    let [newest, before] = settings.setups().expect("reads");
    assert_eq!(newest.map(|setup| setup.generation()), Some(1));
    assert_eq!(before, None);
    settings.abandon();
    assert_eq!(settings.commit(), Err(SettingsError::NotBegun));
}

fn case1() -> Prepared {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("recordings/case1-60kmh.csv");
    replay::prepare(&path, None, replay::DEFAULT_SEED).expect("a shipped recording")
}

fn logger(flash: &[PcFlash; 2]) -> Station {
    Station::new(Box::new(InProcess::on(flash.clone()).expect("a flash in memory")))
}

fn give_setup(station: &mut Station, prepared: &Prepared) {
    station.begin_setup().expect("begun");
    station
        .load(prepared.bridge.as_ref().expect("a bridge"))
        .expect("taken");
    station.configure(&prepared.watching()).expect("taken");
    station.keep_setup().expect("kept");
    // It comes again, as if its answer had been lost.
    station.keep_setup().expect("kept already");
}

/// Lets the train pass, without telling the logger anything but samples.
fn pass(station: &mut Station, prepared: &Prepared) -> Vec<Event> {
    for (block, counts) in prepared.recording.to_counts().chunks(BLOCK_COUNTS).enumerate() {
        station.samples((block * BLOCK_COUNTS) as u64, counts).expect("taken");
    }
    station.finish().expect("an answer");
    let events = std::iter::from_fn(|| station.next_event()).collect();
    station.confirm().expect("sent");
    events
}

#[test]
fn a_logger_goes_on_over_a_restart_with_its_setup_and_its_evidence() {
    let (prepared, flash) = (case1(), PcFlash::in_memory());
    let mut station = logger(&flash);
    assert_eq!(station.status().expect("an answer").setup, SetupState::default());
    give_setup(&mut station, &prepared);
    let first = pass(&mut station, &prepared);
    assert!(
        matches!(first.as_slice(), [Event::Alert(_), Event::Passage(_)]),
        "{first:?}"
    );
    let evidence = station.evidence().expect("an answer");
    // Once by order, once by a power cut.
    station.restart().expect("says hello again");
    assert_eq!(station.evidence().expect("an answer"), evidence);
    drop(station);
    let mut station = logger(&flash);
    let setup = station.status().expect("an answer").setup;
    assert_eq!((setup.generation, setup.rolled_back), (1, false));
    assert_eq!(station.evidence().expect("an answer"), evidence);
    let second = pass(&mut station, &prepared);
    let [Event::Alert(alert), Event::Passage(_)] = second.as_slice() else {
        panic!("{second:?}");
    };
    assert!(alert.passages > 1.5, "it rests on both passages: {}", alert.passages);
    // It is of the bridge, and outlives another setup for the same one.
    let evidence = station.evidence().expect("an answer");
    give_setup(&mut station, &prepared);
    assert_eq!(station.evidence().expect("an answer"), evidence);
    station.restart().expect("says hello again");
    assert_eq!(station.evidence().expect("an answer"), evidence);
    // What it keeps can be read back.
    let blob = model::to_blob(prepared.bridge.as_ref().expect("a bridge")).expect("a blob");
    assert_eq!(station.setup(Part::Model).expect("an answer"), blob);
    assert!(station.setup(Part::Track).expect("an answer").is_empty());
    // After a repair.
    station.clear().expect("forgotten");
    station.restart().expect("says hello again");
    assert_ne!(station.evidence().expect("an answer"), evidence);
    let third = pass(&mut station, &prepared);
    assert!(
        matches!(third.as_slice(), [Event::Alert(alert), _] if alert.passages == 1.0),
        "{third:?}"
    );
}

#[test]
fn a_setup_that_the_logger_does_not_take_is_passed_over_for_the_one_before() {
    let (prepared, flash) = (case1(), PcFlash::in_memory());
    give_setup(&mut logger(&flash), &prepared);
    // Whole, and nonsense: as another version of the program might have left it.
    let [_, partition] = flash.clone();
    let mut settings = Settings::new(partition);
    settings.begin().expect("begun");
    settings.stage(Part::Model, &[7; 1000]).expect("room");
    assert_eq!(settings.commit(), Ok(2));
    let mut station = logger(&flash);
    let setup = station.status().expect("an answer").setup;
    assert_eq!((setup.generation, setup.rolled_back), (1, true));
    assert!(matches!(
        pass(&mut station, &prepared).as_slice(),
        [Event::Alert(_), Event::Passage(_)]
    ));
    // The next one is the third, and counts.
    give_setup(&mut station, &prepared);
    let setup = logger(&flash).status().expect("an answer").setup;
    assert_eq!((setup.generation, setup.rolled_back), (3, false));
}

#[test]
fn a_setup_of_which_a_part_was_refused_is_not_kept() {
    let (prepared, flash) = (case1(), PcFlash::in_memory());
    let mut station = logger(&flash);
    give_setup(&mut station, &prepared);
    station.begin_setup().expect("begun");
    let mut nonsense = prepared.watching();
    nonsense.sample_rate_hz = f32::NAN;
    station.configure(&nonsense).expect_err("refused");
    station.keep_setup().expect_err("there is none");
    station.reload_setup().expect("the one before");
    let setup = station.status().expect("an answer").setup;
    assert_eq!((setup.generation, setup.rolled_back), (1, false));
    assert!(matches!(
        pass(&mut station, &prepared).as_slice(),
        [Event::Alert(_), Event::Passage(_)]
    ));
}

#[test]
fn a_new_key_makes_the_next_session_and_outlives_a_restart() {
    let flash = PcFlash::in_memory();
    let folder = tempfile::TempDir::new().expect("a folder");
    let keys = host_sim::keys::KeyFile::at(&folder.path().join("keys.toml"));
    let mut station = logger(&flash);
    station.status().expect("the demo key");
    drop(station);
    let first = keys.add(12, Some("Viaduct 12".to_owned())).expect("made");
    let [_, partition] = flash.clone();
    Settings::new(partition).set_identity(&first).expect("installed");
    let here = || Box::new(InProcess::on(flash.clone()).expect("a flash in memory"));
    let second = keys.add(12, None).expect("made");
    let mut station = Station::with_keys(here(), keys.ring().expect("reads"));
    station.status().expect("the first key");
    station.replace_identity(&second).expect("a session by the second key");
    station.status().expect("an answer");
    drop(station);
    keys.remove(12, first.key_number, false).expect("taken out");
    Station::with_keys(here(), keys.ring().expect("reads"))
        .status()
        .expect("the second key is on the flash");
    keys.remove(12, second.key_number, false).expect_err("it is the newest");
    keys.remove(12, second.key_number, true).expect("taken out");
    assert_eq!(
        keys.add(12, None).expect("made").key_number,
        3,
        "no number is given again"
    );
    let stranger = Station::with_keys(here(), keys.ring().expect("reads")).status();
    let text = format!("{:#}", stranger.expect_err("its key is not known any more"));
    assert!(text.contains("number 12 with its key 2"), "{text}");
}
