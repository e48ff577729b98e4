//! Pictures that show the points of a sweep.

use std::path::Path;
use wm_image::{MediaError, PictureSize, png};

/// The colour of pixels that show nothing.
const BACKGROUND_COLOR: [u8; 3] = [14, 16, 20];
/// The colour of rings, and of other lines that show distances and the field of view.
pub(crate) const LINE_COLOR: [u8; 3] = [48, 54, 62];

/// A picture of a sweep, `[H, W, 3]`, sRGB.
#[derive(Clone, Debug, PartialEq)]
pub struct SweepPicture {
    /// The size.
    pub size: PictureSize,
    /// The pixels.
    pub rgb: Vec<u8>,
}

impl SweepPicture {
    pub(crate) fn new(size: PictureSize) -> Self {
        Self { size, rgb: BACKGROUND_COLOR.repeat(size.pixels()) }
    }

    /// Sets a pixel, if it is in the picture.
    pub(crate) fn set(&mut self, x: i64, y: i64, color: [u8; 3]) {
        let (width, height) = (i64::from(self.size.width), i64::from(self.size.height));
        if (0..width).contains(&x) && (0..height).contains(&y) {
            let at = 3 * (y * width + x) as usize;
            self.rgb[at..at + 3].copy_from_slice(&color);
        }
    }

    /// Writes it as PNG.
    ///
    /// # Errors
    /// [`MediaError`] if the file cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), MediaError> {
        png::write_rgb8(path, &self.rgb, self.size, &[])
    }
}
