//! Work outside of the interpreter: without its lock, stopped by Ctrl-C, and sound after a fork.

use crate::error::{Failure, Outcome};
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::mem;
use std::panic::resume_unwind;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread;
use std::time::Duration;
use weather_magician::Device;
use weather_magician::Progress;

/// Time between two questions to the interpreter for signals.
const SIGNAL_CHECK_INTERVAL: Duration = Duration::from_millis(50);

/// Does `work` on a thread of its own, with the interpreter free for others. Ctrl-C asks it to
/// stop, and is raised when it has.
pub(crate) fn detached<T: Send>(
    py: Python<'_>,
    work: impl FnOnce(&StopFlag) -> Outcome<T> + Send,
) -> PyResult<T> {
    let stop = StopFlag::default();
    let (outcome, signal) = py.detach(|| {
        thread::scope(|scope| {
            let (done, wait) = channel::<()>();
            let stop = &stop;
            let worker = scope.spawn(move || {
                let _done = done;
                work(stop)
            });
            let mut signal = None;
            while wait.recv_timeout(SIGNAL_CHECK_INTERVAL) == Err(RecvTimeoutError::Timeout) {
                if signal.is_none() {
                    signal = Python::attach(|py| py.check_signals().err());
                    if signal.is_some() {
                        stop.0.store(true, Ordering::Relaxed);
                    }
                }
            }
            (worker.join().unwrap_or_else(|panic| resume_unwind(panic)), signal)
        })
    });
    match (outcome, signal) {
        (_, Some(signal)) => Err(signal),
        (outcome, None) => Ok(outcome?),
    }
}

/// Tells work that it should stop.
#[derive(Debug, Default)]
pub(crate) struct StopFlag(AtomicBool);

impl StopFlag {
    /// Returns true if it should.
    pub(crate) fn is_set(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Progress of the library as calls of a Python function, and the way in which Ctrl-C reaches the
/// library.
pub(crate) struct CallbackProgress<'a> {
    stop: &'a StopFlag,
    /// Called with the steps done, the steps in all or `None`, and the task.
    callback: Option<&'a Py<PyAny>>,
    task: &'static str,
    steps: Option<u64>,
    done: u64,
    /// The exception of the callback.
    raised: Option<PyErr>,
}

impl<'a> CallbackProgress<'a> {
    /// Progress that goes to `callback`.
    pub(crate) fn new(stop: &'a StopFlag, callback: Option<&'a Py<PyAny>>) -> Self {
        Self { stop, callback, task: "", steps: None, done: 0, raised: None }
    }

    /// Returns the outcome of the work, or the exception of the callback that stopped it.
    pub(crate) fn outcome<T>(&mut self, outcome: Result<T, impl Into<Failure>>) -> Outcome<T> {
        match self.raised.take() {
            Some(raised) => Err(Failure::Python(raised)),
            None => outcome.map_err(Into::into),
        }
    }

    /// Tells that so many steps of a task are done, where other tasks came in between.
    pub(crate) fn reached(&mut self, task: &'static str, done: u64, steps: u64) {
        (self.task, self.steps, self.done) = (task, Some(steps), done);
        self.tell();
    }

    fn tell(&mut self) {
        let Some(callback) = self.callback.filter(|_| self.raised.is_none()) else { return };
        let called = Python::attach(|py| callback.call1(py, (self.done, self.steps, self.task)).map(drop));
        self.raised = called.err();
    }
}

impl Progress for CallbackProgress<'_> {
    fn begin(&mut self, task: &'static str, steps: Option<u64>) {
        (self.task, self.steps, self.done) = (task, steps, 0);
        self.tell();
    }

    fn advance(&mut self, steps: u64) {
        self.done += steps;
        self.tell();
    }

    fn is_stopped(&mut self) -> bool {
        self.raised.is_some() || self.stop.is_set()
    }
}

/// A value that each process makes for itself: the threads and the locks of a process are not there
/// in its forks.
pub(crate) struct PerProcess<T> {
    first: OnceLock<Box<ProcessSlot<T>>>,
}

struct ProcessSlot<T> {
    process: u32,
    value: Mutex<Option<T>>,
    next: OnceLock<Box<ProcessSlot<T>>>,
}

impl<T> PerProcess<T> {
    /// Without a value yet.
    pub(crate) const fn new() -> Self {
        Self { first: OnceLock::new() }
    }

    /// Locks the value of this process; `None` where it was not made yet.
    pub(crate) fn lock(&self) -> MutexGuard<'_, Option<T>> {
        let process = std::process::id();
        let mut at = &self.first;
        loop {
            let new = || Box::new(ProcessSlot { process, value: Mutex::new(None), next: OnceLock::new() });
            let slot = at.get_or_init(new);
            if slot.process == process {
                return slot.value.lock().unwrap_or_else(PoisonError::into_inner);
            }
            at = &slot.next;
        }
    }

    /// Calls `work` with the value of this process, made by `make` if it was not there.
    pub(crate) fn with<R, E>(
        &self,
        make: impl FnOnce() -> Result<T, E>,
        work: impl FnOnce(&mut T) -> Result<R, E>,
    ) -> Result<R, E> {
        let mut value = self.lock();
        work(match &mut *value {
            Some(made) => made,
            missing => missing.insert(make()?),
        })
    }
}

impl<T> Drop for PerProcess<T> {
    fn drop(&mut self) {
        let mut at = self.first.take();
        while let Some(mut slot) = at {
            at = slot.next.take();
            if slot.process != std::process::id() {
                // Its threads are not in this process: to end them would wait for ever.
                mem::forget(slot);
            }
        }
    }
}

/// Starts threads for one piece of work after the other; `None` for one for each processor.
///
/// Work that may run beside other work has a pool of its own: while a thread of a pool waits for
/// another pool, it takes other work of its own, which then has to end first.
pub(crate) fn pool_of(threads: Option<usize>) -> Outcome<Arc<ThreadPool>> {
    let built = ThreadPoolBuilder::new().num_threads(threads.unwrap_or(0)).build();
    built.map(Arc::new).map_err(|error| Failure::Library(error.to_string()))
}

/// Does `work` on threads of its own: rayon's global ones would be dead in a fork.
pub(crate) fn on_threads<R: Send>(work: impl FnOnce() -> R + Send) -> Outcome<R> {
    Ok(pool_of(None)?.install(work))
}

/// The device of a name: auto, cpu, gpu or gpu:NAME.
pub(crate) fn device_of(name: &str) -> Outcome<Device> {
    name.parse().map_err(|error| Failure::Library(format!("device: {error}")))
}
