use super::*;
use crate::CpuRenderer;
use crate::config::{Background, CpuConfig, ParticlePass, SkyGradient};
use crate::frame::Frame;
use crate::hooks::{
    GROUP, Medium, Particle, ParticleGroup, ParticleView, Particles, PixelBatch, PixelEffect,
};
use crate::plan::SetView;
use crate::renderer::RenderBackend;
use crate::simd::SimdPath;
use crate::testing::comparison::{ALL_OUTPUTS, TestAir, drawn, rendered};
use crate::testing::{Backend, camera, random_splats, threads};
use wm_base::random::uniform;

crate::parity! {
    the_parts_make_up_the_picture => recombination;
    transmittance_is_that_of_the_reference => transmittance;
    clear_air_takes_nothing => clear;
}

/// Coloured air, the same everywhere.
const AIR: TestAir =
    TestAir { extinction: [0.3, 0.4, 0.55], light: [0.5, 0.6, 0.7], by_direction: 0.0, by_origin: 0.0 };

/// Some thousand drops before, between and behind the splats.
struct Drops;

impl Particles for Drops {
    fn parts(&self, _: &ParticleView) -> Vec<[i32; 4]> {
        (0..20).map(|part| [part, 0, 0, 0]).collect()
    }

    fn gather(&self, _: SimdPath, view: &ParticleView, part: [i32; 4], take: &mut dyn FnMut(&ParticleGroup)) {
        let drops = (0..100u64).map(|i| {
            let draw = |k: u64, low: f64, high: f64| low + (high - low) * uniform(part[0] as u64, 20 * i + k);
            let at = [draw(0, -3.0, 3.0), draw(1, -3.0, 3.0), draw(2, -3.0, 3.0)];
            Particle {
                offset: [0, 1, 2].map(|k| (at[k] - view.center[k]) as f32),
                sigma: 0.01,
                reach: [[0.0, draw(3, 0.0, 0.3) as f32, 0.02], [0.0; 3]],
                area: draw(4, 1e-4, 5e-3) as f32,
                rgb: [5, 6, 7].map(|k| draw(k, 0.0, 1.5) as f32),
            }
        });
        let drops: Vec<Particle> = drops.collect();
        drops.chunks(GROUP).for_each(|group| take(&ParticleGroup::of(group)));
    }
}

/// A pixel effect, which shows in no part.
struct Red;

impl PixelEffect for Red {
    fn apply(&self, _: SimdPath, pixels: &mut PixelBatch<'_>) {
        pixels.rgb[0].iter_mut().for_each(|red| *red += 1.0);
    }
}

const ALL: [PicturePart; 3] = [PicturePart::Clean, PicturePart::Transmittance, PicturePart::Airlight];

fn config() -> RenderConfig {
    RenderConfig {
        outputs: Outputs { particles: ParticlePass::On, ..Outputs::default() },
        background: Background::Sky(SkyGradient::daylight([0.0, -1.0, 0.0])),
        ..RenderConfig::default()
    }
}

fn parts(
    renderer: &mut dyn RenderBackend,
    medium: Option<&dyn Medium>,
    wanted: &[PicturePart],
) -> (Frame, PictureParts) {
    let set = renderer.load(&random_splats(300, 1, 5)).unwrap();
    let hooks = Hooks { medium, particles: vec![&Drops], ..Hooks::default() };
    let pass = DrawPass::new(&[SetView::plain(set)], &camera(77, 52), &config());
    let mut plan = FramePlan::new();
    let picture = plan.draw(pass.clone().with_hooks(hooks.clone()));
    let red = plan.draw(pass.with_hooks(Hooks { pixels: vec![&Red], ..hooks }));
    let passes = PartPasses::append(&mut plan, red, wanted);
    let mut pictures = Pictures::default();
    renderer.execute(&plan, &mut pictures).unwrap();
    (pictures.take(picture), passes.finish(&pictures))
}

/// The picture that the parts add up to, linear light, and the picture.
fn sums(frame: &Frame, passes: &PictureParts) -> Vec<(f32, f32)> {
    let colors = frame.rgb_linear();
    let pixel = |i: usize| {
        let [.., coverage] = frame.particles.as_chunks::<4>().0[i / 3];
        let light = frame.particles[4 * (i / 3) + i % 3];
        let through = passes.clean[i] * passes.transmittance[i] + passes.airlight[i];
        (through * (1.0 - coverage) + light, colors[i])
    };
    (0..colors.len()).map(pixel).collect()
}

fn recombination(backend: Backend) {
    let (frame, passes) = parts(&mut *backend.renderer(), Some(&AIR), &ALL);
    let worst = sums(&frame, &passes).iter().map(|(sum, color)| (sum - color).abs()).fold(0.0, f32::max);
    // f32 and the encoding, 1e-6 of light each time.
    assert!(worst < 2e-5, "{worst}");
    let coverage: Vec<f32> = frame.particles.iter().skip(3).step_by(4).copied().collect();
    let covered = coverage.iter().filter(|c| **c > 0.05).count();
    assert!(covered > 300 && coverage.iter().all(|c| (0.0..=1.0).contains(c)), "{covered}");
    assert!(frame.particles.iter().all(|v| *v >= 0.0));
    // The rest is light of the air, but where a pixel shows several distances.
    let [low, high] = [-0.05, 0.75];
    assert!(passes.airlight.iter().all(|light| (low..high).contains(light)));
}

/// The reference picture of an air that colours by its share is blended like any other.
fn transmittance(backend: Backend) {
    let mut renderer = backend.renderer();
    let (_, passes) = parts(&mut *renderer, Some(&AIR), &[PicturePart::Transmittance]);
    assert!(passes.clean.is_empty() && passes.airlight.is_empty());
    let (camera, splats) = (camera(77, 52), random_splats(300, 1, 5));
    let hooks = Hooks { medium: Some(&AIR), ..Hooks::default() };
    let config = RenderConfig { outputs: ALL_OUTPUTS, ..RenderConfig::default() };
    let pass = DrawPass::new(&[], &camera, &config).with_hooks(hooks);
    let pass = DrawPass { shading: Shading::Transmittance, ..pass };
    let frame = rendered(backend, &[(&splats, None)], &pass).unwrap();
    let clamped: Vec<f32> = frame.rgb.iter().map(|share| share.clamp(0.0, 1.0)).collect();
    assert!(clamped == passes.transmittance);
    // Blue is lost first.
    let shares = passes.transmittance.as_chunks::<3>().0;
    assert!(shares.iter().all(|[red, green, blue]| red >= green && green >= blue && *red < 0.6));
    assert!(shares.iter().filter(|[red, ..]| *red > 0.05).count() > 1000);
}

fn clear(backend: Backend) {
    let (frame, passes) = parts(&mut *backend.renderer(), None, &ALL);
    assert!(passes.transmittance.iter().all(|share| *share == 1.0));
    assert!(passes.airlight.iter().all(|light| *light == 0.0));
    assert!(sums(&frame, &passes).iter().all(|(sum, color)| (sum - color).abs() < 2e-5));
}

#[test]
fn no_bit_depends_on_threads_or_on_what_else_is_wanted() {
    let with = |count: usize, wanted: &[PicturePart]| {
        parts(&mut CpuRenderer::new(threads(count)).unwrap(), Some(&AIR), wanted)
    };
    let one = with(1, &ALL);
    assert!(with(3, &ALL) == one);
    let (frame, alone) = with(2, &[PicturePart::Airlight]);
    assert!(frame == one.0 && alone.airlight == one.1.airlight && alone.clean.is_empty());
}

#[test]
fn asking_for_what_falls_changes_no_color() {
    let (mut renderer, splats) = (CpuRenderer::new(CpuConfig::default()).unwrap(), random_splats(300, 1, 5));
    let (apart, camera) = (config(), camera(77, 52));
    let plain = RenderConfig { outputs: Outputs::default(), ..apart };
    let [apart, plain] = [apart, plain].map(|config| {
        let hooks = Hooks { particles: vec![&Drops], ..Hooks::default() };
        let sets = [SetView::transient(&splats)];
        drawn(&mut renderer, &DrawPass::new(&sets, &camera, &config).with_hooks(hooks))
    });
    assert!(apart.rgb == plain.rgb && plain.particles.is_empty());
}

#[test]
fn a_picture_that_is_a_part_itself_is_not_drawn_again() {
    let mut renderer = CpuRenderer::new(CpuConfig::default()).unwrap();
    let set = renderer.load(&random_splats(300, 1, 5)).unwrap();
    let bare = DrawPass::new(&[SetView::plain(set)], &camera(77, 52), &config());
    for (medium, passes) in [(Some(&AIR as &dyn Medium), [3, 4]), (None, [1, 2])] {
        let hooks = Hooks { medium, ..Hooks::default() };
        let [alone, with_effect] =
            [(&[] as &[&dyn PixelEffect], 0), (&[&Red as &dyn PixelEffect], 1)].map(|(pixels, i)| {
                let mut plan = FramePlan::new();
                let picture =
                    plan.draw(bare.clone().with_hooks(Hooks { pixels: pixels.to_vec(), ..hooks.clone() }));
                let parts = PartPasses::append(&mut plan, picture, &ALL);
                assert_eq!(plan.passes.len(), passes[i]);
                let mut pictures = Pictures::default();
                renderer.execute(&plan, &mut pictures).unwrap();
                parts.finish(&pictures)
            });
        assert!(alone == with_effect);
    }
}

#[cfg(feature = "gpu")]
#[test]
fn a_picture_and_its_parts_are_one_submission_where_the_cpu_has_no_part() {
    let Some(_) = Backend::gpu() else { return };
    // Its own device: what others submit to a shared one is counted too.
    let gpu = crate::testing::small_gpu(128 << 20);
    let mut renderer = crate::GpuRenderer::new(gpu, CpuConfig::default()).unwrap();
    let set = renderer.load(&random_splats(300, 1, 5)).unwrap();
    let pass = DrawPass::new(&[SetView::plain(set)], &camera(400, 300), &config());
    for (particles, wanted) in [(&[] as &[&dyn Particles], 1), (&[&Drops as &dyn Particles], 2)] {
        let mut plan = FramePlan::new();
        let hooks = Hooks { medium: Some(&AIR), particles: particles.to_vec(), ..Hooks::default() };
        let picture = plan.draw(pass.clone().with_hooks(hooks.clone()));
        let _ = PartPasses::append(&mut plan, picture, &ALL);
        let mut pictures = Pictures::default();
        // The first one may be made again with more room.
        renderer.execute(&plan, &mut pictures).unwrap();
        let stats = renderer.execute(&plan, &mut pictures).unwrap();
        assert_eq!(stats.device.submissions, wanted);
    }
}
