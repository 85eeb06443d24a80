//! A genetic search for the logger: eight individuals, elitism, and a fresh start whenever they have become alike.
//!
//! After Krishnakumar's micro-GA (1989): so small a population converges within a few generations, keeps its best
//! individual, and is then filled again with strangers. Parents win tournaments of two; genes, not bits, are mixed, since
//! a step of a gene is a step of 10 % and neighbours in damage should be neighbours in the search. A child then takes
//! one of two mutations: a gene moves a step, or a step moves from one element to another, which is the direction that a
//! single sensor sees least.

use rand_core::Rng;

use super::CodeSearch;
use super::code::{DamageCode, GENE_MAX};
use super::random::{below, chance};

use crate::capacity::ELEMENTS;

/// Individuals.
pub const POPULATION: usize = 8;
/// Generations without a better individual before the strangers come.
const PATIENCE: u32 = 12;
/// Chance of a gene to come from the second parent.
const MIXING: f32 = 0.3;
/// Chance of a child to have a step moved between two elements rather than one gene stepped.
const SHIFT: f32 = 0.3;

/// State of the search.
#[derive(Debug, Clone)]
pub struct MicroGa<R: Rng> {
    rng: R,
    population: [(DamageCode, f32); POPULATION],
    cursor: usize,
    generation: u32,
    best: (DamageCode, f32),
    /// Generation in which the best appeared.
    best_since: u32,
    /// Generations since the last improvement.
    stale: u32,
    restarts: u32,
    limit: f32,
    budget: u32,
    solves: u32,
}

impl<R: Rng> MicroGa<R> {
    /// A search that ends at a misfit below `limit`, (m/s²)², or after `budget` forward solves.
    ///
    /// The first population holds the undamaged bridge and strangers.
    pub fn new(mut rng: R, limit: f32, budget: u32) -> Self {
        let population = core::array::from_fn(|i| {
            let code = if i == 0 {
                DamageCode::default()
            } else {
                stranger(&mut rng)
            };
            (code, f32::INFINITY)
        });
        Self {
            rng,
            population,
            cursor: 0,
            generation: 1,
            best: (DamageCode::default(), f32::INFINITY),
            best_since: 1,
            stale: 0,
            restarts: 0,
            limit,
            budget,
            solves: 0,
        }
    }

    /// Whether the misfit fell below the limit.
    pub fn converged(&self) -> bool {
        self.best.1 < self.limit
    }

    /// Begins again among strangers only, without the best so far, for `solves` more.
    pub fn begin_again(&mut self, solves: u32) {
        self.budget = self.budget.saturating_add(solves);
        self.population = core::array::from_fn(|_| (stranger(&mut self.rng), f32::INFINITY));
        self.best = (DamageCode::default(), f32::INFINITY);
        self.cursor = 0;
        self.stale = 0;
        self.generation += 1;
        self.best_since = self.generation;
        self.restarts += 1;
    }

    /// How often the strangers came.
    pub fn restarts(&self) -> u32 {
        self.restarts
    }

    fn breed(&mut self) {
        let parents = self.population;
        self.stale += 1;
        let fresh = self.stale > PATIENCE;
        if fresh {
            self.stale = 0;
            self.restarts += 1;
        }
        for i in 1..POPULATION {
            let child = if fresh {
                stranger(&mut self.rng)
            } else {
                let (mother, father) = (self.tournament(&parents), self.tournament(&parents));
                self.child(mother, father)
            };
            self.population[i] = (child, f32::INFINITY);
        }
        self.population[0] = self.best;
        // The elite need not be judged again.
        self.cursor = 1;
        self.generation += 1;
    }

    fn tournament(&mut self, parents: &[(DamageCode, f32); POPULATION]) -> DamageCode {
        let [a, b] = [0, 1].map(|_| parents[below(&mut self.rng, POPULATION)]);
        if a.1 <= b.1 { a.0 } else { b.0 }
    }

    fn child(&mut self, mother: DamageCode, father: DamageCode) -> DamageCode {
        let mut child = mother;
        for element in 0..ELEMENTS {
            if chance(&mut self.rng, MIXING) {
                child = child.with(element, father.gene(element));
            }
        }
        let from = below(&mut self.rng, ELEMENTS);
        if chance(&mut self.rng, SHIFT) {
            let to = below(&mut self.rng, ELEMENTS);
            if from != to && child.gene(from) > 0 && child.gene(to) < GENE_MAX {
                return child.with(from, child.gene(from) - 1).with(to, child.gene(to) + 1);
            }
        }
        let gene = child.gene(from);
        let up = gene == 0 || (gene < GENE_MAX && chance(&mut self.rng, 0.5));
        child.with(from, if up { gene + 1 } else { gene - 1 })
    }
}

/// A random code: first its severest gene, then all genes up to that. Genes drawn evenly from all eight would have every
/// stranger's first frequency lower by a fifth, and none near that of a bridge with little damage.
fn stranger<R: Rng>(rng: &mut R) -> DamageCode {
    let severest = below(rng, usize::from(GENE_MAX) + 1);
    (0..ELEMENTS).fold(DamageCode::default(), |code, element| {
        code.with(element, below(rng, severest + 1) as u8)
    })
}

impl<R: Rng> CodeSearch for MicroGa<R> {
    fn ask(&mut self) -> Option<DamageCode> {
        if self.converged() || self.solves >= self.budget {
            return None;
        }
        if self.cursor == POPULATION {
            self.breed();
        }
        self.population.get(self.cursor).map(|(code, _)| *code)
    }

    fn tell(&mut self, misfit: f32) {
        let Some(individual) = self.population.get_mut(self.cursor) else {
            return;
        };
        individual.1 = misfit;
        if misfit < self.best.1 {
            self.best = *individual;
            self.best_since = self.generation;
            self.stale = 0;
        }
        self.cursor += 1;
        self.solves += 1;
    }

    fn best(&self) -> (DamageCode, f32) {
        self.best
    }

    fn generations(&self) -> u32 {
        self.generation
    }

    fn best_since(&self) -> u32 {
        self.best_since
    }
}
