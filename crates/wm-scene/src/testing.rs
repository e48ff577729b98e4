//! Helpers of the tests of this crate and of those that depend on it; feature `testing`.

#[cfg(test)]
mod any;

#[cfg(test)]
pub use any::{SPLAT, any_scene, bits, full, push_row};

use std::path::PathBuf;
use wm_base::random::uniform;

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

/// Random numbers between bounds, drawn one after the other.
#[derive(Clone, Debug)]
pub struct Dice {
    seed: u64,
    drawn: u64,
}

impl Dice {
    /// Starts the numbers of a seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self { seed, drawn: 0 }
    }

    /// Draws the next number between `low` and `high`.
    pub fn draw(&mut self, low: f64, high: f64) -> f64 {
        self.drawn += 1;
        low + (high - low) * uniform(self.seed, self.drawn)
    }
}
