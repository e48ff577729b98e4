//! Ctrl-C: work that checks [`asked`] stops between two steps, everything else at once; no partial file is left in either case.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use thiserror::Error;
use wm_scene::files::abandon_temporaries;

/// The time of the first Ctrl-C of this run.
static PRESSED: Mutex<Option<Instant>> = Mutex::new(None);
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

fn pressed() -> MutexGuard<'static, Option<Instant>> {
    PRESSED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Installs the handler, in place of any other. The first Ctrl-C waits for work that calls [`asked`]; if there is none,
/// and the second time, it ends the program at once.
pub fn listen() {
    // A process may run the program more than once: it is not stopped because the last one was.
    *pressed() = None;
    HEEDED.store(false, Ordering::Relaxed);
    // From the second run on there is a handler, which is an error. Without a handler Ctrl-C ends the program, which may
    // leave a partial file.
    let _ = ctrlc::set_handler(|| {
        let is_again = pressed().get_or_insert_with(Instant::now).elapsed() > SAME_PRESS;
        if is_again || !HEEDED.load(Ordering::Relaxed) {
            abandon_temporaries();
            std::process::exit(130);
        }
    });
}

/// Returns true if Ctrl-C was pressed. After the first call the handler waits for the caller to stop.
pub fn asked() -> bool {
    HEEDED.store(true, Ordering::Relaxed);
    pressed().is_some()
}
