//! Rain and snow from outside: what they dim, how they streak, and that a frame knows no other.
//!
//! Boards stand in the whole picture, a black and a white one. What is left of their difference is
//! the transmittance of drops and air together, whatever light either adds. Tolerance: 3 % of the
//! optical depth; of depths below 0.05 also what chance does to the drops of one frame, taken over
//! several.

use crate::common::*;
use glam::DVec3;
use wm_base::npy;
use wm_base::statistics::median;
use wm_scene::{Camera, Metadata, Splats};

const SIZE: (u32, u32) = (480, 320);
const EYE: DVec3 = DVec3::new(0.0, 0.0, 2.0);

/// The camera that looks along y.
fn ahead() -> (Camera, ViewArgs) {
    look(SIZE, 50.0, EYE, EYE + DVec3::Y, DVec3::Z)
}

/// A scene that is one board across the whole picture.
fn board(distance: f64, rgb: [f32; 3]) -> Shot {
    let half = 1.2 * distance;
    let card = Card { center: EYE + DVec3::Y * distance, u: DVec3::X * half, v: DVec3::Z * half };
    let mut splats = Splats::with_capacity(0, 0);
    card.paint(&mut splats, (60, 60), rgb);
    let metadata = Metadata { airlight: Some([0.7; 3]), ..yard_metadata(1.0) };
    Shot::of("board", splats, &metadata, ahead().1)
}

/// Mean over the picture, linear light.
fn mean(picture: &Image<[f64; 3]>) -> f64 {
    picture.pixels.iter().map(|rgb| rgb[1]).sum::<f64>() / picture.pixels.len() as f64
}

#[test]
fn drops_and_air_dim_by_one_law_at_every_distance() {
    // Rain: 0.365 R^0.63 a km. Snow: as the program's own sum over flakes; 9.36 a km at 2.5 mm/h.
    for (effect, rate, law) in [("rain", 50.0, 0.365e-3 * 50f64.powf(0.63)), ("snowfall", 2.5, 9.36e-3)] {
        for (distance, times) in [(5.0, 12), (20.0, 4), (100.0, 1), (500.0, 1)] {
            let [white, black] = [[0.9; 3], BLACK].map(|rgb| board(distance, rgb));
            let contrast = |options: &str| mean(&white.exr(options)) - mean(&black.exr(options));
            let clear = contrast("");
            let kept = (0..times)
                .map(|time| contrast(&format!("--set {effect}.rate={rate} --time {}", 3 * time)))
                .map(|weathered| weathered / clear / f64::from(times))
                .sum::<f64>();
            // The mean way of a ray to the board is longer than its distance.
            let (camera, _) = ahead();
            let through = |(x, y): (u32, u32)| {
                let ray = camera.ray(f64::from(x) + 0.5, f64::from(y) + 0.5);
                (-law * distance / ray.y).exp()
            };
            let wanted = pixels(&camera).map(through).sum::<f64>() / f64::from(SIZE.0 * SIZE.1);
            let (found, wanted) = (-kept.ln(), -wanted.ln());
            println!("{effect} {rate} mm/h, {distance} m: optical depth {found:.4}, by the law {wanted:.4}");
            assert!((found / wanted - 1.0).abs() < 0.03, "{effect} {distance} m: {found} {wanted}");
        }
    }
}

/// Rain that grows, snow in it, and a wind that turns up and down.
const SLEET: &str = "[rain]\nrate = { keys = [[0, 5], [2, 60]] }\n[snowfall]\nrate = 2\n\
                     [wind]\nspeed = { keys = [[0, 1], [1, 6], [2, 3]] }\n";

#[test]
fn a_frame_of_rain_and_snow_is_the_same_alone_and_with_any_threads() {
    Shot::yard((96, 64)).check_frames_alone(SLEET);
}

/// White drops before a black board: which way their streaks lie. How long they are it does not
/// tell.
#[test]
fn speed_ahead_streaks_away_from_where_it_goes() {
    let board = board(60.0, BLACK);
    // How much longer differences go along the rows and columns in a picture's left part.
    let slant = |options: &str| {
        let options = format!(
            "--set rain.rate=60 --set rain.exposure=0.004 --set rain.airlight=#000000 --set rain.color=#ffffff {options}"
        );
        let picture = board.exr(&options);
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
    // Wind across as fast as most of the water falls: 45 degrees by the drops' own speeds of 2 to 9
    // m/s.
    let windy = slant("--set wind.speed=6 --set wind.direction=0 --set wind.gusts=0");
    assert!((30.0..60.0).contains(&windy.abs()), "in the wind: {windy}");
    // 50 km/h ahead: at the left border they lie flatter, away from the middle.
    let fast = slant("--camera-speed 13.9");
    assert!(fast.abs() > 25.0, "at 50 km/h: {fast}");
}

/// One streak in a picture: optical depths added up.
struct Streak {
    /// Sum of coverage, px.
    cover: f64,
    /// Centre, px.
    at: [f64; 2],
    /// Length of its motion, px.
    length: f64,
    /// Angle from upright, radians.
    angle: f64,
}

/// The streaks of a picture's coverage that touch neither each other nor the border.
fn streaks(coverage: &[f64], width: usize) -> Vec<Streak> {
    let tau: Vec<f64> = coverage.iter().map(|a| -(1.0 - a).ln()).collect();
    let mut seen = vec![false; tau.len()];
    let mut found = Vec::new();
    for first in 0..tau.len() {
        if seen[first] || tau[first] <= 0.0 {
            continue;
        }
        let (mut open, mut pixels, mut is_whole) = (vec![first], Vec::new(), true);
        seen[first] = true;
        while let Some(at) = open.pop() {
            pixels.push(at);
            let (x, y) = (at % width, at / width);
            if x == 0 || y == 0 || x + 1 == width || at + width >= tau.len() {
                is_whole = false;
                continue;
            }
            for near in (0..9).map(|k| at + k % 3 + k / 3 * width - width - 1) {
                if !seen[near] && tau[near] > 0.0 {
                    seen[near] = true;
                    open.push(near);
                }
            }
        }
        if !is_whole || pixels.len() < 12 {
            continue;
        }
        let sum = |of: &dyn Fn(f64, f64) -> f64| {
            let each = |at: &usize| tau[*at] * of((at % width) as f64 + 0.5, (at / width) as f64 + 0.5);
            pixels.iter().map(each).sum::<f64>()
        };
        let all = sum(&|_, _| 1.0);
        let at = [sum(&|x, _| x) / all, sum(&|_, y| y) / all];
        let xx = sum(&|x, _| (x - at[0]).powi(2)) / all;
        let yy = sum(&|_, y| (y - at[1]).powi(2)) / all;
        let xy = sum(&|x, y| (x - at[0]) * (y - at[1])) / all;
        // A way of length l has the variance l^2 / 12; across there is none of it.
        let spread = ((xx - yy).powi(2) + 4.0 * xy * xy).sqrt();
        let cover = pixels.iter().map(|at| coverage[*at]).sum();
        let angle = 0.5 * f64::atan2(2.0 * xy, yy - xx);
        found.push(Streak { cover, at, length: (12.0 * spread).sqrt(), angle });
    }
    found
}

/// Two pictures a shutter's time apart: the same drops, each where its streak ends in the first and
/// begins in the second. The wind across is known, and so from how far a drop went across how far
/// away it is, how fast it falls, and from its cover how large it is.
#[test]
fn streaks_are_as_long_as_drops_of_their_size_fall() {
    const EXPOSURE_S: f64 = 0.004;
    const WIND_SPEED_M_S: f64 = 4.0;
    // So that they stand out as far as they go: a streak ends where it covers less than 1/256.
    const OPACITY: f64 = 50.0;
    let (board, camera) = (board(60.0, BLACK), ahead().0);
    let picture = |time: f64| {
        let options = format!(
            "--time {time} --also particles.npy --set rain.rate=1 --set rain.exposure={EXPOSURE_S} \
             --set rain.opacity={OPACITY} --set wind.speed={WIND_SPEED_M_S} --set wind.direction=0 --set wind.gusts=0"
        );
        board.render("s.exr", &options);
        let (values, shape) = npy::read(&board.path("s.particles.npy")).unwrap();
        assert_eq!(shape, [SIZE.1 as usize, SIZE.0 as usize, 4]);
        let coverage: Vec<f64> = values.as_chunks::<4>().0.iter().map(|rgba| f64::from(rgba[3])).collect();
        streaks(&coverage, SIZE.0 as usize)
    };
    let (mut lengths, mut angles, mut speeds) = (Vec::new(), Vec::new(), Vec::new());
    for time in 0..6 {
        let time = f64::from(time);
        let (first, second) = (picture(time), picture(time + EXPOSURE_S));
        for streak in first.iter().filter(|streak| streak.length > 4.0) {
            // The next picture has one of the same cover where this one ends.
            let is_next = |other: &&Streak| {
                let [dx, dy] = [0, 1].map(|k| other.at[k] - streak.at[k]);
                let away =
                    (dx - streak.angle.sin() * streak.length).hypot(dy - streak.angle.cos() * streak.length);
                away < 0.25 * streak.length && (other.cover / streak.cover - 1.0).abs() < 0.05
            };
            let mut next = second.iter().filter(is_next);
            let (Some(other), None) = (next.next(), next.next()) else { continue };
            let [dx, dy] = [0, 1].map(|k| other.at[k] - streak.at[k]);
            let away = WIND_SPEED_M_S * EXPOSURE_S * camera.fx / dx.abs();
            // Away from the middle pixels are narrower angles.
            let ray = camera.ray(streak.at[0], streak.at[1]);
            let area = streak.cover / OPACITY * away * away / (camera.fx * camera.fy) * ray.y;
            let diameter = 1e3 * (area * 4.0 / std::f64::consts::PI).sqrt();
            // Those that are fading out where drawing ends look smaller than they are.
            if 1e-3 * diameter * camera.fx / away < 0.37 {
                continue;
            }
            lengths.push(streak.length / dx.hypot(dy));
            angles.push((streak.angle - f64::atan2(dx, dy)).to_degrees());
            let speed = dy * away / (camera.fy * EXPOSURE_S);
            println!("{diameter:.2} mm at {away:.2} m: {speed:.2} m/s");
            speeds.push(speed / gunn_kinzer(diameter));
        }
    }
    let count = lengths.len();
    let within = |values: &[f64], around: f64, off: f64| {
        values.iter().filter(|v| (**v - around).abs() < off).count() as f64 / values.len() as f64
    };
    let (all, near, right) =
        (within(&lengths, 1.0, 0.05), within(&angles, 0.0, 2.0), within(&speeds, 1.0, 0.05));
    let [length, angle, speed] = [lengths, angles, speeds].map(|mut values| median(&mut values).unwrap());
    println!(
        "{count} streaks: length {length:.4} ({all:.2} within 5 %), angle off {angle:.3} degrees ({near:.2} within 2), speed {speed:.4} ({right:.2} within 5 %)"
    );
    assert!(count > 50);
    assert!((length - 1.0).abs() < 0.05 && all > 0.9);
    assert!(angle.abs() < 1.0 && near > 0.9);
    assert!((speed - 1.0).abs() < 0.05 && right > 0.8);
}

/// Fall speed of drops, mm and m/s, as measured by Gunn and Kinzer (1949), straight between their
/// sizes.
fn gunn_kinzer(diameter: f64) -> f64 {
    const FALL_SPEEDS_MM_M_S: [[f64; 2]; 14] = [
        [0.4, 1.62],
        [0.6, 2.47],
        [0.8, 3.27],
        [1.0, 4.03],
        [1.2, 4.64],
        [1.4, 5.17],
        [1.6, 5.65],
        [1.8, 6.09],
        [2.0, 6.49],
        [2.4, 7.27],
        [2.8, 7.82],
        [3.2, 8.26],
        [4.0, 8.83],
        [5.8, 9.17],
    ];
    let pair =
        FALL_SPEEDS_MM_M_S.windows(2).find(|pair| diameter < pair[1][0]).unwrap_or(&FALL_SPEEDS_MM_M_S[12..]);
    pair[0][1] + (pair[1][1] - pair[0][1]) * (diameter - pair[0][0]) / (pair[1][0] - pair[0][0])
}
