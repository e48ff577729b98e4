//! The slant of what falls in the mean wind.

use crate::level::{from_level, level_axes};

/// Quantization step of the slope of the fall: the tangent of 3 degrees.
const SLOPE_STEP: f64 = 0.052_4;

/// Largest slope by which wind slants the fall in maps of shelter.
const MAX_SLANT_SLOPE: f64 = 1.0;

/// The sideways drift by a wind, m/s along [`level_axes`], for each metre of fall at `speed`, m/s.
pub(super) fn slant(wind: [f64; 2], speed: f64) -> [f64; 2] {
    let [x, y] = wind;
    let eased = 1f64.min(MAX_SLANT_SLOPE * speed / x.hypot(y));
    [x, y].map(|v| v * eased / speed)
}

/// The direction, world axes, in which what falls at `speed` comes down in a mean wind, m/s: see
/// [`PreparedWeather::fall`](super::PreparedWeather::fall).
pub(crate) fn fall_of(wind: [f64; 2], speed: f64, up: [f64; 3]) -> [f64; 3] {
    let [x, y] = slant(wind, speed).map(|v| (v / SLOPE_STEP).round() * SLOPE_STEP);
    let way = [x, y, -1.0];
    let length = way.iter().map(|v| v * v).sum::<f64>().sqrt();
    from_level(&level_axes(up), way.map(|v| v / length))
}
