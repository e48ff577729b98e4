//! The part of a picture that a box covers.

use glam::DVec3;
use wm_scene::Camera;

/// Returns the area that a box covers in a camera's picture, px; the whole picture if the eye is
/// inside, 0 if the box is not seen.
///
/// Things in front of the box are not known. The area is exact but for the near plane, which cuts
/// off what is behind it.
pub(crate) fn coverage(low: [f32; 3], high: [f32; 3], camera: &Camera) -> f64 {
    let whole = f64::from(camera.width) * f64::from(camera.height);
    let (low, high) = (low.map(f64::from), high.map(f64::from));
    let eye = camera.center().to_array();
    let is_around = |axis: usize| (low[axis] - camera.near..=high[axis] + camera.near).contains(&eye[axis]);
    let has_bounds = low.iter().chain(&high).all(|v| v.is_finite());
    if !has_bounds || (0..3).all(is_around) {
        return whole;
    }
    let corners: [DVec3; 8] = std::array::from_fn(|corner| {
        let at = |axis: usize| if corner >> axis & 1 == 0 { low[axis] } else { high[axis] };
        camera.viewmat.transform_point3(DVec3::new(at(0), at(1), at(2)))
    });
    let planes = Planes::of(camera);
    let mut outside = [0_u32; 8];
    for (mask, corner) in outside.iter_mut().zip(&corners) {
        *mask = planes.outside(*corner);
    }
    if outside.iter().fold(u32::MAX, |all, mask| all & mask) != 0 {
        return 0.0;
    }
    let cut = outside.iter().fold(0, |any, mask| any | mask);
    // The faces that are turned to the eye do not hide each other.
    let mut area = 0.0;
    for axis in 0..3 {
        let side = if eye[axis] < low[axis] {
            0
        } else if eye[axis] > high[axis] {
            1 << axis
        } else {
            continue;
        };
        let (a, b) = (1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3));
        let face = [side, side | a, side | a | b, side | b].map(|corner| corners[corner]);
        area += planes.area(&face, cut);
    }
    area.min(whole)
}

/// The planes that bound what a camera sees, in its axes: near, left, right, top, bottom. Inside is
/// 0 and above.
struct Planes {
    planes: [(DVec3, f64); 5],
    focal: f64,
}

impl Planes {
    fn of(camera: &Camera) -> Self {
        let Camera { fx, fy, cx, cy, .. } = *camera;
        let (width, height) = (f64::from(camera.width), f64::from(camera.height));
        Self {
            planes: [
                (DVec3::Z, -camera.near),
                (DVec3::new(fx, 0.0, cx), 0.0),
                (DVec3::new(-fx, 0.0, width - cx), 0.0),
                (DVec3::new(0.0, fy, cy), 0.0),
                (DVec3::new(0.0, -fy, height - cy), 0.0),
            ],
            focal: fx * fy,
        }
    }

    /// The planes that a point is outside of, a bit each.
    fn outside(&self, point: DVec3) -> u32 {
        let is_out = |(normal, offset): &(DVec3, f64)| normal.dot(point) + offset < 0.0;
        self.planes.iter().enumerate().map(|(bit, plane)| u32::from(is_out(plane)) << bit).sum()
    }

    /// The area of a convex polygon in the picture, cut by the planes that have a bit in `cut`, px.
    fn area(&self, face: &[DVec3; 4], cut: u32) -> f64 {
        // Each plane adds at most one corner.
        let (mut polygon, mut count) = ([DVec3::ZERO; 9], 4);
        polygon[..4].copy_from_slice(face);
        for (bit, (normal, offset)) in self.planes.iter().enumerate() {
            if cut >> bit & 1 == 0 || count == 0 {
                continue;
            }
            let (mut kept, mut left) = ([DVec3::ZERO; 9], 0);
            let mut before = polygon[count - 1];
            let mut above = normal.dot(before) + offset;
            for point in &polygon[..count] {
                let here = normal.dot(*point) + offset;
                if (here >= 0.0) != (above >= 0.0) && left < kept.len() {
                    kept[left] = before.lerp(*point, above / (above - here));
                    left += 1;
                }
                if here >= 0.0 && left < kept.len() {
                    kept[left] = *point;
                    left += 1;
                }
                (before, above) = (*point, here);
            }
            (polygon, count) = (kept, left);
        }
        let flat = |p: DVec3| (p.x / p.z, p.y / p.z);
        let mut twice = 0.0;
        for i in 0..count {
            let (a, b) = (flat(polygon[i]), flat(polygon[(i + 1) % count]));
            twice += a.0 * b.1 - b.0 * a.1;
        }
        let area = (0.5 * twice * self.focal).abs();
        if area.is_finite() { area } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        Camera::looking((400, 200), 60.0, DVec3::new(0.0, -10.0, 0.0), DVec3::ZERO, DVec3::Z).unwrap()
    }

    /// Counts the pixels whose rays hit the box.
    fn counted(low: [f32; 3], high: [f32; 3], camera: &Camera) -> f64 {
        let eye = camera.center();
        let mut hits = 0.0;
        for y in 0..camera.height {
            for x in 0..camera.width {
                let ray = camera.ray(f64::from(x) + 0.5, f64::from(y) + 0.5);
                let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
                for axis in 0..3 {
                    let [a, b] = [low, high].map(|side| (f64::from(side[axis]) - eye[axis]) / ray[axis]);
                    (enter, leave) = (enter.max(a.min(b)), leave.min(a.max(b)));
                }
                hits += f64::from(u8::from(enter <= leave));
            }
        }
        hits
    }

    #[test]
    fn the_area_is_that_of_the_pixels() {
        let camera = camera();
        for (low, high) in [
            ([-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]),
            ([2.0, -3.0, 1.0], [30.0, 20.0, 4.0]),
            ([-50.0, 5.0, -2.0], [50.0, 6.0, -1.0]),
            // Beside the eye and cut by the near plane.
            ([1.0, -14.0, -1.0], [2.0, 3.0, 1.0]),
            ([-90.0, -90.0, -3.0], [90.0, 90.0, -2.0]),
        ] {
            let (area, pixels) = (coverage(low, high, &camera), counted(low, high, &camera));
            assert!((area - pixels).abs() < 0.01 * pixels + 100.0, "{low:?}: {area} {pixels}");
        }
    }

    #[test]
    fn boxes_behind_beside_around_and_without_bounds() {
        let camera = camera();
        assert_eq!(coverage([-1.0, -30.0, -1.0], [1.0, -20.0, 1.0], &camera), 0.0);
        assert_eq!(coverage([50.0, 0.0, 0.0], [51.0, 1.0, 1.0], &camera), 0.0);
        assert_eq!(coverage([-1.0, -11.0, -1.0], [1.0, -9.0, 1.0], &camera), 80_000.0);
        assert_eq!(coverage([f32::NEG_INFINITY; 3], [f32::INFINITY; 3], &camera), 80_000.0);
        assert_eq!(coverage([f32::NAN; 3], [f32::NAN; 3], &camera), 80_000.0);
    }
}
