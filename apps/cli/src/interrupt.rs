//! Signals that end the program: work that checks [`asked`] stops between two steps, everything
//! else at once; no partial file is left in either case.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, AtomicI32, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use thiserror::Error;
use wm_base::files::abandon_temporaries;

/// The time of the first signal of this run.
static FIRST_SIGNAL_AT: Mutex<Option<Instant>> = Mutex::new(None);
/// The number of the last signal.
static LAST_SIGNAL: AtomicI32 = AtomicI32::new(INTERRUPT_SIGNAL);
/// True once the current work checks for signals between its steps.
static IS_CHECKED: AtomicBool = AtomicBool::new(false);

/// The number of the signal that Ctrl-C sends.
const INTERRUPT_SIGNAL: i32 = 2;
/// A signal so soon after the first is the same one: shells and `timeout` send it to the process
/// and to its group.
const SAME_SIGNAL_WITHIN: Duration = Duration::from_millis(500);

/// The work was stopped by a signal.
#[derive(Debug, Error)]
#[error("stopped: {0}")]
struct Interrupted(String);

/// Returns the error of stopped work, with a text that says what is left.
pub(crate) fn stopped(says: impl Into<String>) -> anyhow::Error {
    Interrupted(says.into()).into()
}

/// Fails with [`stopped`] if a signal came.
pub(crate) fn check(says: impl Into<String>) -> anyhow::Result<()> {
    if asked() { Err(stopped(says)) } else { Ok(()) }
}

/// Breaks a loop of the library if a signal came.
pub(crate) fn flow() -> ControlFlow<()> {
    if asked() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
}

/// Returns true if an error says that the work was stopped, here or in the library.
pub(crate) fn is_stop(error: &anyhow::Error) -> bool {
    error.is::<Interrupted>() || matches!(error.downcast_ref(), Some(weather_magician::Error::Stopped))
}

/// The exit status of a program that a signal stopped: 130 for Ctrl-C, 143 for SIGTERM, 129 for
/// SIGHUP.
pub(crate) fn status() -> u8 {
    128 + LAST_SIGNAL.load(Ordering::Relaxed) as u8
}

fn first() -> MutexGuard<'static, Option<Instant>> {
    FIRST_SIGNAL_AT.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Installs the handlers. The first signal waits for work that calls [`asked`]; if there is none,
/// and the second time, it ends the program at once.
pub(crate) fn listen() {
    // A process may run the program more than once: it is not stopped because the last one was.
    *first() = None;
    IS_CHECKED.store(false, Ordering::Relaxed);
    static INSTALLED: AtomicBool = AtomicBool::new(false);
    if !INSTALLED.swap(true, Ordering::Relaxed) {
        install();
    }
}

fn handle(signal: i32) {
    LAST_SIGNAL.store(signal, Ordering::Relaxed);
    let is_again = first().get_or_insert_with(Instant::now).elapsed() > SAME_SIGNAL_WITHIN;
    if is_again || !IS_CHECKED.load(Ordering::Relaxed) {
        abandon_temporaries();
        std::process::exit(status().into());
    }
}

/// Without handlers a signal ends the program, which may leave a partial file until the next one
/// writes into the folder: so errors are ignored.
#[cfg(unix)]
fn install() {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ};
    // A file beyond `ulimit -f` is an error of the write, not the end of the program.
    let _ = signal_hook::flag::register(SIGXFSZ, std::sync::Arc::default());
    let mut signals = vec![SIGINT, SIGTERM];
    // `nohup` has the program ignore it.
    if !is_ignored(SIGHUP) {
        signals.push(SIGHUP);
    }
    if let Ok(mut signals) = signal_hook::iterator::Signals::new(signals) {
        let _ = std::thread::Builder::new()
            .name("signals".into())
            .spawn(move || signals.forever().for_each(handle));
    }
}

/// Returns true if this process was started with a signal ignored, as Linux tells.
#[cfg(unix)]
fn is_ignored(signal: i32) -> bool {
    let about = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = about.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let ignored = ignored.and_then(|bits| u64::from_str_radix(bits.trim(), 16).ok());
    ignored.is_some_and(|bits| bits >> (signal - 1) & 1 == 1)
}

#[cfg(not(unix))]
fn install() {
    let _ = ctrlc::set_handler(|| handle(INTERRUPT_SIGNAL));
}

/// Returns true if a signal came. After the first call the handler waits for the caller to stop.
pub(crate) fn asked() -> bool {
    IS_CHECKED.store(true, Ordering::Relaxed);
    first().is_some()
}
