//! A Poisson process in the whole of space, asked for by what a camera sees.
//!
//! Space is cut in cubes. What a cube holds follows from its key alone: points in the order of
//! their thresholds, whose gaps are exponential, so that those below any threshold are a Poisson
//! process of that density.

use super::random::{pcg4d, uniform};
use crate::level::to_level;
use fearless_simd::SimdBase;
use wm_render::hooks::{GROUP, ParticleView};
use wm_render::simd::{Lanes, log2};

/// The cubes of one process.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Cells {
    /// The key of the process.
    pub(crate) key: u32,
    /// Edge of a cube, m.
    pub(crate) edge: f64,
    /// Points per m^3 and threshold of 1.
    pub(crate) density: f64,
    /// Thresholds of its points, from and up to.
    pub(crate) thresholds: [f64; 2],
}

/// Points that a cube holds on average, where that makes no cube too small or too large: cubes
/// cut by the border of the view cost, and so do groups of points that are not filled.
const MEAN_CUBE_POINTS: f64 = 24.0;
/// Shortest and longest edge of a cube.
const CUBE_EDGE_LIMITS_M: [f64; 2] = [0.1, 16.0];

impl Cells {
    /// Cubes for a density, points per m^3 and threshold.
    pub(crate) fn new(key: u32, density: f64, thresholds: [f64; 2]) -> Self {
        let count = density * (thresholds[1] - thresholds[0]);
        let edge =
            (MEAN_CUBE_POINTS / count.max(1e-12)).cbrt().clamp(CUBE_EDGE_LIMITS_M[0], CUBE_EDGE_LIMITS_M[1]);
        Self { key, edge, density, thresholds }
    }

    /// Before the first point of a cube.
    #[inline]
    pub(crate) fn begin(&self) -> Points {
        Points {
            threshold: [0.0; GROUP],
            place: [[0.0; GROUP]; 3],
            count: 0,
            last: self.thresholds[0] as f32,
        }
    }

    /// The next points of a cube, in the order of their thresholds, after those that `points`
    /// holds.
    #[inline(always)]
    pub(crate) fn next<S: Lanes>(&self, simd: S, cell: [i64; 3], points: &mut Points) {
        // Mean gap, of the natural logarithm's opposite and by log2.
        let step = std::f64::consts::LN_2 / (self.density * self.edge * self.edge * self.edge);
        for first in (0..GROUP).step_by(S::N) {
            let number = S::U::from_slice(simd, &LANES[first..first + S::N])
                + S::U::splat(simd, self.key.wrapping_add(points.count));
            // Cubes farther from each other than 2^32 of them are the same.
            let [x, y, z] = cell.map(|index| S::U::splat(simd, index as u32));
            let [gap, place @ ..] = pcg4d(simd, [x, y, z, number]);
            let gap = log2(simd, [uniform(simd, gap)])[0] * (-step as f32);
            gap.store_slice(&mut points.threshold[first..first + S::N]);
            for k in 0..3 {
                uniform(simd, place[k]).store_slice(&mut points.place[k][first..first + S::N]);
            }
        }
        for threshold in &mut points.threshold {
            points.last += *threshold;
            *threshold = points.last;
        }
        points.count += GROUP as u32;
    }

    /// Four more numbers of each of the points that [`Self::next`] gave last, from lane `first` on;
    /// `which` is any number but 0.
    #[inline(always)]
    pub(crate) fn own<S: Lanes>(
        &self,
        simd: S,
        cell: [i64; 3],
        points: &Points,
        first: usize,
        which: u32,
    ) -> [S::U; 4] {
        let number = S::U::from_slice(simd, &LANES[first..first + S::N])
            + S::U::splat(simd, (self.key ^ which << 24).wrapping_add(points.count - GROUP as u32));
        let [x, y, z] = cell.map(|index| S::U::splat(simd, !(index as u32)));
        pcg4d(simd, [number, x, y, z])
    }
}

const LANES: [u32; GROUP] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];

/// Sixteen points of one cube.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct Points {
    /// Thresholds; points whose threshold is beyond the tier's are not part of it.
    pub(crate) threshold: [f32; GROUP],
    /// Positions in their cube, 0-1, one array per axis.
    pub(crate) place: [[f32; GROUP]; 3],
    /// The number of points up to the last of these.
    count: u32,
    /// Threshold of the last point.
    pub(crate) last: f32,
}

/// The view of a camera up to a distance, in level axes and metres from its centre.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ViewFrustum {
    /// Normals of planes through the camera, into the view, length 1: its four sides and the one
    /// that it looks along.
    pub(crate) planes: [[f64; 3]; 5],
    /// The camera's centre, m, where the process stands still.
    pub(crate) center: [f64; 3],
    /// Farthest, m.
    pub(crate) range: f64,
    /// Distance outside the planes at which points still count, m.
    pub(crate) margin: f64,
}

impl ViewFrustum {
    /// The planes of a view; `axes` are the level ones, world axes.
    pub(crate) fn planes(view: &ParticleView, axes: &[[f64; 3]; 3]) -> [[f64; 3]; 5] {
        let turned = |n: [f32; 3]| to_level(axes, n.map(f64::from));
        let [a, b, c, d] = view.sides.map(turned);
        [a, b, c, d, turned(view.rotation[2])]
    }

    /// The numbers of the slices of cubes along the first axis.
    pub(crate) fn slices(&self, edge: f64) -> std::ops::Range<i64> {
        let (low, high) = self.bounds(0, [None, None]);
        let index = |v: f64| ((self.center[0] + v) / edge).floor() as i64;
        if low > high { 0..0 } else { index(low)..index(high) + 1 }
    }

    /// Least and greatest coordinate along an axis of what is within, given intervals of those
    /// before it.
    fn bounds(&self, axis: usize, known: [Option<[f64; 2]>; 2]) -> (f64, f64) {
        let reach = self.range + self.margin;
        // Farthest that the ball goes where the others are nearest to 0.
        let nearest = |interval: [f64; 2]| interval[0].max(0.0) + (-interval[1]).max(0.0);
        let used: f64 = known.iter().flatten().map(|interval| nearest(*interval).powi(2)).sum();
        let most = (reach * reach - used).max(0.0).sqrt();
        let (mut low, mut high) = if used > reach * reach { (1.0, -1.0) } else { (-most, most) };
        for n in &self.planes {
            // n . p >= -margin, with the free axes anywhere in the ball.
            let mut rest = self.margin;
            for k in 0..3 {
                rest += match known.get(k).copied().flatten().filter(|_| k < axis) {
                    Some([from, to]) => (n[k] * from).max(n[k] * to),
                    None if k == axis => 0.0,
                    None => n[k].abs() * reach,
                };
            }
            if n[axis] > 1e-9 {
                low = low.max(-rest / n[axis]);
            } else if n[axis] < -1e-9 {
                high = high.min(-rest / n[axis]);
            } else if rest < 0.0 {
                high = low - 1.0;
            }
        }
        (low, high)
    }

    /// Estimates the cubes that [`Self::each_cell`] visits in all slices, by some of them.
    pub(crate) fn cells(&self, edge: f64) -> f64 {
        const SAMPLE_COUNT: i64 = 16;
        let slices = self.slices(edge);
        let count = slices.end - slices.start;
        let step = (count / SAMPLE_COUNT).max(1);
        let cubes = |low: f64, high: f64| ((high - low) / edge + 1.0).max(0.0);
        let of_slice = |slice: i64| {
            let x = slice as f64 * edge - self.center[0];
            let first = Some([x, x + edge]);
            let (low, high) = self.bounds(1, [first, None]);
            if low > high {
                return 0.0;
            }
            let (bottom, top) = self.bounds(2, [first, Some([low, high])]);
            if bottom > top { 0.0 } else { cubes(low, high) * cubes(bottom, top) }
        };
        slices.step_by(step as usize).map(of_slice).sum::<f64>() * step as f64
    }

    /// Calls `visit` with each cube of a slice that may be within: its indices, and its first
    /// corner from the camera, m.
    pub(crate) fn each_cell(&self, edge: f64, slice: i64, mut visit: impl FnMut([i64; 3], [f64; 3])) {
        let from = |k: usize, index: i64| index as f64 * edge - self.center[k];
        let index = |k: usize, v: f64| ((self.center[k] + v) / edge).floor() as i64;
        let x = from(0, slice);
        let first = Some([x, x + edge]);
        let (low, high) = self.bounds(1, [first, None]);
        if low > high {
            return;
        }
        for column in index(1, low)..=index(1, high) {
            let y = from(1, column);
            let (low, high) = self.bounds(2, [first, Some([y, y + edge])]);
            if low > high {
                continue;
            }
            for layer in index(2, low)..=index(2, high) {
                visit([slice, column, layer], [x, y, from(2, layer)]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use wm_render::dispatch;
    use wm_render::simd::SimdPath;
    use wm_scene::Camera;

    #[test]
    fn cubes_hold_what_their_density_says() {
        let path = SimdPath::available()[0];
        for (tier, ends) in [[0.0, 0.006], [0.006, 0.1], [0.1, 1.5], [1.5, 3.0]].into_iter().enumerate() {
            let cells = Cells::new(5 + tier as u32, 20.0, ends);
            let [low, high] = ends;
            let all: Vec<Vec<f32>> =
                (0..4000).map(|i| dispatch!(path, s => thresholds(s, &cells, [i, -i, 3]))).collect();
            assert!(all.iter().all(|cell| cell.windows(2).all(|pair| pair[0] < pair[1])));
            for share in [0.1, 0.5, 1.0] {
                let most = low + share * (high - low);
                let count = |cell: &Vec<f32>| cell.iter().filter(|t| f64::from(**t) < most).count() as f64;
                let counts: Vec<f64> = all.iter().map(count).collect();
                let wanted = (most - low) * 20.0 * cells.edge.powi(3);
                let mean = counts.iter().sum::<f64>() / 4000.0;
                let variance = counts.iter().map(|c| (c - mean).powi(2)).sum::<f64>() / 4000.0;
                // A Poisson process: mean and variance are equal; four standard errors of 4,000
                // cubes.
                assert!((mean - wanted).abs() < 4.0 * (wanted / 4000.0).sqrt(), "{tier}: {mean} {wanted}");
                assert!((variance / wanted - 1.0).abs() < 0.1, "{tier}: {variance} {wanted}");
            }
        }
    }

    #[inline(always)]
    fn thresholds<S: Lanes>(simd: S, cells: &Cells, cell: [i64; 3]) -> Vec<f32> {
        let (mut points, mut found) = (cells.begin(), Vec::new());
        let most = cells.thresholds[1] as f32;
        while points.last < most {
            cells.next(simd, cell, &mut points);
            found.extend(points.threshold.iter().filter(|t| **t < most));
        }
        found
    }

    #[test]
    fn every_point_in_view_is_in_a_visited_cube() {
        for (eye, towards) in [(DVec3::new(0.3, 0.2, 1.0), DVec3::new(9.0, 4.0, -2.0)), (DVec3::Z, -DVec3::X)]
        {
            let camera = Camera::looking((90, 60), 55.0, eye, eye + towards, DVec3::Z).unwrap();
            let view = ParticleView::new(&camera);
            let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
            let cone = ViewFrustum {
                planes: ViewFrustum::planes(&view, &axes),
                center: [123.4, -56.7, 8.9],
                range: 6.0,
                margin: 0.05,
            };
            let edge = 0.7;
            let mut visited = std::collections::HashSet::new();
            for slice in cone.slices(edge) {
                cone.each_cell(edge, slice, |cell, corner| {
                    assert!((corner[1] + cone.center[1] - cell[1] as f64 * edge).abs() < 1e-9);
                    assert!(visited.insert(cell));
                });
            }
            let (mut seen, mut all) = (0, 0);
            for i in 0..60_000u64 {
                let p = [0, 1, 2].map(|k| 14.0 * wm_base::random::uniform(k, i) - 7.0);
                all += 1;
                let is_near = p.iter().map(|v| v * v).sum::<f64>() < 36.0;
                let Some((x, y, _)) = camera.project(eye + DVec3::from_array(p)).filter(|_| is_near) else {
                    continue;
                };
                if x >= 0.0 && y >= 0.0 && x < 90.0 && y < 60.0 {
                    seen += 1;
                    let cell = [0, 1, 2].map(|k| ((cone.center[k] + p[k]) / edge).floor() as i64);
                    assert!(visited.contains(&cell), "{p:?}");
                }
            }
            let estimate = cone.cells(edge) / visited.len() as f64;
            assert!((0.8..4.0).contains(&estimate), "{estimate} times as many cubes as there are");
            // And not many more: the cubes at the sides of a cone this narrow are about as many as
            // those inside.
            let volume = 14f64.powi(3) * f64::from(seen) / f64::from(all);
            let cubes = visited.len() as f64 * edge.powi(3);
            assert!(cubes < 3.0 * volume, "{cubes} m^3 for {volume}");
        }
    }
}
