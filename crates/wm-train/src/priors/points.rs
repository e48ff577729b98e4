//! The points of the reconstruction as each photo sees them.

use super::relative::SeenPoint;
use crate::photos::Photos;
use glam::DVec3;
use rayon::prelude::*;
use wm_scene::Camera;
use wm_scene::capture::Capture;

/// Returns true if the capture says which photo shows which point.
#[must_use]
pub fn has_tracks(capture: &Capture) -> bool {
    capture.observations.iter().any(|seen| !seen.is_empty())
}

/// Returns, for each of `places` (indices in `photos`), the points that the photo shows, as indices into the capture's.
///
/// If the capture does not say which, these are all points in its image, including those behind walls.
#[must_use]
pub fn seen_points(capture: &Capture, photos: &Photos, places: &[usize]) -> Vec<Vec<u32>> {
    let has_tracks = has_tracks(capture);
    let of = |place: &usize| -> Vec<u32> {
        if has_tracks {
            return capture.observations[photos.view(*place)].iter().map(|seen| seen.point).collect();
        }
        let camera = photos.camera(*place, 0);
        (0..capture.points.len() as u32).filter(|index| inside(capture, &camera, *index).is_some()).collect()
    };
    places.par_iter().map(of).collect()
}

/// Returns the image point of a point, px, and its view z; `None` outside of the image.
#[must_use]
pub fn inside(capture: &Capture, camera: &Camera, point: u32) -> Option<(f64, f64, f64)> {
    let at = DVec3::from_array(capture.points.positions[point as usize]);
    let (x, y, z) = camera.project(at)?;
    let is_inside = x >= 0.0 && y >= 0.0 && x < f64::from(camera.width) && y < f64::from(camera.height);
    (is_inside && z.is_finite() && z > 0.0).then_some((x, y, z))
}

/// Returns the image points of the points `seen`, of those inside the image.
#[must_use]
pub fn placed(capture: &Capture, camera: &Camera, seen: &[u32]) -> Vec<SeenPoint> {
    let at = |point: &u32| {
        let (x, y, z) = inside(capture, camera, *point)?;
        Some(SeenPoint { at: [x / f64::from(camera.width), y / f64::from(camera.height)], z })
    };
    seen.iter().filter_map(at).collect()
}
