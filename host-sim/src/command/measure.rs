//! `host-sim measure`: what the firmware image costs, in bytes and in instructions.

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use host_sim::channel::{self, Qemu};
use host_sim::cost::{self, INSTRUCTIONS_PER_TICK};
use host_sim::image::{self, Sizes};
use host_sim::model;
use host_sim::replay::{self, Told};
use host_sim::station::Station;
use spanwatch::wire::message::Event;
use spanwatch::wire::{FrameBuffer, Kind};

/// The processor that the times are given for, Hz: a common Cortex-M4F, one instruction a clock.
const PROCESSOR_HZ: f64 = 168e6;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Recordings to measure with
    #[arg(required = true, value_name = "REC.csv")]
    recordings: Vec<PathBuf>,
    /// Firmware image [default: target/thumbv7em-none-eabihf/firmware/logger]
    #[arg(long, value_name = "FILE")]
    image: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let image = arguments
        .image
        .clone()
        .unwrap_or_else(|| channel::built_image("logger"));
    let prepared = arguments
        .recordings
        .iter()
        .map(|path| replay::prepare(path, None, replay::DEFAULT_SEED))
        .collect::<Result<Vec<_>>>()?;
    let sizes = Sizes::of(&image)?;
    let mut text = format!(
        "| image | bytes |\n|---|---|\n\
         | flash: text {} + data {} | {} |\n\
         | RAM: data {} + bss {} + stack {} reserved | {} |\n\
         | of it the logger with its passage, model and search | {} |\n",
        sizes.text,
        sizes.data,
        sizes.flash(),
        sizes.data,
        sizes.bss,
        sizes.stack,
        sizes.ram() + sizes.stack,
        sizes.logger
    );
    if let Some(bridge) = prepared.iter().find_map(|prepared| prepared.bridge.as_ref()) {
        text += &format!(
            "| bridge model {}, as it is sent | {} |\n",
            bridge.name,
            model::to_blob(bridge)?.len()
        );
    }
    let panicking = image::panicking(&image)?;
    text += &match panicking.as_slice() {
        [] => "\nNothing in the image can panic.\n".to_owned(),
        found => format!("\nThe image can panic, by {}.\n", found.join(", ")),
    };
    text += "\n| an alert's frame | bytes | instructions to write it | instructions to read it |\n|---|---|---|---|\n";
    for (name, frame) in ["sealed", "in the clear"].into_iter().zip(cost::of_an_alert()?) {
        text += &format!("| {name} | {} | {} | {} |\n", frame.bytes, frame.write, frame.read);
    }
    text += "\n| recording | samples | solver steps | instructions a sample | instructions a step | longest slice, \
             million instructions | whole identification at 168 MHz, s | stack, bytes | alert frame, bytes |\n|---|---|---|---|---|---|---|---|---|\n";
    for prepared in &prepared {
        // A fresh start for each, so that the stack's peak is its own.
        let mut station = Station::new(Box::new(Qemu::start(&image, true, false)?));
        let mut alert_bytes = None;
        let status = prepared.replay(&mut station, None, None, |told| {
            if let Told::Alert { alert, .. } = told {
                let mut frame = FrameBuffer::new();
                alert_bytes = frame
                    .write(Kind::Event, 1, &Event::Alert(alert.clone()))
                    .ok()
                    .map(<[u8]>::len);
            }
            Ok(())
        })?;
        let effort = status.effort;
        let instructions = |ticks: u64| ticks * INSTRUCTIONS_PER_TICK;
        text += &format!(
            "| {} | {} | {} | {} | {} | {:.1} | {:.1} | {} | {} |\n",
            prepared.path.file_stem().unwrap_or_default().display(),
            status.samples,
            effort.solver_steps,
            instructions(effort.stream_ticks) / status.samples.max(1),
            instructions(effort.identification_ticks) / effort.solver_steps.max(1),
            instructions(effort.longest_slice_ticks) as f64 / 1e6,
            instructions(effort.identification_ticks) as f64 / PROCESSOR_HZ,
            status.health.stack_peak_bytes,
            alert_bytes.map_or("no alert".to_owned(), |bytes| bytes.to_string())
        );
    }
    super::print(&text)
}
