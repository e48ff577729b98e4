//! Work that waits for a GPU: on native systems it blocks and is done when it is first polled, in a
//! browser it is not.

use std::future::Future;
use std::pin::pin;
use std::task::{Context, Poll, Waker};

/// The value of a future that has it at once; `None` if it has to wait.
pub(crate) fn ready<T>(future: impl Future<Output = T>) -> Option<T> {
    match pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(value) => Some(value),
        Poll::Pending => None,
    }
}

/// The value of a future that never waits: one whose pictures are drawn by
/// [`RenderBackend::execute`](crate::RenderBackend::execute).
///
/// # Panics
/// If it waits.
pub fn at_once<T>(future: impl Future<Output = T>) -> T {
    ready(future).expect("what is drawn by `execute` never waits")
}
