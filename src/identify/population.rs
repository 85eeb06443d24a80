//! The individuals of a genetic search over damage codes, judged one after the other, and the best so far.

use super::code::DamageCode;

/// A code and its misfit, (m/s²)²; infinite until it is judged.
pub type Individual = (DamageCode, f32);

/// `N` individuals.
#[derive(Debug, Clone)]
pub struct Population<const N: usize> {
    individuals: [Individual; N],
    /// The one that is being judged.
    cursor: usize,
    generation: u32,
    best: Individual,
    best_since: u32,
}

impl<const N: usize> Population<N> {
    /// The first generation.
    pub fn new(codes: [DamageCode; N]) -> Self {
        Self {
            individuals: codes.map(|code| (code, f32::INFINITY)),
            cursor: 0,
            generation: 1,
            best: (DamageCode::default(), f32::INFINITY),
            best_since: 1,
        }
    }

    /// All individuals.
    pub fn individuals(&self) -> [Individual; N] {
        self.individuals
    }

    /// The best individual of all generations.
    pub fn best(&self) -> Individual {
        self.best
    }

    /// The generation, from 1.
    pub fn generation(&self) -> u32 {
        self.generation
    }

    /// Generation in which the best appeared.
    pub fn best_since(&self) -> u32 {
        self.best_since
    }

    /// The code to be judged next; none when all have been.
    pub fn next(&self) -> Option<DamageCode> {
        self.individuals.get(self.cursor).map(|(code, _)| *code)
    }

    /// The misfit of the code that was next; true if it is the best so far.
    pub fn judge(&mut self, misfit: f32) -> bool {
        let Some(individual) = self.individuals.get_mut(self.cursor) else {
            return false;
        };
        individual.1 = misfit;
        self.cursor += 1;
        let better = misfit < self.best.1;
        if better {
            self.best = *individual;
            self.best_since = self.generation;
        }
        better
    }

    /// The next generation: `children`, the first of whom gives way to the best so far; with `again` that one is judged
    /// once more.
    pub fn succeed(&mut self, children: [DamageCode; N], again: bool) {
        self.individuals = children.map(|code| (code, f32::INFINITY));
        if let Some(first) = self.individuals.first_mut() {
            *first = self.best;
        }
        self.cursor = if again { 0 } else { 1 };
        self.generation += 1;
    }

    /// A generation without a past.
    pub fn begin_again(&mut self, codes: [DamageCode; N]) {
        let generation = self.generation + 1;
        *self = Self {
            generation,
            best_since: generation,
            ..Self::new(codes)
        };
    }
}
