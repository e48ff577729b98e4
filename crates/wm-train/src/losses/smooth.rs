//! Smooth inverse depth where the photo is smooth (Godard et al. 2017).
//!
//! The mean over neighbouring pixels of `|r_i - r_j| / mean(r) exp(-|I_i - I_j| / 0.1)` with
//! `r = 1 / D`. Off by default: it rounds surfaces, and helps where no other term has evidence.

use super::term::{LossGradients, LossInput, LossTerm, TrainPhoto};
use wm_render::Channels;
use wm_render::training::{EDGE_CONTRAST, MIN_COVERAGE, Term};

/// The term `smooth`.
#[derive(Clone, Debug)]
pub(crate) struct SmoothTerm {
    /// The weight from then on.
    pub(crate) weight: f64,
    /// The first step that counts.
    pub(crate) from: u32,
}

impl LossTerm for SmoothTerm {
    fn name(&self) -> &'static str {
        "smooth"
    }

    fn weight(&self, step: u32, _: &TrainPhoto<'_>) -> f64 {
        if step >= self.from { self.weight } else { 0.0 }
    }

    fn channels(&self) -> Channels {
        Channels::ColorDepth
    }

    fn on_device(&self) -> Option<Term> {
        Some(Term::Smooth)
    }

    fn add(&mut self, input: &LossInput<'_>, weight: f64, out: &mut LossGradients) -> f64 {
        let (frame, rgb) = (input.frame, input.truth.rgb);
        let counts = |at: usize| frame.alpha[at] >= MIN_COVERAGE && frame.depth[at] > 0.0;
        let pixels = frame.pixels();
        let covered: Vec<usize> = (0..pixels).filter(|at| counts(*at)).collect();
        let mean = covered.iter().map(|at| 1.0 / f64::from(frame.depth[*at])).sum::<f64>() / pixels as f64;
        if mean <= 0.0 {
            return 0.0;
        }
        // The mean is a constant of the derivative: it only makes the term independent of the unit.
        let scale = (weight / (mean * pixels as f64)) as f32;
        let width = frame.width as usize;
        let mut sum = 0.0;
        for at in covered {
            for next in
                [(at % width + 1 < width).then_some(at + 1), (at + width < pixels).then_some(at + width)]
            {
                let Some(next) = next.filter(|next| counts(*next)) else { continue };
                let off = (0..3).map(|k| (rgb[3 * at + k] - rgb[3 * next + k]).abs()).sum::<f32>() / 3.0;
                let edge = (-off / EDGE_CONTRAST).exp();
                let (a, b) = (1.0 / frame.depth[at], 1.0 / frame.depth[next]);
                sum += f64::from(edge * (a - b).abs());
                let slope = scale * edge * if a == b { 0.0 } else { (a - b).signum() };
                out.depth[at] -= slope * a * a;
                out.depth[next] += slope * b * b;
            }
        }
        sum / (mean * pixels as f64)
    }
}
