//! The blend loop alone: one 32x32 tile, 512 splats in view order, too faint to stop early. One
//! element is one evaluated pair of a splat and a pixel, so 2.5 Gelem/s is 0.4 ns a pair.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use wm_render::dispatch;
use wm_render::simd::{Lanes, SimdPath};
use wm_render::stages::intersect::key;
use wm_render::stages::project::Record;
use wm_render::stages::rasterize::cpu::{BlendScratch, blend_tile};
use wm_render::testing::tile_records;

#[inline(always)]
fn blend<S: Lanes, const C: usize>(
    simd: S,
    records: &[Record],
    keys: &[u64],
    scratch: &mut BlendScratch,
) -> u64 {
    blend_tile::<S, C, false, false, false>(simd, records, keys, 0.0, 0.0, 15, scratch)
}

fn rasterize(criterion: &mut Criterion) {
    for sigma in [1.5, 3.0, 40.0] {
        let mut group = criterion.benchmark_group(format!("rasterize/sigma {sigma} px"));
        let records = tile_records(sigma);
        let keys: Vec<u64> = (0..512).map(|i| key(i, i, 15)).collect();
        let mut scratch = Box::<BlendScratch>::default();
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
