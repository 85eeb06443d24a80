//! How a train runs over a bridge.

use core::fmt;

use serde::{Deserialize, Serialize};

use crate::capacity::CARS;
use crate::math::Real;

/// Which end of the bridge the train enters by.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Direction {
    /// By node 1.
    #[default]
    Forward,
    /// By the last node of the way.
    Backward,
}

/// What moves a wheel besides the rail's own motion.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Kinematics {
    /// As the paper does (its coupling matrices in Eq. 45 are symmetric): `u' = phi . q'`, `u'' = phi . q''`.
    #[default]
    Paper,
    /// The full derivatives along the wheel's way: the deflected rail is also a slope and a curve to roll over. For one
    /// inspection car on girder50 at 60 km/h this changes the acceleration by 1 % (relative RMS), the displacement by
    /// 0.02 %.
    Convective,
}

/// How a train runs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Run<T: Real> {
    /// Speed as the first wheelset enters, m/s.
    pub speed_mps: T,
    /// Change of the speed, m/s²; negative when the train brakes. Its cars do not pitch for it.
    pub acceleration_mps2: T,
    /// Time at which the first wheelset enters, s.
    pub entry_time_s: T,
    /// Scales the static loads.
    pub load_factor: T,
    /// The end that it enters by.
    pub direction: Direction,
    /// What moves a wheel besides the rail's own motion.
    pub kinematics: Kinematics,
}

/// Where the train's first wheelset is, from the end that it enters by, and how fast.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrainPosition<T: Real> {
    /// Distance from that end, m; negative before.
    pub way_m: T,
    /// Speed, m/s.
    pub speed_mps: T,
}

impl<T: Real> Run<T> {
    /// A run at constant speed, entering by node 1 at time 0 with its static loads.
    pub fn at(speed_mps: T) -> Self {
        Self {
            speed_mps,
            acceleration_mps2: T::zero(),
            entry_time_s: T::zero(),
            load_factor: T::one(),
            direction: Direction::Forward,
            kinematics: Kinematics::Paper,
        }
    }

    /// Where the train is after `steps` steps of `step_s`.
    pub fn after(&self, steps: i32, step_s: T) -> TrainPosition<T> {
        let (v, a) = (self.speed_mps, self.acceleration_mps2);
        let n = T::counted(steps);
        if a == T::zero() {
            return TrainPosition {
                way_m: n * (v * step_s) - v * self.entry_time_s,
                speed_mps: v,
            };
        }
        // Before it has started, and after it has stopped, it stands.
        let standstill = -v / a;
        let t = n * step_s - self.entry_time_s;
        let t = if a > T::zero() {
            t.max(standstill)
        } else {
            t.min(standstill)
        };
        TrainPosition {
            way_m: t * (v + T::of(0.5) * a * t),
            speed_mps: v + a * t,
        }
    }

    /// Time at which the first wheelset is `way_m` from the end that it enters by, s; none if the train never is there.
    pub fn time_at_s(&self, way_m: T) -> Option<T> {
        let (v, a) = (self.speed_mps, self.acceleration_mps2);
        let square = v * v + (a + a) * way_m;
        if square <= T::zero() {
            return None;
        }
        // The root without cancellation, also for a = 0.
        Some(self.entry_time_s + (way_m + way_m) / (v + square.sqrt()))
    }
}

/// Why a run cannot be solved.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum SetupError {
    /// Speed, load factor, times, step or acceleration are not finite, or the first, second and step not positive.
    NotFinite,
    /// More cars than [`CARS`], or none.
    Cars,
    /// More cars touch the bridge at once than there is memory for.
    TooManyOnBridge,
    /// A sensor sits where the bridge model has none.
    NoSuchSensor,
    /// A mass or moment of inertia is not positive.
    Masses,
    /// A car's springs are too stiff for the step.
    TooStiff,
    /// The train stops before it has left the bridge, or started after the track's irregularity began.
    Stops,
}

impl fmt::Display for SetupError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotFinite => f.write_str("speed, load factor and step must be positive, the entry time finite"),
            Self::Cars => write!(f, "a train has 1 to {CARS} cars, from its front to its end"),
            Self::TooManyOnBridge => f.write_str("more cars would be on the bridge at once than there is memory for"),
            Self::NoSuchSensor => f.write_str("the bridge model has no sensor place at that node"),
            Self::Masses => f.write_str("a car has a mass or moment of inertia that is not positive"),
            Self::TooStiff => {
                f.write_str("a car's springs are too stiff for its masses at this step; take a shorter step")
            }
            Self::Stops => {
                f.write_str("the train would stop on its way over track and bridge; check speed and acceleration")
            }
        }
    }
}

impl core::error::Error for SetupError {}
