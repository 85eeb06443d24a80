//! Ways to a logger, as bytes that go and come: in this process, over TCP, over a serial device, in QEMU.

pub mod in_process;
pub mod qemu;
pub mod serial;
pub mod tcp;

use std::io;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::{Duration, Instant};

use anyhow::Result;
use spanwatch::link::{Identity, RemoteLogger};

use crate::campaign::power::TEARS;
use crate::flash::SimulatedFlash;

pub use in_process::InProcess;
pub use qemu::Qemu;
pub use serial::Serial;
pub use tcp::Tcp;

/// Bytes to and from a logger.
pub trait Channel {
    /// Sends all of `bytes`.
    fn send(&mut self, bytes: &[u8]) -> io::Result<()>;
    /// Waits for bytes; how many were written to `buffer`, 0 after the timeout.
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize>;
}

/// The way to a logger, as the user names it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Via {
    /// A logger in this process.
    InProcess,
    /// The firmware image in QEMU.
    Qemu,
    /// A logger that listens at this address.
    Tcp(String),
    /// A logger on this serial device.
    Serial(PathBuf),
}

impl FromStr for Via {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text.split_once(':') {
            None if text == "inproc" => Ok(Self::InProcess),
            None if text == "qemu" => Ok(Self::Qemu),
            Some(("tcp", address)) if address.contains(':') => Ok(Self::Tcp(address.to_owned())),
            Some(("serial", device)) if !device.is_empty() => Ok(Self::Serial(device.into())),
            _ => Err("a logger is reached by inproc, qemu, tcp:HOST:PORT or serial:DEVICE".to_owned()),
        }
    }
}

/// Where the firmware image is and what is shown of it, for [`Via::Qemu`].
#[derive(Debug, Clone)]
pub struct QemuOptions {
    /// The image.
    pub image: PathBuf,
    /// Print the logger's own log to standard error.
    pub show_log: bool,
}

impl Default for QemuOptions {
    fn default() -> Self {
        Self {
            image: built_image("logger"),
            show_log: false,
        }
    }
}

/// Where `tests/build-firmware.sh` leaves the image of that name: in the folder that this program was built in, or else in
/// `target`.
pub fn built_image(name: &str) -> PathBuf {
    let image = Path::new("thumbv7em-none-eabihf/firmware").join(name);
    let program = std::env::current_exe().unwrap_or_default();
    let beside = program
        .ancestors()
        .map(|folder| folder.join(&image))
        .find(|path| path.exists());
    beside.unwrap_or_else(|| {
        let target = std::env::var_os("CARGO_TARGET_DIR").unwrap_or_else(|| "target".into());
        PathBuf::from(target).join(image)
    })
}

/// Opens the way to a logger.
pub fn open(via: &Via, qemu: &QemuOptions) -> Result<Box<dyn Channel>> {
    Ok(match via {
        Via::InProcess => Box::new(InProcess::new()),
        Via::Qemu => Box::new(Qemu::start(&qemu.image, false, qemu.show_log)?),
        Via::Tcp(address) => Box::new(Tcp::connect(address)?),
        Via::Serial(device) => Box::new(Serial::open(device)?),
    })
}

/// What a read gave: nothing after the timeout, an error if the other end is gone.
fn received(read: io::Result<usize>) -> io::Result<usize> {
    match read {
        Ok(0) => Err(io::Error::new(
            io::ErrorKind::ConnectionAborted,
            "the logger has closed the line",
        )),
        Err(error)
            if matches!(
                error.kind(),
                io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut | io::ErrorKind::Interrupted
            ) =>
        {
            Ok(0)
        }
        other => other,
    }
}

/// A logger on a PC, its outbox in memory.
type PcLogger = RemoteLogger<SimulatedFlash<4, 4096>>;
/// Pages of its flash, as many as the board's.
const PAGES: usize = 16;

/// A logger that has just been switched on, with the key that everybody knows.
fn new_logger() -> Box<PcLogger> {
    let mut logger = Box::new(PcLogger::new());
    let flash = SimulatedFlash::new(PAGES, TEARS[0], 0);
    logger
        .open(flash, Identity::DEMO)
        .expect("a flash in memory does not fail");
    logger
}

/// A board for a logger on a PC: no stack to watch, no clock of the processor.
struct PcBoard {
    start: Instant,
}

impl PcBoard {
    fn new() -> Self {
        Self { start: Instant::now() }
    }

    /// The board with a line whose bytes go wherever `send` puts them.
    fn sending<F: FnMut(&[u8])>(&self, send: F) -> PcLine<F> {
        PcLine {
            start: self.start,
            send,
        }
    }
}

struct PcLine<F: FnMut(&[u8])> {
    start: Instant,
    send: F,
}

impl<F: FnMut(&[u8])> spanwatch::link::Board for PcLine<F> {
    fn send(&mut self, bytes: &[u8]) {
        (self.send)(bytes);
    }

    fn ticks(&mut self) -> u64 {
        0
    }

    fn now_ms(&mut self) -> u64 {
        self.start.elapsed().as_millis() as u64
    }

    fn health(&mut self) -> spanwatch::wire::message::Health {
        spanwatch::wire::message::Health::default()
    }
}
