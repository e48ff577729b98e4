//! Extinction of what falls, both ways, by the program's own laws.

use wm_weather::Effect;
use wm_weather::optics::sigma_of_mor;
use wm_weather::particles::PrecipitationKind;

/// Extinction a metre of what an effect lets fall at a rate, mm/h.
pub(crate) fn extinction(effect: &str, rate: f64) -> f64 {
    match precipitation(effect) {
        Some(kind) if rate > 0.0 => kind.sigma_t(&kind.classes(), rate),
        _ => 0.0,
    }
}

fn precipitation(effect: &str) -> Option<&'static PrecipitationKind> {
    Effect::named(effect)?.precipitation
}

/// The rate of snow within `range`, mm/h of water, whose extinction is `sigma`, 1/m.
pub(crate) fn snow_rate(sigma: f64, range: [f64; 2]) -> f64 {
    let [mut low, mut high] = range;
    let Some(kind) = precipitation("snowfall") else { return low };
    let classes = kind.classes();
    // Extinction rises with the rate; 40 halvings are more than the digits that are written.
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if kind.sigma_t(&classes, middle) < sigma {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

/// The visibility, m, of an extinction a metre; infinite for none.
pub(crate) fn visibility(sigma: f64) -> f64 {
    sigma_of_mor(sigma)
}

/// Relative humidity, 0-1, of air at a temperature with a dew point, degrees Celsius: Magnus'
/// formula over water (Sonntag 1990).
pub(crate) fn humidity(temperature: f64, dew_point: f64) -> f64 {
    let vapour = |t: f64| (17.62 * t / (243.12 + t)).exp();
    (vapour(dew_point) / vapour(temperature)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_of_snow_comes_back_from_its_extinction() {
        for rate in [0.15, 1.0, 4.0] {
            let back = snow_rate(extinction("snowfall", rate), [0.1, 8.0]);
            assert!((back / rate - 1.0).abs() < 1e-6, "{rate}: {back}");
        }
        assert!((snow_rate(1.0, [0.1, 1.0]) - 1.0).abs() < 1e-6, "clamped by the intensity");
        assert_eq!(extinction("rain", 0.0), 0.0);
    }

    #[test]
    fn saturated_air_is_at_its_dew_point() {
        assert_eq!(humidity(3.0, 3.0), 1.0);
        // 20 degrees and a dew point of 9.3: half (tables of the WMO).
        assert!((humidity(20.0, 9.26) - 0.5).abs() < 0.005);
    }
}
