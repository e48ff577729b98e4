//! Limits on the memory of a frame, so that no camera, weather or scene takes all that there is.

use crate::error::{Listed, RenderError};
use std::sync::atomic::{AtomicU64, Ordering};

/// Bytes that the lists of any frame may take, and bytes more for each of its pixels: five times
/// as many as those of heavy rain.
const BASE_BYTES: u64 = 1 << 30;
const BYTES_PER_PIXEL: u64 = 256;
/// Cells of space that may be searched for particles: for any frame, and for each pixel.
const BASE_CELLS: f64 = 3e7;
const CELLS_PER_PIXEL: f64 = 8.0;

/// Counts the bytes of the lists that threads make for a frame.
#[derive(Debug)]
pub(crate) struct FrameBudget {
    most: u64,
    taken: AtomicU64,
}

impl FrameBudget {
    /// The budget of a picture of a width and a height, px.
    pub(crate) fn new(width: u32, height: u32) -> Self {
        let most = BASE_BYTES + BYTES_PER_PIXEL * u64::from(width) * u64::from(height);
        Self { most, taken: AtomicU64::new(0) }
    }

    /// Counts more bytes; returns false once the total is too large. The final result does not
    /// depend on the order of threads.
    pub(crate) fn take(&self, bytes: usize) -> bool {
        let bytes = bytes as u64;
        self.taken.fetch_add(bytes, Ordering::Relaxed) + bytes <= self.most
    }

    /// Fails if the total is too large.
    pub(crate) fn check(&self, listed: Listed) -> Result<(), RenderError> {
        if self.taken.load(Ordering::Relaxed) <= self.most {
            return Ok(());
        }
        Err(RenderError::TooMuch { listed, mebibytes: self.most >> 20 })
    }
}

/// Fails if `cells` cells of space are too many to search for the particles of a picture.
pub(crate) fn check_cells(cells: f64, width: u32, height: u32) -> Result<(), RenderError> {
    let most = BASE_CELLS + CELLS_PER_PIXEL * f64::from(width) * f64::from(height);
    if cells <= most { Ok(()) } else { Err(RenderError::TooManyCells { cells }) }
}
