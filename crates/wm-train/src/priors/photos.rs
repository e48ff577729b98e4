//! Priors from nothing but the photos and their cameras: stereo, and the sky by its look.

use super::fit::Fit;
use super::points::{inside, seen_points};
use super::sky::{SkyInput, classify};
use super::stereo::{self, StereoMap, StereoOptions};
use super::{Prior, PriorsWriter};
use crate::photos::{PhotoError, Photos};
use thiserror::Error;
use wm_scene::FormatError;
use wm_scene::capture::Capture;

/// What `source` in the index says.
pub const SOURCE: &str = "photos";
/// How far off depth from stereo is, as a share: what photos of a known place gave (median 0.9 %).
const OFF: f32 = 0.01;

/// Why there are none.
#[derive(Debug, Error)]
pub enum PhotoPriorsError {
    /// A photo is damaged.
    #[error(transparent)]
    Photo(#[from] PhotoError),
    /// A file cannot be written.
    #[error(transparent)]
    Write(#[from] FormatError),
}

/// Makes the priors of the photos `places` and adds them to `writer`. Photos whose depth cannot be told still have a
/// sky. `progress` is told how many of `2 places` passes are done, and says whether to go on: `None` if not.
///
/// # Errors
/// [`PhotoPriorsError`] if a photo is damaged or a file cannot be written.
pub fn write(
    capture: &Capture,
    photos: &Photos,
    places: &[usize],
    options: &StereoOptions,
    writer: &mut PriorsWriter,
    progress: &(dyn Fn(usize) -> bool + Sync),
) -> Result<Option<()>, PhotoPriorsError> {
    let Some(maps) = stereo::estimate(capture, photos, places, options, progress)? else { return Ok(None) };
    let level = stereo::level(photos, places, options);
    let seen = seen_points(capture, photos, places);
    for ((place, map), seen) in places.iter().zip(maps).zip(&seen) {
        let photo = photos.get(*place, level)?;
        let points: Vec<[f32; 2]> = seen
            .iter()
            .filter_map(|point| inside(capture, &photo.camera, *point))
            .map(|(x, y, _)| [x as f32, y as f32])
            .collect();
        let StereoMap { disparity, normal, .. } = map.clone().unwrap_or_default();
        let has_depth: Vec<bool> = disparity.iter().map(|v| *v > 0.0).collect();
        let (width, height) = (photo.width, photo.height);
        let input = SkyInput {
            rgb: &photo.rgb,
            width: width as usize,
            far: None,
            has_depth: &has_depth,
            points: &points,
        };
        let mut known: Vec<f32> = disparity.iter().copied().filter(|v| *v > 0.0).collect();
        known.sort_by(f32::total_cmp);
        let sigma = OFF * known.get(known.len() / 2).copied().unwrap_or(0.0);
        let mut prior = Prior { width, height, disparity, sigma, normal, sky: classify(&input) };
        prior.clear_sky();
        let name = &capture.views[photos.view(*place)].name;
        writer.add(name, &prior, None::<Fit>)?;
    }
    Ok(Some(()))
}
