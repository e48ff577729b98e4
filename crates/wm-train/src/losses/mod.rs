//! What training makes small: terms, one a file, that read what is rendered and say which way to go.
//!
//! The trainer names no term. It renders what the terms read, adds up what they say, and goes one step.
//! A term may ask for a render of its own, with other opacities and only some parameters learning.

mod l1;
mod ssim;

pub use l1::L1;
pub use ssim::Dssim;

use wm_render::simd::SimdPath;
use wm_render::{Channels, DepthAlpha, Frame, Learn, Opacity, Upstream};
use wm_scene::Camera;

/// The photo that a frame is compared with.
#[derive(Clone, Copy, Debug)]
pub struct Truth<'a> {
    /// `[H, W, 3]`, 0-1, display-referred.
    pub rgb: &'a [f32],
    /// `[H, W]`, 1 where the photo counts and 0 where it does not; `None` where all of it does.
    pub mask: Option<&'a [f32]>,
    /// From where.
    pub camera: &'a Camera,
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
    /// What learns from it.
    pub learn: Learn,
    /// Whether coverage learns from depth.
    pub depth_alpha: DepthAlpha,
}

/// A term of the loss.
pub trait LossTerm: Send {
    /// Its name in reports.
    fn name(&self) -> &'static str;

    /// Its weight at a step; where it is 0 the term is not called.
    fn weight(&self, step: u32) -> f64;

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
}
