//! The validation chapter holds, and the page in the docs is what the command prints.

use std::path::Path;
use std::process::{Command, Output};

use host_sim::validate;

fn command(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_host-sim"))
        .arg("validate")
        .args(arguments)
        .output()
        .expect("host-sim runs")
}

fn printed(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).expect("UTF-8")
}

#[test]
fn every_row_holds() {
    let chapters = validate::run(&mut |_| ()).expect("every row can be computed");
    let failures = validate::failures(&chapters);
    assert!(failures.is_empty(), "{}", failures.join("\n"));
    for chapter in &chapters {
        assert!(!chapter.rows.is_empty(), "\"{}\" compares nothing", chapter.topic.title);
        for row in &chapter.rows {
            assert!(
                !row.source.is_empty() && !row.reason.is_empty(),
                "\"{}\" says neither source nor reason",
                row.what
            );
        }
    }
}

#[test]
fn the_page_is_what_the_command_prints() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/validation.md");
    let page = std::fs::read_to_string(path).expect("docs/validation.md");
    let output = command(&[]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let printed = printed(&output);
    for (line, (now, then)) in printed.lines().zip(page.lines()).enumerate() {
        assert_eq!(
            now,
            then,
            "line {}; make the page anew: host-sim validate > docs/validation.md",
            line + 1
        );
    }
    assert_eq!(
        printed.len(),
        page.len(),
        "make the page anew: host-sim validate > docs/validation.md"
    );
}

#[test]
fn the_rows_are_there_as_json_too() {
    let output = command(&["--json"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let all: serde_json::Value = serde_json::from_str(&printed(&output)).expect("one JSON object");
    assert_eq!(all["failed"], 0);
    let rows = all["chapters"][0]["rows"].as_array().expect("rows");
    assert_eq!(rows[0]["expected"], 18.15945);
    assert!(rows[0]["difference"].as_f64() <= rows[0]["tolerance"].as_f64());
}

#[test]
fn a_row_that_is_off_or_no_number_does_not_hold() {
    let row = |found: f64| {
        validate::Row::new("test", "none")
            .numbers(2.0, found)
            .within(0.1, "none")
    };
    assert!(row(2.19).holds() && row(1.81).holds());
    assert!(!row(2.21).holds() && !row(1.79).holds() && !row(f64::NAN).holds());
    let short = validate::Row::new("test", "none").histories(&[1.0, 2.0], &[1.0]);
    assert!(!short.clone().within(1.0, "none").holds());
    let short = validate::Row::new("test", "none").everywhere(&[1.0, 2.0], &[1.0]);
    assert!(!short.within(1.0, "none").holds());
}
