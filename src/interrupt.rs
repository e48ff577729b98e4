//! Ctrl-C: the first asks the work at hand to end between two steps, the second ends the program.

use std::sync::atomic::{AtomicBool, Ordering};
use thiserror::Error;

static ASKED: AtomicBool = AtomicBool::new(false);

/// The work was stopped by Ctrl-C.
#[derive(Debug, Error)]
#[error("stopped: {0}")]
pub struct Interrupted(pub String);

/// Starts to listen. A second Ctrl-C ends the program at once.
pub fn listen() {
    // Without a handler Ctrl-C just ends the program, which is fine too.
    let _ = ctrlc::set_handler(|| {
        if ASKED.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
    });
}

/// Whether Ctrl-C was pressed.
pub fn asked() -> bool {
    ASKED.load(Ordering::Relaxed)
}
