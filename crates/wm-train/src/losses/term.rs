//! The interface of the terms of the loss: their input, and what they give.

use crate::priors::Prior;
use wm_render::simd::SimdPath;
use wm_render::training::{Comparison, SplatTerms, Term};
use wm_render::{Channels, DepthAlpha, DrawnSplats, Frame, Learn, Opacity, Upstream};
use wm_scene::Camera;

/// The photo that a frame is compared with.
#[derive(Clone, Copy, Debug)]
pub struct TrainPhoto<'a> {
    /// The colours `[H, W, 3]`, 0-1, display-referred.
    pub rgb: &'a [f32],
    /// The mask `[H, W]`, 1 where the photo counts and 0 elsewhere; `None` if all of it counts.
    pub mask: Option<&'a [f32]>,
    /// The camera of the photo.
    pub camera: &'a Camera,
    /// The prior of depth, normals and sky; `None` if there is none.
    pub prior: Option<&'a Prior>,
}

impl TrainPhoto<'_> {
    /// Returns width and height, px.
    pub(crate) fn size(&self) -> (u32, u32) {
        (self.camera.width, self.camera.height)
    }
}

/// The input of a loss term.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LossInput<'a> {
    /// The render; its colours have the photo's exposure.
    pub(crate) frame: &'a Frame,
    /// The photo and its prior.
    pub(crate) truth: &'a TrainPhoto<'a>,
    /// The step of the training, from 0.
    pub(crate) step: u32,
    /// The SIMD path of loops over pixels.
    pub(crate) path: SimdPath,
}

/// Gradients of the loss by the pixels of a frame; empty if nothing was rendered, or if they are on
/// a device.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct LossGradients {
    /// `[H, W, 3]`.
    pub(crate) rgb: Vec<f32>,
    /// `[H, W]`.
    pub(crate) alpha: Vec<f32>,
    /// `[H, W]`.
    pub(crate) depth: Vec<f32>,
    /// `[H, W, 3]`.
    pub(crate) normal: Vec<f32>,
}

impl LossGradients {
    /// Sets all arrays to zeros of the sizes of `frame`.
    pub(crate) fn clear(&mut self, frame: &Frame) {
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

    /// Returns the derivatives in the form that the renderer takes.
    pub(crate) fn upstream(&self, depth_alpha: DepthAlpha) -> Upstream<'_> {
        Upstream { rgb: &self.rgb, alpha: &self.alpha, depth: &self.depth, normal: &self.normal, depth_alpha }
    }
}

/// A render for a single term.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct OwnRender {
    /// The pictures that are rendered.
    pub(crate) channels: Channels,
    /// The opacities that are used.
    pub(crate) opacity: Opacity,
    /// The splats that are drawn.
    pub(crate) drawn: DrawnSplats,
    /// The parameters that learn from it.
    pub(crate) learn: Learn,
    /// The choice of whether gradients of depth reach coverage.
    pub(crate) depth_alpha: DepthAlpha,
}

/// A term of the loss.
pub(crate) trait LossTerm: Send {
    /// Returns the name of the term in reports.
    fn name(&self) -> &'static str;

    /// Returns the weight of the term at a step on a photo; where it is 0 the term is not called.
    fn weight(&self, step: u32, truth: &TrainPhoto<'_>) -> f64;

    /// Returns the pictures that the term reads of the step's common render.
    fn channels(&self) -> Channels {
        Channels::Color
    }

    /// Returns the same term on the device that holds the pictures; `None` for a term that does not
    /// look at pictures.
    fn on_device(&self) -> Option<Term> {
        None
    }

    /// Adds to `comparison` what a device needs beside weights.
    fn prepare(&self, _step: u32, _comparison: &mut Comparison<'_>) {}

    /// Returns the render that the term has for itself instead of the common one.
    fn own_render(&self) -> Option<OwnRender> {
        None
    }

    /// Returns the value of the term before weighting, and adds `weight` times its derivative to
    /// `out`.
    fn add(&mut self, _input: &LossInput<'_>, _weight: f64, _out: &mut LossGradients) -> f64 {
        0.0
    }

    /// Adds the weight of the term to those that act on the splats themselves, whatever the picture
    /// shows.
    fn splat_terms(&self, _: f64, _: &mut SplatTerms) {}
}
