//! How fast wet ground dries.

/// Heat that evaporates water, J/kg, and the psychrometric constant, hPa/K.
const LATENT_HEAT_J_PER_KG: f64 = 2.45e6;
const PSYCHROMETRIC_CONSTANT: f64 = 0.66;

/// Vapour pressure of saturated air at a temperature in degrees Celsius, hPa (Magnus).
fn saturated(temperature: f64) -> f64 {
    6.112 * (17.62 * temperature / (243.12 + temperature)).exp()
}

/// Evaporation from wet ground, mm/h, 0 and more, by Penman (1948) with his function of the wind,
/// `0.26 (1 + 0.54 u)` mm a day and hPa. Takes the temperature of the air, degrees Celsius, its
/// relative humidity, 0-1, the wind, m/s, and the net radiation, W/m^2.
pub(crate) fn penman(temperature: f64, humidity: f64, wind: f64, radiation: f64) -> f64 {
    let pressure = saturated(temperature);
    let slope = pressure * 17.62 * 243.12 / (243.12 + temperature).powi(2);
    let by_radiation = radiation * 3600.0 / LATENT_HEAT_J_PER_KG;
    let by_air = 0.26 * (1.0 + 0.54 * wind) * pressure * (1.0 - humidity) / 24.0;
    ((slope * by_radiation + PSYCHROMETRIC_CONSTANT * by_air) / (slope + PSYCHROMETRIC_CONSTANT)).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Published rates of wet pavements: 0.46 mm/h on a bright overcast day in spring, 0.9 on a dry
    /// summer noon, none on a humid night.
    #[test]
    fn pavements_dry_at_the_published_rates() {
        let spring = penman(13.0, 0.55, 4.0, 370.0);
        let noon = penman(28.0, 0.3, 3.0, 620.0);
        let night = penman(10.0, 1.0, 1.0, -30.0);
        assert!((spring / 0.46 - 1.0).abs() < 0.1, "{spring}");
        assert!((noon / 0.9 - 1.0).abs() < 0.1, "{noon}");
        assert_eq!(night, 0.0);
        assert!(penman(15.0, 0.7, 4.0, 100.0) > penman(15.0, 0.7, 1.0, 100.0));
    }
}
