//! A logger on a TCP line: the base station's end, and a logger on this PC for the other.

use std::io::{self, Read, Write};
use std::net::{TcpListener, TcpStream, ToSocketAddrs};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow};
use spanwatch::session::Device;

use super::pc::PcLogger;
use super::{Channel, received};

/// A logger that does not answer for so long is not there.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(5);
/// A line that takes no bytes for so long is dead.
const SEND_TIMEOUT: Duration = Duration::from_secs(30);

/// A logger that has nothing to do looks at its session so often.
const TURN: Duration = Duration::from_millis(200);
/// A logger whose line is gone opens another after this time.
const RECONNECT: Duration = Duration::from_secs(1);
/// A base station that is started again is there within this time.
const RESTART_TIMEOUT: Duration = Duration::from_secs(60);
/// Each direction of a relay is looked at so often.
const RELAY_TURN: Duration = Duration::from_millis(1);
/// A relay tries to connect so often.
const RELAY_RECONNECT: Duration = Duration::from_millis(100);

/// The base station's end.
pub struct Tcp {
    line: TcpStream,
}

impl Tcp {
    /// The base station's end of a connection.
    pub fn new(line: TcpStream) -> Result<Self> {
        line.set_nodelay(true)?;
        line.set_write_timeout(Some(SEND_TIMEOUT))?;
        Ok(Self { line })
    }

    /// Connects to a logger that listens at `address`, HOST:PORT.
    pub fn connect(address: &str) -> Result<Self> {
        let places = address
            .to_socket_addrs()
            .with_context(|| format!("{address} is no address HOST:PORT"))?;
        let mut last = anyhow!("{address} is no address HOST:PORT");
        for place in places {
            match TcpStream::connect_timeout(&place, CONNECT_TIMEOUT) {
                Ok(line) => return Self::new(line),
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

/// The end of one who gives a logger orders through a base station, which may be started again meanwhile.
pub struct Console {
    address: String,
    logger: Device,
    line: Tcp,
}

impl Console {
    /// Connects to the base station that takes orders at `address`, HOST:PORT.
    pub fn connect(address: &str, logger: Device) -> Result<Self> {
        let mut line = Tcp::connect(address)?;
        line.send(format!("{logger}\n").as_bytes())?;
        Ok(Self {
            address: address.to_owned(),
            logger,
            line,
        })
    }

    /// Connects once more, for a minute.
    fn again(&mut self, lost: io::Error) -> io::Result<()> {
        let deadline = Instant::now() + RESTART_TIMEOUT;
        while Instant::now() < deadline {
            std::thread::sleep(RECONNECT);
            if let Ok(new) = Self::connect(&self.address, self.logger) {
                *self = new;
                return Ok(());
            }
        }
        Err(lost)
    }
}

impl Channel for Console {
    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        // What was to be said belonged to the session that is over.
        self.line.send(bytes).or_else(|lost| self.again(lost))
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        self.line
            .receive(buffer, timeout)
            .or_else(|lost| self.again(lost).map(|()| 0))
    }
}

/// Carries bytes between a logger and the base station at `address`, and connects again whenever that is lost, until it is to `stop` or the
/// logger has ended. `mangle` makes of each piece what the line makes of it.
pub fn relay(
    logger: &mut dyn Channel,
    address: &str,
    mangle: &mut dyn FnMut(&[u8]) -> Vec<u8>,
    stop: &AtomicBool,
) -> io::Result<()> {
    let mut buffer = [0; 4096];
    while !stop.load(Ordering::Relaxed) {
        let Ok(mut station) = Tcp::connect(address) else {
            // What the logger says to nobody is lost, as on a line that is cut.
            logger.receive(&mut buffer, RELAY_TURN)?;
            std::thread::sleep(RELAY_RECONNECT);
            continue;
        };
        while !stop.load(Ordering::Relaxed) {
            let count = logger.receive(&mut buffer, RELAY_TURN)?;
            if count > 0 && station.send(&mangle(&buffer[..count])).is_err() {
                break;
            }
            match station.receive(&mut buffer, RELAY_TURN) {
                Ok(0) => {}
                Ok(count) => logger.send(&mangle(&buffer[..count]))?,
                Err(_) => break,
            }
        }
    }
    Ok(())
}

/// Runs `logger` for everyone who connects to `listener`, one after the other, as a device on a line would: it keeps its state from one to
/// the next. Ends when accepting fails.
pub fn serve(listener: &TcpListener, logger: &mut PcLogger) -> io::Result<()> {
    loop {
        let (mut line, _) = listener.accept()?;
        line.set_nodelay(true)?;
        // A base station that is gone is no reason for a logger to stop.
        let _ = attend(&mut line, logger);
    }
}

/// Runs `logger` on a line that it opens itself, to the base station at `address`, and again whenever that is lost.
pub fn call(address: &str, logger: &mut PcLogger) -> ! {
    loop {
        let line = TcpStream::connect(address);
        let _ = line.and_then(|mut line| {
            line.set_nodelay(true)?;
            attend(&mut line, logger)
        });
        std::thread::sleep(RECONNECT);
    }
}

fn attend(line: &mut TcpStream, logger: &mut PcLogger) -> io::Result<()> {
    let mut buffer = [0; 4096];
    let mut reply = line.try_clone()?;
    let mut lost = Ok(());
    let mut send = |bytes: &[u8]| {
        if lost.is_ok() {
            lost = reply.write_all(bytes);
        }
    };
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
                logger.receive(&buffer[..count], &mut send);
            }
        }
        line.set_nonblocking(false)?;
        more = logger.poll(&mut send);
    }
}
