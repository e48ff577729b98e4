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
mod term;

pub(crate) use beliefs::{beliefs, believed};
pub(crate) use depth::DepthTerm;
pub(crate) use flat::FlatTerm;
pub(crate) use l1::L1Term;
pub(crate) use normal::NormalTerm;
pub(crate) use patches::{PatchDepthTerm, PatchPass};
pub(crate) use smooth::SmoothTerm;
pub(crate) use ssim::SsimTerm;
pub(crate) use surface::SurfaceTerm;
pub use term::TrainPhoto;
pub(crate) use term::{LossGradients, LossInput, LossTerm, OwnRender};

use crate::config::TrainConfig;
use crate::ssim::Ssim;
use wm_render::simd::SimdPath;

/// The terms of a configuration.
pub(crate) fn terms(config: &TrainConfig, path: SimdPath) -> Vec<Box<dyn LossTerm>> {
    let (geometry, steps) = (config.loss.geometry, config.steps);
    vec![
        Box::new(L1Term { weight: config.loss.l1 }),
        Box::new(SsimTerm { weight: config.loss.ssim, ssim: Ssim::new(path) }),
        Box::new(DepthTerm { geometry, steps }),
        Box::new(PatchDepthTerm::new(config, PatchPass::Hard)),
        Box::new(PatchDepthTerm::new(config, PatchPass::Soft)),
        Box::new(SurfaceTerm { weight: geometry.surface, every: geometry.every.max(1) }),
        Box::new(NormalTerm { weight: geometry.normal, from: geometry.normal_from(steps) }),
        Box::new(FlatTerm { weight: geometry.flat }),
        Box::new(SmoothTerm { weight: geometry.smooth, from: geometry.depth_from(steps) }),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{GeometryConfig, Preset};
    use crate::densify::Population;
    use crate::priors::{Prior, SkyClass};
    use glam::DVec3;
    use wm_base::random::uniform;
    use wm_render::testing::{Backend, gpu_differentiable, shell_camera, shell_splats};
    use wm_render::training::{Comparison, NO_EXPOSURE};
    use wm_render::{Channels, ForwardConfig, Frame, Opacity, Resident};
    use wm_scene::Camera;

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
        let tested = ["depth", "surface", "normal", "smooth"];
        for mut term in terms(&config, path()).into_iter().filter(|term| tested.contains(&term.name())) {
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
            let which = term.on_device().unwrap();
            term.prepare(400, &mut comparison);
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
            check_device(SurfaceTerm { weight: 1.0, every: 1 }.own_render(), &prior, &["surface"]);
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
