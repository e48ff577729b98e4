//! Pictures of the place, pixel by pixel; the caller brings the threads.

use super::{CAST, Material, SHARED, Street, display_of};
use glam::DVec3;
use wm_scene::Camera;

/// One pixel of a photo with its ground truth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhotoPixel {
    /// Mean linear radiance over the pixel.
    pub radiance: [f64; 3],
    /// [`display_of`] that: sRGB, 0-1.
    pub rgb: [f64; 3],
    /// View z of the first surface on the ray through the pixel's centre, m; 0 in the sky.
    pub depth: f64,
    /// Normal of that surface, world axes, towards the camera; 0 in the sky.
    pub normal: DVec3,
    /// Its material; none in the sky.
    pub material: Option<Material>,
    /// True if the ray through the pixel's centre ends in the sky.
    pub is_sky: bool,
}

impl Street {
    /// The pixel in column `x` and row `y`, averaged over `samples` x `samples` rays (1 and above).
    #[must_use]
    pub fn photo(&self, camera: &Camera, x: u32, y: u32, samples: u32) -> PhotoPixel {
        let eye = camera.center();
        let (left, top) = (f64::from(x), f64::from(y));
        let samples = samples.max(1);
        let size = 1.0 / f64::from(samples);
        let budget = if samples > 1 { SHARED } else { CAST };
        let mut sum = DVec3::ZERO;
        for row in 0..samples {
            for column in 0..samples {
                let (dx, dy) = ((f64::from(column) + 0.5) * size, (f64::from(row) + 0.5) * size);
                let direction = camera.ray(left + dx, top + dy);
                let hit = self.cast_with(eye, direction, budget);
                sum += DVec3::from_array(hit.map_or_else(|| self.sky(direction), |hit| hit.radiance));
            }
        }
        let radiance = (sum * size * size).to_array();
        let direction = camera.ray(left + 0.5, top + 0.5);
        let middle = self.first(eye, direction);
        PhotoPixel {
            radiance,
            rgb: display_of(radiance),
            depth: middle.map_or(0.0, |surface| surface.t * direction.dot(camera.forward())),
            normal: middle.map_or(DVec3::ZERO, |surface| surface.normal),
            material: middle.map(|surface| surface.material),
            is_sky: middle.is_none(),
        }
    }

    /// Row `y` of a picture, left to right; see [`Self::photo`].
    #[must_use]
    pub fn photo_row(&self, camera: &Camera, y: u32, samples: u32) -> Vec<PhotoPixel> {
        (0..camera.width).map(|x| self.photo(camera, x, y, samples)).collect()
    }
}
