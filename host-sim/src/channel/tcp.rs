//! A logger on a TCP line: the base station's end, and a logger on this PC for the other.

use std::io::{self, Read, Write};
use std::net::{TcpListener, TcpStream, ToSocketAddrs};
use std::time::Duration;

use anyhow::{Context, Result, anyhow};

use super::{Channel, PcBoard, PcLogger, new_logger, received};

/// A logger that does not answer for so long is not there.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(5);
/// A line that takes no bytes for so long is dead.
const SEND_TIMEOUT: Duration = Duration::from_secs(30);

/// A logger that has nothing to do looks at its session so often.
const TURN: Duration = Duration::from_millis(200);

/// The base station's end.
pub struct Tcp {
    line: TcpStream,
}

impl Tcp {
    /// Connects to a logger that listens at `address`, HOST:PORT.
    pub fn connect(address: &str) -> Result<Self> {
        let places = address
            .to_socket_addrs()
            .with_context(|| format!("{address} is no address HOST:PORT"))?;
        let mut last = anyhow!("{address} is no address HOST:PORT");
        for place in places {
            match TcpStream::connect_timeout(&place, CONNECT_TIMEOUT) {
                Ok(line) => {
                    line.set_nodelay(true)?;
                    line.set_write_timeout(Some(SEND_TIMEOUT))?;
                    return Ok(Self { line });
                }
                Err(error) => last = anyhow!("no logger answers at {address} ({error}); is it listening there?"),
            }
        }
        Err(last)
    }
}

impl Channel for Tcp {
    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.line.write_all(bytes)
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        // A timeout of zero would mean none at all.
        self.line
            .set_read_timeout(Some(timeout.max(Duration::from_millis(1))))?;
        received(self.line.read(buffer))
    }
}

/// Runs a logger on this PC for everyone who connects to `listener`, one after the other, as a device on a line would:
/// it keeps its state from one to the next. Ends when accepting fails.
pub fn serve(listener: &TcpListener) -> io::Result<()> {
    let mut logger = new_logger();
    let board = PcBoard::new();
    loop {
        let (mut line, _) = listener.accept()?;
        line.set_nodelay(true)?;
        // A base station that is gone is no reason for a logger to stop.
        let _ = attend(&mut line, &mut logger, &board);
    }
}

fn attend(line: &mut TcpStream, logger: &mut PcLogger, board: &PcBoard) -> io::Result<()> {
    let mut buffer = [0; 4096];
    let mut reply = line.try_clone()?;
    let mut lost = Ok(());
    let mut board = board.sending(|bytes| {
        if lost.is_ok() {
            lost = reply.write_all(bytes);
        }
    });
    let mut more = false;
    loop {
        line.set_nonblocking(more)?;
        // The session has its own times to keep.
        line.set_read_timeout(Some(TURN))?;
        match received(line.read(&mut buffer))? {
            0 => {}
            count => {
                // The two ends share this setting: an answer must not be cut off because the line is full.
                line.set_nonblocking(false)?;
                logger.receive(&buffer[..count], &mut board);
            }
        }
        line.set_nonblocking(false)?;
        more = logger.poll(&mut board);
    }
}
