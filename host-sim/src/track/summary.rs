//! What a track is like, in numbers.

use spanwatch::track::{Motion, Track};

use super::{Profile, RAIL_DISTANCE_M, table};

/// A value and where it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extreme {
    /// The value.
    pub value: f64,
    /// Its place, m.
    pub x_m: f64,
}

/// One motion of a track, as a length: roll as the difference of the rails' heights.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Summary {
    /// Root mean square about the mean, over the length, m.
    pub rms_m: f64,
    /// Lowest and highest value at the points, m above the beginning.
    pub extremes: [Extreme; 2],
    /// Slope of the largest size, m/m.
    pub slope: Extreme,
    /// Curvature of the largest size, 1/m.
    pub curvature: Extreme,
}

/// Sums up one motion.
pub fn summary(track: &Profile, motion: Motion) -> Summary {
    let x = &track.rails().x_m;
    let points: Vec<_> = x.iter().map(|&x| Track::<f64>::at(track, motion, x)).collect();
    let scale = scale(motion);

    // Trapezoids, for points at any spacing.
    let mean_of = |f: &dyn Fn(f64) -> f64| {
        let sum: f64 = (x.windows(2).zip(points.windows(2)))
            .map(|(x, p)| (x[1] - x[0]) * (f(p[0].value) + f(p[1].value)) / 2.0)
            .sum();
        sum / (x[x.len() - 1] - x[0])
    };
    let mean = mean_of(&|value| value);
    let rms = mean_of(&|value| (value - mean).powi(2)).sqrt();

    let at_points = |f: &dyn Fn(usize) -> f64| -> Vec<Extreme> {
        (0..x.len())
            .map(|i| Extreme {
                value: scale * f(i),
                x_m: x[i],
            })
            .collect()
    };
    let values = at_points(&|i| points[i].value);
    let curvatures = at_points(&|i| points[i].curvature);
    let mut slopes = at_points(&|i| points[i].slope);
    // Curvature is straight between points: where it passes zero there, the slope is largest.
    for i in 1..x.len() {
        let [before, after] = [points[i - 1].curvature, points[i].curvature];
        if before * after < 0.0 {
            let turn = x[i - 1] + (x[i] - x[i - 1]) * before / (before - after);
            slopes.push(Extreme {
                value: scale * Track::<f64>::at(track, motion, turn).slope,
                x_m: turn,
            });
        }
    }
    let most = |of: &[Extreme], key: &dyn Fn(f64) -> f64| {
        (of.iter().copied())
            .reduce(|best, next| if key(next.value) > key(best.value) { next } else { best })
            .unwrap_or(Extreme { value: 0.0, x_m: x[0] })
    };
    Summary {
        rms_m: scale * rms,
        extremes: [most(&values, &|v| -v), most(&values, &|v| v)],
        slope: most(&slopes, &f64::abs),
        curvature: most(&curvatures, &f64::abs),
    }
}

/// What makes a length of a motion.
pub fn scale(motion: Motion) -> f64 {
    match motion {
        Motion::Vertical | Motion::Lateral => 1.0,
        Motion::Roll => RAIL_DISTANCE_M,
    }
}

/// Smallest, usual (median) and largest distance of points, m.
pub fn spacing_m(track: &Profile) -> [f64; 3] {
    let x = &track.rails().x_m;
    let spacings = || x.windows(2).map(|pair| pair[1] - pair[0]);
    [
        spacings().fold(f64::INFINITY, f64::min),
        table::median_spacing_m(x),
        spacings().fold(0.0, f64::max),
    ]
}
