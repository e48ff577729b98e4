//! A sweep of a lidar with 64 rows and 1800 columns through a million splats, with one and with
//! seven rays a beam, standing and in a car at 15 m/s.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::{DQuat, DVec3};
use std::f64::consts::TAU;
use wm_render::simd::SimdPath;
use wm_render::testing::shell_splats;
use wm_render::{RayOutputs, RaySplats, RayTracer, Rays};

const ROWS: usize = 64;
const COLUMNS: usize = 1800;
const HALF_DIVERGENCE_RAD: f64 = 1.5e-3;

/// Rays of a sweep of 0.1 s, `sub` a beam: one in its middle and six about it.
fn sweep(sub: usize, speed: f64) -> Rays {
    let mut rays = Rays::default();
    for beam in 0..ROWS * COLUMNS {
        let (column, row) = (beam / ROWS, beam % ROWS);
        let turn = column as f64 / COLUMNS as f64;
        let elevation = (2.0 - 26.8 * row as f64 / (ROWS - 1) as f64).to_radians();
        let axis = DQuat::from_rotation_z(TAU * turn) * DQuat::from_rotation_y(-elevation) * DVec3::X;
        let (across, high) = axis.any_orthonormal_pair();
        for ray in 0..sub {
            let (sin, cos) = (TAU * ray as f64 / 6.0).sin_cos();
            let off = if ray == 6 || sub == 1 {
                DVec3::ZERO
            } else {
                (across * cos + high * sin) * HALF_DIVERGENCE_RAD
            };
            rays.directions.push((axis + off).normalize().as_vec3().to_array());
            rays.origins.push([(0.1 * speed * turn) as f32, 0.0, 0.0]);
        }
    }
    rays
}

fn rays(criterion: &mut Criterion) {
    let splats = shell_splats(1_000_000, 16.0, 0, 1);
    let scene = RaySplats::new(&splats, |_| true);
    let mut group = criterion.benchmark_group("rays/64x1800");
    group.sample_size(10);
    for (sub, speed) in [(1, 0.0), (1, 15.0), (7, 0.0)] {
        let sweep = sweep(sub, speed);
        group.throughput(Throughput::Elements(sweep.len() as u64));
        for path in SimdPath::available() {
            group.bench_function(format!("{sub} a beam, {speed} m/s, {path}"), |bench| {
                bench.iter(|| scene.trace(&sweep, RayOutputs::default(), path));
            });
        }
    }
}

criterion_group!(benches, rays);
criterion_main!(benches);
