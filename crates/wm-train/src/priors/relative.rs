//! From relative depth (a network's, or maps of unknown scale) to a prior in the scene's units.

use super::fit::{Fit, FitError, Freedom, fit};
use super::normals::normals;
use super::sky::{SkyInput, classify};
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
    /// What is free in it.
    pub freedom: Freedom,
    /// The sky, where it is known.
    pub sky: Option<Vec<SkyClass>>,
}

/// A point of the reconstruction in a photo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeenPoint {
    /// Where, as a share of the photo's width and height.
    pub at: [f64; 2],
    /// View z, scene units.
    pub z: f64,
}

/// A far point is this many times as far as the 99.5th percentile of points (`d_max` of the paper).
const FAR: f64 = 1.5;
/// And this many times as far as their median, at least.
const FAR_MEDIAN: f64 = 10.0;
/// Half the side of the window of normals, as a share of the picture's height, and px at least.
const WINDOW: f64 = 0.012;
const FEWEST_PIXELS: usize = 2;

/// Fits `relative` to `points` and finds sky and normals. `rgb` is the photo at the size of the map, `[H, W, 3]`; `camera`
/// its camera at any size.
///
/// # Errors
/// [`FitError`] if it cannot be fitted.
pub fn prior(
    relative: &Relative,
    rgb: &[u8],
    camera: &Camera,
    points: &[SeenPoint],
    seed: u64,
) -> Result<(Prior, Fit), FitError> {
    let (width, height) = (relative.width, relative.height);
    let pixel = |share: f64, side: usize| ((share * side as f64) as usize).min(side - 1);
    let pairs: Vec<[f64; 2]> = points
        .iter()
        .map(|point| {
            let at = pixel(point.at[1], height) * width + pixel(point.at[0], width);
            [f64::from(relative.values[at]), 1.0 / point.z]
        })
        .collect();
    let found = fit(&pairs, relative.freedom, seed)?;
    let sky = relative.sky.clone().unwrap_or_else(|| {
        let places: Vec<[f32; 2]> = points
            .iter()
            .map(|point| [(point.at[0] * width as f64) as f32, (point.at[1] * height as f64) as f32])
            .collect();
        classify(&SkyInput { rgb, width, far: Some(&relative.values), has_depth: &[], points: &places })
    });
    let mut distances: Vec<f64> = points.iter().map(|point| point.z).collect();
    distances.sort_by(f64::total_cmp);
    let far = (FAR * distances[(distances.len() - 1) * 995 / 1000])
        .max(FAR_MEDIAN * distances[distances.len() / 2]);
    // Fits go below 0 where noise is; nothing but the sky is farther than that.
    let least = (1.0 / far) as f32;
    let fitted = |v: &f32| {
        let inverse = (found.scale * f64::from(*v) + found.shift) as f32;
        if inverse.is_nan() { inverse } else { inverse.max(least) }
    };
    let disparity: Vec<f32> = relative.values.iter().map(fitted).collect();
    let camera = camera.resized(width as u32, height as u32);
    let radius = ((WINDOW * height as f64).round() as usize).max(FEWEST_PIXELS);
    let normal = normals(&disparity, &camera, radius);
    let (width, height) = (width as u32, height as u32);
    let mut prior = Prior { width, height, disparity, sigma: found.sigma as f32, normal, sky };
    prior.clear_sky();
    Ok((prior, found))
}
