//! Lux meter: boards under a sky, against the sky that is seen.
//!
//! White boards on open ground, level and upright. A board's light is its reflectance times the
//! irradiance `E`, and the sky's radiance `L` is shown as `pi L`: both are in one unit. Under full
//! clouds the CIE's overcast sky gives an upright board 0.396 of `E` on the level, and the zenith
//! has `9 / (7 pi)` of it (Moon and Spencer 1942); the ground returns a quarter, of which an
//! upright board sees a half. Under a sun the sky is summed over its own pixels, five cameras for
//! all of it, and held against a level board in the shade of a small disc far away, as radiation is
//! measured with a shadow ball; what the sun adds to a level board and to an upright one that faces
//! it must be as the sine and the cosine of its elevation.
//!
//! Tolerance 3 %. Systematic: a disc hides 0.2 % of the sky's light; directions to the sky are few
//! (the light of a sky that is seen from a board is summed over 32).

use super::lit::{OPEN_SKY, OVERCAST_UPRIGHT, level_square, overcast_card, paint_card};
use super::plot::Series;
use super::{Bench, Instrument, LevelFrame, ShotSubject, Tolerance, expected, lit};
use std::f64::consts::PI;
use wm_base::color::luminance;
use wm_place::Result;
use wm_scene::Splats;
use wm_weather::Weather;

/// The instrument.
pub(crate) const INSTRUMENT: Instrument = Instrument {
    name: "lux",
    title: "Lux meter",
    about: "White boards on open ground. Under full clouds: the light of an upright board and of the zenith over that of a level \
            board, against the CIE's overcast sky. Under a sun: a level board in the shade of a small disc against the sum of the sky's pixels, and \
            what the sun adds to level and upright boards against its elevation.",
    applies: |weather, time| sky(weather, time).is_some(),
    measure,
    sweep: &[
        "light.model=clear, light.clouds=1",
        "light.model=clear, light.sun_elevation=60, light.sun_azimuth=200",
        "light.model=clear, light.sun_elevation=35, light.sun_azimuth=140",
        "light.model=clear, light.sun_elevation=15, light.sun_azimuth=250, light.turbidity=4",
        "light.model=clear, light.sun_elevation=40, light.clouds=0.4",
    ],
};

/// The sky over the boards.
#[derive(Clone, Copy, PartialEq)]
enum BoardSky {
    Overcast,
    /// Elevation and azimuth of the sun, radians.
    Sunny([f64; 2]),
}

/// Level illuminance by the sun over that by the sky on a clear day, by the sun's elevation,
/// radians: by the formulas of the Illuminating Engineering Society, straight between these
/// elevations.
fn day(elevation: f64) -> f64 {
    const SUN_TO_SKY_RATIOS: [[f64; 2]; 5] =
        [[10.0, 0.9], [20.0, 2.4], [30.0, 3.6], [45.0, 4.8], [60.0, 5.7]];
    let degrees = elevation.to_degrees();
    let pair =
        SUN_TO_SKY_RATIOS.windows(2).find(|pair| degrees < pair[1][0]).unwrap_or(&SUN_TO_SKY_RATIOS[3..]);
    pair[0][1] + (pair[1][1] - pair[0][1]) * (degrees - pair[0][0]) / (pair[1][0] - pair[0][0])
}

/// The sky that a weather says by numbers, if it is one by day.
fn sky(weather: &Weather, time: f64) -> Option<BoardSky> {
    let number = |param: &str| expected::number(weather, time, "light", param);
    if !expected::says(weather, time, "light", "model", "clear") {
        return None;
    }
    if number("clouds") == Some(1.0) {
        return Some(BoardSky::Overcast);
    }
    let [elevation, azimuth] = ["sun_elevation", "sun_azimuth"].map(number);
    let is_by_hour = number("hour").is_some() && elevation.is_none();
    let sun = [elevation.unwrap_or(45.0), azimuth.unwrap_or(180.0)];
    (!is_by_hour && sun[0] > MIN_SUN_DEGREES).then(|| BoardSky::Sunny(sun.map(f64::to_radians)))
}

/// Lowest sun that boards are held under, degrees.
const MIN_SUN_DEGREES: f64 = 10.0;
/// Half the side of the ground, and of a board, m; the distance of splats.
const YARD_HALF_SIDE_M: f64 = 10.0;
const BOARD_HALF_SIDE_M: f64 = 0.6;
const SPLAT_SPACING_M: f64 = 0.1;
/// Depth of the block of which the upright board is the front, m.
const BLOCK_DEPTH_M: f64 = 0.6;
/// Reflectance of boards, so that they do not burn out beside a bright sky.
const BOARD_REFLECTANCE: f64 = 0.8;
/// Half the side of the disc, and its distance from what it shades, m: smaller things in the air
/// are taken for faults of a scene.
const DISC_HALF_SIDE_M: f64 = 1.1;
const DISC_DISTANCE_M: f64 = 30.0;
/// Exposures that leave room for the brightest of a sky, EV.
const EXPOSURE: [&str; 2] = ["light.exposure=-1", "light.exposure=-6"];
/// Side of the pictures of the sky, px.
const SKY_SIDE_PX: u32 = 180;
/// Height of boards' middles and of the level one, m.
const UPRIGHT_HEIGHT_M: f64 = 0.8;
const LEVEL_HEIGHT_M: f64 = 0.06;

/// The target: ground, a level and an upright board, and where they are in the shade of discs.
struct Boards {
    level: LevelFrame,
    subject: ShotSubject,
    /// Level, from the boards towards the sun.
    heading: [f64; 2],
}

impl Boards {
    fn new(bench: &mut Bench<'_>, sun: Option<[f64; 2]>) -> Result<Self> {
        let level = bench.level;
        let [elevation, azimuth] = sun.unwrap_or([0.5 * PI, 0.0]);
        // Azimuths turn clockwise seen from above, from the first axis.
        let heading = [azimuth.cos(), azimuth.sin() * -level.hand()];
        let mut splats = Splats::default();
        let mut card = |center: [f64; 3], halves: [[f64; 3]; 2], light: f64| {
            paint_card(&level, center, halves, SPLAT_SPACING_M, light, &mut splats);
        };
        card([0.0; 3], level_square(YARD_HALF_SIDE_M), overcast_card(lit::GROUND_REFLECTANCE, 0.0));
        let boards = Self { level, subject: ShotSubject::Place, heading };
        for shaded in [false, true] {
            let [flat, stood] = boards.middles(shaded);
            card(flat, level_square(BOARD_HALF_SIDE_M), overcast_card(BOARD_REFLECTANCE, 0.0));
            let across = [-heading[1] * BOARD_HALF_SIDE_M, heading[0] * BOARD_HALF_SIDE_M, 0.0];
            card(stood, [across, [0.0, 0.0, BOARD_HALF_SIDE_M]], overcast_card(BOARD_REFLECTANCE, 1.0));
            // The front of a block, since of a lone card nothing says which side is lit.
            let back =
                [stood[0] - BLOCK_DEPTH_M * heading[0], stood[1] - BLOCK_DEPTH_M * heading[1], stood[2]];
            card(back, [across, [0.0, 0.0, BOARD_HALF_SIDE_M]], overcast_card(lit::GROUND_REFLECTANCE, 1.0));
            if shaded && sun.is_some() {
                let (sin, cos) = elevation.sin_cos();
                let to_sun = [cos * heading[0], cos * heading[1], sin];
                let aside = [-heading[1] * DISC_HALF_SIDE_M, heading[0] * DISC_HALF_SIDE_M, 0.0];
                let upwards = [
                    -sin * heading[0] * DISC_HALF_SIDE_M,
                    -sin * heading[1] * DISC_HALF_SIDE_M,
                    cos * DISC_HALF_SIDE_M,
                ];
                for at in [flat, stood] {
                    let at: [f64; 3] = std::array::from_fn(|k| at[k] + DISC_DISTANCE_M * to_sun[k]);
                    card(at, [aside, upwards], overcast_card(lit::GROUND_REFLECTANCE, 0.0));
                }
            }
        }
        let subject = bench.set_up_lit(splats)?;
        Ok(Self { subject, ..boards })
    }

    /// The middles of the level and of the upright board, which are beside each other, across the
    /// sun's way.
    fn middles(&self, shaded: bool) -> [[f64; 3]; 2] {
        let aside = if shaded { [-4.5, -2.0] } else { [2.0, 4.5] };
        let [x, y] = self.heading;
        let at = |aside: f64, z: f64| [-y * aside, x * aside, z];
        [at(aside[0], LEVEL_HEIGHT_M), at(aside[1], UPRIGHT_HEIGHT_M)]
    }

    /// Irradiances of a level board and of an upright one that faces the sun, in the picture's
    /// unit.
    fn irradiances(&self, bench: &mut Bench<'_>, weather: &Weather, shaded: bool) -> Result<[f64; 2]> {
        let [flat, stood] = self.middles(shaded);
        let [x, y] = self.heading;
        let before = [stood[0] + 3.0 * x, stood[1] + 3.0 * y, stood[2]];
        let mut out = [0.0; 2];
        for (out, (eye, at)) in out.iter_mut().zip([([flat[0], flat[1], 3.0], flat), (before, stood)]) {
            let camera = self.level.camera((33, 33), 8.0, eye, at)?;
            let picture = bench.light(self.subject, &camera, weather)?;
            *out = picture.patch(16.5, 16.5, 6) / BOARD_REFLECTANCE;
        }
        Ok(out)
    }

    /// Irradiance of level ground by the sky's pixels, and the light of the zenith, times pi;
    /// `None` if it burns out.
    fn sky(&self, bench: &mut Bench<'_>, weather: &Weather) -> Result<Option<[f64; 2]>> {
        let eye = [0.0, 0.0, 60.0];
        let sides = [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]];
        let (mut sum, mut zenith, mut brightest) = (0.0, 0.0, 0.0f64);
        for side in sides {
            let target = std::array::from_fn(|k| eye[k] + side[k]);
            let camera = self.level.camera((SKY_SIDE_PX, SKY_SIDE_PX), 90.0, eye, target)?;
            let picture = bench.light(self.subject, &camera, weather)?;
            for y in 0..SKY_SIDE_PX as usize {
                for x in 0..SKY_SIDE_PX as usize {
                    let ray = camera.ray(x as f64 + 0.5, y as f64 + 0.5).normalize();
                    let sin = ray.dot(self.level.axes[2]);
                    if sin > 0.0 {
                        // A pixel at the angle `a` from the axis covers cos^3 a over the square of
                        // the focal length.
                        let angle = ray.dot(camera.forward()).powi(3) / (camera.fx * camera.fy);
                        sum += luminance(picture.rgb(x, y)) / PI * sin * angle;
                        brightest = brightest.max(picture.rgb(x, y).into_iter().fold(0.0, f64::max));
                    }
                }
            }
            if side[2] > 0.0 {
                zenith = picture.patch(0.5 * f64::from(SKY_SIDE_PX), 0.5 * f64::from(SKY_SIDE_PX), 2);
            }
        }
        Ok((brightest < 1.0).then_some([sum, zenith]))
    }
}

fn measure(bench: &mut Bench<'_>) -> Result<()> {
    let Some(sky) = sky(bench.weather, bench.time) else { return Ok(()) };
    let sun = match sky {
        BoardSky::Overcast => None,
        BoardSky::Sunny(sun) => Some(sun),
    };
    let boards = Boards::new(bench, sun)?;
    let exposed = |exposure: &str| bench.with_light(&format!("{OPEN_SKY}, {exposure}"));
    let (weather, darker) = (exposed(EXPOSURE[0])?, exposed(EXPOSURE[1])?);
    // Five steps of exposure are a factor of 32.
    let seen = boards.sky(bench, &darker)?.map(|sky| sky.map(|v| 32.0 * v));
    let [sum, zenith] = seen.unwrap_or([f64::NAN; 2]);
    let [flat, stood] = boards.irradiances(bench, &weather, false)?;
    let three = Tolerance::Relative(0.03);
    match sun {
        None => {
            bench.add(
                "upright board under clouds, over level board",
                "",
                [OVERCAST_UPRIGHT + 0.5 * lit::GROUND_REFLECTANCE, stood / flat],
                three,
            );
            bench.add(
                "light of the zenith over level board",
                "",
                [9.0 / (7.0 * PI), zenith / PI / flat],
                three,
            );
            bench.add("level board over the sum of the sky", "", [1.0, flat / sum], three);
        }
        Some([elevation, _]) => {
            let [shade, stood_shade] = boards.irradiances(bench, &weather, true)?;
            bench.add("level board in shade over the sum of the sky", "", [1.0, shade / sum], three);
            let ratio = (stood - stood_shade) / (flat - shade);
            bench.add("beam on upright board over level board", "", [1.0 / elevation.tan(), ratio], three);
            let is_cloudless = bench.number("light", "clouds").is_none();
            if is_cloudless {
                let ratio = (flat - shade) / shade;
                bench.add(
                    "sun over sky on the level, of a clear day",
                    "",
                    [day(elevation), ratio],
                    Tolerance::None,
                );
            }
        }
    }
    bench.plot(
        "Irradiances",
        "1: the sky's pixels, 2: level board, 3: upright board",
        "irradiance, of display white",
        vec![Series::points("irradiance", vec![[1.0, sum], [2.0, flat], [3.0, stood]])],
    );
    let [x, y] = boards.heading;
    let eye = [11.0 * x - 3.0 * y, 11.0 * y + 3.0 * x, 4.0];
    let camera = boards.level.camera((480, 320), 50.0, eye, [0.0, 0.0, 0.6])?;
    let shown = bench.light(boards.subject, &camera, &weather)?;
    bench.show("the boards, those to one side in the shade of discs", &shown.picture);
    Ok(())
}
