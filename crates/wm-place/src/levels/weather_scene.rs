//! The splats that weather is prepared with: few enough to work on as a whole, finest about where
//! the cameras are.

use super::shot::cameras_around;
use super::stream::{LevelStream, RunId};
use glam::DVec3;
use rayon::prelude::*;
use std::ops::Range;
use wm_base::kd_tree::KdTree;
use wm_scene::{Camera, Splats};

/// Width of a cell of the ground, m: cameras in one cell share the splats that weather is prepared
/// with.
const GROUND_CELL_M: f64 = 32.0;
/// Maximum number of views of a camera's path.
const MAX_PATH_VIEWS: usize = 12;

/// The place that weather is prepared about: the line along which the cameras are, by its ends
/// (world, scene units).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct WeatherFocus {
    pub(crate) path: [[f64; 3]; 2],
}

impl WeatherFocus {
    /// About the cell of the ground that a camera is in, so that cameras of one cell share what is
    /// prepared.
    pub(crate) fn cell_of(camera: &Camera, up: DVec3, metres_per_unit: f64) -> Self {
        let cell = GROUND_CELL_M / metres_per_unit;
        let east = up.any_orthonormal_vector();
        let north = up.cross(east);
        let center = camera.center();
        let middle = |axis: DVec3| ((center.dot(axis) / cell).floor() + 0.5) * cell * axis;
        // Storeys of 8 m: what is on a roof is not seen from the street.
        let storey = cell / 4.0;
        let height = ((center.dot(up) / storey).floor() + 0.5) * storey * up;
        Self { path: [(middle(east) + middle(north) + height).to_array(); 2] }
    }

    /// About a path of cameras, at least one.
    pub(crate) fn along(cameras: &[Camera]) -> Self {
        let centers: Vec<DVec3> = cameras.iter().map(Camera::center).collect();
        let first = centers.first().copied().unwrap_or_default();
        let farthest = |from: DVec3| {
            let far = centers.iter().max_by(|a, b| a.distance(from).total_cmp(&b.distance(from)));
            far.copied().unwrap_or(from)
        };
        let end = farthest(first);
        Self { path: [farthest(end), end].map(|end| end.to_array()) }
    }

    /// Cameras that look to all sides from along the path.
    pub(crate) fn cameras(&self, metres_per_unit: f64) -> Vec<Camera> {
        let [from, to] = self.path.map(DVec3::from_array);
        let stops = ((from.distance(to) * metres_per_unit / GROUND_CELL_M).ceil() as usize + 1)
            .clamp(1, MAX_PATH_VIEWS);
        let at = |stop: usize| from.lerp(to, stop as f64 / (stops - 1).max(1) as f64);
        (0..stops).flat_map(|stop| cameras_around(at(stop))).collect()
    }
}

/// The splats that weather is prepared with, and the leaf that each is of.
pub(crate) struct WeatherScene {
    pub(crate) splats: Splats,
    /// The runs of its leaves, in order, and their parts of the splats. After them come the splats
    /// that are always drawn.
    pub(crate) parts: Vec<(RunId, Range<usize>)>,
}

/// The splats of a drawn run in the terms of the weather's: for each the nearest of the same leaf.
pub(crate) fn nearest_of(means: &[[f32; 3]], part: &[[f32; 3]], first: usize) -> Vec<u32> {
    let places: Vec<[f64; 3]> = part.iter().map(|mean| mean.map(f64::from)).collect();
    let tree = KdTree::new(&places);
    means
        .par_iter()
        .map(|mean| {
            let at = mean.map(f64::from);
            let found = tree.nearest(&at, 1);
            first as u32 + found.first().map_or(0, |near| near.index)
        })
        .collect()
}

impl LevelStream {
    /// Reads runs, one of a leaf, as one set of splats without colours that depend on the
    /// direction, and `always` after them.
    ///
    /// # Errors
    /// As of [`LevelStream::hold`].
    pub(crate) fn weather_scene(
        &mut self,
        runs: &[RunId],
        always: Option<&Splats>,
    ) -> crate::Result<WeatherScene> {
        let read = self.read_runs(runs)?;
        let mut scene = WeatherScene { splats: Splats::default(), parts: Vec::new() };
        for (id, mut splats) in read {
            splats.limit_sh(0);
            let first = scene.splats.len();
            scene.parts.push((id, first..first + splats.len()));
            scene.splats.append(&splats);
        }
        if let Some(always) = always {
            scene.splats.append(always);
        }
        Ok(scene)
    }
}
