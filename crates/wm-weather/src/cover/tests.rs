//! Snow on made-up places whose surfaces are known.

use super::*;
use crate::optics::Daylight;
use glam::DVec3;
use wm_scene::synthetic::Builder;

const SITE: Site = Site {
    metres_per_unit: 1.0,
    up: [0.0, 0.0, 1.0],
    ground: 0.0,
    airlight: [0.8; 3],
    daylight: Daylight::Known,
    far: 100.0,
};
const SNOW: Matter = Matter { color: [0.8; 3], shade: [0.2, 0.22, 0.28] };

/// A yard of 10 m by 8 m with a roof of 3 m by 3 m at 2.5 m over a part of it.
fn porch() -> Splats {
    let mut place = Builder::new(1);
    place.surface(DVec3::ZERO, DVec3::X * 10.0, DVec3::Y * 8.0, 0.05, |_, _| [0.4; 3]);
    place.surface(DVec3::new(4.0, 3.0, 2.5), DVec3::X * 3.0, DVec3::Y * 3.0, 0.05, |_, _| [0.4; 3]);
    place.build()
}

/// Mean depth over a field of the uppermost surface between two heights.
fn mean(cover: &Cover, lying: &Lying, x: [f64; 2], y: [f64; 2], z: [f64; 2]) -> f64 {
    let ground = &cover.rings()[0];
    let (mut sum, mut count) = (0.0, 0);
    for node in 0..lying.settled[0].depth.len() {
        let [column, row] = ground.place(node).map(|v| v as f64 + 0.5);
        let at = ground.places.point([column, row], f64::from(ground.height[node]));
        let is_in = |k: usize, ends: [f64; 2]| at[k] > ends[0] && at[k] < ends[1];
        if is_in(0, x) && is_in(1, y) && is_in(2, z) {
            sum += f64::from(lying.settled[0].depth[node]);
            count += 1;
        }
    }
    assert!(count > 100, "{count} nodes");
    sum / f64::from(count)
}

#[test]
fn roofs_are_covered_and_what_is_below_is_bare() {
    let splats = porch();
    let cover = Cover::of(&splats, &SITE, [0.0; 2], [5.0, 4.0, 0.0], 2);
    let lying = cover.lying(&Asked { depth: 0.1, repose: 0.84, matter: SNOW });
    let open = mean(&cover, &lying, [1.0, 3.0], [1.0, 7.0], [-0.2, 0.2]);
    let roof = mean(&cover, &lying, [4.5, 6.5], [3.5, 5.5], [2.3, 2.7]);
    let below = mean(&cover, &lying, [5.0, 6.0], [4.0, 5.0], [-0.2, 0.2]);
    println!("open {open:.4}, roof {roof:.4}, below {below:.4}");
    assert!((open / 0.1 - 1.0).abs() < 0.03 && (roof / 0.1 - 1.0).abs() < 0.03, "{open} {roof}");
    assert!(below < 0.005, "{below}");
    // What fell lies.
    let fell: f64 = cover.rings()[0].share.iter().map(|v| f64::from(*v) * 0.1).sum();
    let lies: f64 = lying.settled[0].depth.iter().map(|v| f64::from(*v)).sum();
    assert!(
        ((lies + lying.settled[0].lost) / fell - 1.0).abs() < 1e-3,
        "{lies} {} {fell}",
        lying.settled[0].lost
    );
}
