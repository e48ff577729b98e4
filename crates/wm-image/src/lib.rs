//! Reads and writes pictures and videos: photos ([`photo`]), depth, normal and mask maps
//! ([`maps`]), PNG, EXR, MP4, and contact sheets.
//!
//! Everything takes plain slices, so that nothing here knows a renderer:
//!
//! | kind | shape | values |
//! |---|---|---|
//! | rgb | `[H, W, 3]` | display-referred, sRGB-encoded, nominally 0-1, may lie outside |
//! | depth | `[H, W]` | scene units or metres as told; 0 = nothing there |
//! | normal | `[H, W, 3]` | unit vectors, world axes; (0, 0, 0) = nothing there |
//! | alpha | `[H, W]` | 0-1 |
//!
//! Rows run from top to bottom. A slice whose length does not fit its shape is a bug of the caller
//! and panics; whatever can go wrong outside the program is a [`MediaError`] of one line. Every
//! file is written beside its final name and then renamed ([`wm_base::files`]), so that a file
//! under its final name is always whole.
//!
//! The same pixels give the same bytes, on any number of threads.

pub mod color;
mod dither;
mod error;
mod exif;
pub mod exr;
pub mod flow;
pub mod header;
pub mod jpeg;
pub mod maps;
pub mod photo;
pub mod png;
pub mod quality;
pub mod ramps;
pub mod sheet;
pub mod video;

pub use error::MediaError;

use std::io::BufWriter;
use std::path::Path;
use wm_base::files::{TempFile, write_whole};

/// Width and height of a picture, pixels, both above 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PictureSize {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

impl PictureSize {
    /// A size; panics where a side is 0.
    #[must_use]
    pub fn new(width: u32, height: u32) -> Self {
        assert!(width > 0 && height > 0, "a picture of {width}x{height} pixels");
        Self { width, height }
    }

    /// Width times height.
    #[must_use]
    pub fn pixels(self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Panics if `pixels` is not `[H, W, channels]`.
    fn expect<T>(self, what: &str, pixels: &[T], channels: usize) {
        let Self { width, height } = self;
        assert_eq!(
            pixels.len(),
            self.pixels() * channels,
            "{what} of {width}x{height} with {channels} channels"
        );
    }
}

/// [`write_whole`] with the errors of this module.
fn write_file(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<&TempFile>) -> Result<(), MediaError>,
) -> Result<(), MediaError> {
    write_whole(path, |fault| MediaError::write(path, fault), write)
}

/// Names and values that are written into a file besides pixels, in this order: program, scene,
/// weather, seed, time, ...
pub type Tags = [(String, String)];
