//! Converts the prior of a photo into the arrays that a device compares with.

use super::grid::Grid;
use super::surface;
use super::term::TrainPhoto;
use crate::priors::Prior;
use wm_render::training::{GridPriors, PixelPrior};

/// Returns `prior` in the form for a device; `pixels` are [`beliefs`].
pub(crate) fn believed<'a>(
    truth: &TrainPhoto<'_>,
    prior: &Prior,
    pixels: &'a (dyn Fn() -> Vec<PixelPrior> + Sync),
) -> GridPriors<'a> {
    let grid = Grid::new(truth.size(), prior);
    GridPriors { sigma: prior.sigma, grid: (grid.width as u32, grid.height as u32), pixels }
}

/// Returns the weight of each pixel of the photo, `[H, W]`.
pub(crate) fn beliefs(truth: &TrainPhoto<'_>) -> Vec<PixelPrior> {
    let (width, height) = truth.size();
    let mut beliefs = vec![PixelPrior::NONE; width as usize * height as usize];
    let Some(prior) = truth.prior else { return beliefs };
    for (at, theirs) in Grid::new(truth.size(), prior).pairs() {
        // Comparisons with NaN, not known, are false.
        if let Some(disparity) = prior.disparity.get(theirs).filter(|disparity| **disparity >= 0.0) {
            beliefs[at].disparity = *disparity;
        }
        if let Some(normal) = prior.normal.get(theirs) {
            beliefs[at].normal = *normal;
        }
    }
    if !prior.sky.is_empty() {
        surface::shares(truth, prior, |at, share| beliefs[at].coverage = share);
    }
    beliefs
}
