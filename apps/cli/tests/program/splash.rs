//! Splashes: frames alone and in sequences, threads, what stays dry, and weathers without splashes.

use crate::common::*;
use glam::DVec3;
use wm_scene::Splats;
use wm_scene::synthetic::Builder;

const SIZE: (u32, u32) = (96, 64);

/// A cloudburst that goes on for some seconds, in wind.
const CLOUDBURST: &str = r#"
[wind]
speed = 3
[rain]
rate = { keys = [[0, 60], [4, 90]] }
exposure = 0.02
[wetness]
[splash]
amount = 10
"#;

#[test]
fn a_frame_with_splashes_alone_is_that_of_the_sequence_on_any_number_of_threads() {
    let (_, view) = look(SIZE, 50.0, DVec3::new(0.5, -8.0, 1.6), DVec3::new(0.0, -4.0, 0.0), DVec3::Z);
    Shot::of("yard", yard().build(), &yard_metadata(1.0), view).check_frames_alone(CLOUDBURST);
}

/// Level ground, half of it (x below -1) under a roof.
fn half_covered() -> Splats {
    let mut place = Builder::new(5);
    let grey = |_: f64, _: f64| [0.3; 3];
    place.surface(DVec3::new(-12.0, -12.0, 0.0), DVec3::X * 24.0, DVec3::Y * 24.0, 0.3, grey);
    place.surface(DVec3::new(-12.0, -12.0, 3.0), DVec3::X * 11.0, DVec3::Y * 24.0, 0.2, grey);
    place.build()
}

#[test]
fn nothing_splashes_under_a_roof_or_on_dry_ground() {
    let eye = DVec3::new(-3.5, -9.0, 1.6);
    let (camera, _) = look((150, 100), 60.0, eye, DVec3::new(-0.5, -3.0, 0.3), DVec3::Z);
    let rain: &[&str] = &["rain.rate=100", "rain.exposure=0.016", "wetness.amount=1"];
    let with = |more: &[&'static str]| [rain, more].concat();
    let shown = pictures(
        half_covered(),
        &camera,
        2.0,
        &[
            &with(&[]),
            &with(&["splash.amount=20"]),
            &with(&["splash.amount=0"]),
            &["rain.rate=100"],
            &["rain.rate=100", "splash.amount=20"],
            &["wetness.amount=1"],
            &["wetness.amount=1", "splash.amount=20"],
            &["rain.rate=100", "wetness.amount=1", "splash.amount=20", "fidelity=paper"],
            &["rain.rate=100", "wetness.amount=1", "fidelity=paper"],
        ],
    );
    // Without wet ground, without rain and without an amount there is nothing.
    for (a, b) in [(0, 2), (3, 4), (5, 6), (7, 8)] {
        assert!(shown[a].frame == shown[b].frame, "{a} {b}");
    }
    let (mut dry, mut wet) = ([0, 0], [0, 0]);
    for (x, y) in pixels(&camera) {
        let ray = camera.ray(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let distance = -eye.z / ray.z;
        if ray.z > -0.05 || distance > 9.0 {
            continue;
        }
        // From the edge of the roof droplets fly some way.
        let side = (eye + ray * distance).x + 1.0;
        let changed = shown[0].frame.rgb_at(x, y) != shown[1].frame.rgb_at(x, y);
        if side < -0.8 {
            dry = [dry[0] + 1, dry[1] + i32::from(changed)];
        } else if side > 0.8 {
            wet = [wet[0] + 1, wet[1] + i32::from(changed)];
        }
    }
    println!("changed: {} of {} pixels under the roof, {} of {} in the open", dry[1], dry[0], wet[1], wet[0]);
    assert!(dry[0] > 500 && dry[1] == 0, "{dry:?}");
    assert!(wet[0] > 500 && wet[1] > wet[0] / 3, "{wet:?}");
}
