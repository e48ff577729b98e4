//! Splats that learn on a GPU move as those of the CPU.

use super::cpu::{add_terms, hold_sky, step};
use super::*;
use crate::differentiable::{Channels, DrawnSplats, ForwardConfig, Opacity, Resident, Target};
use crate::frame::Frame;
use crate::gpu::GpuDifferentiable;
use crate::gradients::Learn;
use crate::simd::SimdPath;
use crate::testing::{
    Backend, RandomLoss, camera, comparison, gpu_differentiable, random_splats, small_gpu, threads,
};
use wm_scene::{Group, quat};

const LOSS_SEED: u64 = 9;
const RATES: Rates =
    Rates { means: 0.01, quats: 0.02, log_scales: 0.03, logit_opacities: 0.04, sh_dc: 0.05, sh_rest: 0.06 };

/// Splats that learn, in the computer's memory.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct LearntState {
    pub(crate) splats: Splats,
    moments: Moments,
    pulls: DensifyStats,
    seen: Vec<u32>,
}

impl LearntState {
    pub(crate) fn new(splats: Splats) -> Self {
        let (moments, pulls, seen) =
            (Moments::new(&splats), DensifyStats::new(splats.len()), vec![0; splats.len()]);
        Self { splats, moments, pulls, seen }
    }

    pub(crate) fn learnt(&self) -> Learnt<'_> {
        Learnt { splats: &self.splats, moments: &self.moments, pulls: &self.pulls, seen: &self.seen }
    }

    fn learnt_mut(&mut self) -> LearntMut<'_> {
        let Self { splats, moments, pulls, seen } = self;
        LearntMut { splats, moments, pulls, seen }
    }
}

/// Some of the sky, and some flat enough.
fn splats(degree: u8) -> Splats {
    let mut splats = random_splats(700, degree, 31);
    splats.groups.iter_mut().step_by(5).for_each(|group| *group = Group::Sky);
    splats.log_scales.iter_mut().step_by(3).for_each(|scales| scales[1] = -6.0);
    splats.log_scales.iter_mut().step_by(7).for_each(|scales| *scales = [-2.0; 3]);
    splats
}

fn step_of(number: u32) -> Step {
    let terms = SplatTerms { opacity: 20.0, scale: 30.0, flatness: 40.0 };
    Step { number, rates: RATES, terms, size: (75, 53) }
}

/// The render of a step, and the other render that is added to it.
fn renders(degree: u8) -> [ForwardConfig; 2] {
    let config =
        ForwardConfig { channels: Channels::ColorDepthNormal, sh_degree: degree, ..ForwardConfig::default() };
    let (opacity, drawn) = (Opacity::Fixed(0.6), DrawnSplats::WithoutSky);
    [config, ForwardConfig { channels: Channels::Depth, opacity, drawn, ..config }]
}

const OTHER: Learn = Learn { sh: false, quats: false, ..Learn::ALL };

/// Two steps, from two sides, whose gradients are the GPU's: of the CPU's own, those that are 0 but
/// for rounding would decide by their sign where Adam goes.
fn learn_on_cpu(kept: &mut LearntState, degree: u8) {
    let path = SimdPath::available()[0];
    let mut gpu = gpu_differentiable();
    for number in 1..=2 {
        let mut sum = Gradients::default();
        for (place, config) in renders(degree).iter().enumerate() {
            let learn = if place == 0 { Learn::ALL } else { OTHER };
            let (seen, splats) = (camera(75, 53 * number), &kept.splats);
            let (_, own) = comparison::step(&mut gpu, splats, &seen, config, learn, LOSS_SEED).unwrap();
            if place == 0 { sum = own } else { sum.add_parameters(&own) }
        }
        let step_now = step_of(number);
        sum.visible.iter().for_each(|index| kept.seen[*index as usize] = number);
        add_terms(&kept.splats, &step_now.terms, &mut sum);
        kept.pulls.add(&sum, 75, 53);
        hold_sky(&kept.splats, &mut sum);
        step(path, &mut kept.splats, &mut kept.moments, &sum, &RATES, number);
    }
}

fn learn_on(gpu: &mut GpuDifferentiable, degree: u8) {
    for number in 1..=2 {
        for (place, config) in renders(degree).iter().enumerate() {
            let mut frame = Frame::default();
            Resident::forward(gpu, &camera(75, 53 * number), config, &mut frame).unwrap();
            let loss = RandomLoss::new(config.channels, frame.pixels(), LOSS_SEED, |_| true);
            let target = if place == 0 { Target::Step } else { Target::Added(OTHER) };
            Resident::backward(gpu, &loss.upstream(), target).unwrap();
        }
        gpu.optimize(&step_of(number)).unwrap();
    }
}

/// By the largest difference, in units of the array's largest number.
fn assert_near(name: &str, got: &[f32], want: &[f32], tolerance: f32) {
    let largest = want.iter().fold(1e-20f32, |a, b| a.max(b.abs()));
    let off = got.iter().zip(want).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max) / largest;
    eprintln!("{name}: {off:.1e}");
    assert!(got.len() == want.len() && off < tolerance, "{name} is off by {off:.1e}");
}

fn assert_alike(got: &LearntState, want: &LearntState) {
    let (a, b) = (&got.splats, &want.splats);
    assert_near("means", a.means.as_flattened(), b.means.as_flattened(), 1e-5);
    assert_near("quats", a.quats.as_flattened(), b.quats.as_flattened(), 1e-5);
    assert_near("scales", a.log_scales.as_flattened(), b.log_scales.as_flattened(), 1e-5);
    assert_near("opacities", &a.logit_opacities, &b.logit_opacities, 1e-5);
    assert_near("sh", &a.sh, &b.sh, 1e-5);
    let (a, b) = (&got.moments, &want.moments);
    for (name, a, b) in [
        ("means", &a.means, &b.means),
        ("quats", &a.quats, &b.quats),
        ("scales", &a.log_scales, &b.log_scales),
        ("opacities", &a.logit_opacities, &b.logit_opacities),
        ("sh", &a.sh, &b.sh),
    ] {
        assert_near(&format!("moments of {name}"), &a.first, &b.first, 1e-5);
        assert_near(&format!("squares of {name}"), &a.second, &b.second, 1e-5);
    }
    assert_near("pulls", &got.pulls.sums, &want.pulls.sums, 1e-5);
    assert_near("radii", &got.pulls.radii, &want.pulls.radii, 1e-5);
    assert_eq!((&got.pulls.counts, &got.seen), (&want.pulls.counts, &want.seen));
}

#[test]
fn what_learns_on_a_gpu_learns_the_same() {
    let Some(_) = Backend::gpu() else { return };
    for degree in [0, 2] {
        let start = LearntState::new(splats(degree));
        let (mut want, mut got) = (start.clone(), start.clone());
        learn_on_cpu(&mut want, degree);
        let mut gpu = gpu_differentiable();
        gpu.load(start.learnt()).unwrap();
        learn_on(&mut gpu, degree);
        gpu.read(got.learnt_mut()).unwrap();
        assert_ne!(got.splats.means, start.splats.means);
        assert_alike(&got, &want);
        // In many pieces, bit by bit.
        let mut gpu = GpuDifferentiable::new(small_gpu(900_000), threads(2)).unwrap();
        let mut pieces = start.clone();
        gpu.load(start.learnt()).unwrap();
        learn_on(&mut gpu, degree);
        gpu.read(pieces.learnt_mut()).unwrap();
        assert!(pieces == got);
    }
}

/// By the formula in f64, with the CPU's random numbers.
#[test]
fn noise_is_the_cpus() {
    let Some(_) = Backend::gpu() else { return };
    let mut start = LearntState::new(splats(1));
    start.splats.logit_opacities.iter_mut().step_by(2).for_each(|logit| *logit = -6.0);
    let noise = Noise { seed: 0xfeed_beef_0123_4567, size: 40.0, most: 0.1 };
    let mut want = start.splats.means.clone();
    for (i, mean) in want.iter_mut().enumerate() {
        let opacity = start.splats.opacity(i);
        if opacity > noise.most || start.splats.groups[i] == Group::Sky {
            continue;
        }
        let gate = 1.0 / (1.0 + (100.0 * (opacity - 0.005)).exp());
        let u = |k: u64| wm_base::random::uniform(noise.seed, 4 * i as u64 + k);
        let radius = |k: u64| (-2.0 * (1.0 - u(k)).ln()).sqrt();
        let angle = |k: u64| std::f64::consts::TAU * u(k);
        let normal = [radius(0) * angle(1).cos(), radius(0) * angle(1).sin(), radius(2) * angle(3).cos()];
        let turn = quat::to_matrix(start.splats.quats[i].map(f64::from));
        let scales = start.splats.scales(i);
        let own: [f64; 3] = std::array::from_fn(|k| {
            let along: f64 = (0..3).map(|row| turn[row][k] * normal[row]).sum();
            scales[k] * (noise.size * gate * scales[k]).min(1.0) * along
        });
        for row in 0..3 {
            mean[row] += (0..3).map(|k| turn[row][k] * own[k]).sum::<f64>() as f32;
        }
    }
    let mut gpu = gpu_differentiable();
    gpu.load(start.learnt()).unwrap();
    gpu.explore(&noise).unwrap();
    let mut got = start.clone();
    gpu.read(got.learnt_mut()).unwrap();
    let moved = (0..700).filter(|i| got.splats.means[*i] != start.splats.means[*i]).count();
    assert!(moved > 200 && moved < 400, "{moved}");
    assert_near("means", got.splats.means.as_flattened(), want.as_flattened(), 1e-5);
    let means = start.splats.means.clone();
    assert!(LearntState { splats: Splats { means, ..got.splats.clone() }, ..got } == start);
}
