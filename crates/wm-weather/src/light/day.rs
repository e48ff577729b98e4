//! Light of the open sky by the place of the sun: day, twilight, night, and clouds before any of
//! them.
//!
//! Irradiances are linear RGB whose luminance is in lux. With the sun above [`LOWEST_DAY`] they are
//! those of [`ClearSky`]; below it, illuminance falls as it was measured under clear skies
//! (Seidelmann 1992: 3.4 lx with the sun 6 degrees below the horizon, 0.008 at 12, 0.0006 at 18),
//! and the glow of the sky about the place stays.

use super::clear_sky::ClearSky;
use super::irradiance::{SceneLight, SkyGradation};
use crate::level::dot;
use std::f64::consts::PI;
use wm_base::color::luminance;

/// Luminous efficacy, lm/W.
const LUMINOUS_EFFICACY: f64 = 683.0;
/// Elevation of the sun down to which the model of the clear sky holds, degrees.
const LOWEST_DAY: f64 = 3.0;
/// Clear skies with the sun below that: elevation in degrees, illuminance of level ground in lux.
const TWILIGHT_ILLUMINANCES: [[f64; 2]; 4] = [[-0.8, 400.0], [-6.0, 3.4], [-12.0, 0.008], [-18.0, 0.0006]];
/// Tint of the sky once the sun is 6 degrees below the horizon, luminance 1.
const BLUE_HOUR: [f64; 3] = [0.75, 0.98, 1.93];
/// Tint of the glow of a town's sky, luminance 1: lamps of 3,000 to 4,000 K, as a camera balances
/// them.
const GLOW_TINT: [f64; 3] = [1.15, 0.97, 0.85];
/// Share of a clear sky's light that the thickest clouds take (Kasten and Czeplak 1980).
const MAX_CLOUD_LOSS_SHARE: f64 = 0.75;
/// Tint of clouds, luminance 1.
const CLOUD_TINT: [f64; 3] = [0.97, 1.0, 1.05];
/// Albedo of the ground under the sky.
const GROUND_ALBEDO: f64 = 0.2;

/// The light of the open sky at an instant.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct OpenLight {
    /// Towards the sun, world axes, length 1.
    pub(crate) sun: [f64; 3],
    /// Sine of the sun's elevation.
    pub(crate) sin_sun: f64,
    /// Towards the brightest of the sky, which stays above the horizon.
    glow_center: [f64; 3],
    /// The sky between the clouds; its radiances times `tint` are W/(m^2 sr), in the unit of
    /// [`ClearSky`].
    clear: ClearSky,
    /// Factor on it: 1 by day, and the tint and the darkness of the twilight.
    tint: [f64; 3],
    /// Irradiances, lx.
    pub(crate) light: SceneLight,
    /// The share of `light.sky` that is even grey, of clouds, of the glow of towns and of what took
    /// the beam away, lx.
    overcast: [f64; 3],
}

impl OpenLight {
    /// Under a sun at `elevation` (degrees, -90 to 90) over the `heading` (world axes, level,
    /// length 1), in air of this turbidity (1-10). `clouds` is the cloud cover, 0-1, `depth` the
    /// optical depth of fog and the like straight up by channel, `glow` the illuminance by the glow
    /// of towns, lx.
    pub(crate) fn new(
        heading: [f64; 3],
        up: [f64; 3],
        elevation: f64,
        turbidity: f64,
        clouds: f64,
        depth: [f64; 3],
        glow: f64,
    ) -> Self {
        let day = elevation.max(LOWEST_DAY).to_radians();
        let clear = ClearSky::new(day, turbidity, GROUND_ALBEDO);
        let at = |elevation: f64| -> [f64; 3] {
            let (sin, cos) = elevation.sin_cos();
            std::array::from_fn(|k| cos * heading[k] + sin * up[k])
        };
        let (mut tint, mut beam) = ([1.0; 3], clear.sun_irradiance().map(|v| LUMINOUS_EFFICACY * v));
        let irradiance = clear.level_and_upright_irradiance();
        let lowest = irradiance[0].map(|v| LUMINOUS_EFFICACY * v);
        if elevation < LOWEST_DAY {
            let fade = ((elevation + 0.8) / (LOWEST_DAY + 0.8)).clamp(0.0, 1.0);
            beam = beam.map(|v| v * fade);
            let level = twilight(elevation, luminance(lowest)) / luminance(lowest);
            let blue = (-elevation / 6.0).clamp(0.0, 1.0);
            tint = BLUE_HOUR.map(|v| level * (1.0 + (v - 1.0) * blue));
        }
        let sin_sun = elevation.to_radians().sin();
        let sin = sin_sun.max(LOWEST_DAY.to_radians().sin() * 0.5);
        let open: [f64; 3] = std::array::from_fn(|k| lowest[k] * tint[k] + beam[k] * sin_sun.max(0.0));
        // Clouds take light away; what floats in the air scatters it downwards.
        let kept = 1.0 - MAX_CLOUD_LOSS_SHARE * clouds.powf(3.4);
        let level = open.map(|v| v * kept);
        let sun: [f64; 3] = std::array::from_fn(|k| beam[k] * (1.0 - clouds) * (-depth[k] / sin).exp());
        let through = (1.0 - clouds) * (-depth[1] / sin).exp();
        let sky: [f64; 3] = std::array::from_fn(|k| lowest[k] * tint[k] * through);
        let rest = std::array::from_fn(|k| (level[k] - sun[k] * sin_sun.max(0.0) - sky[k]).max(0.0));
        let grey = luminance(rest);
        let overcast = std::array::from_fn(|k| CLOUD_TINT[k] * grey + GLOW_TINT[k] * glow);
        let zenith = clear.radiance(1.0, day.sin());
        let gradation = gradation(irradiance, zenith, tint.map(|v| v * through * LUMINOUS_EFFICACY));
        let cloudy = SkyGradation::overcast(overcast);
        let add = |a: [f64; 3], b: [f64; 3]| std::array::from_fn(|k| a[k] + b[k]);
        let sky = SkyGradation {
            level: add(gradation.level, cloudy.level),
            rise: add(gradation.rise, cloudy.rise),
        };
        let tint = tint.map(|v| v * through);
        Self {
            sun: at(elevation.to_radians()),
            sin_sun,
            glow_center: at(day),
            clear,
            tint,
            light: SceneLight { sun, sky },
            overcast,
        }
    }

    /// Illuminance of level ground, lx.
    pub(crate) fn level(&self) -> f64 {
        luminance(self.light.irradiance(self.sin_sun))
    }

    /// Radiance of the sky in a direction (world axes, length 1) at a sine of elevation, times pi:
    /// the irradiance of a level surface under a whole sky of this radiance, linear RGB, lx. Below
    /// the horizon it is that of the horizon above.
    pub(crate) fn radiance(&self, direction: [f64; 3], sin: f64) -> [f64; 3] {
        let clear = self.clear.radiance(sin, dot(direction, self.glow_center));
        // CIE overcast: the zenith has 9/7 of the mean.
        let cloudy = (1.0 + 2.0 * sin.clamp(0.0, 1.0)) * 3.0 / 7.0;
        std::array::from_fn(|k| PI * LUMINOUS_EFFICACY * self.tint[k] * clear[k] + cloudy * self.overcast[k])
    }
}

/// Illuminance of level ground under a clear sky with the sun at an elevation (degrees) below
/// [`LOWEST_DAY`], where it is `highest`, lx: a straight line of its logarithm between the rows.
fn twilight(elevation: f64, highest: f64) -> f64 {
    let mut above = [LOWEST_DAY, highest];
    for below in TWILIGHT_ILLUMINANCES {
        if elevation >= below[0] {
            let share = (elevation - below[0]) / (above[0] - below[0]);
            return below[1] * (above[1] / below[1]).powf(share);
        }
        above = below;
    }
    above[1]
}

/// The gradation by elevation with these irradiances of a clear sky on level ground and, in the
/// mean over all sides, on upright walls; radiances times `factor`. Towards the zenith it falls to
/// no less than the radiance there: below a low sun the red light of the sky is near the horizon,
/// and a courtyard that sees the zenith alone would get none of it.
fn gradation(irradiances: [[f64; 3]; 2], zenith: [f64; 3], factor: [f64; 3]) -> SkyGradation {
    let [level, upright] = irradiances;
    // pi (l + 2/3 r) on the level, (pi/2) l + (2/3) r upright, l + r at the zenith.
    let rise: [f64; 3] = std::array::from_fn(|k| {
        let by_walls = (level[k] / 2.0 - upright[k]) / (PI / 3.0 - 2.0 / 3.0);
        by_walls.max(3.0 * (zenith[k] - level[k] / PI))
    });
    let at_horizon: [f64; 3] = std::array::from_fn(|k| level[k] / PI - 2.0 / 3.0 * rise[k]);
    SkyGradation {
        level: std::array::from_fn(|k| at_horizon[k] * factor[k]),
        rise: std::array::from_fn(|k| rise[k] * factor[k]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn open(elevation: f64, clouds: f64) -> OpenLight {
        OpenLight::new([1.0, 0.0, 0.0], [0.0, 0.0, 1.0], elevation, 2.5, clouds, [0.0; 3], 0.0)
    }

    /// Published: 3.4 lx at the end of civil twilight; some 100 klx with a high sun, and a quarter
    /// of it under clouds.
    #[test]
    fn levels_are_the_published_ones_and_never_jump() {
        assert!((open(-6.0, 0.0).level() / 3.4 - 1.0).abs() < 0.05, "{}", open(-6.0, 0.0).level());
        assert!((80e3..120e3).contains(&open(60.0, 0.0).level()), "{}", open(60.0, 0.0).level());
        let share = open(45.0, 1.0).level() / open(45.0, 0.0).level();
        assert!((share - 0.25).abs() < 0.01, "{share}");
        let mut before = open(90.0, 0.0).level();
        for step in 1..2160 {
            let level = open(90.0 - f64::from(step) / 20.0, 0.0).level();
            assert!(level <= before * 1.02 && level > 0.9 * before, "{step}: {before} to {level}");
            before = level;
        }
    }

    /// The radiances that are seen make the irradiance that surfaces get, within the error of sums
    /// over directions.
    #[test]
    fn the_sky_that_is_seen_is_the_sky_that_lights() {
        for (elevation, clouds) in [(50.0, 0.0), (20.0, 0.4), (5.0, 0.0), (-4.0, 0.0), (30.0, 1.0)] {
            let open = open(elevation, clouds);
            let (rows, columns, mut sum) = (90, 180, [0.0; 3]);
            for row in 0..rows {
                let sin = ((f64::from(row) + 0.5) / f64::from(rows)).sqrt();
                let cos = (1.0 - sin * sin).sqrt();
                for column in 0..columns {
                    let (y, x) = (2.0 * PI * (f64::from(column) + 0.5) / f64::from(columns)).sin_cos();
                    let light = open.radiance([cos * x, cos * y, sin], sin);
                    (0..3).for_each(|k| sum[k] += light[k] / f64::from(rows * columns));
                }
            }
            let want = open.light.sky.irradiance();
            for k in 0..3 {
                assert!(
                    (sum[k] / want[k] - 1.0).abs() < 0.02,
                    "{elevation} {clouds}: {sum:?}, want {want:?}"
                );
            }
        }
    }
}
