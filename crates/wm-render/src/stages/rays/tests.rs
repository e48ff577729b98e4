use super::cpu::RaySplats;
use super::packets::{PACKET, Packets};
use super::{RayHits, RayOutputs, RayTracer, Rays};
use crate::config::RenderConfig;
use crate::reference;
use crate::simd::SimdPath;
use crate::testing::comparison::drawn;
use crate::testing::{Backend, random_splats};
use crate::{DrawPass, SetView};
use glam::DVec3;
use proptest::prelude::*;
use wm_base::random::uniform;
use wm_scene::{Camera, Splats};

pub(super) const ALL: RayOutputs = RayOutputs { color: true, normal: true, value: true };

/// A value for every splat, 0-1.
pub(super) fn value(splat: usize) -> f32 {
    (splat * 7 % 11) as f32 / 10.0
}

pub(super) fn ray_splats(splats: &Splats) -> RaySplats<'_> {
    RaySplats::new(splats, |_| true).with_values(value)
}

/// Rays to all sides from places along a path of some length.
pub(super) fn rays(count: usize, path: f32, seed: u64) -> Rays {
    let number = |index: usize, k: u64| uniform(seed, 8 * index as u64 + k);
    let one = |index: usize| {
        let (up, around) = (2.0 * number(index, 0) - 1.0, std::f64::consts::TAU * number(index, 1));
        let level = (1.0 - up * up).sqrt();
        [level * around.cos(), level * around.sin(), up].map(|v| v as f32)
    };
    let origins = (0..count).map(|index| [path * number(index, 2) as f32, 0.1, -0.2]).collect();
    Rays { origins, directions: (0..count).map(one).collect() }
}

pub(super) fn compare(splats: &Splats, rays: &Rays, hits: &RayHits) -> Result<(), String> {
    let packets = Packets::new(rays);
    let mut unsettled = 0;
    for group in &packets.groups {
        let center = DVec3::from_array(group.center.map(f64::from));
        for ray in group.packets.clone().flat_map(|packet| packets.rays(packet)) {
            let ray = *ray as usize;
            let [origin, direction] =
                [rays.origins[ray], rays.directions[ray]].map(|v| DVec3::from_array(v.map(f64::from)));
            let want = reference::rays::trace(splats, |_| true, origin, direction, center);
            let limit = 2e-4 + want.slack;
            if (f64::from(hits.coverage[ray]) - want.coverage).abs() > limit {
                return Err(format!("ray {ray}: coverage {}, want {}", hits.coverage[ray], want.coverage));
            }
            for k in 0..3 {
                let (color, normal) = (f64::from(hits.color[ray][k]), f64::from(hits.normal[ray][k]));
                if (color - want.color[k]).abs() > 4.0 * limit
                    || (normal - want.normal[k]).abs() > 2.0 * limit
                {
                    return Err(format!("ray {ray}: colour {color}, normal {normal}, want {want:?}"));
                }
            }
            let sum: f64 = want.weights.iter().map(|(splat, weight)| weight * f64::from(value(*splat))).sum();
            if (f64::from(hits.value[ray]) - sum).abs() > limit {
                return Err(format!("ray {ray}: value {}, want {sum}", hits.value[ray]));
            }
            if want.margin < limit {
                unsettled += 1;
                continue;
            }
            match want.hit {
                None if hits.splat[ray] == u32::MAX && hits.distance[ray] == f32::INFINITY => {}
                Some((distance, splat))
                    if hits.splat[ray] as usize == splat
                        && (f64::from(hits.distance[ray]) - distance).abs() < 1e-4 * (1.0 + distance) => {}
                _ => {
                    return Err(format!(
                        "ray {ray}: {} at {}, want {want:?}",
                        hits.splat[ray], hits.distance[ray]
                    ));
                }
            }
        }
    }
    if unsettled * 20 > rays.len() { Err(format!("{unsettled} rays are unsettled")) } else { Ok(()) }
}

#[test]
fn rays_meet_what_the_reference_meets() {
    let splats = random_splats(3000, 3, 11);
    for path in SimdPath::available() {
        for travelled in [0.0, 3.0] {
            let rays = rays(1500, travelled, 5);
            let hits = ray_splats(&splats).trace(&rays, ALL, path);
            assert!(hits.splat.iter().filter(|splat| **splat != u32::MAX).count() > 200);
            compare(&splats, &rays, &hits).unwrap_or_else(|error| panic!("{path}, {travelled}: {error}"));
        }
    }
}

/// Needles and flat splats, small ones far away, one that the origin lies in; and rays at all of
/// them.
pub(super) fn hard() -> (Splats, Rays) {
    let mut splats = random_splats(400, 0, 3);
    for index in 0..splats.len() {
        let kind = index % 4;
        let size = splats.log_scales[index][0];
        splats.log_scales[index] = match kind {
            0 => [size + 1.5, size - 4.0, size - 4.0],
            1 => [size + 1.5, size + 1.0, size - 14.0],
            2 => [size - 3.0; 3],
            _ => splats.log_scales[index],
        };
        if kind == 2 {
            splats.means[index] = splats.means[index].map(|v| 30.0 * v);
        }
    }
    splats.means[7] = [0.1, 0.0, 0.0];
    splats.log_scales[7] = [0.5; 3];
    splats.logit_opacities[7] = -2.0;
    // Rays at the middles of splats, so that small ones are met.
    let aimed =
        splats.means.iter().map(|mean| (DVec3::from_array(mean.map(f64::from))).normalize().as_vec3());
    let rays = Rays::from_one([0.0; 3], aimed.map(|way| way.to_array()).collect());
    (splats, rays)
}

#[test]
fn hard_splats_are_met() {
    let (splats, rays) = hard();
    for path in SimdPath::available() {
        let hits = ray_splats(&splats).trace(&rays, ALL, path);
        compare(&splats, &rays, &hits).unwrap_or_else(|error| panic!("{path}: {error}"));
    }
}

#[test]
fn threads_change_nothing() {
    let splats = random_splats(5000, 1, 2);
    let rays = rays(2000, 1.0, 9);
    let run = |threads| {
        let pool = crate::cpu::pool(threads).unwrap();
        pool.install(|| ray_splats(&splats).trace(&rays, ALL, SimdPath::widest()))
    };
    let one = run(1);
    assert_eq!(one, run(2));
    assert_eq!(one, run(7));
}

/// A picture by rays is that of the rasterizer, where splats are many pixels wide and few degrees.
#[test]
fn pinhole_rays_draw_what_the_rasterizer_draws() {
    let mut splats = random_splats(300, 1, 21);
    for index in 0..splats.len() {
        let spread = |k: u64| uniform(77, 4 * index as u64 + k) - 0.5;
        splats.means[index] =
            [200.0 + 40.0 * spread(0), 60.0 * spread(1), 40.0 * spread(2)].map(|v| v as f32);
        splats.log_scales[index] = [1.3f32.ln(), 1.0f32.ln(), 0.8f32.ln()];
    }
    let camera = Camera::looking((480, 320), 12.0, DVec3::ZERO, DVec3::X, DVec3::Z).unwrap();
    let pixels = (0..320 * 480).map(|pixel| ((pixel % 480) as f64 + 0.5, (pixel / 480) as f64 + 0.5));
    let directions = pixels.map(|(x, y)| camera.ray(x, y).normalize().as_vec3().to_array()).collect();
    let rays = Rays::from_one([0.0; 3], directions);
    let path = SimdPath::widest();
    let hits = ray_splats(&splats).trace(&rays, ALL, path);
    let pass = DrawPass::new(&[SetView::transient(&splats)], &camera, &RenderConfig::default());
    let frame = drawn(&mut *Backend::Cpu(path).renderer(), &pass);
    let square: f64 = hits
        .color
        .as_flattened()
        .iter()
        .zip(&frame.rgb)
        .map(|(ray, drawn)| f64::from(ray - drawn).powi(2))
        .sum::<f64>()
        / frame.rgb.len() as f64;
    let psnr = -10.0 * square.log10();
    assert!(psnr > 50.0, "{psnr:.1} dB");
    assert!(hits.coverage.iter().filter(|coverage| **coverage > 0.5).count() > 20_000);
}

#[test]
fn packets_hold_each_ray_once() {
    for (count, path) in [(0, 0.0), (1, 0.0), (1000, 0.0), (3000, 50.0)] {
        let rays = rays(count, path, 4);
        let packets = Packets::new(&rays);
        let mut order = packets.order.clone();
        order.sort_unstable();
        assert!(order.into_iter().eq(0..count as u32));
        assert!(packets.starts.windows(2).all(|pair| (pair[1] - pair[0]) as usize <= PACKET));
        assert!(packets.groups.iter().all(|group| group.radius <= 50.0 / 16.0));
        let narrow = Packets::no_wider(&rays, 0.2);
        assert_eq!(narrow.order, packets.order);
        for packet in 0..narrow.starts.len() - 1 {
            let ways: Vec<DVec3> = narrow
                .rays(packet)
                .iter()
                .map(|ray| DVec3::from_array(rays.directions[*ray as usize].map(f64::from)))
                .collect();
            let apart = ways.iter().map(|way| way.angle_between(ways[0])).fold(0.0, f64::max);
            assert!(ways.len() == 1 || (ways.len() <= PACKET && apart <= 0.41), "{apart}");
        }
    }
}

proptest! {
    #[test]
    fn any_rays_through_few_splats(seed in any::<u64>(), count in 1usize..200, splats in 1usize..60, path in 0.0f32..20.0) {
        let splats = random_splats(splats, 0, seed);
        let rays = rays(count, path, seed);
        let hits = ray_splats(&splats).trace(&rays, ALL, SimdPath::widest());
        if let Err(error) = compare(&splats, &rays, &hits) {
            prop_assert!(error.ends_with("unsettled"), "{error}");
        }
    }
}
