//! Rainbows: sunlight that comes back from drops after one and two reflections inside of them.
//!
//! The drops that return one colour lie on circles around the antisolar point: red at 42.4 and
//! violet at 40.6 degrees (primary bow), with the colours reversed between 50.4 and 53.5 degrees
//! (secondary bow). The phase function `p` of the two paths through a sphere of water is found by
//! tracing rays (Descartes; Fresnel's equations for both polarisations) and smoothed by the sun's
//! disc and by the waves of light in drops of about 1 mm. With the extinction of the rain `s_r`,
//! twice what the drops' area blocks, and that of all air `s`, a pixel at the distance `d` gains
//! the radiance
//!
//! `E p(angle) s_r / (2 s) (1 - e^(-s d))`
//!
//! by the sun's irradiance `E`. All rain in front of the pixel is assumed to be sunlit, and the air
//! to be as at the eye.

use super::light_in_picture::add_light;
use crate::effects::effect::{Effect, EffectRole, Need};
use crate::param::ParamValue;
use crate::weather::observer::Observer;
use crate::weather::prepared::{PixelContribution, PreparedWeather};
use std::f64::consts::PI;
use std::sync::{Arc, LazyLock};
use wm_render::hooks::{PixelBatch, PixelEffect};
use wm_render::simd::SimdPath;
use wm_scene::Camera;

crate::param::params! {
    /// The parameters of the effect.
    struct RainbowParams {
        /// Factor on the brightness of the bows; 1 is that of nature. They need rain, a sun of the
        /// weather's own (`light.model = clear`), and clouds that let it through (`light.clouds`
        /// below 1, since rain brings full clouds).
        brightness: f64 = ParamValue::Number(1.0), 0.0 => 10.0, "";
    }
}

/// The entry of [`EFFECTS`](super::EFFECTS).
pub(crate) const EFFECT: Effect = Effect {
    name: "rainbow",
    about: "Primary and secondary bow opposite to the sun, in rain",
    role: EffectRole::Sky,
    needs: &[Need::Light],
    precipitation: None,
    params: RainbowParams::PARAMS,
    contribute: |now, weather| {
        let RainbowParams { brightness } = RainbowParams::of(now.values);
        weather.prepared.pixels.push(Arc::new(Rainbow { brightness }));
    },
    contribute_as_paper: Some(|_, _| {}),
};

/// Depth of the rain where no surface is seen, m.
const FAR_M: f64 = 20_000.0;

/// Bows of a brightness.
#[derive(Debug)]
struct Rainbow {
    brightness: f64,
}

impl PixelContribution for Rainbow {
    fn in_pass<'a>(
        &'a self,
        weather: &'a PreparedWeather,
        observer: &Observer<'a>,
    ) -> Option<Box<dyn PixelEffect + 'a>> {
        let (sun, irradiance) = weather.sunlight()?;
        let rain = weather.rain_extinction();
        if rain <= 0.0 || irradiance.iter().all(|light| *light <= 0.0) || self.brightness <= 0.0 {
            return None;
        }
        let camera = observer.camera;
        let all = weather.air.extinction_at(camera.center().to_array())[1].max(rain);
        let share = 0.5 * self.brightness * rain / all;
        let opposite = camera.rotation() * -glam::DVec3::from_array(sun);
        Some(Box::new(BowBeforeCamera {
            camera: *camera,
            opposite: opposite.to_array(),
            // A white level board has the value of the irradiance, and pi of its radiance.
            light: irradiance.map(|light| PI * share * light),
            extinction: all,
            metres_per_unit: weather.site().metres_per_unit,
        }))
    }
}

/// The bows in one picture.
struct BowBeforeCamera {
    camera: Camera,
    /// Opposite to the sun, camera axes, length 1.
    opposite: [f64; 3],
    /// Display value of a phase function of 1/sr in endless rain, by channel.
    light: [f64; 3],
    /// Extinction of the air, 1/m.
    extinction: f64,
    metres_per_unit: f64,
}

impl PixelEffect for BowBeforeCamera {
    fn apply(&self, _: SimdPath, pixels: &mut PixelBatch<'_>) {
        let Camera { fx, fy, cx, cy, .. } = self.camera;
        let table = &*BOW_PHASE;
        add_light(pixels, |pixels, pixel, at| {
            let [u, v] = [(at.x - cx) / fx, (at.y - cy) / fy];
            let length = (u * u + v * v + 1.0).sqrt();
            let [x, y, z] = self.opposite;
            let cosine = (u * x + v * y + z) / length;
            if !table.cosines.contains(&cosine) {
                return None;
            }
            let phase = table.at(cosine.acos().to_degrees());
            let (alpha, sum) = (f64::from(pixels.alpha[pixel]), f64::from(pixels.depth_sum[pixel]));
            let seen = |metres: f64| 1.0 - (-self.extinction * metres).exp();
            let near = if alpha > 0.0 { seen(sum / alpha * length * self.metres_per_unit) } else { 0.0 };
            let amount = alpha * near + (1.0 - alpha) * seen(FAR_M);
            Some(std::array::from_fn(|k| amount * self.light[k] * phase[k]))
        });
    }
}

/// Width of a bin of the table, degrees.
const BIN_DEG: f64 = 0.05;
/// Largest angle in the table, degrees from the antisolar point. The bows are negligible beyond it.
const MAX_ANGLE_DEG: f64 = 62.0;
/// Radius of the sun, degrees.
const SUN_RADIUS_DEG: f64 = 0.266;
/// Standard deviation by which waves smooth the bows of drops of 1 mm, degrees.
const DIFFRACTION_DEG: f64 = 0.25;
/// Rays that are traced at each wavelength.
const RAY_COUNT: usize = 4000;

/// The phase function of the two bows, 1/sr, by channel and angle.
struct BowPhase {
    bins: Vec<[f64; 3]>,
    /// Cosines of the angles at which it is not 0.
    cosines: std::ops::Range<f64>,
}

static BOW_PHASE: LazyLock<BowPhase> = LazyLock::new(BowPhase::new);

impl BowPhase {
    /// Traces rays through a sphere of water at wavelengths of 400 to 700 nm.
    fn new() -> Self {
        let count = (MAX_ANGLE_DEG / BIN_DEG) as usize;
        let mut bins = vec![[0.0; 3]; count];
        let weights: Vec<(f64, [f64; 3])> =
            (0..31).map(|k| 400.0 + 10.0 * f64::from(k)).map(|nm| (nm, channels(nm))).collect();
        let total: [f64; 3] = std::array::from_fn(|k| weights.iter().map(|(_, share)| share[k]).sum());
        for (nm, share) in &weights {
            let micrometres = nm * 1e-3;
            // Cauchy's formula for water at 20 C.
            let index = 1.3244 + 3.1e-3 / (micrometres * micrometres);
            for ray in 0..RAY_COUNT {
                let incident = ((ray as f64 + 0.5) / RAY_COUNT as f64).sqrt().asin();
                let refracted = (incident.sin() / index).asin();
                let reflected = reflectance(incident, refracted);
                for (order, angle) in
                    [(1, 4.0 * refracted - 2.0 * incident), (2, 6.0 * refracted - 2.0 * incident - PI)]
                {
                    let light: f64 = reflected
                        .iter()
                        .map(|r| 0.5 * (1.0 - r) * (1.0 - r) * r.powi(order) / RAY_COUNT as f64)
                        .sum();
                    let degrees = angle.abs().to_degrees();
                    let bin = (degrees / BIN_DEG) as usize;
                    if bin < count {
                        let ring = 2.0 * PI * degrees.to_radians().sin().max(1e-3) * BIN_DEG.to_radians();
                        (0..3).for_each(|k| bins[bin][k] += light / ring * share[k] / total[k]);
                    }
                }
            }
        }
        let bins = smoothed(&bins);
        let cosines = MAX_ANGLE_DEG.to_radians().cos()..2.0;
        Self { bins, cosines }
    }

    /// The phase function at an angle from the point opposite to the sun, degrees.
    fn at(&self, degrees: f64) -> [f64; 3] {
        let at = (degrees / BIN_DEG - 0.5).clamp(0.0, (self.bins.len() - 1) as f64);
        let (first, share) = (at as usize, at.fract());
        let next = (first + 1).min(self.bins.len() - 1);
        std::array::from_fn(|k| (self.bins[first][k] * (1.0 - share) + self.bins[next][k] * share).max(0.0))
    }
}

/// Reflectances of the two polarisations at the surface of a drop (Fresnel).
fn reflectance(incident: f64, refracted: f64) -> [f64; 2] {
    let (difference, sum) = (incident - refracted, incident + refracted);
    [(difference.sin() / sum.sin()).powi(2), (difference.tan() / sum.tan()).powi(2)]
}

/// Convolves with the sun's disc and the width that waves have.
fn smoothed(bins: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let reach = ((SUN_RADIUS_DEG + 3.0 * DIFFRACTION_DEG) / BIN_DEG) as i64;
    let disc = |degrees: f64| (SUN_RADIUS_DEG.powi(2) - degrees.powi(2)).max(0.0).sqrt();
    let kernel: Vec<f64> = (-reach..=reach)
        .map(|offset| {
            let steps = 40;
            (0..=steps)
                .map(|k| (f64::from(k) / f64::from(steps) * 2.0 - 1.0) * SUN_RADIUS_DEG)
                .map(|sun| {
                    let apart = (offset as f64 * BIN_DEG - sun) / DIFFRACTION_DEG;
                    disc(sun) * (-0.5 * apart * apart).exp()
                })
                .sum()
        })
        .collect();
    let total: f64 = kernel.iter().sum();
    let last = bins.len() as i64 - 1;
    (0..=last)
        .map(|bin| {
            std::array::from_fn(|k| {
                let beside = |j: i64| bins[(bin + j - reach).clamp(0, last) as usize][k];
                kernel.iter().zip(0..).map(|(weight, j)| weight * beside(j)).sum::<f64>() / total
            })
        })
        .collect()
}

/// Linear RGB of light of a wavelength, nm: the eye's curves by the lobes of Wyman, Sloan and
/// Shirley (2013), in the primaries of Rec. 709.
fn channels(nm: f64) -> [f64; 3] {
    let lobe = |center: f64, low: f64, high: f64| {
        let apart = (nm - center) * if nm < center { low } else { high };
        (-0.5 * apart * apart).exp()
    };
    let x = 0.362 * lobe(442.0, 0.0624, 0.0374) + 1.056 * lobe(599.8, 0.0264, 0.0323)
        - 0.065 * lobe(501.1, 0.0490, 0.0382);
    let y = 0.821 * lobe(568.8, 0.0213, 0.0247) + 0.286 * lobe(530.9, 0.0613, 0.0322);
    let z = 1.217 * lobe(437.0, 0.0845, 0.0278) + 0.681 * lobe(459.0, 0.0385, 0.0725);
    [
        3.2406 * x - 1.5372 * y - 0.4986 * z,
        -0.9689 * x + 1.8758 * y + 0.0415 * z,
        0.0557 * x - 0.2040 * y + 1.0570 * z,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::light_in_picture::gain;
    use crate::testing::{SITE, weather};
    use glam::DVec3;

    /// The angle between two at which a channel of the table is brightest.
    fn peak(channel: usize, degrees: [f64; 2]) -> f64 {
        let angles = (0..).map(|k| degrees[0] + 0.02 * f64::from(k)).take_while(|at| *at < degrees[1]);
        angles.max_by(|a, b| BOW_PHASE.at(*a)[channel].total_cmp(&BOW_PHASE.at(*b)[channel])).unwrap()
    }

    /// Angles of textbooks: red at 42.4 degrees outside of the primary bow and violet at 40.6
    /// inside, the secondary bow from 50.4 to 53.5 the other way round, and Alexander's dark band
    /// between.
    #[test]
    fn bows_stand_where_they_do_in_nature() {
        let (red, blue) = (peak(0, [38.0, 46.0]), peak(2, [38.0, 46.0]));
        assert!((41.6..42.6).contains(&red) && (40.2..41.4).contains(&blue), "{red} {blue}");
        let (second_red, second_blue) = (peak(0, [48.0, 57.0]), peak(2, [48.0, 57.0]));
        assert!(
            (50.0..51.5).contains(&second_red) && second_blue > second_red + 1.0,
            "{second_red} {second_blue}"
        );
        let [primary, band, secondary] = [red, 46.0, second_red].map(|at| BOW_PHASE.at(at)[0]);
        assert!(
            primary > 2.0 * secondary && secondary > 5.0 * band.max(1e-4),
            "{primary} {band} {secondary}"
        );
    }

    /// The light that a picture of the sky gains, and where: on circles about the point opposite to
    /// the sun, by the formula, without depth in the rain's far distance.
    #[test]
    fn a_picture_gains_the_light_of_the_formula() {
        let light =
            ["light.model=clear", "light.sun_elevation=20", "light.sun_azimuth=0", "light.clouds=0.3"];
        let weather = weather(light.into_iter().chain(["rain.rate=10", "rainbow=on"]));
        let prepared = weather.at(0.0).prepare(&SITE);
        let (sun, light) = prepared.sunlight().unwrap();
        let opposite = -DVec3::from_array(sun);
        // 42 degrees over the point opposite to the sun.
        let level = opposite.reject_from(DVec3::Z).normalize();
        let toward = |degrees: f64| {
            let up = (degrees - 20.0).to_radians();
            level * up.cos() + DVec3::Z * up.sin()
        };
        let mut gains = Vec::new();
        for degrees in [30.0, 42.0, 46.0] {
            let camera = Camera::looking((16, 16), 1.0, DVec3::ZERO, toward(degrees), DVec3::Z).unwrap();
            let observer = Observer::at_rest(&camera);
            let pass = Rainbow { brightness: 1.0 };
            let effect = pass.in_pass(&prepared, &observer).unwrap();
            let gain = gain(&*effect, [8, 8]);
            let all = prepared.air.extinction_at([0.0; 3])[1];
            let share = 0.5 * prepared.rain_extinction() / all;
            let want = PI * light[0] * BOW_PHASE.at(degrees)[0] * share;
            assert!((gain - want).abs() < 0.03 * want + 1e-6, "{degrees}: {gain} is not {want}");
            gains.push(gain);
        }
        assert!(gains[1] > 4.0 * gains[2] && gains[1] > 2.0 * gains[0], "{gains:?}");
        // Without rain or without a sun there are none.
        for text in ["rain.rate=0", "light.clouds=1", "light.model=captured"] {
            let mut other = weather.clone();
            other.set_text(text).unwrap();
            let prepared = other.at(0.0).prepare(&SITE);
            let camera = Camera::looking((16, 16), 50.0, DVec3::ZERO, opposite, DVec3::Z).unwrap();
            assert!(
                Rainbow { brightness: 1.0 }.in_pass(&prepared, &Observer::at_rest(&camera)).is_none(),
                "{text}"
            );
        }
    }
}
