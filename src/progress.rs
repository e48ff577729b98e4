//! Progress of long work, on the error stream, where it is a terminal.

use indicatif::{ProgressBar, ProgressStyle};

/// A bar for `count` steps called `what`, with rate and time left.
pub fn bar(count: u64, what: &'static str) -> ProgressBar {
    let template = "{prefix} [{bar:32}] {pos}/{len}, {per_sec}, {eta} left {msg}";
    let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(count).with_style(style.progress_chars("=> ")).with_prefix(what)
}
