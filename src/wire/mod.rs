//! The line between logger and base station: what is said ([`message`]) and how it is cut into frames ([`frame`]).
//!
//! Both ends use this module, so what one can say the other can read. Its checksum guards against noise; against malice each frame is
//! sealed by a [session](crate::session).

pub mod frame;
pub mod message;

pub use frame::{Decoder, Frame, FrameBuffer, Kind, Rejections};

/// CRC-32C (Castagnoli), of frames and of the bridge model.
pub const CRC32C: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISCSI);

/// By what a blob that ends in its own checksum is known: that checksum. (The checksum of all of it would be the same for every one.)
pub fn fingerprint(blob: &[u8]) -> u32 {
    blob.last_chunk().copied().map_or(0, u32::from_le_bytes)
}
