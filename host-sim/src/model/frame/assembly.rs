//! From the parts of a frame to its matrices over the free degrees of freedom.
//!
//! ```text
//! M = sum T^T M_part T,     K(d) = K_fixed + sum_g (1 - d_g) K_g
//! ```
//!
//! with `T` of [`super::constraint`], consistent mass of beams plus the masses at nodes, and `d_g` the fraction of
//! stiffness that the beams and springs of damage group `g` have lost. `K_fixed` is what belongs to no group.

use anyhow::{Result, anyhow, bail};
use nalgebra::{DMatrix, DVectorView, Matrix3, SMatrix};

use super::constraint::{self, Row};
use super::element::{Matrix12, carried};
use super::{Frame, NODE_FREEDOMS, Spring, soundness};

/// A symmetric matrix of which few entries are not zero.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Sparse {
    entries: Vec<(usize, usize, f64)>,
}

impl Sparse {
    /// Adds `factor` times the matrix to `sum`.
    pub fn add_to(&self, sum: &mut DMatrix<f64>, factor: f64) {
        for &(i, j, value) in &self.entries {
            sum[(i, j)] += factor * value;
        }
    }

    /// The matrix times the columns of `vectors`.
    pub fn times(&self, vectors: &DMatrix<f64>) -> DMatrix<f64> {
        let mut product = DMatrix::zeros(vectors.nrows(), vectors.ncols());
        for (k, vector) in vectors.column_iter().enumerate() {
            for &(i, j, value) in &self.entries {
                product[(i, k)] += value * vector[j];
            }
        }
        product
    }

    /// `v^T A v`.
    pub fn quadratic(&self, v: DVectorView<'_, f64>) -> f64 {
        self.entries
            .iter()
            .fold(0.0, |sum, &(i, j, value)| sum + v[i] * value * v[j])
    }

    /// Whether all of it is zero.
    pub fn is_zero(&self) -> bool {
        self.entries.iter().all(|&(_, _, value)| value == 0.0)
    }

    /// Adds `T^T block T`, a row of `T` for each row of the block.
    fn add_block(&mut self, block: &Matrix12, rows: &[&Row]) {
        for (i, row) in rows.iter().enumerate() {
            for (j, column) in rows.iter().enumerate() {
                let value = block[(i, j)];
                if value != 0.0 {
                    for &(p, a) in *row {
                        self.entries.extend(column.iter().map(|&(q, b)| (p, q, a * value * b)));
                    }
                }
            }
        }
    }

    /// Sums entries of the same place.
    fn merged(mut self) -> Self {
        self.entries.sort_by_key(|&(i, j, _)| (i, j));
        self.entries.dedup_by(|next, kept| {
            let same = (next.0, next.1) == (kept.0, kept.1);
            if same {
                kept.2 += next.2;
            }
            same
        });
        self
    }
}

/// A frame's matrices.
#[derive(Debug, Clone, PartialEq)]
pub struct Assembly {
    /// How each node's six degrees of freedom follow the free ones.
    pub rows: Vec<[Row; NODE_FREEDOMS]>,
    /// Consistent mass.
    pub mass: DMatrix<f64>,
    /// The part of it that turns: rotary inertia of beams about their axes and of bodies at nodes.
    pub rotary: Sparse,
    /// Stiffness that belongs to no damage group.
    pub fixed: Sparse,
    /// Stiffness of each damage group.
    pub groups: Vec<Sparse>,
    /// Mass that is nearest to each node, kg: half of each beam's, and what sits there.
    pub node_kg: Vec<f64>,
}

impl Assembly {
    /// Assembles a frame.
    ///
    /// # Errors
    /// If a part of it is none, or the whole cannot stand: see [`soundness`].
    pub fn new(frame: &Frame) -> Result<Self> {
        soundness::check_numbers(frame)?;
        soundness::check_connections(frame)?;
        let (rows, freedoms) = constraint::rows(frame)?;
        if freedoms == 0 {
            bail!("every node is held, so nothing can move: take something out of [supports]");
        }
        let rows_of = |nodes: [usize; 2]| -> Vec<&Row> { nodes.iter().flat_map(|&node| &rows[node]).collect() };
        let (mut mass, mut rotary) = (Sparse::default(), Sparse::default());
        let mut fixed = Sparse::default();
        let mut groups = vec![Sparse::default(); frame.groups.len()];
        let mut node_kg = vec![0.0; frame.nodes.len()];
        for beam in &frame.beams {
            let [a, b] = beam.nodes;
            let matrices = beam
                .matrices([frame.nodes[a].place_m, frame.nodes[b].place_m])
                .map_err(|error| {
                    anyhow!(
                        "the beam from \"{}\" to \"{}\" {error}",
                        frame.nodes[a].name,
                        frame.nodes[b].name
                    )
                })?;
            mass.add_block(&matrices.mass, &rows_of(beam.nodes));
            rotary.add_block(&matrices.rotary, &rows_of(beam.nodes));
            let stiffness = beam.group.map_or(&mut fixed, |group| &mut groups[group]);
            stiffness.add_block(&matrices.stiffness, &rows_of(beam.nodes));
            for node in beam.nodes {
                node_kg[node] += 0.5 * matrices.total_kg;
            }
        }
        for spring in &frame.springs {
            let stiffness = spring.group.map_or(&mut fixed, |group| &mut groups[group]);
            stiffness.add_block(
                &spring_stiffness(frame, spring),
                &rows_of([spring.node, spring.to.unwrap_or(spring.node)]),
            );
        }
        for lump in &frame.masses {
            let (mut moves, mut turns) = (Matrix12::zeros(), Matrix12::zeros());
            for direction in 0..3 {
                moves[(direction, direction)] = lump.mass_kg;
                turns[(direction + 3, direction + 3)] = lump.inertia_kgm2[direction];
            }
            mass.add_block(&(moves + turns), &rows_of([lump.node; 2]));
            rotary.add_block(&turns, &rows_of([lump.node; 2]));
            node_kg[lump.node] += lump.mass_kg;
        }
        let mut dense_mass = DMatrix::zeros(freedoms, freedoms);
        mass.add_to(&mut dense_mass, 1.0);
        let assembly = Self {
            mass: dense_mass,
            rotary: rotary.merged(),
            fixed: fixed.merged(),
            groups: groups.into_iter().map(Sparse::merged).collect(),
            node_kg,
            rows,
        };
        soundness::check_stiffness(frame, &assembly.rows, &assembly.stiffness(&[]))?;
        Ok(assembly)
    }

    /// Number of free degrees of freedom.
    pub fn freedoms(&self) -> usize {
        self.mass.nrows()
    }

    /// Stiffness matrix with the fraction that each damage group has lost (groups beyond the slice are whole).
    pub fn stiffness(&self, damage: &[f64]) -> DMatrix<f64> {
        let mut sum = DMatrix::zeros(self.freedoms(), self.freedoms());
        self.fixed.add_to(&mut sum, 1.0);
        for (group, stiffness) in self.groups.iter().enumerate() {
            stiffness.add_to(&mut sum, 1.0 - damage.get(group).copied().unwrap_or(0.0));
        }
        sum
    }
}

/// `B^T diag(k) B` with `B` the relative motion at the spring's first node.
fn spring_stiffness(frame: &Frame, spring: &Spring) -> Matrix12 {
    let mut relative = SMatrix::<f64, NODE_FREEDOMS, 12>::zeros();
    relative.fixed_view_mut::<6, 6>(0, 0).fill_with_identity();
    if let Some(to) = spring.to {
        relative.fixed_view_mut::<6, 6>(0, 6).fill_diagonal(-1.0);
        let arm: Matrix3<f64> = carried(frame.nodes[spring.node].place_m - frame.nodes[to].place_m);
        relative.fixed_view_mut::<3, 3>(0, 9).copy_from(&-arm);
    }
    relative.transpose() * SMatrix::from_diagonal(&spring.stiffness.into()) * relative
}
