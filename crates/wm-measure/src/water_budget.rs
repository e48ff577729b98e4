//! Water budget: what came down is on the ground, or ran off, or has dried.
//!
//! A yard with a shallow bowl stands in the rain. The rain on it is the rate times the time times
//! the area; what is there is summed over the nodes of the state of water: pores, films, and the
//! depths of puddles, which are levels less the ground. Under snow that has melted the water that
//! comes is what degrees and hours melt of it.
//!
//! Tolerance 1 %. Systematic: the edge of a puddle ends between nodes.

use super::budget::fallen;
use super::lit::{level_square, overcast_card, paint_card};
use super::{Bench, Instrument, Tolerance, expected};
use wm_place::Result;
use wm_scene::Splats;
use wm_weather::Weather;

/// The instrument.
pub(crate) const INSTRUMENT: Instrument = Instrument {
    name: "water-budget",
    title: "Water budget",
    about: "A yard with a shallow bowl in the rain: the rain on it against rate, time and area; and the water in pores, in films and in the \
            puddle, as the levels over its nodes say, with what ran off and has dried, against the rain. Snow that melts on it is water in the same \
            way: 4 mm a degree and day.",
    applies: |weather, time| minutes(weather, time).is_some() || melt(weather, time) > 0.0,
    measure,
    sweep: &[
        "rain.rate=5, wetness.rained_before=30",
        "rain.rate=25, wetness.rained_before=10",
        "rain.rate=60, wetness.rained_before=10",
        "wetness.rate_before=20, wetness.rained_before=20, wetness.stopped=15",
        "snowfall.rate=2, snow_cover.depth=auto, snow_cover.hours=12, snow_cover.temperature=5, wetness.rained_before=0",
    ],
};

/// Half the side of the yard, m; the radius of its bowl and its depth, m; the sides of the tiles
/// that it is made of, m.
const YARD_HALF_SIDE_M: f64 = 3.2;
const BOWL_RADIUS_M: f64 = 2.6;
const BOWL_DEPTH_M: f64 = 0.02;
const TILE_SIDE_M: f64 = 0.2;
const ALBEDO: f64 = 0.2;

/// Returns true if the water of a weather is what has come.
fn is_by_water(weather: &Weather, time: f64) -> bool {
    let number = |param: &str| expected::number(weather, time, "wetness", param);
    expected::is_on(weather, "wetness") && number("amount").is_none() && number("puddles").is_none()
}

/// The snow that has melted on open ground, if the water goes by it, mm.
fn melt(weather: &Weather, time: f64) -> f64 {
    let melted = fallen(weather, time).map_or(0.0, |fallen| fallen.melted);
    if is_by_water(weather, time) { melted } else { 0.0 }
}

/// The rate of the rain, mm/h, and for how many minutes it had fallen at time 0, if this is what
/// the water goes by.
fn minutes(weather: &Weather, time: f64) -> Option<[f64; 2]> {
    let number = |param: &str| expected::number(weather, time, "wetness", param);
    let is_by_rain = is_by_water(weather, time) && number("lapse") == Some(1.0);
    let rate = number("rate_before").or_else(|| expected::number(weather, time, "rain", "rate"))?;
    (is_by_rain && rate > 0.0).then_some([rate, number("rained_before")?]).filter(|rain| rain[1] > 0.0)
}

fn measure(bench: &mut Bench<'_>) -> Result<()> {
    let melted = melt(bench.weather, bench.time);
    let [rate, before] = minutes(bench.weather, bench.time).unwrap_or_default();
    let level = bench.level;
    let mut splats = Splats::default();
    let tiles = (YARD_HALF_SIDE_M / TILE_SIDE_M).round() as i32;
    for row in -tiles..tiles {
        for column in -tiles..tiles {
            let [x, y] = [column, row].map(|k| (f64::from(k) + 0.5) * TILE_SIDE_M);
            let inside = (1.0 - (x * x + y * y) / (BOWL_RADIUS_M * BOWL_RADIUS_M)).max(0.0);
            let halves = level_square(0.5 * TILE_SIDE_M);
            let center = [x, y, -BOWL_DEPTH_M * inside];
            paint_card(&level, center, halves, 0.5 * TILE_SIDE_M, overcast_card(ALBEDO, 0.0), &mut splats);
        }
    }
    let subject = bench.set_up_lit(splats)?;
    let weather = bench.with("light=off, wind=off, fog=off, haze=off, smog=off, look=off")?;
    let Some(state) = bench.rig.water(subject, &weather, bench.time)? else { return Ok(()) };
    let texture = bench.number("wetness", "texture").unwrap_or(f64::NAN);
    let nodes = state.ground.iter().filter(|height| height.is_finite()).count() as f64;
    let now = bench.number("rain", "rate").unwrap_or(0.0);
    let area = nodes * state.step * state.step;
    let rain = 1e-3 * area * (rate * before / 60.0 + now * bench.time / 3600.0);
    let melt = 1e-3 * area * melted;
    let stands = state.water_in_puddles();
    let there = state.water_in_pores() + state.water_in_films(texture) + stands;
    let what = if melt > 0.0 { "rain and melt water on the ground" } else { "rain on the ground" };
    bench.add(what, "m^3", [rain + melt, state.budget.came], Tolerance::Relative(0.01));
    let gone = state.budget.left + state.budget.dried;
    bench.add("water in and out", "m^3", [state.budget.came, there + gone], Tolerance::Relative(0.01));
    bench.add("water in the puddle", "m^3", [state.budget.in_puddles, stands], Tolerance::None);
    Ok(())
}
