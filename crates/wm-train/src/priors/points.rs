//! The points of the reconstruction as each photo sees them.

use super::relative::SeenPoint;
use crate::photos::Photos;
use glam::DVec3;
use rayon::prelude::*;
use wm_scene::Camera;
use wm_scene::capture::Capture;

/// Whether the capture says which photo shows which point.
#[must_use]
pub fn has_tracks(capture: &Capture) -> bool {
    capture.observations.iter().any(|seen| !seen.is_empty())
}

/// For each of `places` (places in `photos`) the points that it shows: indices into the capture's.
///
/// Where the capture does not say, all points that fall into the picture, those behind walls too.
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

/// Where a camera sees a point, px, and its view z; `None` outside of the picture.
#[must_use]
pub fn inside(capture: &Capture, camera: &Camera, point: u32) -> Option<(f64, f64, f64)> {
    let at = DVec3::from_array(capture.points.positions[point as usize]);
    let (x, y, z) = camera.project(at)?;
    let is_inside = x >= 0.0 && y >= 0.0 && x < f64::from(camera.width) && y < f64::from(camera.height);
    (is_inside && z.is_finite() && z > 0.0).then_some((x, y, z))
}

/// Where `camera` sees the points `seen`, those that fall into its picture.
#[must_use]
pub fn placed(capture: &Capture, camera: &Camera, seen: &[u32]) -> Vec<SeenPoint> {
    let at = |point: &u32| {
        let (x, y, z) = inside(capture, camera, *point)?;
        Some(SeenPoint { at: [x / f64::from(camera.width), y / f64::from(camera.height)], z })
    };
    seen.iter().filter_map(at).collect()
}
