//! A logger in this process, behind the same bytes as one on a line.

use std::collections::VecDeque;
use std::io;
use std::time::Duration;

use spanwatch::link::RemoteLogger;

use super::{Channel, PcBoard};

/// The logger, and what it has said that nobody has read.
pub struct InProcess {
    logger: Box<RemoteLogger>,
    said: VecDeque<u8>,
}

impl InProcess {
    /// A logger that has just been switched on.
    pub fn new() -> Self {
        Self {
            logger: Box::new(RemoteLogger::new()),
            said: VecDeque::new(),
        }
    }
}

impl Default for InProcess {
    fn default() -> Self {
        Self::new()
    }
}

impl Channel for InProcess {
    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        let said = &mut self.said;
        self.logger
            .receive(bytes, &mut PcBoard(|bytes: &[u8]| said.extend(bytes)));
        Ok(())
    }

    /// Works while there is nothing to read, as the firmware does.
    fn receive(&mut self, buffer: &mut [u8], _timeout: Duration) -> io::Result<usize> {
        let said = &mut self.said;
        let mut more = true;
        while said.is_empty() && more {
            more = self.logger.poll(&mut PcBoard(|bytes: &[u8]| said.extend(bytes)));
        }
        io::Read::read(said, buffer)
    }
}
