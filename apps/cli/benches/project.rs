//! Projection and shading of groups of sixteen splats, on each SIMD path. One element is one splat.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use wm_render::cpu::model::CpuModel;
use wm_render::dispatch;
use wm_render::hooks::{GROUP, ShadeGroup};
use wm_render::simd::{Lanes, SimdPath};
use wm_render::stages::project::ProjectCamera;
use wm_render::stages::project::cpu::{ProjectedGroup, project_group};
use wm_render::stages::shade::cpu::shade_group;
use wm_render::testing::{camera, random_splats};
use wm_scene::Rasterization;

#[inline(always)]
fn project<S: Lanes>(
    simd: S,
    model: &CpuModel,
    camera: &ProjectCamera,
    out: &mut (ProjectedGroup, ShadeGroup),
) {
    for group in &model.groups {
        project_group(simd, group, camera, Rasterization::Classic, None, None, &mut out.0, &mut out.1);
    }
}

#[inline(always)]
fn shade<S: Lanes>(simd: S, model: &CpuModel, out: &mut (ProjectedGroup, ShadeGroup)) {
    let rows = model.sh_rows();
    for (i, group) in model.groups.iter().enumerate() {
        shade_group(simd, group, &model.sh_rest[i * rows..(i + 1) * rows], &mut out.1);
    }
}

fn run(criterion: &mut Criterion) {
    let camera = ProjectCamera::new(&camera(1200, 800));
    for degree in [0, 3] {
        let model = CpuModel::new(&random_splats(16_384, degree, 1)).expect("random splats are sound");
        let mut out = (ProjectedGroup::default(), ShadeGroup::default());
        let mut group = criterion.benchmark_group(format!("degree {degree}"));
        group.throughput(Throughput::Elements((model.groups.len() * GROUP) as u64));
        for path in SimdPath::available() {
            if degree == 0 {
                group.bench_function(BenchmarkId::new("project", path), |bench| {
                    bench.iter(|| dispatch!(path, s => project(s, &model, &camera, &mut out)));
                });
            }
            group.bench_function(BenchmarkId::new("shade", path), |bench| {
                bench.iter(|| dispatch!(path, s => shade(s, &model, &mut out)));
            });
        }
    }
}

criterion_group!(benches, run);
criterion_main!(benches);
