//! A logger in this process, behind the same bytes as one on a line.

use std::collections::VecDeque;
use std::io;
use std::time::Duration;

use super::{Channel, PcBoard, PcLogger, new_logger};

/// The logger, and what it has said that nobody has read.
pub struct InProcess {
    logger: Box<PcLogger>,
    board: PcBoard,
    said: VecDeque<u8>,
}

impl InProcess {
    /// A logger that has just been switched on.
    pub fn new() -> Self {
        Self {
            logger: new_logger(),
            board: PcBoard::new(),
            said: VecDeque::new(),
        }
    }

    /// The recording ends here, as if the base station had said so.
    pub fn finish(&mut self) {
        self.logger.finish();
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
            .receive(bytes, &mut self.board.sending(|bytes| said.extend(bytes)));
        Ok(())
    }

    /// Works while there is nothing to read, as the firmware does.
    fn receive(&mut self, buffer: &mut [u8], _timeout: Duration) -> io::Result<usize> {
        let said = &mut self.said;
        let mut more = true;
        while said.is_empty() && more {
            more = self.logger.poll(&mut self.board.sending(|bytes| said.extend(bytes)));
        }
        io::Read::read(said, buffer)
    }
}
