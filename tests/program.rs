//! The program as a user runs it, for the tests that need it.

use std::path::Path;
use std::process::{Command, Output};

/// Runs `host-sim` in a folder.
pub fn host_sim(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_host-sim"))
        .current_dir(folder)
        .args(arguments)
        .output()
        .expect("host-sim runs")
}
