//! `host-sim logger`: a logger on this computer, on a TCP line, for trying a base station without a board.

use std::net::TcpListener;

use anyhow::{Context, Result};
use clap::Args;
use host_sim::channel::tcp;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Address to listen at
    #[arg(long, default_value = "127.0.0.1:4950", value_name = "HOST:PORT")]
    listen: String,
}

pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let listener =
        TcpListener::bind(&arguments.listen).with_context(|| format!("cannot listen at {}", arguments.listen))?;
    super::print(&format!(
        "a logger listens at {}; end it with Ctrl-C\n",
        listener.local_addr()?
    ))?;
    tcp::serve(&listener).context("the logger cannot go on listening")
}
