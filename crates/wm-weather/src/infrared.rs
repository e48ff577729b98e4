//! The air at the wavelengths of lidars.
//!
//! Extinction follows that of green light. Droplets of fog are larger than any of these
//! wavelengths: 1.02 times as much at 905 nm and 1.05 times at 1550 nm (Mie's theory over fogs of
//! droplets of some micrometres). Small particles go by their own Angstrom exponent: haze 0.52 and
//! 0.26, smog 0.61 and 0.36 times. Rain and snow take as much of any light.
//!
//! Backscatter is extinction over the lidar ratio: 18 sr of droplets (Mie's theory: 15 to 20 sr at
//! 905 nm, 18 to 28 sr at 1550 nm), 50 sr of small particles (guessed: 30 to 70 sr are measured of
//! hazes). Rain and snow add none here: their particles are met one by one.

use crate::optics::{AirLayer, Atmosphere, Site, WAVELENGTHS_NM};
use crate::particles::Precipitation;

/// Extinction by droplets over that of green light, by the wavelength, nm.
const DROPLET_EXTINCTIONS: [[f64; 2]; 3] = [[550.0, 1.0], [905.0, 1.02], [1550.0, 1.05]];
/// Lidar ratios of droplets and of small particles, sr.
const LIDAR_RATIOS: [f64; 2] = [18.0, 50.0];
/// Angstrom exponent below which particles count as droplets.
const MAX_DROPLET_EXPONENT: f64 = 0.05;

/// The air for light of one wavelength of the near infrared.
#[derive(Clone, Debug, PartialEq)]
pub struct InfraredAir {
    /// Channels: the extinction of everything, and pi times the backscatter a sr of what floats,
    /// both 1/m.
    air: Atmosphere,
    floats: bool,
}

impl InfraredAir {
    /// The air with the layers that float and those of what falls, over a site; see
    /// [`crate::PreparedWeather::infrared_air`].
    pub(crate) fn new(
        floating: &[AirLayer],
        falling: &[Precipitation],
        wavelength: f64,
        lidar_ratio: Option<f64>,
        site: &Site,
    ) -> Self {
        let float = |layer: &AirLayer| {
            let angstrom = angstrom(layer);
            let (factor, ratio) = if angstrom.abs() < MAX_DROPLET_EXPONENT {
                (droplets(wavelength), LIDAR_RATIOS[0])
            } else {
                ((wavelength / WAVELENGTHS_NM[1]).powf(-angstrom), LIDAR_RATIOS[1])
            };
            let sigma = factor * layer.sigma_t[1];
            let scatter = std::f64::consts::PI * sigma / lidar_ratio.unwrap_or(ratio);
            AirLayer { sigma_t: [sigma, scatter, 0.0], ..*layer }
        };
        let fall = |kind: &Precipitation| {
            let layer = kind.layer();
            AirLayer { sigma_t: [layer.sigma_t[1], 0.0, 0.0], ..layer }
        };
        let layers = floating.iter().map(float).chain(falling.iter().map(fall)).collect();
        let air = Atmosphere::new(layers, *site);
        let floats = floating.iter().any(|layer| layer.sigma_t[1] > 0.0);
        Self { air, floats }
    }

    /// The share of light that comes through `distance` (scene units) along a unit direction from
    /// `origin` (world axes, scene units), 0-1, one way.
    #[must_use]
    pub fn transmittance(&self, origin: [f64; 3], direction: [f64; 3], distance: f64) -> f64 {
        (-self.air.layers_depth(origin, direction, distance, 0)).exp()
    }

    /// Returns true if nothing floats that scatters light back.
    #[must_use]
    pub fn is_dark(&self) -> bool {
        !self.floats
    }

    /// The reflectance of a metre of the air at a point (world axes, scene units), 1/m: pi times
    /// its backscatter a sr, which a surface across the beam would have as its own.
    #[must_use]
    pub fn reflectance_at(&self, point: [f64; 3]) -> f64 {
        self.air.extinction_at(point)[1]
    }
}

/// The Angstrom exponent of a layer, between blue and red.
fn angstrom(layer: &AirLayer) -> f64 {
    let [red, _, blue] = layer.sigma_t;
    (blue / red).ln() / (WAVELENGTHS_NM[0] / WAVELENGTHS_NM[2]).ln()
}

/// Extinction by droplets over that of green light.
fn droplets(wavelength: f64) -> f64 {
    let pair = if wavelength < DROPLET_EXTINCTIONS[1][0] { 0 } else { 1 };
    let [[from, low], [to, high]] = [DROPLET_EXTINCTIONS[pair], DROPLET_EXTINCTIONS[pair + 1]];
    low + (high - low) * ((wavelength - from) / (to - from)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use crate::{Site, Weather};

    /// The factors of Mie's theory, and of the exponents 1.3 and 1.
    #[test]
    fn extinction_has_the_factors_of_each_kind_of_air() {
        for (name, near, far) in [("fog", 1.02, 1.05), ("haze", 0.523, 0.260), ("smog", 0.61, 0.36)] {
            let weather = Weather::clear().set(&format!("{name}.mor"), 300.0).unwrap();
            let prepared = weather.at(0.0).prepare(&Site::PLAIN);
            for (wavelength, factor) in [(905.0, near), (1550.0, far)] {
                let air = prepared.infrared_air(wavelength, None);
                let left = air.transmittance([0.0, 0.0, 1.0], [1.0, 0.0, 0.0], 100.0);
                let asked = factor * 100.0 * 20f64.ln() / 300.0;
                // The factors are rounded to two digits.
                assert!((-left.ln() / asked - 1.0).abs() < 0.02, "{name} {wavelength}: {left}");
            }
        }
    }

    #[test]
    fn rain_dims_and_scatters_nothing_back_as_air() {
        let weather = Weather::clear().set("rain.rate", 25.0).unwrap();
        let prepared = weather.at(0.0).prepare(&Site::PLAIN);
        let air = prepared.infrared_air(905.0, None);
        assert!(air.is_dark() && air.reflectance_at([0.0; 3]) == 0.0);
        let left = air.transmittance([0.0; 3], [1.0, 0.0, 0.0], 100.0);
        assert!((-left.ln() / (0.0365 * 25f64.powf(0.63)) - 1.0).abs() < 1e-6);
    }
}
