//! A probe for tuning, not kept.
use wm_render::testing::{RandomLoss, shell_camera, shell_splats};
use wm_render::{Channels, CpuConfig, Differentiable, ForwardConfig, Frame, Gradients, Learn};
fn main() {
    let args: Vec<String> = std::env::args().collect();
    let simd = args.get(1).map_or("auto", |s| s).parse().unwrap();
    let threads: usize = args.get(2).map_or(2, |s| s.parse().unwrap());
    let counts: Vec<usize> = args
        .get(3)
        .map_or("6000,100000,300000,1000000", |s| s)
        .split(',')
        .map(|v| v.parse().unwrap())
        .collect();
    let (w, h) = if args.len() > 4 { (1200, 800) } else { (600, 444) };
    let camera = shell_camera(w, h);
    for count in counts {
        let splats = shell_splats(count, 60.0, 3, 1);
        let order = wm_render::cpu::model::morton_order(&splats.means);
        let splats = splats.select(&order.iter().map(|i| *i as usize).collect::<Vec<_>>());
        for channels in [Channels::Color, Channels::ColorDepth, Channels::ColorDepthNormal, Channels::Depth] {
            let config = ForwardConfig { channels, ..ForwardConfig::default() };
            let mut r = Differentiable::new(CpuConfig { threads: Some(threads), simd }).unwrap();
            let (mut f, mut g) = (Frame::default(), Gradients::default());
            let loss = RandomLoss::new(channels, (w * h) as usize, 3, |_| true);
            let mut best = (1e9f64, None);
            for _ in 0..25 {
                let a = r.forward(&splats, &camera, &config, &mut f).unwrap();
                let b = r.backward(&splats, &loss.upstream(), Learn::ALL, &mut g);
                if a.wall + b.wall < best.0 {
                    best = (a.wall + b.wall, Some((a, b)));
                }
            }
            let (a, b) = best.1.unwrap();
            let ms = 1e3;
            println!(
                "{count:8} {channels:?}: step {:.2} ms = fwd {:.2} + bwd {:.2}; core-ms: project {:.2} intersect {:.2} sort {:.2} blend {:.2} composite {:.2} | back {:.2} gather {:.2}; V {} E {} pairs {:.1}M; ns/pair fwd {:.2} bwd {:.2}, ratio {:.2}",
                best.0 * ms,
                a.wall * ms,
                b.wall * ms,
                a.project * ms,
                a.intersect * ms,
                a.sort * ms,
                a.rasterize * ms,
                a.composite * ms,
                b.rasterize * ms,
                b.project * ms,
                a.visible,
                a.intersections,
                a.evaluated_pairs as f64 / 1e6,
                a.rasterize * 1e9 / a.evaluated_pairs as f64,
                b.rasterize * 1e9 / a.evaluated_pairs as f64,
                b.rasterize / a.rasterize
            );
        }
    }
}
