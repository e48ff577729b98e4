//! The interface of differentiable back ends: renders for training, and their gradients.
//!
//! A step is [`forward`](Differentiable::forward), a loss on the frame, and
//! [`backward`](Differentiable::backward) with the loss's derivative by each picture.
//!
//! The trainer knows no other interface. A back end on a GPU also offers [`Resident`]: the splats
//! stay on the device with what the optimiser remembers of them;
//! [`optimize`](crate::stages::optimize) moves them there, [`compare`](crate::stages::compare)
//! compares pictures with photos and priors there, and only sums come back.

use crate::error::RenderError;
use crate::even_air::EvenAir;
use crate::frame::{Arrays, ColorEncoding, Frame};
use crate::gradients::{Gradients, Learn};
use crate::renderer::{Stats, check_count};
use crate::simd::SimdPath;
use crate::stages::compare::{Compared, Comparison};
use crate::stages::optimize::{Changed, Learnt, LearntMut, Noise, Shapes, Step};
use std::sync::Arc;
use wm_scene::{Camera, Rasterization, Splats, sh};

/// A back end of training: renders splats in stored form, and derives.
///
/// Splats should be in an order in which neighbours are near in space (a Morton curve): runs of 256
/// are worked on together. Unlike a [`RenderBackend`](crate::RenderBackend), which checks a set
/// once, this does not check parameters: a splat whose position, rotation, scale or opacity is NaN
/// is not drawn, and a NaN colour shows.
pub trait Differentiable: Send {
    /// Names the back end for reports.
    fn describe(&self) -> String;

    /// The SIMD path of the CPU's work, its share of a step or all of it.
    fn path(&self) -> SimdPath;

    /// The threads of that, for the rest of a step too: losses, the optimiser.
    fn pool(&self) -> &Arc<rayon::ThreadPool>;

    /// Renders `splats` into `frame`, and keeps what [`Self::backward`] needs.
    ///
    /// # Errors
    /// [`RenderError`] if the camera cannot be rendered with, arrays do not fit each other, memory
    /// is short or the device fails.
    ///
    /// # Panics
    /// If `config.sh_degree` is above that of the splats.
    fn forward(
        &mut self,
        splats: &Splats,
        camera: &Camera,
        config: &ForwardConfig,
        frame: &mut Frame,
    ) -> Result<Stats, RenderError>;

    /// The gradients of the loss whose derivative by each pixel of the last frame is `upstream`.
    /// `splats` must be those of that [`Self::forward`], not changed since. It may be called again,
    /// with another loss.
    ///
    /// # Errors
    /// [`RenderError`] if the device fails.
    ///
    /// # Panics
    /// If there was no forward pass, if `splats` are others in number, or if a picture has the
    /// wrong size or was not rendered.
    fn backward(
        &mut self,
        splats: &Splats,
        upstream: &Upstream<'_>,
        learn: Learn,
        gradients: &mut Gradients,
    ) -> Result<(), RenderError>;

    /// Returns the back end of splats that stay on the device; `None` for the CPU, in whose memory
    /// they are anyway.
    fn resident(&mut self) -> Option<&mut dyn Resident> {
        None
    }

    /// Goes on with another device after `error`, if there is one to go on with.
    ///
    /// # Errors
    /// `error`, if there is none.
    fn give_up(&mut self, error: RenderError) -> Result<(), RenderError> {
        Err(error)
    }
}

/// Splats that stay on the device where they learn, with what the optimiser remembers of them. What
/// is done is queued: a failure may be told by a later call.
///
/// A step is [`forward`](Self::forward), [`backward`](Self::backward) for the step and for other
/// renders of the same view, and [`optimize`](Self::optimize).
pub trait Resident {
    /// Takes splats with what is known of them, in place of those that were there.
    ///
    /// # Errors
    /// [`RenderError`] if arrays do not fit each other, memory is short or the device fails.
    fn load(&mut self, learnt: Learnt<'_>) -> Result<(), RenderError>;

    /// Number of splats.
    fn count(&self) -> usize;

    /// Gives back what decides which splats come and go.
    ///
    /// # Errors
    /// [`RenderError`] if the device fails.
    ///
    /// # Panics
    /// If none were loaded.
    fn shapes(&mut self) -> Result<Shapes, RenderError>;

    /// Takes splats that came of those that are there, in place of them.
    ///
    /// # Errors
    /// [`RenderError`] if arrays do not fit each other, memory is short or the device fails.
    ///
    /// # Panics
    /// If none were loaded, or one comes from a splat that was not there.
    fn rearrange(&mut self, changed: &Changed<'_>) -> Result<(), RenderError>;

    /// Gives back what was learnt.
    ///
    /// # Errors
    /// [`RenderError`] if the device fails.
    ///
    /// # Panics
    /// If none were loaded, or others in number.
    fn read(&mut self, learnt: LearntMut<'_>) -> Result<(), RenderError>;

    /// As [`Differentiable::forward`], of the splats that were loaded.
    ///
    /// # Errors
    /// As [`Differentiable::forward`].
    ///
    /// # Panics
    /// As [`Differentiable::forward`], and if no splats were loaded.
    fn forward(
        &mut self,
        camera: &Camera,
        config: &ForwardConfig,
        frame: &mut Frame,
    ) -> Result<Stats, RenderError>;

    /// As [`Self::forward`], with pictures compared where they are. They do not come back; the
    /// [`Self::backward`] that follows has their derivative from here, and those in `upstream` are
    /// empty.
    ///
    /// # Errors
    /// As [`Self::forward`].
    ///
    /// # Panics
    /// As [`Self::forward`], and if the photo has another size.
    fn compare(
        &mut self,
        camera: &Camera,
        config: &ForwardConfig,
        comparison: &Comparison<'_>,
    ) -> Result<(Stats, Compared), RenderError>;

    /// As [`Differentiable::backward`]; gradients stay on the device.
    ///
    /// # Errors
    /// As [`Differentiable::backward`].
    ///
    /// # Panics
    /// As [`Differentiable::backward`], if a step is not of everything, and if it is added to one
    /// that is not there.
    fn backward(&mut self, upstream: &Upstream<'_>, target: Target) -> Result<(), RenderError>;

    /// Moves the splats along the step's gradients.
    ///
    /// # Errors
    /// [`RenderError`] if the device fails.
    ///
    /// # Panics
    /// If there are no gradients of a step.
    fn optimize(&mut self, step: &Step) -> Result<(), RenderError>;

    /// Moves what is nearly transparent at random.
    ///
    /// # Errors
    /// [`RenderError`] if the device fails.
    fn explore(&mut self, noise: &Noise) -> Result<(), RenderError>;

    /// The times of the stages the last time that they had run before the last forward pass came
    /// back, if the device has a clock.
    fn clock(&self) -> Option<StepClock>;
}

/// Times of a step by the device's own clock, seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepClock {
    /// From splats to tile lists.
    pub lists: f64,
    /// From there to pictures.
    pub rasterize: f64,
    /// Colours against the photo.
    pub compare: f64,
    /// From pixels to slots.
    pub rasterize_backward: f64,
    /// From slots to gradients.
    pub project_backward: f64,
    /// From gradients to parameters, and their noise.
    pub optimize: f64,
}

/// The destination of gradients on the device.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Target {
    /// They are those of the step: of everything, in a render with colours and stored opacities.
    Step,
    /// They are added to those of the step, as far as they learn, for the splats that it has in
    /// view.
    Added(Learn),
}

/// The settings of a render for a step of training.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ForwardConfig {
    /// The pictures.
    pub channels: Channels,
    /// The colour behind all splats, display-referred.
    pub background: [f32; 3],
    /// The drawing of splats smaller than a pixel.
    pub rasterization: Rasterization,
    /// The source of opacities.
    pub opacity: Opacity,
    /// The splats that are drawn.
    pub drawn: DrawnSplats,
    /// Degree of the spherical harmonics in use, at most that of the splats: it grows in training.
    pub sh_degree: u8,
    /// The haze through which all splats but the sky's are seen. It is a constant to gradients: by
    /// a splat's colour they go through it, by its position they do not.
    pub air: Option<EvenAir>,
}

impl Default for ForwardConfig {
    fn default() -> Self {
        Self {
            channels: Channels::Color,
            background: [0.0; 3],
            rasterization: Rasterization::default(),
            opacity: Opacity::Stored,
            drawn: DrawnSplats::All,
            sh_degree: sh::MAX_DEGREE,
            air: None,
        }
    }
}

impl ForwardConfig {
    /// Checks what is to be rendered, and sizes the frame.
    pub(crate) fn check(
        &self,
        splats: &Splats,
        camera: &Camera,
        frame: &mut Frame,
    ) -> Result<(), RenderError> {
        splats.check()?;
        check_count(splats.len())?;
        self.check_view(splats.sh_degree, camera, frame)
    }

    /// Checks a view of splats that were checked before, whose colours are of `degree`, and sizes
    /// the frame.
    pub(crate) fn check_view(
        &self,
        degree: u8,
        camera: &Camera,
        frame: &mut Frame,
    ) -> Result<(), RenderError> {
        self.check_camera(degree, camera)?;
        let arrays = Arrays {
            front: false,
            rgb: self.channels.has_color(),
            depth: self.channels.depth().is_some(),
            median_depth: false,
            normal: self.channels.has_normal(),
            particles: false,
        };
        frame.prepare(camera.width, camera.height, ColorEncoding::Srgb, arrays)
    }

    /// Checks a camera and the settings for splats whose colours are of `degree`.
    pub(crate) fn check_camera(&self, degree: u8, camera: &Camera) -> Result<(), RenderError> {
        assert!(self.sh_degree <= degree, "SH degree {} of splats with {degree}", self.sh_degree);
        Ok(camera.check()?)
    }

    /// The parameters of `learn` that this render has gradients for.
    pub(crate) fn learns(&self, learn: Learn) -> Learn {
        let logit_opacities = learn.logit_opacities && self.opacity == Opacity::Stored;
        Learn { logit_opacities, sh: learn.sh && self.channels.has_color(), ..learn }
    }
}

/// The pictures of a training render; alpha is always there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Channels {
    /// Colour.
    #[default]
    Color,
    /// Colour and expected depth.
    ColorDepth,
    /// Colour, expected depth and normals.
    ColorDepthNormal,
    /// Expected depth without colour: for losses that ask for a render of their own.
    Depth,
}

impl Channels {
    /// Every combination.
    #[cfg(all(feature = "gpu", any(test, feature = "testing")))]
    pub(crate) const ALL: [Self; 4] = [Self::Color, Self::ColorDepth, Self::ColorDepthNormal, Self::Depth];

    /// Number of sums blended.
    #[must_use]
    pub const fn count(self) -> usize {
        match self {
            Self::Color => 3,
            Self::ColorDepth => 4,
            Self::ColorDepthNormal => 7,
            Self::Depth => 1,
        }
    }

    /// Returns true if there is colour.
    pub(crate) const fn has_color(self) -> bool {
        !matches!(self, Self::Depth)
    }

    /// The index of view z among the blended sums.
    pub(crate) const fn depth(self) -> Option<usize> {
        match self {
            Self::Color => None,
            Self::ColorDepth | Self::ColorDepthNormal => Some(3),
            Self::Depth => Some(0),
        }
    }

    /// Returns true if there are normals.
    pub(crate) const fn has_normal(self) -> bool {
        matches!(self, Self::ColorDepthNormal)
    }
}

/// The source of a splat's opacity.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Opacity {
    /// The splat's own opacity.
    #[default]
    Stored,
    /// This one for all, 0-1: surfaces by position alone.
    Fixed(f32),
}

/// The splats that are drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DrawnSplats {
    /// All.
    #[default]
    All,
    /// All but the group [`Sky`](wm_scene::Group::Sky): what stands in front of it.
    WithoutSky,
}

/// The gradient of expected depth by the coverage that it was divided by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DepthAlpha {
    /// The exact derivative of `sum w z / alpha`.
    #[default]
    Learns,
    /// Alpha is taken for a constant, so that no loss on depth can be lowered by transparency
    /// alone.
    Detached,
}

/// The derivative of a loss by each pixel of a frame. An empty picture has none.
#[derive(Clone, Copy, Debug, Default)]
pub struct Upstream<'a> {
    /// By [`Frame::rgb`](crate::Frame::rgb), `[H, W, 3]`.
    pub rgb: &'a [f32],
    /// By [`Frame::alpha`](crate::Frame::alpha), `[H, W]`.
    pub alpha: &'a [f32],
    /// By [`Frame::depth`](crate::Frame::depth), `[H, W]`.
    pub depth: &'a [f32],
    /// By [`Frame::normal`](crate::Frame::normal), `[H, W, 3]`.
    pub normal: &'a [f32],
    /// The reach of the gradient of depth.
    pub depth_alpha: DepthAlpha,
}

impl Upstream<'_> {
    /// Checks sizes.
    ///
    /// # Panics
    /// If a picture has the wrong size, or was not rendered.
    pub(crate) fn check(&self, pixels: usize, channels: Channels) {
        let empty_or = |name: &str, found: usize, expected: usize| {
            assert!(found == 0 || found == expected, "upstream {name}: {found} values, not {expected}");
        };
        empty_or("rgb", self.rgb.len(), if channels.has_color() { 3 * pixels } else { 0 });
        empty_or("alpha", self.alpha.len(), pixels);
        empty_or("depth", self.depth.len(), if channels.depth().is_some() { pixels } else { 0 });
        empty_or("normal", self.normal.len(), if channels.has_normal() { 3 * pixels } else { 0 });
    }
}

#[cfg(test)]
mod tests;
