//! Structural similarity and its derivative, as a step of training takes them.

use criterion::{Criterion, criterion_group, criterion_main};
use std::hint::black_box;
use wm_base::random::uniform;
use wm_render::simd::SimdPath;
use wm_train::metrics::Ssim;

fn ssim(c: &mut Criterion) {
    let (width, height) = (600, 444);
    let picture = |seed| -> Vec<f32> { (0..width * height * 3).map(|i| uniform(seed, i) as f32).collect() };
    let (x, y) = (picture(1), picture(2));
    let mut gradient = vec![0.0; x.len()];
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    for path in SimdPath::available() {
        let mut ssim = Ssim::new(path);
        c.bench_function(&format!("ssim 600x444, 1 thread, {path}"), |b| {
            b.iter(|| {
                pool.install(|| black_box(ssim.add_gradient(&x, &y, width as usize, 1.0, &mut gradient)))
            });
        });
    }
}

criterion_group!(benches, ssim);
criterion_main!(benches);
