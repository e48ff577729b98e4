//! The overlap of photos: how many of them show a surface, and so how much of what they show is
//! confirmed by others.

use glam::DVec3;
use wm_scene::Camera;
use wm_scene::SparsePoints;

/// Approximate number of sampled points of the reconstruction.
const MAX_POINTS: usize = 4000;
/// Photos that determine the place and the colour of a surface; further ones confirm them.
const SHOWING_PHOTOS: f64 = 2.0;
/// Least confirmed share of the pixels, also used if there are no points.
const MIN_CONFIRMED_SHARE: f64 = 0.25;

/// Returns how many photos show a surface, in the mean over the points of the reconstruction that
/// are in view of any; `None` if none is.
///
/// The photo that shows a point at the highest resolution counts as 1, and another one as its
/// resolution relative to that: a street seen from its far end is not seen again. Occlusion is not
/// considered.
pub(crate) fn overlap(points: &SparsePoints, cameras: &[Camera]) -> Option<f64> {
    let every = points.len().div_ceil(MAX_POINTS).max(1);
    let (mut sum, mut count) = (0.0, 0);
    for position in points.positions.iter().step_by(every) {
        let point = DVec3::from_array(*position);
        let (mut all, mut most) = (0.0, 0.0f64);
        for camera in cameras {
            let Some((x, y, z)) = camera.project(point) else { continue };
            let (width, height) = (f64::from(camera.width), f64::from(camera.height));
            if (0.0..width).contains(&x) && (0.0..height).contains(&y) {
                let density = camera.fx * camera.fy / (z * z);
                (all, most) = (all + density, most.max(density));
            }
        }
        if most > 0.0 && all.is_finite() {
            (sum, count) = (sum + all / most, count + 1);
        }
    }
    (count > 0).then(|| sum / f64::from(count))
}

/// Returns the share of the pixels of photos that confirm what two others show: of n photos that
/// show a surface, n - 2 do. `overlap` is this n, if it is known. A quarter, at least: next to
/// nothing would be learnt with no splats.
pub(crate) fn confirmed_share(overlap: Option<f64>) -> f64 {
    overlap.map_or(MIN_CONFIRMED_SHARE, |photos| (1.0 - SHOWING_PHOTOS / photos).max(MIN_CONFIRMED_SHARE))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(eye: DVec3) -> Camera {
        Camera::looking((80, 60), 50.0, eye, eye + DVec3::Y, DVec3::Z).unwrap()
    }

    #[test]
    fn a_photo_from_afar_counts_by_its_pixels() {
        let mut points = SparsePoints::default();
        points.push([0.0, 4.0, 0.0], [9; 3], 0.5, 3);
        // Behind all cameras.
        points.push([0.0, -90.0, 0.0], [9; 3], 0.5, 3);
        let beside = [-0.5, 0.0, 0.5].map(|x| camera(DVec3::new(x, 0.0, 0.0)));
        assert!((overlap(&points, &beside).unwrap() - 3.0).abs() < 1e-9);
        let behind = [0.0, -4.0].map(|y| camera(DVec3::new(0.0, y, 0.0)));
        assert!((overlap(&points, &behind).unwrap() - 1.25).abs() < 1e-9);
        assert_eq!(overlap(&SparsePoints::default(), &beside), None);
    }

    #[test]
    fn what_two_photos_show_is_not_confirmed() {
        let shares = [Some(1.0), Some(2.5), Some(4.0), Some(8.0), None].map(confirmed_share);
        assert_eq!(shares, [MIN_CONFIRMED_SHARE, MIN_CONFIRMED_SHARE, 0.5, 0.75, MIN_CONFIRMED_SHARE]);
    }
}
