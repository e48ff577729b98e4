//! Halo: the light in the air around a lamp in fog, by the angle from it.
//!
//! The air of scattering `sigma` before and behind a lamp of intensity `I` sends to the eye, along
//! a ray that passes it at the distance `h`, what it scatters once: the integral over the ray of
//! `sigma I p(a) T(r) T(t) / r^2`, `r` from the lamp, `t` from the eye, `a` the deflection.
//! Droplets scatter most light forwards by small angles, so that light goes on as if it were not
//! scattered: of the phase function of Henyey and Greenstein with `g = 0.85` the share `f = g^2` is
//! taken for that (delta scaling: Joseph, Wiscombe and Weinman 1976), and what is left has
//! `sigma (1 - f)` and `g / (1 + g)`. The integral is made here in double precision with Simpson's
//! rule over the angle at the lamp.
//!
//! The lamp's intensity in the picture is measured by its own light on a level card 3 m below it in
//! clear air, at the same exposure. Tolerance 5 %.

use super::allard::{NIGHT, NOTHING_FALLS};
use super::lit::{LightPicture, level_square, overcast_card};
use super::plot::{Axis, Series};
use super::{Bench, Instrument, Tolerance, changed, expected};
use std::f64::consts::PI;
use wm_place::Result;
use wm_scene::{Camera, Lamp};

/// The instrument.
pub(crate) const INSTRUMENT: Instrument = Instrument {
    name: "halo",
    title: "Light around a lamp",
    about: "A lamp by night, 25 m off. The light in the air beside it at several distances, over the lamp's light on a card \
            below it in clear air, against the integral of what fog scatters once, with the forward peak of its droplets left in the beam.",
    applies: |weather, time| {
        let airs = expected::airs(weather, time);
        airs.iter().any(|air| MIN_MEAN_FREE_PATH_M * air.share(LAMP_HEIGHT_M) * air.sigma_t[1] > 1.0)
            && airs.iter().all(|air| air.scale_height.is_infinite())
    },
    measure,
    sweep: &["fog.mor=50", "fog.mor=100", "fog.mor=200", "fog.mor=500"],
};

/// Air in which a lamp has no halo to speak of: 1 over its extinction, m.
const MIN_MEAN_FREE_PATH_M: f64 = 500.0;
/// Height of lamp and camera, m: so low that no ground under the lamp returns its light.
const LAMP_HEIGHT_M: f64 = 0.9;
/// Distance of the lamp, m, and of the card below it.
const LAMP_DISTANCE_M: f64 = 25.0;
const CARD_DISTANCE_M: f64 = 3.0;
/// Flux, lm, and radius, m.
const LAMP_FLUX_LM: f64 = 5_000.0;
const LAMP_RADIUS_M: f64 = 0.1;
/// The picture, px and degrees, and the distances from the lamp in it at which its light is
/// measured, px.
const SIZE: (u32, u32) = (480, 240);
const FIELD_OF_VIEW_DEGREES: f64 = 20.0;
const RING_RADII_PX: [f64; 7] = [12.0, 17.0, 24.0, 40.0, 70.0, 120.0, 200.0];
/// Reflectance of the card.
const CARD_REFLECTANCE: f64 = 0.2;
/// Asymmetry of fog's droplets.
const FOG_ASYMMETRY: f64 = 0.85;
/// Intervals of the integral.
const INTEGRAL_STEPS: usize = 2_000;

/// Radiance at the angle `turn` beside a lamp at the distance `away` (m), over its intensity,
/// 1/m^2, in even air of extinction `sigma`, 1/m.
fn scattered_once(turn: f64, away: f64, sigma: f64) -> f64 {
    let (sigma, g) = (sigma * (1.0 - FOG_ASYMMETRY * FOG_ASYMMETRY), FOG_ASYMMETRY / (1.0 + FOG_ASYMMETRY));
    let (abreast, h) = (away * turn.cos(), away * turn.sin());
    let phase = |cos: f64| (1.0 - g * g) / (4.0 * PI * (1.0 + g * g - 2.0 * g * cos).powf(1.5));
    // t = abreast + h tan(phi): dt / r^2 = dphi / h.
    let at = |phi: f64| {
        let (sin, cos) = phi.sin_cos();
        let (t, r) = (abreast + h * sin / cos, h / cos);
        phase(-sin) * (-sigma * (t + r)).exp()
    };
    let (from, to) = (-(abreast / h).atan(), 0.5 * PI - 1e-9);
    let step = (to - from) / INTEGRAL_STEPS as f64;
    let weight = |i: usize| match i {
        0 | INTEGRAL_STEPS => 1.0,
        i if i % 2 == 1 => 4.0,
        _ => 2.0,
    };
    let sum: f64 = (0..=INTEGRAL_STEPS).map(|i| weight(i) * at(from + step * i as f64)).sum();
    sigma / h * sum * step / 3.0
}

/// Mean of measured light and of the integral over pixels about level with the lamp, `ring` px from
/// it.
fn on_ring(picture: &LightPicture, camera: &Camera, ring: f64, sigma: f64) -> [f64; 2] {
    let (mut seen, mut law, mut count) = (0.0, 0.0, 0.0);
    for side in [-1.0, 1.0] {
        for step in -4..=4 {
            let (sin, cos) = (0.08 * f64::from(step)).sin_cos();
            let [x, y] = [camera.cx + side * ring * cos, camera.cy + ring * sin].map(f64::floor);
            let ray = camera.ray(x + 0.5, y + 0.5);
            seen += picture.light(x as usize, y as usize);
            law += scattered_once(ray.angle_between(camera.forward()), LAMP_DISTANCE_M, sigma);
            count += 1.0;
        }
    }
    [seen / count, law / count]
}

fn measure(bench: &mut Bench<'_>) -> Result<()> {
    let level = bench.level;
    let weather = bench.with(&format!("{NOTHING_FALLS}, {NIGHT}, light.glow=0, light.exposure=-4.8"))?;
    let without_air = changed(&weather, "fog=off, haze=off, smog=off")?;
    let sigma = expected::extinction(&weather, bench.time, LAMP_HEIGHT_M)[1];
    let at = [0.0, LAMP_DISTANCE_M, LAMP_HEIGHT_M];
    let lamp = Lamp {
        lumens: LAMP_FLUX_LM,
        radius: LAMP_RADIUS_M,
        kelvin: 4_000.0,
        ..Lamp::new(level.point(at).to_array())
    };
    let middle = [at[0], at[1], LAMP_HEIGHT_M - CARD_DISTANCE_M];
    let light = overcast_card(CARD_REFLECTANCE, 0.0);
    let subject = bench.card_by_lamps(middle, level_square(0.5), 0.05, light, vec![lamp])?;

    let above = level.camera((33, 33), 8.0, [at[0], at[1], LAMP_HEIGHT_M - 0.5], middle)?;
    let lit = bench.light(subject, &above, &without_air)?;
    // The irradiance in the picture's unit, of a white card, is `pi` times the radiance of one of
    // it.
    let intensity = lit.patch(16.5, 16.5, 3) / CARD_REFLECTANCE
        * (CARD_DISTANCE_M * CARD_DISTANCE_M + LAMP_RADIUS_M * LAMP_RADIUS_M);
    let camera = level.camera(SIZE, FIELD_OF_VIEW_DEGREES, [0.0, 0.0, LAMP_HEIGHT_M], at)?;
    let picture = bench.light(subject, &camera, &weather)?;
    let is_burned = lit.patch(16.5, 16.5, 3) > 0.95;

    let (mut seen, mut law) = (Vec::new(), Vec::new());
    for ring in RING_RADII_PX {
        let [measured, asked] = on_ring(&picture, &camera, ring, sigma);
        // Radiance is shown as pi times itself.
        let measured = measured / (PI * intensity);
        let metres = LAMP_DISTANCE_M * (ring / camera.fx);
        seen.push([metres, measured]);
        law.push([metres, asked]);
        bench.add(
            format!("light {ring:.0} px from the lamp, over its intensity"),
            "1/m\u{b2}",
            [asked, if is_burned || picture_is_burned(&picture, ring) { f64::NAN } else { measured }],
            Tolerance::Relative(0.05),
        );
    }
    bench.plot(
        "Light around a lamp",
        Axis::log("distance from the lamp, m"),
        Axis::log("radiance over intensity, 1/m\u{b2}"),
        vec![Series::line("scattered once", law), Series::points("seen", seen)],
    );
    bench.show(format!("the lamp, {LAMP_DISTANCE_M} m off"), &picture.picture);
    Ok(())
}

/// Returns true if a picture has no more room for light at a distance from its middle.
fn picture_is_burned(picture: &LightPicture, ring: f64) -> bool {
    let (x, y) = (0.5 * picture.size.0 as f64 + ring, 0.5 * picture.size.1 as f64);
    picture.light(x as usize, y as usize) > 0.95
}
