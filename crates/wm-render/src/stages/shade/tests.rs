use super::cpu::{relight_group, shade_group};
use crate::DrawPass;
use crate::config::{Background, RenderConfig, SkyGradient};
use crate::cpu::model::CpuModel;
use crate::dispatch;
use crate::frame::srgb_decode;
use crate::hooks::{Attribute, AttributeBlock, SplatAttributes};
use crate::hooks::{GROUP, Hooks, ShadeGroup};
#[cfg(feature = "gpu")]
use crate::reference;
use crate::simd::SimdPath;
use crate::testing::comparison::{ALL_OUTPUTS, TestAir, rendered};
use crate::testing::{Backend, camera, random_splats, uniform};
use wm_scene::{Group, sh};

crate::parity! {
    colors_agree_in_every_degree => colors;
    the_air_acts_on_splats_and_background => air;
    gains_change_the_light_before_the_air => gains;
}

fn colors(backend: Backend) {
    #[cfg(feature = "gpu")]
    if let Backend::Gpu = backend {
        return colors_on_gpu();
    }
    let path = backend.path();
    for degree in 0..=3 {
        let splats = random_splats(320, degree, 5);
        let model = CpuModel::new(&splats).unwrap();
        let rows = model.sh_rows();
        for (g, group) in model.groups.iter().enumerate() {
            let mut shade = ShadeGroup::default();
            for lane in 0..GROUP {
                let u = |k| uniform(6, ((g * GROUP + lane) * 4) as u64 + k) * 2.0 - 1.0;
                let d = glam::DVec3::new(u(0), u(1), u(2)).normalize();
                for k in 0..3 {
                    shade.direction[k][lane] = d[k] as f32;
                }
            }
            dispatch!(path, s => shade_group(s, group, &model.sh_rest[g * rows..(g + 1) * rows], &mut shade));
            for lane in 0..GROUP {
                let d = [0, 1, 2].map(|k| f64::from(shade.direction[k][lane]));
                let want = sh::color(splats.sh_of(model.source[g * GROUP + lane] as usize), d);
                for k in 0..3 {
                    let got = f64::from(shade.rgb[k][lane]);
                    assert!((got - want[k].max(0.0)).abs() < 4e-6, "{got}, want {}", want[k]);
                }
            }
        }
    }
}

/// Compares the colours of the splats in view, along the rays to them: the rounding of directions
/// (2e-7) comes on top.
#[cfg(feature = "gpu")]
fn colors_on_gpu() {
    let camera = camera(320, 200);
    for degree in 0..=3 {
        let splats = random_splats(320, degree, 5);
        let model = CpuModel::new(&splats).unwrap();
        let config = RenderConfig::default();
        let records = crate::gpu::probe::Probe::of(&splats, &camera, &config).records;
        assert!(records.len() > 200);
        for record in records {
            let index = model.source[record.index as usize] as usize;
            let projected = reference::project(&splats, index, &camera, config.rasterization, 1.0).unwrap();
            let want = sh::color(splats.sh_of(index), projected.direction);
            for k in 0..3 {
                let got = f64::from(record.rgb[k]);
                assert!((got - want[k].max(0.0)).abs() < 6e-6, "{got}, want {}", want[k]);
            }
        }
    }
}

/// An air that depends on everything that it is given.
const TINT: TestAir =
    TestAir { extinction: [0.2, 0.25, 0.3], light: [0.5; 3], by_direction: 0.3, by_origin: 0.01 };

fn air(backend: Backend) {
    let mut splats = random_splats(600, 0, 8);
    for i in (0..600).step_by(3) {
        splats.groups[i] = Group::Sky;
    }
    let camera = camera(70, 50);
    let up = [0.0, -1.0, 0.0];
    let config = RenderConfig {
        outputs: ALL_OUTPUTS,
        background: Background::Sky(SkyGradient::daylight(up)),
        ..RenderConfig::default()
    };
    let hooks = Hooks { medium: Some(&TINT), ..Hooks::default() };
    let pass = DrawPass::new(&[], &camera, &config).with_hooks(hooks);
    rendered(backend, &[(&splats, None)], &pass).unwrap();
}

/// Gains by the index of a splat, from shade to four times the light, and fades from 0 to 1.
struct Relit;

impl SplatAttributes for Relit {
    fn fill(&self, _: &[u32], _: &mut AttributeBlock) {}

    fn fill_light(&self, indices: &[u32], block: &mut AttributeBlock) {
        for (k, gain) in Attribute::GAINS.into_iter().enumerate() {
            for (index, value) in indices.iter().zip(block.column_mut(gain)) {
                *value = 4.0 * uniform(17, u64::from(3 * index) + k as u64) as f32;
            }
        }
        for (index, value) in indices.iter().zip(block.column_mut(Attribute::Fade)) {
            *value = (2.0 * uniform(18, u64::from(*index)) - 1.0).max(0.0) as f32;
        }
    }

    fn changes_light(&self) -> bool {
        true
    }
}

fn gains(backend: Backend) {
    let splats = random_splats(600, 1, 9);
    let camera = camera(70, 50);
    let config = RenderConfig { outputs: ALL_OUTPUTS, ..RenderConfig::default() };
    for hooks in [Hooks::default(), Hooks { medium: Some(&TINT), ..Hooks::default() }] {
        let pass = DrawPass::new(&[], &camera, &config).with_hooks(hooks);
        rendered(backend, &[(&splats, Some(&Relit))], &pass).unwrap();
    }
}

#[test]
fn gains_keep_the_hue_of_what_is_too_bright() {
    // Orange light of three times its strength stops at white's level, with its ratios.
    let shown = [0.9, 0.6, 0.3];
    let mut group = ShadeGroup { rgb: shown.map(|v| [v; GROUP]), ..ShadeGroup::default() };
    let gain = [3.0; GROUP];
    dispatch!(SimdPath::widest(), s => relight_group(s, [&gain, &gain, &gain], &mut group));
    let light = group.rgb.map(|channel| srgb_decode(f64::from(channel[5])));
    let before = shown.map(|v| srgb_decode(f64::from(v)));
    assert!((light[0] - 1.0).abs() < 1e-5, "{light:?}");
    for k in 1..3 {
        assert!((light[k] / light[0] - before[k] / before[0]).abs() < 1e-5, "{light:?}");
    }
}
