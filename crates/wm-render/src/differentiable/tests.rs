//! The properties that all back ends of training share.

use super::*;
use crate::config::{Background, CpuConfig, RenderConfig};
use crate::hooks::Hooks;
use crate::plan::{DrawPass, SetView};
use crate::testing::comparison::{self, drawn};
use crate::testing::{Backend, RandomLoss, camera, random_splats, threads};
use crate::{CpuDifferentiable, CpuRenderer, Geometry, Outputs};

crate::parity! {
    a_frame_is_the_one_that_rendering_gives => frames_are_alike;
    what_does_not_learn_is_left_out_and_changes_nothing_else => leave_out;
    a_backward_pass_may_be_repeated_with_another_loss => repeat;
    what_is_left_out_is_as_if_it_were_not_there => without_sky;
    the_air_is_that_of_rendering_and_leaves_the_sky_alone => through_air;
    nothing_in_view_is_no_fault => nothing_in_view;
}

const CONFIG: ForwardConfig = ForwardConfig {
    channels: Channels::ColorDepthNormal,
    background: [0.2, 0.4, 0.6],
    rasterization: Rasterization::Antialiased,
    opacity: Opacity::Stored,
    drawn: DrawnSplats::All,
    sh_degree: 2,
    air: None,
};

fn step(
    renderer: &mut dyn Differentiable,
    splats: &Splats,
    config: &ForwardConfig,
    learn: Learn,
) -> (Frame, Gradients) {
    comparison::step(renderer, splats, &camera(333, 217), config, learn, 5).unwrap()
}

#[test]
fn bytes_are_the_same_for_any_number_of_threads() {
    let splats = random_splats(20_000, 2, 90);
    let of = |count| step(&mut CpuDifferentiable::new(threads(count)).unwrap(), &splats, &CONFIG, Learn::ALL);
    let one = of(1);
    assert!(one.1.visible.len() > 5000 && one.1.means.iter().flatten().any(|v| *v != 0.0));
    for threads in [2, 7] {
        assert!(of(threads) == one, "{threads} threads");
    }
}

fn frames_are_alike(backend: Backend) {
    let splats = random_splats(5000, 2, 91);
    let (frame, _) = step(&mut *backend.differentiable(), &splats, &CONFIG, Learn::NONE);
    let config = RenderConfig {
        outputs: Outputs { geometry: Geometry::DepthNormal, ..Outputs::default() },
        background: Background::Color(CONFIG.background),
        rasterization: CONFIG.rasterization,
    };
    let pass = DrawPass::new(&[SetView::transient(&splats)], &camera(333, 217), &config);
    let want = drawn(&mut CpuRenderer::new(CpuConfig::default()).unwrap(), &pass);
    let near = |got: &[f32], want: &[f32], scale: f32| {
        // Scales are activated in another precision: the odd splat falls on the other side of a
        // cut.
        let off = got.iter().zip(want).filter(|(a, b)| (*a - *b).abs() > 1e-4 * scale).count();
        assert!(got.len() == want.len() && off * 1000 <= want.len(), "{off} of {}", want.len());
    };
    near(&frame.rgb, &want.rgb, 1.0);
    near(&frame.alpha, &want.alpha, 1.0);
    near(&frame.depth, &want.depth, 10.0);
    near(&frame.normal, &want.normal, 5.0);
}

fn leave_out(backend: Backend) {
    let splats = random_splats(3000, 2, 92);
    let mut renderer = backend.differentiable();
    let (_, all) = step(&mut *renderer, &splats, &CONFIG, Learn::ALL);
    let (_, means) = step(&mut *renderer, &splats, &CONFIG, Learn::MEANS);
    assert_eq!(means.means, all.means);
    assert!(means.quats.is_empty() && means.sh.is_empty() && means.logit_opacities.is_empty());
    assert_eq!((means.weights.len(), means.visible), (all.visible.len(), all.visible.clone()));
    let (_, opacities) = step(&mut *renderer, &splats, &CONFIG, Learn::OPACITIES);
    assert_eq!(opacities.logit_opacities, all.logit_opacities);
    assert!(opacities.means.is_empty());
    let fixed = ForwardConfig { opacity: Opacity::Fixed(0.95), channels: Channels::Depth, ..CONFIG };
    let (frame, fixed) = step(&mut *renderer, &splats, &fixed, Learn::ALL);
    assert!(fixed.logit_opacities.is_empty() && fixed.sh.is_empty() && !fixed.means.is_empty());
    assert!(frame.rgb.is_empty() && frame.depth.len() == frame.pixels());
}

fn repeat(backend: Backend) {
    let splats = random_splats(2000, 2, 93);
    let mut renderer = backend.differentiable();
    let (frame, first) = step(&mut *renderer, &splats, &CONFIG, Learn::ALL);
    let none = vec![0.0; frame.pixels()];
    let mut gradients = Gradients::default();
    let upstream = Upstream { alpha: &none, depth_alpha: DepthAlpha::Detached, ..Upstream::default() };
    renderer.backward(&splats, &upstream, Learn::ALL, &mut gradients).unwrap();
    assert_eq!(gradients.visible, first.visible);
    assert_eq!(gradients.weights, first.weights);
    assert!(gradients.means.iter().flatten().chain(&gradients.sh).all(|v| *v == 0.0));
    let loss = RandomLoss::new(CONFIG.channels, frame.pixels(), 5, |_| true);
    renderer.backward(&splats, &loss.upstream(), Learn::ALL, &mut gradients).unwrap();
    assert!(gradients == first);
}

/// Draws the air as the hook does; splats of the sky learn as without it.
fn through_air(backend: Backend) {
    let air = EvenAir { extinction: 0.2, airlight: [0.5, 0.6, 0.7] };
    let config = ForwardConfig { channels: Channels::Color, air: Some(air), ..CONFIG };
    let mut splats = random_splats(3000, 2, 96);
    let (hazy, pulled) = step(&mut *backend.differentiable(), &splats, &config, Learn::ALL);
    let (clear, pulled_clear) =
        step(&mut *backend.differentiable(), &splats, &ForwardConfig { air: None, ..config }, Learn::ALL);
    let settings = RenderConfig {
        background: Background::Color(config.background),
        rasterization: config.rasterization,
        ..RenderConfig::default()
    };
    // The background of training is there in place of what no splat covers, and no air is before
    // it.
    let hooks = Hooks { medium: Some(&air), ..Hooks::default() };
    let pass = DrawPass::new(&[SetView::transient(&splats)], &camera(333, 217), &settings).with_hooks(hooks);
    let want = drawn(&mut CpuRenderer::new(CpuConfig::default()).unwrap(), &pass);
    let far = |a: &[f32], b: &[f32], by: f32| a.iter().zip(b).filter(|(a, b)| (*a - *b).abs() > by).count();
    assert!(far(&hazy.rgb, &want.rgb, 1e-4) * 1000 <= hazy.rgb.len());
    assert!(far(&hazy.rgb, &clear.rgb, 0.02) * 2 > hazy.rgb.len());
    assert!(pulled.sh != pulled_clear.sh && pulled.visible == pulled_clear.visible);
    splats.groups.fill(wm_scene::Group::Sky);
    let (sky, pulled) = step(&mut *backend.differentiable(), &splats, &config, Learn::ALL);
    assert_eq!(far(&sky.rgb, &clear.rgb, 1e-4), 0);
    let norm = |values: &[f32]| values.iter().map(|v| v * v).sum::<f32>().sqrt();
    let off: Vec<f32> = pulled.sh.iter().zip(&pulled_clear.sh).map(|(a, b)| a - b).collect();
    assert!(norm(&off) < 1e-4 * norm(&pulled_clear.sh));
}

fn without_sky(backend: Backend) {
    let mut splats = random_splats(3000, 2, 95);
    splats.groups.iter_mut().step_by(3).for_each(|group| *group = wm_scene::Group::Sky);
    let kept: Vec<usize> = (0..3000).filter(|i| i % 3 != 0).collect();
    let without = ForwardConfig { drawn: DrawnSplats::WithoutSky, ..CONFIG };
    let mut renderer = backend.differentiable();
    let (frame, found) = step(&mut *renderer, &splats, &without, Learn::ALL);
    let (want, rest) = step(&mut *renderer, &splats.select(&kept), &CONFIG, Learn::ALL);
    assert_eq!(found.visible, rest.visible.iter().map(|i| kept[*i as usize] as u32).collect::<Vec<_>>());
    // Clusters are of other splats, and so are the roundings of some sums.
    let near = |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-4 * (1.0 + b.abs()));
    assert!(near(&frame.rgb, &want.rgb) && near(&frame.depth, &want.depth));
    assert!(near(&found.logit_opacities, &rest.logit_opacities));
}

fn nothing_in_view(backend: Backend) {
    let mut renderer = backend.differentiable();
    for splats in [Splats::with_capacity(0, 2), random_splats(40, 2, 94)] {
        let away = Camera {
            viewmat: glam::DMat4::from_translation(glam::DVec3::new(0.0, 0.0, -50.0)),
            ..camera(64, 48)
        };
        let (frame, gradients) =
            comparison::step(&mut *renderer, &splats, &away, &CONFIG, Learn::ALL, 5).unwrap();
        assert!(gradients.visible.is_empty() && gradients.sh.is_empty());
        assert!(frame.alpha.iter().all(|a| *a == 0.0));
    }
}

#[test]
fn rows_are_added_where_both_see_the_splat() {
    let rows = |visible: &[u32], learn: Learn, value: f32| {
        let mut gradients = Gradients::default();
        gradients.resize(visible.len(), learn, 1);
        gradients.visible.copy_from_slice(visible);
        gradients.means.fill([value; 3]);
        gradients.logit_opacities.fill(value);
        gradients.sh.fill(value);
        gradients
    };
    let mut sum = rows(&[1, 4, 6, 9], Learn::ALL, 1.0);
    sum.add_parameters(&rows(&[0, 4, 5, 9, 12], Learn::ALL, 2.0));
    assert_eq!(sum.means, [[1.0; 3], [3.0; 3], [1.0; 3], [3.0; 3]]);
    assert_eq!((sum.logit_opacities.clone(), sum.sh[12], sum.sh[35]), (vec![1.0, 3.0, 1.0, 3.0], 3.0, 1.0));
    sum.add_parameters(&rows(&[1, 4], Learn::MEANS, 5.0));
    assert_eq!((sum.means[0], sum.logit_opacities[0]), ([6.0; 3], 1.0));
}
