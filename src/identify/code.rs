//! Damage codes: the paper's genes, three bits an element, 0 to 70 % in steps of 10 % (its Table 5).

use crate::bridge::Damage;
use crate::capacity::ELEMENTS;
use crate::math::Real;

/// Bits of a gene.
pub const GENE_BITS: u32 = 3;
/// Bits of a whole code.
pub const CODE_BITS: u32 = GENE_BITS * ELEMENTS as u32;
/// Largest value of a gene: 70 %.
pub const GENE_MAX: u8 = 7;
/// Damage of one step of a gene.
pub const GENE_STEP: f64 = 0.1;

/// One gene an element, packed: element 1 in the lowest bits.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct DamageCode(u32);

impl DamageCode {
    /// The code with these bits; bits beyond the last gene are dropped.
    pub fn from_bits(bits: u32) -> Self {
        Self(bits & ((1 << CODE_BITS) - 1))
    }

    /// The packed bits.
    pub fn bits(self) -> u32 {
        self.0
    }

    /// The nearest code to a damage pattern.
    pub fn nearest(damage: &Damage<f32>) -> Self {
        damage
            .iter()
            .enumerate()
            .fold(Self::default(), |code, (element, &loss)| {
                // Adding a half before the cast rounds; negative and huge values saturate.
                code.with(element, ((loss / GENE_STEP as f32 + 0.5) as u8).min(GENE_MAX))
            })
    }

    /// Gene of `element` (from 0), 0 to 7.
    pub fn gene(self, element: usize) -> u8 {
        (self.0 >> (GENE_BITS * element as u32)) as u8 & GENE_MAX
    }

    /// The code with the gene of `element` replaced.
    pub fn with(self, element: usize, gene: u8) -> Self {
        let shift = GENE_BITS * element as u32;
        Self((self.0 & !(u32::from(GENE_MAX) << shift)) | (u32::from(gene & GENE_MAX) << shift))
    }

    /// The code without the genes beyond the first `elements`, which a search draws though the bridge has no such elements.
    pub fn within(self, elements: usize) -> Self {
        (elements..ELEMENTS).fold(self, |code, element| code.with(element, 0))
    }

    /// All genes, element 1 first.
    pub fn genes(self) -> [u8; ELEMENTS] {
        core::array::from_fn(|element| self.gene(element))
    }

    /// The damage that the code stands for.
    pub fn damage<T: Real>(self) -> Damage<T> {
        self.genes().map(|gene| T::of(f64::from(gene) * GENE_STEP))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn genes_are_read_back_and_rounded_to_the_nearest_tenth() {
        let code = DamageCode::default().with(0, 2).with(4, 4).with(9, 7);
        assert_eq!(code.genes(), [2, 0, 0, 0, 4, 0, 0, 0, 0, 7]);
        assert_eq!(DamageCode::nearest(&code.damage()), code);
        assert_eq!(
            DamageCode::nearest(&[0.21, 0.04, 0.06, 0.0, 0.41, -0.2, 0.0, 0.0, 0.9, 0.0]).genes(),
            [2, 0, 1, 0, 4, 0, 0, 0, 7, 0]
        );
    }
}
