//! From printed times to sample indices.
//!
//! Recorders print rounded times (0.000547, 0.001094 for 1828.57 Hz), and rows may be missing. So the interval is first
//! guessed as the lower quartile of the differences, which is right even if most rows follow a gap, then taken from all
//! rows that follow each other, and at last from the first row to the last; each difference must be a whole number of
//! intervals.

/// A time may lie this part of an interval off its sample. A millisecond's rounding at 500 Hz is as much; a clock that
/// is further off does not tell one sample from the next any more.
pub const TIME_TOLERANCE: f64 = 0.25;

/// Samples beyond that many are not counted by a time's number.
const MOST_SAMPLES: u64 = 1 << f64::MANTISSA_DIGITS;

/// Consecutive rows without a gap.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Run {
    /// Index in the stream of its first sample; the first run's is 0.
    pub first_sample: u64,
    /// Its first row.
    pub first_row: usize,
    /// How many rows; at least 1.
    pub rows: usize,
}

/// Why times make no clock.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ClockError {
    /// A single row has no interval.
    OneRow,
    /// The time of `row` is not later than that of the row before.
    NotIncreasing {
        /// The row, from 0.
        row: usize,
    },
    /// The time of `row` is not a whole number of intervals after the first.
    Uneven {
        /// The row, from 0.
        row: usize,
        /// The interval that fits the other rows, s.
        interval_s: f64,
    },
}

/// Interval (s) and runs of increasing `times` (s).
pub fn runs(times: &[f64]) -> Result<(f64, Vec<Run>), ClockError> {
    let [first, .., last] = times else {
        return Err(ClockError::OneRow);
    };
    let differences: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    if let Some(row) = differences.iter().position(|&difference| difference <= 0.0) {
        return Err(ClockError::NotIncreasing { row: row + 1 });
    }
    let mut sorted = differences.clone();
    sorted.sort_by(f64::total_cmp);
    let guess = sorted[(sorted.len() - 1) / 4];
    let next: Vec<f64> = differences
        .iter()
        .copied()
        .filter(|difference| difference / guess < 1.5)
        .collect();
    let refined = next.iter().sum::<f64>() / next.len() as f64;

    let mut index = 0;
    let mut indices = vec![0];
    for difference in &differences {
        index = ((difference / refined).round() as u64).max(1).saturating_add(index);
        indices.push(index);
    }
    let interval_s = (last - first) / index as f64;
    let uneven = times
        .iter()
        .zip(&indices)
        // Times so far apart that their difference is no number make no clock either.
        .position(|(time, &index)| {
            let off = ((time - first) / interval_s - index as f64).abs();
            off > TIME_TOLERANCE || off.is_nan() || index > MOST_SAMPLES
        });
    if let Some(row) = uneven {
        return Err(ClockError::Uneven {
            row,
            interval_s: refined,
        });
    }

    let mut runs: Vec<Run> = Vec::new();
    for (row, &sample) in indices.iter().enumerate() {
        match runs.last_mut() {
            Some(run) if run.first_sample + run.rows as u64 == sample => run.rows += 1,
            _ => runs.push(Run {
                first_sample: sample,
                first_row: row,
                rows: 1,
            }),
        }
    }
    Ok((interval_s, runs))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounded_times_give_the_rate_from_first_to_last() {
        let times: Vec<f64> = (0..22_200).map(|k| (k as f64 / 1828.57 * 1e6).round() / 1e6).collect();
        let (interval, runs) = runs(&times).expect("a clock");
        assert!((interval * 1828.57 - 1.0).abs() < 1e-7, "{interval}");
        assert_eq!(runs.len(), 1);
    }

    #[test]
    fn a_gap_is_a_whole_number_of_intervals_even_a_long_one_of_rounded_times() {
        let kept = (0..500).chain(40_000..40_300).chain([40_305]);
        let times: Vec<f64> = kept.map(|k| (k as f64 / 1828.57 * 1e6).round() / 1e6 + 12.0).collect();
        let (_, runs) = runs(&times).expect("a clock");
        let starts: Vec<_> = runs
            .iter()
            .map(|run| (run.first_sample, run.first_row, run.rows))
            .collect();
        assert_eq!(starts, [(0, 0, 500), (40_000, 500, 300), (40_305, 800, 1)]);
    }

    #[test]
    fn what_is_no_clock_is_refused() {
        assert_eq!(runs(&[0.0]), Err(ClockError::OneRow));
        assert_eq!(runs(&[0.0, 0.1, 0.1]), Err(ClockError::NotIncreasing { row: 2 }));
        let times = [0.0, 0.1, 0.2, 0.34, 0.4, 0.5];
        assert!(matches!(runs(&times), Err(ClockError::Uneven { row: 3, .. })));
    }
}
