//! Promises of the outbox: what it has confirmed is given until it is acknowledged, unchanged, once and in order, through power cuts at
//! any byte; no number is given twice; newest alerts win when it is full, and what is dropped is counted; its flash wears evenly.

use host_sim::campaign::{power, sequential};
use host_sim::flash::{SimulatedFlash, Tear};
use spanwatch::outbox::{Class, LEASE, Ledger, Outbox, OutboxError};

/// Cuts of the short campaign; `host-sim evaluate link` makes as many as one likes.
const CUTS: u64 = 120_000;
/// Cuts within which the queue that the outbox does not rest on loses something.
const CUTS_OF_THE_OTHER: u64 = 300_000;
const SEED: u64 = 1;

const PAGES: usize = 4;
const ORDERLY: Tear = power::TEARS[0];
type Flash = SimulatedFlash<4, 512>;

fn outbox() -> Outbox<Flash> {
    Outbox::open(Flash::new(PAGES, ORDERLY, SEED)).expect("a new flash")
}

fn contents(outbox: &mut Outbox<Flash>) -> Vec<(u32, Class, u8)> {
    let mut buffer = [0; 256];
    let (mut last, mut all): (u32, Vec<(u32, Class, u8)>) = (0, vec![]);
    while let Some(parcel) = outbox.next_after(last, &mut buffer).expect("reads") {
        assert_eq!(
            parcel.previous,
            all.last().map_or(outbox.acknowledged(), |&(number, ..)| number)
        );
        assert!(buffer[..parcel.length].iter().all(|&byte| byte == buffer[0]));
        all.push((parcel.sequence, parcel.class, buffer[0]));
        last = parcel.sequence;
    }
    all
}

#[test]
fn no_power_cut_loses_repeats_or_changes_a_message() {
    for row in power::run(CUTS, SEED, |_| ()) {
        assert!(row.counts.is_clean(), "{row:?}");
        assert!(
            row.counts.cuts >= CUTS / 12 && row.counts.cuts_in_recovery > row.counts.cuts / 4,
            "{row:?}"
        );
    }
}

#[test]
fn the_queue_that_it_was_meant_to_rest_on_loses_messages() {
    let rows = sequential::run(CUTS_OF_THE_OTHER, SEED, |_| ());
    let lost: u64 = rows.iter().map(|row| row.counts.lost).sum();
    assert!(
        lost > 0,
        "sequential-storage has lost nothing: is it time to rest on it? {rows:?}"
    );
}

#[test]
fn messages_are_given_in_order_until_they_are_acknowledged() {
    let mut outbox = outbox();
    let numbers: Vec<u32> = (0..5)
        .map(|n| outbox.append(Class::Alert, &[n; 40]).expect("room"))
        .collect();
    assert!(numbers.is_sorted());
    outbox.acknowledge(numbers[1]).expect("written");
    // An old one does no harm.
    outbox.acknowledge(numbers[0]).expect("passed over");
    assert_eq!(outbox.acknowledge(numbers[4] + 1), Err(OutboxError::NotSent));
    let rest: Vec<u8> = contents(&mut outbox).iter().map(|&(.., byte)| byte).collect();
    assert_eq!(rest, [2, 3, 4]);
    let mut outbox = Outbox::open(outbox.into_flash()).expect("the same flash");
    let rest: Vec<u8> = contents(&mut outbox).iter().map(|&(.., byte)| byte).collect();
    assert_eq!(rest, [2, 3, 4]);
    assert_eq!(outbox.acknowledged(), numbers[1]);
}

#[test]
fn numbers_go_on_behind_the_lease_after_each_start() {
    let mut outbox = outbox();
    let mut last = 0;
    for start in 1..=20 {
        assert_eq!(outbox.starts(), start);
        for _ in 0..start * 7 {
            let number = outbox.append(Class::Report, &[1; 8]).expect("room");
            assert!(number > last && number <= last + LEASE + 1);
            last = number;
            outbox.acknowledge(number).expect("written");
        }
        outbox = Outbox::open(outbox.into_flash()).expect("the same flash");
    }
}

#[test]
fn the_newest_alerts_win_and_what_is_dropped_is_counted() {
    let mut outbox = outbox();
    let mut reports = 0;
    while outbox.ledger() == Ledger::default() {
        outbox.append(Class::Report, &[1; 60]).expect("an older one gives way");
        reports += 1;
    }
    let dropped = outbox.ledger().reports_dropped;
    assert_eq!(contents(&mut outbox).len() as u32, reports - dropped);

    let mut alerts = 0;
    while outbox.ledger().alerts_dropped == 0 {
        outbox.append(Class::Alert, &[2; 60]).expect("others give way");
        alerts += 1;
    }
    // Not one alert was dropped before the last report.
    let all = contents(&mut outbox);
    assert!(all.iter().all(|&(_, class, _)| class == Class::Alert));
    assert_eq!(outbox.ledger().reports_dropped, reports);
    assert_eq!(all.len() as u32, alerts - outbox.ledger().alerts_dropped);

    // A report that finds no room is counted, too.
    let refused = (0..100).find_map(|_| {
        outbox.append(Class::Alert, &[2; 60]).expect("others give way");
        let mut full = outbox.clone();
        (full.append(Class::Report, &[3; 60]) == Err(OutboxError::Full)).then_some(full)
    });
    let mut outbox = refused.expect("alerts leave no room for a report now and then");
    assert_eq!(outbox.ledger().reports_dropped, reports + 1);

    // All of it can be fetched and let go.
    let last = contents(&mut outbox).last().expect("some").0;
    outbox.acknowledge(last).expect("written");
    assert_eq!(contents(&mut outbox), []);
    outbox.append(Class::Report, &[4; 60]).expect("room again");
}

#[test]
fn the_newest_evidence_outlives_everything() {
    let mut outbox = outbox();
    for n in 0..50 {
        outbox.keep_evidence(&[n; 130]).expect("room");
        for _ in 0..10 {
            outbox.append(Class::Alert, &[n; 60]).expect("older ones give way");
        }
        outbox = Outbox::open(outbox.into_flash()).expect("the same flash");
        let mut buffer = [0; 200];
        assert_eq!(outbox.evidence(&mut buffer).expect("reads"), Some([n; 130].as_slice()));
        let number = outbox.append(Class::Alert, &[n; 60]).expect("room");
        outbox.acknowledge(number).expect("written");
    }
}

#[test]
fn sectors_wear_alike_and_the_outbox_knows_how_much() {
    let mut outbox = outbox();
    for n in 0..20_000_u32 {
        let number = outbox.append(Class::Alert, &[n as u8; 60]).expect("room");
        if n % 3 == 0 {
            outbox.acknowledge(number).expect("written");
        }
    }
    let wear = outbox.wear();
    let erases = outbox.flash_mut().erases().to_vec();
    assert_eq!(
        (wear.most, wear.fewest),
        (*erases.iter().max().unwrap(), *erases.iter().min().unwrap())
    );
    assert!(wear.most > 1000 && wear.most - wear.fewest <= wear.most / 4, "{wear:?}");
}

#[test]
fn what_the_flash_has_not_kept_is_told_and_hides_nothing_else() {
    let mut outbox = outbox();
    for n in 0..3 {
        outbox.append(Class::Alert, &[n; 60]).expect("room");
    }
    let mut flash = outbox.into_flash();
    // Somewhere in the payload of the second: behind the head, a state and the first.
    flash.corrupt(56 + 56 + 76 + 16 + 30, 0x10);
    let mut outbox = Outbox::open(flash).expect("the rest is sound");
    let kept: Vec<u8> = contents_of(&mut outbox);
    assert_eq!(kept, [0, 2]);
    assert_eq!(outbox.ledger().unreadable, 1);
}

/// A sector's head that is whole, with these words between its magic number and its checksum.
fn head(words: [u32; 12]) -> Vec<u8> {
    let mut head = b"SWO\x01".to_vec();
    head.extend(words.iter().flat_map(|word| word.to_le_bytes()));
    head.extend(spanwatch::wire::CRC32C.checksum(&head).to_le_bytes());
    head
}

#[test]
fn a_sector_that_no_outbox_can_have_begun_is_none() {
    const HIGH: u32 = u32::MAX;
    // Order, erasures; acknowledged, leased, collected, alerts up to, reports up to, two counts, starts, stream, 0.
    for words in [
        [HIGH, 1, 0, 64, 0, 0, 0, 0, 0, 1, 0, 0],
        [0, 1, 0, 64, 0, 0, 0, 0, 0, 1, 0, 0],
        [3, 1, HIGH, 64, 0, 0, 0, 0, 0, 1, 0, 0],
        [3, 1, 0, HIGH, 0, 0, 0, 0, 0, 1, 0, 0],
        [3, 1, 0, 64, 3, 0, 0, 0, 0, 1, 0, 0],
        [3, 1, 0, 64, 0, 65, 0, 0, 0, 1, 0, 0],
        [3, 1, 0, 64, 0, 0, HIGH, 0, 0, 1, 0, 0],
        [3, 1, 0, 64, 0, 0, 0, HIGH, 0, 1, 0, 0],
        [3, 1, 0, 64, 0, 0, 0, 0, 0, HIGH, 0, 0],
    ] {
        let mut cells = vec![0xFF; PAGES * 512];
        let head = head(words);
        cells[512..512 + head.len()].copy_from_slice(&head);
        let mut outbox = Outbox::open(Flash::holding(cells, ORDERLY, SEED)).expect("it opens");
        assert_eq!(outbox.starts(), 1, "{words:?}");
        let number = outbox.append(Class::Alert, &[7; 20]).expect("room");
        assert_eq!(contents(&mut outbox), [(number, Class::Alert, 7)], "{words:?}");
    }
}

#[test]
fn a_state_that_rots_takes_no_message_with_it() {
    // Some of these numbers of messages end just behind a collection.
    for count in 1..=40_u8 {
        let mut outbox = outbox();
        for message in 1..=count {
            outbox.append(Class::Alert, &[message; 60]).expect("room");
            if message == 2 {
                outbox.keep_evidence(&[9; 60]).expect("room");
            }
            if message % 5 == 0 {
                outbox.acknowledge(outbox.acknowledged() + 4).expect("given");
            }
        }
        let before = contents_of(&mut outbox);
        let cells = outbox.into_flash().cells().to_vec();
        let states = (0..cells.len() - 16).filter(|&at| cells[at..at + 4] == [40, 0, 1, 0x5A]);
        for at in states {
            let mut cells = cells.clone();
            cells[at + 20] ^= 1;
            let mut outbox = Outbox::open(Flash::holding(cells, ORDERLY, SEED)).expect("it opens");
            let after = contents_of(&mut outbox);
            assert!(
                before.iter().all(|message| after.contains(message)),
                "{count}, {at}: {before:?} {after:?}"
            );
        }
    }
}

#[test]
fn an_evidence_that_rots_gives_way_to_the_one_before() {
    let mut outbox = outbox();
    outbox.keep_evidence(&[1; 60]).expect("room");
    outbox.append(Class::Alert, &[2; 20]).expect("room");
    outbox.keep_evidence(&[3; 60]).expect("room");
    let mut cells = outbox.into_flash().cells().to_vec();
    let newest = cells.windows(4).rposition(|head| head == [60, 0, 4, 0x5A]);
    cells[newest.expect("there") + 30] ^= 1;
    let mut outbox = Outbox::open(Flash::holding(cells, ORDERLY, SEED)).expect("it opens");
    let mut buffer = [0; 100];
    assert_eq!(outbox.evidence(&mut buffer), Ok(Some(&[1; 60][..])));
    assert_eq!(contents_of(&mut outbox), [2]);
}

#[test]
fn of_two_sectors_of_one_order_the_fuller_counts() {
    let mut outbox = outbox();
    outbox.append(Class::Alert, &[1; 60]).expect("room");
    let early = outbox.flash_mut().cells()[..512].to_vec();
    for message in 2..4 {
        outbox.append(Class::Alert, &[message; 60]).expect("room");
    }
    let mut cells = outbox.into_flash().cells().to_vec();
    cells[1024..1536].copy_from_slice(&early);
    let mut outbox = Outbox::open(Flash::holding(cells, ORDERLY, SEED)).expect("it opens");
    for message in 4..9 {
        outbox.append(Class::Alert, &[message; 60]).expect("room");
    }
    assert_eq!(outbox.ledger(), Ledger::default());
    assert_eq!(contents_of(&mut outbox), [1, 2, 3, 4, 5, 6, 7, 8]);
}

#[test]
fn no_number_is_given_again_though_the_newest_sector_is_lost() {
    let mut outbox = outbox();
    let last = (0..100).map(|_| outbox.append(Class::Report, &[1; 60]).expect("an older one gives way"));
    let last = last.last().expect("a hundred");
    // The newest sector's head rots, and with it its lease, and all that it held.
    let mut cells = outbox.into_flash().cells().to_vec();
    let order = |cells: &[u8], page: usize| u32::from_le_bytes(*cells[page * 512 + 4..].first_chunk().expect("a head"));
    let written = (0..PAGES).filter(|page| cells[page * 512] == b'S');
    let newest = written.max_by_key(|&page| order(&cells, page)).expect("a sector");
    cells[newest * 512 + 5] ^= 0x10;
    let mut outbox = Outbox::open(Flash::holding(cells, ORDERLY, SEED)).expect("it opens");
    let next = outbox.append(Class::Report, &[1; 60]).expect("room");
    assert!(next > last, "{next} was given before: the last was {last}");
}

#[test]
fn no_number_is_given_again_though_the_lease_is_lost() {
    let mut outbox = outbox();
    let first = outbox.append(Class::Alert, &[1; 20]).expect("room");
    let mut cells = outbox.into_flash().cells().to_vec();
    // The record behind the head, which leased the number, rots.
    let head = 56;
    cells[head + 20] ^= 1;
    let mut outbox = Outbox::open(Flash::holding(cells, ORDERLY, SEED)).expect("it opens");
    let second = outbox.append(Class::Alert, &[2; 20]).expect("room");
    assert!(second > first, "{second} behind {first}");
    assert_eq!(
        contents(&mut outbox),
        [(first, Class::Alert, 1), (second, Class::Alert, 2)]
    );
}

fn contents_of(outbox: &mut Outbox<Flash>) -> Vec<u8> {
    contents(outbox).iter().map(|&(.., byte)| byte).collect()
}

#[test]
fn what_does_not_fit_is_refused() {
    let mut outbox = outbox();
    assert_eq!(outbox.append(Class::Alert, &[0; 400]), Err(OutboxError::TooLong));
    assert_eq!(
        Outbox::open(Flash::new(2, ORDERLY, SEED)).err(),
        Some(OutboxError::Flash)
    );
}
