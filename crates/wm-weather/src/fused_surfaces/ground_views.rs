//! The ground that views show: what they see of floors and of the ground field is put onto them.

use super::floor::{FLOOR_THICKNESS, FloorPlane};
use super::ground_field::{GroundField, MAX_GROUND_DISTANCE_M};
use super::photo_view::PhotoView;
use crate::level::level_matrix;
use crate::threads::map;
use glam::DVec3;
use std::sync::Arc;

/// Distance from a camera to which floors are examined, in those.
const EXAMINED_REACH: f64 = 5.0;
/// Share of the pixels that should show the floor but show what is below it, above which a training
/// has lost the floor.
const LOST_FLOOR_SHARE: f64 = 0.4;
/// Pixels from one point to the next along rows and columns: of most ground, and of ground whose
/// pixels are no farther apart than this, m.
const PIXEL_STRIDES: [usize; 2] = [2, 4];
const DENSE_SPACING_M: f64 = 0.1;
/// Least cosine between a point's normal and up.
const MIN_GROUND_COSINE: f64 = 0.75;
/// Least weight of all points of a ground, and the weight of one under a camera, which is exact.
const MIN_GROUND_WEIGHT: f32 = 100.0;
const FOOT_WEIGHT: f32 = 16.0;

impl FloorPlane {
    /// Returns true if most of `views` that should show it see through it: a training has lost it.
    #[must_use]
    pub fn is_lost(&self, views: &[PhotoView]) -> bool {
        let (mut there, mut below) = (0, 0);
        for view in views {
            let (center, forward) = (view.camera.center(), view.camera.forward());
            for (ray, depth) in view.rays().zip(&view.depth) {
                let Some((way, _)) = self.met(center, ray) else { continue };
                let off = f64::from(*depth) / (way * ray.dot(forward)) - 1.0;
                below += u64::from(off > FLOOR_THICKNESS || *depth == 0.0);
                there += u64::from(off.abs() <= FLOOR_THICKNESS && *depth > 0.0);
            }
        }
        below as f64 > LOST_FLOOR_SHARE * (there + below) as f64
    }
}

impl PhotoView {
    /// [`PhotoView::stop_at`] of all views.
    #[must_use]
    pub fn stopped_at(views: &[Self], floors: &[FloorPlane]) -> Vec<Self> {
        map(views.len(), |index| {
            let mut view = views[index].clone();
            view.stop_at(floors);
            view
        })
    }

    /// Brings what is seen below the floors of a walk onto them, along its ray, what is not there
    /// at all, and what is a little above.
    pub(crate) fn stop_at(&mut self, floors: &[FloorPlane]) {
        let (center, forward) = (self.camera.center(), self.camera.forward());
        let is_near = |floor: &&FloorPlane| {
            let off = floor.point - center;
            off.length() < EXAMINED_REACH * floor.reach && off.dot(forward) > -floor.reach
        };
        self.floors = floors.iter().filter(is_near).copied().collect();
        self.on = vec![0; self.depth.len()];
        if self.floors.is_empty() {
            return;
        }
        let rays: Vec<DVec3> = self.rays().collect();
        for (pixel, ray) in rays.into_iter().enumerate() {
            let stops = (1..).zip(&self.floors).filter_map(|(k, floor)| Some((k, floor.met(center, ray)?)));
            let Some((k, (way, slab))) = stops.min_by(|a, b| a.1.0.total_cmp(&b.1.0)) else { continue };
            let (depth, stop) = (&mut self.depth[pixel], way * ray.dot(forward));
            if *depth == 0.0 || f64::from(*depth) > stop * (1.0 - slab) {
                *depth = stop as f32;
                self.on[pixel] = k;
            }
        }
    }
}

impl GroundField {
    /// Puts what views show of the ground at a grazing angle onto the ground that all of them show.
    #[must_use]
    pub fn snap(views: &[PhotoView], up: [f64; 3], metres_per_unit: f64) -> Vec<PhotoView> {
        let Some(field) = Self::new(views, up, metres_per_unit) else { return views.to_vec() };
        let field = Arc::new(field);
        map(views.len(), |index| views[index].clone().snapped_to(&field))
    }

    /// Builds the field from what cameras see; `None` where they see next to no level surface.
    /// Under cameras that were carried over it at one height it is that far below them.
    fn new(views: &[PhotoView], up: [f64; 3], metres_per_unit: f64) -> Option<Self> {
        let level = level_matrix(up);
        let cameras: Vec<DVec3> =
            views.iter().map(|view| level * view.camera.center() * metres_per_unit).collect();
        let middle = cameras.iter().sum::<DVec3>() / cameras.len().max(1) as f64;
        let found = map(views.len(), |index| {
            let mut points = Vec::new();
            let stride = |apart: f64| PIXEL_STRIDES[usize::from(apart * metres_per_unit < DENSE_SPACING_M)];
            views[index].each_level_point(
                stride,
                DVec3::from_array(up),
                MIN_GROUND_COSINE,
                |point, stride| {
                    let off = level * point * metres_per_unit - middle;
                    if off.truncate().length() < MAX_GROUND_DISTANCE_M {
                        // It stands for those that are left out.
                        let weight = (stride / PIXEL_STRIDES[0]).pow(2) as f32;
                        points.push((off.as_vec3().to_array(), weight));
                    }
                },
            );
            points
        });
        let mut points: Vec<([f32; 3], f32)> = found.concat();
        if points.iter().map(|(_, weight)| weight).sum::<f32>() < MIN_GROUND_WEIGHT {
            return None;
        }
        let field = Self::fit(level, metres_per_unit, middle, &points);
        let Some(height) = field.carried_at(&cameras) else { return Some(field) };
        let feet = cameras.iter().map(|camera| *camera - middle - DVec3::new(0.0, 0.0, height));
        points.extend(feet.map(|foot| (foot.as_vec3().to_array(), FOOT_WEIGHT)));
        let mut field = Self::fit(level, metres_per_unit, middle, &points);
        field.is_path = true;
        Some(field)
    }
}
