//! The condition of a clip, such as rain or fog, from its weather.

use super::weathers::{PlannedWeather, value_of};
use crate::Condition;
use wm_scene::metadata::MOR_DEPTH;
use wm_weather::ParamValue;

/// Air is clear above this visibility, m.
const CLEAR_VISIBILITY_M: f64 = 2000.0;
/// Rain and snowfall below this rate do not count, mm/h of water.
const MIN_RATE_MM_H: f64 = 0.05;
/// Lying snow below this depth does not count, m.
const MIN_SNOW_DEPTH_M: f64 = 0.005;

/// The condition that prevails in a weather when its clip begins.
pub(super) fn condition_of(planned: &PlannedWeather) -> Condition {
    let sample = planned.weather.at(planned.at);
    let number = |key: &str| value_of(&planned.weather, key, planned.at);
    let lies = match sample.track("snow_cover", "depth").map(|track| track.at(planned.at)) {
        Some(ParamValue::Number(depth)) => depth > MIN_SNOW_DEPTH_M,
        Some(_) => true,
        None => false,
    };
    if number("snowfall.rate").is_some_and(|rate| rate > MIN_RATE_MM_H) || lies {
        Condition::Snow
    } else if number("rain.rate").is_some_and(|rate| rate > MIN_RATE_MM_H) {
        Condition::Rain
    } else if number("dust_cover.depth").is_some() && number("smog.mor").is_some() {
        Condition::Dust
    } else if visibility_of(planned) < CLEAR_VISIBILITY_M {
        Condition::Fog
    } else if is_night(planned) {
        Condition::Night
    } else {
        Condition::Clear
    }
}

/// The visibility by fog, haze and smog, and by the extinction of what falls, m.
pub(super) fn visibility_of(planned: &PlannedWeather) -> f64 {
    let number = |key: &str| value_of(&planned.weather, key, planned.at);
    let air =
        ["fog.mor", "haze.mor", "smog.mor"].iter().filter_map(|key| number(key)).map(|mor| MOR_DEPTH / mor);
    let falling = planned.weather.effects().filter_map(|(effect, _)| {
        let kind = effect.precipitation?;
        Some(kind.sigma_t(&kind.classes(), number(&format!("{}.rate", effect.name))?))
    });
    let sigma = air.chain(falling).fold(0.0, |sum, own| sum + own);
    if sigma > 0.0 { MOR_DEPTH / sigma } else { f64::INFINITY }
}

/// Returns true if a clip begins at night: by the model of the light, or by a sun 6 degrees or
/// more below the horizon.
pub(super) fn is_night(planned: &PlannedWeather) -> bool {
    let sample = planned.weather.at(planned.at);
    let model = sample.track("light", "model").map(|track| track.at(planned.at));
    let is_below =
        value_of(&planned.weather, "light.sun_elevation", planned.at).is_some_and(|angle| angle < -6.0);
    model == Some(ParamValue::Word("night")) || is_below
}
