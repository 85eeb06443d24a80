//! What is shown on a terminal only: colours and progress. A file or a pipe gets plain text and no bars.

use std::io::IsTerminal;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Redraws a second: enough for the eye.
const REDRAWS_HZ: u8 = 10;

static PROGRESS: AtomicBool = AtomicBool::new(true);

/// Switches the progress of long work on or off; it starts switched on.
pub fn show_progress(on: bool) {
    PROGRESS.store(on, Ordering::Relaxed);
}

/// Whether errors may be coloured: standard error is a terminal that knows colours, and the user has not said
/// otherwise (`NO_COLOR`, see no-color.org).
pub fn colours_on_stderr() -> bool {
    std::io::stderr().is_terminal() && colours_wanted()
}

fn colours_wanted() -> bool {
    let set = |name: &str| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    !set("NO_COLOR") && std::env::var_os("TERM").is_none_or(|term| term != "dumb")
}

/// A bar for `total` units of work on standard error, invisible unless that is a terminal and progress is switched on.
/// `what` says what is being done. Finish it with [`ProgressBar::finish_and_clear`].
pub fn progress(total: u64, what: &'static str) -> ProgressBar {
    if !PROGRESS.load(Ordering::Relaxed) || !std::io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::with_draw_target(Some(total), ProgressDrawTarget::stderr_with_hz(REDRAWS_HZ));
    let template = if colours_wanted() {
        "{msg} {bar:30.cyan} {percent:>3} %  {eta} left"
    } else {
        "{msg} {bar:30} {percent:>3} %  {eta} left"
    };
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style.progress_chars("━╸─"));
    }
    bar.set_message(what);
    bar.enable_steady_tick(Duration::from_millis(250));
    bar
}
