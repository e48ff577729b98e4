//! The picture in parts: what the air and what falls do to it, each as a picture of its own.
//!
//! In linear light, before the pixel effects:
//! ```text
//! through = clean transmittance + airlight
//! colour  = through (1 - coverage) + light
//! ```
//! `light` and `coverage` are [`Frame::particles`], which come with the colour itself. The others take renders of
//! their own, since the air acts on each splat before they are blended, and they are blended as they are encoded for
//! a display: no sum over the splats of one pixel is linear in light. So the parts are defined a pixel:
//!
//! - `clean`: the scene and what stands behind it, without air and without what falls.
//! - `transmittance`: the share of light that the air lets through, the mean over what a pixel shows, weighted as its
//!   colours are. Each splat's own is the difference of a white and a black one seen through the air.
//! - `airlight`: what is left, so that the sum is exact. Where a pixel shows one distance it is the light of the air;
//!   at silhouettes it holds what the means leave over, and may be a little below 0.
//!
//! Tolerance: [`Transmitting`] goes through the display's encoding twice and subtracts, 4e-6 of white.

use crate::dispatch;
use crate::frame::{Frame, srgb_decode};
use crate::hooks::{Backdrop, GROUP, Hooks, Medium, ShadeGroup, SkySplats, Twin};
use crate::renderer::{Job, Outputs, RenderConfig, RenderError, Renderer, Stats};
use crate::simd::{self, Lanes, SimdPath};
use fearless_simd::SimdBase;

/// A part that takes renders of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pass {
    /// One render more.
    Clean,
    /// One render more; none in clear air.
    Transmittance,
    /// Three renders more, those of the other two among them; one in clear air.
    Airlight,
}

/// The parts of one picture, linear light; those that were not asked for are empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Passes {
    /// The scene without air and what falls, `[H, W, 3]`, 0 or more.
    pub clean: Vec<f32>,
    /// The share of its light that the air lets through, by channel, `[H, W, 3]`, 0-1.
    pub transmittance: Vec<f32>,
    /// What the air adds, `[H, W, 3]`; at silhouettes it may be a little below 0.
    pub airlight: Vec<f32>,
}

impl Passes {
    /// Renders the parts of `job` that are `wanted`, and empties the others; the colour itself is left to the caller.
    /// Of `job`, what falls, the pixel effects and the outputs are left out.
    ///
    /// # Errors
    /// [`RenderError`] as of [`Renderer::render`].
    pub fn render(
        &mut self,
        renderer: &mut dyn Renderer,
        job: &Job<'_>,
        wanted: &[Pass],
    ) -> Result<Stats, RenderError> {
        let mut stats = Stats::default();
        let config = RenderConfig { outputs: Outputs::default(), ..job.config.clone() };
        let wants = |pass: Pass| wanted.contains(&pass);
        let air = job.hooks.medium;
        let mut frame = Frame::default();
        let mut seen = |hooks: Hooks<'_>| {
            stats += renderer.render(&Job { config: &config, hooks, ..*job }, &mut frame)?;
            Ok::<_, RenderError>((frame.rgb.clone(), frame.rgb_linear()))
        };
        let bare = Hooks { medium: None, particles: &[], pixels: &[], ..job.hooks };
        *self = Self::default();
        if wants(Pass::Clean) || wants(Pass::Airlight) {
            self.clean = seen(bare)?.1;
        }
        if wants(Pass::Transmittance) || wants(Pass::Airlight) {
            let (width, height) = (job.camera.width as usize, job.camera.height as usize);
            self.transmittance = match air {
                None => vec![1.0; 3 * width * height],
                Some(air) => {
                    let (white, air) = (White(job.hooks.sky_splats()), Transmitting(air));
                    let hooks = Hooks { background: Some(&white), medium: Some(&air), ..bare };
                    // Shares, not colours: they are blended as they are.
                    seen(hooks)?.0.iter().map(|share| share.clamp(0.0, 1.0)).collect()
                }
            };
        }
        if wants(Pass::Airlight) {
            let through = match air {
                None => self.clean.clone(),
                Some(_) => seen(Hooks { medium: air, ..bare })?.1,
            };
            let parts = through.iter().zip(&self.clean).zip(&self.transmittance);
            self.airlight = parts.map(|((through, clean), share)| through - clean * share).collect();
        }
        for (pass, array) in [(Pass::Clean, &mut self.clean), (Pass::Transmittance, &mut self.transmittance)]
        {
            if !wanted.contains(&pass) {
                *array = Vec::new();
            }
        }
        Ok(stats)
    }
}

/// White in all directions, where the sky's splats are taken as they are with another backdrop.
struct White(SkySplats);

impl Backdrop for White {
    fn paint(&self, _: f64, groups: &mut [ShadeGroup]) {
        groups.iter_mut().for_each(|group| group.rgb = [[1.0; GROUP]; 3]);
    }

    fn reference(&self, _: f64, _: [f64; 3]) -> [f64; 3] {
        [1.0; 3]
    }

    fn uniform(&self) -> Option<[f32; 3]> {
        Some([1.0; 3])
    }

    fn sky_splats(&self) -> SkySplats {
        self.0
    }
}

/// An air that colours everything with the share of light that another one lets through from there, 0-1, not
/// encoded.
pub struct Transmitting<'a>(pub &'a dyn Medium);

impl Medium for Transmitting<'_> {
    fn shade(&self, path: SimdPath, origin: [f32; 3], groups: &mut [ShadeGroup]) {
        let mut black = groups.to_vec();
        groups.iter_mut().for_each(|group| group.rgb = [[1.0; GROUP]; 3]);
        black.iter_mut().for_each(|group| group.rgb = [[0.0; GROUP]; 3]);
        self.0.shade(path, origin, groups);
        self.0.shade(path, origin, &mut black);
        dispatch!(path, s => subtract(s, groups, &black));
    }

    fn reference(&self, origin: [f64; 3], direction: [f64; 3], distance: f64, _: [f64; 3]) -> [f64; 3] {
        let [white, black] = [1.0, 0.0].map(|v| self.0.reference(origin, direction, distance, [v; 3]));
        std::array::from_fn(|k| srgb_decode(white[k]) - srgb_decode(black[k]))
    }

    fn twin(&self, origin: [f32; 3]) -> Option<Twin> {
        let Twin { wgsl, parameters } = self.0.twin(origin)?;
        // The air's own function under another name.
        let wgsl = wgsl.replace("fn seen_through(", "fn seen_through_air(")
            + "
fn seen_through(direction: vec3<f32>, distance: f32, rgb: vec3<f32>) -> vec3<f32> {
    let white = srgb_decode(seen_through_air(direction, distance, vec3<f32>(1.0)));
    let black = srgb_decode(seen_through_air(direction, distance, vec3<f32>(0.0)));
    return max(white - black, vec3<f32>(0.0));
}
";
        Some(Twin { wgsl: wgsl.into(), parameters })
    }

    fn name(&self) -> &'static str {
        self.0.name()
    }
}

/// The difference in linear light, not below 0.
#[inline(always)]
fn subtract<S: Lanes>(simd: S, groups: &mut [ShadeGroup], less: &[ShadeGroup]) {
    for (group, less) in groups.iter_mut().zip(less) {
        for first in (0..GROUP).step_by(S::N) {
            let light = |group: &ShadeGroup| {
                let mut color = [simd.set(0.0); 3];
                for k in 0..3 {
                    color[k] = simd.load(&group.rgb[k][first..]);
                }
                simd::srgb_decode(simd, color)
            };
            let (more, less) = (light(group), light(less));
            for k in 0..3 {
                let share = (more[k] - less[k]).max(simd.set(0.0));
                share.store_slice(&mut group.rgb[k][first..first + S::N]);
            }
        }
    }
}

#[cfg(test)]
mod tests;
