//! Depth, normal and mask maps of photos that are given as files.
//!
//! | file | values | channels |
//! |---|---|---|
//! | `.png` | 8 or 16-bit counts | grey or colour |
//! | `.tif`, `.tiff` | 16, 32 or 64-bit floats, 8 or 16-bit counts; strips or tiles | 1 to 4, interleaved |
//! | `.exr` | 16 or 32-bit floats | see [`read_map`] |
//! | `.npy` | little-endian f32 | `[H, W]`, `[H, W, C]` with 1 to 4 |
//!
//! A file becomes a [`Map`] of the numbers in it; what they mean is said beside it: [`DepthForm`],
//! [`NormalAxes`], `Map::to_mask`. Which file belongs to a photo is told by its name
//! ([`MapFolder`]). Pixels are those of the photo without its lens: where a camera has distortion,
//! the maps are of the pinhole picture, or made so
//! ([`Photos::without_lens`](crate::photos::Photos::without_lens)).

mod depth;
mod error;
mod exr;
mod find;
mod normal;
mod npy;
mod png;
mod resample;
#[cfg(test)]
mod tests;
mod tiff;
mod unit;

pub use depth::DepthForm;
pub use error::{MapError, MapFault};
pub use find::MapFolder;
pub use normal::NormalAxes;
pub use resample::Filter;
pub use unit::DepthUnit;

use std::{
    fs::File,
    io::Read,
    panic::{AssertUnwindSafe, catch_unwind},
    path::Path,
};
use wm_scene::camera::MAX_SIDE;

/// Most numbers of a map: 1 GiB of them, such as three channels of 89 million pixels.
pub(crate) const MAX_VALUES: u64 = 1 << 28;
/// Longest file that is read, bytes.
const MAX_FILE_BYTES: u64 = 1 << 31;
/// Most bytes that one byte of a compressed file can stand for: deflate reaches 1032, LZW of 12
/// bits 1365.
const MAX_COMPRESSION_RATIO: u64 = 2000;
/// The size up to which maps are not checked against [`MAX_COMPRESSION_RATIO`], bytes.
const UNCHECKED_BYTES: u64 = 1 << 20;
/// Largest difference of the aspect ratios of a map and its photo.
const ASPECT_TOLERANCE: f64 = 0.01;

/// The number type of a map in its file.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Stored {
    /// Floats.
    #[default]
    Floats,
    /// Whole numbers from 0 to this.
    Counts(f32),
}

/// Numbers for each pixel of a photo, as a file has them.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    /// Width, px.
    pub width: u32,
    /// Height, px.
    pub height: u32,
    /// Numbers a pixel, 1 to 4.
    pub channels: u32,
    /// `[H, W, C]`, not scaled; may be NaN or infinite.
    pub values: Vec<f32>,
    /// The number type in the file.
    pub stored: Stored,
    /// Metres that one step of a depth map stands for, where the file says it: the text
    /// `depth_metres_per_count` of PNG files that `render --also depth.png` writes.
    pub metres_per_step: Option<f64>,
}

impl Map {
    /// A map of floats.
    ///
    /// # Panics
    /// If there are more or fewer values than `[H, W, C]`, or none.
    #[must_use]
    pub fn new(width: u32, height: u32, channels: u32, values: Vec<f32>) -> Self {
        let count = width as usize * height as usize * channels as usize;
        assert!(count > 0 && values.len() == count, "a map of {width}x{height} px with {channels} channels");
        Self { width, height, channels, values, stored: Stored::Floats, metres_per_step: None }
    }

    /// Number of pixels.
    pub(crate) fn pixels(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// The map in the size of its photo, px; the same if it has that.
    ///
    /// # Errors
    /// [`MapFault::Aspect`] if the aspect ratios differ by more than 1 %.
    pub fn fitted(self, width: u32, height: u32, filter: Filter) -> Result<Self, MapFault> {
        if (self.width, self.height) == (width, height) {
            return Ok(self);
        }
        self.check_shape(width, height)?;
        Ok(self.resampled(width, height, filter))
    }

    /// Checks that the map has the aspect ratio of a photo of this size, px.
    ///
    /// # Errors
    /// [`MapFault::Aspect`] if the aspect ratios differ by more than 1 %.
    pub(crate) fn check_shape(&self, photo_width: u32, photo_height: u32) -> Result<(), MapFault> {
        let across = f64::from(self.width) * f64::from(photo_height);
        let down = f64::from(self.height) * f64::from(photo_width);
        if (across / down - 1.0).abs() <= ASPECT_TOLERANCE && (down / across - 1.0).abs() <= ASPECT_TOLERANCE
        {
            return Ok(());
        }
        let (width, height) = (self.width, self.height);
        Err(MapFault::Aspect { width, height, photo_width, photo_height })
    }

    /// The map as a mask, `[H, W]`, 0-1; what is not finite is 0.
    ///
    /// Of coloured pictures red says it. Counts that are all 0 and 1 are taken as such.
    pub(crate) fn to_mask(&self) -> Vec<f32> {
        let is_tiny = self.values.iter().all(|v| *v <= 1.0);
        let full = match self.stored {
            Stored::Counts(full) if !is_tiny => full,
            _ => 1.0,
        };
        let share = |v: &f32| if v.is_finite() { (v / full).clamp(0.0, 1.0) } else { 0.0 };
        self.values.iter().step_by(self.channels as usize).map(share).collect()
    }

    /// The one number of each pixel, `[H, W]`. Grey that was saved as colour is grey, and
    /// transparency is not looked at.
    ///
    /// # Errors
    /// [`MapFault::Channels`] if the channels differ.
    pub fn grey(&self) -> Result<Vec<f32>, MapFault> {
        let channels = self.channels as usize;
        let pixels = self.values.chunks_exact(channels);
        // Bits, so that a NaN is the same as itself.
        let is_grey = |p: &[f32]| p[1].to_bits() == p[0].to_bits() && p[2].to_bits() == p[0].to_bits();
        if channels > 2 && !pixels.clone().all(is_grey) {
            return Err(MapFault::Channels { found: self.channels, wanted: "one number a pixel (grey)" });
        }
        Ok(pixels.map(|p| p[0]).collect())
    }

    /// The first three numbers of each pixel, `[H, W, 3]`.
    ///
    /// # Errors
    /// [`MapFault::Channels`] if there are fewer.
    fn triples(&self) -> Result<impl Iterator<Item = [f32; 3]> + '_, MapFault> {
        if self.channels < 3 {
            return Err(MapFault::Channels { found: self.channels, wanted: "three (x, y, z)" });
        }
        Ok(self.values.chunks_exact(self.channels as usize).map(|p| [p[0], p[1], p[2]]))
    }
}

/// A file's format by its first bytes.
#[derive(Clone, Copy)]
enum Format {
    Png,
    Tiff,
    Exr,
    Npy,
}

impl Format {
    fn of(bytes: &[u8]) -> Option<Self> {
        const STARTS: [(&[u8], Format); 7] = [
            (b"\x89PNG\r\n\x1a\n", Format::Png),
            (b"II*\0", Format::Tiff),
            (b"MM\0*", Format::Tiff),
            (b"II+\0", Format::Tiff),
            (b"MM\0+", Format::Tiff),
            (b"\x76\x2f\x31\x01", Format::Exr),
            (b"\x93NUMPY", Format::Npy),
        ];
        STARTS.iter().find(|(start, _)| bytes.starts_with(start)).map(|(_, format)| *format)
    }
}

/// Reads a map; the format is told by the content.
///
/// Of an EXR file the channels are, in this order: Z alone where there is no X beside it; N.X, N.Y,
/// N.Z; X, Y, Z; R, G, B; Y; else the first.
///
/// # Errors
/// [`MapError`] if the file is missing, damaged, too large, or of another kind. Sizes are believed
/// only if the file is long enough for them.
pub fn read_map(path: &Path) -> Result<Map, MapError> {
    let fault = |fault| MapError { path: path.into(), fault };
    let bytes = read_file(path).map_err(fault)?;
    let Some(format) = Format::of(&bytes) else { return Err(fault(MapFault::Unknown)) };
    // A map that trips a decoder's own checks is a bad map, not the end of the program.
    let decoded = catch_unwind(AssertUnwindSafe(|| match format {
        Format::Png => png::decode(&bytes),
        Format::Tiff => tiff::decode(&bytes),
        Format::Exr => exr::decode(&bytes),
        Format::Npy => npy::decode(path),
    }));
    decoded.unwrap_or_else(|_| Err(MapFault::Damaged("the decoder gave up".into()))).map_err(fault)
}

fn read_file(path: &Path) -> Result<Vec<u8>, MapFault> {
    let cannot = |e: std::io::Error| MapFault::Unreadable(e.to_string());
    let about = std::fs::metadata(path).map_err(cannot)?;
    if !about.is_file() {
        return Err(MapFault::Unreadable("it is no regular file".into()));
    }
    if about.len() > MAX_FILE_BYTES {
        return Err(MapFault::Large(format!("{} bytes", about.len())));
    }
    let mut bytes = Vec::new();
    File::open(path).and_then(|file| file.take(MAX_FILE_BYTES).read_to_end(&mut bytes)).map_err(cannot)?;
    Ok(bytes)
}

/// Refuses a size before anything is allocated for it: `sample` bytes for each number, out of a
/// file of `length` bytes.
fn check_size(width: u64, height: u64, channels: u64, sample: u64, length: usize) -> Result<(), MapFault> {
    let values = width.saturating_mul(height).saturating_mul(channels);
    let size = || format!("{width}x{height} px with {channels} channels");
    if width == 0 || height == 0 || channels == 0 {
        return Err(MapFault::Damaged(format!("it has {}", size())));
    }
    if width > MAX_SIDE.into() || height > MAX_SIDE.into() || values > MAX_VALUES {
        return Err(MapFault::Large(size()));
    }
    let bytes = values * sample;
    if bytes > UNCHECKED_BYTES && bytes > MAX_COMPRESSION_RATIO * length as u64 {
        return Err(MapFault::Damaged(format!("{length} bytes cannot hold {}", size())));
    }
    Ok(())
}

/// The message of a decoder on one line, shortened.
fn words(error: &dyn std::fmt::Display) -> MapFault {
    let text = error.to_string();
    MapFault::Damaged(text.chars().map(|c| if c.is_control() { ' ' } else { c }).take(160).collect())
}
