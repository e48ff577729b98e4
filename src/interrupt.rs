//! Ctrl-C: work that checks [`asked`] stops between two steps, everything else at once; no partial file is left in either case.

use std::sync::atomic::{AtomicBool, Ordering};
use thiserror::Error;
use wm_scene::files::abandon_temporaries;

static PRESSED: AtomicBool = AtomicBool::new(false);
/// True once the current work checks for Ctrl-C between its steps.
static HEEDED: AtomicBool = AtomicBool::new(false);

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
        if PRESSED.swap(true, Ordering::Relaxed) || !HEEDED.load(Ordering::Relaxed) {
            abandon_temporaries();
            std::process::exit(130);
        }
    });
}

/// Returns true if Ctrl-C was pressed. After the first call the handler waits for the caller to stop.
pub fn asked() -> bool {
    HEEDED.store(true, Ordering::Relaxed);
    PRESSED.load(Ordering::Relaxed)
}
