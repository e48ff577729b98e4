//! Flatness of splats, so that their shortest axis is distinct and stays the same axis.
//!
//! A normal, the shortest axis, jumps when two axes are of nearly equal length. The term acts on
//! the ratio of the shortest scale to the middle one, `mean min(1, s_1 / s_2 - r)`, where it is
//! above a ratio r that is flat enough: the shortest axis shrinks and the middle one grows. Another
//! axis can become the shortest only against this loss.

use super::term::{LossGradients, LossInput, LossTerm, Reads, TrainPhoto};
use crate::config::TrainConfig;
use wm_render::training::{Comparison, SplatTerms};

/// The term `flat`.
#[derive(Clone, Debug)]
pub(crate) struct FlatTerm {
    weight: f64,
}

impl FlatTerm {
    /// Returns the term with its weight in `config`.
    pub(crate) fn new(config: &TrainConfig) -> Self {
        Self { weight: config.loss.geometry.flat }
    }
}

impl LossTerm for FlatTerm {
    fn name(&self) -> &'static str {
        "flat"
    }

    fn weight(&self, _: u32, truth: &TrainPhoto<'_>) -> f64 {
        // A training without priors has no geometry terms.
        if truth.prior.is_some() { self.weight } else { 0.0 }
    }

    fn reads(&self, _: u32, _: &TrainPhoto<'_>, _: &mut Comparison<'_>) -> Reads {
        Reads::Nothing
    }

    fn add(&mut self, _: &LossInput<'_>, _: f64, _: &mut LossGradients) -> f64 {
        0.0
    }

    fn splat_terms(&self, weight: f64, terms: &mut SplatTerms) {
        terms.flatness += weight;
    }
}
