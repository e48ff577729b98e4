//! Trainings of a few splats: that they learn, what terms change, and that they outlive a GPU.

use super::*;
use crate::config::{BackgroundKind, Densify, GeometryConfig, LossConfig, Preset};
use crate::densify::fixed::FixedConfig;
use crate::densify::mcmc::McmcConfig;
use crate::losses::{LossGradients, LossInput, OwnRender};
use glam::DVec3;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use wm_render::testing::{Backend, fallible_differentiable, random_splats, threads, uniform};
use wm_render::{Channels, CpuDifferentiable, DepthAlpha, DrawnSplats, Learn, Opacity};

const SIZE: (u32, u32) = (48, 32);

/// Splats about the origin, large enough to be seen.
fn truth_splats() -> Splats {
    let mut splats = random_splats(30, 0, 5);
    splats.log_scales.iter_mut().flatten().for_each(|v| *v = v.max(-2.0));
    splats
}

fn cameras() -> Vec<Camera> {
    let eyes = [[0.0, 0.0, -7.0], [6.0, 1.0, -3.0], [-6.0, -1.0, -3.0], [1.0, 5.0, -5.0]];
    let look = |eye: [f64; 3]| {
        Camera::looking(SIZE, 45.0, DVec3::from_array(eye), DVec3::ZERO, DVec3::NEG_Y).unwrap()
    };
    eyes.map(look).into()
}

fn config(steps: u32) -> TrainConfig {
    let mut config = TrainConfig::preset(Preset::Quick);
    config.set_steps(steps);
    config.sh_degree = 0;
    // Photos of the truth are over black.
    config.background = BackgroundKind::Black;
    config.densify = Densify::Fixed(FixedConfig {});
    config
}

fn trainer(config: TrainConfig, splats: Splats) -> Trainer {
    Trainer::new(config, Box::new(CpuDifferentiable::new(threads(1)).unwrap()), splats, 3.0, 4)
}

/// Photos of the truth, one for each camera.
struct Photos(Vec<(Camera, Vec<f32>)>);

impl Photos {
    fn taken() -> Self {
        let mut truth = trainer(config(1), truth_splats());
        let mut frame = Frame::default();
        let mut see = |camera: Camera| {
            truth.render(&camera, &mut frame).unwrap();
            (camera, frame.rgb.clone())
        };
        Self(cameras().into_iter().map(&mut see).collect())
    }

    /// Takes a step on the photo that is due, and returns its report.
    fn step(&self, trainer: &mut Trainer) -> StepReport {
        let index = trainer.photo_at(trainer.steps_done());
        let (camera, rgb) = &self.0[index];
        trainer.step(&TrainPhoto { rgb, mask: None, camera, prior: None }, index).unwrap()
    }
}

/// The truth moved, resized and recoloured at random.
fn perturbed() -> Splats {
    let mut splats = truth_splats();
    let off = |i: usize| uniform(77, i as u64) as f32 - 0.5;
    splats.means.as_flattened_mut().iter_mut().enumerate().for_each(|(i, v)| *v += 0.2 * off(i));
    splats.log_scales.as_flattened_mut().iter_mut().enumerate().for_each(|(i, v)| *v += off(1000 + i));
    splats.sh.iter_mut().enumerate().for_each(|(i, v)| *v += off(2000 + i));
    splats
}

#[test]
fn what_was_perturbed_is_learnt_again() {
    let photos = Photos::taken();
    let mut trainer = trainer(config(800), perturbed());
    // Of one round of the four photos.
    let mut losses = Vec::new();
    while !trainer.is_done() {
        losses.push((0..4).map(|_| photos.step(&mut trainer).loss).sum::<f64>() / 4.0);
    }
    let (first, last) = (losses[0], losses[losses.len() - 1]);
    assert!(last < first / 5.0, "{first} to {last}");
}

/// Pulls everything that it is let pull.
struct PullTerm {
    weight: f64,
    own: Option<OwnRender>,
    calls: Arc<AtomicU32>,
}

impl LossTerm for PullTerm {
    fn name(&self) -> &'static str {
        "pull"
    }

    fn weight(&self, _: u32, _: &TrainPhoto<'_>) -> f64 {
        self.weight
    }

    fn own_render(&self) -> Option<OwnRender> {
        self.own
    }

    fn add(&mut self, _: &LossInput<'_>, weight: f64, out: &mut LossGradients) -> f64 {
        self.calls.fetch_add(1, Ordering::Relaxed);
        out.rgb.iter_mut().enumerate().for_each(|(i, v)| *v += (weight * (i as f64).sin()) as f32);
        1.0
    }
}

/// One step with the configured losses off and a [`PullTerm`]: the splats before and after, calls,
/// loss.
fn pulled(weight: f64, own: Option<OwnRender>) -> (Splats, Splats, u32, StepReport) {
    let mut config = config(10);
    config.loss = LossConfig { l1: 0.0, ssim: 0.0, geometry: GeometryConfig::NONE };
    let mut trainer = trainer(config, perturbed());
    let calls = Arc::new(AtomicU32::new(0));
    trainer.terms.push(Box::new(PullTerm { weight, own, calls: Arc::clone(&calls) }));
    let before = trainer.state().unwrap().population.splats.clone();
    let report = Photos::taken().step(&mut trainer);
    (before, trainer.state().unwrap().population.splats.clone(), calls.load(Ordering::Relaxed), report)
}

const OWN: OwnRender = OwnRender {
    channels: Channels::Color,
    opacity: Opacity::Fixed(0.5),
    drawn: DrawnSplats::All,
    learn: Learn::MEANS,
    depth_alpha: DepthAlpha::Learns,
};

#[test]
fn a_term_with_a_render_of_its_own_moves_what_it_may() {
    let (before, after, calls, report) = pulled(2.0, Some(OWN));
    assert_eq!((calls, report.loss, report.terms), (1, 2.0, vec![("pull", 1.0)]));
    assert_ne!(after.means, before.means);
    assert_eq!(Splats { means: before.means.clone(), ..after }, before);
    let (before, after, ..) = pulled(2.0, None);
    assert!(after.means != before.means && after.sh != before.sh);
    assert_ne!(after.logit_opacities, before.logit_opacities);
}

#[test]
fn a_term_without_weight_is_never_called() {
    for own in [None, Some(OWN)] {
        let (before, after, calls, report) = pulled(0.0, own);
        assert_eq!((calls, report.terms.len(), report.loss), (0, 0, 0.0));
        assert_eq!(after, before);
    }
}

/// Adaptive control looks at what pulls on the common picture, whatever other renders learn from.
#[test]
fn a_term_with_a_render_of_its_own_leaves_the_pulls() {
    let mut config = config(1000);
    config.densify = Densify::Adaptive(crate::densify::adaptive::AdaptiveConfig::for_steps(1000, 100));
    let photos = Photos::taken();
    let pulls = [None, Some(OWN)].map(|own| {
        let mut trainer = trainer(config.clone(), perturbed());
        if own.is_some() {
            trainer.terms.push(Box::new(PullTerm { weight: 1.0, own, calls: Arc::default() }));
        }
        photos.step(&mut trainer);
        trainer.state().unwrap().population.pulls.clone()
    });
    assert_eq!(pulls[0], pulls[1]);
}

/// Trains on a GPU that is lost on the way, and says after how many steps what was lost.
fn losing(gpu_at: u32, config: &TrainConfig) -> (Trainer, Vec<(u32, u32)>) {
    let (renderer, gpu) = fallible_differentiable(|_| {});
    let mut trainer = Trainer::new(config.clone(), Box::new(renderer), perturbed(), 3.0, 4);
    let photos = Photos::taken();
    let mut lost = Vec::new();
    let mut taken = 0;
    while !trainer.is_done() {
        match taken {
            20 => assert_eq!(trainer.state().unwrap().step, 20),
            _ if taken == gpu_at => gpu.lose(),
            _ => {}
        }
        taken += 1;
        let step = trainer.steps_done();
        let report = photos.step(&mut trainer);
        if trainer.steps_done() <= step {
            lost.push((step, report.lost));
        }
    }
    (trainer, lost)
}

/// Splats come every five steps. After 20 the state is asked for: at 26 the six since are taken
/// again.
#[test]
fn a_training_goes_on_without_its_gpu() {
    let Some(_) = Backend::gpu() else { return };
    let mut config = config(40);
    let chain = McmcConfig { from: 1, until: 30, every: 5, ..McmcConfig::for_steps(40, 40) };
    config.densify = Densify::Mcmc(chain);
    let (mut trainer, lost) = losing(26, &config);
    assert_eq!(lost, [(26, 6)]);
    assert!(trainer.describe().starts_with("cpu, "));
    assert_eq!((trainer.steps_done(), trainer.state().unwrap().step), (40, 40));
    let (mut whole, lost) = losing(u32::MAX, &config);
    assert!(lost.is_empty() && whole.describe().starts_with("gpu, "));
    assert_eq!(whole.len(), trainer.len());
    let [one, two] = [&mut whole, &mut trainer].map(|trainer| {
        let mut frame = Frame::default();
        trainer.render(&cameras()[0], &mut frame).unwrap();
        frame.rgb
    });
    let off = one.iter().zip(&two).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
    let psnr = -10.0 * (off / one.len() as f64).log10();
    eprintln!("{psnr:.1} dB");
    assert!(psnr > 30.0, "{psnr}");
}
