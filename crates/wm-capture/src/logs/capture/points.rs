//! Points of all sweeps: without movers, one a voxel, coloured by photos.

use super::depth::LidarView;
use super::photo::Rgb;
use crate::logs::log::DrivingLog;
use crate::logs::sweep::{LogPoint, LogSweep, SweepPoints};
use crate::logs::track::LogBox;
use glam::DVec3;
use std::collections::{BTreeMap, HashMap};
use wm_base::FormatError;
use wm_scene::Camera;
use wm_scene::camera::Distortion;

/// Share by which boxes of movers are enlarged.
pub(super) const BOX_MARGIN_SHARE: f64 = 0.15;
/// Points nearer to the lidar are of the vehicle itself, m.
const MIN_POINT_RANGE_M: f64 = 2.5;

/// Most voxels.
pub(super) const MAX_VOXELS: usize = 20_000_000;
/// The side of the cells in which points are sorted, m.
const SORTING_CELL_M: f64 = 20.0;
/// Colour of what no photo shows.
const UNSEEN_COLOR: [u8; 3] = [128; 3];

/// A sweep without the vehicle itself and without movers.
#[derive(Default)]
pub(super) struct CleanSweep {
    pub(crate) points: Vec<LogPoint>,
    /// Points that are not finite, or too far away.
    pub(crate) unusable: usize,
    /// True if the file has no points at all.
    pub(crate) is_empty: bool,
}

impl CleanSweep {
    pub(super) fn read(log: &DrivingLog, sweep: &LogSweep) -> Result<Self, FormatError> {
        let SweepPoints { mut points, unusable } = sweep.read()?;
        let is_empty = points.is_empty() && unusable == 0;
        let boxes = log.movers_at(sweep.timestamp);
        // Within a sweep boxes move less than by what they are enlarged.
        let squared = |own: &LogBox| (0.5 * (1.0 + BOX_MARGIN_SHARE) * own.size.length()).powi(2);
        let reach: Vec<f64> = boxes.iter().map(squared).collect();
        points.retain(|point| {
            let is_in = |own: &LogBox, reach: f64| {
                point.position.distance_squared(own.world_from_box.translation) <= reach
                    && own.has(point.position, BOX_MARGIN_SHARE)
            };
            let is_moving = || boxes.iter().zip(&reach).any(|(own, reach)| is_in(own, *reach));
            !point.moves && point.range >= MIN_POINT_RANGE_M && !is_moving()
        });
        Ok(Self { points, unusable, is_empty })
    }
}

/// Points of many sweeps, one a voxel: the mean of those that fell into it.
pub(super) struct VoxelCloud {
    side: f64,
    places: HashMap<[i32; 3], u32>,
    /// Sum from the middle of the voxel, m, and count.
    sums: Vec<([i32; 3], [f32; 3], u32)>,
}

impl VoxelCloud {
    pub(super) fn new(side: f64) -> Self {
        let side = if side.is_finite() && side > 1e-4 { side } else { 1e-4 };
        Self { side, places: HashMap::new(), sums: Vec::new() }
    }

    pub(super) fn add(&mut self, sweep: &CleanSweep, farthest: f64) {
        for point in &sweep.points {
            let scaled = point.position / self.side;
            // Points beyond 2^31 voxels from the origin have no voxel; no log is 100,000 km long.
            let is_usable = point.range <= farthest && scaled.abs().max_element() < f64::from(i32::MAX);
            if !is_usable {
                continue;
            }
            let key = scaled.floor().to_array().map(|v| v as i32);
            let next = self.sums.len() as u32;
            let place = match self.places.get(&key) {
                Some(place) => *place,
                None if self.is_full() => continue,
                None => {
                    self.places.insert(key, next);
                    self.sums.push((key, [0.0; 3], 0));
                    next
                }
            };
            let (_, sum, count) = &mut self.sums[place as usize];
            let off = (scaled - middle(key)) * self.side;
            for (sum, off) in sum.iter_mut().zip(off.to_array()) {
                *sum += off as f32;
            }
            *count += 1;
        }
    }

    pub(super) fn is_full(&self) -> bool {
        self.sums.len() >= MAX_VOXELS
    }

    /// At most `most` points, thinned out evenly, in the order in which they were first seen.
    pub(super) fn points(self, most: usize) -> ColoredPoints {
        let all = self.sums.len();
        let kept = |index: usize| {
            let share = |index: usize| index as u128 * most.min(all) as u128 / all.max(1) as u128;
            share(index) != share(index + 1)
        };
        let voxels = self.sums.iter().enumerate().filter(|(index, _)| kept(*index));
        let positions = voxels.map(|(_, (key, sum, count))| {
            middle(*key) * self.side + DVec3::from(sum.map(f64::from)) / f64::from(*count)
        });
        ColoredPoints::new(positions.collect())
    }
}

fn middle(key: [i32; 3]) -> DVec3 {
    DVec3::from(key.map(f64::from)) + 0.5
}

/// Points with colours, each of the nearest camera that sees it.
pub(super) struct ColoredPoints {
    pub(crate) positions: Vec<DVec3>,
    pub(crate) colors: Vec<[u8; 3]>,
    /// Distance of that camera, m; infinite where none has seen it.
    distances: Vec<f32>,
    /// Points by cell.
    cells: BTreeMap<[i64; 3], Vec<u32>>,
}

impl ColoredPoints {
    fn new(positions: Vec<DVec3>) -> Self {
        let mut cells = BTreeMap::<[i64; 3], Vec<u32>>::new();
        for (index, position) in positions.iter().enumerate() {
            let key = (*position / SORTING_CELL_M).floor().to_array().map(|v| v as i64);
            cells.entry(key).or_default().push(index as u32);
        }
        let count = positions.len();
        Self { positions, colors: vec![UNSEEN_COLOR; count], distances: vec![f32::INFINITY; count], cells }
    }

    pub(super) fn len(&self) -> usize {
        self.positions.len()
    }

    /// Colours the points that a photo shows, are not hidden and that no nearer camera has seen.
    pub(super) fn paint(
        &mut self,
        photo: &Camera,
        distortion: Distortion,
        view: &LidarView,
        rgb: &Rgb,
        mask: Option<&[u8]>,
        farthest: f64,
    ) {
        let center = photo.center();
        // Half the diagonal of a cell.
        let half = 0.5 * SORTING_CELL_M * 3f64.sqrt();
        for (key, members) in &self.cells {
            let middle = (DVec3::from(key.map(|v| v as f64)) + 0.5) * SORTING_CELL_M;
            let z = photo.viewmat.transform_point3(middle).z;
            if middle.distance(center) > farthest + half || z < -half {
                continue;
            }
            for index in members {
                let index = *index as usize;
                let position = self.positions[index];
                let distance = position.distance(center) as f32;
                if distance >= self.distances[index] || f64::from(distance) > farthest {
                    continue;
                }
                let Some((x, y, z)) = view.camera().project(position) else { continue };
                if z < 0.5 || !view.has(x, y) || view.hides(x, y, z) {
                    continue;
                }
                let local = photo.viewmat.transform_point3(position);
                let (u, v) = distortion.distort(local.x / local.z, local.y / local.z);
                let (u, v) = (photo.fx * u + photo.cx, photo.fy * v + photo.cy);
                let Some(pixel) = rgb.pixel(u, v) else { continue };
                if mask.is_some_and(|mask| mask.get(pixel) == Some(&0)) {
                    continue;
                }
                self.colors[index] = rgb.at(pixel);
                self.distances[index] = distance;
            }
        }
    }

    /// Drops the points that no photo shows; returns their number.
    pub(super) fn drop_unseen(&mut self) -> usize {
        let before = self.len();
        let seen: Vec<usize> = (0..before).filter(|index| self.distances[*index].is_finite()).collect();
        self.positions = seen.iter().map(|index| self.positions[*index]).collect();
        self.colors = seen.iter().map(|index| self.colors[*index]).collect();
        self.distances = seen.iter().map(|index| self.distances[*index]).collect();
        self.cells.clear();
        before - self.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x: f64) -> LogPoint {
        let position = DVec3::new(x, 1.0, -1.0);
        LogPoint { position, range: 5.0, intensity: 0.5, timestamp: 0, moves: false }
    }

    fn thinned(points: Vec<LogPoint>, most: usize) -> ColoredPoints {
        let mut cloud = VoxelCloud::new(0.07);
        cloud.add(&CleanSweep { points, ..CleanSweep::default() }, 100.0);
        cloud.points(most)
    }

    #[test]
    fn a_voxel_keeps_the_mean() {
        let points = vec![at(0.01), at(0.03), at(0.08), at(-0.01), LogPoint { range: 200.0, ..at(7.0) }];
        let points = thinned(points, 10);
        let x: Vec<f64> = points.positions.iter().map(|p| (p.x * 1e6).round() / 1e6).collect();
        assert_eq!(x, [0.02, 0.08, -0.01]);
        assert!((points.positions[0].y - 1.0).abs() < 1e-6);
    }

    #[test]
    fn too_many_points_are_thinned_evenly() {
        let points = thinned((0..1000).map(|k| at(f64::from(k))).collect(), 100);
        assert_eq!(points.len(), 100);
        let steps = points.positions.windows(2).map(|pair| pair[1].x - pair[0].x);
        assert!(steps.into_iter().all(|step| (step - 10.0).abs() < 0.01));
    }
}
