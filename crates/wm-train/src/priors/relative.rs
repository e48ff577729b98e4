//! From relative depth (a network's, or maps of unknown scale) to a prior in the scene's units.

use super::fit::{Fit, FitError, Freedom, fit};
use super::normals::normals;
use super::{Prior, SkyClass};
use wm_scene::Camera;

/// Depth of one photo before it is fitted.
#[derive(Clone, Debug, Default)]
pub struct Relative {
    /// Width, px.
    pub width: usize,
    /// Height, px.
    pub height: usize,
    /// Relative inverse depth, near is large, `[H, W]`, NaN where it is not known.
    pub values: Vec<f32>,
    /// The unknowns of its scale.
    pub freedom: Freedom,
    /// The class of each pixel, `[H, W]`, or empty.
    pub sky: Vec<SkyClass>,
}

/// A point of the reconstruction in a photo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeenPoint {
    /// The image point, as shares of the photo's width and height.
    pub(crate) at: [f64; 2],
    /// View z, scene units.
    pub(crate) z: f64,
}

impl SeenPoint {
    /// Returns the image point in an image of this size, px.
    pub(crate) fn pixel(&self, width: usize, height: usize) -> [f32; 2] {
        [(self.at[0] * width as f64) as f32, (self.at[1] * height as f64) as f32]
    }
}

/// Largest depth in units of the 99.5th percentile of the points' depths (`d_max` of the paper).
const FAR_RATIO: f64 = 1.5;
/// Least value of the largest depth, in units of the median depth.
const FAR_MEDIAN_RATIO: f64 = 10.0;
/// Half the side of the window of normals, as a fraction of the image height, and its minimum, px.
const NORMAL_WINDOW: f64 = 0.012;
const MIN_WINDOW_PX: usize = 2;

/// Relative error of depth of a known scale where there are no points.
const DEPTH_ERROR: f64 = 0.02;

/// Fits `relative` to `points` and computes normals. `camera` is that of the photo at any size.
/// The fit is `None` if the scale is known and there are too few points to check it.
///
/// # Errors
/// [`FitError`] if it cannot be fitted.
pub(crate) fn prior(
    relative: Relative,
    camera: &Camera,
    points: &[SeenPoint],
    seed: u64,
) -> Result<(Prior, Option<Fit>), FitError> {
    let (width, height) = (relative.width, relative.height);
    let pairs = pairs(&relative, points);
    let (found, scale, shift) = match (fit(&pairs, relative.freedom, seed), relative.freedom) {
        (Err(FitError::Few(_)), Freedom::Known(scale)) => (None, scale, 0.0),
        (found, _) => found.map(|found| (Some(found), found.scale, found.shift))?,
    };
    // Fits with a shift can be below 0; depth is limited for everything but the sky.
    let least = match relative.freedom {
        Freedom::ScaleShift => (1.0 / farthest(points)) as f32,
        Freedom::Scale | Freedom::Known(_) => 0.0,
    };
    let fitted = |v: &f32| {
        let inverse = (scale * f64::from(*v) + shift) as f32;
        if inverse.is_nan() { inverse } else { inverse.max(least) }
    };
    let disparity: Vec<f32> = relative.values.iter().map(fitted).collect();
    let camera = camera.resized(width as u32, height as u32);
    let radius = ((NORMAL_WINDOW * height as f64).round() as usize).max(MIN_WINDOW_PX);
    let normal = normals(&disparity, &camera, radius);
    let (width, height) = (width as u32, height as u32);
    let sigma = found.map_or_else(|| DEPTH_ERROR * median(&disparity), |found| found.sigma) as f32;
    let mut prior = Prior { width, height, disparity, sigma, normal, sky: relative.sky };
    prior.clear_sky();
    for (disparity, class) in prior.disparity.iter_mut().zip(&prior.sky) {
        // Only the sky is infinitely far.
        if *class != SkyClass::Sky && *disparity <= 0.0 {
            *disparity = f32::NAN;
        }
    }
    Ok((prior, found))
}

/// Returns pairs of relative values and inverse depths of the points seen there, for [`fit`].
///
/// # Panics
/// If the map has no pixel.
#[must_use]
pub fn pairs(relative: &Relative, points: &[SeenPoint]) -> Vec<[f64; 2]> {
    let (width, height) = (relative.width, relative.height);
    let pair = |point: &SeenPoint| {
        let [x, y] = point.pixel(width, height).map(|v| v as usize);
        let at = y.min(height - 1) * width + x.min(width - 1);
        [f64::from(relative.values[at]), 1.0 / point.z]
    };
    points.iter().map(pair).collect()
}

/// Returns the largest distance that anything but the sky may have, scene units.
fn farthest(points: &[SeenPoint]) -> f64 {
    let mut distances: Vec<f64> = points.iter().map(|point| point.z).collect();
    distances.sort_by(f64::total_cmp);
    (FAR_RATIO * distances[(distances.len() - 1) * 995 / 1000])
        .max(FAR_MEDIAN_RATIO * distances[distances.len() / 2])
}

/// Returns the median of the values above 0; 0 if there are none.
pub(super) fn median(values: &[f32]) -> f64 {
    let mut known: Vec<f32> = values.iter().copied().filter(|v| *v > 0.0).collect();
    known.sort_by(f32::total_cmp);
    known.get(known.len() / 2).copied().unwrap_or(0.0).into()
}
