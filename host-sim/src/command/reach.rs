//! How a command reaches a logger, and by which keys.

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use host_sim::channel::{self, QemuOptions, Via};
use host_sim::keys::{DEFAULT_FILE, KeyFile, KeyRing};
use host_sim::station::Station;

#[derive(Debug, Args)]
pub(super) struct Reach {
    /// The logger: inproc (in this program), qemu (the firmware image), tcp:HOST:PORT, serial:DEVICE, or station:HOST:PORT/LOGGER (through
    /// the base station that takes orders there)
    #[arg(long, default_value = "inproc", value_name = "WAY")]
    pub(super) via: Via,
    /// File of the loggers' keys (host-sim keys); if it is not there, loggers are expected to have the demo key
    #[arg(long, default_value = DEFAULT_FILE, value_name = "FILE")]
    keys: PathBuf,
    #[command(flatten)]
    image: Image,
}

/// The firmware image in QEMU.
#[derive(Debug, Args)]
pub(super) struct Image {
    /// Firmware image for QEMU [default: target/thumbv7em-none-eabihf/firmware/logger]
    #[arg(long, value_name = "FILE")]
    image: Option<PathBuf>,
    /// File that the logger's flash lies in, so that it outlives the logger; made if it is not there
    #[arg(long, value_name = "FILE")]
    pub(super) flash: Option<PathBuf>,
    /// Print the image's own log to standard error
    #[arg(long)]
    log: bool,
}

impl Image {
    pub(super) fn options(&self) -> QemuOptions {
        let mut options = QemuOptions {
            show_log: self.log,
            flash: self.flash.clone(),
            ..QemuOptions::default()
        };
        if let Some(image) = &self.image {
            options.image.clone_from(image);
        }
        options
    }
}

impl Reach {
    /// The file of keys.
    pub(super) fn key_file(&self) -> KeyFile {
        KeyFile::at(&self.keys)
    }

    /// Whether a base station has the line, and stores what comes.
    pub(super) fn by_station(&self) -> bool {
        matches!(self.via, Via::Station(..))
    }

    /// Opens the way to the logger.
    pub(super) fn station(&self) -> Result<Station> {
        let keys = match &self.via {
            // Nobody can have given these a key.
            Via::InProcess => KeyRing::demo(),
            Via::Qemu if self.image.flash.is_none() => KeyRing::demo(),
            Via::Station(..) => self.key_file().ring()?.for_console(),
            _ => self.key_file().ring()?,
        };
        Ok(Station::with_keys(
            channel::open(&self.via, &self.image.options())?,
            keys,
        ))
    }
}
