//! `host-sim base-station`: attends to many loggers at once, stores what they say, and takes orders for them.

use std::path::PathBuf;
use std::time::SystemTime;

use anyhow::{Result, bail};
use clap::Args;
use host_sim::keys::{DEFAULT_FILE, KeyFile};
use host_sim::station::base::{self, Base, Said};
use host_sim::station::words;
use serde_json::json;
use spanwatch::wire::message::{Event, Verdict};

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Address that loggers connect to
    #[arg(long, default_value = "127.0.0.1:4960", value_name = "HOST:PORT")]
    listen: String,
    /// Serial device with a logger on it; may be given again
    #[arg(long, value_name = "DEVICE")]
    serial: Vec<PathBuf>,
    /// Address for those who give orders (--via station:HOST:PORT/LOGGER)
    #[arg(long, default_value = "127.0.0.1:4961", value_name = "HOST:PORT")]
    console: String,
    /// SQLite file that everything is stored in
    #[arg(long, default_value = "spanwatch.sqlite", value_name = "FILE")]
    database: PathBuf,
    /// File of the loggers' keys (host-sim keys)
    #[arg(long, default_value = DEFAULT_FILE, value_name = "FILE")]
    keys: PathBuf,
    /// One JSON object a line instead of sentences
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let keys = KeyFile::at(&arguments.keys);
    let ring = keys.ring()?;
    let (base, said) = Base::new(keys, &arguments.database)?;
    let (listener, console) = (base::listener(&arguments.listen)?, base::listener(&arguments.console)?);
    let console_address = console.local_addr()?;
    if ring.console_is_open() && !console_address.ip().is_loopback() {
        bail!(
            "the console listens at {console_address}, where others can reach it, and has no key; make one (host-sim keys console), or \
             let it listen at 127.0.0.1"
        );
    }
    if ring.is_demo() {
        eprintln!(
            "DEMO KEY: there is no file of keys at {}, so every logger is believed that has the key which everybody knows. \
             `host-sim keys new` makes keys.",
            arguments.keys.display()
        );
    }
    if ring.console_is_open() && !ring.is_demo() {
        eprintln!(
            "The console has no key of its own: whoever can use this computer can give orders. `host-sim keys console` makes one."
        );
    }
    let address = listener.local_addr()?;
    base.listen(listener);
    base.take_orders(console);
    for device in &arguments.serial {
        base.attend_serial(device.clone());
    }
    if arguments.json {
        super::print_json(&json!({
            "event": "listening",
            "loggers": address.to_string(),
            "console": console_address.to_string(),
            "database": arguments.database,
        }))?;
    } else {
        super::print(&format!(
            "Loggers connect to {address}, orders go to {console_address}; everything is stored in {}. End it with Ctrl-C: nothing is \
             lost.\n",
            arguments.database.display()
        ))?;
    }
    for said in said {
        let time = humantime::format_rfc3339_seconds(SystemTime::now());
        if arguments.json {
            let mut line = as_json(&said);
            line["time"] = json!(time.to_string());
            super::print_json(&line)?;
        } else {
            super::print(&format!("{time}  {}\n", as_text(&said)))?;
        }
    }
    Ok(())
}

fn as_text(said: &Said) -> String {
    match said {
        Said::Here { logger, name, source } => {
            let name = name.as_ref().map_or(String::new(), |name| format!(" ({name})"));
            format!("logger {logger}{name}: here, on {source}")
        }
        Said::Unknown { logger, key, source } => format!(
            "{source}: somebody says to be logger {logger} with its key {key}, which is not known here; refused (host-sim keys)"
        ),
        Said::Stored { origin, notice } => {
            let what = notice.as_ref().map_or_else(
                || "a message of another version of the program; stored as it came".to_owned(),
                |notice| match &notice.event {
                    Event::Alert(alert) => words::alert(alert),
                    Event::Passage(report) => words::verdict(report),
                    Event::Track(report) => format!("passage {}: TRACK CHANGED", report.passage),
                },
            );
            format!("logger {}, {}: {what}", origin.logger, origin.number)
        }
        Said::Ordered { logger, order, allowed } => match allowed {
            true => format!("logger {logger}: ordered to {order}"),
            false => format!(
                "logger {logger}: the order to {order} is refused: its key is not in the file, or another logger's"
            ),
        },
        Said::Lost { logger, after, upto } => format!(
            "logger {logger}: messages {} to {upto} are lost: it has been told that they were stored, and they are not here. Was another \
             database used, or this one set back?",
            after + 1
        ),
        Said::Trouble { source, what } => format!("{source}: {what}"),
        Said::Closed { source, why } => format!("{source}: closed ({why})"),
    }
}

fn as_json(said: &Said) -> serde_json::Value {
    match said {
        Said::Here { logger, name, source } => json!({"event": "here", "logger": logger, "name": name, "line": source}),
        Said::Unknown { logger, key, source } => {
            json!({"event": "unknown", "logger": logger, "key": key, "line": source})
        }
        Said::Stored { origin, notice } => {
            let (kind, passage, verdict) = match notice.as_ref().map(|notice| &notice.event) {
                Some(Event::Alert(alert)) => ("alert", Some(alert.passage), None),
                Some(Event::Passage(report)) => ("passage", Some(report.passage), Some(verdict(&report.verdict))),
                Some(Event::Track(report)) => ("track", Some(report.passage), None),
                None => ("unknown", None, None),
            };
            let text = match notice.as_ref().map(|notice| &notice.event) {
                Some(Event::Alert(alert)) => Some(words::alert(alert)),
                _ => None,
            };
            json!({
                "event": kind,
                "logger": origin.logger,
                "series": origin.series,
                "number": origin.number,
                "passage": passage,
                "verdict": verdict,
                "text": text,
            })
        }
        Said::Ordered { logger, order, allowed } => {
            json!({"event": "order", "logger": logger, "order": order, "allowed": allowed})
        }
        Said::Lost { logger, after, upto } => {
            json!({"event": "lost", "logger": logger, "first": after + 1, "last": upto})
        }
        Said::Trouble { source, what } => json!({"event": "trouble", "line": source, "text": what}),
        Said::Closed { source, why } => json!({"event": "closed", "line": source, "text": why}),
    }
}

fn verdict(verdict: &Verdict) -> &'static str {
    match verdict {
        Verdict::Healthy { .. } => "healthy",
        Verdict::Undecided { .. } => "undecided",
        Verdict::Damaged { .. } => "damaged",
        Verdict::NotIdentified(_) => "not identified",
    }
}
