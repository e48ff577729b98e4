//! The request for wet surfaces.

use super::column::WetStep;

/// A request for wet surfaces: the rain so far, or a wetness by hand.
#[derive(Clone, Debug, PartialEq)]
pub struct WetRequest {
    /// Rain and drying until the instant.
    pub(crate) steps: Vec<WetStep>,
    /// Wetness that is requested, 0-1, in the place of what the steps give: pores are full at a
    /// half, and the texture at 1.
    pub(crate) amount: Option<f64>,
    /// Share of the volume of puddles that is filled, 0-1, in the place of what has come to them.
    pub(crate) puddles: Option<f64>,
    /// Factor on the darkening of surfaces, 0-1.
    pub porosity: f64,
    /// Mean depth of the texture of surfaces, mm.
    pub texture: f64,
    /// Share of the water of roofs that falls from their eaves, 0-1; gutters take the rest.
    pub eaves: f64,
    /// The rain.
    pub rain: SlantedRain,
}

/// The direction of the rain, the same at all times.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlantedRain {
    /// The direction of fall, world axes, length 1.
    pub fall: [f64; 3],
    /// The direction of the wind, world axes, times the rain on a wall that faces it over that on
    /// level ground.
    pub(crate) driving: [f64; 3],
}

impl WetRequest {
    /// Returns true if nothing is wet anywhere.
    pub(crate) fn is_nothing(&self) -> bool {
        let is_dry = match self.amount {
            Some(amount) => amount <= 0.0,
            None => !self.steps.iter().any(WetStep::is_wet),
        };
        is_dry && self.puddles.is_none_or(|share| share <= 0.0)
    }
}

/// Rain on a wall that faces the wind, m/s, over that on level ground, in a rain of `rate` mm/h:
/// `2/9 v R^(8/9)` mm/h (ISO 15927-3).
pub(crate) fn driving_rain(wind: f64, rate: f64) -> f64 {
    if rate > 0.0 { 2.0 / 9.0 * wind * rate.powf(-1.0 / 9.0) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn walls_get_the_driving_rain_of_the_standard() {
        assert!((10.0 * driving_rain(5.0, 10.0) - 8.6).abs() < 0.05);
        assert_eq!(driving_rain(5.0, 0.0), 0.0);
    }
}
