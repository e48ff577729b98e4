//! Exports that Ctrl-C stops.

use crate::interrupt;
use anyhow::Result;

/// The error of an export that was stopped.
pub(super) const NOT_WRITTEN: &str = "no site is written";

/// Fails if Ctrl-C was pressed.
pub(super) fn stop_if_asked() -> Result<()> {
    interrupt::check(NOT_WRITTEN)
}
