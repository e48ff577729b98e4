//! A frame as a list of passes, which a back end carries out in order.
//!
//! A [`DrawPass`] draws splats with a camera. A [`PicturePass`] works on whole finished pictures:
//! it sees colour, depth and normals of every pixel, and other pictures of the same plan. Most
//! frames are one draw pass; the paper's rain draws each sub-cloud by itself and lays it over the
//! scene, and the parts of a picture ([`crate::parts`]) are three draw passes.
//!
//! ```
//! use wm_render::{CpuConfig, CpuRenderer, DrawPass, FramePlan, Pictures, RenderBackend, RenderConfig, SetView};
//! # use wm_render::{Frame, PictureEffect, simd::SimdPath};
//! # use wm_scene::{Camera, Splats};
//! # struct Mean;
//! # impl PictureEffect for Mean {
//! #     fn apply(&self, _: SimdPath, picture: &mut Frame, inputs: &[&Frame]) {
//! #         picture.rgb.iter_mut().zip(&inputs[0].rgb).for_each(|(a, b)| *a = 0.5 * (*a + *b));
//! #     }
//! # }
//! # let camera = Camera::looking((32, 24), 50.0, glam::DVec3::ZERO, glam::DVec3::X, glam::DVec3::Z)?;
//! # let (splats, other) = (Splats::default(), Splats::default());
//! let mut renderer = CpuRenderer::new(CpuConfig::default())?;
//! let set = renderer.load(&splats)?;
//! let config = RenderConfig::default();
//!
//! let mut plan = FramePlan::new();
//! let scene = plan.draw(DrawPass::new(&[SetView::plain(set)], &camera, &config));
//! let noise = plan.draw(DrawPass::new(&[SetView::transient(&other)], &camera, &config));
//! plan.apply(&Mean, scene, &[noise]);
//!
//! let mut pictures = Pictures::default();
//! renderer.execute(&plan, &mut pictures)?;
//! assert_eq!(pictures[scene].width, 32);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use crate::config::{RenderConfig, SetId};
use crate::frame::{ColorEncoding, Frame};
use crate::hooks::{Backdrop, Hooks, Particles, SplatAttributes};
use crate::simd::SimdPath;
use std::ops::{Index, IndexMut};
use wm_scene::{Camera, Splats};

/// Passes in the order in which they are carried out.
///
/// Passes write to pictures, which [`Pictures`] holds after [`crate::RenderBackend::execute`].
/// Several passes may write to one picture: a draw pass overwrites it, an effect changes it. A plan
/// starts from nothing: what pictures hold from the frame before is memory, not input.
#[derive(Clone, Default)]
pub struct FramePlan<'a> {
    pub(crate) passes: Vec<FramePass<'a>>,
    pub(crate) pictures: usize,
}

/// One pass of a [`FramePlan`].
#[derive(Clone)]
pub enum FramePass<'a> {
    /// Draws splats.
    Draw {
        /// The picture that is overwritten.
        target: PictureId,
        /// The view.
        pass: Box<DrawPass<'a>>,
    },
    /// Works on a finished picture.
    Picture(PicturePass<'a>),
}

impl<'a> FramePlan<'a> {
    /// A plan without passes.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a draw pass into a new picture.
    pub fn draw(&mut self, pass: DrawPass<'a>) -> PictureId {
        let target = PictureId(self.pictures);
        self.pictures += 1;
        self.draw_into(target, pass);
        target
    }

    /// Adds a draw pass that overwrites a picture which earlier passes are done with: this saves
    /// memory.
    ///
    /// # Panics
    /// If `target` is not of this plan.
    pub fn draw_into(&mut self, target: PictureId, pass: DrawPass<'a>) {
        self.check(target);
        self.passes.push(FramePass::Draw { target, pass: Box::new(pass) });
    }

    /// Adds an effect that changes `picture`.
    ///
    /// # Panics
    /// If `picture` or an input is not of this plan, or `picture` is among its own inputs.
    pub fn apply(&mut self, effect: &'a dyn PictureEffect, picture: PictureId, inputs: &[PictureId]) {
        self.check(picture);
        inputs.iter().for_each(|id| self.check(*id));
        assert!(!inputs.contains(&picture), "a picture pass reads the picture that it changes");
        self.passes.push(FramePass::Picture(PicturePass {
            target: picture,
            inputs: inputs.to_vec(),
            effect,
        }));
    }

    /// The last draw pass into a picture.
    pub(crate) fn draw_of(&self, picture: PictureId) -> Option<&DrawPass<'a>> {
        self.passes.iter().rev().find_map(|pass| match pass {
            FramePass::Draw { target, pass } if *target == picture => Some(&**pass),
            _ => None,
        })
    }

    fn check(&self, id: PictureId) {
        assert!(id.0 < self.pictures, "picture {} is not of this plan, which has {}", id.0, self.pictures);
    }
}

/// One view of splats.
#[derive(Clone)]
pub struct DrawPass<'a> {
    /// The splat sets, drawn together.
    pub sets: Vec<SetView<'a>>,
    /// The camera.
    pub camera: Camera,
    /// The camera of the whole picture, where `camera` shows a part of it: splats beside the
    /// picture are as wide as they are there.
    pub whole: Option<Camera>,
    /// The outputs, the background and the rasterization.
    pub config: RenderConfig,
    /// The air, the background, the particles and the pixel effects of the weather.
    pub hooks: Hooks<'a>,
    /// The meaning of the picture's colours.
    pub shading: Shading,
    /// A surface inside the blend, such as water. It changes no colour: the pass fills
    /// [`Frame::front`] with the sums before and behind the surface, and keeps particles out of the
    /// colours, in [`Frame::particles`] alone. The contract of [`crate::stages::rasterize`] has the
    /// formulas.
    pub surface: Option<BlendSurface<'a>>,
    /// Splats whose centre lies below this plane are not drawn.
    pub cut: Option<CutPlane>,
}

/// A surface inside the blend of splats.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlendSurface<'a> {
    /// View z of the surface at each pixel, scene units, `[H, W]`; NaN where there is none.
    pub depth: &'a [f32],
    /// Unit normal, world axes. Splats are split as if they were flat along it.
    pub normal: [f64; 3],
}

/// A plane below which nothing is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CutPlane {
    /// Normal towards what is drawn, world axes, length 1.
    pub normal: [f64; 3],
    /// Height of the plane along the normal, scene units.
    pub height: f64,
}

impl CutPlane {
    /// The plane as seen from a point: a normal, and the height of the plane above the point. A
    /// splat at `offset` from the point is drawn if `normal . offset >= height`.
    pub(crate) fn seen_from(&self, center: [f64; 3]) -> [f32; 4] {
        let [x, y, z] = self.normal;
        let own = x * center[0] + y * center[1] + z * center[2];
        [x, y, z, self.height - own].map(|v| v as f32)
    }
}

impl<'a> DrawPass<'a> {
    /// Makes a view of `sets` in clear air.
    #[must_use]
    pub fn new(sets: &[SetView<'a>], camera: &Camera, config: &RenderConfig) -> Self {
        Self {
            sets: sets.to_vec(),
            camera: *camera,
            whole: None,
            config: *config,
            hooks: Hooks::default(),
            shading: Shading::default(),
            surface: None,
            cut: None,
        }
    }

    /// Returns the particles that are drawn: none if the picture holds transmittances.
    pub(crate) fn particles(&self) -> &[&'a dyn Particles] {
        match self.shading {
            Shading::Color => &self.hooks.particles,
            Shading::Transmittance => &[],
        }
    }

    /// The encoding of the picture's colours.
    pub(crate) fn encoding(&self) -> ColorEncoding {
        match self.shading {
            Shading::Color => ColorEncoding::Srgb,
            Shading::Transmittance => ColorEncoding::Linear,
        }
    }

    /// The background behind the splats.
    pub(crate) fn backdrop(&self) -> &dyn Backdrop {
        self.hooks.background.unwrap_or(&self.config.background)
    }

    /// Sets the weather of the view.
    #[must_use]
    pub fn with_hooks(self, hooks: Hooks<'a>) -> Self {
        Self { hooks, ..self }
    }
}

/// The meaning of a drawn picture's colours.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Shading {
    /// Colours as seen through the air, display-referred.
    #[default]
    Color,
    /// The share of light that the air lets through from each splat and from the background, by
    /// channel, 0-1. Splats have no other colour, and particles are not drawn.
    Transmittance,
}

/// The splats of a [`SetView`].
#[derive(Clone, Copy)]
pub enum SplatSource<'a> {
    /// A set that the renderer holds.
    Loaded(SetId),
    /// Splats that the renderer loads for one plan and forgets afterwards.
    Transient(&'a Splats),
}

/// A splat set of a draw pass, with the attributes that change from frame to frame.
#[derive(Clone, Copy)]
pub struct SetView<'a> {
    /// The splats.
    pub(crate) splats: SplatSource<'a>,
    /// Attributes that each splat has in this pass alone; `None` if all are neutral.
    pub attributes: Option<&'a dyn SplatAttributes>,
}

impl<'a> SetView<'a> {
    /// Views a loaded set without attributes.
    #[must_use]
    pub fn plain(set: SetId) -> Self {
        Self { splats: SplatSource::Loaded(set), attributes: None }
    }

    /// Views splats that are loaded for one plan, without attributes.
    #[must_use]
    pub fn transient(splats: &'a Splats) -> Self {
        Self { splats: SplatSource::Transient(splats), attributes: None }
    }

    /// Sets the attributes of the splats.
    #[must_use]
    pub fn with_attributes(self, attributes: Option<&'a dyn SplatAttributes>) -> Self {
        Self { attributes, ..self }
    }
}

/// A change of a whole finished picture.
pub trait PictureEffect: Sync {
    /// Changes `picture`; `inputs` are the pictures that the pass was given, in that order. Runs on
    /// the threads of the back end.
    fn apply(&self, path: SimdPath, picture: &mut Frame, inputs: &[&Frame]);
}

/// A pass over whole pictures.
#[derive(Clone)]
pub struct PicturePass<'a> {
    /// The picture that is changed.
    pub(crate) target: PictureId,
    /// Other pictures that are read.
    pub(crate) inputs: Vec<PictureId>,
    /// The change.
    pub(crate) effect: &'a dyn PictureEffect,
}

impl PicturePass<'_> {
    /// Runs the pass.
    pub(crate) fn run(&self, path: SimdPath, pictures: &mut Pictures) {
        let mut picture = pictures.take(self.target);
        let inputs: Vec<&Frame> = self.inputs.iter().map(|id| &pictures[*id]).collect();
        self.effect.apply(path, &mut picture, &inputs);
        pictures.put(self.target, picture);
    }
}

/// Names a picture of a [`FramePlan`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PictureId(usize);

/// The pictures that a plan made. Keep it from frame to frame: memory that fits is used again.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pictures {
    frames: Vec<Frame>,
}

impl Pictures {
    /// Takes a picture out; an empty frame stays in its place.
    pub fn take(&mut self, id: PictureId) -> Frame {
        self.frames.get_mut(id.0).map(std::mem::take).unwrap_or_default()
    }

    /// Puts a frame in a picture's place, for its memory or as the result of work outside of a
    /// plan.
    pub fn put(&mut self, id: PictureId, frame: Frame) {
        self.fit(id.0 + 1);
        self.frames[id.0] = frame;
    }

    /// Makes room for the pictures of a plan.
    pub(crate) fn fit(&mut self, count: usize) {
        if self.frames.len() < count {
            self.frames.resize_with(count, Frame::default);
        }
    }
}

impl Index<PictureId> for Pictures {
    type Output = Frame;

    /// # Panics
    /// If no plan with this picture was carried out.
    fn index(&self, id: PictureId) -> &Frame {
        &self.frames[id.0]
    }
}

impl IndexMut<PictureId> for Pictures {
    fn index_mut(&mut self, id: PictureId) -> &mut Frame {
        &mut self.frames[id.0]
    }
}

#[cfg(test)]
mod tests;
