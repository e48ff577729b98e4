use super::drops::{GlassDrop, RUNNING_CELL_M, SITTING_CELL_M, cells, drops, landings};
use super::geometry::GlassView;
use super::layer::{DropLayer, LayerScale};
use super::veil::Haze;
use super::wide::WideView;
use super::*;
use crate::testing;
use std::f64::consts::PI;
use wm_base::random::bits;
use wm_render::simd::SimdPath;
use wm_scene::Camera;

/// Drops that land on a part of the glass, m, from one instant to another and do not run because
/// they grew on it.
fn count_landings(glass: &Glass, bounds: [[f64; 2]; 2], times: [f64; 2]) -> usize {
    let [from, to] = times;
    let rain = &glass.rain;
    let inside = |at: [f64; 2]| (0..2).all(|k| (bounds[0][k]..bounds[1][k]).contains(&at[k]));
    let [before, after] = [from, to].map(|time| rain.landed(time));
    let mut number = 0;
    for (name, cell, counts, runs) in [
        (0x6472_6f70, SITTING_CELL_M, [before.small, after.small], false),
        (0x7275_6e73, RUNNING_CELL_M, [before.running, after.running], true),
    ] {
        let [first, last] = cells(bounds[0][1], bounds[1][1], cell);
        let columns = cells(bounds[0][0], bounds[1][0], cell);
        for row in first..=last {
            landings(bits(glass.seed, name), cell, columns, row, counts, |at, count, mut random| {
                let grew = runs && random.uniform() < rain.segment(rain.time_of_running(count)).grown;
                number += usize::from(inside(at) && !grew);
            });
        }
    }
    number
}

const CONTACT_ANGLE_RAD: f64 = 55.0 * PI / 180.0;

fn glass(rain: GlassRain, tilt: f64, time: f64) -> Glass {
    Glass {
        distance: 0.5,
        aperture: 0.0,
        tilt,
        contact: CONTACT_ANGLE_RAD,
        runs_from: 2.2e-3,
        drying: 60.0,
        dirt: 0.0,
        dirt_transmittance: 0.6,
        dirt_scatter: 0.25,
        veil: 0.0,
        seed: 5,
        time,
        rain,
    }
}

fn steady(rain: Rainfall) -> GlassRain {
    GlassRain::new(-20.0, &[], |_| rain, CONTACT_ANGLE_RAD, 1.0, 2.2e-3)
}

fn camera(width: u32, height: u32, fov: f64) -> Camera {
    Camera::looking((width, height), fov, glam::DVec3::ZERO, glam::DVec3::Y, glam::DVec3::Z).unwrap()
}

/// Area of the feet of drops, m^2.
fn area(drops: &[GlassDrop]) -> f64 {
    drops.iter().map(|drop| PI * drop.radius.powi(2)).sum()
}

/// Marshall and Palmer's drops of `rate` mm/h from 0.5 to 6 mm at the speeds of Brandes et al.
/// (2002): the sum of `f(number, speed)` over the diameters, by numbers that give the rate. Typed
/// anew.
fn rain_sum(rate: f64, f: impl Fn(f64) -> f64) -> f64 {
    let slope = 4.1 * rate.powf(-0.21);
    let steps = 20_000;
    let width = 5.5 / f64::from(steps);
    let (mut water, mut sum) = (0.0, 0.0);
    for k in 0..steps {
        let d = 0.5 + width * (f64::from(k) + 0.5);
        let number = 8000.0 * (-slope * d).exp() * width;
        let speed = -0.1021 + 4.932 * d - 0.9551 * d * d + 0.07934 * d.powi(3) - 0.002_362 * d.powi(4);
        water += number * speed * PI / 6.0 * d.powi(3) * 3.6e-3;
        sum += number * f(speed);
    }
    sum * rate / water
}

#[test]
fn as_many_drops_land_as_the_flux_says() {
    let bounds = [[-0.4, -0.3], [0.4, 0.3]];
    let patch = 0.8 * 0.6;
    let (tilt, rate, wind) = (40f64.to_radians(), 25.0, 9.0);
    let level = Rainfall { rate, wind: 0.0, speed: 0.0, tilt, is_on_glass: false };
    let cases = [
        (level, rain_sum(rate, |speed| speed * tilt.sin())),
        // Rain that falls past an upright glass, with a wind from all sides, and against a glass
        // that moves.
        (Rainfall { wind, tilt: 0.0, ..level }, rain_sum(rate, |_| wind / PI)),
        (Rainfall { speed: 12.0, tilt: 0.0, ..level }, rain_sum(rate, |_| 12.0)),
        (Rainfall::onto_glass(10.0), rain_sum(10.0, |speed| speed)),
    ];
    for (rain, flux) in cases {
        let glass = glass(steady(rain), tilt, 0.0);
        let (from, to) = (3.0, 43.0);
        let expected = flux * patch * (to - from);
        let found = count_landings(&glass, bounds, [from, to]) as f64;
        let sigma = expected.sqrt();
        // Classes of diameters are some thousandths off.
        assert!((found - expected).abs() < 3.0 * sigma + 0.005 * expected, "{found} of {expected}");
        assert!((found - 1.1 * expected).abs() > 5.0 * sigma, "a tenth more would pass");
    }
    // In still air nothing lands on an upright glass.
    assert!(steady(Rainfall { tilt: 0.0, ..level }).is_dry(1e6));
}

#[test]
fn landings_follow_rain_that_changes() {
    let rate = |time: f64| 4.0 + 2.0 * time.clamp(0.0, 10.0);
    let rain = GlassRain::new(
        -20.0,
        &[0.0, 10.0],
        |time| Rainfall::onto_glass(rate(time)),
        CONTACT_ANGLE_RAD,
        1.0,
        2.2e-3,
    );
    let glass = glass(rain, 0.0, 0.0);
    let bounds = [[-0.5, -0.5], [0.5, 0.5]];
    let steps = 200;
    let expected: f64 = (0..steps)
        .map(|k| {
            8.0 / f64::from(steps)
                * rain_sum(rate(1.0 + 8.0 * (f64::from(k) + 0.5) / f64::from(steps)), |v| v)
        })
        .sum();
    let found = count_landings(&glass, bounds, [1.0, 9.0]) as f64;
    assert!((found - expected).abs() < 3.0 * expected.sqrt() + 0.01 * expected, "{found} of {expected}");
}

#[test]
fn a_drop_shows_the_scene_upside_down() {
    // Bright above, dark below.
    let side = 256;
    let rgb = (0..side * side).flat_map(|i| [if i / side < side / 2 { 1.0f32 } else { 0.1 }; 3]).collect();
    let frame = testing::frame([side as u32; 2], rgb, 1.0);
    let wide = WideView::new(SimdPath::widest(), &frame);
    // Rays are nearly along the axis.
    let camera = camera(200, 200, 10.0);
    let glass = glass(steady(Rainfall::onto_glass(10.0)), 0.0, 0.0);
    let view = GlassView::new(&glass, &camera);
    // 40 px of radius.
    let radius = 40.0 / view.project([0.0; 2]).1[0];
    let drop = GlassDrop { at: [0.0; 2], radius, aspect: 1.0 };
    let layer =
        DropLayer::new(&glass, &view, &camera, &[drop], &wide, LayerScale::new(0.0), SimdPath::widest());
    let at = |x: usize, y: usize| layer.pixels[y * layer.width + x];
    let (top, bottom, rim, beside) = (at(100, 78), at(100, 122), at(138, 100), at(150, 100));
    assert!(top[0] < 0.05 && bottom[0] > 0.8, "{top:?} {bottom:?}");
    assert!((top[3], bottom[3], beside[3]) == (1.0, 1.0, 0.0));
    // The rim is darker than both halves' mean: it mirrors what is inside.
    assert!(rim[0] < 0.1 && rim[3] == 1.0, "{rim:?}");
}

#[test]
fn drops_dry_when_the_rain_ends() {
    let rain = |time: f64| Rainfall::onto_glass(if time < 10.0 { 10.0 } else { 0.0 });
    let rain = GlassRain::new(-20.0, &[10.0, 10.001], rain, CONTACT_ANGLE_RAD, 1.0, 2.2e-3);
    let bounds = [[-0.2, -0.2], [0.2, 0.2]];
    let areas =
        [10.0, 12.0, 40.0, 120.0, 1000.0].map(|time| area(&drops(&glass(rain.clone(), 0.5, time), bounds)));
    println!("{areas:?}");
    assert!(areas[0] > 0.005 * 0.16);
    // Runs end first; then all shrink.
    assert!(areas[2] < areas[1] && areas[3] < 0.8 * areas[2] && areas[4] == 0.0);
}

#[test]
fn a_long_rain_leaves_no_more_work_than_a_short_one() {
    let rain = steady(Rainfall::onto_glass(15.0));
    let bounds = [[-0.3, -0.2], [0.3, 0.2]];
    let numbers = [300.0, 3000.0, 300_000.0].map(|time| drops(&glass(rain.clone(), 0.5, time), bounds).len());
    assert!(numbers.iter().all(|n| (0.8..1.25).contains(&(*n as f64 / numbers[0] as f64))), "{numbers:?}");
}

#[test]
fn drops_run_down() {
    let rain = steady(Rainfall::onto_glass(15.0));
    let bounds = [[-0.3, -0.2], [0.3, 0.2]];
    let at = |time: f64| drops(&glass(rain.clone(), 0.5, time), bounds);
    let (before, after) = (at(50.0), at(50.04));
    // Of most drops nothing changes in a frame; of those that move all go down.
    let same = before.iter().filter(|drop| after.iter().any(|other| other.at == drop.at)).count();
    assert!(same as f64 > 0.9 * before.len() as f64, "{same} of {}", before.len());
    let moved: Vec<&GlassDrop> = before
        .iter()
        .filter(|drop| drop.radius > 2.2e-3 && after.iter().all(|other| other.at != drop.at))
        .collect();
    assert!(!moved.is_empty());
    for drop in moved {
        let near = |other: &&GlassDrop| (0..2).all(|k| (other.at[k] - drop.at[k]).abs() < 0.02);
        let lower = after
            .iter()
            .filter(near)
            .any(|other| other.at[1] > drop.at[1] && other.radius > 0.8 * drop.radius);
        let has_left = drop.at[1] > bounds[1][1];
        assert!(lower || has_left, "{drop:?}");
    }
}

#[test]
fn a_bright_source_has_the_veil_of_vos() {
    let camera = camera(900, 600, 50.0);
    let size = (camera.width * camera.height) as usize;
    let mut frame = testing::frame([camera.width, camera.height], vec![0.0; 3 * size], 1.0);
    // A square of 12 px with a light of 1.
    for y in 294..306 {
        for x in 444..456 {
            frame.rgb[3 * (y * 900 + x)..][..3].fill(1.0);
        }
    }
    let wide = WideView::new(SimdPath::widest(), &testing::frame([256; 2], vec![0.0; 3 * 256 * 256], 1.0));
    let glass = Glass { veil: 1.0, ..glass(steady(Rainfall::onto_glass(0.0)), 0.0, 0.0) };
    let view = GlassView::new(&glass, &camera);
    let haze = Haze::new(&glass, &view, &camera, &frame, &wide).unwrap();
    let mut line = Vec::new();
    haze.row(300, &mut line);
    let illuminance = (12.0 / camera.fx).powi(2);
    for degrees in [2.0, 3.5, 6.0, 12.0, 20.0f64] {
        let x = 450.0 + camera.fx * degrees.to_radians().tan();
        let found = f64::from(haze.column(&line, x as usize)[0]);
        let wanted = 10.0 * illuminance / degrees.powi(2);
        assert!((0.6..1.6).contains(&(found / wanted)), "{degrees}: {found} for {wanted}");
    }
}
