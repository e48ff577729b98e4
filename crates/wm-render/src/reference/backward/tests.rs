use super::*;
use crate::config::{Background, RenderConfig};
use crate::differentiable::Opacity;
use crate::even_air::EvenAir;
use crate::plan::DrawPass;
use crate::reference;
use crate::testing::comparison::HardSplats;
use crate::testing::{RandomLoss, camera, random_splats};
use wm_scene::Rasterization;

const SIZE: (u32, u32) = (24, 16);

fn random_loss(channels: Channels, seed: u64) -> RandomLoss {
    RandomLoss::new(channels, (SIZE.0 * SIZE.1) as usize, seed, |_| true)
}

/// The distance of the gradient by each array from central differences, L2, relative. What the
/// rounding of the loss does to the differences is taken off.
fn against_differences(
    splats: &Splats,
    config: &ForwardConfig,
    upstream: &Upstream<'_>,
) -> [(&'static str, f64); 5] {
    let camera = camera(SIZE.0, SIZE.1);
    let mut parameters = Parameters::of(splats);
    let decisions = decide(&parameters, &camera, config);
    let mut ours = gradients(&parameters, &camera, config, &decisions, upstream).parameters;
    let mut result = [("", 0.0); 5];
    let pictures = render(&parameters, &camera, config, &decisions);
    let size = pictures.loss(upstream).abs() + (pictures.alpha.len() as f64).sqrt();
    for array in 0..5 {
        let (mut error, mut norm) = (0.0, 0.0);
        let name = parameters.arrays()[array].0;
        for i in 0..parameters.arrays()[array].1.len() {
            let step = 1e-5;
            let mut loss_at = |offset: f64| {
                let kept = parameters.arrays()[array].1[i];
                parameters.arrays()[array].1[i] = kept + offset;
                let loss = render(&parameters, &camera, config, &decisions).loss(upstream);
                parameters.arrays()[array].1[i] = kept;
                loss
            };
            // Fourth order: truncation far below the rounding of the loss.
            let near = loss_at(step) - loss_at(-step);
            let far = loss_at(2.0 * step) - loss_at(-2.0 * step);
            let difference = (8.0 * near - far) / (12.0 * step);
            error += (ours.arrays()[array].1[i] - difference).powi(2);
            norm += difference.powi(2);
        }
        let noise = 1e-16 * size / 1e-5 * (parameters.arrays()[array].1.len() as f64).sqrt();
        result[array] = (name, (error.sqrt() - noise).max(0.0) / norm.sqrt().max(1e-30));
    }
    result
}

fn check(splats: &Splats, config: &ForwardConfig, upstream: &Upstream<'_>) {
    for (name, error) in against_differences(splats, config, upstream) {
        eprintln!("{config:?}: {name} {error:.1e}");
        assert!(error < 1e-6, "{config:?}: {name} is off by {error:.1e}");
    }
}

#[test]
fn every_parameter_through_every_picture() {
    for (i, channels) in [Channels::Color, Channels::ColorDepth, Channels::ColorDepthNormal, Channels::Depth]
        .into_iter()
        .enumerate()
    {
        for rasterization in [Rasterization::Classic, Rasterization::Antialiased] {
            let background = [0.3, 0.6, 0.1];
            let config = ForwardConfig {
                channels,
                background,
                rasterization,
                sh_degree: 1,
                ..ForwardConfig::default()
            };
            let loss = random_loss(channels, 3 + i as u64);
            check(&random_splats(30, 1, 1 + i as u64), &config, &loss.upstream());
        }
    }
}

#[test]
fn each_picture_alone() {
    let channels = Channels::ColorDepthNormal;
    let config = ForwardConfig { channels, sh_degree: 0, ..ForwardConfig::default() };
    let loss = random_loss(channels, 9);
    let all = loss.upstream();
    let none = Upstream::default();
    let splats = random_splats(20, 0, 9);
    for upstream in [
        Upstream { rgb: all.rgb, ..none },
        Upstream { alpha: all.alpha, ..none },
        Upstream { depth: all.depth, ..none },
        Upstream { normal: all.normal, ..none },
    ] {
        check(&splats, &config, &upstream);
    }
}

#[test]
fn every_degree_of_the_colors() {
    for sh_degree in 0..=3 {
        let config = ForwardConfig { sh_degree, ..ForwardConfig::default() };
        check(&random_splats(20, 3, 5), &config, &random_loss(Channels::Color, 6).upstream());
    }
}

#[test]
fn through_the_air() {
    let air = Some(EvenAir { extinction: 0.2, airlight: [0.5, 0.6, 0.7] });
    for sh_degree in [0, 2] {
        let config = ForwardConfig { sh_degree, air, ..ForwardConfig::default() };
        check(&random_splats(20, 2, 5), &config, &random_loss(Channels::Color, 6).upstream());
    }
}

#[test]
fn hard_splats() {
    for hard in [
        HardSplats::Huge,
        HardSplats::Needle,
        HardSplats::NearPlane,
        HardSplats::Behind,
        HardSplats::Opaque,
        HardSplats::Tiny,
    ] {
        for rasterization in [Rasterization::Classic, Rasterization::Antialiased] {
            let channels = Channels::ColorDepthNormal;
            let config = ForwardConfig { channels, rasterization, sh_degree: 1, ..ForwardConfig::default() };
            let mut splats = hard.splats(25, 7);
            // An infinite logit has no difference quotient.
            splats.logit_opacities.iter_mut().for_each(|v| *v = v.min(8.0));
            if hard == HardSplats::NearPlane {
                // Most would be outside the picture.
                splats
                    .means
                    .iter_mut()
                    .for_each(|mean| (mean[0], mean[1]) = (0.05 * mean[0], 0.05 * mean[1]));
            }
            eprintln!("{hard:?}");
            check(&splats, &config, &random_loss(channels, 8).upstream());
        }
    }
}

#[test]
fn fixed_opacity_has_no_gradient_by_opacity() {
    let opacity = Opacity::Fixed(0.95);
    let config =
        ForwardConfig { channels: Channels::Depth, opacity, sh_degree: 0, ..ForwardConfig::default() };
    check(&random_splats(25, 0, 11), &config, &random_loss(Channels::Depth, 12).upstream());
}

#[test]
fn detached_alpha_moves_depth_and_not_coverage() {
    let config = ForwardConfig { channels: Channels::Depth, sh_degree: 0, ..ForwardConfig::default() };
    let camera = camera(SIZE.0, SIZE.1);
    let parameters = Parameters::of(&random_splats(25, 0, 13));
    let decisions = decide(&parameters, &camera, &config);
    let pictures = render(&parameters, &camera, &config, &decisions);
    let depth = random_loss(Channels::Depth, 14).depth;
    // By hand: the exact derivative, with alpha's share put back.
    let share = |i: usize| {
        let alpha = pictures.alpha[i];
        if decisions.covered[i] { f64::from(depth[i]) * pictures.depth[i] / alpha } else { 0.0 }
    };
    let alpha: Vec<f32> = (0..depth.len()).map(|i| share(i) as f32).collect();
    let by_hand = Upstream { depth: &depth, alpha: &alpha, ..Upstream::default() };
    let detached = Upstream { depth: &depth, depth_alpha: DepthAlpha::Detached, ..Upstream::default() };
    let want = gradients(&parameters, &camera, &config, &decisions, &by_hand).parameters;
    let got = gradients(&parameters, &camera, &config, &decisions, &detached).parameters;
    let norm: f64 = want.means.iter().map(|v| v * v).sum();
    let error: f64 = want.means.iter().zip(&got.means).map(|(a, b)| (a - b) * (a - b)).sum();
    assert!(error < 1e-10 * norm, "{error} of {norm}");
}

/// The picture under kept decisions is the reference's.
#[test]
fn the_picture_is_the_one_of_the_reference() {
    for rasterization in [Rasterization::Classic, Rasterization::Antialiased] {
        let splats = random_splats(200, 2, 21);
        let camera = camera(40, 30);
        let background = [0.3, 0.6, 0.1];
        let channels = Channels::ColorDepthNormal;
        let config = ForwardConfig { channels, background, rasterization, ..ForwardConfig::default() };
        let config = ForwardConfig { sh_degree: 2, ..config };
        let parameters = Parameters::of(&splats);
        let got = render(&parameters, &camera, &config, &decide(&parameters, &camera, &config));
        let background = Background::Color(background);
        let want = RenderConfig { background, rasterization, ..RenderConfig::default() };
        let want = reference::frame::render(&[(&splats, None)], &DrawPass::new(&[], &camera, &want));
        for i in 0..got.alpha.len() {
            assert!((got.alpha[i] - want.alpha[i]).abs() < 1e-12);
            assert!((got.depth[i] * got.alpha[i] - want.depth_sum[i]).abs() < 1e-11);
            assert!((0..3).all(|k| (got.rgb[i][k] - want.rgb[i][k]).abs() < 1e-12));
        }
    }
}
