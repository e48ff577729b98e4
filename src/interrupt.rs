//! Ctrl-C: work that checks [`asked`] stops between two steps, everything else at once; no partial file is left in either case.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use thiserror::Error;
use wm_scene::files::abandon_temporaries;

/// The time of the first Ctrl-C.
static PRESSED: OnceLock<Instant> = OnceLock::new();
/// True once the current work checks for Ctrl-C between its steps.
static HEEDED: AtomicBool = AtomicBool::new(false);

/// A Ctrl-C so soon after the first is the same one: shells and `timeout` send it to the process and to its group.
const SAME_PRESS: Duration = Duration::from_millis(500);

/// The work was stopped by Ctrl-C.
#[derive(Debug, Error)]
#[error("stopped: {0}")]
pub struct Interrupted(pub String);

/// Returns true if an error says that the work was stopped, here or in the library.
pub fn is_stop(error: &anyhow::Error) -> bool {
    error.is::<Interrupted>() || matches!(error.downcast_ref(), Some(weather_magician::Error::Stopped))
}

/// Installs the handler. The first Ctrl-C waits for work that calls [`asked`]; if there is none, and
/// the second time, it ends the program at once.
pub fn listen() {
    // Without a handler Ctrl-C ends the program, which may leave a partial file.
    let _ = ctrlc::set_handler(|| {
        let is_again = PRESSED.get().is_some_and(|first| first.elapsed() > SAME_PRESS);
        PRESSED.get_or_init(Instant::now);
        if is_again || !HEEDED.load(Ordering::Relaxed) {
            abandon_temporaries();
            std::process::exit(130);
        }
    });
}

/// Returns true if Ctrl-C was pressed. After the first call the handler waits for the caller to stop.
pub fn asked() -> bool {
    HEEDED.store(true, Ordering::Relaxed);
    PRESSED.get().is_some()
}
