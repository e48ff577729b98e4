//! Normals against those of a prior.
//!
//! The mean of `|N - M|^2` (`eq:normal l2_loss`) with the rendered normal N, shortest axes blended
//! and brought to length 1, and the prior's M, over pixels where M is known and at least half is
//! covered. It begins late, after depth has formed surfaces: in a cloud of splats it would make
//! them transparent instead of rotating them.

use super::grid::Grid;
use super::term::{LossGradients, LossInput, LossTerm, TrainPhoto};
use wm_render::Channels;
use wm_render::training::{MIN_COVERAGE, Term};

/// The term `normal`.
#[derive(Clone, Debug)]
pub(crate) struct NormalTerm {
    /// The weight from then on.
    pub(crate) weight: f64,
    /// The first step that counts.
    pub(crate) from: u32,
}

impl LossTerm for NormalTerm {
    fn name(&self) -> &'static str {
        "normal"
    }

    fn weight(&self, step: u32, truth: &TrainPhoto<'_>) -> f64 {
        let is_on = step >= self.from && truth.prior.is_some_and(|prior| !prior.normal.is_empty());
        if is_on { self.weight } else { 0.0 }
    }

    fn channels(&self) -> Channels {
        Channels::ColorDepthNormal
    }

    fn on_device(&self) -> Option<Term> {
        Some(Term::Normal)
    }

    fn add(&mut self, input: &LossInput<'_>, weight: f64, out: &mut LossGradients) -> f64 {
        let (Some(prior), frame) = (input.truth.prior, input.frame) else { return 0.0 };
        let grid = Grid::new(input.truth.size(), prior);
        let mut sum = 0.0;
        let scale = (2.0 * weight / grid.len() as f64) as f32;
        for (at, theirs) in grid.pairs() {
            let wanted = prior.normal[theirs];
            if wanted == [0.0; 3] || frame.alpha[at] < MIN_COVERAGE {
                continue;
            }
            for k in 0..3 {
                let off = frame.normal[3 * at + k] - wanted[k];
                sum += f64::from(off * off);
                out.normal[3 * at + k] += scale * off;
            }
        }
        sum / grid.len() as f64
    }
}
