//! The GPU's rays against the reference's, with the tolerance of the CPU's, and against the CPU's.

use super::cpu::RaySplats;
use super::tests::{ALL, compare, hard, ray_splats, rays, value};
use super::{RayHits, RayOutputs, RayTracer, Rays};
use crate::error::RenderError;
use crate::gpu::{Gpu, GpuError, GpuRaySplats};
use crate::ray_tracer::AnyRaySplats;
use crate::simd::SimdPath;
use crate::testing::{Backend, gpu_renderer, random_splats, small_gpu};
use std::sync::Arc;
use wm_base::random::uniform;
use wm_scene::Splats;

/// Any GPU, unless there is none.
fn gpu() -> Option<Arc<Gpu>> {
    Backend::gpu().map(|_| Arc::clone(&gpu_renderer().gpu))
}

fn traced(gpu: &Arc<Gpu>, splats: &Splats, rays: &Rays, asked: RayOutputs) -> RayHits {
    let scene = GpuRaySplats::new(Arc::clone(gpu), splats, |_| true, value).expect("it fits");
    scene.trace(rays, asked).expect("they are traced")
}

/// Compares with the reference, and says how near the CPU is.
fn check(name: &str, gpu: &Arc<Gpu>, splats: &Splats, rays: &Rays) {
    let hits = traced(gpu, splats, rays, ALL);
    compare(splats, rays, &hits).unwrap_or_else(|error| panic!("{name}: {error}"));
    let cpu = ray_splats(splats).trace(rays, ALL, SimdPath::widest());
    let off = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    let same = (0..rays.len()).filter(|ray| hits.splat[*ray] == cpu.splat[*ray]).count();
    println!(
        "{name}: {same} of {} hits are the CPU's, coverage off by at most {:.1e}, colour by {:.1e}, normal by {:.1e}",
        rays.len(),
        off(&hits.coverage, &cpu.coverage),
        off(hits.color.as_flattened(), cpu.color.as_flattened()),
        off(hits.normal.as_flattened(), cpu.normal.as_flattened()),
    );
    // Two splats at half of the coverage within rounding: less than one ray in a hundred.
    assert!(same * 100 >= rays.len() * 99, "{name}: {same} of {} hits", rays.len());
}

/// Walls about the middle, one behind the other, of wide flat splats of all opacities.
fn walls() -> Splats {
    let mut splats = random_splats(600, 1, 8);
    for index in 0..splats.len() {
        let number = |k: u64| uniform(31, 8 * index as u64 + k) as f32;
        let (axis, side) = (index % 3, if index % 2 == 0 { 1.0 } else { -1.0 });
        splats.means[index] = [0, 1, 2].map(|k| 8.0 * (number(k) - 0.5));
        splats.means[index][axis] = side * (3.0 + (index / 200) as f32);
        splats.log_scales[index] = [0.8f32.ln(); 3];
        splats.log_scales[index][axis] = 1e-4f32.ln();
        splats.quats[index] = [1.0, 0.0, 0.0, 0.0];
        splats.logit_opacities[index] = if index % 5 == 0 { f32::INFINITY } else { 8.0 * number(4) - 2.0 };
    }
    splats
}

#[test]
fn rays_on_the_gpu_meet_what_the_reference_meets() {
    let Some(gpu) = gpu() else { return };
    let splats = random_splats(3000, 3, 11);
    for travelled in [0.0, 3.0] {
        check(&format!("random, {travelled}"), &gpu, &splats, &rays(800, travelled, 5));
    }
    let (splats, aimed) = hard();
    check("hard", &gpu, &splats, &aimed);
    check("hard, from many places", &gpu, &splats, &rays(400, 2.0, 3));
    check("walls", &gpu, &walls(), &rays(800, 2.0, 6));
    // Few splats and rays, so that most rays meet none.
    for seed in 0..4 {
        let path = 20.0 * uniform(1, seed) as f32;
        check("few", &gpu, &random_splats(1 + 9 * seed as usize, 0, seed), &rays(150, path, seed));
    }
}

#[test]
fn the_gpu_gives_the_same_again_and_in_parts() {
    let Some(gpu) = gpu() else { return };
    let splats = random_splats(600, 1, 2);
    let rays = rays(300, 0.3, 9);
    let scene = GpuRaySplats::new(Arc::clone(&gpu), &splats, |_| true, value).unwrap();
    let once = scene.trace(&rays, ALL).unwrap();
    assert!(once == scene.trace(&rays, ALL).unwrap());
    // Room for an entry per splat and no more: almost every packet by itself.
    let scene = scene.holding(1);
    assert!(once == scene.trace(&rays, ALL).unwrap());
    // Bindings that hold the splats and little more.
    let small = small_gpu(4 * 16 * 640);
    assert!(once == traced(&small, &splats, &rays, ALL));
    // Sums do not change what is hit, and colours are the same alone.
    for asked in [(false, false), (true, false), (false, true)] {
        let asked = RayOutputs { color: asked.0, normal: asked.1, value: asked.0 != asked.1 };
        let hits = traced(&gpu, &splats, &rays, asked);
        let color = if asked.color { once.color.clone() } else { Vec::new() };
        let normal = if asked.normal { once.normal.clone() } else { Vec::new() };
        let value = if asked.value { once.value.clone() } else { Vec::new() };
        assert!(hits == RayHits { color, normal, value, ..once.clone() }, "{asked:?}");
    }
}

#[test]
fn nothing_is_met_where_there_is_nothing() {
    let Some(gpu) = gpu() else { return };
    let some = random_splats(300, 3, 4);
    let one = Rays::from_one([0.0; 3], vec![[1.0, 0.0, 0.0]]);
    let missed = RayHits {
        coverage: vec![0.0],
        distance: vec![f32::INFINITY],
        splat: vec![u32::MAX],
        color: vec![[0.0; 3]],
        normal: vec![[0.0; 3]],
        value: vec![0.0],
    };
    assert_eq!(traced(&gpu, &some, &Rays::default(), ALL), RayHits::default());
    assert_eq!(traced(&gpu, &random_splats(0, 3, 4), &one, ALL), missed);
    let sky = GpuRaySplats::new(Arc::clone(&gpu), &some, |_| false, value).unwrap();
    assert_eq!(sky.trace(&one, ALL).unwrap(), missed);
    let far = Rays::from_one([1e4, 0.0, 0.0], vec![[1.0, 0.0, 0.0]]);
    assert_eq!(traced(&gpu, &some, &far, ALL), missed);
    check("a single ray", &gpu, &some, &one);
    // Splats that cannot be met: of no number, and too faint.
    let mut broken = random_splats(2, 0, 1);
    broken.means[0] = [f32::NAN; 3];
    broken.logit_opacities[1] = -20.0;
    assert_eq!(traced(&gpu, &broken, &one, ALL), missed);
}

/// Many packets, and rays to all sides side by side: the lists of as many splats would be too long
/// for a GPU in software.
#[test]
fn many_packets_on_the_gpu_meet_what_the_cpus_meet() {
    let Some(gpu) = gpu() else { return };
    let splats = crate::testing::shell_splats(60_000, 16.0, 0, 1);
    let ring = |ray: usize| {
        let (sin, cos) = (std::f64::consts::TAU * (ray / 4) as f64 / 3000.0).sin_cos();
        let up = 0.05 * (ray % 4) as f64 - 0.1;
        glam::DVec3::new(cos, sin, up).normalize().as_vec3().to_array()
    };
    let rays = Rays::from_one([0.0; 3], (0..12_000).map(ring).collect());
    let hits = traced(&gpu, &splats, &rays, RayOutputs::default());
    let cpu = RaySplats::new(&splats, |_| true).trace(&rays, RayOutputs::default(), SimdPath::widest());
    // Both meet the tolerance of the contract against f64; a splat at the cut of 1/255 takes or
    // leaves as much.
    let off = hits.coverage.iter().zip(&cpu.coverage).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    let same = (0..rays.len()).filter(|ray| hits.splat[*ray] == cpu.splat[*ray]).count();
    println!("{same} of {} hits are the CPU's, coverage off by at most {off:.1e}", rays.len());
    assert!(off < 5e-3 && same * 1000 >= rays.len() * 999, "{same} {off}");
}

#[test]
fn the_cpu_goes_on_where_the_gpu_is_lost() {
    if gpu().is_none() {
        return;
    }
    let gpu = small_gpu(1 << 27);
    let (splats, rays, path) = (random_splats(300, 1, 4), rays(200, 0.0, 5), SimdPath::widest());
    let mut scene = AnyRaySplats::on_cpu(&splats, |index| index != 7, value);
    scene.move_to(&gpu).unwrap();
    let cpu = RaySplats::new(&splats, |index| index != 7).with_values(value).trace(&rays, ALL, path);
    assert!(RayTracer::trace(&scene, &rays, ALL, path).splat == cpu.splat && scene.give_up_gpu().is_none());
    gpu.lose();
    assert!(RayTracer::trace(&scene, &rays, ALL, path) == cpu);
    assert!(matches!(scene.give_up_gpu(), Some(RenderError::Gpu(GpuError::Lost(_)))));
    assert!(RayTracer::trace(&scene, &rays, ALL, path) == cpu && scene.give_up_gpu().is_none());
    // Splats that one binding does not hold.
    let many = random_splats(5000, 0, 1);
    let refused = GpuRaySplats::new(small_gpu(4 * 16 * 4096), &many, |_| true, value);
    assert!(matches!(refused, Err(GpuError::TooLarge { .. })));
}
