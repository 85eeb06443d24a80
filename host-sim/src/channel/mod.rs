//! Ways to a logger, as bytes that go and come.

pub mod qemu;

/// Bytes to and from a logger.
pub trait Channel {
    /// Sends all of `bytes`.
    fn send(&mut self, bytes: &[u8]) -> std::io::Result<()>;
    /// Waits for bytes; how many were written to `buffer`, 0 after the timeout.
    fn receive(&mut self, buffer: &mut [u8], timeout: std::time::Duration) -> std::io::Result<usize>;
}
