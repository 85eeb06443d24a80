//! A logger on a serial device.

use std::io::{self, Read, Write};
use std::path::Path;
use std::time::Duration;

use anyhow::{Result, anyhow};
use serialport::SerialPort;

use super::Channel;

/// Bits a second: what the firmware's UART is set to.
const BAUD: u32 = 115_200;

/// An open serial device.
pub struct Serial {
    port: Box<dyn SerialPort>,
}

impl Serial {
    /// Opens `device` at 115,200 baud, 8 bits, no parity, one stop bit.
    pub fn open(device: &Path) -> Result<Self> {
        let name = device.to_string_lossy();
        let port = serialport::new(name.as_ref(), BAUD)
            .timeout(Duration::from_secs(1))
            .open()
            .map_err(|error| anyhow!("serial device {name} cannot be opened: {error}"))?;
        Ok(Self { port })
    }
}

impl Channel for Serial {
    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.port.write_all(bytes)
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        self.port.set_timeout(timeout)?;
        match self.port.read(buffer) {
            Err(error) if matches!(error.kind(), io::ErrorKind::TimedOut | io::ErrorKind::Interrupted) => Ok(0),
            other => other,
        }
    }
}
