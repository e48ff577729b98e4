//! Snow stake: how deep snow lies in the open, on a roof, and under it.
//!
//! A yard of 12 m with a roof of 3 m at 2.5 m over a part of it. A camera looks straight down; what
//! the view z of a surface loses when snow lies on it is the depth. Without wind: it carries snow
//! under roofs, as it should.
//!
//! Tolerance 3 % of the depth, and 3 mm under the roof. The surface is uneven by 4 mm, of which a
//! mean over some square metres keeps nothing, but what is nearest is seen first: some 1 mm. Below
//! 5 cm snow is drawn higher than it is, by up to 7 mm, so as to hide the ground; that is above the
//! tolerance, and such depths are not swept.

use super::lit::level_square;
use super::{Bench, Instrument, LevelFrame, ShotSubject, Tolerance, clear, expected};
use super::{SURFACES, mean};
use wm_place::Result;
use wm_scene::card::Card;
use wm_scene::{Camera, Splats};
use wm_weather::Weather;

/// The instrument.
pub(crate) const INSTRUMENT: Instrument = Instrument {
    name: "stake",
    title: "Snow stake",
    about: "A yard with a roof over a part of it, seen from straight above with and without the snow: what the depth maps differ by is \
            how deep it lies - in the open, on the roof, and under it, where none may lie. Without wind, which carries snow under \
            roofs.",
    applies: |weather, time| depth(weather, time).is_some(),
    measure,
    sweep: &[
        "snow_cover.depth=0.05",
        "snow_cover.depth=0.1",
        "snow_cover.depth=0.2",
        "snow_cover.depth=0.3",
        "snow_cover.depth=0.5",
    ],
};

/// The depth of the snow, m, if it is given as a number and nothing melts.
fn depth(weather: &Weather, time: f64) -> Option<f64> {
    let number = |param: &str| expected::number(weather, time, "snow_cover", param);
    let is_cold = number("temperature").is_some_and(|temperature| temperature <= 0.0);
    number("depth").filter(|depth| *depth > 0.0 && is_cold)
}

/// Half the side of the yard, and of the roof, m; the middle and the height of the roof.
const YARD_HALF_SIDE_M: f64 = 6.0;
const ROOF_HALF_SIDE_M: f64 = 1.5;
const ROOF_CENTER_M: [f64; 3] = [2.5, 0.0, 2.5];
/// Distance of splats on them, m.
const SPLAT_SPACING_M: f64 = 0.08;
/// Grey of all surfaces, sRGB.
pub(crate) const GREY: [f32; 3] = [0.4; 3];

/// A level card about a point, level coordinates, painted.
pub(crate) fn level_card(level: &LevelFrame, center: [f64; 3], halves: [[f64; 3]; 2], splats: &mut Splats) {
    let [u, v] = halves.map(|half| level.vector(half) / level.metres(1.0));
    let cells =
        |half: glam::DVec3| ((2.0 * level.metres(half.length()) / SPLAT_SPACING_M).round() as usize).max(1);
    Card { center: level.point(center), u, v }.paint(splats, (cells(u), cells(v)), GREY);
}

/// Mean view z over the middle of a depth map, m.
fn middle_depth(level: &LevelFrame, camera: &Camera, depth: &[f32]) -> f64 {
    let (width, height) = (camera.width as usize, camera.height as usize);
    let rows = height / 4..3 * height / 4;
    let pixels = rows.flat_map(|y| (width / 4..3 * width / 4).map(move |x| y * width + x));
    level.metres(mean(pixels.map(|at| f64::from(depth[at]))))
}

fn measure(bench: &mut Bench<'_>) -> Result<()> {
    let level = bench.level;
    let mut yard = Splats::default();
    level_card(&level, [0.0; 3], level_square(YARD_HALF_SIDE_M), &mut yard);
    level_card(&level, ROOF_CENTER_M, level_square(ROOF_HALF_SIDE_M), &mut yard);
    let subject = bench.rig.set_up(yard)?;
    let weather = bench.with("wind=off, fog=off, haze=off, smog=off, snowfall=off, rain=off")?;
    let wanted = depth(bench.weather, bench.time).unwrap_or(0.0);
    let down = |eye: [f64; 3]| level.camera((160, 160), 20.0, eye, [eye[0], eye[1], 0.0]);
    for (name, eye, asked, tolerance) in [
        ("in the open", [-2.5, 0.0, 9.0], wanted, Tolerance::Relative(0.03)),
        ("on the roof", [ROOF_CENTER_M[0], ROOF_CENTER_M[1], 9.0], wanted, Tolerance::Relative(0.03)),
        ("under the roof", [ROOF_CENTER_M[0], ROOF_CENTER_M[1], 2.3], 0.0, Tolerance::Absolute(0.003)),
    ] {
        let camera = down(eye)?;
        let mut z = |weather| -> Result<_> {
            let depth = median_depth(bench, subject, &camera, weather)?;
            Ok(middle_depth(&level, &camera, &depth))
        };
        let measured = z(&clear())? - z(&weather)?;
        bench.add(format!("snow depth {name}"), "m", [asked, measured], tolerance);
    }
    let camera = level.camera((480, 320), 45.0, [-7.0, -9.0, 4.5], [0.6, 0.0, 0.8])?;
    let seen = bench.light(subject, &camera, &weather)?;
    bench.show("the yard, with its roof", &seen.picture);
    Ok(())
}

/// The median depth of every pixel of a target.
pub(crate) fn median_depth(
    bench: &mut Bench<'_>,
    subject: ShotSubject,
    camera: &Camera,
    weather: &Weather,
) -> Result<Vec<f32>> {
    Ok(bench.draw(subject, camera, weather, SURFACES)?.frame.median_depth)
}
