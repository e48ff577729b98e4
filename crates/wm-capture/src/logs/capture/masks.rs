//! Masks of photos: what boxes of movers cover, and what the log's own masks say.
//!
//! A box in front of the camera is cut at a plane close to it; the convex hull of the corners in
//! the ideal picture is cut to what the photo shows and then bent by the lens, edge by edge.

use super::photo::read_grey;
use crate::logs::files::fault;
use crate::logs::log::LogCamera;
use crate::logs::track::LogBox;
use glam::{DVec2, DVec3, dvec2};
use std::path::Path;
use wm_base::FormatError;
use wm_scene::Camera;
use wm_scene::camera::Distortion;

/// The plane at which boxes are cut, m in front of the camera.
const NEAR_PLANE_M: f64 = 0.1;
/// Parts of an edge of a hull across a photo.
const EDGE_PARTS: f64 = 24.0;

/// A camera's lens, prepared for masks.
#[derive(Clone)]
pub(super) struct MaskLens {
    distortion: Distortion,
    /// The part of the ideal plane z = 1 that the photo shows.
    low: DVec2,
    high: DVec2,
}

impl MaskLens {
    pub(super) fn new(camera: &LogCamera) -> Self {
        let (width, height) = (f64::from(camera.size.0), f64::from(camera.size.1));
        let plane = |x: f64, y: f64| {
            dvec2((x - camera.center[0]) / camera.focal[0], (y - camera.center[1]) / camera.focal[1])
        };
        let edge = (0..=32).map(|step| f64::from(step) / 32.0);
        let border: Vec<DVec2> = edge
            .flat_map(|s| {
                [
                    plane(s * width, 0.0),
                    plane(s * width, height),
                    plane(0.0, s * height),
                    plane(width, s * height),
                ]
            })
            .collect();
        let ideal: Option<Vec<DVec2>> =
            border.iter().map(|p| camera.distortion.undistort(p.x, p.y).map(|(x, y)| dvec2(x, y))).collect();
        // A lens that folds over is refused later; its masks are those of a pinhole.
        let (distortion, border) = match ideal {
            Some(ideal) => (camera.distortion, ideal),
            None => (Distortion::None, border),
        };
        let fold = |of: fn(DVec2, DVec2) -> DVec2| border.iter().copied().reduce(of).unwrap_or(DVec2::ZERO);
        Self { distortion, low: fold(DVec2::min), high: fold(DVec2::max) }
    }

    /// The mask of a photo, `[H, W]`: 0 in boxes, else 255. `None` if it shows none of them.
    pub(super) fn mask(&self, photo: &Camera, boxes: &[LogBox], more: f64) -> Option<Vec<u8>> {
        let mut mask = None;
        for own in boxes.iter().filter(|own| !own.has(photo.center(), more)) {
            let corners = own.corners(more).map(|corner| photo.viewmat.transform_point3(corner));
            let outline = self.outline(photo, &corners);
            if outline.len() >= 3 {
                let pixels = photo.width as usize * photo.height as usize;
                fill(mask.get_or_insert_with(|| vec![255; pixels]), photo.width, photo.height, &outline);
            }
        }
        mask.filter(|mask| mask.contains(&0))
    }

    /// The outline of a box in the photo, px, from its corners in the camera's axes; fewer than
    /// three points if it is not seen.
    fn outline(&self, photo: &Camera, corners: &[DVec3; 8]) -> Vec<DVec2> {
        let mut points: Vec<DVec2> = Vec::with_capacity(20);
        let mut push = |p: DVec3| {
            let p = p.truncate() / p.z;
            if p.is_finite() {
                points.push(p);
            }
        };
        for (index, corner) in corners.iter().enumerate() {
            if corner.z >= NEAR_PLANE_M {
                push(*corner);
            }
            for axis in [1, 2, 4] {
                let other = corners[index ^ axis];
                // Each edge once, from the corner before the plane.
                if corner.z >= NEAR_PLANE_M && other.z < NEAR_PLANE_M {
                    push(corner.lerp(other, (corner.z - NEAR_PLANE_M) / (corner.z - other.z)));
                }
            }
        }
        let hull = clipped(hull(points), self.low, self.high);
        let step = ((self.high - self.low).max_element() / EDGE_PARTS).max(1e-6);
        let mut outline = Vec::new();
        for (index, from) in hull.iter().enumerate() {
            let to = hull[(index + 1) % hull.len()];
            let parts = if self.distortion == Distortion::None {
                1.0
            } else {
                (from.distance(to) / step).ceil().clamp(1.0, 2.0 * EDGE_PARTS)
            };
            for part in 0..parts as u32 {
                let p = from.lerp(to, f64::from(part) / parts);
                let (x, y) = self.distortion.distort(p.x, p.y);
                outline.push(dvec2(photo.fx * x + photo.cx, photo.fy * y + photo.cy));
            }
        }
        outline
    }
}

/// The convex hull, counterclockwise (Andrew 1979).
fn hull(mut points: Vec<DVec2>) -> Vec<DVec2> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    points.dedup();
    if points.len() < 3 {
        return points;
    }
    let half = |points: &mut dyn Iterator<Item = &DVec2>| {
        let mut side: Vec<DVec2> = Vec::new();
        for point in points {
            while let [.., a, b] = side[..] {
                if (b - a).perp_dot(*point - a) > 0.0 {
                    break;
                }
                side.pop();
            }
            side.push(*point);
        }
        side.pop();
        side
    };
    let mut lower = half(&mut points.iter());
    lower.extend(half(&mut points.iter().rev()));
    lower
}

/// A convex polygon, cut to a rectangle (Sutherland and Hodgman 1974).
fn clipped(mut polygon: Vec<DVec2>, low: DVec2, high: DVec2) -> Vec<DVec2> {
    let sides: [(DVec2, f64); 4] =
        [(DVec2::X, -low.x), (DVec2::NEG_X, high.x), (DVec2::Y, -low.y), (DVec2::NEG_Y, high.y)];
    for (normal, offset) in sides {
        let inside = |p: DVec2| normal.dot(p) + offset;
        let mut kept = Vec::with_capacity(polygon.len() + 2);
        for (index, from) in polygon.iter().enumerate() {
            let to = polygon[(index + 1) % polygon.len()];
            let (a, b) = (inside(*from), inside(to));
            if a >= 0.0 {
                kept.push(*from);
            }
            if (a >= 0.0) != (b >= 0.0) {
                kept.push(from.lerp(to, a / (a - b)));
            }
        }
        polygon = kept;
    }
    polygon
}

/// Zeroes the pixels whose centres lie in a polygon.
fn fill(mask: &mut [u8], width: u32, height: u32, polygon: &[DVec2]) {
    let bound = |of: fn(f64, f64) -> f64| polygon.iter().map(|p| p.y).reduce(of).unwrap_or(0.0);
    let first = (bound(f64::min) - 0.5).ceil().clamp(0.0, f64::from(height)) as usize;
    let last = (bound(f64::max) - 0.5).floor().clamp(-1.0, f64::from(height) - 1.0) as i64;
    let mut crossings: Vec<f64> = Vec::new();
    for row in first..(last + 1) as usize {
        let y = row as f64 + 0.5;
        crossings.clear();
        for (index, a) in polygon.iter().enumerate() {
            let b = polygon[(index + 1) % polygon.len()];
            if (a.y <= y) != (b.y <= y) {
                crossings.push(a.x + (y - a.y) / (b.y - a.y) * (b.x - a.x));
            }
        }
        crossings.sort_by(f64::total_cmp);
        for pair in crossings.as_chunks::<2>().0 {
            let [start, end] = pair.map(|x| (x - 0.5).ceil().clamp(0.0, f64::from(width)) as usize);
            mask[row * width as usize..][start..end.max(start)].fill(0);
        }
    }
}

/// Adds a mask of the log, white where something moves.
pub(super) fn add_file(mask: &mut Option<Vec<u8>>, file: &Path, size: (u32, u32)) -> Result<(), FormatError> {
    let (width, height, grey) = read_grey(file)?;
    if (width, height) != size {
        return Err(fault(file, format!("the mask is {width}x{height} px, the photo {}x{}", size.0, size.1)));
    }
    if grey.iter().any(|value| *value > 0) {
        let mask = mask.get_or_insert_with(|| vec![255; grey.len()]);
        mask.iter_mut().zip(&grey).filter(|(_, value)| **value > 0).for_each(|(mask, _)| *mask = 0);
    }
    Ok(())
}

/// A mask of the sky, white in it, as a pinhole of the size of `ideal` sees it.
pub(super) fn pinhole_sky(
    file: &Path,
    photo: &Camera,
    distortion: Distortion,
    ideal: &Camera,
) -> Result<Vec<u8>, FormatError> {
    let (width, height, grey) = read_grey(file)?;
    // It may be of another size, but shows the same.
    let scale = dvec2(f64::from(width) / f64::from(photo.width), f64::from(height) / f64::from(photo.height));
    let mut sky = Vec::with_capacity(ideal.width as usize * ideal.height as usize);
    for row in 0..ideal.height {
        for column in 0..ideal.width {
            let x = (f64::from(column) + 0.5 - ideal.cx) / ideal.fx;
            let y = (f64::from(row) + 0.5 - ideal.cy) / ideal.fy;
            let (x, y) = distortion.distort(x, y);
            let at = dvec2(photo.fx * x + photo.cx, photo.fy * y + photo.cy) * scale;
            let (x, y) = (at.x.clamp(0.0, f64::from(width) - 1.0), at.y.clamp(0.0, f64::from(height) - 1.0));
            let value = grey.get(y as usize * width as usize + x as usize).copied().unwrap_or(0);
            sky.push(if value > 0 { 255 } else { 0 });
        }
    }
    Ok(sky)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::RigidPose;
    use glam::DQuat;

    fn camera(distortion: Distortion) -> LogCamera {
        LogCamera {
            name: "a".into(),
            size: (120, 90),
            focal: [100.0, 100.0],
            center: [60.0, 45.0],
            distortion,
        }
    }

    /// The mask, and whether the ray through each pixel's middle meets the box.
    fn check(distortion: Distortion, own: LogBox) -> usize {
        let camera = camera(distortion);
        let photo = camera.camera(&RigidPose::IDENTITY);
        let mask = MaskLens::new(&camera).mask(&photo, &[own], 0.0).unwrap_or(vec![255; 120 * 90]);
        let (mut wrong, mut covered) = (0, 0);
        for (pixel, value) in mask.iter().enumerate() {
            let (x, y) = ((pixel % 120) as f64 + 0.5, (pixel / 120) as f64 + 0.5);
            let (x, y) = distortion.undistort((x - 60.0) / 100.0, (y - 45.0) / 100.0).unwrap();
            let b = own.world_from_box.inverse();
            let (from, along) = (b.point(DVec3::ZERO), b.rotation * DVec3::new(x, y, 1.0));
            let (one, two) = ((-0.5 * own.size - from) / along, (0.5 * own.size - from) / along);
            let (start, end) = (one.min(two).max_element(), one.max(two).min_element());
            let is_met = start <= end && end > NEAR_PLANE_M;
            covered += usize::from(is_met);
            wrong += usize::from(is_met != (*value == 0));
        }
        // Pixels on the edge may fall on either side by rounding.
        assert!(wrong * 100 <= covered, "{wrong} of {covered}");
        covered
    }

    #[test]
    fn masks_cover_what_boxes_project_to() {
        let own = |position: [f64; 3], angle: f64| LogBox {
            timestamp: 0,
            world_from_box: RigidPose {
                rotation: DQuat::from_rotation_y(angle) * DQuat::from_rotation_x(0.3),
                translation: position.into(),
            },
            size: DVec3::new(4.0, 1.5, 2.0),
        };
        for lens in [Distortion::None, Distortion::of([-0.2, 0.05, 0.002, -0.001, 0.0])] {
            assert!(check(lens, own([0.5, 0.2, 9.0], 0.4)) > 500);
            // Over the edge of the photo, and partly behind the camera.
            assert!(check(lens, own([4.0, 1.0, 7.0], 1.0)) > 100);
            assert!(check(lens, own([2.2, 0.0, 1.0], 1.4)) > 500);
            // Not seen.
            assert_eq!(check(lens, own([30.0, 0.0, 8.0], 0.0)), 0);
            assert_eq!(check(lens, own([0.0, 0.0, -9.0], 0.0)), 0);
        }
        let photo = camera(Distortion::None).camera(&RigidPose::IDENTITY);
        // A box around the camera says nothing.
        assert_eq!(MaskLens::new(&camera(Distortion::None)).mask(&photo, &[own([0.0; 3], 0.0)], 0.15), None);
    }
}
