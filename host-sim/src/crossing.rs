//! A train crosses a bridge in space: the solver of the core, in `f64`, on as many modes as a [`ModalModel`] has.

use anyhow::{Context, Result, bail};
use nalgebra::SVector;
use spanwatch::capacity::CARS;
use spanwatch::interaction::car::CarState;
use spanwatch::interaction::contact::hermite;
use spanwatch::interaction::{Interaction, Modes, Run, Scheme, TrainSteps};
use spanwatch::track::{Smooth, Track};
use spanwatch::train::Motion;
use spanwatch::train::stock::{SPATIAL_CONTACTS, SPATIAL_DOFS};

use crate::model::modal::ModalModel;
use crate::train::SpatialTrain;

/// Most modes that are stepped.
pub const MAX_MODES: usize = 320;

/// The interaction in space, with room for all cars on the bridge.
type SpatialInteraction<const M: usize> = Interaction<f64, SpatialModes<M>, M, SPATIAL_DOFS, SPATIAL_CONTACTS, CARS>;

/// What crosses what, and how.
#[derive(Clone)]
pub struct Crossing<'a> {
    /// The bridge.
    pub model: &'a ModalModel,
    /// The train.
    pub train: &'a SpatialTrain,
    /// How it runs.
    pub run: Run<f64>,
    /// The irregularity of the track; none: smooth.
    pub track: Option<&'a dyn Track<f64>>,
    /// How time is stepped.
    pub scheme: Scheme,
    /// Length of a step, s.
    pub step_s: f64,
}

/// Bridge and cars after a step; the bridge in modal coordinates, mass-normalised.
#[derive(Clone, Copy)]
pub struct State<'a> {
    /// Displacements, kg^1/2 m.
    pub position: &'a [f64],
    /// Velocities, kg^1/2 m/s.
    pub velocity: &'a [f64],
    /// Accelerations, kg^1/2 m/s².
    pub acceleration: &'a [f64],
    /// The cars by number, as [`Interaction::car`] knows them.
    pub car: &'a dyn Fn(usize) -> Option<&'a CarState<f64, SPATIAL_DOFS>>,
}

/// What a row of the modes shows of a crossing, from time 0 on, a value a step.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Watched {
    /// Displacement, m.
    pub displacement_m: Vec<f64>,
    /// Acceleration, m/s².
    pub acceleration_mps2: Vec<f64>,
}

impl Crossing<'_> {
    /// Solves `steps` steps from rest at time 0 and keeps what each of `rows` (mass-normalised shapes) shows, `steps + 1`
    /// values.
    ///
    /// # Errors
    /// As [`Self::solve`].
    pub fn watch(&self, steps: usize, rows: &[&[f64]]) -> Result<Vec<Watched>> {
        let at_rest = Watched {
            displacement_m: vec![0.0],
            acceleration_mps2: vec![0.0],
        };
        let mut watched = vec![at_rest; rows.len()];
        self.solve(steps, &mut |state| {
            for (watched, row) in watched.iter_mut().zip(rows) {
                let shown = |modal: &[f64]| row.iter().zip(modal).map(|(row, q)| row * q).sum();
                watched.displacement_m.push(shown(state.position));
                watched.acceleration_mps2.push(shown(state.acceleration));
            }
        })?;
        Ok(watched)
    }

    /// Solves `steps` steps from rest at time 0 and shows the state after each; `each` is called `steps` times.
    ///
    /// # Errors
    /// If the run cannot be solved, or the model has more than [`MAX_MODES`] modes.
    pub fn solve(&self, steps: usize, each: &mut dyn FnMut(State<'_>)) -> Result<()> {
        // A few sizes: each is compiled on its own, with loops of fixed length.
        match self.model.omega_squared.len() {
            0..=8 => self.solve_in::<8>(steps, each),
            9..=20 => self.solve_in::<20>(steps, each),
            21..=60 => self.solve_in::<60>(steps, each),
            61..=160 => self.solve_in::<160>(steps, each),
            161..=MAX_MODES => self.solve_in::<MAX_MODES>(steps, each),
            modes => bail!("{modes} modes are more than the {MAX_MODES} that are stepped here; ask for fewer"),
        }
    }

    // Not inlined: the largest size's megabyte of stack is for those who need it.
    #[inline(never)]
    fn solve_in<const M: usize>(&self, steps: usize, each: &mut dyn FnMut(State<'_>)) -> Result<()> {
        let track: &dyn Track<f64> = self.track.unwrap_or(&Smooth);
        let cars = TrainSteps::new(self.train.clone(), self.scheme, self.step_s).context("the train")?;
        let mut interaction = SpatialInteraction::<M>::new(SpatialModes::new(self.model), track, &cars, self.run)?;
        let modes = self.model.omega_squared.len();
        for _ in 0..steps {
            interaction.step(&cars, track);
            let interaction = &interaction;
            each(State {
                position: &interaction.position().as_slice()[..modes],
                velocity: &interaction.velocity().as_slice()[..modes],
                acceleration: &interaction.acceleration().as_slice()[..modes],
                car: &|index| interaction.car(index),
            });
        }
        Ok(())
    }
}

/// Value and slope of the shapes at a node of the way, in each motion.
type Node<const M: usize> = [[SVector<f64, M>; 2]; 3];

/// A [`ModalModel`] in vectors of fixed size. Modes beyond those of the model have no shape and stay at rest.
pub struct SpatialModes<const M: usize> {
    omega_squared: SVector<f64, M>,
    damping: SVector<f64, M>,
    position_m: Vec<f64>,
    nodes: Vec<Node<M>>,
    /// Whether anything moves in each motion.
    moves: [bool; 3],
}

impl<const M: usize> SpatialModes<M> {
    /// The modes of `model`, at most `M`.
    pub fn new(model: &ModalModel) -> Self {
        let padded = |values: &[f64], rest: f64| SVector::from_fn(|k, _| values.get(k).copied().unwrap_or(rest));
        let nodes: Vec<Node<M>> = (model.path.iter())
            .map(|at| [&at.vertical, &at.lateral, &at.roll].map(|pair| [padded(&pair[0], 0.0), padded(&pair[1], 0.0)]))
            .collect();
        Self {
            omega_squared: padded(
                &model.omega_squared,
                model.omega_squared.first().copied().unwrap_or(1.0),
            ),
            damping: padded(&model.damping, 0.0),
            position_m: model.path.iter().map(|at| at.x_m).collect(),
            moves: [0, 1, 2].map(|motion| nodes.iter().any(|node| node[motion].iter().any(|row| row.amax() > 0.0))),
            nodes,
        }
    }
}

impl<const M: usize> Modes<f64, M> for SpatialModes<M> {
    fn omega_squared(&self) -> &SVector<f64, M> {
        &self.omega_squared
    }

    fn damping(&self) -> &SVector<f64, M> {
        &self.damping
    }

    fn length_m(&self) -> f64 {
        self.position_m.last().copied().unwrap_or(0.0)
    }

    fn shape(&self, motion: Motion, order: u8, x_m: f64) -> [f64; M] {
        let motion = match motion {
            Motion::Vertical => 0,
            Motion::Lateral => 1,
            Motion::Roll => 2,
        };
        if !self.moves[motion] || self.position_m.len() < 2 {
            return [0.0; M];
        }
        let span = self.position_m[1..self.position_m.len() - 1].partition_point(|&begin| begin <= x_m);
        let length = self.position_m[span + 1] - self.position_m[span];
        let part = ((x_m - self.position_m[span]) / length).clamp(0.0, 1.0);
        let [w1, s1, w2, s2] = hermite(order, part, length);
        let ([left, left_slope], [right, right_slope]) = (&self.nodes[span][motion], &self.nodes[span + 1][motion]);
        std::array::from_fn(|k| left[k] * w1 + left_slope[k] * s1 + right[k] * w2 + right_slope[k] * s2)
    }
}
