use super::*;
use crate::testing;
use glam::DVec3;
use wm_render::simd::SimdChoice;
use wm_render::{CpuConfig, CpuRenderer, DrawPass, Geometry, Outputs, RenderBackend, RenderConfig, SetView};
use wm_scene::splats::{Splat, logit};
use wm_scene::{Camera, Group, Splats};

const RAIN: PaperBlend = PaperBlend { sky: 0.8, t: [0.0, 0.35], t_d: 15.0, t_c: 0.02, d_max: 20.0 };
const SNOW: PaperBlend = PaperBlend { t: [-0.1, 0.6], ..RAIN };

/// The values of `exp(x) - 1` are those of a table.
#[test]
fn the_factor_is_the_papers_with_its_bounds_put_right() {
    for (blend, light, wanted) in [
        (RAIN, 0.8, 0.0),
        (RAIN, 0.6, 0.221_402_758),
        (RAIN, 0.3, 0.419_067_549),
        (RAIN, 0.0, 0.419_067_549),
        (RAIN, 1.0, 0.0),
        (SNOW, 0.3, 0.648_721_271),
        (SNOW, 0.1, 0.822_118_800),
        (SNOW, 0.85, -0.048_770_575),
        (SNOW, 1.0, -0.095_162_582),
    ] {
        assert!((blend.factor(light) - wanted).abs() < 1e-8, "{light}: {}", blend.factor(light));
    }
}

#[test]
fn the_mask_is_the_papers() {
    let grey = [0.5; 3];
    for (scene, noise_depth, noise, wanted) in [
        ((10.0, 1.0), 9.99, grey, true),
        ((10.0, 1.0), 10.0, grey, false),
        // Half covered at 4: 2, and half of d_max: 12 in all.
        ((2.0, 0.5), 11.9, grey, true),
        ((2.0, 0.5), 12.1, grey, false),
        // Before nothing: up to t_D.
        ((0.0, 0.0), 14.9, grey, true),
        ((0.0, 0.0), 15.0, grey, false),
        // Both are capped at d_max.
        ((50.0, 1.0), 30.0, grey, false),
        // By the mean of the channels.
        ((10.0, 1.0), 5.0, [0.03, 0.03, 0.003], true),
        ((10.0, 1.0), 5.0, [0.05, 0.005, 0.0], false),
    ] {
        let (depth, alpha) = scene;
        assert_eq!(RAIN.keeps(depth, alpha, noise_depth, noise), wanted, "{scene:?} {noise_depth} {noise:?}");
    }
}

fn frame(rgb: [f32; 3], alpha: f32, depth: f32) -> Frame {
    Frame { alpha: vec![alpha], ..testing::frame([1, 1], rgb.to_vec(), depth) }
}

/// Two layers over one pixel: the second sees what the first has left.
#[test]
fn layers_are_added_to_the_running_composite() {
    let mut picture = frame([0.6, 0.5, 0.4], 1.0, 12.0);
    let mut stages = PaperStages::default();
    stages.begin(&picture);
    // Depth sums 0.5 * 10 and 0.4 * 4; both before 12.
    add(&RAIN, &mut picture, &frame([0.4; 3], 0.5, 10.0), Some(&mut stages));
    // 0.8 - 0.5 = 0.3: e^0.3 - 1 = 0.349858808, times 0.4.
    let first = 0.139_943_523;
    assert!((f64::from(picture.rgb[1]) - 0.5 - first).abs() < 1e-6);
    add(&RAIN, &mut picture, &frame([0.3; 3], 0.4, 4.0), Some(&mut stages));
    let second = 0.3 * ((0.8 - 0.5 - first).exp() - 1.0);
    for (k, clear) in [0.6, 0.5, 0.4].into_iter().enumerate() {
        assert!((f64::from(picture.rgb[k]) - clear - first - second).abs() < 1e-6);
    }
    // Behind the scene: not in the picture, nor in the filtered noise, but in the overlay.
    let kept = (picture.clone(), stages.clone());
    add(&RAIN, &mut picture, &frame([0.7; 3], 0.95, 13.0), Some(&mut stages));
    assert_eq!((&picture, &stages.filtered), (&kept.0, &kept.1.filtered));
    assert!((stages.filtered[0] - (0.3 + 0.6 * 0.4)).abs() < 1e-6);
    assert!((stages.noise[0] - (0.7 + 0.05 * (0.3 + 0.6 * 0.4))).abs() < 1e-6);
    let overlay = 0.7 + 0.05 * (0.3 + 0.6 * (0.4 + 0.5 * 0.6));
    assert!((stages.overlay[0] - overlay).abs() < 1e-6);
    // No negative light.
    let mut picture = frame([1.5, 1.5, 0.0], 1.0, 12.0);
    add(&SNOW, &mut picture, &frame([0.4; 3], 0.5, 4.0), None);
    assert!((f64::from(picture.rgb[0]) - 1.5 + 0.4 * 0.095_162_582).abs() < 1e-6 && picture.rgb[2] == 0.0);
}

/// Why the paper has sub-clouds: at a pixel where a near drop lies before a far one that the scene
/// hides, the depth of both together hides the near one too.
#[test]
fn one_cloud_loses_a_near_drop_before_a_far_one() {
    let camera = Camera::looking((32, 32), 40.0, DVec3::ZERO, DVec3::X, DVec3::Z).unwrap();
    let drop = |depth: f64, opacity: f64| {
        let mut splats = Splats::with_capacity(1, 0);
        splats.push(&Splat {
            mean: [depth as f32, 0.0, 0.0],
            quat: [1.0, 0.0, 0.0, 0.0],
            log_scale: [(0.05 * depth).ln() as f32; 3],
            logit_opacity: logit(opacity) as f32,
            rgb: [0.8; 3],
            group: Group::Scene,
        });
        splats
    };
    let (near, far) = (drop(2.0, 0.5), drop(18.0, 0.9));
    let mut both = far.clone();
    both.push(&Splat {
        mean: near.means[0],
        quat: near.quats[0],
        log_scale: near.log_scales[0],
        logit_opacity: near.logit_opacities[0],
        rgb: [0.8; 3],
        group: Group::Scene,
    });
    let mut renderer = CpuRenderer::new(CpuConfig { threads: Some(1), ..CpuConfig::default() }).unwrap();
    let config = RenderConfig {
        outputs: Outputs { geometry: Geometry::Depth, ..Outputs::default() },
        ..RenderConfig::default()
    };
    // A dark wall 5 units away.
    let wall = testing::frame([32, 32], vec![0.2; 3 * 32 * 32], 5.0);
    let mut over = |clouds: &[&Splats]| {
        let mut picture = wall.clone();
        for cloud in clouds {
            let set = renderer.load(cloud).unwrap();
            let mut noise = Frame::default();
            let sets = [SetView::plain(set)];
            let job = DrawPass::new(&sets, &camera, &config);
            renderer.render(&job, &mut noise).unwrap();
            add(&RAIN, &mut picture, &noise, None);
        }
        picture.rgb[3 * (16 * 32 + 16)]
    };
    // Together 0.5 * 2 + 0.5 * 0.9 * 18 = 9 of depth, at most; apart 1 and 16.
    assert_eq!(over(&[&both]), 0.2);
    let apart = over(&[&far, &near]);
    // The middle of a drop: 0.5 * 0.8 of noise, times e^0.35 - 1, less what half a pixel off takes.
    assert!(apart > 0.2 + 0.9 * 0.4 * 0.419 && apart <= 0.2 + 0.4 * 0.4191, "{apart}");
}

#[test]
fn the_blur_keeps_light_and_is_a_gaussian() {
    let mut picture = testing::frame([21, 17], vec![0.0; 3 * 21 * 17], 1.0);
    picture.rgb[3 * (8 * 21 + 10) + 1] = 1.0;
    blur(1.5, &mut picture);
    let sum: f32 = picture.rgb.iter().sum();
    assert!((sum - 1.0).abs() < 1e-5);
    let at = |x: u32, y: u32| f64::from(picture.rgb[3 * picture.index(x, y) + 1]);
    // exp(-(9 + 4) / (2 1.5^2)).
    assert!((at(13, 6) / at(10, 8) - 0.055_637).abs() < 1e-4);
    assert!(picture.rgb.iter().skip(2).step_by(3).all(|v| *v == 0.0));
    // At the edge the last pixel goes on.
    let mut plain = testing::frame([5, 4], vec![0.7; 60], 1.0);
    blur(2.0, &mut plain);
    assert!(plain.rgb.iter().all(|v| (v - 0.7).abs() < 1e-6));
}

/// Odd sizes: the last patches are cut, and every pixel is changed once.
#[test]
fn effects_reach_every_pixel_once() {
    let grade = ColorGrade { gains: [2.0; 3], saturation: 1.0, contrast: 1.0 };
    let path = SimdPath::select(SimdChoice::Auto).unwrap();
    let pixels = 37 * 19;
    let rgb = (0..3 * pixels).map(|i| i as f32 / (6 * pixels) as f32).collect();
    let mut picture = testing::frame([37, 19], rgb, 1.0);
    let clear = picture.clone();
    apply(&[&grade], path, &mut picture);
    for i in 0..pixels {
        let wanted = grade.reference([0, 1, 2].map(|k| f64::from(clear.rgb[3 * i + k])));
        for k in 0..3 {
            assert!((f64::from(picture.rgb[3 * i + k]) - wanted[k]).abs() < 1e-4);
        }
    }
}
