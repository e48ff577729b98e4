//! Helpers of the tests of this crate and of those that depend on it; feature `testing`.

#[cfg(test)]
mod any;
mod capture;

#[cfg(test)]
pub use any::{SPLAT, any_scene, bits, full, push_row};

pub use capture::{Dice, rolled, taken_if};

use std::path::PathBuf;

/// A file or folder of the real data; `None`, said on stderr, where it is not there.
///
/// The data lies in `WM_DATA`, or in `shared/data` beside the checkout.
#[must_use]
pub fn data(path: &str) -> Option<PathBuf> {
    let root = std::env::var_os("WM_DATA").map_or_else(
        || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data")),
        PathBuf::from,
    );
    let path = root.join(path);
    if path.exists() {
        return Some(path);
    }
    eprintln!("skipped: {} is not there", path.display());
    None
}
