//! Mode shapes of a reduced model, as numbers and as a sketch in text.

use spanwatch::bridge::{ModalBridge, ReducedBridge};
use spanwatch::capacity::MODES;
use spanwatch::interaction::Modes;
use spanwatch::train::Motion;

/// A natural mode of the undamaged bridge.
#[derive(Debug, Clone, PartialEq)]
pub struct Mode {
    /// Natural frequency, Hz.
    pub frequency_hz: f64,
    /// Damping ratio.
    pub damping_ratio: f64,
    /// Shape at equal distances from the first node of the path to the last, its largest value 1 and its first
    /// movement upwards.
    pub shape: Vec<f64>,
}

/// The modes that the logger steps, lowest first, each shape at `points` (at least 2) points.
pub fn modes(bridge: &ReducedBridge<f64>, points: usize) -> Vec<Mode> {
    let modal = ModalBridge::<f64, MODES>::new(bridge, &[0.0; _], &[]);
    let length_m = bridge.path.length_m();
    let along: Vec<_> = (0..points)
        .map(|i| modal.shape(Motion::Vertical, 0, i as f64 / (points - 1) as f64 * length_m))
        .collect();
    (0..MODES.min(bridge.basis))
        .map(|k| {
            let mut shape: Vec<f64> = along.iter().map(|at| at[k]).collect();
            let largest = shape.iter().fold(0.0_f64, |largest, w| largest.max(w.abs()));
            let rises = shape.iter().find(|w| w.abs() > 1e-3 * largest).is_none_or(|&w| w > 0.0);
            let scale = if largest > 0.0 { largest.recip() } else { 1.0 } * if rises { 1.0 } else { -1.0 };
            shape.iter_mut().for_each(|w| *w *= scale);
            Mode {
                frequency_hz: modal.frequency_hz(k),
                damping_ratio: modal.damping[k] / (2.0 * modal.omega_squared[k].sqrt()),
                shape,
            }
        })
        .collect()
}

/// Nodes (from 1) that cannot move: what the model shows of the supports.
pub fn held_nodes(bridge: &ReducedBridge<f64>) -> Vec<u16> {
    bridge
        .sensor_node
        .iter()
        .zip(bridge.sensors.column_iter())
        .take(bridge.sensor_count)
        .filter(|(_, row)| row.iter().all(|&w| w == 0.0))
        .map(|(&node, _)| node)
        .collect()
}

/// A curve of values from -1 to 1 drawn with Braille characters over a dotted zero line, `columns x rows` characters.
///
/// Each character holds 2 x 4 dots (Unicode U+2800 plus one bit a dot).
pub fn sketch(values: &[f64], columns: usize, rows: usize) -> Vec<String> {
    const DOT: [[u32; 4]; 2] = [[0x01, 0x02, 0x04, 0x40], [0x08, 0x10, 0x20, 0x80]];
    let (width, height) = (2 * columns, 4 * rows);
    let mut cells = vec![vec![0_u32; columns]; rows];
    let mut dot = |x: usize, y: usize| cells[y / 4][x / 2] |= DOT[x % 2][y % 4];
    let level = |value: f64| ((1.0 - value.clamp(-1.0, 1.0)) / 2.0 * (height - 1) as f64).round() as usize;
    let at = |x: usize| {
        let place = x as f64 / (width - 1) as f64 * (values.len() - 1) as f64;
        let (left, part) = (place.floor() as usize, place.fract());
        values[left] * (1.0 - part) + values[(left + 1).min(values.len() - 1)] * part
    };
    let mut last = level(at(0));
    for x in 0..width {
        let y = level(at(x));
        // Where the curve is steep it stays one line.
        for between in last.min(y) + usize::from(last < y)..=last.max(y) - usize::from(last > y) {
            dot(x, between);
        }
        last = y;
        if x % 4 == 0 {
            dot(x, level(0.0));
        }
    }
    cells
        .into_iter()
        .map(|row| {
            row.into_iter()
                .map(|bits| char::from_u32(0x2800 + bits).unwrap_or(' '))
                .collect()
        })
        .collect()
}
