//! The points of the reconstruction as each photo sees them.

use super::relative::SeenPoint;
use crate::photos::Photos;
use glam::DVec3;
use rayon::prelude::*;
use wm_base::statistics::quantile;
use wm_capture::Capture;
use wm_scene::Camera;

/// Returns true if the capture says which photo shows which point.
pub(crate) fn has_tracks(capture: &Capture) -> bool {
    capture.observations.iter().any(|seen| !seen.is_empty())
}

/// Returns, for each of `places` (indices in `photos`), the points that the photo shows, as indices
/// into the capture's.
///
/// If the capture does not say which, these are the points in its image that no other points stand
/// before.
#[must_use]
pub fn seen_points(capture: &Capture, photos: &Photos, places: &[usize]) -> Vec<Vec<u32>> {
    let has_tracks = has_tracks(capture);
    let spacing = if has_tracks { 0.0 } else { spacing(&capture.points.positions) };
    let of = |place: &usize| -> Vec<u32> {
        if has_tracks {
            return capture.observations[photos.view(*place)].iter().map(|seen| seen.point).collect();
        }
        unhidden(capture, &photos.camera(*place, 0), spacing)
    };
    places.par_iter().map(of).collect()
}

/// Columns of the grid in which points hide others.
const HIDING_COLUMNS: f64 = 96.0;
/// Radius within which a point hides others, in distances between neighbouring points.
const HIDING_RADIUS: f64 = 0.35;
/// Relative distance beyond another point from which a point is hidden; twice the distance between
/// neighbours is added.
const HIDDEN_TOLERANCE: f64 = 0.1;

/// Returns the points in the image that no others hide; each point stands for a small piece of a
/// surface.
fn unhidden(capture: &Capture, camera: &Camera, spacing: f64) -> Vec<u32> {
    let scale = HIDING_COLUMNS / f64::from(camera.width.max(1));
    let columns = HIDING_COLUMNS as usize;
    let rows = ((f64::from(camera.height) * scale).ceil() as usize).max(1);
    let placed: Vec<(u32, [f64; 3])> = (0..capture.points.len() as u32)
        .filter_map(|index| {
            let (x, y, z) = inside(capture, camera, index)?;
            Some((index, [x * scale, y * scale, z]))
        })
        .collect();
    let mut nearest = vec![f64::INFINITY; columns * rows];
    for (_, [x, y, z]) in &placed {
        let radius = HIDING_RADIUS * spacing * camera.fx * scale / z;
        let range = |at: f64, most: usize| {
            let end = ((at + radius).floor() as usize).min(most - 1);
            (at - radius).max(0.0).floor() as usize..=end
        };
        for row in range(*y, rows) {
            for column in range(*x, columns) {
                let at = &mut nearest[row * columns + column];
                *at = at.min(*z);
            }
        }
    }
    let is_seen = |(index, [x, y, z]): &(u32, [f64; 3])| {
        let cell = (*y as usize).min(rows - 1) * columns + (*x as usize).min(columns - 1);
        (*z <= nearest[cell] * (1.0 + HIDDEN_TOLERANCE) + 2.0 * spacing).then_some(*index)
    };
    placed.iter().filter_map(is_seen).collect()
}

/// Returns the median distance of sampled points from their nearest neighbours; 0 for fewer than
/// two points.
fn spacing(positions: &[[f64; 3]]) -> f64 {
    /// Most points whose nearest neighbours are looked for.
    const MAX_SAMPLE_COUNT: usize = 200;
    /// Most points that may be such a neighbour.
    const MAX_CANDIDATE_COUNT: usize = 100_000;
    let among: Vec<DVec3> = positions
        .iter()
        .step_by(positions.len() / MAX_CANDIDATE_COUNT + 1)
        .map(|p| DVec3::from_array(*p))
        .collect();
    let nearest = |at: usize| {
        let others = among.iter().enumerate().filter(|(other, _)| *other != at);
        others.map(|(_, other)| other.distance_squared(among[at])).fold(f64::INFINITY, f64::min).sqrt()
    };
    let places: Vec<usize> = (0..among.len()).step_by(among.len() / MAX_SAMPLE_COUNT + 1).collect();
    let mut distances: Vec<f64> = places.into_par_iter().map(nearest).filter(|d| d.is_finite()).collect();
    quantile(&mut distances, 0.5)
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
