//! Depth of a picture from the points of a sweep, without what is hidden from the camera.
//!
//! The lidar stands higher than the cameras, and beside them: it sees over and past things. Such a
//! point falls into the picture of what hides it, below its upper edge, or beside its side edges. A
//! point is hidden if a nearer one lies a little above it in the picture, closer than the distance
//! of two beams. Nearer points below it, and in its row, are the ground before it.

use crate::logs::sweep::LogPoint;
use wm_scene::Camera;

/// Half the width of the window, and its height upwards, radians: 64 beams are 0.4 degrees apart,
/// 32 are 1.3.
const WINDOW_HALF_WIDTH_RAD: f64 = 0.006;
const WINDOW_HEIGHT_RAD: f64 = 0.014;
/// A point is hidden by others nearer than this share of its distance less this margin, m.
const OCCLUSION_RATIO: f64 = 0.9;
const OCCLUSION_MARGIN_M: f64 = 0.3;
/// Nearest view z of a point, m.
const MIN_DEPTH_M: f64 = 0.5;
/// Longest side of a map, px.
const MAX_SIDE_PX: f64 = 8192.0;

/// The points of a lidar in a camera's picture.
pub(super) struct LidarView {
    camera: Camera,
    /// The nearest z of each pixel, m; infinite where there is no point.
    nearest: Vec<f32>,
    /// The points of the picture: x, y, px, and z, m.
    points: Vec<(f64, f64, f64)>,
    /// The window, px.
    window: (i64, i64),
}

/// The size of a depth map of a camera: the picture's shape, at most `most` pixels.
pub(super) fn map_size(camera: &Camera, most: u32) -> (u32, u32) {
    let (width, height) = (f64::from(camera.width), f64::from(camera.height));
    let scale =
        (f64::from(most.max(1)) / (width * height)).sqrt().min(1.0).min(MAX_SIDE_PX / width.max(height));
    let side = |side: f64| (side * scale).round().max(1.0) as u32;
    (side(width), side(height))
}

impl LidarView {
    /// The points in the picture of a camera, which has the size of the map.
    pub(super) fn new(camera: &Camera, points: &[LogPoint]) -> Self {
        let pixels = camera.width as usize * camera.height as usize;
        let mut view = Self {
            camera: *camera,
            nearest: vec![f32::INFINITY; pixels],
            points: Vec::new(),
            window: (0, 0),
        };
        view.window = (
            (WINDOW_HALF_WIDTH_RAD * camera.fx).ceil().min(64.0) as i64,
            (WINDOW_HEIGHT_RAD * camera.fy).ceil().min(64.0) as i64,
        );
        for point in points {
            let Some((x, y, z)) = camera.project(point.position) else { continue };
            if z < MIN_DEPTH_M || !view.has(x, y) {
                continue;
            }
            let nearest = &mut view.nearest[y as usize * camera.width as usize + x as usize];
            *nearest = nearest.min(z as f32);
            view.points.push((x, y, z));
        }
        view
    }

    /// The camera, in the size of the map.
    pub(super) fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Returns true if a point is in the picture, px of the map.
    pub(super) fn has(&self, x: f64, y: f64) -> bool {
        (0.0..f64::from(self.camera.width)).contains(&x) && (0.0..f64::from(self.camera.height)).contains(&y)
    }

    /// Returns true if a nearer point hides one at these px and this z, m.
    pub(super) fn hides(&self, x: f64, y: f64, z: f64) -> bool {
        let limit = (OCCLUSION_RATIO * z - OCCLUSION_MARGIN_M) as f32;
        let (column, row) = (x as i64, y as i64);
        let (width, height) = (i64::from(self.camera.width), i64::from(self.camera.height));
        let rows = (row - self.window.1).max(0)..row.min(height);
        let columns = (column - self.window.0).max(0)..=(column + self.window.0).min(width - 1);
        rows.into_iter().any(|row| {
            let start = (row * width) as usize;
            let line = &self.nearest[start + *columns.start() as usize..=start + *columns.end() as usize];
            line.iter().any(|nearest| *nearest < limit)
        })
    }

    /// View z, m, 0 where there is none, `[H, W]`; `None` if there is none at all. Each point also
    /// fills what is empty around it.
    pub(super) fn depth(&self) -> Option<Vec<f32>> {
        let (width, height) = (self.camera.width as usize, self.camera.height as usize);
        let mut map = vec![f32::INFINITY; width * height];
        let seen: Vec<_> = self.points.iter().filter(|(x, y, z)| !self.hides(*x, *y, *z)).collect();
        if seen.is_empty() {
            return None;
        }
        for (x, y, z) in &seen {
            let own = &mut map[*y as usize * width + *x as usize];
            *own = own.min(*z as f32);
        }
        let own: Vec<bool> = map.iter().map(|z| z.is_finite()).collect();
        for (x, y, z) in seen {
            let (column, row) = (*x as usize, *y as usize);
            for row in row.saturating_sub(1)..(row + 2).min(height) {
                for pixel in row * width + column.saturating_sub(1)..row * width + (column + 2).min(width) {
                    if !own[pixel] {
                        map[pixel] = map[pixel].min(*z as f32);
                    }
                }
            }
        }
        map.iter_mut().filter(|z| z.is_infinite()).for_each(|z| *z = 0.0);
        Some(map)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn point(x: f64, y: f64, z: f64) -> LogPoint {
        LogPoint { position: DVec3::new(x, y, z), range: 10.0, intensity: 0.0, timestamp: 0, moves: false }
    }

    #[test]
    fn what_is_hidden_does_not_show_through() {
        // A camera along y, z up; 1 px is 0.01.
        let camera = Camera {
            width: 100,
            height: 80,
            fx: 100.0,
            fy: 100.0,
            cx: 50.0,
            cy: 40.0,
            ..Camera::looking((100, 80), 60.0, DVec3::ZERO, DVec3::Y, DVec3::Z).unwrap()
        };
        // A sign 10 m away, a wall 40 m away that the lidar sees over its top, and beside it.
        let sign: Vec<LogPoint> =
            (0..40).map(|k| point(0.1 * f64::from(k % 10), 10.0, 0.1 * f64::from(k / 10))).collect();
        let hidden = point(1.2, 40.0, -0.2);
        let free = point(-12.0, 40.0, 0.0);
        let view = LidarView::new(&camera, &[&sign[..], &[hidden, free]].concat());
        let map = view.depth().unwrap();
        let at = |x: usize, y: usize| map[y * 100 + x];
        assert_eq!((at(53, 38), at(20, 40), at(80, 10)), (10.0, 40.0, 0.0));
        assert!(!map.iter().enumerate().any(|(pixel, z)| *z == 40.0 && pixel % 100 > 40));
        // The ground before a wall does not hide it, nor itself.
        let ground: Vec<LogPoint> = (5..60).map(|k| point(0.0, f64::from(k), -1.7)).collect();
        let view = LidarView::new(&camera, &ground);
        assert!(view.points.iter().all(|(x, y, z)| !view.hides(*x, *y, *z)));
        assert_eq!(LidarView::new(&camera, &[]).depth(), None);
        assert_eq!(map_size(&Camera { width: 1600, height: 900, ..camera }, 300_000), (730, 411));
    }
}
