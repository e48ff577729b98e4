//! Mean absolute difference of colours.

use super::term::{LossGradients, LossInput, LossTerm, TrainPhoto};
use rayon::prelude::*;
use wm_render::dispatch;
use wm_render::training::Term;

/// `mean |x - y|` over the pixels that count and their channels.
#[derive(Clone, Debug)]
pub(crate) struct L1Term {
    /// The weight at all steps.
    pub(crate) weight: f64,
}

impl LossTerm for L1Term {
    fn name(&self) -> &'static str {
        "l1"
    }

    fn weight(&self, _: u32, _: &TrainPhoto<'_>) -> f64 {
        self.weight
    }

    fn on_device(&self) -> Option<Term> {
        Some(Term::L1)
    }

    fn add(&mut self, input: &LossInput<'_>, weight: f64, out: &mut LossGradients) -> f64 {
        let (frame, truth) = (input.frame, input.truth);
        let line = 3 * frame.width as usize;
        let counted =
            truth.mask.map_or(frame.pixels() as f64, |mask| mask.iter().map(|v| f64::from(*v)).sum());
        let scale = (weight / (3.0 * counted.max(1.0))) as f32;
        let factor = truth.mask.map(|mask| mask.iter().flat_map(|v| [*v; 3]).collect::<Vec<f32>>());
        let path = input.path;
        let rows =
            out.rgb.par_chunks_mut(line).zip(frame.rgb.par_chunks(line)).zip(truth.rgb.par_chunks(line));
        let sums: Vec<f64> = rows
            .enumerate()
            .map(|(row, ((gradient, x), y))| match &factor {
                None => dispatch!(path, _simd => row_of(x, y, |_| 1.0, scale, gradient)),
                Some(factor) => {
                    let factor = &factor[row * line..(row + 1) * line];
                    row_of(x, y, |i| factor[i], scale, gradient)
                }
            })
            .collect();
        sums.iter().sum::<f64>() / (3.0 * counted.max(1.0))
    }
}

/// Returns the sum of one row and adds its derivative. Plain loops, which the compiler vectorises.
#[inline(always)]
fn row_of(x: &[f32], y: &[f32], factor: impl Fn(usize) -> f32, scale: f32, gradient: &mut [f32]) -> f64 {
    const LANES: usize = 16;
    let (mut sums, mut rest) = ([0.0f32; LANES], 0.0);
    let whole = x.len() / LANES * LANES;
    for at in (0..whole).step_by(LANES) {
        let (x, y, gradient) = (&x[at..at + LANES], &y[at..at + LANES], &mut gradient[at..at + LANES]);
        for i in 0..LANES {
            let (off, factor) = (x[i] - y[i], factor(at + i));
            sums[i] += factor * off.abs();
            gradient[i] += scale * factor * slope(off);
        }
    }
    for i in whole..x.len() {
        let off = x[i] - y[i];
        rest += factor(i) * off.abs();
        gradient[i] += scale * factor(i) * slope(off);
    }
    sums.iter().map(|v| f64::from(*v)).sum::<f64>() + f64::from(rest)
}

/// Returns the derivative of the absolute value, 0 at 0.
#[inline(always)]
fn slope(off: f32) -> f32 {
    if off == 0.0 { 0.0 } else { 1f32.copysign(off) }
}
