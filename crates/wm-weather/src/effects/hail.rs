//! Hail: white balls of ice of 5 to 50 mm, in their true number.
//!
//! Sizes: `N(D) = 115 L^3.63 exp(-L D)` a m^3 and mm (Cheng and English 1983), whose slope `L`
//! follows from the rate and stays between 0.1 and 1 a mm, where it was measured; Federer and
//! Waldvogel's (1975) mean of many storms is L = 0.42, some 20 mm/h of water. Below 10 mm/h the
//! slope stays at 1 and all numbers fall with the rate.
//!
//! Fall speed: that at which drag carries the weight of a ball,
//! `sqrt(4 rho_i g D / (3 rho_a C_d))`, with C_d = 0.55 and ice of 900 kg/m^3 in air of 1.2 kg/m^3:
//! 9.4 m/s at 5 mm, 13.4 at 10 mm, 30 at 50 mm (Matson and Huggins 1980 measured C_d from 0.5 to
//! 0.9). Stones do not bounce. The paper has no hail: in its fidelity it falls in physical units.

use crate::effects::effect::{Effect, EffectContext, EffectRole, Need};
use crate::param::ParamValue;
use crate::particles::{ClassSpacing, ParticleAppearance, ParticleShape, Precipitation, PrecipitationKind};
use crate::physics::{AIR_DENSITY, GRAVITY};
use crate::weather::builder::WeatherBuilder;
use wm_render::frame::srgb_decode;

/// Density of hailstones, kg/m^3, and the drag coefficient of a stone.
const ICE_DENSITY: f64 = 900.0;
const DRAG_COEFFICIENT: f64 = 0.55;
/// Diameter of a stone when melted, as a share of its own: the cube root of 0.9.
const MELTED_DIAMETER: f64 = 0.965_489_384_605_629_7;
/// Rate, mm/h, at which the slope of the spectrum is 1 a mm, and the power of the slope that the
/// rate goes with: the integral of the spectrum times mass and speed.
const UNIT_RATE: f64 = 9.58;
const SLOPE_POWER: f64 = -0.87;

/// Hailstones: Cheng and English's sizes, at the speed of drag.
const HAIL: PrecipitationKind = PrecipitationKind {
    name: "hail",
    key: 0x4a17_0000,
    diameters: [5.0 * MELTED_DIAMETER, 50.0 * MELTED_DIAMETER],
    spacing: ClassSpacing::Geometric,
    classes: 48,
    class_slope: 0.42 / MELTED_DIAMETER,
    reference_rate: 20.0,
    tiers: &[0.0, 0.1],
    width: |d| d / MELTED_DIAMETER,
    speed: |d| {
        let weight = 4.0 * ICE_DENSITY * GRAVITY * 1e-3 * (d / MELTED_DIAMETER);
        (weight / (3.0 * AIR_DENSITY * DRAG_COEFFICIENT)).sqrt()
    },
    spectrum: |rate| {
        let slope = (rate / UNIT_RATE).powf(1.0 / SLOPE_POWER).clamp(0.1, 1.0);
        [115.0 * slope.powf(3.63) / MELTED_DIAMETER, slope / MELTED_DIAMETER]
    },
    extinction: None,
    shape: ParticleShape::Ball,
    // Ice of albedo 0.85; an overcast sky, three times as bright straight up, lights a ball 1.4
    // times as much as one that is everywhere as bright as at the horizon.
    reflectance: 1.2,
};

crate::param::params! {
    /// The parameters of hail.
    struct HailParams {
        /// Water equivalent of the ice that falls through a level plane. A shower of small hail 10,
        /// a hailstorm 50.
        rate: f64 = ParamValue::Number(20.0), 0.0 => 200.0, "mm/h";
        /// Exposure time: streaks are as long as the distance travelled in it.
        exposure: f64 = ParamValue::Number(0.0166), 0.000_01 => 1.0, "s";
        /// Factor on the diameters that are drawn; their number, speed and the air stay as they
        /// are.
        size: f64 = ParamValue::Number(1.0), 0.1 => 10.0, "";
        /// Factor on the share of light that stones block.
        opacity: f64 = ParamValue::Number(1.0), 0.0 => 100.0, "";
        /// Factor on the brightness of stones.
        brightness: f64 = ParamValue::Number(1.0), 0.0 => 10.0, "";
        /// Colour of the stones; `auto` is white ice in the light of the scene's sky.
        color: Option<[f64; 3]> = ParamValue::Auto, 0.0 => 1.0, "";
        /// Colour of an endless depth of hail; `auto` takes the scene's sky near the horizon.
        airlight: Option<[f64; 3]> = ParamValue::Auto, 0.0 => 1.0, "";
        /// Seed of the random positions: a whole number.
        seed: f64 = ParamValue::Number(0.0), 0.0 => 9_007_199_254_740_992.0, "";
    }
}

/// The entry of [`EFFECTS`](super::EFFECTS).
pub(crate) const EFFECT: Effect = Effect {
    name: "hail",
    about: "White balls of ice in their true number",
    role: EffectRole::Falls,
    needs: &[Need::Shelter],
    precipitation: Some(&HAIL),
    params: HailParams::PARAMS,
    contribute,
    contribute_as_paper: None,
};

fn contribute(now: &EffectContext<'_>, weather: &mut WeatherBuilder) {
    let own = HailParams::of(now.values);
    let appearance = ParticleAppearance {
        seed: own.seed as u64,
        exposure: own.exposure,
        size: own.size,
        opacity: own.opacity,
        brightness: own.brightness,
        radiance: own.color.map(|color| color.map(srgb_decode)),
    };
    let airlight = own.airlight.map_or(weather.site().airlight, |color| color.map(srgb_decode));
    weather.add_fall(Precipitation::new(&HAIL, own.rate, airlight, appearance));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::particles::near::each_particle;
    use crate::particles::spectrum::flux;
    use crate::testing::SITE;
    use crate::weather::{Observer, Weather};
    use glam::DVec3;
    use wm_render::hooks::ParticleView;
    use wm_render::simd::SimdPath;
    use wm_scene::Camera;

    /// The drag law typed anew.
    fn drag(diameter: f64) -> f64 {
        (4.0 / 3.0 * 900.0 / 1.2 * 9.81 / 0.55 * diameter * 1e-3).sqrt()
    }

    #[test]
    fn stones_fall_as_drag_lets_them() {
        for class in HAIL.classes() {
            for share in [0.0, 0.5, 1.0] {
                let ratio = class.fall_speed / drag(1e3 * class.seen(share));
                assert!((ratio - 1.0).abs() < 0.05, "{class:?}: {ratio}");
            }
        }
        assert!((HAIL.fall_speed(10.0 * MELTED_DIAMETER) - 13.4).abs() < 0.1);
    }

    #[test]
    fn stones_bring_the_water_that_is_set() {
        let classes = HAIL.classes();
        for rate in [1.0, 10.0, 20.0, 40.0, 70.0, 150.0] {
            let numbers = HAIL.densities(&classes, rate);
            assert!((flux(&classes, &numbers) / rate - 1.0).abs() < 1e-12);
            // Cheng and English's own numbers beyond 5 mm, where their law is not stretched or cut
            // off at 50 mm.
            let [most, slope] = (HAIL.spectrum)(rate);
            let own = most / slope * (-slope * HAIL.diameters[0]).exp();
            let ratio = numbers.iter().sum::<f64>() / own;
            assert!(!(20.0..50.0).contains(&rate) || (0.9..1.2).contains(&ratio), "{rate}: {ratio}");
        }
    }

    #[test]
    fn the_same_instant_has_the_same_stones() {
        let camera = Camera::looking((320, 240), 50.0, DVec3::ZERO, DVec3::Y, DVec3::Z).unwrap();
        let view = ParticleView::new(&camera);
        let stones = |seed: i32| {
            let weather = Weather::clear().set("hail.rate", 60).unwrap().set("hail.seed", seed).unwrap();
            let weather = weather.at(3.0).prepare(&SITE);
            let pass = weather.pass(&Observer::at_rest(&camera));
            let particles = pass.hooks().particles[0];
            let mut all = Vec::new();
            each_particle(particles, SimdPath::available()[0], &view, |one| {
                all.extend((one.area > 0.0).then_some(one.offset));
            });
            all
        };
        let first = stones(0);
        assert!(first.len() > 20, "{}", first.len());
        assert_eq!(first, stones(0));
        assert_ne!(first, stones(1));
    }
}
