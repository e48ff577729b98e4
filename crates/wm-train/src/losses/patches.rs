//! The relative depth of patches (Li et al. 2024, DNGaussian; `eq:hs depth loss`).
//!
//! Rendered inverse depth and that of the prior are compared over patches of random size after
//! normalisation, `(x - m_P) / (s + 0.01 s_I)`: m_P is the mean of the patch, and s the standard
//! deviation over the whole photo (global) or the patch (local). The deviation over the photo is a
//! constant of the derivative. Differences below the margin count as 0. So neither scale nor shift
//! of the prior matters, nor their drift over the photo. Inverse depth is used since the prior is
//! linear in it, and the sky is 0.
//!
//! The hard pass gives every splat the same high opacity and moves means alone; the soft one
//! changes opacities alone. Each is a render of its own, in which alpha is a constant of the
//! derivative. Pixels covered by less than half do not count.

use super::grid::Grid;
use super::term::{LossGradients, LossInput, LossTerm, OwnRender, TrainPhoto};
use crate::config::{GeometryConfig, TrainConfig};
use crate::random::{Purpose, Random};
use wm_render::training::{self, Comparison, DEVIATION_FLOOR, MIN_COVERAGE, MIN_PATCH_PIXELS, Term};
use wm_render::{Channels, DepthAlpha, DrawnSplats, Learn, Opacity};

/// Opacity of all splats in the hard pass.
const HARD_OPACITY: f32 = 0.95;
/// Range of the sides of patches, px of a photo of the reference height.
const PATCH_SIDES_PX: [f64; 2] = [5.0, 17.0];
const REFERENCE_HEIGHT_PX: f64 = 378.0;

/// The parameters to which a patch term has gradients.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PatchPass {
    /// Means.
    Hard,
    /// Opacities.
    Soft,
}

/// The terms `depth-hard` and `depth-soft`.
#[derive(Clone, Debug)]
pub(crate) struct PatchDepthTerm {
    pass: PatchPass,
    steps: u32,
    geometry: GeometryConfig,
    seed: u64,
    work: Work,
}

/// The compared values, one per pair of pixels.
#[derive(Clone, Debug, Default)]
struct Work {
    /// Rendered inverse depth; NaN where it does not count.
    x: Vec<f64>,
    /// Inverse depth of the prior.
    y: Vec<f64>,
    /// The derivative by `x`.
    slope: Vec<f64>,
}

impl PatchDepthTerm {
    /// Returns the term with its weight in `config`.
    pub(crate) fn new(config: &TrainConfig, pass: PatchPass) -> Self {
        let (geometry, steps, seed) = (config.loss.geometry, config.steps, config.seed);
        Self { pass, steps, geometry, seed, work: Work::default() }
    }

    /// Returns the side of the patches at a step, for a grid of `rows` rows.
    fn side(&self, step: u32, rows: usize) -> usize {
        let random = Random::new(self.seed, Purpose::Patch, step);
        let scale = rows as f64 / REFERENCE_HEIGHT_PX;
        let side =
            PATCH_SIDES_PX[0] + random.uniform(self.pass as u64) * (PATCH_SIDES_PX[1] - PATCH_SIDES_PX[0]);
        (scale * side).round().max(3.0) as usize
    }
}

impl LossTerm for PatchDepthTerm {
    fn name(&self) -> &'static str {
        match self.pass {
            PatchPass::Hard => "depth-hard",
            PatchPass::Soft => "depth-soft",
        }
    }

    fn weight(&self, step: u32, truth: &TrainPhoto<'_>) -> f64 {
        let Self { pass, steps, geometry, .. } = self;
        let (weight, from) = match pass {
            PatchPass::Hard => (geometry.depth_hard, 0),
            PatchPass::Soft => (geometry.depth_soft, geometry.depth_from(*steps)),
        };
        let every = geometry.every.max(1);
        let is_on = step >= from
            && step.is_multiple_of(every)
            && truth.prior.is_some_and(|prior| !prior.disparity.is_empty());
        if is_on { weight * geometry.depth_share(step, *steps) * f64::from(every) } else { 0.0 }
    }

    fn own_render(&self) -> Option<OwnRender> {
        let (opacity, learn) = match self.pass {
            PatchPass::Hard => (Opacity::Fixed(HARD_OPACITY), Learn::MEANS),
            PatchPass::Soft => (Opacity::Stored, Learn::OPACITIES),
        };
        let (channels, drawn, depth_alpha) = (Channels::Depth, DrawnSplats::All, DepthAlpha::Detached);
        Some(OwnRender { channels, opacity, drawn, learn, depth_alpha })
    }

    fn on_device(&self) -> Option<Term> {
        Some(Term::Patches)
    }

    fn prepare(&self, step: u32, comparison: &mut Comparison<'_>) {
        let rows = comparison.believed.map_or(0, |believed| believed.grid.1 as usize);
        comparison.patches = training::Patches {
            side: self.side(step, rows) as u32,
            local: self.geometry.depth_local as f32,
            margin: self.geometry.depth_margin as f32,
        };
    }

    fn add(&mut self, input: &LossInput<'_>, weight: f64, out: &mut LossGradients) -> f64 {
        let (Some(prior), frame) = (input.truth.prior, input.frame) else { return 0.0 };
        let grid = Grid::new(input.truth.size(), prior);
        let side = self.side(input.step, grid.height);
        let (Work { x, y, slope }, geometry) = (&mut self.work, &self.geometry);
        x.clear();
        y.clear();
        for (at, theirs) in grid.pairs() {
            let (depth, believed) = (frame.depth[at], prior.disparity[theirs]);
            let counts = believed >= 0.0 && frame.alpha[at] >= MIN_COVERAGE && depth > 0.0;
            x.push(if counts { 1.0 / f64::from(depth) } else { f64::NAN });
            y.push(f64::from(believed));
        }
        let patches = Patches { width: grid.width, height: grid.height, side };
        let value = normalised(x, y, patches, geometry.depth_local, geometry.depth_margin, slope);
        for (i, (at, _)) in grid.pairs().enumerate() {
            if slope[i] != 0.0 {
                // dr/dD = -r^2.
                out.depth[at] -= (weight * slope[i] * x[i] * x[i]) as f32;
            }
        }
        value
    }
}

/// The grid of patches of an image.
#[derive(Clone, Copy, Debug)]
struct Patches {
    width: usize,
    height: usize,
    side: usize,
}

impl Patches {
    /// Returns the pixels of each patch that are not NaN.
    fn of(self, x: &[f64]) -> Vec<Vec<usize>> {
        let mut patches = Vec::new();
        for top in (0..self.height).step_by(self.side) {
            for left in (0..self.width).step_by(self.side) {
                let rows = top..(top + self.side).min(self.height);
                let columns = left..(left + self.side).min(self.width);
                let pixels =
                    rows.flat_map(|row| columns.clone().map(move |column| row * self.width + column));
                patches.push(pixels.filter(|pixel| !x[*pixel].is_nan()).collect());
            }
        }
        patches
    }
}

/// Returns mean and standard deviation.
fn moments(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let (count, sum) = values.clone().fold((0.0f64, 0.0), |(n, s), v| (n + 1.0, s + v));
    let mean = sum / count.max(1.0);
    (mean, (values.map(|v| (v - mean).powi(2)).sum::<f64>() / count.max(1.0)).sqrt())
}

/// Returns the loss, global and local, and writes its derivative by `x`; 0 if nothing can be
/// compared.
fn normalised(x: &[f64], y: &[f64], patches: Patches, local: f64, margin: f64, slope: &mut Vec<f64>) -> f64 {
    slope.clear();
    slope.resize(x.len(), 0.0);
    let known = || (0..x.len()).filter(|i| !x[*i].is_nan());
    let ((_, all_x), (_, all_y)) = (moments(known().map(|i| x[i])), moments(known().map(|i| y[i])));
    if !(all_x > 0.0 && all_y > 0.0) {
        return 0.0;
    }
    let patches: Vec<Vec<usize>> =
        patches.of(x).into_iter().filter(|pixels| pixels.len() >= MIN_PATCH_PIXELS).collect();
    let mut total = 0.0;
    for (is_local, share) in [(false, 1.0), (true, local)] {
        if share == 0.0 {
            continue;
        }
        // Differences come first, since the mean is over those above the margin.
        let (mut sum, mut count) = (0.0, 0usize);
        let mut offs: Vec<(usize, Vec<f64>, f64, f64)> = Vec::new();
        for (index, pixels) in patches.iter().enumerate() {
            let (mean_x, own_x) = moments(pixels.iter().map(|i| x[*i]));
            let (mean_y, own_y) = moments(pixels.iter().map(|i| y[*i]));
            let over = |all: f64, own: f64| DEVIATION_FLOOR * all + if is_local { own } else { all };
            let (over_x, over_y) = (over(all_x, own_x), over(all_y, own_y));
            let off = |i: &usize| {
                let off = (x[*i] - mean_x) / over_x - (y[*i] - mean_y) / over_y;
                if off.abs() > margin { off } else { 0.0 }
            };
            let differences: Vec<f64> = pixels.iter().map(off).collect();
            sum += differences.iter().map(|v| v * v).sum::<f64>();
            count += differences.iter().filter(|v| **v != 0.0).count();
            offs.push((index, differences, mean_x, over_x));
        }
        if count == 0 {
            continue;
        }
        total += share * sum / count as f64;
        for (index, differences, mean_x, over_x) in offs {
            let pixels = &patches[index];
            let n = pixels.len() as f64;
            let by_value = |v: f64| share * 2.0 * v / count as f64;
            let mean = differences.iter().map(|v| by_value(*v)).sum::<f64>() / n;
            // The deviation of the patch depends on its pixels.
            let own = over_x - DEVIATION_FLOOR * all_x;
            let along = if is_local && own > 1e-12 * all_x {
                let sum = pixels
                    .iter()
                    .zip(&differences)
                    .map(|(i, v)| by_value(*v) * (x[*i] - mean_x))
                    .sum::<f64>();
                sum / (n * own * over_x * over_x)
            } else {
                0.0
            };
            for (i, v) in pixels.iter().zip(&differences) {
                slope[*i] += (by_value(*v) - mean) / over_x - (x[*i] - mean_x) * along;
            }
        }
    }
    total
}

#[cfg(test)]
mod tests {
    use super::*;
    use wm_base::random::uniform;

    const PATCHES: Patches = Patches { width: 12, height: 9, side: 4 };

    fn values(seed: u64) -> Vec<f64> {
        (0..108).map(|i| 0.2 + uniform(seed, i) + 0.05 * (i % 12) as f64).collect()
    }

    fn loss(x: &[f64], y: &[f64], local: f64, margin: f64) -> (f64, Vec<f64>) {
        let mut slope = Vec::new();
        (normalised(x, y, PATCHES, local, margin, &mut slope), slope)
    }

    #[test]
    fn the_derivative_is_that_of_the_value() {
        let (mut x, y) = (values(1), values(2));
        x[17] = f64::NAN;
        for (local, margin) in [(0.0, 0.0), (0.7, 0.0), (0.3, 0.2)] {
            let (_, slope) = loss(&x, &y, local, margin);
            // The photo's deviation is a constant of the derivative: kept by moving pixels in pairs
            // is not enough, so it is held by comparing with the loss of values that are scaled
            // back.
            let known: Vec<f64> = x.iter().copied().filter(|v| !v.is_nan()).collect();
            let (_, all) = moments(known.iter().copied());
            for i in [0, 5, 40, 77, 107] {
                let at = |step: f64| {
                    let mut moved = x.clone();
                    moved[i] += step;
                    loss_by_formula(&moved, &y, local, margin, all)
                };
                let step = 1e-6;
                let by_difference = (at(step) - at(-step)) / (2.0 * step);
                assert!(
                    (by_difference - slope[i]).abs() < 1e-5 * (1.0 + by_difference.abs()),
                    "{i}: {by_difference} {}",
                    slope[i]
                );
            }
            assert_eq!(slope[17], 0.0);
        }
    }

    /// The loss by its formula, with the photo's deviation held.
    fn loss_by_formula(x: &[f64], y: &[f64], local: f64, margin: f64, all_x: f64) -> f64 {
        let known: Vec<usize> = (0..x.len()).filter(|i| !x[*i].is_nan()).collect();
        let (_, all_y) = moments(known.iter().map(|i| y[*i]));
        let mut total = 0.0;
        for (is_local, share) in [(false, 1.0), (true, local)] {
            let mut squares = Vec::new();
            for pixels in PATCHES.of(x).iter().filter(|p| p.len() >= MIN_PATCH_PIXELS) {
                let (mx, sx) = moments(pixels.iter().map(|i| x[*i]));
                let (my, sy) = moments(pixels.iter().map(|i| y[*i]));
                for i in pixels {
                    let (over_x, over_y) = if is_local { (sx, sy) } else { (all_x, all_y) };
                    let off = (x[*i] - mx) / (over_x + DEVIATION_FLOOR * all_x)
                        - (y[*i] - my) / (over_y + DEVIATION_FLOOR * all_y);
                    if off.abs() > margin {
                        squares.push(off * off);
                    }
                }
            }
            total += share * squares.iter().sum::<f64>() / squares.len() as f64;
        }
        total
    }

    #[test]
    fn scale_and_shift_do_not_matter_and_nothing_is_no_fault() {
        let x = values(3);
        let y: Vec<f64> = x.iter().map(|v| 7.0 * v + 3.0).collect();
        let (value, slope) = loss(&x, &y, 0.5, 0.0);
        assert!(value < 1e-20 && slope.iter().all(|v| v.abs() < 1e-9));
        let (nothing, flat) = (vec![f64::NAN; 108], vec![0.5; 108]);
        assert_eq!(loss(&nothing, &y, 0.5, 0.0).0, 0.0);
        assert_eq!(loss(&flat, &y, 0.5, 0.0).0, 0.0);
        let within = loss(&values(4), &values(5), 0.5, 1e3);
        assert_eq!((within.0, within.1.iter().all(|v| *v == 0.0)), (0.0, true));
    }
}
