//! Structural dissimilarity of colours: 1 minus their structural similarity.

use super::term::{LossGradients, LossInput, LossTerm, TrainPhoto};
use crate::ssim::{Ssim, within};
use wm_render::training::Term;

/// `1 - SSIM`; see [`crate::ssim`]. Both images are black where the photo is masked.
#[derive(Clone, Debug)]
pub(crate) struct SsimTerm {
    /// The weight at all steps.
    pub(crate) weight: f64,
    /// The similarity of pictures.
    pub(crate) ssim: Ssim,
}

impl LossTerm for SsimTerm {
    fn name(&self) -> &'static str {
        "dssim"
    }

    fn weight(&self, _: u32, _: &TrainPhoto<'_>) -> f64 {
        self.weight
    }

    fn on_device(&self) -> Option<Term> {
        Some(Term::Dssim)
    }

    fn add(&mut self, input: &LossInput<'_>, weight: f64, out: &mut LossGradients) -> f64 {
        let (frame, truth) = (input.frame, input.truth);
        let (width, scale) = (frame.width as usize, -weight as f32);
        let Some(mask) = truth.mask else {
            return 1.0 - self.ssim.add_gradient(&frame.rgb, truth.rgb, width, scale, &mut out.rgb);
        };
        let mut gradient = vec![0.0; frame.rgb.len()];
        let (x, y) = (within(mask, &frame.rgb), within(mask, truth.rgb));
        let value = self.ssim.add_gradient(&x, &y, width, scale, &mut gradient);
        for (i, (out, gradient)) in out.rgb.iter_mut().zip(gradient).enumerate() {
            *out += mask[i / 3] * gradient;
        }
        1.0 - value
    }
}
