//! `host-sim validate`: the validation chapter, computed.

use anyhow::{Result, bail};
use clap::Args;
use host_sim::terminal;
use host_sim::validate::{self, TOPICS, page};
use serde_json::json;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Print one JSON object instead of the page
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let bar = terminal::progress(TOPICS.len() as u64, "validating");
    let chapters = validate::run(&mut |done| bar.set_position(done as u64));
    bar.finish_and_clear();
    let chapters = chapters?;
    let failures = validate::failures(&chapters);
    if arguments.json {
        let chapters: Vec<_> = (chapters.iter())
            .map(|chapter| json!({"title": chapter.topic.title, "rows": chapter.rows}))
            .collect();
        super::print_json(&json!({"chapters": chapters, "failed": failures.len()}))?;
    } else {
        super::print(&page::page(&chapters))?;
    }
    match failures.as_slice() {
        [] => Ok(()),
        [first] => bail!("a row does not hold: {first}"),
        [first, rest @ ..] => bail!("{} rows do not hold; the first: {first}", rest.len() + 1),
    }
}
