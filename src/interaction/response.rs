//! How the recorded motion answers to the track: the equations of a step, differentiated by a coefficient of its profile.
//!
//! A B-spline under the wheels is a change `du_i` of what the rail does to contact `i`, and of the state in which a car comes from its
//! approach: one more source of the differentiated step ([`sensitivity`](super::sensitivity)), and an exact one, for the motion is linear in the
//! profile. For the PC, where hundreds of coefficients are followed at once ([`Sensitivities::sample_with`](super::Sensitivities::sample_with)).

use super::car::{CarState, Lead};
use super::run::Direction;
use super::sensitivity::{Coupled, Source, Tangent};
use super::simulation::Observation;
use super::solver::{Approach, PlanarInteraction};
use crate::capacity::{CAR_DOFS, CHANNELS};
use crate::math::Real;
use crate::track::profile::Profile;

/// The answer to a B-spline of the track.
#[derive(Debug, Clone)]
pub struct Response<T: Real, const M: usize> {
    bspline: Profile<T>,
    support: [T; 2],
    tangent: Tangent<T, M>,
    approach: Option<Approach<T, CAR_DOFS>>,
    /// The latest sample of each channel, m/s² (m) per metre of the B-spline's height.
    pub sample: [T; CHANNELS],
}

impl<T: Real, const M: usize> Response<T, M> {
    /// The response to a B-spline, 1 m high, that begins and ends at `support`, m; at rest.
    pub fn to(bspline: Profile<T>, support: [T; 2]) -> Self {
        Self {
            bspline,
            support,
            tangent: Tangent::AT_REST,
            approach: None,
            sample: [T::ZERO; CHANNELS],
        }
    }

    /// Follows a step that `base` has made.
    pub(super) fn step(&mut self, base: &PlanarInteraction<T, M>, observed: &Observation<T>, coupling: &Coupled<T, M>) {
        let (cars, bspline, support) = (&observed.cars, &self.bspline, self.support);
        let speed = coupling.now.speed_mps;
        let rail = base.rail(cars, coupling, |contact, way| {
            let x = base.along(way);
            if support[0] < x && x < support[1] {
                base.irregularity(bspline, contact.motion, way, speed)
            } else {
                Lead::still()
            }
        });
        let ahead = base.along(T::ZERO);
        let behind = match base.run.direction {
            Direction::Forward => support[0] < ahead,
            Direction::Backward => support[1] > ahead,
        };
        if behind && coupling.aboard.end > coupling.entered {
            let last = self.approach.take();
            self.approach = base.approach_of(coupling.entered, cars, bspline, last, |contact, way, speed| {
                base.irregularity(bspline, contact.motion, way, speed)
            });
        }
        let approach = self.approach.as_ref();
        let source = Source {
            rail: Some(&rail),
            entering: &|index| {
                let approached = || {
                    let (_, (place, _, _)) = cars.from(index).next()?;
                    let since_s = base.since_begin_s(place, bspline)?;
                    let (approach, later_s) = base.shared(approach, place, since_s)?;
                    Some(approach.state(later_s))
                };
                approached().unwrap_or(CarState::AT_REST)
            },
            ..Source::modal([T::ZERO; M])
        };
        self.tangent.step(base, cars, coupling, &source);
        for (c, (sensor, sample)) in observed.recorder.sensors.iter().zip(&mut self.sample).enumerate() {
            *sample = self.tangent.recorded(base, observed, c, sensor.quantity, T::ZERO);
        }
    }
}
