//! `host-sim logger`: a logger on this computer, or the firmware image in QEMU, on a TCP line, for trying a base station without a board.

use std::sync::atomic::AtomicBool;

use anyhow::{Context, Result};
use clap::Args;
use host_sim::channel::pc::{PcFlash, PcLogger};
use host_sim::channel::{Channel, tcp};
use host_sim::station::base;

use super::reach::Image;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Address to listen at
    #[arg(long, default_value = "127.0.0.1:4950", value_name = "HOST:PORT")]
    listen: String,
    /// Base station to connect to, in place of listening
    #[arg(long, value_name = "HOST:PORT", conflicts_with = "listen")]
    connect: Option<String>,
    /// Run the firmware image in QEMU in place of a logger in this program
    #[arg(long, requires = "connect")]
    qemu: bool,
    #[command(flatten)]
    image: Image,
}

pub(super) fn run(arguments: &Arguments) -> Result<()> {
    if let Some(address) = &arguments.connect {
        super::print(&format!("a logger connects to {address}; end it with Ctrl-C\n"))?;
    }
    if arguments.qemu {
        let address = arguments.connect.as_deref().unwrap_or_default();
        let mut logger: Box<dyn Channel> = Box::new(arguments.image.options().start()?);
        let never = AtomicBool::new(false);
        return tcp::relay(logger.as_mut(), address, &mut |bytes| bytes.to_vec(), &never)
            .context("the logger cannot go on");
    }
    let flash = match &arguments.image.flash {
        Some(path) => PcFlash::in_file(path)?,
        None => PcFlash::in_memory(),
    };
    let mut logger = PcLogger::start(flash)?;
    if logger.identity().key.is_demo() {
        eprintln!("DEMO KEY: nobody gave this logger a key (host-sim keys); it uses the one that everybody knows.");
    }
    if let Some(address) = &arguments.connect {
        tcp::call(address, &mut logger);
    }
    let listener = base::listener(&arguments.listen)?;
    super::print(&format!(
        "a logger listens at {}; end it with Ctrl-C\n",
        listener.local_addr()?
    ))?;
    tcp::serve(&listener, &mut logger).context("the logger cannot go on listening")
}
