//! The GPU back end as a whole: room, pieces, repetition, and errors.

use super::*;
use crate::config::RenderConfig;
use crate::differentiable::{Channels, Differentiable, ForwardConfig, Upstream};
use crate::error::RenderError;
use crate::frame::Frame;
use crate::gradients::{Gradients, Learn};
use crate::hooks::Hooks;
use crate::plan::{DrawPass, SetView};
use crate::reference;
use crate::renderer::RenderBackend;
use crate::testing::comparison::{ALL_OUTPUTS, HardSplats, HeavyAir, compare, drawn, step};
use crate::testing::{
    ANY_GPU, Backend, camera, gpu_differentiable, gpu_renderer, random_splats, shell_camera, shell_splats,
    small_gpu, threads,
};
use std::sync::Arc;
use wm_scene::{Camera, Splats};

/// A GPU of a test's own with all that the adapter has, or with little, and bindings that hold no
/// more than that.
fn own_gpu(most_binding: Option<u64>) -> Arc<Gpu> {
    most_binding.map_or_else(|| Gpu::open(&ANY_GPU).unwrap(), small_gpu)
}

fn own_renderer(most_binding: Option<u64>) -> GpuRenderer {
    GpuRenderer::new(own_gpu(most_binding), threads(2)).unwrap()
}

fn render(renderer: &mut GpuRenderer, splats: &Splats, camera: &Camera) -> Result<Frame, RenderError> {
    let set = renderer.load(splats)?;
    let config = RenderConfig { outputs: ALL_OUTPUTS, ..RenderConfig::default() };
    let pass = DrawPass::new(&[SetView::plain(set)], camera, &config);
    let mut frame = Frame::default();
    let stats = renderer.render(&pass, &mut frame)?;
    assert!(stats.visible > 0 && stats.intersections >= stats.visible / 2 && stats.evaluated_pairs > 0);
    renderer.unload(set);
    Ok(frame)
}

/// 150 of them fill every tile: more entries than the first guess has room for.
#[test]
fn room_that_is_too_small_grows_and_the_frame_is_whole() {
    let Some(_) = Backend::gpu() else { return };
    let camera = camera(600, 400);
    let splats = HardSplats::Huge.splats(150, 4);
    let mut renderer = gpu_renderer();
    let set = renderer.load(&splats).unwrap();
    let config = RenderConfig::default();
    let pass = DrawPass::new(&[SetView::plain(set)], &camera, &config);
    let mut frames = [Frame::default(), Frame::default()];
    let mut entries = 0;
    for frame in &mut frames {
        entries = renderer.render(&pass, frame).unwrap().intersections;
    }
    assert!(entries > 65_536, "{entries} entries ask for no more room");
    // The second had room from the start.
    assert!(frames[0] == frames[1]);
    let many = random_splats(30_000, 0, 5);
    let cpu = Backend::of(crate::simd::SimdChoice::Auto).unwrap();
    let mut other = cpu.renderer();
    let [one, two] = [&mut renderer as &mut dyn RenderBackend, &mut *other]
        .map(|renderer| drawn(renderer, &DrawPass { sets: vec![SetView::transient(&many)], ..pass.clone() }));
    assert_alike(&one, &two);
}

/// Two pictures of one scene, on two back ends: what may be off is a splat at a cut, or two at one
/// depth.
fn assert_alike(one: &Frame, two: &Frame) {
    let off: Vec<f64> = one.rgb.iter().zip(&two.rgb).map(|(a, b)| f64::from((a - b).abs())).collect();
    let count = off.len() as f64;
    let beyond = off.iter().filter(|off| **off > 2.0 / 255.0).count();
    let mean = off.iter().sum::<f64>() / count;
    let psnr = -10.0 * (off.iter().map(|off| off * off).sum::<f64>() / count).log10();
    let most = off.iter().copied().fold(0.0, f64::max);
    let mut depth: f64 = 0.0;
    let mut depths_off = 0;
    for i in (0..one.depth.len()).filter(|i| one.alpha[*i] > 0.5) {
        let relative = f64::from((one.depth[i] / two.depth[i] - 1.0).abs());
        depth = depth.max(relative);
        depths_off += usize::from(relative > 1e-4);
    }
    eprintln!(
        "PSNR {psnr:.1} dB, mean {mean:.1e}, most {most:.1e}, {beyond} of {count} beyond 2/255; depth {depth:.1e} at most, \
         {depths_off} of {} beyond 1e-4",
        one.depth.len()
    );
    assert!(psnr > 70.0 && mean < 1e-5 && (beyond as f64) < 1e-4 * count);
    assert!(depths_off as f64 <= 1e-4 * one.depth.len() as f64);
}

/// A scene like a trained one.
#[test]
fn pictures_are_the_cpus() {
    let Some(_) = Backend::gpu() else { return };
    let camera = shell_camera(400, 266);
    let cpu = Backend::of(crate::simd::SimdChoice::Auto).unwrap();
    for (count, cover, degree) in [(20_000, 30.0, 3), (60_000, 60.0, 0)] {
        let splats = shell_splats(count, cover, degree, 3);
        let config = RenderConfig { outputs: ALL_OUTPUTS, ..RenderConfig::default() };
        let [one, two] = [Backend::Gpu, cpu].map(|backend| {
            let pass = DrawPass::new(&[SetView::transient(&splats)], &camera, &config);
            drawn(&mut *backend.renderer(), &pass)
        });
        assert_alike(&one, &two);
    }
}

/// Sets in many pieces are drawn as in one, bit by bit.
#[test]
fn pieces_make_no_difference() {
    let Some(_) = Backend::gpu() else { return };
    let (camera, splats) = (camera(75, 53), random_splats(5000, 3, 6));
    let whole = render(&mut gpu_renderer(), &splats, &camera).unwrap();
    // 256 splats of degree 3 take 46 kB, those in view 64 bytes each.
    let pieces = render(&mut own_renderer(Some(330_000)), &splats, &camera).unwrap();
    assert!(whole == pieces);
    let config = RenderConfig { outputs: ALL_OUTPUTS, ..RenderConfig::default() };
    let want = reference::frame::render(&[(&splats, None)], &DrawPass::new(&[], &camera, &config));
    compare(&whole, &want, 2.0).unwrap();
}

#[test]
fn what_does_not_fit_is_named() {
    let Some(_) = Backend::gpu() else { return };
    let many = random_splats(5000, 3, 6);
    for (most, what, splats, size) in [
        (10_000, "256 splats", &many, (64, 48)),
        (100_000, "the splats in view", &many, (64, 48)),
        (3_000_000, "tile lists", &HardSplats::Huge.splats(2000, 4), (600, 400)),
        (400_000, "the picture", &many, (600, 400)),
    ] {
        let error = match render(&mut own_renderer(Some(most)), splats, &camera(size.0, size.1)) {
            Err(error) => error.to_string(),
            Ok(_) => panic!("{most} bytes are enough"),
        };
        assert!(
            error.contains(&format!("for {what}: "))
                && error.contains("in one piece")
                && !error.contains('\n'),
            "{error}"
        );
    }
}

#[test]
fn frames_are_the_same_each_time() {
    let Some(_) = Backend::gpu() else { return };
    let (camera, splats) = (camera(333, 217), random_splats(20_000, 1, 60));
    let mut renderer = gpu_renderer();
    let first = render(&mut renderer, &splats, &camera).unwrap();
    for _ in 0..3 {
        assert!(render(&mut renderer, &splats, &camera).unwrap() == first);
    }
}

#[test]
fn a_lost_device_is_an_error_and_no_panic() {
    let Some(_) = Backend::gpu() else { return };
    let (camera, splats) = (camera(64, 48), random_splats(500, 1, 6));
    let mut renderer = own_renderer(None);
    render(&mut renderer, &splats, &camera).unwrap();
    renderer.gpu.lose();
    for _ in 0..2 {
        let error = render(&mut renderer, &splats, &camera).unwrap_err().to_string();
        assert!(error.starts_with("the GPU was lost") && !error.contains('\n'), "{error}");
    }
    assert!(renderer.load(&splats).is_err());
}

/// WebGL's limits of compute are too low; WebGPU's default limits suffice, by the tests above.
#[test]
fn an_adapter_that_lacks_something_is_told_so() {
    let Some(_) = Backend::gpu() else { return };
    let webgl = wgpu::Limits::downlevel_defaults();
    let storage = wgpu::Limits { max_compute_workgroup_storage_size: 16_384, ..webgl.clone() };
    for (limits, lack) in [
        (webgl, "max_compute_workgroup_storage_size is 16352, and 16384 is needed"),
        (storage, "max_storage_buffers_per_shader_stage is 4, and 8 is needed"),
    ] {
        let Err(error) = Gpu::open(&GpuConfig { limits: Some(limits), ..ANY_GPU }) else { panic!("{lack}") };
        let said = error.to_string();
        assert!(said.ends_with(lack) && !said.contains('\n'), "{said}");
    }
}

#[test]
fn a_gpu_that_is_not_there_is_named() {
    let choice = AdapterChoice::Named("no such GPU".to_owned());
    let error = Gpu::open(&GpuConfig { choice, ..GpuConfig::default() }).err().unwrap().to_string();
    assert!(error.contains("`no such GPU`") && !error.contains('\n'), "{error}");
    // One in software is never taken unasked.
    if let Ok(gpu) = Gpu::open(&GpuConfig::default()) {
        assert_ne!(gpu.kind, AdapterKind::Software);
    }
}

#[test]
fn an_air_without_wgsl_is_refused_by_name() {
    let Some(_) = Backend::gpu() else { return };
    let mut renderer = gpu_renderer();
    let set = renderer.load(&random_splats(50, 0, 1)).unwrap();
    let (camera, config) = (camera(32, 32), RenderConfig::default());
    let hooks = Hooks { medium: Some(&HeavyAir), ..Hooks::default() };
    let pass = DrawPass::new(&[SetView::plain(set)], &camera, &config).with_hooks(hooks.clone());
    let error = renderer.render(&pass, &mut Frame::default()).unwrap_err();
    assert_eq!(error.to_string(), "heavy air has no form for the GPU yet: render with the CPU");
}

/// A step of training: the picture, and gradients of a random loss.
fn learn(
    trainer: &mut GpuDifferentiable,
    splats: &Splats,
    camera: &Camera,
) -> Result<(Frame, Gradients), RenderError> {
    let channels = Channels::ColorDepthNormal;
    let config = ForwardConfig { channels, sh_degree: splats.sh_degree, ..ForwardConfig::default() };
    step(trainer, splats, camera, &config, Learn::ALL, 5)
}

fn own_trainer(most_binding: Option<u64>) -> GpuDifferentiable {
    GpuDifferentiable::new(own_gpu(most_binding), threads(2)).unwrap()
}

/// With splats about which all threads of a workgroup search the tiles, and others.
#[test]
fn gradients_are_the_same_each_time() {
    let Some(_) = Backend::gpu() else { return };
    let mut splats = HardSplats::Huge.splats(60, 4);
    splats.append(&random_splats(8000, 0, 5));
    let camera = camera(333, 217);
    let mut trainer = gpu_differentiable();
    let first = learn(&mut trainer, &splats, &camera).unwrap();
    assert!(first.1.visible.len() > 1000 && first.1.means.iter().flatten().all(|v| v.is_finite()));
    // What lay there before does not show.
    learn(&mut trainer, &random_splats(3000, 2, 6), &shell_camera(90, 70)).unwrap();
    for _ in 0..3 {
        assert!(learn(&mut trainer, &splats, &camera).unwrap() == first);
    }
}

/// Room that grows, and splats in many pieces, change no bit.
#[test]
fn gradients_do_not_depend_on_room_or_pieces() {
    let Some(_) = Backend::gpu() else { return };
    let (camera, splats) = (camera(600, 400), HardSplats::Huge.splats(150, 4));
    let mut trainer = own_trainer(None);
    let grown = learn(&mut trainer, &splats, &camera).unwrap();
    assert!(grown == learn(&mut trainer, &splats, &camera).unwrap());
    let (camera, splats) = (shell_camera(75, 53), random_splats(5000, 3, 6));
    let whole = learn(&mut trainer, &splats, &camera).unwrap();
    // 256 splats of degree 3 take 46 kB, 4096 in view 786 kB, 65,536 entries 4.2 MB.
    let pieces = learn(&mut own_trainer(Some(800_000)), &splats, &camera).unwrap();
    assert!(whole == pieces && whole.1.visible.len() > 100);
}

#[test]
fn a_training_that_does_not_fit_or_loses_its_gpu_is_told_so() {
    let Some(_) = Backend::gpu() else { return };
    let (camera, splats) = (camera(200, 100), HardSplats::Huge.splats(2000, 4));
    let error = learn(&mut own_trainer(Some(3_000_000)), &splats, &camera).unwrap_err().to_string();
    assert!(error.starts_with("no room on the GPU for what pixels pull: "), "{error}");
    let mut trainer = own_trainer(None);
    let few = random_splats(500, 1, 6);
    learn(&mut trainer, &few, &camera).unwrap();
    trainer.gpu.lose();
    let error = learn(&mut trainer, &few, &camera).unwrap_err().to_string();
    assert!(error.starts_with("the GPU was lost") && !error.contains('\n'), "{error}");
    let none = vec![0.0; 20_000];
    let upstream = Upstream { alpha: &none, ..Upstream::default() };
    let mut trainer = own_trainer(None);
    let config = ForwardConfig { sh_degree: 1, ..ForwardConfig::default() };
    trainer.forward(&few, &camera, &config, &mut Frame::default()).unwrap();
    trainer.gpu.lose();
    assert!(trainer.backward(&few, &upstream, Learn::ALL, &mut Gradients::default()).is_err());
}
