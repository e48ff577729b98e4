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
        for channels in if std::env::var("ONE").is_ok() {
            vec![Channels::ColorDepthNormal]
        } else {
            vec![Channels::Color, Channels::ColorDepth, Channels::ColorDepthNormal, Channels::Depth]
        } {
            let config = ForwardConfig { channels, ..ForwardConfig::default() };
            let mut r = Differentiable::new(CpuConfig { threads: Some(threads), simd }).unwrap();
            let (mut f, mut g) = (Frame::default(), Gradients::default());
            let loss = RandomLoss::new(channels, (w * h) as usize, 3, |_| true);
            let mut best = [1e9f64; 10];
            let (mut v, mut e, mut p) = (0, 0, 0);
            for _ in 0..std::env::var("N").map_or(40, |n| n.parse().unwrap()) {
                let a = r.forward(&splats, &camera, &config, &mut f).unwrap();
                let b = r.backward(&splats, &loss.upstream(), Learn::ALL, &mut g);
                (v, e, p) = (a.visible, a.intersections, a.evaluated_pairs);
                for (best, now) in best.iter_mut().zip([
                    a.wall + b.wall,
                    a.wall,
                    b.wall,
                    a.project,
                    a.intersect,
                    a.sort,
                    a.rasterize,
                    a.composite,
                    b.rasterize,
                    b.project,
                ]) {
                    *best = best.min(now * 1e3);
                }
            }
            let [step, aw, bw, project, intersect, sort, blend, composite, back, gather] = best;
            let n = 1e6 / p as f64;
            println!(
                "{count:8} {channels:?}: step {step:.2} ms = fwd {aw:.2} + bwd {bw:.2}; core-ms: project {project:.2} intersect {intersect:.2} sort {sort:.2} blend {blend:.2} composite {composite:.2} | back {back:.2} gather {gather:.2}; V {v} E {e} pairs {:.1}M; ns/pair fwd {:.2} bwd {:.2}, ratio {:.2}",
                p as f64 / 1e6,
                blend * n,
                back * n,
                back / blend
            );
        }
    }
}
