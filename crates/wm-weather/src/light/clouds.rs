//! Shadows of broken clouds that drift over a place.
//!
//! The field is a sum of waves over the level ground, of lengths of 0.5 to 2 km and random
//! directions and phases, so that its values are normally distributed; where it is above the
//! quantile of the cloud cover there is a cloud. The shadow of a point is that of the field where
//! the ray to the sun meets the clouds' height. It is a function of the seed and of how far the air
//! has come.

use crate::level::{level_axes, to_level};
use crate::optics::Site;
use glam::Vec3;
use std::f64::consts::TAU;
use wm_base::random::uniform;

const WAVE_COUNT: u64 = 24;
const WAVE_LENGTHS_M: [f64; 2] = [500.0, 2_000.0];
const CLOUD_HEIGHT_M: f64 = 1_000.0;
/// Half the width of a shadow's edge, in standard deviations of the field: some 14 m where it is
/// steep.
const EDGE_SIGMAS: f64 = 0.07;
/// Spacing of the table, m, and its nodes along a side.
const NODE_SPACING_M: f64 = 8.0;
const TABLE_SIDE_NODES: i64 = 65;

/// The share of the sun's beam that clouds let through, about a camera.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct CloudShadows {
    /// Rows and columns of [`TABLE_SIDE_NODES`] by the place that the sun's ray has at the height
    /// of 0, along the level axes; the spacing is whole, so that a node has the same value in any
    /// table that holds it.
    table: Vec<f32>,
    /// Columns and rows, from world axes in scene units.
    axes: [Vec3; 2],
    start: [f32; 2],
    /// The share outside of the table.
    mean: f32,
}

impl CloudShadows {
    /// Builds the shadows of clouds that cover the share `clouds` (0-1) of the sky, under a sun
    /// towards `sun` (world axes, length 1), about the point `center` (world axes, scene units).
    /// The air has come as far as `drift`, m, along the level axes.
    pub(crate) fn new(
        clouds: f64,
        sun: [f64; 3],
        drift: [f64; 2],
        center: [f64; 3],
        seed: u64,
        site: &Site,
    ) -> Self {
        let level = level_axes(site.up);
        let [x, y, z] = to_level(&level, sun);
        let z = z.max(0.05);
        // Along the ray to the height of the ground: what moves the shadow of a point.
        let slide = [x / z, y / z];
        let axis = |k: usize| -> Vec3 {
            let axis: [f64; 3] = std::array::from_fn(|i| {
                (level[k][i] - slide[k] * level[2][i]) * site.metres_per_unit / NODE_SPACING_M
            });
            Vec3::from_array(axis.map(|v| v as f32))
        };
        let axes = [axis(0), axis(1)];
        let raise = slide.map(|slide| slide * site.ground * site.metres_per_unit / NODE_SPACING_M);
        let middle = Vec3::from_array(center.map(|v| v as f32));
        let first: [i64; 2] = std::array::from_fn(|k| {
            (f64::from(axes[k].dot(middle)) + raise[k]).floor() as i64 - TABLE_SIDE_NODES / 2
        });
        let waves = waves(seed);
        let threshold = quantile(1.0 - clouds);
        let table = (0..TABLE_SIDE_NODES * TABLE_SIDE_NODES)
            .map(|at| {
                let node = [at % TABLE_SIDE_NODES + first[0], at / TABLE_SIDE_NODES + first[1]];
                let [u, v] = [0, 1]
                    .map(|k: usize| node[k] as f64 * NODE_SPACING_M + slide[k] * CLOUD_HEIGHT_M - drift[k]);
                let above = (noise(&waves, [u, v]) - threshold) / EDGE_SIGMAS;
                let share = (0.5 - 0.5 * above).clamp(0.0, 1.0);
                (share * share * (3.0 - 2.0 * share)) as f32
            })
            .collect();
        let start = std::array::from_fn(|k| (raise[k] - first[k] as f64) as f32);
        Self { table, axes, start, mean: (1.0 - clouds) as f32 }
    }

    /// The share of the beam that reaches a point (world axes, scene units), 0-1.
    #[inline]
    pub(crate) fn open(&self, point: Vec3) -> f32 {
        let [u, v] = [0, 1].map(|k: usize| self.axes[k].dot(point) + self.start[k]);
        let last = (TABLE_SIDE_NODES - 1) as f32;
        let is_known = u >= 0.0 && v >= 0.0 && u < last && v < last;
        if !is_known {
            return self.mean;
        }
        let (column, row) = (u as usize, v as usize);
        let (s, t) = (u - column as f32, v - row as f32);
        let at = |x: usize, y: usize| self.table[(row + y) * TABLE_SIDE_NODES as usize + column + x];
        let mix = |a: f32, b: f32, share: f32| a + (b - a) * share;
        mix(mix(at(0, 0), at(1, 0), s), mix(at(0, 1), at(1, 1), s), t)
    }
}

/// Wave vectors, rad/m, and phases.
fn waves(seed: u64) -> Vec<([f64; 2], f64)> {
    let wave = |index: u64| {
        let at = |k: u64| uniform(seed ^ 0xc10d_5ade, 3 * index + k);
        let length = WAVE_LENGTHS_M[0] * (WAVE_LENGTHS_M[1] / WAVE_LENGTHS_M[0]).powf(at(0));
        let (sin, cos) = (TAU * at(1)).sin_cos();
        ([cos, sin].map(|v| v * TAU / length), TAU * at(2))
    };
    (0..WAVE_COUNT).map(wave).collect()
}

/// Value of the noise of waves at a place, m: mean 0, variance 1.
fn noise(waves: &[([f64; 2], f64)], point: [f64; 2]) -> f64 {
    let [x, y] = point;
    let sum: f64 = waves.iter().map(|([a, b], phase)| (a * x + b * y + phase).cos()).sum();
    sum * (2.0 / WAVE_COUNT as f64).sqrt()
}

/// The quantile of the normal distribution.
fn quantile(share: f64) -> f64 {
    let (mut low, mut high) = (-4.0, 4.0);
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        if normal_share(middle) < share { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// The share of the normal distribution below a value (Abramowitz and Stegun 26.2.17, within 1e-7).
fn normal_share(value: f64) -> f64 {
    let t = 1.0 / (1.0 + 0.231_641_9 * value.abs());
    let density = (-0.5 * value * value).exp() / TAU.sqrt();
    let terms = [0.319_381_530, -0.356_563_782, 1.781_477_937, -1.821_255_978, 1.330_274_429];
    let tail = density * terms.iter().rev().fold(0.0, |sum, term| (sum + term) * t);
    if value > 0.0 { 1.0 - tail } else { tail }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cover_is_the_share_of_the_ground_in_shadow() {
        for clouds in [0.2, 0.5, 0.8] {
            let (mut sum, mut count) = (0.0, 0.0);
            for step in 0..60 {
                let center = [1_100.0 * f64::from(step % 8), 900.0 * f64::from(step / 8), 0.0];
                let shadows = CloudShadows::new(
                    clouds,
                    [0.0, 0.6, 0.8],
                    [0.0; 2],
                    center,
                    u64::from(step as u32 % 5),
                    &Site::PLAIN,
                );
                sum += shadows.table.iter().map(|v| f64::from(*v)).sum::<f64>();
                count += shadows.table.len() as f64;
            }
            assert!((sum / count - (1.0 - clouds)).abs() < 0.08, "{clouds}: {}", sum / count);
        }
    }

    /// A shadow is where it was, moved by the wind; a point on a tower has that of the ground
    /// behind it; and tables about two cameras agree.
    #[test]
    fn shadows_drift_with_the_air_and_slant_with_the_sun() {
        let make = |drift: [f64; 2], center: [f64; 3]| {
            CloudShadows::new(0.5, [0.6, 0.0, 0.8], drift, center, 3, &Site::PLAIN)
        };
        let (now, later) = (make([0.0; 2], [0.0; 3]), make([80.0, 0.0], [0.0; 3]));
        for x in -10..10 {
            let x = 8.0 * x as f32;
            let here = now.open(Vec3::new(x, 16.0, 0.0));
            assert!((later.open(Vec3::new(x + 80.0, 16.0, 0.0)) - here).abs() < 1e-4);
            assert!((now.open(Vec3::new(x + 15.0, 16.0, 20.0)) - here).abs() < 1e-4);
            assert_eq!(make([0.0; 2], [50.0, -30.0, 4.0]).open(Vec3::new(x, 16.0, 0.0)), here);
        }
    }

    #[test]
    fn quantiles_are_those_of_tables() {
        for (share, value) in [(0.5, 0.0), (0.841_345, 1.0), (0.025, -1.959_964)] {
            assert!((quantile(share) - value).abs() < 1e-4, "{share}");
        }
    }
}
