//! Futures of work on a GPU: ready when they are first polled on native systems, but not in a
//! browser.

use std::future::Future;
use std::pin::pin;
use std::task::{Context, Poll, Waker};

/// Polls a future once; `None` if it is not ready.
pub(crate) fn ready<T>(future: impl Future<Output = T>) -> Option<T> {
    match pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(value) => Some(value),
        Poll::Pending => None,
    }
}

/// Returns the value of a future that is ready at once: one whose pictures are drawn by
/// [`RenderBackend::execute`](crate::RenderBackend::execute).
///
/// # Panics
/// If it waits.
pub fn at_once<T>(future: impl Future<Output = T>) -> T {
    ready(future).expect("what is drawn by `execute` never waits")
}
