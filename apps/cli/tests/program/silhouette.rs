//! Fog at a silhouette: a pixel that holds two distances at once.
//!
//! Half a card at 10 m before one at 1000 m. Where the near card's edge covers a pixel by the part
//! `a`, the eye gets `a` of the near card seen through 10 m of fog and `1 - a` of the far one
//! through 1000 m. Each layer is fogged here in f64, in linear light, and the two are blended as
//! the renderer blends, in display-referred colour, with the coverage that a clear picture of the
//! near card shows. Fog from one depth per pixel, the mean of both, is computed as well: it draws a
//! bright rim about dark things, and the test must see it.
//!
//! Tolerance: 1/255. The splats that a pixel shows lie within two standard deviations, 3.6 px, of
//! its ray. In the picture's corners that is 3.6/88 x 0.55 of 10 m nearer or farther, 0.22 m; at a
//! range of 200 m it changes the light before black by 0.22 x 0.015 x 0.86 x 0.51 = 0.0015, where
//! the sRGB curve rises by 2.1: 0.8/255. It is less everywhere else. What shines through the cards
//! is 2e-4 and goes under.

use crate::common::*;
use glam::DVec3;
use wm_scene::{Metadata, Splats};

const SIZE: (u32, u32) = (96, 64);
const NEAR_DISTANCE_M: f64 = 10.0;
const FAR_DISTANCE_M: f64 = 1000.0;
const AIRLIGHT: f64 = 0xbe as f64 * BYTE_STEP;

#[test]
fn an_edge_is_the_blend_of_what_each_layer_sends_through_the_fog() {
    let (camera, view) = look(SIZE, 40.0, DVec3::ZERO, DVec3::X, DVec3::Z);
    // 0.62 and 0.42 of the distance reach beyond the picture's borders; to the left is +y.
    let across = |distance: f64| Card {
        center: DVec3::X * distance,
        u: DVec3::Y * (0.62 * distance),
        v: DVec3::Z * (0.42 * distance),
    };
    let far = across(FAR_DISTANCE_M);
    let near = Card {
        center: DVec3::new(NEAR_DISTANCE_M, 0.31 * NEAR_DISTANCE_M, 0.0),
        u: across(NEAR_DISTANCE_M).u / 2.0,
        v: across(NEAR_DISTANCE_M).v,
    };
    let metadata = Metadata { ground: Some(-2.0), ..yard_metadata(1.0) };
    // Coarse, so that the edge is wide: 2.3 px of spacing, 1.8 px of standard deviation.
    let near_grid = (24, 32);
    let mut alone = Splats::default();
    near.paint(&mut alone, near_grid, WHITE);
    let alone = Shot::of("near", alone, &metadata, view.clone());
    alone.exr("--background black --also alpha");
    let coverage = read_channel(&alone.path("shot.alpha.exr"), "A");

    for (name, near_color, far_color) in [("black before white", 0.0, 1.0), ("white before black", 1.0, 0.0)]
    {
        let mut splats = Splats::default();
        near.paint(&mut splats, near_grid, [near_color as f32; 3]);
        far.paint(&mut splats, (72, 50), [far_color as f32; 3]);
        let both = Shot::of("both", splats, &metadata, view.clone());
        for mor in [200.0, 1000.0] {
            let options = format!("--background black --set fog.mor={mor} --set fog.airlight=#bebebe");
            let picture = both.exr(&options);
            let fogged = |color: f64, metres: f64| {
                let kept = (-MOR_DEPTH / mor * metres).exp();
                encode(decode(color) * kept + decode(AIRLIGHT) * (1.0 - kept))
            };
            let (mut off, mut off_by_mean, mut edge) = (0.0f64, 0.0f64, 0);
            for y in 0..picture.height {
                for x in 0..picture.width {
                    let alpha = coverage.at(x, y);
                    let ray = |card: &Card| card.ray_length(&camera, x as f64 + 0.5, y as f64 + 0.5);
                    let (front, back) = (fogged(near_color, ray(&near)), fogged(far_color, ray(&far)));
                    let wanted = alpha * front + (1.0 - alpha) * back;
                    let seen = encode(picture.at(x, y)[1]);
                    off = off.max((seen - wanted).abs());
                    // No halo: nothing is brighter or darker than both layers.
                    assert!(
                        seen > front.min(back) - BYTE_STEP && seen < front.max(back) + BYTE_STEP,
                        "{x}, {y}"
                    );
                    edge += usize::from((0.02..0.98).contains(&alpha));
                    let clear = alpha * near_color + (1.0 - alpha) * far_color;
                    let by_mean = fogged(clear, alpha * ray(&near) + (1.0 - alpha) * ray(&far));
                    off_by_mean = off_by_mean.max((by_mean - wanted).abs());
                }
            }
            let steps = |v: f64| v / BYTE_STEP;
            println!(
                "{name}, MOR {mor} m, {edge} edge pixels: off by {:.3}/255 at most; by the mean depth {:.1}/255",
                steps(off),
                steps(off_by_mean)
            );
            assert!(edge > 150, "{edge} pixels of edge");
            assert!(off <= BYTE_STEP, "{name}, MOR {mor}: off by {:.2}/255", steps(off));
            // The test can fail: one depth per pixel is off by more than ten times the bound.
            assert!(off_by_mean > 10.0 * BYTE_STEP, "{name}, MOR {mor}: {:.2}/255", steps(off_by_mean));
        }
    }
}
