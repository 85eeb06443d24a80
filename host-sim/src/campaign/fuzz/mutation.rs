//! Input that is nearly right: changed bytes, absurd numbers, lines in another order.

use serde::ser::{Serialize, SerializeTuple, Serializer};

use crate::campaign::forgery::flip;
use crate::campaign::line::Chance;

/// Numbers at which arithmetic turns over.
const EDGES: [f64; 16] = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.5,
    1e-3,
    1e-30,
    1e-45,
    1e9,
    1e30,
    f32::MAX as f64,
    f32::MIN as f64,
    f64::INFINITY,
    f64::NEG_INFINITY,
    f64::NAN,
    f32::MIN_POSITIVE as f64,
];
/// The same of whole numbers.
const WHOLE_EDGES: [u64; 12] = [
    0,
    1,
    2,
    0x7F,
    0xFF,
    0x7FFF,
    0xFFFF,
    i32::MAX as u64,
    u32::MAX as u64 - 1,
    u32::MAX as u64,
    u64::MAX - 1,
    u64::MAX,
];
/// Numbers as people write them, and as they do not.
const WORDS: [&str; 22] = [
    "0",
    "-1",
    "1",
    "2",
    "1e300",
    "-1e300",
    "1e-300",
    "1e-320",
    "nan",
    "inf",
    "-inf",
    "0.0",
    "-0.0",
    "4294967295",
    "9223372036854775807",
    "18446744073709551616",
    "1e9",
    "0.3",
    "\"\"",
    "[]",
    "true",
    "999",
];

/// A number from the edges, any at all, or one between 0 and 100.
pub(super) fn number(chance: &mut Chance) -> f32 {
    match chance.below(4) {
        0 | 1 => chance.pick(&EDGES) as f32,
        2 => f32::from_bits(chance.any() as u32),
        _ => chance.below(1_000_000) as f32 / 1e4,
    }
}

/// A number near `value`, or any.
pub(super) fn near(value: f32, chance: &mut Chance) -> f32 {
    match chance.below(4) {
        0 => number(chance),
        1 => -value,
        2 => value * (1.0 + (chance.below(2001) as f32 - 1000.0) * 1e-6),
        _ => value * chance.pick(&[0.0, 0.1, 0.9, 1.1, 10.0, 1e3, 1e-3, 1e6]),
    }
}

/// A whole number from the edges, any at all, or a small one.
pub(super) fn whole(chance: &mut Chance) -> u64 {
    match chance.below(3) {
        0 => chance.pick(&WHOLE_EDGES),
        1 => chance.any() >> chance.below(64),
        _ => chance.below(300),
    }
}

/// Changes bytes in one to four ways; `other` is what they are spliced with.
pub(super) fn mutate(bytes: &mut Vec<u8>, other: &[u8], chance: &mut Chance) {
    for _ in 0..=chance.below(4) {
        change(bytes, other, chance);
    }
}

fn change(bytes: &mut Vec<u8>, other: &[u8], chance: &mut Chance) {
    let length = bytes.len() as u64;
    let at = chance.below(length) as usize;
    match chance.below(11) {
        0 => flip(bytes, 4, chance),
        1 if length > 0 => bytes[at] = chance.pick(&[0, 1, 0x7F, 0x80, 0xFF]),
        2 if length > 0 => bytes[at] = chance.any() as u8,
        3 => bytes.insert(at, chance.any() as u8),
        4 if length > 0 => {
            let end = at + 1 + chance.below((bytes.len() - at) as u64) as usize;
            bytes.drain(at..end.min(at + 16));
        }
        5 => bytes.truncate(at),
        6 if !other.is_empty() => {
            let from = chance.below(other.len() as u64) as usize;
            bytes.truncate(at);
            bytes.extend_from_slice(&other[from..]);
        }
        7 => {
            let some = chance.below(20) as usize;
            bytes.extend(chance.bytes(some));
        }
        8 if length > 1 => {
            let to = chance.below(length) as usize;
            bytes.swap(at, to);
        }
        _ => {
            let written = match chance.below(3) {
                0 => number(chance).to_le_bytes().to_vec(),
                1 => (whole(chance) as u32).to_le_bytes().to_vec(),
                _ => whole(chance).to_le_bytes().to_vec(),
            };
            bytes
                .iter_mut()
                .skip(at)
                .zip(written)
                .for_each(|(byte, new)| *byte = new);
        }
    }
}

/// Changes text in one to four ways: numbers, words, lines, letters. What is no text any more stays bytes.
pub(super) fn mutate_text(text: &str, chance: &mut Chance) -> Vec<u8> {
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let mut bytes_too = false;
    for _ in 0..=chance.below(3) {
        if lines.is_empty() {
            break;
        }
        let at = chance.below(lines.len() as u64) as usize;
        let other = chance.below(lines.len() as u64) as usize;
        match chance.below(8) {
            0 => drop(lines.remove(at)),
            1 => lines.insert(other, lines[at].clone()),
            2 => lines.swap(at, other),
            3 => lines.truncate(at),
            4 => bytes_too = true,
            _ => lines[at] = other_word(&lines[at], &lines[other], chance),
        }
    }
    let mut bytes = lines.join("\n").into_bytes();
    bytes.push(b'\n');
    if bytes_too {
        mutate(&mut bytes, text.as_bytes(), chance);
    }
    bytes
}

/// The line with one of its words or numbers another.
fn other_word(line: &str, donor: &str, chance: &mut Chance) -> String {
    let words = |line: &str| -> Vec<(usize, usize)> {
        let mut words = vec![];
        let mut start = None;
        for (at, c) in line.char_indices().chain([(line.len(), ' ')]) {
            let inside = c.is_ascii_alphanumeric() || matches!(c, '.' | '-' | '+' | '_');
            match (inside, start) {
                (true, None) => start = Some(at),
                (false, Some(from)) => {
                    words.push((from, at));
                    start = None;
                }
                _ => {}
            }
        }
        words
    };
    let mine = words(line);
    if mine.is_empty() {
        return line.to_owned();
    }
    // Values stand behind names.
    let numbers: Vec<(usize, usize)> = (mine.iter().copied())
        .filter(|&(from, to)| line[from..to].parse::<f64>().is_ok())
        .collect();
    let (from, to) = match numbers.is_empty() || chance.once_in(4) {
        true => chance.pick(&mine),
        false => chance.pick(&numbers),
    };
    let theirs = words(donor);
    let new = match chance.below(4) {
        0 if !theirs.is_empty() => {
            let (from, to) = chance.pick(&theirs);
            donor[from..to].to_owned()
        }
        1 => match line[from..to].parse::<f64>() {
            Ok(value) => format!("{}", value * chance.pick(&[-1.0, 0.1, 0.99, 1.01, 2.0, 1e3, 1e9, 1e-9])),
            Err(_) => String::new(),
        },
        _ => chance.pick(&WORDS).to_owned(),
    };
    format!("{}{new}{}", &line[..from], &line[to..])
}

/// A message as it travels.
pub(super) fn posted(message: &impl Serialize) -> Vec<u8> {
    let mut room = [0; 1024];
    postcard::to_slice(message, &mut room)
        .map(|written| written.to_vec())
        .unwrap_or_default()
}

/// Bytes that are a message by themselves, without a length before them.
pub(super) struct Raw<'a>(pub(super) &'a [u8]);

impl Serialize for Raw<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut all = serializer.serialize_tuple(self.0.len())?;
        for byte in self.0 {
            all.serialize_element(byte)?;
        }
        all.end()
    }
}
