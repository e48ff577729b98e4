//! Additional points on surfaces whose depth priors know and where the reconstruction has none.
//!
//! Structure from motion finds few points on lawns, gravel and walls, where a training would begin
//! with nothing and end with a few huge splats. Stereo knows the depth of many of their pixels.
//! Each of these becomes a point, unless its cell of space, whose size is the distance between
//! pixels there, already holds one.

use crate::haze::PhotoHaze;
use crate::photos::Photo;
use crate::priors::Prior;
use glam::DVec3;
use std::collections::HashSet;
use wm_scene::Camera;
use wm_scene::SparsePoints;

/// Approximate number of photos that show a surface: of as many pixels with known depth one is a
/// new point.
const PHOTOS_PER_SURFACE: f64 = 3.0;

/// A photo with the depth of its pixels.
pub(crate) struct FillView<'a> {
    /// The camera, of any size.
    pub(crate) camera: &'a Camera,
    /// The depth map and its size.
    pub(crate) prior: &'a Prior,
    /// The colours, of any size.
    pub(crate) photo: &'a Photo,
}

/// Adds to `points` until there are `most`, evenly over the photos; returns the number of added
/// points. `haze` is removed from the colours.
pub(crate) fn fill(
    points: &mut SparsePoints,
    views: &[FillView<'_>],
    most: usize,
    haze: Option<&PhotoHaze>,
) -> usize {
    let room = most.saturating_sub(points.len());
    let known: usize =
        views.iter().map(|view| view.prior.disparity.iter().filter(|v| **v > 0.0).count()).sum();
    if room == 0 || known == 0 {
        return 0;
    }
    let step = ((known as f64 / (PHOTOS_PER_SURFACE * room as f64)).sqrt() as usize).max(1);
    let mut taken = HashSet::new();
    let mut fresh: Vec<([f64; 3], [u8; 3])> = Vec::new();
    for FillView { camera, prior, photo } in views {
        let (width, height) = (prior.width as usize, prior.height as usize);
        let [across, along] =
            [f64::from(camera.width) / width as f64, f64::from(camera.height) / height as f64];
        let distance = |z: f64| z * across * step as f64 / camera.fx;
        for position in &points.positions {
            let at = DVec3::from_array(*position);
            if let Some((_, _, z)) = camera.project(at) {
                taken.insert(Cell::of(at, distance(z)));
            }
        }
        for row in (step / 2..height).step_by(step) {
            for column in (step / 2..width).step_by(step) {
                let Some(disparity) = prior.disparity.get(row * width + column).filter(|v| **v > 0.0) else {
                    continue;
                };
                let z = 1.0 / f64::from(*disparity);
                let (x, y) = (column as f64 + 0.5, row as f64 + 0.5);
                let ray = camera.ray(x * across, y * along);
                let at = camera.center() + ray * (z / ray.dot(camera.forward()));
                if !taken.insert(Cell::of(at, distance(z))) {
                    continue;
                }
                let shown = photo.at_share(x / width as f64, y / height as f64);
                let kept = |haze: &PhotoHaze| haze.transmittance(camera.center().distance(at));
                let color = haze.map_or(shown, |haze| haze.clear_color(shown, kept(haze)));
                fresh.push((at.to_array(), color));
            }
        }
    }
    let added = fresh.len().min(room);
    for i in 0..added {
        let (position, color) = fresh[i * fresh.len() / added];
        points.push(position, color, f32::NAN, 0);
    }
    added
}

/// A cell of space; its size is a power of two.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Cell {
    level: i32,
    at: [i64; 3],
}

impl Cell {
    /// Returns the cell of about `size` that contains a point.
    fn of(point: DVec3, size: f64) -> Self {
        let level = size.log2().round() as i32;
        Self { level, at: (point / 2f64.powi(level)).floor().to_array().map(|v| v as i64) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall at 4 units of which the left half has points.
    #[test]
    fn points_come_where_there_are_none() {
        let camera = Camera::looking((80, 60), 60.0, DVec3::ZERO, DVec3::Y, DVec3::Z).unwrap();
        let (width, height) = (40u32, 30u32);
        let mut disparity = vec![0.25f32; 1200];
        disparity[0] = f32::NAN;
        disparity[1] = 0.0;
        let prior = Prior { width, height, disparity, ..Prior::default() };
        let rgb = (0..20 * 15).flat_map(|i| [if i % 20 < 10 { 250 } else { 10 }, 7, 9]).collect();
        let photo = Photo { width: 20, height: 15, rgb, mask: None, camera };
        let mut points = SparsePoints::default();
        for row in 0..30 {
            for column in 0..20 {
                let ray = camera.ray(2.0 * f64::from(column) + 1.0, 2.0 * f64::from(row) + 1.0);
                points.push((ray * (4.0 / ray.y)).to_array(), [1; 3], 0.5, 3);
            }
        }
        let view = FillView { camera: &camera, prior: &prior, photo: &photo };
        let mut full = points.clone();
        assert_eq!(fill(&mut full, &[], 5000, None), 0);
        let added = fill(&mut full, &[view], 5000, None);
        assert!((200..=620).contains(&added), "{added}");
        assert_eq!(full.len(), 600 + added);
        let right = full.positions[600..].iter().filter(|p| p[0] > 0.0).count();
        assert!(right > added * 9 / 10, "{right} of {added}");
        for (position, color) in full.positions[600..].iter().zip(&full.colors[600..]) {
            assert!((position[1] - 4.0).abs() < 1e-9);
            assert_eq!(*color, [if position[0] < 0.0 { 250 } else { 10 }, 7, 9]);
        }
        let view = FillView { camera: &camera, prior: &prior, photo: &photo };
        assert_eq!(fill(&mut points, &[view], 700, None), 100);
    }
}
