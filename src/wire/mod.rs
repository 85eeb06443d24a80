//! wire

pub mod message;

/// CRC-32C (Castagnoli), of frames and of the bridge model.
pub const CRC32C: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISCSI);
