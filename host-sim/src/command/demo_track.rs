//! `host-sim demo --unknown-track`: a viaduct whose rails nobody has measured. Twenty trains teach the base station their profile; then
//! an element loses stiffness, and the logger finds it. What is done is done by the commands that anybody would give, and they are shown.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result};
use clap::Parser;
use include_dir::{Dir, include_dir};

use super::{CommandLine, dispatch, print};

/// Twenty passages over the healthy bridge, six after element 5 has lost 15 %, and the track that is true.
static RECORDINGS: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/recordings/unknown-track");

pub(super) fn run(out: &Path) -> Result<()> {
    fs::create_dir_all(out).with_context(|| format!("cannot make the folder {}", out.display()))?;
    let (mut healthy, mut later) = (vec![], vec![]);
    for file in RECORDINGS.files() {
        let path = out.join(file.path());
        fs::write(&path, file.contents()).with_context(|| format!("cannot write {}", path.display()))?;
        let name = file.path().to_string_lossy();
        if name.ends_with(".csv") && name.starts_with("healthy") {
            healthy.push(path);
        } else if name.ends_with(".csv") && name.starts_with("later") {
            later.push(path);
        }
    }
    let at = |name: &str| out.join(name).to_string_lossy().into_owned();
    let (track, evidence, alerts) = (at("track.blob"), at("evidence.bin"), at("alerts.sqlite"));
    // What an earlier demonstration has learnt of the bridge would be taken for more passages.
    if Path::new(&evidence).exists() {
        fs::remove_file(&evidence).with_context(|| format!("cannot remove {evidence}"))?;
    }
    let names = |paths: &[std::path::PathBuf]| -> Vec<String> {
        paths.iter().map(|path| path.to_string_lossy().into_owned()).collect()
    };
    let (healthy, later) = (names(&healthy), names(&later));

    print(
        "The rails of a viaduct are rough (FRA class 6), and nobody has measured them. A logger that takes them for smooth finds no \
         explanation for a train over the healthy bridge, or a false one:\n",
    )?;
    give("replay", &healthy[..1], &healthy[0], &["--database", &alerts])?;

    print(
        "\nBut all trains roll over the same rails. Twenty of them, over the healthy bridge, teach their profile:\n",
    )?;
    let (profile, passage, truth) = (at("profile.svg"), at("passage.svg"), at("true-track.csv"));
    let flags = [
        "-o",
        &track,
        "--svg",
        &profile,
        "--truth",
        &truth,
        "--passage-svg",
        &passage,
    ];
    give("calibrate", &healthy, &at("healthy-*.csv"), &flags)?;

    print("\nThen element 5 loses 15 % of its stiffness. The logger, with the track as it was learnt, finds it:\n")?;
    let flags = ["--track", &track, "--evidence", &evidence, "--database", &alerts];
    give("replay", &later, &at("later-*.csv"), &flags)?;
    print(&format!("\nPictures: {profile} and {passage}\n"))
}

/// Shows a command with its recordings as `shown`, and runs it.
fn give(command: &str, recordings: &[String], shown: &str, flags: &[&str]) -> Result<()> {
    print(&format!("\n$ host-sim {command} {shown} {}\n", flags.join(" ")))?;
    let words = ["host-sim", command].into_iter();
    let words = words
        .chain(recordings.iter().map(String::as_str))
        .chain(flags.iter().copied());
    dispatch(CommandLine::try_parse_from(words)?.command)
}
