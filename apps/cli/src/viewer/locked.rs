//! Locks of values that no critical section leaves half changed when it panics.

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Locks a value, also after a panic of another thread that held the lock.
pub(super) fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
