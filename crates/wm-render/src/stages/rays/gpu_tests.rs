//! The GPU's rays against the referee's, with the tolerance of the CPU's, and against the CPU's.

use super::cpu::RaySplats;
use super::tests::{ALL, compare, hard, rays};
use super::{RayHits, RayOutputs, Rays};
use crate::gpu::{Gpu, GpuRaySplats};
use crate::simd::SimdPath;
use crate::testing::{Backend, gpu_renderer, random_splats, small_gpu};
use std::sync::Arc;
use wm_scene::Splats;
use wm_scene::random::uniform;

/// Any GPU, unless there is none.
fn gpu() -> Option<Arc<Gpu>> {
    Backend::gpu().map(|_| Arc::clone(gpu_renderer().gpu()))
}

fn traced(gpu: &Arc<Gpu>, splats: &Splats, rays: &Rays, asked: RayOutputs) -> RayHits {
    let scene = GpuRaySplats::new(Arc::clone(gpu), splats, |_| true).expect("it fits");
    scene.trace(rays, asked).expect("they are traced")
}

/// Compares with the referee, and says how near the CPU is.
fn check(name: &str, gpu: &Arc<Gpu>, splats: &Splats, rays: &Rays) {
    let hits = traced(gpu, splats, rays, ALL);
    compare(splats, rays, &hits).unwrap_or_else(|error| panic!("{name}: {error}"));
    let cpu = RaySplats::new(splats, |_| true).trace(rays, ALL, SimdPath::widest());
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
fn rays_on_the_gpu_meet_what_the_referee_meets() {
    let Some(gpu) = gpu() else { return };
    let splats = random_splats(3000, 3, 11);
    for travelled in [0.0, 3.0] {
        check(&format!("random, {travelled}"), &gpu, &splats, &rays(1500, travelled, 5));
    }
    let (splats, aimed) = hard();
    check("hard", &gpu, &splats, &aimed);
    check("hard, from many places", &gpu, &splats, &rays(700, 2.0, 3));
    check("walls", &gpu, &walls(), &rays(1500, 2.0, 6));
    // Few splats and rays, so that most rays meet none.
    for seed in 0..6 {
        let path = 20.0 * uniform(1, seed) as f32;
        check("few", &gpu, &random_splats(1 + 9 * seed as usize, 0, seed), &rays(150, path, seed));
    }
}

#[test]
fn the_gpu_gives_the_same_again_and_in_parts() {
    let Some(gpu) = gpu() else { return };
    let splats = random_splats(4000, 1, 2);
    let rays = rays(3000, 1.0, 9);
    let scene = GpuRaySplats::new(Arc::clone(&gpu), &splats, |_| true).unwrap();
    let once = scene.trace(&rays, ALL).unwrap();
    assert!(once == scene.trace(&rays, ALL).unwrap());
    // Room for an entry a splat and no more: almost every packet by itself.
    let scene = scene.holding(1);
    assert!(once == scene.trace(&rays, ALL).unwrap());
    // Bindings that hold the splats and little more.
    let small = small_gpu(4 * 16 * 4096);
    assert!(once == traced(&small, &splats, &rays, ALL));
    // Sums do not change what is hit, and colours are the same alone.
    for asked in [(false, false), (true, false), (false, true)] {
        let asked = RayOutputs { color: asked.0, normal: asked.1 };
        let hits = traced(&gpu, &splats, &rays, asked);
        let color = if asked.color { once.color.clone() } else { Vec::new() };
        let normal = if asked.normal { once.normal.clone() } else { Vec::new() };
        assert!(hits == RayHits { color, normal, ..once.clone() }, "{asked:?}");
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
    };
    assert_eq!(traced(&gpu, &some, &Rays::default(), ALL), RayHits::default());
    assert_eq!(traced(&gpu, &random_splats(0, 3, 4), &one, ALL), missed);
    let sky = GpuRaySplats::new(Arc::clone(&gpu), &some, |_| false).unwrap();
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
