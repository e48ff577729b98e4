//! The blend loop alone: one 32x32 tile, 512 splats in view order, too faint to stop early. One element
//! is one evaluated pair of a splat and a pixel, so 2.5 Gelem/s is 0.4 ns a pair.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use wm_render::dispatch;
use wm_render::simd::{Lanes, SimdPath};
use wm_render::stages::intersect::key;
use wm_render::stages::project::{Record, SQRT_HALF_LOG2E};
use wm_render::stages::rasterize::cpu::{Scratch, blend_tile};
use wm_render::testing::uniform;

/// Splats with a standard deviation of about `sigma` px, spread over the tile.
fn records(sigma: f64) -> Vec<Record> {
    (0..512)
        .map(|i| {
            let u = |k: u64| uniform(5, i * 8 + k);
            let stretch = (1.2 * (u(0) - 0.5)).exp();
            let (sin, cos) = (u(1) * std::f64::consts::PI).sin_cos();
            let (a, b) = ((sigma * stretch).powi(2) + 0.3, (sigma / stretch).powi(2) + 0.3);
            let (xx, yy, xy) =
                (cos * cos * a + sin * sin * b, sin * sin * a + cos * cos * b, sin * cos * (a - b));
            let vy = f64::from(SQRT_HALF_LOG2E) * (xx / (xx * yy - xy * xy)).sqrt();
            Record {
                x: (32.0 * u(2)) as f32,
                y: (32.0 * u(3)) as f32,
                ux: (f64::from(SQRT_HALF_LOG2E) / xx.sqrt()) as f32,
                vx: (-vy * xy / xx) as f32,
                vy: vy as f32,
                slope_y: (xy / xx) as f32,
                slope_x: (xy / yy) as f32,
                log2_opacity: (0.012 + 0.01 * u(4)).log2() as f32,
                rgb: [0.5, 0.4, 0.3],
                depth: 5.0,
                normal: [0.1, 0.2, 0.9],
                index: i as u32,
            }
        })
        .collect()
}

#[inline(always)]
fn blend<S: Lanes, const C: usize>(simd: S, records: &[Record], keys: &[u64], scratch: &mut Scratch) -> u64 {
    blend_tile::<S, C, false>(simd, records, keys, (0.0, 0.0), 15, scratch)
}

fn rasterize(criterion: &mut Criterion) {
    for sigma in [1.5, 3.0, 40.0] {
        let mut group = criterion.benchmark_group(format!("rasterize/sigma {sigma} px"));
        let records = records(sigma);
        let keys: Vec<u64> = (0..512).map(|i| key(i, i, 15)).collect();
        let mut scratch = Box::<Scratch>::default();
        for path in SimdPath::available() {
            let pairs = dispatch!(path, s => blend::<_, 7>(s, &records, &keys, &mut scratch));
            group.throughput(Throughput::Elements(pairs));
            group.bench_function(BenchmarkId::new("rgb", path), |bench| {
                bench.iter(|| dispatch!(path, s => blend::<_, 3>(s, &records, &keys, &mut scratch)));
            });
            group.bench_function(BenchmarkId::new("rgb+depth+normal", path), |bench| {
                bench.iter(|| dispatch!(path, s => blend::<_, 7>(s, &records, &keys, &mut scratch)));
            });
        }
    }
}

criterion_group!(benches, rasterize);
criterion_main!(benches);
