//! Fewer occluders for coarse maps: those of a cube become one.

use super::grid::axes_of;
use super::map::{FloaterRule, ShelterOptions};
use super::occluder::Occluder;
use super::occluders::Occluders;
use crate::level::dot;
use crate::point_grid::PlaceMap;
use std::f64::consts::TAU;

/// Factor on the widths of what was merged: Gaussians of cubes side by side then close as their
/// splats did.
const WIDTH_FACTOR: f64 = 1.5;
/// Rows and columns of the entries of a covariance.
const COVARIANCE_ENTRIES: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
/// Most opacity of one.
const MAX_OPACITY: f64 = 0.98;

impl Occluders {
    /// Makes quick maps with cells a number of times as wide: of merged occluders, floaters among
    /// them.
    pub(crate) fn sketched(&self, times: f64) -> Self {
        self.coarse_maps(times, self.merged(times * self.options.cell))
    }

    /// Makes soft maps of falls that are nearly straight down, with cells a number of times as
    /// wide; what floats stops them too.
    pub(crate) fn softened(&self, times: f64) -> Self {
        self.coarse_maps(times, self.pooled(0.5 * times * self.options.cell))
    }

    /// Makes maps of other occluders, floaters among them, with cells a number of times as wide.
    fn coarse_maps(&self, times: f64, all: Vec<Occluder>) -> Self {
        let (cell, floaters) = (times * self.options.cell, FloaterRule::Stop);
        Self { all, ..*self }.mapped(&ShelterOptions { cell, floaters, ..self.options })
    }

    /// Merges the occluders of each cube of `width` metres into one, for maps whose cells are no
    /// finer than that.
    fn merged(&self, width: f64) -> Vec<Occluder> {
        let width = (width / self.metres_per_unit) as f32;
        let cell = |it: &Occluder| it.mean.map(|v| (v / width).floor() as i32);
        let mut order: Vec<(([i32; 3], u32), &Occluder)> =
            (0u32..).zip(&self.all).map(|(index, it)| ((cell(it), index), it)).collect();
        order.sort_unstable_by_key(|(key, _)| *key);
        let runs = order.chunk_by(|a, b| a.0.0 == b.0.0);
        let merged = runs.map(|run| match run {
            [(_, only)] => **only,
            many => merge(many.iter().map(|(_, it)| *it)),
        });
        merged.collect()
    }

    /// Merges the occluders of each cube of `width` metres into one that lets as much of a fall
    /// through as they do, for falls that are nearly straight down and maps whose cells are twice
    /// as wide. Its opacity is an optical thickness, which may be above 1.
    fn pooled(&self, width: f64) -> Vec<Occluder> {
        let width = (width / self.metres_per_unit) as f32;
        let [across, down, _] = axes_of(self.up.map(|v| -v));
        // Area that it covers seen from above.
        let area = |it: &Occluder| {
            let [a, b, c] = [(across, across), (down, down), (across, down)].map(|(u, v)| it.between(u, v));
            (a * b - c * c).max(1e-12 * (a * a + b * b)).max(1e-30).sqrt()
        };
        let mut places = PlaceMap::<[i32; 3], u32>::default();
        let mut pools: Vec<Pool> = Vec::new();
        for it in &self.all {
            let cube = it.mean.map(|v| (v / width).floor() as i32);
            let place = *places.entry(cube).or_insert(pools.len() as u32) as usize;
            let weight = area(it) * f64::from(it.opacity);
            match pools.get_mut(place) {
                Some(pool) => pool.add(it, weight),
                None => pools.push(Pool::new(it, weight)),
            }
        }
        let merged = pools.into_iter().map(|pool| match pool.count {
            1 => pool.first,
            _ => {
                let one = pool.merged();
                Occluder { opacity: (pool.weight / area(&one)) as f32, ..one }
            }
        });
        merged.collect()
    }
}

/// Sums over the occluders of a cube.
struct Pool {
    first: Occluder,
    count: u32,
    weight: f64,
    /// Sum of the means from that of the first, times their weights.
    mean: [f64; 3],
    moments: [f64; 6],
}

impl Pool {
    fn new(it: &Occluder, weight: f64) -> Self {
        let mut pool = Self { first: *it, count: 0, weight: 0.0, mean: [0.0; 3], moments: [0.0; 6] };
        pool.add(it, weight);
        pool
    }

    fn add(&mut self, it: &Occluder, weight: f64) {
        let off: [f64; 3] = std::array::from_fn(|k| f64::from(it.mean[k] - self.first.mean[k]));
        self.count += 1;
        self.weight += weight;
        (0..3).for_each(|k| self.mean[k] += weight * off[k]);
        for (k, (i, j)) in COVARIANCE_ENTRIES.into_iter().enumerate() {
            self.moments[k] += weight * (f64::from(it.covariance[k]) + off[i] * off[j]);
        }
    }

    fn merged(&self) -> Occluder {
        let off = self.mean.map(|v| v / self.weight);
        let covariance = std::array::from_fn(|k| {
            let (i, j) = COVARIANCE_ENTRIES[k];
            (self.moments[k] / self.weight - off[i] * off[j]) as f32
        });
        let mean = std::array::from_fn(|k| (f64::from(self.first.mean[k]) + off[k]) as f32);
        Occluder { mean, covariance, ..self.first }
    }
}

/// The Gaussian of several, with the opacity that covers as much as they do.
fn merge<'a>(all: impl Iterator<Item = &'a Occluder> + Clone) -> Occluder {
    let (mut sum, mut weights, mut moments) = ([0.0; 3], 0.0, [0.0; 6]);
    let (mut heaviest, mut splat) = (f64::NEG_INFINITY, 0);
    for it in all.clone() {
        let weight = covered(it);
        weights += weight;
        let mean = it.mean.map(f64::from);
        (0..3).for_each(|k| sum[k] += weight * mean[k]);
        for (moment, ((i, j), own)) in
            moments.iter_mut().zip(COVARIANCE_ENTRIES.into_iter().zip(it.covariance))
        {
            *moment += weight * (f64::from(own) + mean[i] * mean[j]);
        }
        if weight > heaviest {
            (heaviest, splat) = (weight, it.splat);
        }
    }
    let mean = sum.map(|v| v / weights);
    let covariance: [f32; 6] = std::array::from_fn(|k| {
        let (i, j) = COVARIANCE_ENTRIES[k];
        (WIDTH_FACTOR * WIDTH_FACTOR * (moments[k] / weights - mean[i] * mean[j])) as f32
    });
    let merged = Occluder { mean: mean.map(|v| v as f32), covariance, opacity: 1.0, splat };
    Occluder {
        opacity: (weights * WIDTH_FACTOR * WIDTH_FACTOR / covered(&merged)).min(MAX_OPACITY) as f32,
        ..merged
    }
}

/// Area that it covers, seen from its broadest side, times its opacity.
fn covered(it: &Occluder) -> f64 {
    let [xx, xy, xz, yy, yz, zz] = it.covariance.map(f64::from);
    // The product of the two largest variances is nearly the sum of the products of pairs.
    let minors = xx * yy - xy * xy + xx * zz - xz * xz + yy * zz - yz * yz;
    let least = 1e-12 * dot([xx, yy, zz], [1.0; 3]).powi(2);
    TAU * minors.max(least).max(1e-30).sqrt() * f64::from(it.opacity)
}
