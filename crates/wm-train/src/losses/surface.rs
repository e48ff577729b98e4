//! Coverage: what stands in front of the sky covers its pixels whole, and nothing covers the sky's.
//!
//! `mean |A - S|` with the coverage A by all splats but the sky's, from a render of its own, and S, 1 where the prior
//! has the place and 0 where it has the sky; pixels that it does not know do not count. Without it the sky is
//! painted on splats that drift before it, which fog lights up, and shines through walls.

use super::grid::Grid;
use super::{LossGradients, LossInput, LossTerm, OwnRender, Truth};
use crate::config::TrainConfig;
use crate::priors::SkyClass;
use wm_render::{Channels, DepthAlpha, Drawn, Learn, Opacity};

/// The term `surface`.
#[derive(Clone, Debug)]
pub struct Surface {
    weight: f64,
    every: u32,
}

impl Surface {
    /// As configured.
    #[must_use]
    pub fn new(config: &TrainConfig) -> Self {
        let geometry = &config.loss.geometry;
        Self { weight: geometry.surface, every: geometry.every.max(1) }
    }
}

impl LossTerm for Surface {
    fn name(&self) -> &'static str {
        "surface"
    }

    fn weight(&self, step: u32, truth: &Truth<'_>) -> f64 {
        let is_on = step.is_multiple_of(self.every) && truth.prior.is_some_and(|prior| !prior.sky.is_empty());
        // What comes more rarely pulls as much in all.
        if is_on { self.weight * f64::from(self.every) } else { 0.0 }
    }

    fn own_render(&self) -> Option<OwnRender> {
        Some(OwnRender {
            channels: Channels::Depth,
            opacity: Opacity::Stored,
            drawn: Drawn::WithoutSky,
            learn: Learn { sh: false, ..Learn::ALL },
            depth_alpha: DepthAlpha::Detached,
        })
    }

    fn add(&mut self, input: &LossInput<'_>, weight: f64, out: &mut LossGradients) -> f64 {
        let (Some(prior), frame) = (input.truth.prior, input.frame) else { return 0.0 };
        let grid = Grid::new(frame, prior);
        let mut sum = 0.0;
        let scale = (weight / grid.len() as f64) as f32;
        for (at, theirs) in grid.pairs() {
            let (wanted, slope) = match prior.sky[theirs] {
                SkyClass::Place => (1.0, -scale),
                SkyClass::Sky => (0.0, scale),
                SkyClass::Unknown => continue,
            };
            sum += f64::from((frame.alpha[at] - wanted).abs());
            out.alpha[at] += slope;
        }
        sum / grid.len() as f64
    }
}
