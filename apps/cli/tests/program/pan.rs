//! The fog's colour belongs to the place, not to the picture: when a camera turns until the sky is
//! out of view, nothing that stays in view changes its colour.
//!
//! Boards stand in a field under a sky; their fog takes the airlight from the scene (`auto`). One
//! view has the sky in its upper half, the other, turned down and aside about the same centre, has
//! none. Each board is measured in both.
//!
//! Tolerance: 1/255, what an 8-bit picture can show. The boards' splats are the same distance away
//! in both views; only the pixels' places on them differ, by less than 1 px, and blending's
//! rounding.

use crate::common::*;
use glam::DVec3;
use wm_scene::Camera;
use wm_scene::survey::label_sky;
use wm_scene::synthetic::Builder;

const EYE: DVec3 = DVec3::new(0.0, 0.0, 6.0);
const SIZE: (u32, u32) = (240, 160);

/// The direction of an azimuth and an elevation, degrees; azimuth 0 is +y.
fn direction(azimuth: f64, elevation: f64) -> DVec3 {
    let ((sin_a, cos_a), (sin_e, cos_e)) = (azimuth.to_radians().sin_cos(), elevation.to_radians().sin_cos());
    DVec3::new(sin_a * cos_e, cos_a * cos_e, sin_e)
}

/// Display-referred mean over the 5 x 5 px about the direction in which `point` lies.
fn patch(picture: &Image<[f64; 3]>, camera: &Camera, point: DVec3) -> [f64; 3] {
    let local = camera.viewmat.transform_point3(point);
    let x = (camera.fx * local.x / local.z + camera.cx) as usize;
    let y = (camera.fy * local.y / local.z + camera.cy) as usize;
    let pixels = || (y - 2..=y + 2).flat_map(|y| (x - 2..=x + 2).map(move |x| (x, y)));
    std::array::from_fn(|k| pixels().map(|(x, y)| encode(picture.at(x, y)[k])).sum::<f64>() / 25.0)
}

/// The mean of the brightest tenth of a picture, display-referred: what would pass for airlight if
/// each picture were asked for its own.
fn brightest(picture: &Image<[f64; 3]>) -> f64 {
    let mut values: Vec<f64> = picture.pixels.iter().map(|rgb| encode(rgb[1])).collect();
    values.sort_by(|a, b| b.total_cmp(a));
    let tenth = &values[..values.len() / 10];
    tenth.iter().sum::<f64>() / tenth.len() as f64
}

#[test]
fn turning_from_the_sky_changes_no_color() {
    let mut place = Builder::new(5);
    let meadow = |a: f64, _: f64| if (a * 9.0).fract() < 0.5 { [0.3, 0.38, 0.2] } else { [0.35, 0.4, 0.25] };
    place.surface(DVec3::new(-60.0, -60.0, 0.0), DVec3::X * 120.0, DVec3::Y * 120.0, 1.5, meadow);
    place.sky(DVec3::ZERO, 500.0, 2500);
    let mut splats = place.build();
    let boards: Vec<(Card, [f32; 3])> = [
        (-14.0, 20.0, [0.05, 0.05, 0.06]),
        (-4.0, 30.0, [0.6, 0.6, 0.58]),
        (5.0, 45.0, [0.7, 0.15, 0.1]),
        (12.0, 58.0, [0.1, 0.2, 0.6]),
    ]
    .into_iter()
    .map(|(azimuth, distance, rgb)| {
        // Upright, 2 m above the ground, as large as 16 px.
        let center = EYE + direction(azimuth, 0.0) * distance - DVec3::Z * 4.0;
        let half = 0.06 * distance;
        (Card { center, u: direction(azimuth + 90.0, 0.0) * half, v: DVec3::Z * half }, rgb)
    })
    .collect();
    boards.iter().for_each(|(board, rgb)| board.paint(&mut splats, (24, 24), *rgb));
    // The program has to find the sky by itself, and can.
    assert!(label_sky(&mut splats.clone()) > 2000);
    let workshop = Workshop::new();
    let scene = workshop.scene("field", splats, &yard_metadata(1.0));

    let views = [direction(0.0, 14.0), direction(4.0, -31.0)]
        .map(|towards| look(SIZE, 58.0, EYE, EYE + towards, DVec3::Z));
    let highest = |camera: &Camera| {
        let rows = (0..SIZE.0).map(|x| camera.ray(f64::from(x), 0.0).z.asin().to_degrees());
        rows.fold(f64::NEG_INFINITY, f64::max)
    };
    // The sky fills the upper half of the first view; the second ends below the horizon.
    assert!(highest(&views[0].0) > 40.0 && highest(&views[1].0) < 0.0);

    let render = |name: &str, weather: &str| {
        views.each_ref().map(|(_, view)| read_exr(&workshop.render(&scene, view, name, weather)))
    };
    let clear = render("clear.exr", "");
    let fogged = render("fog.exr", "--set fog.mor=90");
    let mut most: f64 = 0.0;
    for (board, rgb) in &boards {
        let [up, down] = [0, 1].map(|i| patch(&fogged[i], &views[i].0, board.center));
        let [before, _] = [0, 1].map(|i| patch(&clear[i], &views[i].0, board.center));
        most = largest((0..3).map(|k| (up[k] - down[k]).abs()).chain([most]));
        // The patches are the boards, and the fog is there.
        assert!((0..3).all(|k| (before[k] - f64::from(rgb[k])).abs() < BYTE_STEP), "{before:?}, {rgb:?}");
        assert!((0..3).any(|k| (up[k] - before[k]).abs() > 20.0 * BYTE_STEP), "{up:?}, {before:?}");
    }
    let own = (brightest(&clear[0]) - brightest(&clear[1])).abs();
    println!(
        "off by {:.4}/255 at most; airlights by picture differ by {:.1}/255",
        most / BYTE_STEP,
        own / BYTE_STEP
    );
    assert!(most <= BYTE_STEP, "off by {:.2}/255", most / BYTE_STEP);
    // The test can fail: an airlight of each picture's own would change by far more.
    assert!(own > 20.0 * BYTE_STEP, "{own}");
}
