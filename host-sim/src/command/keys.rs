//! `host-sim keys`: the keys of loggers, and how they get onto them.

use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use clap::{Args, Subcommand};
use host_sim::channel::Via;
use host_sim::channel::pc::PcFlash;
use host_sim::keys::{DEFAULT_FILE, KeyFile};
use spanwatch::session::Device;
use spanwatch::settings::Settings;

use super::reach::Reach;

#[derive(Debug, Subcommand)]
pub(super) enum Command {
    /// Make a key for a logger; it is used once it is on it
    New(New),
    /// List the loggers and the numbers of their keys
    List(File),
    /// Write a logger's newest key into its flash, on the bench
    Install(Install),
    /// Make another key and give it to the logger over its line, sealed by the one that it has
    Rotate(Rotate),
    /// Take a key out: a logger that still has it is not heard any more
    Remove(Remove),
    /// Make the key of those who give orders through a running base station
    Console(File),
}

#[derive(Debug, Args)]
pub(super) struct File {
    /// File of the keys
    #[arg(long = "keys", default_value = DEFAULT_FILE, value_name = "FILE")]
    file: PathBuf,
}

#[derive(Debug, Args)]
pub(super) struct New {
    #[command(flatten)]
    keys: File,
    /// Number of the logger, from 1
    #[arg(long, value_parser = clap::value_parser!(Device).range(1..))]
    logger: Device,
    /// What it is called, as "Viaduct 12"
    #[arg(long)]
    name: Option<String>,
}

#[derive(Debug, Args)]
pub(super) struct Install {
    #[command(flatten)]
    keys: File,
    /// Number of the logger
    #[arg(long)]
    logger: Device,
    /// The logger's flash as a file: QEMU's, or one that a programmer writes to the board
    #[arg(long, value_name = "FILE")]
    flash: PathBuf,
}

#[derive(Debug, Args)]
pub(super) struct Rotate {
    #[command(flatten)]
    reach: Reach,
    /// Number of the logger
    #[arg(long)]
    logger: Device,
}

#[derive(Debug, Args)]
pub(super) struct Remove {
    #[command(flatten)]
    keys: File,
    /// Number of the logger
    #[arg(long)]
    logger: Device,
    /// Number of the key
    #[arg(long)]
    number: u8,
    /// Also if it is the newest: the logger, or the key, is lost
    #[arg(long)]
    lost: bool,
}

pub(super) fn run(command: &Command) -> Result<()> {
    match command {
        Command::New(arguments) => {
            let file = KeyFile::at(&arguments.keys.file);
            let identity = file.add(arguments.logger, arguments.name.clone())?;
            super::print(&format!(
                "Logger {} has key {} in {}; keep that file secret. `host-sim keys install` puts the key onto the logger on the bench, \
                 `host-sim keys rotate` over a line that has a key already.\n",
                identity.device,
                identity.key_number,
                file.path().display()
            ))
        }
        Command::List(keys) => {
            let ring = KeyFile::at(&keys.file).ring()?;
            if ring.is_demo() {
                return super::print(&format!(
                    "There is no file {}: every logger is expected to have the demo key, which everybody knows.\n",
                    keys.file.display()
                ));
            }
            for (device, name, numbers) in ring.loggers() {
                let numbers: Vec<String> = numbers.iter().map(u8::to_string).collect();
                super::print(&format!(
                    "logger {device}{}: keys {}\n",
                    name.map_or(String::new(), |name| format!(" ({name})")),
                    numbers.join(", ")
                ))?;
            }
            super::print(match ring.console_is_open() {
                true => "console: no key of its own\n",
                false => "console: has a key\n",
            })
        }
        Command::Install(arguments) => {
            let ring = KeyFile::at(&arguments.keys.file).ring()?;
            let Some(identity) = ring.newest(arguments.logger) else {
                bail!(
                    "{} has no key of logger {}; make one first (host-sim keys new)",
                    arguments.keys.file.display(),
                    arguments.logger
                );
            };
            let [_, settings] = PcFlash::in_file(&arguments.flash)?;
            Settings::new(settings)
                .set_identity(&identity)
                .with_context(|| format!("cannot write the key into {}", arguments.flash.display()))?;
            super::print(&format!(
                "Logger {}, key {}: written into {}.\n",
                identity.device,
                identity.key_number,
                arguments.flash.display()
            ))
        }
        Command::Rotate(arguments) => {
            if let Via::Station(_, logger) = arguments.reach.via
                && logger != arguments.logger
            {
                bail!("--via names logger {logger}, and --logger {}", arguments.logger);
            }
            let mut station = arguments.reach.station()?;
            // Nothing is made for a logger that is not there.
            station.status()?;
            let file = arguments.reach.key_file();
            let identity = file.add(arguments.logger, None)?;
            station.replace_identity(&identity).with_context(|| {
                format!(
                    "key {} is in the file, and perhaps not on the logger",
                    identity.key_number
                )
            })?;
            super::print(&format!(
                "Logger {} uses key {} now. `host-sim keys remove` takes the earlier ones out.\n",
                identity.device, identity.key_number
            ))
        }
        Command::Remove(arguments) => {
            let file = KeyFile::at(&arguments.keys.file);
            file.remove(arguments.logger, arguments.number, arguments.lost)?;
            super::print(&format!(
                "Key {} of logger {} is taken out of {}.\n",
                arguments.number,
                arguments.logger,
                file.path().display()
            ))
        }
        Command::Console(keys) => {
            KeyFile::at(&keys.file).add_console()?;
            super::print(&format!("The console has a key in {}.\n", keys.file.display()))
        }
    }
}
