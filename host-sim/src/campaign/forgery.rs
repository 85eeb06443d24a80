//! Frames taken apart, changed and put together again, as an attacker and the fuzz campaign do it.

use super::line::Chance;

/// Bytes of a frame's head.
pub const HEADER_BYTES: usize = 8;

/// A frame without stuffing, zeros and checksum.
pub fn bare(line: &[u8]) -> Vec<u8> {
    let mut bare = vec![];
    let mut rest = line.strip_prefix(&[0]).unwrap_or(line);
    while let Some((&count, after)) = rest.split_first() {
        if count == 0 {
            break;
        }
        let (block, after) = after.split_at(usize::from(count - 1).min(after.len()));
        bare.extend_from_slice(block);
        if count < 255 && after.first().is_some_and(|&next| next != 0) {
            bare.push(0);
        }
        rest = after;
    }
    bare.truncate(bare.len().saturating_sub(4));
    bare
}

/// A frame of these bytes, its length and checksum made right.
pub fn framed(mut bare: Vec<u8>) -> Vec<u8> {
    bare.resize(bare.len().max(8), 0);
    let length = (bare.len() - 8) as u16;
    bare[6..8].copy_from_slice(&length.to_le_bytes());
    bare.extend_from_slice(&spanwatch::wire::CRC32C.checksum(&bare).to_le_bytes());
    stuffed(&bare)
}

/// COBS as its paper defines it, out of place: of the bytes and a zero after them, what lies before each zero behind its count, and what is
/// longer than 254 in blocks that stand for no zero.
pub fn stuffed(bare: &[u8]) -> Vec<u8> {
    let mut line = vec![0];
    let mut parts = bare.split(|&byte| byte == 0).peekable();
    while let Some(mut rest) = parts.next() {
        let zero_follows = parts.peek().is_some();
        while rest.len() > 254 || (rest.len() == 254 && zero_follows) {
            line.push(255);
            line.extend_from_slice(&rest[..254]);
            rest = &rest[254..];
        }
        line.push(rest.len() as u8 + 1);
        line.extend_from_slice(rest);
    }
    line.push(0);
    line
}

/// A bare frame with fewer bytes, its head left whole.
pub fn truncated(mut bare: Vec<u8>, chance: &mut Chance) -> Vec<u8> {
    let less = 1 + chance.below((bare.len() - HEADER_BYTES) as u64) as usize;
    bare.truncate(bare.len().saturating_sub(less));
    bare
}

/// The head of one and the rest of another.
pub fn spliced(head: &[u8], rest: &[u8], chance: &mut Chance) -> Vec<u8> {
    let cut = chance.below(head.len().min(rest.len()) as u64) as usize;
    [&head[..cut], &rest[cut..]].concat()
}

/// Flips one to `most` bits.
pub fn flip(bytes: &mut [u8], most: u64, chance: &mut Chance) {
    if bytes.is_empty() {
        return;
    }
    for _ in 0..=chance.below(most) {
        let bit = chance.below(8 * bytes.len() as u64) as usize;
        bytes[bit / 8] ^= 1 << (bit % 8);
    }
}
