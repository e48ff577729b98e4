//! Sorting of one tile's list by depth. One element is one entry.

use criterion::{BatchSize, BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use wm_render::stages::intersect::key;
use wm_render::stages::sort::cpu::sort;
use wm_render::testing::uniform;

fn run(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("sort");
    for count in [50, 360, 700, 3000, 20_000] {
        let depth = |i: u64| (2.0 * 20f64.powf(uniform(1, i))) as f32;
        let keys: Vec<u64> = (0..count).map(|i| key(depth(i).to_bits(), i as u32, 15)).collect();
        let mut scratch = Vec::new();
        group.throughput(Throughput::Elements(count));
        group.bench_function(BenchmarkId::new("radix", count), |bench| {
            bench.iter_batched_ref(|| keys.clone(), |keys| sort(keys, &mut scratch), BatchSize::SmallInput);
        });
        group.bench_function(BenchmarkId::new("std unstable", count), |bench| {
            bench.iter_batched_ref(|| keys.clone(), |keys| keys.sort_unstable(), BatchSize::SmallInput);
        });
    }
}

criterion_group!(benches, run);
criterion_main!(benches);
