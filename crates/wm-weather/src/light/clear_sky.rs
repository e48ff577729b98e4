//! Clear and hazy skies with the sun in them, by the model of Hosek and Wilkie (2012), and the
//! sun's beam.
//!
//! Radiance of a direction at zenith angle `t` and angle `g` to the sun, a channel:
//!
//! `L = R (1 + A e^(B / (cos t + 0.01))) (C + D e^(E g) + F cos^2 g + G X(H, g) + I cos^(1/2) t)`,
//! `X(H, g) = (1 + cos^2 g) / (1 + H^2 - 2 H cos g)^(3/2)`.
//!
//! The coefficients A to I and the factor R are quintic Bezier curves over the cube root of the
//! sun's elevation (as a share of 90 degrees), linear in turbidity between whole numbers and linear
//! in the ground's albedo. The model was fitted to path-traced skies. Turbidity is the ratio of all
//! vertical optical depth to that of pure air: 2 is very clear, 3 clear, 6 hazy, 10 very hazy.
//!
//! Unit of radiance: W/(m^2 sr), weighted by the CIE 1931 colour matching functions and given as
//! linear RGB with the primaries and the white of sRGB (ITU-R BT.709). 683 lm/W times its luminance
//! is cd/m^2. Irradiances are W/m^2 weighted alike; 683 lm/W times their luminance is lux.
//!
//! The fit is weakest with the sun below 3 degrees (values fall below 0 at the horizon and are cut
//! there), and above turbidity 7 (the light of the sky falls by up to 5 % where the sun comes close
//! to the zenith).

use crate::optics::WAVELENGTHS_NM;
use std::f64::consts::{FRAC_PI_2, PI};
use table::control_points;

mod table;

/// Highest turbidity of the published table; its rows begin at 1.
const MAX_TURBIDITY: f64 = 10.0;
/// Samples along each of elevation and azimuth of half the sky. The error of the irradiance is
/// below 0.4 %.
const SKY_SAMPLE_COUNT: u32 = 48;
/// Irradiance of the sun above the atmosphere, in the unit of the sky's irradiance: the solar
/// spectrum that the model's skies were path-traced with (Preetham 1999) under the CIE 1931 colour
/// matching functions. Its luminance is 129.9 klx; measured spectra have 133 klx (Darula, Kittler
/// and Gueymard 2005).
const EXTRATERRESTRIAL_IRRADIANCE: [f64; 3] = [201.8, 187.3, 183.7];

/// A clear or hazy sky with the sun above the horizon.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ClearSky {
    sun_elevation: f64,
    turbidity: f64,
    channels: [Channel; 3],
}

impl ClearSky {
    /// The sky for an elevation of the sun (radians, 0 to pi/2), a turbidity (1 to 10) and an
    /// albedo of the ground (0 to 1). Values outside the ranges are set to the nearest end; NaN
    /// counts as the lower end.
    pub(crate) fn new(sun_elevation: f64, turbidity: f64, ground_albedo: f64) -> Self {
        let sun_elevation = clamped(sun_elevation, 0.0, FRAC_PI_2);
        let turbidity = clamped(turbidity, 1.0, MAX_TURBIDITY);
        let albedo = clamped(ground_albedo, 0.0, 1.0);
        let control = bernstein((sun_elevation / FRAC_PI_2).cbrt());
        let channels = std::array::from_fn(|channel| Channel::new(channel, &control, turbidity, albedo));
        Self { sun_elevation, turbidity, channels }
    }

    /// Radiance of a direction, linear RGB in the unit of the module, without the solar disc;
    /// finite and at least 0. `sin_elevation` is the sine of the direction's elevation,
    /// `cos_to_sun` the cosine of its angle to the sun, both -1 to 1. A direction below the horizon
    /// has the radiance of the horizon above it.
    pub(crate) fn radiance(&self, sin_elevation: f64, cos_to_sun: f64) -> [f64; 3] {
        let sin = clamped(sin_elevation, -1.0, 1.0);
        let mut cos_to_sun = clamped(cos_to_sun, -1.0, 1.0);
        if sin < 0.0 {
            let (sin_sun, cos_sun) = self.sun_elevation.sin_cos();
            // The nadir is below all of the horizon: any point of it will do.
            let level = (1.0 - sin * sin).sqrt().max(1e-9);
            cos_to_sun = ((cos_to_sun - sin * sin_sun) / level).clamp(-cos_sun, cos_sun);
        }
        self.channels.each_ref().map(|channel| channel.radiance(sin.max(0.0), cos_to_sun))
    }

    /// Irradiance of a level surface by the sky alone, without the sun's beam, linear RGB in the
    /// unit of the module, and of an upright surface, the mean over all sides that it may face.
    pub(crate) fn level_and_upright_irradiance(&self) -> [[f64; 3]; 2] {
        let (sin_sun, cos_sun) = self.sun_elevation.sin_cos();
        let middle = |i: u32| (f64::from(i) + 0.5) / f64::from(SKY_SAMPLE_COUNT);
        let (mut level, mut upright) = ([0.0; 3], [0.0; 3]);
        for row in 0..SKY_SAMPLE_COUNT {
            // Bands of equal squared sine have equal irradiance under a uniform sky.
            let (sin, cos) = (middle(row).sqrt(), (1.0 - middle(row)).sqrt());
            for column in 0..SKY_SAMPLE_COUNT {
                // The other half is its mirror image.
                let azimuth = PI * middle(column);
                let light = self.radiance(sin, sin * sin_sun + cos * cos_sun * azimuth.cos());
                for k in 0..3 {
                    level[k] += light[k];
                    // A share of 1 / pi of the cosine that a wall facing the direction has.
                    upright[k] += light[k] * cos / (PI * sin);
                }
            }
        }
        [level, upright].map(|sum| sum.map(|v| v * PI / f64::from(SKY_SAMPLE_COUNT * SKY_SAMPLE_COUNT)))
    }

    /// Irradiance of a surface that faces the sun, by the beam alone, linear RGB in the unit of the
    /// sky's irradiance: the solar spectrum that the model was made with, times
    /// [`beam_transmittance`]. At the mean distance of the sun; over a year it varies by 3.4 %
    /// either way.
    ///
    /// Balance of sun and sky on level ground, luminance of beam over sky, ground albedo 0.2,
    /// against the clear sky of the IES's illuminances (0.9 / 2.4 / 3.6 / 4.8 / 5.7 with the sun 10
    /// / 20 / 30 / 45 / 60 degrees high):
    /// - turbidity 2: 0.90 / 2.23 / 3.37 / 4.80 / 5.87, within 8 %;
    /// - turbidity 2.5: 0.66 / 1.82 / 2.85 / 4.16 / 5.15, within a factor of 1.2 from 45 degrees up
    ///   and 1.4 from 10;
    /// - turbidity 3: 0.48 / 1.49 / 2.42 / 3.60 / 4.52, within a factor of 1.4 from 45 degrees up
    ///   and 1.9 from 10.
    ///
    /// The sky alone is within 17 % of the IES's 0.8 + 15.5 sin^0.5 h klx at turbidity 2, and
    /// within 30 % at 3. Nothing is scaled to fit.
    pub(crate) fn sun_irradiance(&self) -> [f64; 3] {
        let transmittance = beam_transmittance(self.sun_elevation, self.turbidity);
        std::array::from_fn(|k| EXTRATERRESTRIAL_IRRADIANCE[k] * transmittance[k])
    }
}

/// Share of the sun's light that reaches the ground unscattered, by channel, 0 to 1: 0 with the sun
/// below the horizon. Elevation of the sun in radians, up to pi/2; turbidity from 1 without an
/// upper limit. Values beyond are set to the nearest end; a turbidity of NaN counts as 1.
///
/// `exp(-0.008735 m l^-4.08) exp(-beta m l^-1.3)` at the wavelengths `l` (um) of
/// [`WAVELENGTHS_NM`], `beta = 0.046 (T - 1)`, with the relative air mass `m = 1 / (cos z + 0.15
/// (93.885 - z)^-1.253)`, `z` the zenith angle in degrees (Kasten 1965; Preetham 1999). Ozone,
/// water vapour and mixed gases are left out. Three wavelengths make the beam of a low sun less red
/// than the same formula over the whole spectrum does, at turbidity 3: red 4 / 7 / 12 % too low and
/// blue 9 / 20 / 49 % too high at 47 / 20 / 10 degrees, luminance within 0.3 %.
fn beam_transmittance(sun_elevation: f64, turbidity: f64) -> [f64; 3] {
    if sun_elevation.is_nan() || sun_elevation < 0.0 {
        return [0.0; 3];
    }
    let elevation = sun_elevation.min(FRAC_PI_2);
    let zenith = 90.0 - elevation.to_degrees();
    let mass = 1.0 / (elevation.sin() + 0.15 * (93.885 - zenith).powf(-1.253));
    let beta = 0.046 * (turbidity.max(1.0) - 1.0);
    WAVELENGTHS_NM.map(|nanometres| {
        let micrometres = nanometres / 1000.0;
        (-mass * (0.008_735 * micrometres.powf(-4.08) + beta * micrometres.powf(-1.3))).exp()
    })
}

/// One channel of a sky.
#[derive(Clone, Debug, PartialEq)]
struct Channel {
    /// A B C D E F G I H of the formula.
    coefficients: [f64; 9],
    /// R of the formula.
    factor: f64,
}

impl Channel {
    /// Mixes the rows of the table: by `control` points of the elevation, by turbidity and by
    /// albedo, all in range.
    fn new(channel: usize, control: &[f64; 6], turbidity: f64, albedo: f64) -> Self {
        let clearer = (turbidity as usize).clamp(1, MAX_TURBIDITY as usize - 1);
        let share = turbidity - clearer as f64;
        let mut mixed = [0.0; 10];
        for (ground, ground_weight) in [(0, 1.0 - albedo), (1, albedo)] {
            for (row, row_weight) in [(clearer - 1, 1.0 - share), (clearer, share)] {
                for (point, weight) in control_points(channel, ground, row).iter().zip(control) {
                    let weight = ground_weight * row_weight * weight;
                    (0..10).for_each(|k| mixed[k] += weight * f64::from(point[k]));
                }
            }
        }
        let [coefficients @ .., factor] = mixed;
        Self { coefficients, factor }
    }

    /// Radiance at a sine of elevation (0 to 1) and a cosine of the angle to the sun.
    fn radiance(&self, sin_elevation: f64, cos_to_sun: f64) -> f64 {
        let [a, b, c, d, e, f, g, i, h] = self.coefficients;
        let squared = cos_to_sun * cos_to_sun;
        // `h` stays below 0.91 for all skies, so this is far from 0.
        let base = 1.0 + h * h - 2.0 * h * cos_to_sun;
        let aureole = (1.0 + squared) / (base * base.sqrt());
        let gradation = 1.0 + a * (b / (sin_elevation + 0.01)).exp();
        let indicatrix =
            c + d * (e * cos_to_sun.acos()).exp() + f * squared + g * aureole + i * sin_elevation.sqrt();
        (self.factor * gradation * indicatrix).max(0.0)
    }
}

/// Weights of the six control points of a quintic Bezier curve at `x`, 0 to 1.
fn bernstein(x: f64) -> [f64; 6] {
    let binomials = [1.0, 5.0, 10.0, 10.0, 5.0, 1.0];
    std::array::from_fn(|i| binomials[i] * x.powi(i as i32) * (1.0 - x).powi(5 - i as i32))
}

/// The value within its range, the lower end for NaN.
fn clamped(value: f64, low: f64, high: f64) -> f64 {
    if value.is_nan() { low } else { value.clamp(low, high) }
}

#[cfg(test)]
mod tests;
