//! Labels by brute force and by truth.

use super::*;
use crate::testing::renderer;
use crate::{PreparedPlace, Renderer};
use glam::DVec3;
use wm_render::{CpuConfig, CpuDifferentiable};
use wm_scene::splats::{Splat, logit};
use wm_scene::{Group, LensModel, Scene};

const SIZE: (u32, u32) = (64, 48);

fn camera() -> Camera {
    Camera::looking(SIZE, 60.0, DVec3::ZERO, DVec3::X, DVec3::Z).unwrap()
}

fn labels(
    renderer: &mut Renderer,
    place: &mut PreparedPlace,
    lens: Option<&LensView>,
    camera: &Camera,
) -> LabelLayers {
    Drawing { renderer, place, progress: &mut () }.labels(lens, camera).unwrap()
}

/// Round splats in front of the camera, each with a label of its own.
fn cloud(count: u32) -> Splats {
    let mut splats = Splats::with_capacity(count as usize, 0);
    let random = |i: u32, k: u32| {
        let word = (i * 7 + k).wrapping_mul(0x9e37_79b9);
        f64::from((word ^ word >> 15).wrapping_mul(0x85eb_ca6b) >> 8) / f64::from(1u32 << 24)
    };
    for i in 0..count {
        let x = 2.0 + 4.0 * random(i, 0);
        splats.push(&Splat {
            mean: [x, (random(i, 1) - 0.5) * x, (random(i, 2) - 0.5) * x].map(|v| v as f32),
            quat: [1.0, 0.0, 0.0, 0.0],
            log_scale: [(0.05 + 0.3 * random(i, 3)).ln() as f32; 3],
            logit_opacity: logit(0.05 + 0.9 * random(i, 4)) as f32,
            rgb: [0.5; 3],
            group: Group::Scene,
        });
    }
    splats.labels = (0..count).map(|i| 1000 + i as u16).collect();
    splats.instances = (0..count).map(|i| 1 + (i % 5) as u16).collect();
    splats
}

/// For each pixel the splats that blend there, by the contract of the rasterization in f64: weights
/// and the transmittance before each.
fn blended(splats: &Splats, camera: &Camera, x: f64, y: f64) -> Vec<(usize, f64, f64)> {
    let mut order: Vec<(f64, usize)> = (0..splats.len())
        .map(|i| {
            let mean = DVec3::from_array(splats.means[i].map(f64::from));
            (camera.viewmat.transform_point3(mean).z, i)
        })
        .collect();
    order.sort_by(|a, b| a.partial_cmp(b).unwrap());
    let (mut out, mut open) = (Vec::new(), 1.0);
    for (z, i) in order {
        let p = camera.viewmat.transform_point3(DVec3::from_array(splats.means[i].map(f64::from)));
        let (tx, ty) = (p.x / z, p.y / z);
        // Round splats: the covariance is J J^T s^2, dilated.
        let s = splats.scales(i)[0];
        let (fx, fy) = (camera.fx / z, camera.fy / z);
        let limit = |t: f64, c: f64, f: f64, n: u32| {
            let n = f64::from(n);
            t.clamp(-(c + 0.15 * n) / f, (n - c + 0.15 * n) / f)
        };
        let (hx, hy) =
            (limit(tx, camera.cx, camera.fx, camera.width), limit(ty, camera.cy, camera.fy, camera.height));
        let xx = fx * fx * s * s * (1.0 + hx * hx) + 0.3;
        let yy = fy * fy * s * s * (1.0 + hy * hy) + 0.3;
        let xy = fx * fy * s * s * hx * hy;
        let (dx, dy) = (x - (camera.fx * tx + camera.cx), y - (camera.fy * ty + camera.cy));
        let power = (yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / (xx * yy - xy * xy);
        let alpha = (splats.opacity(i) * (-0.5 * power).exp()).min(0.99);
        if alpha < 1.0 / 255.0 {
            continue;
        }
        let next = open * (1.0 - alpha);
        if next <= 1e-4 {
            break;
        }
        out.push((i, alpha * open, open));
        open = next;
    }
    out
}

/// Each pixel's label is that of the splat at which half of the light is passed, and nothing else.
#[test]
fn labels_are_those_of_brute_force() {
    let splats = cloud(150);
    let mut renderer = renderer();
    let mut place = renderer.load(Scene { splats: splats.clone(), ..Scene::default() }).unwrap();
    place.release_splats();
    let labels = labels(&mut renderer, &mut place, None, &camera());
    let (mut none, mut seen) = (0, 0);
    for (pixel, label) in labels.label.iter().enumerate() {
        let at = (pixel as u32 % SIZE.0, pixel as u32 / SIZE.0);
        let blend = blended(&splats, &camera(), f64::from(at.0) + 0.5, f64::from(at.1) + 0.5);
        let end = blend.last().map_or(1.0, |(_, weight, open)| open - weight);
        // Where a step lies within rounding of one half, either side is right.
        if blend.iter().map(|(_, _, open)| *open).chain([end]).any(|open| (open - 0.5).abs() < 2e-3) {
            continue;
        }
        let median = blend.iter().rev().find(|(_, _, open)| *open > 0.5).filter(|_| end <= 0.5);
        let want = median.map_or(0, |(i, ..)| splats.labels[*i]);
        assert_eq!(*label, want, "{at:?}");
        assert_eq!(labels.instance[pixel], median.map_or(0, |(i, ..)| splats.instances[*i]));
        none += usize::from(want == 0);
        seen += usize::from(want > 0);
    }
    assert!(none > 50 && seen > 1000, "{none} and {seen}");
}

/// A splat's label is the one with the largest sum of its weights.
#[test]
fn votes_are_those_of_brute_force() {
    let splats = cloud(60);
    let mask: Vec<u16> = (0..SIZE.0 * SIZE.1)
        .map(|i| {
            let (x, y) = (i % SIZE.0, i / SIZE.0);
            // Seven labels, so that there are several backward passes, 0 among them.
            [0, 3, 500, 65535, 9, 2, 1][((x / 11 + 3 * (y / 13)) % 7) as usize]
        })
        .collect();
    let mut sums = vec![std::collections::BTreeMap::<u16, f64>::new(); splats.len()];
    for (pixel, label) in mask.iter().enumerate() {
        let at = (pixel as u32 % SIZE.0, pixel as u32 / SIZE.0);
        for (i, weight, _) in blended(&splats, &camera(), f64::from(at.0) + 0.5, f64::from(at.1) + 0.5) {
            *sums[i].entry(*label).or_default() += weight;
        }
    }
    let mut renderer =
        CpuDifferentiable::new(CpuConfig { threads: Some(2), ..CpuConfig::default() }).unwrap();
    let mut votes = LabelVotes::new(&splats, Rasterization::default());
    votes.add(&mut renderer, &camera(), &mask).unwrap();
    let voted = votes.finish();
    let mut tested = 0;
    for (i, sums) in sums.iter().enumerate() {
        let mut order: Vec<(f64, u16)> = sums.iter().map(|(label, sum)| (*sum, *label)).collect();
        order.sort_by(|a, b| b.partial_cmp(a).unwrap());
        let Some((best, label)) = order.first().copied() else {
            assert_eq!(voted.labels[i], 0);
            continue;
        };
        // Where two are within rounding, either is right.
        let second = order.get(1).map_or(0.0, |(sum, _)| *sum);
        if best > 0.01 && best - second > 0.02 * best {
            assert_eq!(voted.labels[i], label, "splat {i}: {order:?}");
            tested += 1;
        }
    }
    assert!(tested > 40, "{tested}");
    assert!(voted.won.contains(&65535) && !voted.won.contains(&0));
}

/// Two walls side by side: through any lens there are their two labels and none, never a number
/// between.
#[test]
fn edges_mix_no_labels() {
    let mut splats = Splats::with_capacity(0, 0);
    for i in -40..40 {
        for j in -40..40 {
            splats.push(&Splat {
                mean: [3.0, 0.05 * (i as f32 + 0.5), 0.05 * j as f32],
                quat: [1.0, 0.0, 0.0, 0.0],
                log_scale: [1e-3f32.ln(), 0.04f32.ln(), 0.04f32.ln()],
                logit_opacity: 4.0,
                rgb: [0.5; 3],
                group: Group::Scene,
            });
            let count = splats.len();
            splats.labels.resize(count, 0);
            splats.labels[count - 1] = if i < 0 { 10 } else { 30 };
        }
    }
    let mut renderer = renderer();
    let mut place = renderer.load(Scene { splats, ..Scene::default() }).unwrap();
    let (fisheye, round) = LensModel::fisheye(SIZE, 180.0).unwrap();
    let fisheye = LensView::new(fisheye, &round).unwrap();
    for lens in [None, Some(&fisheye)] {
        let labels = labels(&mut renderer, &mut place, lens, &camera());
        let found: BTreeSet<u16> = labels.label.iter().copied().collect();
        assert_eq!(found, BTreeSet::from([0, 10, 30]));
        // y is to the left.
        let row = &labels.label[(SIZE.0 * SIZE.1 / 2) as usize..][..SIZE.0 as usize];
        assert_eq!((row[SIZE.0 as usize / 2 - 3], row[SIZE.0 as usize / 2 + 2]), (30, 10));
        assert!(labels.instance.is_empty());
    }
}
