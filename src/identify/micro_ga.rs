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
use super::population::{Individual, Population};
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
    population: Population<POPULATION>,
    /// Generations since the last improvement.
    stale: u32,
    restarts: u32,
    budget: u32,
    solves: u32,
}

impl<R: Rng> MicroGa<R> {
    /// A search that ends after `budget` forward solves. The first population holds the undamaged bridge and strangers.
    pub fn new(mut rng: R, budget: u32) -> Self {
        let population = Population::new(core::array::from_fn(|i| match i {
            0 => DamageCode::default(),
            _ => stranger(&mut rng),
        }));
        Self {
            rng,
            population,
            stale: 0,
            restarts: 0,
            budget,
            solves: 0,
        }
    }

    /// Begins again among strangers only, without the best so far, for `solves` more.
    pub fn begin_again(&mut self, solves: u32) {
        self.budget = self.budget.saturating_add(solves);
        self.population
            .begin_again(core::array::from_fn(|_| stranger(&mut self.rng)));
        self.stale = 0;
        self.restarts += 1;
    }

    /// How often the strangers came.
    pub fn restarts(&self) -> u32 {
        self.restarts
    }

    fn breed(&mut self) {
        let parents = self.population.individuals();
        self.stale += 1;
        let fresh = self.stale > PATIENCE;
        if fresh {
            self.stale = 0;
            self.restarts += 1;
        }
        let children = core::array::from_fn(|i| match i {
            // Gives way to the best.
            0 => DamageCode::default(),
            _ if fresh => stranger(&mut self.rng),
            _ => {
                let (mother, father) = (self.tournament(&parents), self.tournament(&parents));
                self.child(mother, father)
            }
        });
        self.population.succeed(children, false);
    }

    fn tournament(&mut self, parents: &[Individual; POPULATION]) -> DamageCode {
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
        if self.solves >= self.budget {
            return None;
        }
        if self.population.next().is_none() {
            self.breed();
        }
        self.population.next()
    }

    fn tell(&mut self, misfit: f32) {
        if self.population.judge(misfit) {
            self.stale = 0;
        }
        self.solves += 1;
    }

    fn best(&self) -> (DamageCode, f32) {
        self.population.best()
    }

    fn generations(&self) -> u32 {
        self.population.generation()
    }

    fn best_since(&self) -> u32 {
        self.population.best_since()
    }
}
