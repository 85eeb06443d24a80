//! Ways to a logger, as bytes that go and come: in this process, over TCP, over a serial device, in QEMU.

pub mod in_process;
pub mod pc;
pub mod qemu;
pub mod serial;
pub mod tcp;

use std::io;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::Duration;

use anyhow::Result;
use spanwatch::session::Device;

pub use in_process::InProcess;
pub use qemu::Qemu;
pub use serial::Serial;
pub use tcp::{Console, Tcp};

/// Bytes to and from a logger.
pub trait Channel: Send {
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
    /// A logger through the base station that takes orders at this address.
    Station(String, Device),
}

impl FromStr for Via {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text.split_once(':') {
            None if text == "inproc" => Ok(Self::InProcess),
            None if text == "qemu" => Ok(Self::Qemu),
            Some(("tcp", address)) if address.contains(':') => Ok(Self::Tcp(address.to_owned())),
            Some(("station", place)) if let Some((address, logger)) = place.split_once('/') => {
                let logger = logger
                    .parse()
                    .map_err(|_| format!("{logger} is no number of a logger"))?;
                Ok(Self::Station(address.to_owned(), logger))
            }
            Some(("serial", device)) if !device.is_empty() => Ok(Self::Serial(device.into())),
            _ => Err(
                "a logger is reached by inproc, qemu, tcp:HOST:PORT, serial:DEVICE or station:HOST:PORT/LOGGER"
                    .to_owned(),
            ),
        }
    }
}

/// Where the firmware image is and what is shown of it, for [`Via::Qemu`].
#[derive(Debug, Clone)]
pub struct QemuOptions {
    /// The image.
    pub image: PathBuf,
    /// File that its flash lies in, which outlives it; none: one of its own.
    pub flash: Option<PathBuf>,
    /// Print the logger's own log to standard error.
    pub show_log: bool,
}

impl QemuOptions {
    /// Starts it.
    pub fn start(&self) -> Result<Qemu> {
        match &self.flash {
            Some(flash) => Qemu::start_on(&self.image, flash, false, self.show_log),
            None => Qemu::start(&self.image, false, self.show_log),
        }
    }
}

impl Default for QemuOptions {
    fn default() -> Self {
        Self {
            image: built_image("logger"),
            flash: None,
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
        Via::Qemu => Box::new(qemu.start()?),
        Via::Tcp(address) => Box::new(Tcp::connect(address)?),
        Via::Serial(device) => Box::new(Serial::open(device)?),
        Via::Station(address, logger) => Box::new(Console::connect(address, *logger)?),
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
