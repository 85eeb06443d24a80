//! Promises of everything that reads: no input makes it panic, work without end, or accept what is of no use; in short, for `host-sim evaluate
//! link --campaign fuzz` makes millions of runs.

use host_sim::campaign::fuzz::{self, Target};

/// Runs in all.
const RUNS: u64 = 40_000;
const SEED: u64 = 1;

#[test]
fn whatever_is_read_is_used_or_refused() {
    for row in fuzz::run(RUNS, SEED, |_| ()) {
        assert_eq!(row.failed, 0, "{}", fuzz::table(std::slice::from_ref(&row)));
        let counts = row.counts;
        assert!(
            counts.accepted > 0 && (counts.refused > 0 || row.target == Target::Images),
            "{row:?}: neither may be all there is"
        );
    }
}

#[test]
fn a_run_is_the_same_again_by_its_seed_and_number() {
    for target in Target::EACH {
        for number in [0, 7, 31] {
            let first = fuzz::run_one(target, number, SEED);
            assert_eq!(first, fuzz::run_one(target, number, SEED), "{target:?} {number}");
        }
    }
}
