//! Rain and snow from outside: what they dim, how they streak, and that a frame knows no other.
//!
//! Boards stand in the whole picture, a black and a white one. What is left of their difference is the
//! transmittance of drops and air together, whatever light either adds. Tolerance: 3 % of the optical depth; of
//! depths below 0.05 also what chance does to the drops of one frame, taken over several.

mod common;

use common::*;
use glam::DVec3;
use wm_scene::{Metadata, Splats};

const SIZE: (u32, u32) = (480, 320);
const EYE: DVec3 = DVec3::new(0.0, 0.0, 2.0);

/// A scene that is one board across the whole picture.
fn board(workshop: &Workshop, name: &str, distance: f64, rgb: [f32; 3]) -> (std::path::PathBuf, ViewArgs) {
    let (camera, view) = look(SIZE, 50.0, EYE, EYE + DVec3::Y, DVec3::Z);
    let half = 1.2 * distance;
    let card = Card { center: EYE + DVec3::Y * distance, u: DVec3::X * half, v: DVec3::Z * half };
    let mut splats = Splats::with_capacity(0, 0);
    card.paint(&mut splats, (60, 60), rgb);
    let metadata = Metadata {
        metres_per_unit: Some(1.0),
        up: Some(DVec3::Z),
        ground: Some(0.0),
        airlight: Some([0.7; 3]),
        ..Metadata::default()
    };
    assert!(camera.height == SIZE.1);
    (workshop.scene(name, splats, &metadata), view)
}

/// Mean over the picture, linear light.
fn mean(picture: &Image<[f64; 3]>) -> f64 {
    picture.pixels.iter().map(|rgb| rgb[1]).sum::<f64>() / picture.pixels.len() as f64
}

#[test]
fn drops_and_air_dim_by_one_law_at_every_distance() {
    let workshop = Workshop::new();
    // Rain: 0.365 R^0.63 a km. Snow: as the program's own sum over flakes; 9.36 a km at 2.5 mm/h.
    for (effect, rate, law) in [("rain", 50.0, 0.365e-3 * 50f64.powf(0.63)), ("snowfall", 2.5, 9.36e-3)] {
        for (distance, times) in [(5.0, 12), (20.0, 4), (100.0, 1), (500.0, 1)] {
            let mut kept = 0.0;
            for time in 0..times {
                let light = |name: &str, rgb: [f32; 3]| {
                    let (scene, view) = board(&workshop, name, distance, rgb);
                    let options = format!("--set {effect}.rate={rate} --time {}", 3 * time);
                    let weathered = mean(&read_exr(&workshop.render(&scene, &view, "w.exr", &options)));
                    (weathered, mean(&read_exr(&workshop.render(&scene, &view, "c.exr", ""))))
                };
                let (white, black) = (light("white", [0.9; 3]), light("black", [0.0; 3]));
                kept += (white.0 - black.0) / (white.1 - black.1) / f64::from(times);
            }
            // The mean way of a ray to the board is longer than its distance.
            let (camera, _) = look(SIZE, 50.0, EYE, EYE + DVec3::Y, DVec3::Z);
            let rays = (0..SIZE.1).flat_map(|y| (0..SIZE.0).map(move |x| (x, y)));
            let through = |(x, y): (u32, u32)| {
                let ray = camera.ray(f64::from(x) + 0.5, f64::from(y) + 0.5);
                (-law * distance / ray.y).exp()
            };
            let wanted = rays.map(through).sum::<f64>() / f64::from(SIZE.0 * SIZE.1);
            let (found, wanted) = (-kept.ln(), -wanted.ln());
            println!("{effect} {rate} mm/h, {distance} m: optical depth {found:.4}, by the law {wanted:.4}");
            assert!((found / wanted - 1.0).abs() < 0.03, "{effect} {distance} m: {found} {wanted}");
        }
    }
}

#[test]
fn a_frame_of_rain_and_snow_is_the_same_alone_and_with_any_threads() {
    let workshop = Workshop::new();
    let scene = workshop.scene("yard", yard().build(), &yard_metadata(1.0));
    let (_, view) = yard_look((96, 64));
    let weather = "--set rain.rate=0:5,2:60 --set snowfall.rate=2 --set wind.speed=0:1,1:6,2:3";
    let folder =
        workshop.render(&scene, &view, "all", &format!("{weather} --seconds 1.5 --fps 8 --threads 1"));
    for (frame, threads) in [(3, 2), (11, 7)] {
        let time = f64::from(frame) / 8.0;
        let options = format!("{weather} --time {time} --threads {threads}");
        let alone = read_png(&workshop.render(&scene, &view, "alone.png", &options));
        assert!(alone == read_png(&folder.join(format!("{frame:05}.png"))), "frame {frame}");
    }
}

/// White drops before a black board: which way their streaks lie. How long they are `measure` tells (tests/measure.rs).
#[test]
fn speed_ahead_streaks_away_from_where_it_goes() {
    let workshop = Workshop::new();
    let (scene, view) = board(&workshop, "black", 60.0, [0.0; 3]);
    // How much longer differences go along the rows and columns in a picture's left part.
    let slant = |options: &str| {
        let options = format!(
            "--set rain.rate=60 --set rain.exposure=0.004 --set rain.airlight=#000000 --set rain.color=#ffffff {options}"
        );
        let picture = read_exr(&workshop.render(&scene, &view, "s.exr", &options));
        // The structure tensor: gradients stand across streaks.
        let (mut xx, mut yy, mut xy) = (0.0, 0.0, 0.0);
        for y in 110..210 {
            for x in 5..100 {
                let dx = picture.at(x + 1, y)[1] - picture.at(x - 1, y)[1];
                let dy = picture.at(x, y + 1)[1] - picture.at(x, y - 1)[1];
                (xx, yy, xy) = (xx + dx * dx, yy + dy * dy, xy + dx * dy);
            }
        }
        assert!(xx + yy > 1e-3, "nothing falls: {xx} {yy}");
        // Angle of the streaks from upright, degrees, towards the right at their lower end.
        (0.5 * f64::atan2(2.0 * xy, xx - yy)).to_degrees()
    };
    let still = slant("");
    assert!(still.abs() < 3.0, "upright: {still}");
    // Wind across as fast as most of the water falls: 45 degrees by the drops' own speeds of 2 to 9 m/s.
    let windy = slant("--set wind.speed=6 --set wind.direction=0 --set wind.gusts=0");
    assert!((30.0..60.0).contains(&windy.abs()), "in the wind: {windy}");
    // 50 km/h ahead: at the left border they lie flatter, away from the middle.
    let fast = slant("--camera-speed 13.9");
    assert!(fast.abs() > 25.0, "at 50 km/h: {fast}");
}
