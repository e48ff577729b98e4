//! Projection of the points of a tilted glass into a camera's picture, and back.

use super::glass::Glass;
use wm_scene::Camera;

/// Farthest part of the glass that counts, distances: beyond it a tilted plane is no windscreen any
/// more.
const MAX_GLASS_DISTANCE: f64 = 3.0;

/// A glass as a camera sees it. Points of it are metres from the point on the view's axis, to the
/// right and down along it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct GlassView {
    distance: f64,
    sin: f64,
    cos: f64,
    focal: [f64; 2],
    principal: [f64; 2],
    /// Least and greatest point that is in the picture, m.
    pub(crate) bounds: [[f64; 2]; 2],
}

impl GlassView {
    /// The glass in front of a camera.
    pub(crate) fn new(glass: &Glass, camera: &Camera) -> Self {
        let (sin, cos) = glass.tilt.sin_cos();
        let mut view = Self {
            distance: glass.distance,
            sin,
            cos,
            focal: [camera.fx, camera.fy],
            principal: [camera.cx, camera.cy],
            bounds: [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]],
        };
        let (width, height) = (f64::from(camera.width), f64::from(camera.height));
        for x in [0.0, width] {
            for y in [0.0, height] {
                let point = view.point(x, y);
                for k in 0..2 {
                    view.bounds[0][k] = view.bounds[0][k].min(point[k]);
                    view.bounds[1][k] = view.bounds[1][k].max(point[k]);
                }
            }
        }
        view
    }

    /// Returns this view, bounded to the part of the glass where a drop of `radius` metres is at
    /// least `pixels` wide in the picture; `None` if there is no such part.
    pub(crate) fn part_with(&self, radius: f64, pixels: f64, camera: &Camera) -> Option<Self> {
        // Beyond this depth drops are smaller.
        let deepest = radius * self.focal[0] / pixels;
        let mut part = *self;
        let height = (deepest - self.distance) / self.sin;
        if self.sin > 0.0 {
            part.bounds[1][1] = part.bounds[1][1].min(height);
        } else if self.sin < 0.0 {
            part.bounds[0][1] = part.bounds[0][1].max(height);
        } else if deepest < self.distance {
            return None;
        }
        let edge = |x: f64| deepest * (x - self.principal[0]) / self.focal[0];
        part.bounds[0][0] = part.bounds[0][0].max(edge(0.0).min(0.0));
        part.bounds[1][0] = part.bounds[1][0].min(edge(f64::from(camera.width)).max(0.0));
        let [low, high] = part.bounds;
        (low[0] < high[0] && low[1] < high[1]).then_some(part)
    }

    /// The point of the glass at a picture point, px.
    pub(crate) fn point(&self, x: f64, y: f64) -> [f64; 2] {
        let ray = [(x - self.principal[0]) / self.focal[0], (y - self.principal[1]) / self.focal[1]];
        let far = self.cos / (self.cos - ray[1] * self.sin).max(self.cos / MAX_GLASS_DISTANCE);
        let z = self.distance * far;
        [z * ray[0], z * ray[1] / self.cos]
    }

    /// The picture point of a point of the glass, px, and pixels a metre along both axes there.
    #[inline]
    pub(crate) fn project(&self, point: [f64; 2]) -> ([f64; 2], [f64; 2]) {
        let [x, y] = point;
        let z = (self.distance + y * self.sin).max(0.05 * self.distance);
        let across = self.focal[0] / z;
        let along = self.focal[1] * self.cos * self.distance / (z * z);
        let point = [across * x + self.principal[0], self.focal[1] * y * self.cos / z + self.principal[1]];
        (point, [across, along])
    }
}
