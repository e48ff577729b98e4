//! Fewer occluders for coarse maps: those of a cube become one.

use super::occluders::Occluder;
use super::{Occluders, dot};
use std::f64::consts::TAU;

/// Factor on the widths of what was merged: Gaussians of cubes side by side then close as their splats did.
const CLOSED: f64 = 1.5;
/// Most opacity of one.
const MOST: f64 = 0.98;

impl Occluders {
    /// Its occluders with those of each cube of `width` metres as one, for maps whose cells are no finer than that.
    pub(super) fn merged(&self, width: f64) -> Vec<Occluder> {
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
        let pairs = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
        for (moment, ((i, j), own)) in moments.iter_mut().zip(pairs.into_iter().zip(it.covariance)) {
            *moment += weight * (f64::from(own) + mean[i] * mean[j]);
        }
        if weight > heaviest {
            (heaviest, splat) = (weight, it.splat);
        }
    }
    let mean = sum.map(|v| v / weights);
    let pairs = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
    let covariance: [f32; 6] = std::array::from_fn(|k| {
        let (i, j) = pairs[k];
        (CLOSED * CLOSED * (moments[k] / weights - mean[i] * mean[j])) as f32
    });
    let merged = Occluder { mean: mean.map(|v| v as f32), covariance, opacity: 1.0, splat };
    Occluder { opacity: (weights * CLOSED * CLOSED / covered(&merged)).min(MOST) as f32, ..merged }
}

/// Area that it covers, seen from its broadest side, times its opacity.
fn covered(it: &Occluder) -> f64 {
    let [xx, xy, xz, yy, yz, zz] = it.covariance.map(f64::from);
    // The product of the two largest variances is nearly the sum of the products of pairs.
    let minors = xx * yy - xy * xy + xx * zz - xz * xz + yy * zz - yz * yz;
    let least = 1e-12 * dot([xx, yy, zz], [1.0; 3]).powi(2);
    TAU * minors.max(least).max(1e-30).sqrt() * f64::from(it.opacity)
}
