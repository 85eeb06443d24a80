//! A load that is suddenly there, on a damped beam: the closed modal solution.

use anyhow::Result;
use spanwatch::interaction::{Run, Scheme};

use super::beam::{self, Beam};
use super::compare::lowest;
use super::{Row, Topic};
use crate::crossing::Crossing;

/// The topic.
pub const TOPIC: Topic = Topic {
    title: "A sudden load on a damped beam",
    about: "After NAFEMS' test 5T (a simply supported beam, a load at once, damping; its deep beam feels shear, which these \
            elements leave out, so the expected values are those of the same beam without shear under a point load): 10 m, 2 \
            m by 2 m of E = 2e11 N/m² and 8000 kg/m³, 10 MN at mid-span, Rayleigh damping 0.02 at the first two modes. The \
            load is a train that stands (1 nm/s). The closed form is sum_k phi_k² P / w_k² (1 - exp(-xi w t) (cos w_d t + xi \
            w / w_d sin w_d t)). The solver's load comes with its first step: the bridge is at rest before it, and average \
            acceleration takes the load to rise within that step, so its time is half a step late.",
    rows,
};

const BEAM: Beam = Beam {
    length_m: 10.0,
    bending_stiffness_nm2: 2e11 * 16.0 / 12.0,
    mass_kgpm: 8000.0 * 4.0,
    damping_ratio: 0.02,
};
const LOAD_N: f64 = 1e7;
const STEP_S: f64 = 1e-5;
const MODES: usize = 20;
/// When the first mode has died down to 1e-6, s.
const AT_REST_S: f64 = 2.5;

/// Mid-span displacement by the closed form, m.
fn closed_form(t: f64) -> f64 {
    let of_mode = |k: usize| {
        let (w, half_damping) = (BEAM.omega(k), 0.5 * BEAM.damping(k));
        let square = w * w - half_damping * half_damping;
        let wd = square.abs().sqrt();
        let rest = if square > 0.0 {
            (-half_damping * t).exp() * ((wd * t).cos() + half_damping / wd * (wd * t).sin())
        } else {
            // Overdamped: the same with cosh and sinh, put so that nothing grows.
            let [slow, fast] = [((wd - half_damping) * t).exp(), (-(wd + half_damping) * t).exp()];
            0.5 * (slow + fast + half_damping / wd * (slow - fast))
        };
        (BEAM.shape(k, 0.5 * BEAM.length_m) / w).powi(2) * (1.0 - rest)
    };
    // Even modes do not move mid-span.
    -LOAD_N * (1..=MODES).step_by(2).map(of_mode).sum::<f64>()
}

fn rows() -> Result<Vec<Row>> {
    const CLOSED: &str = "closed modal solution";
    const SPEED_MPS: f64 = 1e-9;
    let model = BEAM.modes(20, MODES)?;
    let train = beam::alone(beam::force(LOAD_N))?;
    let standing = |scheme, step_s, duration_s| {
        Crossing {
            model: &model,
            train: &train,
            run: Run {
                entry_time_s: -0.5 * BEAM.length_m / SPEED_MPS,
                ..Run::at(SPEED_MPS)
            },
            track: None,
            scheme,
            step_s,
        }
        .history(11, duration_s)
    };
    // The closed form's own peak, at a hundredth of the step.
    let fine: Vec<f64> = (0..200_000).map(|n| closed_form(n as f64 * 1e-7)).collect();
    let (peak_at, peak_m) = lowest(&fine);
    let early = standing(Scheme::AverageAcceleration, STEP_S, 0.1)?.displacement_m;
    let (found_at, found_m) = lowest(&early[..2000]);
    let expected: Vec<f64> = (1..=early.len())
        .map(|n| closed_form((n as f64 - 0.5) * STEP_S))
        .collect();
    let late = standing(Scheme::Exact, 1e-3, AT_REST_S)?.displacement_m;
    let static_m = LOAD_N * BEAM.length_m.powi(3) / (48.0 * BEAM.bending_stiffness_nm2);
    Ok(vec![
        Row::new("peak", CLOSED)
            .numbers(-1e3 * peak_m, -1e3 * found_m)
            .shown("mm", 5)
            .within(1e-4, "frequencies of twenty elements"),
        Row::new("time of it", CLOSED)
            .numbers(1e3 * peak_at * 1e-7, 1e3 * (found_at + 0.5) * STEP_S)
            .shown("ms", 4)
            .within(1e-4, "1 µs of a flat peak"),
        Row::new("first 0.1 s at all times", CLOSED)
            .everywhere(&expected, &early)
            .times(1e3)
            .shown("mm", 5)
            .within(1e-4, "high modes, stepped 10 µs at a time"),
        Row::new("at rest, after 2.5 s", "P L³ / 48 E I")
            .numbers(1e3 * static_m, -1e3 * late[late.len() - 1])
            .shown("mm", 5)
            .within(1e-4, "1 / k⁴ of the odd modes above the twentieth: 2e-5 in all"),
    ])
}
