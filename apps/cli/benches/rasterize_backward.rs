//! The way back through one 32x32 tile: 512 splats in view order, too faint to stop early, as in
//! the bench of blending. One element is one evaluated pair of a splat and a pixel.
//!
//! And whole steps of training, without loss and optimiser, at 600x444.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use wm_render::dispatch;
use wm_render::hooks::PATCH_PIXELS;
use wm_render::simd::{Lanes, SimdPath};
use wm_render::stages::intersect::key;
use wm_render::stages::project::Record;
use wm_render::stages::rasterize::cpu as forward;
use wm_render::stages::rasterize_backward::cpu::{
    BackwardScratch, RenderedPictures, blend_tile_backward, prepare_patch,
};
use wm_render::stages::rasterize_backward::{GradientSlot, NO_SLOT};
use wm_render::testing::{RandomLoss, shell_camera, shell_splats, tile_records};
use wm_render::{
    Channels, CpuConfig, CpuDifferentiable, Differentiable, ForwardConfig, Frame, Gradients, Learn,
};

struct Tile {
    records: Vec<Record>,
    keys: Vec<u64>,
    scratch: Box<BackwardScratch>,
    slots: Vec<GradientSlot>,
    places: Vec<u32>,
}

#[inline(always)]
fn blend<S: Lanes, const C: usize>(simd: S, tile: &Tile, scratch: &mut forward::BlendScratch) -> u64 {
    forward::blend_tile::<S, C, false, false, false>(simd, &tile.records, &tile.keys, 0.0, 0.0, 15, scratch)
}

/// After [`prepare`].
#[inline(always)]
fn back<S: Lanes, const C: usize>(simd: S, tile: &mut Tile) -> usize {
    let Tile { records, keys, scratch, slots, places } = tile;
    blend_tile_backward::<S, C>(simd, records, keys, 0.0, 0.0, 15, scratch, slots, places)
}

#[inline(always)]
fn prepare<S: Lanes>(simd: S, config: &ForwardConfig, loss: &RandomLoss, scratch: &mut BackwardScratch) {
    let upstream = loss.upstream();
    let pictures = RenderedPictures { config, upstream: &upstream, size: (32, 32) };
    let kept = [[0.5; PATCH_PIXELS]; 8];
    for patch in 0..4 {
        let (left, top) = (patch % 2 * 16, patch / 2 * 16);
        prepare_patch(simd, pictures, &kept, left, top, patch, scratch);
    }
}

fn kernels(criterion: &mut Criterion) {
    let config = ForwardConfig { channels: Channels::ColorDepthNormal, ..ForwardConfig::default() };
    let loss = RandomLoss::new(config.channels, 1024, 3, |_| true);
    for sigma in [1.5, 3.0, 40.0] {
        let mut group = criterion.benchmark_group(format!("rasterize_backward/sigma {sigma} px"));
        let mut tile = Tile {
            records: tile_records(sigma),
            keys: (0..512).map(|i| key(i, i, 15)).collect(),
            scratch: Box::default(),
            slots: vec![GradientSlot::default(); 512],
            places: vec![NO_SLOT; 512],
        };
        let mut scratch = Box::<forward::BlendScratch>::default();
        for path in SimdPath::available() {
            let pairs = dispatch!(path, s => blend::<_, 7>(s, &tile, &mut scratch));
            group.throughput(Throughput::Elements(pairs));
            group.bench_function(BenchmarkId::new("forward", path), |bench| {
                bench.iter(|| dispatch!(path, s => blend::<_, 7>(s, &tile, &mut scratch)));
            });
            macro_rules! backward {
                ($name:literal, $features:literal) => {
                    group.bench_function(BenchmarkId::new($name, path), |bench| {
                        bench.iter(|| {
                            dispatch!(path, s => prepare(s, &config, &loss, &mut tile.scratch));
                            dispatch!(path, s => back::<_, $features>(s, &mut tile))
                        });
                    });
                };
            }
            backward!("rgb", 3);
            backward!("rgb+depth+normal", 7);
        }
    }
}

fn steps(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("step 600x444");
    group.sample_size(20);
    let camera = shell_camera(600, 444);
    for count in [6_000, 100_000, 300_000, 1_000_000] {
        let splats = sorted(count);
        for channels in [Channels::Color, Channels::ColorDepthNormal] {
            let config = ForwardConfig { channels, ..ForwardConfig::default() };
            let mut renderer = CpuDifferentiable::new(CpuConfig::default()).expect("threads start");
            let (mut frame, mut gradients) = (Frame::default(), Gradients::default());
            let loss = RandomLoss::new(channels, 600 * 444, 3, |_| true);
            group.bench_function(BenchmarkId::new(format!("{channels:?}"), count), |bench| {
                bench.iter(|| {
                    renderer.forward(&splats, &camera, &config, &mut frame).expect("it renders");
                    renderer
                        .backward(&splats, &loss.upstream(), Learn::ALL, &mut gradients)
                        .expect("it derives");
                });
            });
        }
    }
}

/// A scene as training keeps it, along a curve through space.
fn sorted(count: usize) -> wm_scene::Splats {
    let splats = shell_splats(count, 60.0, 3, 1);
    let order = wm_render::cpu::model::morton_order(&splats.means);
    splats.select(&order.iter().map(|i| *i as usize).collect::<Vec<_>>())
}

criterion_group!(benches, kernels, steps);
criterion_main!(benches);
