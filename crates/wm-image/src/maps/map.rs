//! The numbers of a map, and what every format is checked for.

use super::error::MapFault;
use std::fmt::Display;
use wm_scene::camera::MAX_SIDE;

/// Most numbers of a map: 1 GiB of them, such as three channels of 89 million pixels.
pub const MAX_VALUES: u64 = 1 << 28;

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
    #[must_use]
    pub fn pixels(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Checks that the map has the aspect ratio of a photo of this size, px.
    ///
    /// # Errors
    /// [`MapFault::Aspect`] if the aspect ratios differ by more than 1 %.
    pub fn check_shape(&self, photo_width: u32, photo_height: u32) -> Result<(), MapFault> {
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
    /// Coloured pictures give their red. Counts that are all 0 and 1 are taken as such.
    #[must_use]
    pub fn to_mask(&self) -> Vec<f32> {
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
            return Err(MapFault::Channels { found: self.channels, wanted: "one number per pixel (grey)" });
        }
        Ok(pixels.map(|p| p[0]).collect())
    }

    /// The first three numbers of each pixel, `[H, W, 3]`.
    ///
    /// # Errors
    /// [`MapFault::Channels`] if there are fewer.
    pub(super) fn triples(&self) -> Result<impl Iterator<Item = [f32; 3]> + '_, MapFault> {
        if self.channels < 3 {
            return Err(MapFault::Channels { found: self.channels, wanted: "three (x, y, z)" });
        }
        Ok(self.values.chunks_exact(self.channels as usize).map(|p| [p[0], p[1], p[2]]))
    }
}

/// Refuses a size before anything is allocated for it: `sample` bytes for each number, out of a
/// file of `length` bytes.
pub(super) fn check_size(
    width: u64,
    height: u64,
    channels: u64,
    sample: u64,
    length: usize,
) -> Result<(), MapFault> {
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
pub(super) fn words(error: &dyn Display) -> MapFault {
    let text = error.to_string();
    MapFault::Damaged(text.chars().map(|c| if c.is_control() { ' ' } else { c }).take(160).collect())
}
