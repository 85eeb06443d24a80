//! Histories compared.

/// Root of the mean square.
pub fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
}

/// RMS of the difference, a part of the RMS that is expected; no number if the lengths differ.
pub fn relative_rms(found: &[f64], expected: &[f64]) -> f64 {
    if found.len() != expected.len() {
        return f64::NAN;
    }
    let apart: Vec<f64> = found.iter().zip(expected).map(|(f, e)| f - e).collect();
    rms(&apart) / rms(expected)
}

/// Largest magnitude.
pub fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |largest, value| value.abs().max(largest))
}

/// Place (in samples, from 0) and value of the lowest point: of the parabola through the lowest sample and its neighbours.
pub fn lowest(values: &[f64]) -> (f64, f64) {
    let at = (0..values.len())
        .min_by(|&a, &b| values[a].total_cmp(&values[b]))
        .unwrap_or(0);
    if at == 0 || at + 1 >= values.len() {
        return (at as f64, values.get(at).copied().unwrap_or(f64::NAN));
    }
    let (before, here, after) = (values[at - 1], values[at], values[at + 1]);
    let (slope, bend) = (0.5 * (after - before), after - 2.0 * here + before);
    if bend == 0.0 {
        return (at as f64, here);
    }
    (at as f64 - slope / bend, here - 0.5 * slope * slope / bend)
}
