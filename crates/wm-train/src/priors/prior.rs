//! Depth, normals and sky of one photo.

use serde::{Deserialize, Serialize};

/// Depth, normals and sky of one photo; arrays `[H, W]` of a size of their own, over the whole
/// photo, or empty where there is no prior.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Prior {
    /// Width, px.
    pub width: u32,
    /// Height, px.
    pub height: u32,
    /// Inverse view z, 1 / scene unit; 0 in the sky, NaN where it is not known.
    pub disparity: Vec<f32>,
    /// The error of `disparity`: the median of its absolute differences from the points, 1 / scene
    /// unit.
    pub sigma: f32,
    /// World axes, towards the camera, length 1; 0 where it is not known.
    pub normal: Vec<[f32; 3]>,
    /// The class of each pixel.
    pub sky: Vec<SkyClass>,
}

/// The class of a pixel: sky or not.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[repr(u8)]
pub enum SkyClass {
    /// Something in front of the sky.
    Place = 0,
    /// It cannot be told.
    #[default]
    Unknown = 128,
    /// The sky.
    Sky = 255,
}

impl Prior {
    /// Bytes that it takes.
    pub(crate) fn bytes(&self) -> usize {
        4 * self.disparity.len() + 12 * self.normal.len() + self.sky.len()
    }

    /// Makes everything unknown in some pixels.
    pub(crate) fn forget(&mut self, pixels: impl IntoIterator<Item = usize>) {
        for pixel in pixels {
            self.clear(pixel, f32::NAN);
            if let Some(sky) = self.sky.get_mut(pixel) {
                *sky = SkyClass::Unknown;
            }
        }
    }

    /// Makes disparity 0 where the sky is, and normals unknown.
    pub(crate) fn clear_sky(&mut self) {
        for pixel in 0..self.sky.len() {
            if self.sky[pixel] == SkyClass::Sky {
                self.clear(pixel, 0.0);
            }
        }
    }

    fn clear(&mut self, pixel: usize, unknown: f32) {
        if let Some(disparity) = self.disparity.get_mut(pixel) {
            *disparity = unknown;
        }
        if let Some(normal) = self.normal.get_mut(pixel) {
            *normal = [0.0; 3];
        }
    }
}
