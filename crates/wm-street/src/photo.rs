//! Pictures of the place, pixel by pixel; the caller brings the threads.

use crate::air::Air;
use crate::light::{CAST_BUDGET, SHARED_BUDGET};
use crate::light_map::Budget;
use crate::shape::Crossing;
use crate::{Label, Material, Place, display_of};
use glam::DVec3;
use rayon::prelude::*;
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
    /// The material; none in the sky.
    pub material: Option<Material>,
    /// The label; none in the sky.
    pub label: Option<Label>,
    /// True if the ray through the pixel's centre ends in the sky.
    pub is_sky: bool,
    /// The share of the pixel that shows people and cars that pass, 0-1.
    pub moving: f64,
}

/// The way in which pixels are cast.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RaySettings {
    /// A pixel is the mean of this squared rays.
    pub(crate) samples: u32,
    /// Rays for the light of each.
    pub(crate) budget: Budget,
    /// Rays for the light of a pixel that has one ray alone.
    pub(crate) plain: Budget,
    /// The haze that they pass through.
    pub(crate) air: Option<Air>,
}

impl RaySettings {
    /// The usual one of `samples`.
    fn of(samples: u32) -> Self {
        let budget = if samples > 1 { SHARED_BUDGET } else { CAST_BUDGET };
        Self { samples: samples.max(1), budget, plain: budget, air: None }
    }

    /// Radiance as it arrives through the haze.
    fn seen(&self, radiance: DVec3, eye: DVec3, direction: DVec3, distance: Option<f64>) -> DVec3 {
        self.air.as_ref().map_or(radiance, |air| air.seen(radiance, eye, direction, distance))
    }
}

/// The hit of the ray through a pixel's middle.
#[derive(Clone, Copy)]
struct CenterHit {
    which: usize,
    crossing: Crossing,
    point: DVec3,
    normal: DVec3,
    material: Material,
    label: Label,
}

impl CenterHit {
    /// Returns true if two pixels show one plain surface: nothing between them needs a closer look.
    fn continues(&self, other: &Self) -> bool {
        let off = (other.point - self.point).dot(self.normal).abs();
        self.which == other.which
            || (self.material == other.material
                && self.normal.dot(other.normal) > 0.95
                && off < 0.01 * self.crossing.t)
    }
}

impl Place {
    /// The pixel in column `x` and row `y`, averaged over `samples` x `samples` rays (1 and above).
    #[must_use]
    pub fn photo(&self, camera: &Camera, x: u32, y: u32, samples: u32) -> PhotoPixel {
        let casting = RaySettings::of(samples);
        let middle = self.middle(camera, x, y);
        let (radiance, moving) = self.averaged(camera, x, y, &casting);
        photo_pixel(camera, x, y, middle.as_ref(), radiance, moving)
    }

    /// Row `y` of a picture, left to right; see [`Self::photo`].
    #[must_use]
    pub fn photo_row(&self, camera: &Camera, y: u32, samples: u32) -> Vec<PhotoPixel> {
        (0..camera.width).map(|x| self.photo(camera, x, y, samples)).collect()
    }

    /// A whole picture, row by row, on all threads: pixels that show one plain surface, or only
    /// sky, have one ray with more light, all others are averaged.
    pub(crate) fn picture(&self, camera: &Camera, casting: &RaySettings) -> Vec<PhotoPixel> {
        let (width, height) = (camera.width as usize, camera.height as usize);
        let pixels = (0..width * height).into_par_iter();
        let middles: Vec<Option<CenterHit>> = pixels
            .clone()
            .map(|index| self.middle(camera, (index % width) as u32, (index / width) as u32))
            .collect();
        let is_plain = |index: usize| {
            let (x, y) = (index % width, index / width);
            let beside = [
                (x > 0).then(|| index - 1),
                (x + 1 < width).then_some(index + 1),
                (y > 0).then(|| index - width),
                (y + 1 < height).then_some(index + width),
            ];
            beside.into_iter().flatten().all(|other| match (&middles[index], &middles[other]) {
                (Some(one), Some(other)) => one.continues(other),
                (None, None) => true,
                _ => false,
            })
        };
        let pixel = |index: usize| {
            let (x, y) = ((index % width) as u32, (index / width) as u32);
            let middle = middles[index].as_ref();
            let (radiance, moving) = if casting.samples == 1 || is_plain(index) {
                self.plain(camera, x, y, middle, casting)
            } else {
                self.averaged(camera, x, y, casting)
            };
            photo_pixel(camera, x, y, middle, radiance, moving)
        };
        pixels.map(pixel).collect()
    }

    fn middle(&self, camera: &Camera, x: u32, y: u32) -> Option<CenterHit> {
        let (eye, direction) = (camera.center(), camera.ray(f64::from(x) + 0.5, f64::from(y) + 0.5));
        let (which, crossing) = self.nearest(eye, direction, f64::INFINITY)?;
        let normal = self.facing(which, &crossing, direction);
        let point = eye + direction * crossing.t;
        let (material, label) = self.matter(which, point);
        Some(CenterHit { which, crossing, point, normal, material, label })
    }

    /// Radiance of a pixel by the ray through its middle alone, and its share of movers.
    fn plain(
        &self,
        camera: &Camera,
        x: u32,
        y: u32,
        middle: Option<&CenterHit>,
        casting: &RaySettings,
    ) -> (DVec3, f64) {
        let (eye, direction) = (camera.center(), camera.ray(f64::from(x) + 0.5, f64::from(y) + 0.5));
        let lit = |middle: &CenterHit| {
            self.hit(middle.which, &middle.crossing, eye, direction, casting.plain, camera.widest_pixel())
        };
        let radiance = middle.map_or_else(|| self.sky(direction), |middle| lit(middle).radiance);
        let moving = middle.is_some_and(|middle| middle.label == Label::Mover);
        let distance = middle.map(|middle| middle.crossing.t);
        (casting.seen(DVec3::from_array(radiance), eye, direction, distance), f64::from(u8::from(moving)))
    }

    /// Mean radiance of a pixel over all samples, and its share of movers.
    fn averaged(&self, camera: &Camera, x: u32, y: u32, casting: &RaySettings) -> (DVec3, f64) {
        let eye = camera.center();
        let (left, top) = (f64::from(x), f64::from(y));
        let size = 1.0 / f64::from(casting.samples);
        let (mut sum, mut moving) = (DVec3::ZERO, 0.0);
        for row in 0..casting.samples {
            for column in 0..casting.samples {
                let (dx, dy) = ((f64::from(column) + 0.5) * size, (f64::from(row) + 0.5) * size);
                let direction = camera.ray(left + dx, top + dy);
                let hit = self.cast_with(eye, direction, casting.budget);
                let radiance = hit.map_or_else(|| self.sky(direction), |hit| hit.radiance);
                sum += casting.seen(DVec3::from_array(radiance), eye, direction, hit.map(|hit| hit.t));
                moving += f64::from(u8::from(hit.is_some_and(|hit| hit.label == Label::Mover)));
            }
        }
        (sum * size * size, moving * size * size)
    }
}

/// A pixel with what is known of its middle.
fn photo_pixel(
    camera: &Camera,
    x: u32,
    y: u32,
    middle: Option<&CenterHit>,
    radiance: DVec3,
    moving: f64,
) -> PhotoPixel {
    let direction = camera.ray(f64::from(x) + 0.5, f64::from(y) + 0.5);
    let radiance = radiance.to_array();
    PhotoPixel {
        radiance,
        rgb: display_of(radiance),
        depth: middle.map_or(0.0, |middle| middle.crossing.t * direction.dot(camera.forward())),
        normal: middle.map_or(DVec3::ZERO, |middle| middle.normal),
        material: middle.map(|middle| middle.material),
        label: middle.map(|middle| middle.label),
        is_sky: middle.is_none(),
        moving,
    }
}
