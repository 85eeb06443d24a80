//! Many damage patterns of one passage, solved at once: one thread a processor, each pattern on one of them.
//!
//! Patterns share bridge, train and recording and nothing that changes, so two processors solve 1.7 times as many
//! (`docs/benchmarks.md`), and every result is the same bits as that of its pattern alone. The number of threads is rayon's:
//! all processors, or `RAYON_NUM_THREADS`, or that of the pool in which the call is made.

use anyhow::Result;
use rayon::prelude::*;
use spanwatch::bridge::Damage;
use spanwatch::identify::Problem;
use spanwatch::interaction::SetupError;

use crate::identification::Observed;

/// The misfit of each pattern, (m/s²)², in the patterns' order: a forward solve each.
///
/// # Errors
/// As [`Problem::misfit`].
pub fn misfits(problem: &Problem<'_>, patterns: &[Damage<f32>]) -> Result<Vec<f32>, SetupError> {
    each(patterns, |damage| problem.misfit(damage)).into_iter().collect()
}

/// The passage simulated with each pattern, as [`Observed::simulate`] gives it, in the patterns' order.
///
/// # Errors
/// As [`Observed::simulate`].
pub fn simulate_all(observed: &Observed, patterns: &[Damage<f32>]) -> Result<Vec<Vec<f32>>> {
    each(patterns, |damage| observed.simulate(damage)).into_iter().collect()
}

/// What `work` makes of each item, in the items' order; a thread takes the next item when it is done with one, so that items
/// may take differently long.
pub fn each<I: Sync, O: Send>(items: &[I], work: impl Fn(&I) -> O + Sync + Send) -> Vec<O> {
    items.par_iter().with_max_len(1).map(work).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model;
    use crate::simulate::Scenario;

    #[test]
    fn patterns_solved_at_once_give_the_bits_of_each_alone() {
        let girder = model::shipped("girder50").expect("ships");
        let observed = Observed::simulated(&girder, &Scenario::inspection_car().recorded()).expect("a passage");
        let patterns: Vec<Damage<f32>> = (0..10)
            .map(|element| std::array::from_fn(|e| if e == element { 0.3 } else { 0.05 }))
            .collect();
        let problem = observed.problem();
        let alone: Vec<f32> = (patterns.iter())
            .map(|damage| problem.misfit(damage).expect("a solve"))
            .collect();
        let histories: Vec<Vec<f32>> = (patterns.iter())
            .map(|damage| observed.simulate(damage).expect("a solve"))
            .collect();
        assert_eq!(misfits(&problem, &patterns), Ok(alone));
        assert_eq!(simulate_all(&observed, &patterns).expect("solves"), histories);
    }
}
