//! The command line: one module a command.
//!
//! A new command is a variant of [`Command`], a line in [`dispatch`] and a module here with its `Arguments` and `run`.
//! `run` returns an error that reads as one sentence once its causes are joined by colons; it ends the program with exit
//! code [`BAD_INPUT`], as wrong flags do.

mod base_station;
mod calibrate;
mod demo;
mod demo_track;
mod evaluate;
mod evaluate_link;
mod evaluate_track;
mod identify;
mod keys;
mod logger;
mod measure;
mod model;
mod predict;
mod query;
mod reach;
mod replay;
mod setup;
mod show_frame;
mod simulate;
mod track;
mod validate;

use std::io::{ErrorKind, Write};
use std::process::ExitCode;

use anyhow::{Context, Result};
use clap::{Parser, Subcommand, ValueEnum};
use host_sim::terminal;

/// Exit code of everything that went wrong; clap uses the same for wrong flags.
const BAD_INPUT: u8 = 2;

/// Tells damage of railway viaducts from the vibration under passing trains: bridge models, simulated and recorded
/// passages, the logger on this computer or on a line, the base station.
#[derive(Debug, Parser)]
#[command(name = "host-sim", version, arg_required_else_help = true)]
struct CommandLine {
    #[command(subcommand)]
    command: Command,
    /// Show how far long work is
    #[arg(long, global = true, value_enum, default_value_t = Progress::Auto, value_name = "WHEN", display_order = 1000)]
    progress: Progress,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Progress {
    /// On a terminal
    Auto,
    /// Never
    Never,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Show the whole way once, with nothing to prepare
    Demo(demo::Arguments),
    /// Simulate a passage and write it as a recording
    Simulate(simulate::Arguments),
    /// Find the damage that explains a recording
    Identify(identify::Arguments),
    /// Send recordings through a logger, print and store what it reports
    Replay(replay::Arguments),
    /// Learn the rails' profile from recordings of healthy passages
    Calibrate(calibrate::Arguments),
    /// Search the paper's cases again, and make the figures again that choices and claims rest on
    #[command(subcommand)]
    Evaluate(evaluate::Command),
    /// Predict what a real bridge would do under a train, with pictures and tables of values
    #[command(subcommand)]
    Predict(predict::Command),
    /// Run a logger on this computer, or the firmware image in QEMU, on a TCP line
    Logger(logger::Arguments),
    /// Attend to many loggers at once, store what they say, take orders for them
    BaseStation(base_station::Arguments),
    /// Ask what the base station has stored
    Query(query::Arguments),
    /// Make the loggers' keys, and give them to them
    #[command(subcommand)]
    Keys(keys::Command),
    /// Give a logger what it keeps over a restart and watches with, or read it back
    #[command(subcommand)]
    Setup(setup::Command),
    /// Measure the firmware image: bytes, and instructions counted in QEMU
    Measure(measure::Arguments),
    /// Build the logger's bridge model, or look into one
    #[command(subcommand)]
    Model(model::Command),
    /// Make the irregularity of a track by chance, or look into one
    #[command(subcommand)]
    Track(track::Command),
    /// Compute the validation chapter: closed forms, others' numbers, what mechanics demands
    Validate(validate::Arguments),
}

fn dispatch(command: Command) -> Result<()> {
    match command {
        Command::Simulate(arguments) => simulate::run(&arguments),
        Command::Demo(arguments) => demo::run(&arguments),
        Command::Identify(arguments) => identify::run(&arguments),
        Command::Replay(arguments) => replay::run(&arguments),
        Command::Calibrate(arguments) => calibrate::run(&arguments),
        Command::Evaluate(command) => evaluate::run(&command),
        Command::Predict(command) => predict::run(&command),
        Command::Logger(arguments) => logger::run(&arguments),
        Command::BaseStation(arguments) => base_station::run(&arguments),
        Command::Query(arguments) => query::run(&arguments),
        Command::Keys(command) => keys::run(&command),
        Command::Setup(command) => setup::run(&command),
        Command::Measure(arguments) => measure::run(&arguments),
        Command::Model(command) => model::run(&command),
        Command::Track(command) => track::run(&command),
        Command::Validate(arguments) => validate::run(&arguments),
    }
}

/// Reads the command line and does what it says.
pub fn run() -> ExitCode {
    let line = CommandLine::parse();
    terminal::show_progress(line.progress == Progress::Auto);
    match dispatch(line.command) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            let label = if terminal::colours_on_stderr() {
                "\x1b[1;31merror:\x1b[0m"
            } else {
                "error:"
            };
            eprintln!("{label} {error:#}");
            ExitCode::from(BAD_INPUT)
        }
    }
}

/// Prints a result. A reader that has seen enough (`| head`) is no error.
fn print(text: &str) -> Result<()> {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(error).context("cannot print the result"),
        _ => Ok(()),
    }
}

/// Prints one JSON object on a line of its own.
fn print_json(value: &serde_json::Value) -> Result<()> {
    print(&format!("{value}\n"))
}

/// Numbers of the elements, from 1, whose bit is set.
fn certain_elements(bits: u16) -> Vec<u32> {
    (0..u16::BITS).filter(|e| bits >> e & 1 == 1).map(|e| e + 1).collect()
}
