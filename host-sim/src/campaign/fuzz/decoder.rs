//! The decoder of frames, compared with one that is written down as the format is: each piece between two zeros by itself.

use spanwatch::session::Hello;
use spanwatch::wire::CRC32C;
use spanwatch::wire::frame::SEALING_BYTES;
use spanwatch::wire::message::{Answer, Event, Request, VERSION};
use spanwatch::wire::{Decoder, Kind};

use super::mutation::mutate;
use super::{Counts, must};
use crate::campaign::forgery::{self, HEADER_BYTES, flip, framed, spliced, truncated};
use crate::campaign::line::Chance;
use spanwatch::capacity::PAYLOAD_BYTES;

const CRC_BYTES: usize = 4;
/// Bytes of a frame at most, without stuffing.
const BARE_BYTES: usize = HEADER_BYTES + PAYLOAD_BYTES + SEALING_BYTES + CRC_BYTES;
/// Kinds of frames, from 1.
const KINDS: u64 = Kind::Time as u64;

/// Kind, number and payload of a frame.
type Found = (u8, u32, Vec<u8>);

/// A line with several frames, whole and not, and garbage between.
pub(super) fn run(chance: &mut Chance) -> Result<Counts, String> {
    let mut line = vec![0];
    let mut whole: Vec<Found> = vec![];
    for _ in 0..=chance.below(6) {
        match chance.below(3) {
            0 => {
                let most = if chance.once_in(8) { 1200 } else { 60 };
                let length = chance.below(most) as usize;
                line.extend(chance.bytes(length));
            }
            1 => {
                let broken = broken(chance);
                line.extend(broken);
            }
            _ => {
                // A zero ends what was before.
                line.push(0);
                let (frame, found) = sound(chance);
                line.extend(frame);
                whole.push(found);
            }
        }
    }
    line.push(0);

    let mut decoder = Decoder::new();
    let mut found: Vec<Found> = vec![];
    for &byte in &line {
        if let Some(frame) = decoder.push(byte) {
            // Whatever it holds can be looked at.
            let _ = (frame.message::<Request>(), frame.message::<Answer>());
            let _ = (frame.message::<Event>(), Hello::from_bytes(frame.payload()));
            found.push((frame.kind as u8, frame.sequence, frame.payload().to_vec()));
        }
    }
    let pieces = || line.split(|&byte| byte == 0).filter(|piece| !piece.is_empty());
    let expected: Vec<Found> = pieces().filter_map(read).collect();
    must!(
        found == expected,
        "{} frames found, {} are there",
        found.len(),
        expected.len()
    );
    let mut left = found.iter();
    must!(
        whole.iter().all(|frame| left.any(|other| other == frame)),
        "a frame that was whole is missing"
    );
    let refused = pieces().count() - found.len();
    must!(
        decoder.rejections().total() as usize == refused,
        "{} pieces refused, {} counted",
        refused,
        decoder.rejections().total()
    );
    Ok(Counts {
        accepted: found.len() as u64,
        refused: refused as u64,
    })
}

/// A frame and what it says.
fn sound(chance: &mut Chance) -> (Vec<u8>, Found) {
    let most = match chance.below(4) {
        0 => PAYLOAD_BYTES + SEALING_BYTES,
        1 => 260,
        _ => 40,
    };
    let length = chance.below(most as u64 + 1) as usize;
    let mut payload = chance.bytes(length);
    if chance.once_in(3) {
        // What stuffing takes out, and long runs without any.
        let fill = chance.pick(&[0, 1, 0xFF]);
        payload.iter_mut().for_each(|byte| *byte = fill);
    }
    let (kind, number) = (1 + chance.below(KINDS) as u8, chance.any() as u32);
    let mut bare = vec![VERSION, kind];
    bare.extend(number.to_le_bytes());
    bare.extend([0, 0]);
    bare.extend(&payload);
    (framed(bare), (kind, number, payload))
}

/// A frame that was something else: with its checksum right, wrong, or stuffed wrongly.
fn broken(chance: &mut Chance) -> Vec<u8> {
    let (mut line, _) = sound(chance);
    let bare = forgery::bare(&line);
    match chance.below(6) {
        0 => framed(truncated(bare, chance)),
        1 => {
            let (other, _) = sound(chance);
            framed(spliced(&bare, &forgery::bare(&other), chance))
        }
        2 => {
            let mut bare = bare;
            flip(&mut bare, 3, chance);
            framed(bare)
        }
        3 => {
            let mut bare = bare;
            mutate(&mut bare, &[], chance);
            bare.extend(CRC32C.checksum(&bare).to_le_bytes());
            forgery::stuffed(&bare)
        }
        4 => {
            let (other, _) = sound(chance);
            mutate(&mut line, &other, chance);
            line
        }
        _ => {
            flip(&mut line, 3, chance);
            line
        }
    }
}

/// What a piece between two zeros says, by the book.
fn read(piece: &[u8]) -> Option<Found> {
    let mut bare = vec![];
    let mut rest = piece;
    while let Some((&count, after)) = rest.split_first() {
        let (block, after) = after.split_at_checked(usize::from(count) - 1)?;
        bare.extend_from_slice(block);
        if count < 255 && !after.is_empty() {
            bare.push(0);
        }
        rest = after;
    }
    if bare.len() > BARE_BYTES {
        return None;
    }
    let (checked, crc) = bare.split_last_chunk::<CRC_BYTES>()?;
    let (&[version, kind, s0, s1, s2, s3, l0, l1], payload) = checked.split_first_chunk::<HEADER_BYTES>()?;
    let sound = CRC32C.checksum(checked) == u32::from_le_bytes(*crc)
        && version == VERSION
        && (1..=KINDS).contains(&kind.into())
        && usize::from(u16::from_le_bytes([l0, l1])) == payload.len();
    sound.then(|| (kind, u32::from_le_bytes([s0, s1, s2, s3]), payload.to_vec()))
}
