//! Mean absolute difference of colours.

use super::{LossGradients, LossInput, LossTerm};
use rayon::prelude::*;

/// `mean |x - y|` over the pixels that count and their channels.
#[derive(Clone, Debug)]
pub struct L1 {
    /// Its weight at all steps.
    pub weight: f64,
}

impl LossTerm for L1 {
    fn name(&self) -> &'static str {
        "l1"
    }

    fn weight(&self, _: u32) -> f64 {
        self.weight
    }

    fn add(&mut self, input: &LossInput<'_>, weight: f64, out: &mut LossGradients) -> f64 {
        let (frame, truth) = (input.frame, input.truth);
        let line = 3 * frame.width as usize;
        let counted = truth.mask.map_or(frame.pixels() as f64, |mask| mask.iter().map(|v| f64::from(*v)).sum());
        let scale = (weight / (3.0 * counted.max(1.0))) as f32;
        let rows = out.rgb.par_chunks_mut(line).zip(frame.rgb.par_chunks(line)).zip(truth.rgb.par_chunks(line));
        let sums: Vec<f64> = rows
            .enumerate()
            .map(|(row, ((gradient, x), y))| {
                let mask = truth.mask.map(|mask| &mask[row * line / 3..(row + 1) * line / 3]);
                let mut sum = 0.0f64;
                for i in 0..line {
                    let factor = mask.map_or(1.0, |mask| mask[i / 3]);
                    let off = x[i] - y[i];
                    // Where both are equal there is no way to go.
                    let sign = f32::from(off > 0.0) - f32::from(off < 0.0);
                    gradient[i] += scale * factor * sign;
                    sum += f64::from(factor * off.abs());
                }
                sum
            })
            .collect();
        sums.iter().sum::<f64>() / (3.0 * counted.max(1.0))
    }
}
