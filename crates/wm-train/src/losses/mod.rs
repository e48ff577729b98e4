//! The loss: terms, one per file, that compare renders with photos and priors.
//!
//! The trainer knows no single term: it renders the images that the terms read, adds up their
//! gradients and takes a step. A term may ask for a render of its own, with other opacities and
//! with gradients for some parameters only.
//!
//! Terms of geometry act in the same step of the optimiser: the gradients of a render of their own
//! (`LossTerm::own_render`) are added to those of the picture, and terms that ask for equal renders
//! share one. Coverage is learnt without the splats of the sky: else nothing tells a wall from a
//! wall that the sky shines through.

mod beliefs;
mod depth;
mod flat;
mod grid;
mod l1;
mod normal;
mod patches;
mod smooth;
mod ssim;
mod surface;

pub(crate) use beliefs::{beliefs, believed};
pub(crate) use depth::DepthTerm;
pub(crate) use flat::FlatTerm;
pub(crate) use l1::L1Term;
pub(crate) use normal::NormalTerm;
pub(crate) use patches::{PatchDepthTerm, PatchPass};
pub(crate) use smooth::SmoothTerm;
pub(crate) use ssim::SsimTerm;
pub(crate) use surface::SurfaceTerm;

use crate::config::TrainConfig;
use crate::priors::Prior;
use wm_render::simd::SimdPath;
use wm_render::training::{Comparison, SplatTerms, Term};
use wm_render::{Channels, DepthAlpha, DrawnSplats, Frame, Learn, Opacity, Upstream};
use wm_scene::Camera;

/// The terms of a configuration.
pub(crate) fn terms(config: &TrainConfig, path: SimdPath) -> Vec<Box<dyn LossTerm>> {
    vec![
        Box::new(L1Term { weight: config.loss.l1 }),
        Box::new(SsimTerm::new(config.loss.ssim, path)),
        Box::new(DepthTerm::new(config)),
        Box::new(PatchDepthTerm::new(config, PatchPass::Hard)),
        Box::new(PatchDepthTerm::new(config, PatchPass::Soft)),
        Box::new(SurfaceTerm::new(config)),
        Box::new(NormalTerm::new(config)),
        Box::new(FlatTerm::new(config)),
        Box::new(SmoothTerm::new(config)),
    ]
}

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
    /// Empties all arrays.
    pub(crate) fn forget(&mut self) {
        for array in [&mut self.rgb, &mut self.alpha, &mut self.depth, &mut self.normal] {
            array.clear();
        }
    }

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

/// The place where a term can be computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Reads {
    /// Only where the pictures are in the computer's memory.
    Frame,
    /// Also on the device that holds the pictures.
    Device(Term),
    /// Anywhere: the term does not look at pictures.
    Nothing,
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

    /// Returns where the term can be computed; adds to `comparison` what a device needs beside
    /// weights.
    fn reads(&self, _step: u32, _truth: &TrainPhoto<'_>, _comparison: &mut Comparison<'_>) -> Reads {
        Reads::Frame
    }

    /// Returns the render that the term has for itself instead of the common one.
    fn own_render(&self) -> Option<OwnRender> {
        None
    }

    /// Returns the value of the term before weighting, and adds `weight` times its derivative to
    /// `out`.
    fn add(&mut self, input: &LossInput<'_>, weight: f64, out: &mut LossGradients) -> f64;

    /// Adds the weight of the term to those that act on the splats themselves, whatever the picture
    /// shows.
    fn splat_terms(&self, _: f64, _: &mut SplatTerms) {}
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{GeometryConfig, Preset};
    use crate::densify::Population;
    use crate::priors::SkyClass;
    use glam::DVec3;
    use wm_base::random::uniform;
    use wm_render::testing::{Backend, gpu_differentiable, shell_camera, shell_splats};
    use wm_render::training::NO_EXPOSURE;
    use wm_render::{ForwardConfig, Resident};

    const SIZE: (u32, u32) = (12, 8);

    fn path() -> SimdPath {
        SimdPath::available()[0]
    }

    fn numbers(seed: u64, count: usize, low: f32, high: f32) -> Vec<f32> {
        (0..count as u64).map(|i| low + (high - low) * uniform(seed, i) as f32).collect()
    }

    fn frame() -> Frame {
        // Away from where the slack of coverage ends.
        let mut alpha = numbers(2, 96, 0.6, 0.93);
        alpha[7] = 0.2;
        Frame {
            width: SIZE.0,
            height: SIZE.1,
            rgb: numbers(1, 288, 0.0, 1.0),
            alpha,
            depth: numbers(3, 96, 2.0, 9.0),
            normal: numbers(4, 288, -1.0, 1.0),
            ..Frame::default()
        }
    }

    /// Half as wide and high as the frame.
    fn prior() -> Prior {
        let mut disparity = numbers(5, 24, 0.05, 0.6);
        (disparity[3], disparity[4]) = (0.0, f32::NAN);
        let class = |i: usize| [SkyClass::Place, SkyClass::Sky, SkyClass::Unknown][i % 3];
        let mut normal = numbers(6, 72, -1.0, 1.0).as_chunks().0.to_vec();
        normal[5] = [0.0; 3];
        Prior { width: 6, height: 4, disparity, sigma: 0.01, normal, sky: (0..24).map(class).collect() }
    }

    fn geometry() -> GeometryConfig {
        GeometryConfig {
            smooth: 1.0,
            every: 1,
            depth_from: 0.0,
            normal_from: 0.0,
            ..GeometryConfig::default()
        }
    }

    #[test]
    fn derivatives_are_those_of_the_values() {
        let mut config = TrainConfig::preset(Preset::Quick);
        config.loss.geometry = geometry();
        let camera = Camera::looking(SIZE, 50.0, DVec3::ZERO, DVec3::Y, DVec3::Z).unwrap();
        let (rgb, prior) = (numbers(7, 288, 0.0, 1.0), prior());
        let truth = TrainPhoto { rgb: &rgb, mask: None, camera: &camera, prior: Some(&prior) };
        let terms: Vec<Box<dyn LossTerm>> = vec![
            Box::new(DepthTerm::new(&config)),
            Box::new(SurfaceTerm::new(&config)),
            Box::new(NormalTerm::new(&config)),
            Box::new(SmoothTerm::new(&config)),
        ];
        for mut term in terms {
            let mut value = |frame: &Frame, out: &mut LossGradients| {
                out.clear(frame);
                let input = LossInput { frame, truth: &truth, step: 0, path: path() };
                term.add(&input, 3.0, out)
            };
            let (base, mut gradients) = (frame(), LossGradients::default());
            let at_base = value(&base, &mut gradients);
            assert!(at_base > 0.0);
            let mut compared = 0;
            for (array, wanted) in
                [&gradients.alpha, &gradients.depth, &gradients.normal].into_iter().enumerate()
            {
                for i in 0..wanted.len() {
                    let mut at = |step: f32| {
                        let mut moved = base.clone();
                        let values = [&mut moved.alpha, &mut moved.depth, &mut moved.normal];
                        values.into_iter().nth(array).unwrap()[i] += step;
                        value(&moved, &mut LossGradients::default())
                    };
                    let step = 1e-2;
                    let found = 3.0 * (at(step) - at(-step)) / (2.0 * f64::from(step));
                    // Second differences of steps of 1e-2, and f32 in the terms; the mean inverse
                    // depth of `Smooth` is a constant of its derivative.
                    let off = (found - f64::from(wanted[i])).abs();
                    assert!(
                        off < 2e-3 + 0.02 * found.abs(),
                        "{} {array} {i}: {found} {}",
                        ["alpha", "depth", "normal"][array],
                        wanted[i]
                    );
                    compared += usize::from(wanted[i] != 0.0);
                }
            }
            assert!(compared >= 15, "{compared}");
        }
    }

    /// The terms give the same values and derivatives on a device as here.
    fn check_device(render: Option<OwnRender>, prior: &Prior, only: &[&str]) {
        let mut config = TrainConfig::preset(Preset::Quick);
        config.loss.geometry = GeometryConfig { depth_local: 0.4, depth_margin: 0.2, ..geometry() };
        let mut gpu = gpu_differentiable();
        let population = Population::new(shell_splats(3000, 3.0, 1, 5));
        gpu.load(population.learnt()).unwrap();
        let camera = shell_camera(61, 45);
        let (width, height) = (camera.width as usize, camera.height as usize);
        let rgb = numbers(7, 3 * width * height, 0.2, 0.8);
        let mask: Vec<f32> = (0..width * height).map(|i| if i % 7 == 3 { 0.0 } else { 1.0 }).collect();
        let truth = TrainPhoto { rgb: &rgb, mask: Some(&mask), camera: &camera, prior: Some(prior) };

        let channels = render.map_or(Channels::ColorDepthNormal, |own| own.channels);
        let opacity = render.map_or(Opacity::Stored, |own| own.opacity);
        let view = ForwardConfig { channels, opacity, sh_degree: 1, ..ForwardConfig::default() };
        let mut frame = Frame::default();
        Resident::forward(&mut gpu, &camera, &view, &mut frame).unwrap();
        let mut out = LossGradients::default();
        out.clear(&frame);
        let beliefs = || beliefs(&truth);
        let mut comparison = Comparison {
            rgb: &rgb,
            mask: Some(&mask),
            exposure: NO_EXPOSURE,
            believed: Some(believed(&truth, prior, &beliefs)),
            ..Comparison::default()
        };
        let mut wanted = Vec::new();
        for mut term in terms(&config, path()).into_iter().filter(|term| only.contains(&term.name())) {
            assert_eq!(term.own_render(), render, "{}", term.name());
            let input = LossInput { frame: &frame, truth: &truth, step: 400, path: path() };
            let Reads::Device(which) = term.reads(400, &truth, &mut comparison) else { panic!("no device") };
            // Of different sizes, so that no term hides another.
            let weight = 1.0 + wanted.len() as f64;
            comparison.weights[which as usize] = weight;
            wanted.push((term.name(), which, term.add(&input, weight, &mut out)));
        }
        assert_eq!(wanted.len(), only.len());
        // Twice: the second time everything is there already.
        for _ in 0..2 {
            let (_, found) = gpu.compare(&camera, &view, &comparison).unwrap();
            for (name, which, wanted) in &wanted {
                let found = found.values[*which as usize];
                assert!((found - wanted).abs() < 1e-4 * wanted, "{name}: {found} instead of {wanted}");
            }
            let derived = gpu.upstream().unwrap();
            let (colors, rest) = derived.split_at(3 * width * height);
            let (alpha, rest) = rest.split_at(width * height);
            let (depth, normal) = rest.split_at(width * height);
            for (name, found, wanted) in [
                ("colour", colors, &out.rgb),
                ("coverage", alpha, &out.alpha),
                ("depth", depth, &out.depth),
                ("normal", normal, &out.normal),
            ] {
                let squares =
                    |of: &mut dyn Iterator<Item = f32>| of.map(|v| f64::from(v).powi(2)).sum::<f64>();
                let all = squares(&mut wanted.iter().copied());
                let off = squares(&mut wanted.iter().zip(found).map(|(a, b)| a - b));
                if all > 0.0 {
                    eprintln!("{only:?}, by {name}: {:.1e}", (off / all).sqrt());
                }
                assert!(off <= 1e-8 * all, "{only:?}, by {name}: {off:e} of {all:e}");
            }
        }
    }

    #[test]
    fn a_device_compares_as_terms_do() {
        let Some(_) = Backend::gpu() else { return };
        let config = TrainConfig::preset(Preset::Quick);
        let of = |pass| PatchDepthTerm::new(&config, pass).own_render();
        // Coarser than the picture one way and finer the other, as no prior is, and as most are.
        for (width, height) in [(40, 60), (24, 18)] {
            let cells = width as usize * height as usize;
            let mut disparity = numbers(5, cells, 0.0, 0.3);
            (disparity[3], disparity[4]) = (0.0, f32::NAN);
            let unit = |n: [f32; 3]| n.map(|v| v / (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt());
            let mut normal: Vec<_> =
                numbers(6, 3 * cells, -1.0, 1.0).as_chunks().0.iter().map(|n| unit(*n)).collect();
            normal[5] = [0.0; 3];
            let class = |i: usize| [SkyClass::Place, SkyClass::Sky, SkyClass::Unknown][i / 5 % 3];
            let prior =
                Prior { width, height, disparity, sigma: 0.01, normal, sky: (0..cells).map(class).collect() };
            check_device(None, &prior, &["l1", "dssim", "depth", "normal", "smooth"]);
            check_device(SurfaceTerm::new(&config).own_render(), &prior, &["surface"]);
            check_device(of(PatchPass::Hard), &prior, &["depth-hard"]);
            check_device(of(PatchPass::Soft), &prior, &["depth-soft"]);
        }
    }

    #[test]
    fn where_nothing_is_believed_nothing_is_asked() {
        let mut config = TrainConfig::preset(Preset::Quick);
        config.loss.geometry = geometry();
        let camera = Camera::looking(SIZE, 50.0, DVec3::ZERO, DVec3::Y, DVec3::Z).unwrap();
        let rgb = numbers(7, 288, 0.0, 1.0);
        let empty = Prior { width: 6, height: 4, ..Prior::default() };
        for prior in [None, Some(&empty)] {
            let truth = TrainPhoto { rgb: &rgb, mask: None, camera: &camera, prior };
            for term in terms(&config, path()) {
                let is_free = ["l1", "dssim", "smooth"].contains(&term.name())
                    || term.name() == "flat" && prior.is_some();
                assert_eq!(term.weight(500, &truth) > 0.0, is_free, "{}", term.name());
            }
        }
        config.loss.geometry = GeometryConfig::NONE;
        let believed = prior();
        let truth = TrainPhoto { rgb: &rgb, mask: None, camera: &camera, prior: Some(&believed) };
        let on = terms(&config, path()).iter().filter(|term| term.weight(500, &truth) > 0.0).count();
        assert_eq!(on, 2);
    }
}
