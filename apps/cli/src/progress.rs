//! Progress of long work, on the error stream if it is a terminal.

use crate::interrupt;
use anyhow::Result;
use indicatif::{ProgressBar, ProgressStyle};
use weather_magician::Progress;

/// Returns a bar for `count` steps called `what`, with rate and remaining time.
pub(crate) fn bar(count: u64, what: &'static str) -> ProgressBar {
    let template = "{prefix} [{bar:32}] {pos}/{len}, {per_sec}, {eta} left {msg}";
    let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(count).with_style(style.progress_chars("=> ")).with_prefix(what)
}

/// Returns a spinner with a text, for work of unknown length.
pub(crate) fn spinner(what: &'static str) -> ProgressBar {
    let bar = ProgressBar::new_spinner().with_message(what);
    bar.enable_steady_tick(std::time::Duration::from_millis(120));
    bar
}

/// Does `work` for each of `items`, which are called `what` beside a bar. Ctrl-C ends it between
/// two of them, and `stopped` says what is left.
pub(crate) fn for_each<T>(
    items: impl ExactSizeIterator<Item = T>,
    what: &'static str,
    stopped: &str,
    mut work: impl FnMut(T, &ProgressBar) -> Result<()>,
) -> Result<()> {
    let bar = bar(items.len() as u64, what);
    for item in items {
        interrupt::check(stopped)?;
        work(item, &bar)?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(())
}

/// Shows the progress of the library's work on the terminal, and stops it on Ctrl-C.
#[derive(Default)]
pub(crate) struct Reporter(Option<ProgressBar>);

impl Reporter {
    /// Prints a line on the error stream, above the bar.
    pub(crate) fn say(&self, line: &str) {
        match &self.0 {
            Some(bar) => bar.suspend(|| eprintln!("{line}")),
            None => eprintln!("{line}"),
        }
    }
}

impl Progress for Reporter {
    fn begin(&mut self, task: &'static str, steps: Option<u64>) {
        self.0 = Some(steps.map_or_else(|| spinner(task), |steps| bar(steps, task)));
    }

    fn advance(&mut self, steps: u64) {
        self.0.iter().for_each(|bar| bar.inc(steps));
    }

    fn end(&mut self) {
        self.0.take().iter().for_each(ProgressBar::finish_and_clear);
    }

    fn is_stopped(&mut self) -> bool {
        interrupt::asked()
    }
}
