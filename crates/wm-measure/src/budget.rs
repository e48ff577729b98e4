//! Mass budget: the snow that lies is the snow that fell, less what has melted.
//!
//! A yard of 12 m with a ridge of 50 degrees that snow slides off, seen from 150 m above, so that
//! all rays are upright. It is seen under half of the snow and under all of it. The volume between
//! the two surfaces is the sum over pixels of what they lose in view z times the ground that a
//! pixel covers; by the density it is water, to be held against what rate and hours bring in
//! between. (Not against bare ground: on a slope the depth of a pixel is that of the uppermost of
//! the splats that overlap there, which snow of any depth raises by some cm.) What melts, 4 mm a
//! degree and day, does so on a level yard, against bare ground: beside a ridge shade slows it.
//!
//! Tolerance: 1 % of what fell.

use super::stake::{level_card, median_depth};
use super::{Bench, Instrument, LevelFrame, Tolerance, clear, expected, fov_of};
use wm_place::Result;
use wm_scene::Splats;
use wm_weather::Weather;

/// The instrument.
pub(crate) const INSTRUMENT: Instrument = Instrument {
    name: "budget",
    title: "Mass budget",
    about: "A yard with a steep ridge that snow slides off, seen from far above under half of the snow and under all of it: what the depth \
            maps differ by, summed over the picture, is a volume, and its water is held against what rate and hours have brought in between. \
            Where it thaws: a level yard without snow and with it, and 4 mm a degree and day less. Density 300 kg/m\u{b3}, to which snow settles, so that volume is water. Without wind.",
    applies: |weather, time| fallen(weather, time).is_some_and(|fallen| fallen.fell > 0.0),
    measure,
    sweep: &[
        "snowfall.rate=1, snow_cover.depth=auto, snow_cover.hours=96",
        "snowfall.rate=2, snow_cover.depth=auto, snow_cover.hours=40",
        "snowfall.rate=3, snow_cover.depth=auto, snow_cover.hours=40",
        "snowfall.rate=5, snow_cover.depth=auto, snow_cover.hours=30",
        "snow_cover.depth=0.3",
        "snowfall.rate=4, snow_cover.depth=auto, snow_cover.hours=15, snow_cover.temperature=3",
    ],
};

/// Density that snow settles towards, kg/m^3, and what melts, mm a degree and hour.
const SETTLED_DENSITY_KG_M3: f64 = 300.0;
const MELT_MM_PER_DEGREE_HOUR: f64 = 4.0 / 24.0;

/// Water on level ground, mm.
pub(super) struct SnowWater {
    pub(crate) fell: f64,
    pub(crate) melted: f64,
}

/// The snow that has fallen and melted until a time, by the parameters: the hours at one rate, and
/// what the shot's own seconds have added.
pub(super) fn fallen(weather: &Weather, time: f64) -> Option<SnowWater> {
    if !expected::is_on(weather, "snow_cover") {
        return None;
    }
    let at = |effect: &str, param: &str, time: f64| expected::number(weather, time, effect, param);
    if let Some(depth) = at("snow_cover", "depth", time) {
        let is_cold = at("snow_cover", "temperature", time).is_some_and(|temperature| temperature <= 0.0);
        return is_cold.then_some(SnowWater { fell: depth * SETTLED_DENSITY_KG_M3, melted: 0.0 });
    }
    let (hours, lapse) = (at("snow_cover", "hours", 0.0)?, at("snow_cover", "lapse", 0.0)?);
    let mut stock = SnowWater { fell: 0.0, melted: 0.0 };
    let mut pass = |time: f64, hours: f64| {
        let rate = at("snowfall", "rate", time).unwrap_or(0.0);
        let warmth = at("snow_cover", "temperature", time).unwrap_or(0.0).max(0.0);
        stock.fell += rate * hours;
        stock.melted = (stock.melted + MELT_MM_PER_DEGREE_HOUR * warmth * hours).min(stock.fell);
    };
    const TIME_STEPS: u32 = 4096;
    (0..TIME_STEPS).for_each(|_| pass(0.0, hours / f64::from(TIME_STEPS)));
    let part = time.max(0.0) / f64::from(TIME_STEPS);
    (0..TIME_STEPS).for_each(|k| pass((f64::from(k) + 0.5) * part, part * lapse / 3600.0));
    Some(stock)
}

/// Returns the weather with half of the snow, and the water of that, mm.
fn half(weather: &Weather, time: f64) -> Result<(Weather, f64)> {
    let mut half = weather.clone();
    for param in ["depth", "hours"] {
        if let Some(value) = expected::number(weather, time, "snow_cover", param) {
            half.set_text(&format!("snow_cover.{param}={}", 0.5 * value))?;
        }
    }
    let stock = fallen(&half, time).map_or(0.0, |fallen| fallen.fell);
    Ok((half, stock))
}

/// Half the side of the yard and of what is looked at, m, and from how high.
const YARD_HALF_SIDE_M: f64 = 6.0;
const WINDOW_HALF_SIDE_M: f64 = 5.0;
const EYE_HEIGHT_M: f64 = 150.0;
/// Height of the ridge, m, and its slope, degrees.
const RIDGE_HEIGHT_M: f64 = 1.2;
const RIDGE_SLOPE_DEGREES: f64 = 50.0;

/// The yard: level, or with a steep ridge across it.
fn yard(level: &LevelFrame, is_level: bool) -> Splats {
    let mut splats = Splats::default();
    let mut card =
        |center: [f64; 3], u: [f64; 3], v: [f64; 3]| level_card(level, center, [u, v], &mut splats);
    card([0.0; 3], [YARD_HALF_SIDE_M, 0.0, 0.0], [0.0, YARD_HALF_SIDE_M, 0.0]);
    if is_level {
        return splats;
    }
    let run = RIDGE_HEIGHT_M / RIDGE_SLOPE_DEGREES.to_radians().tan();
    for side in [-1.0, 1.0] {
        card(
            [0.5 * side * run, 0.0, 0.5 * RIDGE_HEIGHT_M],
            [-0.5 * side * run, 0.0, 0.5 * RIDGE_HEIGHT_M],
            [0.0, YARD_HALF_SIDE_M, 0.0],
        );
    }
    splats
}

fn measure(bench: &mut Bench<'_>) -> Result<()> {
    let Some(SnowWater { fell, melted }) = fallen(bench.weather, bench.time) else {
        return Ok(());
    };
    let level = bench.level;
    let subject = bench.rig.set_up(yard(&level, melted > 0.0))?;
    let weather = bench.with("wind=off, fog=off, haze=off, smog=off, rain=off, snow_cover.density=300")?;
    let (before, stock) = if melted > 0.0 { (clear(), 0.0) } else { half(&weather, bench.time)? };
    let fov = fov_of(WINDOW_HALF_SIDE_M / EYE_HEIGHT_M);
    let camera = level.camera((400, 400), fov, [0.0, 0.0, EYE_HEIGHT_M], [0.0; 3])?;
    let mut depths = |weather: &Weather| median_depth(bench, subject, &camera, weather);
    let (less, more) = (depths(&before)?, depths(&weather)?);
    let (mut volume, mut area) = (0.0, 0.0);
    for (less, more) in less.iter().zip(&more) {
        let [less, more] = [*less, *more].map(|z| level.metres(f64::from(z)));
        // The ground that a pixel covers, at the height of the snow's surface.
        let pixel = (more / camera.fx) * (more / camera.fy);
        volume += pixel * (less - more);
        area += pixel;
    }
    let came = fell - stock;
    bench.add(
        format!("water that came to lie, of {came:.0} mm that fell"),
        "mm",
        [came - melted, volume / area * SETTLED_DENSITY_KG_M3],
        Tolerance::Absolute(0.01 * came),
    );
    let camera = level.camera((480, 320), 45.0, [-8.0, -6.5, 4.5], [0.0, 0.0, 0.4])?;
    let what = if melted > 0.0 { "the level yard" } else { "the yard with its steep ridge" };
    let seen = bench.light(subject, &camera, &weather)?;
    bench.show(what, &seen.picture);
    Ok(())
}
