//! Progress reports of long work, and the way to stop it.

/// Receives the progress of long work. `()` ignores it all.
///
/// ```
/// use wm_place::Progress;
///
/// struct Dots;
/// impl Progress for Dots {
///     fn begin(&mut self, task: &'static str, steps: Option<u64>) {
///         eprint!("{task} ({steps:?} steps) ");
///     }
///     fn advance(&mut self, _steps: u64) {
///         eprint!(".");
///     }
/// }
/// ```
pub trait Progress {
    /// A task begins. `steps` is how many it takes, if that is known.
    fn begin(&mut self, task: &'static str, steps: Option<u64>) {
        let _ = (task, steps);
    }

    /// So many steps more of the current task are done.
    fn advance(&mut self, steps: u64) {
        let _ = steps;
    }

    /// The current task has ended.
    fn end(&mut self) {}

    /// Returns true if the work should stop at the next step; it then fails with
    /// [`Error::Stopped`](crate::Error::Stopped).
    fn is_stopped(&mut self) -> bool {
        false
    }
}

impl Progress for () {}
