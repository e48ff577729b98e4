//! Every back end against the reference, and what must hold of cover whatever the path.

use super::cpu::ProjectedDrop;
use crate::config::{Background, CpuConfig, Geometry, Outputs, RenderConfig};
use crate::hooks::{GROUP, Hooks, Particle, ParticleGroup, ParticleView, Particles};
use crate::plan::{DrawPass, SetView};
use crate::reference::particles::cover;
use crate::renderer::RenderBackend;
use crate::simd::SimdPath;
use crate::testing::comparison::drawn;
use crate::testing::{Backend, random_splats, threads};
use crate::{CpuRenderer, Frame};
use glam::DVec3;
use wm_base::random::uniform;
use wm_scene::{Camera, Splats};

/// A list, in parts of a given length.
struct List(Vec<Particle>, usize);

impl Particles for List {
    fn parts(&self, _: &ParticleView) -> Vec<[i32; 4]> {
        (0..self.0.len().div_ceil(self.1)).map(|part| [part as i32, 0, 0, 0]).collect()
    }

    fn gather(&self, _: SimdPath, _: &ParticleView, part: [i32; 4], take: &mut dyn FnMut(&ParticleGroup)) {
        if let Some(part) = self.0.chunks(self.1).nth(part[0] as usize) {
            part.chunks(GROUP).for_each(|group| take(&ParticleGroup::of(group)));
        }
    }
}

fn camera() -> Camera {
    Camera::looking((75, 52), 60.0, DVec3::new(0.0, 0.0, -4.0), DVec3::ZERO, DVec3::Y).unwrap()
}

/// Drops, streaks and needles from far to very near, some behind, some beside.
fn particles(count: u64) -> Vec<Particle> {
    let particle = |i: u64| {
        let draw = |k: u64, low: f64, high: f64| (low + (high - low) * uniform(3, 20 * i + k)) as f32;
        let size = 10f32.powf(draw(0, -3.0, -0.8));
        let reach = 10f32.powf(draw(1, -3.0, 0.3));
        let vector = |k: u64, size: f32| [0, 1, 2].map(|axis| size * draw(k + axis, -1.0, 1.0));
        Particle {
            offset: [draw(2, -3.0, 3.0), draw(3, -3.0, 3.0), draw(4, -0.5, 8.0)],
            sigma: 0.25 * size,
            reach: [vector(5, reach), vector(8, if i.is_multiple_of(3) { size } else { 0.0 })],
            area: size * size,
            rgb: [draw(11, 0.0, 1.5), draw(12, 0.0, 1.5), draw(13, 0.0, 1.0)],
        }
    };
    (0..count).map(particle).collect()
}

fn on_cpu(path: SimdPath, count: usize) -> CpuRenderer {
    CpuRenderer::new(CpuConfig { simd: path.choice(), ..threads(count) }).unwrap()
}

fn render(splats: &Splats, list: &List, renderer: &mut dyn RenderBackend) -> Frame {
    let sources: [&dyn Particles; 1] = [list];
    let config = RenderConfig {
        background: Background::Color([0.3, 0.5, 0.7]),
        outputs: Outputs { geometry: Geometry::Depth, ..Outputs::default() },
        ..RenderConfig::default()
    };
    let hooks = Hooks { particles: sources.to_vec(), ..Hooks::default() };
    drawn(renderer, &DrawPass::new(&[SetView::transient(splats)], &camera(), &config).with_hooks(hooks))
}

crate::parity! {
    every_back_end_draws_what_the_reference_draws => cover_is_drawn;
}

fn cover_is_drawn(backend: Backend) {
    let splats = random_splats(60, 1, 9);
    let list = List(particles(300), 37);
    let bare = render(&splats, &List(Vec::new(), 1), &mut *backend.renderer());
    let frame = render(&splats, &list, &mut *backend.renderer());
    let (mut drawn, mut most) = (0, 0.0f64);
    for y in 0..frame.height {
        for x in 0..frame.width {
            let at = frame.index(x, y);
            let alpha = f64::from(bare.alpha[at]);
            let seen = cover(&list.0, &camera(), x, y, alpha, f64::from(bare.depth[at]) * alpha);
            let behind = bare.rgb_at(x, y).map(f64::from);
            let want = seen.over(behind);
            drawn += u32::from(seen.tau > 0.01);
            for k in 0..3 {
                // Light and tau both are off; the encoding is steepest, 12.92, at black.
                let tolerance = 1e-5 + 13.0 * 3.0 * seen.slack.min(1.0);
                let off = (f64::from(frame.rgb_at(x, y)[k]) - want[k]).abs();
                most = most.max(off);
                assert!(off < tolerance, "{backend:?} ({x}, {y}): {off} beyond {tolerance}, {seen:?}");
            }
        }
    }
    assert!(drawn > 500 && most < 0.01, "{backend:?}: {drawn} pixels, {most}");
}

#[test]
fn no_bit_depends_on_threads_parts_or_order() {
    let splats = random_splats(60, 1, 9);
    let path = SimdPath::available()[0];
    let all = particles(300);
    let one = render(&splats, &List(all.clone(), 300), &mut on_cpu(path, 1));
    let mut turned = all;
    turned.reverse();
    for (list, threads) in [(List(turned.clone(), 11), 3), (List(turned, 1), 2)] {
        assert!(render(&splats, &list, &mut on_cpu(path, threads)).rgb == one.rgb);
    }
}

#[cfg(feature = "gpu")]
#[test]
fn no_bit_depends_on_the_order_on_the_gpu() {
    let Some(gpu) = Backend::gpu() else { return };
    let splats = random_splats(60, 1, 9);
    let all = particles(300);
    let one = render(&splats, &List(all.clone(), 300), &mut *gpu.renderer());
    let turned = List(all.into_iter().rev().collect(), 7);
    assert!(render(&splats, &turned, &mut *gpu.renderer()).rgb == one.rgb);
}

/// However small, fast or thin it is, what a particle covers in all is its area.
#[test]
fn cover_is_kept() {
    let view = ParticleView::new(&camera());
    for (size, speed) in [(1e-4, 0.0), (1e-3, 0.02), (2e-3, 0.4), (0.03, 0.0), (0.02, 0.1), (0.4, 0.0)] {
        // The mean over where it lies within a pixel: at that size its sum alone is that of chance.
        let (mut sum, mut area) = (0.0, 0.0);
        for place in 0..400u16 {
            // A pixel is 0.089 wide there.
            let (x, y) = (f32::from(place % 20) * 0.00444, f32::from(place / 20) * 0.00444);
            let particle = Particle {
                offset: [0.1 + x, y - 0.2, 4.0],
                sigma: 0.25 * size,
                reach: [[0.2 * speed, speed, 0.1 * speed], [0.0; 3]],
                area: 0.785 * size * size,
                rgb: [1.0; 3],
            };
            for path in SimdPath::available() {
                let drops = ProjectedDrop::project(path, &ParticleGroup::of(&[particle]), &view);
                assert!(drops.len() == 1 && drops[0].extent.iter().all(|extent| *extent < 30.0), "{path}");
            }
            let pixels = |x, y| 1.0 - (-cover(&[particle], &camera(), x, y, 0.0, 0.0).tau).exp();
            sum += (0..75).flat_map(|x| (0..52).map(move |y| pixels(x, y))).sum::<f64>();
            let tan = f64::from(particle.offset[0].hypot(particle.offset[1])) / 4.0;
            let scale = f64::from(view.pixels()) / 4.0;
            area += 0.785 * f64::from(size * size) * scale * scale * (1.0 + tan * tan).sqrt();
        }
        assert!((sum / area - 1.0).abs() < 0.005, "{size} {speed}: {sum} of {area}");
    }
}
