//! How the error falls with the step.

use anyhow::Result;
use spanwatch::interaction::{Run, Scheme};
use spanwatch::wire::message::TrainKind;

use super::beam::{Beam, GIRDER50};
use super::compare::relative_rms;
use super::{Row, Topic};
use crate::crossing::Crossing;
use crate::train::TrainName;

/// The topic.
pub const TOPIC: Topic = Topic {
    title: "Order in time",
    about: "An inspection car at 60 km/h over girder50, element 5 with 30 % less, three modes: 3.4 to 31 Hz, what a recorder \
            of 40 Hz shows. The error is the relative RMS of mid-span displacement over 5 s against the same scheme's \
            solution at 1/32 of the shorter step; the order is the binary logarithm of its fall from 2.5 to 1.25 ms. A wheel \
            that enters loads the modes with a ramp, and its corner leaves Fox and Goodwin's scheme, of the fourth order \
            otherwise, the second; the default scheme rounds corners. In a damped mode that scheme makes the free vibration \
            exact, and so leaves the slow answer of frequency n to a load an error of the second order, a part 2 xi n / w (w \
            h)² / 12 of it: that is the error of the last two rows, less than a hundredth of average acceleration's.",
    rows,
};

/// The longer step, s.
const STEP_S: f64 = 2.5e-3;
const NEXT_TERM: &str = "the next term of the error";

/// Errors at the longer step and at half of it. A first wheel that enters at `entry_s`, a multiple of the step, does so at
/// the end of a step.
fn errors(scheme: Scheme, damped: bool, entry_s: f64) -> Result<[f64; 2]> {
    let beam = Beam {
        damping_ratio: if damped { GIRDER50.damping_ratio } else { 0.0 },
        ..GIRDER50
    };
    let model = beam.damaged(10, 3, &[0.0, 0.0, 0.0, 0.0, 0.3])?;
    let mut train = TrainName::Known(TrainKind::Inspection2Dof).train(Some(1))?;
    if !damped {
        for contact in train.kinds.iter_mut().flat_map(|car| &mut car.contacts) {
            contact.spring.damping = 0.0;
        }
    }
    let displacement = |per: usize| -> Result<Vec<f64>> {
        let crossing = Crossing {
            model: &model,
            train: &train,
            run: Run {
                entry_time_s: entry_s,
                ..Run::at(60.0 / 3.6)
            },
            track: None,
            scheme,
            step_s: STEP_S / per as f64,
        };
        let all = crossing.history(6, 5.0)?.displacement_m;
        Ok(all.into_iter().skip(per - 1).step_by(per).collect())
    };
    let exact = displacement(64)?;
    Ok([
        relative_rms(&displacement(1)?, &exact),
        relative_rms(&displacement(2)?, &exact),
    ])
}

fn rows() -> Result<Vec<Row>> {
    /// Wheels come and go at the end of a step, or somewhere within one.
    const ON_STEP_S: f64 = 0.1;
    const WITHIN_STEP_S: f64 = 0.1009;
    [
        (
            "average acceleration",
            Scheme::AverageAcceleration,
            true,
            ON_STEP_S,
            2.0,
            0.05,
            NEXT_TERM,
        ),
        (
            "Fox and Goodwin",
            Scheme::FoxGoodwin,
            true,
            ON_STEP_S,
            2.0,
            0.05,
            NEXT_TERM,
        ),
        (
            "exact, no damper in bridge and car",
            Scheme::Exact,
            false,
            ON_STEP_S,
            4.0,
            0.125,
            "3.5 at least",
        ),
        (
            "exact, the default",
            Scheme::Exact,
            true,
            ON_STEP_S,
            2.0,
            0.05,
            NEXT_TERM,
        ),
        (
            "the same, wheels come and go within steps",
            Scheme::Exact,
            true,
            WITHIN_STEP_S,
            2.0,
            0.05,
            NEXT_TERM,
        ),
    ]
    .into_iter()
    .map(|(what, scheme, damped, entry_s, order, tolerance, reason)| {
        let [long, short] = errors(scheme, damped, entry_s)?;
        Ok(Row::new(
            format!("{what}: order, from an error of {long:.1e}"),
            "theory of the scheme",
        )
        .numbers(order, (long / short).log2())
        .shown("", 2)
        .within(tolerance, reason))
    })
    .collect()
}
