//! The parts of a picture: what the air and the particles do to it, each as a picture of its own.
//!
//! In linear light, before the pixel effects:
//! ```text
//! through = clean transmittance + airlight
//! colour  = through (1 - coverage) + light
//! ```
//! `light` and `coverage` are [`crate::Frame::particles`], which come with the colour itself. The
//! others take draw passes of their own, since the air acts on each splat before they are blended,
//! and they are blended as they are encoded for a display: no sum over the splats of one pixel is
//! linear in light. So the parts are defined per pixel:
//!
//! - `clean`: the scene and its background, without air and without particles.
//! - `transmittance`: the share of light that the air lets through, the mean over what a pixel
//!   shows, weighted as its colours are ([`Shading::Transmittance`]).
//! - `airlight`: the rest, so that the sum is exact. Where a pixel shows one distance it is the
//!   light that the air adds; at silhouettes it holds what the means leave over, and may be a
//!   little below 0.

use crate::config::{Outputs, RenderConfig};
use crate::hooks::Hooks;
use crate::plan::{DrawPass, FramePlan, PictureId, Pictures, Shading};

/// A part of a picture that takes draw passes of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PicturePart {
    /// The scene without air and particles.
    Clean,
    /// The share of light that the air lets through.
    Transmittance,
    /// The light that the air adds.
    Airlight,
}

/// The parts of one picture, in linear light; those that are not wanted are empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PictureParts {
    /// The scene without air and particles, `[H, W, 3]`, 0 or more.
    pub clean: Vec<f32>,
    /// The share of light that the air lets through, by channel, `[H, W, 3]`, 0-1.
    pub transmittance: Vec<f32>,
    /// The light that the air adds, `[H, W, 3]`; at silhouettes it may be a little below 0.
    pub airlight: Vec<f32>,
}

/// The passes of a plan that make parts.
///
/// ```
/// use wm_render::parts::{PartPasses, PicturePart};
/// # use wm_render::{CpuConfig, CpuRenderer, DrawPass, FramePlan, Pictures, RenderBackend, RenderConfig, SetView};
/// # let camera = wm_scene::Camera::looking((32, 24), 50.0, glam::DVec3::ZERO, glam::DVec3::X, glam::DVec3::Z)?;
/// # let mut renderer = CpuRenderer::new(CpuConfig::default())?;
/// # let set = renderer.load(&wm_scene::Splats::default())?;
/// # let pass = DrawPass::new(&[SetView::plain(set)], &camera, &RenderConfig::default());
/// let mut plan = FramePlan::new();
/// let picture = plan.draw(pass);
/// let passes = PartPasses::append(&mut plan, picture, &[PicturePart::Transmittance]);
///
/// let mut pictures = Pictures::default();
/// renderer.execute(&plan, &mut pictures)?;
/// let parts = passes.finish(&pictures);
/// assert!(parts.transmittance.iter().all(|share| *share == 1.0)); // clear air
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct PartPasses {
    wanted: Vec<PicturePart>,
    picture: PictureId,
    clean: Option<PictureId>,
    /// `None` where it is not wanted or the air is clear.
    transmittance: Option<PictureId>,
    through: Option<PictureId>,
}

impl PartPasses {
    /// Adds the passes for the `wanted` parts of `picture`, which a draw pass of the plan makes.
    /// Its particles, its pixel effects and its outputs are left out of them. A picture that is a
    /// part itself is not drawn again.
    ///
    /// # Panics
    /// If no draw pass of the plan makes `picture`.
    #[must_use]
    pub fn append(plan: &mut FramePlan<'_>, picture: PictureId, wanted: &[PicturePart]) -> Self {
        let whole = plan.draw_of(picture).expect("the parts of a picture that a pass draws").clone();
        let is_bare = whole.hooks.particles.is_empty() && whole.hooks.pixels.is_empty();
        let is_clear = whole.hooks.medium.is_none();
        let config = RenderConfig { outputs: Outputs::default(), ..whole.config };
        let hooks = Hooks { particles: Vec::new(), pixels: Vec::new(), ..whole.hooks };
        let through = DrawPass { config, hooks, surface: None, ..whole };
        let clean = DrawPass { hooks: Hooks { medium: None, ..through.hooks.clone() }, ..through.clone() };
        let wants = |part: PicturePart| wanted.contains(&part) || wanted.contains(&PicturePart::Airlight);
        let mut passes =
            Self { wanted: wanted.to_vec(), picture, clean: None, transmittance: None, through: None };
        if wants(PicturePart::Clean) {
            passes.clean = Some(if is_clear && is_bare { picture } else { plan.draw(clean) });
        }
        if wants(PicturePart::Transmittance) && !is_clear {
            let shading = Shading::Transmittance;
            passes.transmittance = Some(plan.draw(DrawPass { shading, ..through.clone() }));
        }
        if wants(PicturePart::Airlight) {
            passes.through = match (is_clear, is_bare) {
                (true, _) => passes.clean,
                (false, true) => Some(picture),
                (false, false) => Some(plan.draw(through)),
            };
        }
        passes
    }

    /// Makes the parts from the pictures of the plan.
    ///
    /// # Panics
    /// If the plan was not carried out, or a picture was taken out of `pictures`.
    #[must_use]
    pub fn finish(&self, pictures: &Pictures) -> PictureParts {
        let wants = |part: PicturePart| self.wanted.contains(&part);
        let light = |id: Option<PictureId>| id.map(|id| pictures[id].rgb_linear()).unwrap_or_default();
        let mut parts = PictureParts { clean: light(self.clean), ..PictureParts::default() };
        if wants(PicturePart::Transmittance) || wants(PicturePart::Airlight) {
            parts.transmittance = match self.transmittance {
                None => vec![1.0; 3 * pictures[self.picture].pixels()],
                Some(id) => pictures[id].rgb.iter().map(|share| share.clamp(0.0, 1.0)).collect(),
            };
        }
        if wants(PicturePart::Airlight) {
            let through = light(self.through);
            let pixels = through.iter().zip(&parts.clean).zip(&parts.transmittance);
            parts.airlight = pixels.map(|((through, clean), share)| through - clean * share).collect();
        }
        if !wants(PicturePart::Clean) {
            parts.clean = Vec::new();
        }
        if !wants(PicturePart::Transmittance) {
            parts.transmittance = Vec::new();
        }
        parts
    }
}

#[cfg(test)]
mod tests;
