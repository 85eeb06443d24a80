//! `host-sim`: the PC side of Spanwatch, a command for each thing it does.

mod command;

use std::process::ExitCode;

fn main() -> ExitCode {
    command::run()
}
