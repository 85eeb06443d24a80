//! The paper's own search (its section 4.2): a simple genetic algorithm with 50 individuals of ten 3-bit genes, two-point
//! crossover at 60 %, mutation at 10 %, ended by a misfit below 1e-6 (m/s²)² or after 1000 generations.
//!
//! What the paper leaves open is read as in the books that it cites (Goldberg 1989; Koh and Perry 2009) and marked here:
//! the first population is random; parents are drawn by roulette on the inverse of the misfit; the mutation rate is
//! the chance of an individual to have one of its bits flipped; the best individual survives.

use rand_core::Rng;

use super::CodeSearch;
use super::code::{CODE_BITS, DamageCode};
use super::random::{below, chance, unit};

/// Individuals.
pub const POPULATION: usize = 50;
/// Chance of a pair to cross.
const CROSSOVER: f32 = 0.6;
/// Chance of a child to mutate.
const MUTATION: f32 = 0.1;
/// The search ends at a misfit below this, (m/s²)².
pub const LIMIT: f32 = 1e-6;
/// The search ends after so many generations.
pub const MAX_GENERATIONS: u32 = 1000;

/// State of the search.
#[derive(Debug, Clone)]
pub struct PaperGa<R: Rng> {
    rng: R,
    population: [(DamageCode, f32); POPULATION],
    /// The individual that is being judged.
    cursor: usize,
    generation: u32,
    best: (DamageCode, f32),
}

impl<R: Rng> PaperGa<R> {
    /// A search with a random first population.
    pub fn new(mut rng: R) -> Self {
        let population = core::array::from_fn(|_| (DamageCode::from_bits(rng.next_u32()), f32::INFINITY));
        Self {
            rng,
            population,
            cursor: 0,
            generation: 1,
            best: (DamageCode::default(), f32::INFINITY),
        }
    }

    /// Whether the search ended because the misfit fell below its limit.
    pub fn converged(&self) -> bool {
        self.best.1 < LIMIT
    }

    fn breed(&mut self) {
        let parents = self.population;
        let fitness = parents.map(|(_, misfit)| 1.0 / misfit.max(f32::MIN_POSITIVE));
        let total: f32 = fitness.iter().sum();
        for pair in 0..POPULATION / 2 {
            let mut children = [0, 1].map(|_| parents[self.spin(&fitness, total)].0.bits());
            if chance(&mut self.rng, CROSSOVER) {
                let cuts = [0, 1].map(|_| below(&mut self.rng, CODE_BITS as usize + 1));
                let (from, to) = (cuts[0].min(cuts[1]) as u32, cuts[0].max(cuts[1]) as u32);
                let between = ((1_u64 << to) - (1_u64 << from)) as u32;
                let swapped = (children[0] ^ children[1]) & between;
                children = children.map(|child| child ^ swapped);
            }
            for (i, mut child) in children.into_iter().enumerate() {
                if chance(&mut self.rng, MUTATION) {
                    child ^= 1 << below(&mut self.rng, CODE_BITS as usize);
                }
                self.population[2 * pair + i] = (DamageCode::from_bits(child), f32::INFINITY);
            }
        }
        self.population[0] = self.best;
        self.cursor = 0;
        self.generation += 1;
    }

    /// Roulette: an index drawn with a chance in proportion to its fitness.
    fn spin(&mut self, fitness: &[f32; POPULATION], total: f32) -> usize {
        let mut ball = unit(&mut self.rng) * total;
        for (i, share) in fitness.iter().enumerate() {
            ball -= share;
            if ball < 0.0 {
                return i;
            }
        }
        POPULATION - 1
    }
}

impl<R: Rng> CodeSearch for PaperGa<R> {
    fn ask(&mut self) -> Option<DamageCode> {
        if self.converged() {
            return None;
        }
        if self.cursor == POPULATION {
            if self.generation == MAX_GENERATIONS {
                return None;
            }
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
        }
        self.cursor += 1;
    }

    fn best(&self) -> (DamageCode, f32) {
        self.best
    }

    fn generations(&self) -> u32 {
        self.generation
    }
}
