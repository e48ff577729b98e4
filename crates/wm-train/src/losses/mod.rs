//! What training makes small: terms, one a file, that read what is rendered and say which way to go.
//!
//! The trainer names no term. It renders what the terms read, adds up what they say, and goes one step.
//! A term may ask for a render of its own, with other opacities and only some parameters learning.

mod depth;
mod flat;
mod grid;
mod l1;
mod normal;
mod patches;
mod smooth;
mod ssim;
mod surface;

pub use depth::Depth;
pub use flat::Flat;
pub use l1::L1;
pub use normal::Normal;
pub use patches::{Pass, PatchDepth};
pub use smooth::Smooth;
pub use ssim::Dssim;
pub use surface::Surface;

use crate::config::TrainConfig;
use crate::priors::Prior;
use wm_render::simd::SimdPath;
use wm_render::{Channels, DepthAlpha, Drawn, Frame, Gradients, Learn, Opacity, Upstream};
use wm_scene::{Camera, Splats};

/// The terms of a configuration.
#[must_use]
pub fn terms(config: &TrainConfig, path: SimdPath) -> Vec<Box<dyn LossTerm>> {
    vec![
        Box::new(L1 { weight: config.loss.l1 }),
        Box::new(Dssim::new(config.loss.ssim, path)),
        Box::new(Depth::new(config)),
        Box::new(PatchDepth::new(config, Pass::Hard)),
        Box::new(PatchDepth::new(config, Pass::Soft)),
        Box::new(Surface::new(config)),
        Box::new(Normal::new(config)),
        Box::new(Flat::new(config)),
        Box::new(Smooth::new(config)),
    ]
}

/// The photo that a frame is compared with.
#[derive(Clone, Copy, Debug)]
pub struct Truth<'a> {
    /// `[H, W, 3]`, 0-1, display-referred.
    pub rgb: &'a [f32],
    /// `[H, W]`, 1 where the photo counts and 0 where it does not; `None` where all of it does.
    pub mask: Option<&'a [f32]>,
    /// From where.
    pub camera: &'a Camera,
    /// What is believed of its depth, normals and sky; `None` where nothing is.
    pub prior: Option<&'a Prior>,
}

/// What a term reads.
#[derive(Clone, Copy, Debug)]
pub struct LossInput<'a> {
    /// What was rendered; its colours are those of the photo's exposure.
    pub frame: &'a Frame,
    /// What should have been.
    pub truth: &'a Truth<'a>,
    /// Which step of training.
    pub step: u32,
    /// For loops over pixels.
    pub path: SimdPath,
}

/// Derivatives of the loss by the pixels of a frame; empty where nothing was rendered.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LossGradients {
    /// `[H, W, 3]`.
    pub rgb: Vec<f32>,
    /// `[H, W]`.
    pub alpha: Vec<f32>,
    /// `[H, W]`.
    pub depth: Vec<f32>,
    /// `[H, W, 3]`.
    pub normal: Vec<f32>,
}

impl LossGradients {
    /// Zeros for every picture of `frame`.
    pub fn clear(&mut self, frame: &Frame) {
        let arrays = [
            (&mut self.rgb, frame.rgb.len()),
            (&mut self.alpha, frame.alpha.len()),
            (&mut self.depth, frame.depth.len()),
            (&mut self.normal, frame.normal.len()),
        ];
        for (array, length) in arrays {
            array.clear();
            array.resize(length, 0.0);
        }
    }

    /// As the renderer takes them.
    #[must_use]
    pub fn upstream(&self, depth_alpha: DepthAlpha) -> Upstream<'_> {
        Upstream { rgb: &self.rgb, alpha: &self.alpha, depth: &self.depth, normal: &self.normal, depth_alpha }
    }
}

/// A render for one term alone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OwnRender {
    /// Which pictures.
    pub channels: Channels,
    /// Where opacities come from.
    pub opacity: Opacity,
    /// Which splats are drawn.
    pub drawn: Drawn,
    /// What learns from it.
    pub learn: Learn,
    /// Whether coverage learns from depth.
    pub depth_alpha: DepthAlpha,
}

/// A term of the loss.
pub trait LossTerm: Send {
    /// Its name in reports.
    fn name(&self) -> &'static str;

    /// Its weight at a step on a photo; where it is 0 the term is not called.
    fn weight(&self, step: u32, truth: &Truth<'_>) -> f64;

    /// What it reads of the step's common render.
    fn channels(&self) -> Channels {
        Channels::Color
    }

    /// The render that it has for itself instead of the common one.
    fn own_render(&self) -> Option<OwnRender> {
        None
    }

    /// Its value before weighting; adds `weight` times its derivative to `out`.
    fn add(&mut self, input: &LossInput<'_>, weight: f64, out: &mut LossGradients) -> f64;

    /// What it takes from the splats themselves, whatever the picture shows: adds `weight` times its
    /// derivative to the rows of those in view.
    fn pull(&mut self, _: &Splats, _: f64, _: &mut Gradients) {}
}
