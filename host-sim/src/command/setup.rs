//! `host-sim setup`: what a logger keeps over a restart and watches with.

use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use clap::{Args, Subcommand};
use host_sim::{calibrate, model, output, replay};
use spanwatch::link::CONFIGURATION_BYTES;
use spanwatch::settings::Part;
use spanwatch::wire::message::Configuration;

use super::reach::Reach;

#[derive(Debug, Subcommand)]
pub(super) enum Command {
    /// Give a logger bridge model, configuration and learnt track to keep; it starts with them from then on
    Write(Write),
    /// Read back what a logger keeps, into files
    Read(Read),
    /// Let a logger forget what all passages say of the bridge, as after a repair
    Clear(Reach),
    /// Let a logger start again
    Restart(Reach),
}

#[derive(Debug, Args)]
pub(super) struct Write {
    #[command(flatten)]
    reach: Reach,
    /// A recording of the bridge: its TOML names bridge, channels and train. What it says of one run, speed and entry time, is left out
    #[arg(long, value_name = "REC.csv")]
    like: PathBuf,
    /// The bridge, where it is not the one that the recording names: a name or a bridge file NAME.toml
    #[arg(long)]
    bridge: Option<String>,
    /// A track that was learnt (host-sim calibrate)
    #[arg(long, value_name = "FILE.blob")]
    track: Option<PathBuf>,
    /// Seed of the logger's search
    #[arg(long, default_value_t = replay::DEFAULT_SEED)]
    seed: u64,
}

#[derive(Debug, Args)]
pub(super) struct Read {
    #[command(flatten)]
    reach: Reach,
    /// Folder for bridge.blob, track.blob and configuration.json
    #[arg(long, short, value_name = "DIR")]
    out: PathBuf,
}

pub(super) fn run(command: &Command) -> Result<()> {
    match command {
        Command::Write(arguments) => write(arguments),
        Command::Read(arguments) => read(arguments),
        Command::Clear(reach) => {
            reach.station()?.clear()?;
            super::print("The logger has forgotten what the passages said of the bridge.\n")
        }
        Command::Restart(reach) => {
            let mut station = reach.station()?;
            station.restart()?;
            let setup = station.status()?.setup;
            super::print(&format!(
                "The logger has started again, with setup {}.\n",
                setup.generation
            ))
        }
    }
}

fn write(arguments: &Write) -> Result<()> {
    let mut prepared = replay::prepare(&arguments.like, arguments.bridge.as_deref(), arguments.seed)?;
    let track = match &arguments.track {
        Some(path) => {
            prepared.loosen();
            if let Some(bridge) = &prepared.bridge {
                calibrate::read(path, bridge)?;
            }
            Some(std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?)
        }
        None => {
            prepared.refuse_irregular()?;
            None
        }
    };
    let Some(bridge) = &prepared.bridge else {
        bail!("{} names no bridge; give one (--bridge)", arguments.like.display());
    };
    let configuration = prepared.watching();
    let mut station = arguments.reach.station()?;
    // A logger that is not there is told by this.
    station.status()?;
    let kept = (|| {
        station.begin_setup()?;
        station.load(bridge)?;
        if let Some(track) = &track {
            station.load_track(track)?;
        }
        station.configure(&configuration)?;
        station.keep_setup()
    })();
    if let Err(error) = kept {
        // Where there is none, the error that matters is the first.
        let _ = station.reload_setup();
        return Err(error.context("the logger keeps the setup that it had"));
    }
    let read_back = [
        (Part::Model, Some(model::to_blob(bridge)?)),
        (Part::Track, track),
        (
            Part::Configuration,
            Some(postcard::to_slice(&configuration, &mut [0; CONFIGURATION_BYTES])?.to_vec()),
        ),
    ];
    for (part, sent) in read_back {
        if station.setup(part)? != sent.unwrap_or_default() {
            bail!("the logger keeps another {part:?} than it was given; write it again");
        }
    }
    let setup = station.status()?.setup;
    super::print(&format!(
        "The logger keeps setup {}, read back and found the same; it starts with it.\n",
        setup.generation
    ))
}

fn read(arguments: &Read) -> Result<()> {
    let mut station = arguments.reach.station()?;
    let setup = station.status()?.setup;
    if setup.generation == 0 {
        bail!("the logger keeps no setup (host-sim setup write)");
    }
    std::fs::create_dir_all(&arguments.out)
        .with_context(|| format!("cannot make the folder {}", arguments.out.display()))?;
    let (model, track) = (station.setup(Part::Model)?, station.setup(Part::Track)?);
    let configuration: Configuration = postcard::from_bytes(&station.setup(Part::Configuration)?)
        .context("the logger's configuration is of another version of the program")?;
    let configuration = serde_json::to_vec_pretty(&configuration)?;
    let paths = ["bridge.blob", "track.blob", "configuration.json"].map(|name| arguments.out.join(name));
    let files = paths.iter().zip([model, track, configuration]);
    for (path, bytes) in files.filter(|(_, bytes)| !bytes.is_empty()) {
        output::write(&[(path, &bytes)])?;
    }
    let rolled_back = match setup.rolled_back {
        true => " It was rolled back to: the newer one was refused at the start.",
        false => "",
    };
    super::print(&format!(
        "Setup {} is in {}.{rolled_back}\n",
        setup.generation,
        arguments.out.display()
    ))
}
