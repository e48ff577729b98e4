//! Ctrl-C: work that asks ends between two steps, all else at once; no half file is left either way.

use std::sync::atomic::{AtomicBool, Ordering};
use thiserror::Error;
use wm_scene::files::abandon_temporaries;

static PRESSED: AtomicBool = AtomicBool::new(false);
/// Whether the work at hand looks here between its steps.
static HEEDED: AtomicBool = AtomicBool::new(false);

/// The work was stopped by Ctrl-C.
#[derive(Debug, Error)]
#[error("stopped: {0}")]
pub struct Interrupted(pub String);

/// Returns true if an error says that the work was stopped, here or in the library.
pub fn is_stop(error: &anyhow::Error) -> bool {
    error.is::<Interrupted>() || matches!(error.downcast_ref(), Some(weather_magician::Error::Stopped))
}

/// Starts to listen. The first Ctrl-C waits for work that calls [`asked`]; where there is none, and
/// the second time, it ends the program at once.
pub fn listen() {
    // Without a handler Ctrl-C just ends the program, which is fine but for a half file.
    let _ = ctrlc::set_handler(|| {
        if PRESSED.swap(true, Ordering::Relaxed) || !HEEDED.load(Ordering::Relaxed) {
            abandon_temporaries();
            std::process::exit(130);
        }
    });
}

/// Whether Ctrl-C was pressed. Who asks once is waited for from then on.
pub fn asked() -> bool {
    HEEDED.store(true, Ordering::Relaxed);
    PRESSED.load(Ordering::Relaxed)
}
