//! Flatness of splats, so that their shortest axis is distinct and stays the same axis.
//!
//! A normal, the shortest axis, jumps when two axes are of nearly equal length. The term acts on
//! the ratio of the shortest scale to the middle one, `mean min(1, s_1 / s_2 - r)`, where it is
//! above a ratio r that is flat enough: the shortest axis shrinks and the middle one grows. Another
//! axis can become the shortest only against this loss.

use super::term::{LossTerm, TrainPhoto};
use wm_render::training::SplatTerms;

/// The term `flat`.
#[derive(Clone, Debug)]
pub(crate) struct FlatTerm {
    /// The weight at all steps.
    pub(crate) weight: f64,
}

impl LossTerm for FlatTerm {
    fn name(&self) -> &'static str {
        "flat"
    }

    fn weight(&self, _: u32, truth: &TrainPhoto<'_>) -> f64 {
        // A training without priors has no geometry terms.
        if truth.prior.is_some() { self.weight } else { 0.0 }
    }

    fn splat_terms(&self, weight: f64, terms: &mut SplatTerms) {
        terms.flatness += weight;
    }
}
