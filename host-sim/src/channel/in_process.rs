//! A logger in this process, behind the same bytes as one on a line.

use std::collections::VecDeque;
use std::io;
use std::time::Duration;

use anyhow::Result;

use super::Channel;
use super::pc::{PcFlash, PcLogger};

/// The logger, and what it has said that nobody has read.
#[derive(Default)]
pub struct InProcess {
    logger: PcLogger,
    said: VecDeque<u8>,
}

impl InProcess {
    /// A logger that has just been switched on, its flash in memory.
    pub fn new() -> Self {
        Self::default()
    }

    /// A logger on this flash.
    pub fn on(flash: [PcFlash; 2]) -> Result<Self> {
        Ok(Self {
            logger: PcLogger::start(flash)?,
            said: VecDeque::new(),
        })
    }

    /// The recording ends here, as if the base station had said so.
    pub fn finish(&mut self) {
        self.logger.finish();
    }
}

impl Channel for InProcess {
    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        let said = &mut self.said;
        self.logger.receive(bytes, |bytes| said.extend(bytes));
        Ok(())
    }

    /// Works while there is nothing to read, as the firmware does.
    fn receive(&mut self, buffer: &mut [u8], _timeout: Duration) -> io::Result<usize> {
        let said = &mut self.said;
        let mut more = true;
        while said.is_empty() && more {
            more = self.logger.poll(|bytes| said.extend(bytes));
        }
        io::Read::read(said, buffer)
    }
}
