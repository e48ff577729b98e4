//! Depth against a prior that was fitted to the scene's units.
//!
//! `mean rho(ln(D d))` with the expected depth D and the prior's inverse depth d: relative, so that
//! near and far count alike and a surface through which a little of the far sky shines weighs as it
//! does in fog. `rho` is `sqrt(x^2 + tau^2) - tau`, linear beyond `tau`, so that outliers of the
//! prior have bounded gradients. `tau` is the error of the prior: the residual of its fit over d,
//! and 1 % at least. The derivative is exact, so transparency does not lower it. Pixels of the sky,
//! and those covered by less than half, do not count.

use super::grid::Grid;
use super::term::{LossGradients, LossInput, LossTerm, TrainPhoto};
use crate::config::GeometryConfig;
use wm_render::Channels;
use wm_render::training::{MIN_COVERAGE, MIN_RELATIVE_SIGMA, Term};

/// The term `depth`.
#[derive(Clone, Debug)]
pub(crate) struct DepthTerm {
    /// The weights of geometry.
    pub(crate) geometry: GeometryConfig,
    /// The steps of the training.
    pub(crate) steps: u32,
}

impl LossTerm for DepthTerm {
    fn name(&self) -> &'static str {
        "depth"
    }

    fn weight(&self, step: u32, truth: &TrainPhoto<'_>) -> f64 {
        let Self { geometry, steps } = self;
        let is_on = step >= geometry.depth_from(*steps)
            && truth.prior.is_some_and(|prior| !prior.disparity.is_empty());
        if is_on { geometry.depth * geometry.depth_share(step, *steps) } else { 0.0 }
    }

    fn channels(&self) -> Channels {
        Channels::ColorDepth
    }

    fn on_device(&self) -> Option<Term> {
        Some(Term::Depth)
    }

    fn add(&mut self, input: &LossInput<'_>, weight: f64, out: &mut LossGradients) -> f64 {
        let (Some(prior), frame) = (input.truth.prior, input.frame) else { return 0.0 };
        let grid = Grid::new(input.truth.size(), prior);
        let mut sum = 0.0;
        // The mean is over all pixels: a photo with little known depth has small gradients.
        let scale = (weight / grid.len() as f64) as f32;
        for (at, theirs) in grid.pairs() {
            let (disparity, depth) = (prior.disparity[theirs], frame.depth[at]);
            // Comparisons with NaN are false, as for 0.
            let counts = disparity > 0.0 && depth > 0.0 && frame.alpha[at] >= MIN_COVERAGE;
            if !counts {
                continue;
            }
            let off = (depth * disparity).ln();
            let tau = (prior.sigma / disparity).max(MIN_RELATIVE_SIGMA);
            let root = off.hypot(tau);
            sum += f64::from(root - tau);
            out.depth[at] += scale * off / (root * depth);
        }
        sum / grid.len() as f64
    }
}
