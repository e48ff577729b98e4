//! Glare: light of lamps that glass, dust and the edges of the aperture scatter over the picture.
//!
//! A lamp that lights the lens with `E` lux veils the picture at the angle `t`, degrees, with the
//! luminance `s 10 E / (t^2 + 0.25)` (Vos, for an eye: `s` = 1), and draws rays across the straight
//! edges of the aperture: of `n` edges of length `a` about an area `A`, each throws
//! `a l / (4 pi^2 A t^2)` of the light into a line of a pixel's width, per radian along it, to both
//! sides (Fraunhofer's diffraction at light of the wavelength `l`). Lamps that something hides from
//! the lens give none. Only the camera itself has glare, not what water mirrors for it.
//!
//! Sources: Vos, "On the cause of disability glare and its dependence on glare angle, age and
//! ocular pigmentation", Clin. Exp. Optom. 86 (2003); Born and Wolf, "Principles of Optics", 8.5.

use super::light_in_picture::add_light;
use crate::effects::effect::{Effect, EffectRole};
use crate::light::{LampKind, SeenLight, ShadowedLight};
use crate::param::ParamValue;
use crate::weather::observer::Observer;
use crate::weather::prepared::{PixelContribution, PreparedWeather};
use glam::{DVec2, DVec3};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;
use wm_render::hooks::{Medium, PixelBatch, PixelEffect};
use wm_render::simd::SimdPath;
use wm_scene::Camera;

crate::param::params! {
    /// The parameters of the effect.
    struct GlareParams {
        /// Light that glass and dust scatter: 1 is an eye's, 0.2 a clean lens's, 3 a dirty one's.
        scatter: f64 = ParamValue::Number(0.3), 0.0 => 20.0, "";
        /// Straight edges of the aperture, whose rays a lamp shows: as many if it is an even
        /// number, else twice as many. 0 is a round aperture, without rays.
        blades: f64 = ParamValue::Number(7.0), 0.0 => 24.0, "";
        /// Diameter of the aperture: 2.2 a phone, 6 a film camera at f/5.6. Small ones have longer
        /// rays.
        aperture: f64 = ParamValue::Number(6.0), 0.1 => 50.0, "mm";
        /// Turn of the aperture about the view.
        turn: f64 = ParamValue::Number(11.0), -180.0 => 180.0, "deg";
    }
}

/// The entry of [`EFFECTS`](super::EFFECTS).
pub(crate) const EFFECT: Effect = Effect {
    name: "glare",
    about: "Veil and rays of lamps in the lens, by night",
    role: EffectRole::Lens,
    needs: &[],
    precipitation: None,
    params: GlareParams::PARAMS,
    contribute: |now, weather| {
        let params = GlareParams::of(now.values);
        weather.prepared.pixels.push(Arc::new(Glare { params }));
    },
    contribute_as_paper: Some(|_, _| {}),
};

/// Wavelength of the rays, mm: that of green light.
const WAVELENGTH_MM: f64 = 550e-6;
/// Angle within which the veil is even, degrees.
const CORE_DEG: f64 = 0.5;
/// Light that is left out, in units of display white.
const MIN_LIGHT: f64 = 2e-4;
/// Standard deviation of a ray's width, px.
const RAY_WIDTH_PX: f64 = 0.7;

/// Glare of a lens.
#[derive(Debug)]
struct Glare {
    params: GlareParams,
}

impl PixelContribution for Glare {
    fn in_pass<'a>(
        &'a self,
        weather: &'a PreparedWeather,
        observer: &Observer<'a>,
    ) -> Option<Box<dyn PixelEffect + 'a>> {
        let lamps = observer.lamps.filter(|_| !observer.is_within)?;
        let camera = observer.camera;
        let GlareParams { scatter, blades, aperture, turn } = self.params;
        let blades = blades.round();
        // Of both sides of an edge.
        let sides = if blades % 2.0 == 0.0 { blades } else { 2.0 * blades };
        let half = PI / blades.max(1.0);
        let (edge, area) = (aperture * half.sin(), 0.125 * blades * aperture * aperture * (2.0 * half).sin());
        let ray = if blades >= 3.0 { edge * WAVELENGTH_MM / (4.0 * PI * PI * area) } else { 0.0 };
        // Two edges across from each other throw their light into the same rays.
        let ray = if blades % 2.0 == 0.0 { 2.0 * ray } else { ray };
        let source = |(light, cube): &ShadowedLight<'_>| {
            if !matches!(light.kind, LampKind::Ball | LampKind::Window) {
                return None;
            }
            let SeenLight { view, pixel, to_eye, length } = light.seen_by(camera, 0.0)?;
            let towards = to_eye.normalize_or_zero();
            let open = cube.map_or(1.0, |cube| f64::from(cube.open(to_eye.as_vec3())));
            let metres = (length * weather.site().metres_per_unit).max(f64::from(light.radius));
            let air =
                weather.air.evaluate_reference(camera.center().to_array(), (-towards).to_array(), length);
            let share =
                f64::from(light.share(towards.as_vec3())) * open * view.z / length / (metres * metres);
            // A luminance of L is shown as pi L.
            let lux = PI * f64::from(lamps.display) * share;
            let light: [f64; 3] =
                std::array::from_fn(|k| f64::from(light.intensity[k]) * lux * air.transmittance[k]);
            let most = light.iter().copied().fold(0.0, f64::max);
            let peak = 10.0 * scatter / (CORE_DEG * CORE_DEG) + ray * (camera.fx * camera.fy).powf(1.5);
            (most * peak > MIN_LIGHT).then(|| Source { towards: view / length, at: pixel, light })
        };
        let sources: Vec<Source> = lamps.lights.iter().filter_map(source).collect();
        (!sources.is_empty()).then(|| {
            let step = TAU / sides.max(1.0);
            let turn = turn.to_radians();
            Box::new(GlareInLens { camera: *camera, sources, scatter, ray, step, turn })
                as Box<dyn PixelEffect>
        })
    }
}

/// A lamp in front of a lens.
struct Source {
    /// Direction to the source in camera axes, length 1.
    towards: DVec3,
    /// Position in the picture, px.
    at: DVec2,
    /// Display value of the luminance of a lux, over pi, by channel.
    light: [f64; 3],
}

/// The glare of one picture.
struct GlareInLens {
    camera: Camera,
    sources: Vec<Source>,
    scatter: f64,
    /// Light in a ray at an angle of a radian, per radian.
    ray: f64,
    /// Angle from ray to ray, and of the first, radians.
    step: f64,
    turn: f64,
}

impl GlareInLens {
    /// The share of a lamp's light in the direction of a pixel, as a luminance over that on the
    /// lens.
    fn share(&self, source: &Source, pixel: DVec2, towards: DVec3) -> f64 {
        let radians = source.towards.distance(towards);
        let degrees = radians.to_degrees();
        let veil = self.scatter * 10.0 / (degrees * degrees + CORE_DEG * CORE_DEG);
        if self.ray <= 0.0 {
            return veil;
        }
        let from = pixel - source.at;
        let turn = (from.y.atan2(from.x) - self.turn).rem_euclid(self.step);
        let apart = turn.min(self.step - turn).sin() * from.length() / RAY_WIDTH_PX;
        if apart > 4.0 {
            return veil;
        }
        // The line's light over the width of the ray, at least a pixel from the lamp.
        let pixel = 1.0 / (self.camera.fx * self.camera.fy).sqrt();
        let width = RAY_WIDTH_PX * pixel * TAU.sqrt();
        let along = radians.max(pixel);
        veil + self.ray / (along * along * width) * (-0.5 * apart * apart).exp()
    }
}

impl PixelEffect for GlareInLens {
    fn apply(&self, _: SimdPath, pixels: &mut PixelBatch<'_>) {
        let Camera { fx, fy, cx, cy, .. } = self.camera;
        add_light(pixels, |_, _, at| {
            let towards = DVec3::new((at.x - cx) / fx, (at.y - cy) / fy, 1.0).normalize();
            let mut sum = [0.0; 3];
            for source in &self.sources {
                let share = self.share(source, at, towards);
                (0..3).for_each(|k| sum[k] += share * source.light[k]);
            }
            sum.iter().any(|light| *light >= MIN_LIGHT).then_some(sum)
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Site;
    use crate::effects::light_in_picture;
    use crate::light::{LampLight, LampsOn};
    use crate::testing::weather;

    /// The gain of the middle of a patch that looks `degrees` off a lamp of 1000 cd, 10 m away.
    fn gain(text: &str, degrees: [f64; 2]) -> f64 {
        let prepared = weather(text.split(' ')).at(0.0).prepare(&Site::PLAIN);
        let (at, intensity, kind) = ([0.0, 10.0, 0.0], [1000.0; 3], LampKind::Ball);
        let lamp = LampLight { at, intensity, radius: 0.05, kind, ..LampLight::DARK };
        let lights = [(lamp, None)];
        let lamps = LampsOn { lights: &lights, display: 1e-4 };
        let camera = Camera::looking((400, 400), 40.0, DVec3::ZERO, DVec3::Y, DVec3::Z).unwrap();
        let observer = Observer { lamps: Some(&lamps), ..Observer::at_rest(&camera) };
        let Some(effect) = prepared.pixels[0].in_pass(&prepared, &observer) else { return 0.0 };
        let [right, down] = degrees.map(|angle| camera.fx * angle.to_radians().tan());
        light_in_picture::gain(&*effect, [camera.cx + right, camera.cy + down].map(|side| side as u32))
    }

    /// 10 lux at the lens, and Vos's veil at 5 and 10 degrees.
    #[test]
    fn the_veil_has_the_luminance_of_its_law() {
        for degrees in [5.0, 10.0] {
            let seen = gain("glare.scatter=1 glare.blades=0", [degrees, 0.0]);
            let want = PI * 1e-4 * 10.0 * 10.0 / (degrees * degrees + CORE_DEG * CORE_DEG);
            assert!((seen / want - 1.0).abs() < 0.03, "{degrees}: {seen} is not {want}");
        }
        assert_eq!(gain("glare.scatter=0 glare.blades=0", [5.0, 0.0]), 0.0);
    }

    /// Six edges: a ray to the right and none at 30 degrees of it, which falls by the square.
    #[test]
    fn rays_stand_across_the_edges() {
        let text = "glare.scatter=0 glare.blades=6 glare.turn=0 glare.aperture=0.5";
        let [near, far] = [2.0, 4.0].map(|degrees| gain(text, [degrees, 0.0]));
        assert!(near > 0.0 && (near / far / 4.0 - 1.0).abs() < 0.1, "{near} {far}");
        assert_eq!(gain(text, [1.73, 1.0]), 0.0);
    }
}
