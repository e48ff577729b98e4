//! Lens: a wet, dirty glass in front of the camera, and light that scatters in it.
//!
//! [`crate::lens`] finds the drops and draws them over the finished picture. Depth, normals and
//! labels stay those of the scene. In fidelity `paper` it is drawn in the same way: the paper has
//! no lens.

use crate::effects::effect::{Effect, EffectContext, EffectRole};
use crate::lens::{Glass, GlassRain, Rainfall};
use crate::param::ParamValue;
use crate::track::Track;

crate::param::params! {
    /// The parameters of the effect.
    struct LensParams {
        /// Distance of the glass from the lens's entrance pupil: 0.03 for drops on the front of a
        /// bare lens, 0.5 for a windscreen.
        distance: f64 = ParamValue::Number(0.5), 0.005 => 1.0, "m";
        /// Diameter of the aperture: 2.2 a phone, 6 a film camera at f/5.6. A drop is blurred by
        /// aperture over distance, radians.
        aperture: f64 = ParamValue::Number(2.2), 0.0 => 50.0, "mm";
        /// Tilt of the glass: 0 stands across the view, 30 has its top 30 degrees nearer to the
        /// camera, as a windscreen.
        tilt: f64 = ParamValue::Number(30.0), -30.0 => 70.0, "deg";
        /// Water that lands on the glass, over its own surface. `auto` is the flux of `rain` onto
        /// the tilted glass of a camera that looks level, with `speed`; wind counts as its mean
        /// over all directions.
        rate: Option<f64> = ParamValue::Auto, 0.0 => 300.0, "mm/h";
        /// Speed of the glass along the view, which meets more drops; for `rate` `auto`.
        speed: f64 = ParamValue::Number(0.0), 0.0 => 100.0, "m/s";
        /// Duration of the rain on the glass before time 0. With 0 the glass is dry at time 0.
        rained_before: f64 = ParamValue::Number(20.0), 0.0 => 36_000.0, "s";
        /// Factor on the radii of drops; their number stays.
        size: f64 = ParamValue::Number(1.0), 0.1 => 5.0, "";
        /// Contact angle of water on the glass: 20 clean, 55 as most glass, 80 waxed. Above 49 the
        /// rims of drops are dark.
        contact_angle: f64 = ParamValue::Number(55.0), 10.0 => 85.0, "deg";
        /// Radius from which a drop runs down the glass.
        runs_from: f64 = ParamValue::Number(2.2), 0.5 => 20.0, "mm";
        /// Time in which a drop of 1 mm radius dries when nothing lands; larger ones take longer by
        /// the square of the radius.
        drying: f64 = ParamValue::Number(300.0), 1.0 => 1_000_000.0, "s";
        /// Share of the glass that dirt covers.
        dirt: f64 = ParamValue::Number(0.0), 0.0 => 1.0, "";
        /// Share of light that dirt lets straight through.
        dirt_transmittance: f64 = ParamValue::Number(0.6), 0.0 => 1.0, "";
        /// Share of light that dirt scatters into the view: a veil against bright sky.
        dirt_scatter: f64 = ParamValue::Number(0.25), 0.0 => 1.0, "";
        /// Factor on the veil around bright sources, `10 E / angle^2` between 1 and 30 degrees
        /// (Vos): 1 is an eye's, a clean lens has 0.2.
        veil: f64 = ParamValue::Number(0.0), 0.0 => 10.0, "";
        /// Seed of the random drops: a whole number.
        seed: f64 = ParamValue::Number(0.0), 0.0 => 9_007_199_254_740_992.0, "";
    }
}

/// The entry of [`EFFECTS`](super::EFFECTS).
pub(crate) const EFFECT: Effect = Effect {
    name: "lens",
    about: "Drops, dirt and scattered light on the glass in front of the camera",
    role: EffectRole::Lens,
    needs: &[],
    precipitation: None,
    params: LensParams::PARAMS,
    contribute: |now, weather| {
        let glass = Box::new(LensParams::of(now.values).glass(now));
        weather.prepared.glass = Some(glass).filter(|glass| !glass.is_clear());
    },
    contribute_as_paper: None,
};

impl LensParams {
    fn glass(&self, now: &EffectContext<'_>) -> Glass {
        let own = |name: &str| EFFECT.param(name).map(|param| &now.tracks[param]);
        let number = |track: Option<&Track>, time: f64| track.and_then(|track| track.at(time).number());
        let (rain, wind) = (now.weather.track("rain", "rate"), now.weather.track("wind", "speed"));
        let (rate, speed, tilt) = (own("rate"), own("speed"), own("tilt"));
        let rainfall = |time: f64| match number(rate, time) {
            Some(rate) => Rainfall::onto_glass(rate),
            None => Rainfall {
                rate: number(rain, time).unwrap_or(0.0),
                wind: number(wind, time).unwrap_or(0.0),
                speed: number(speed, time).unwrap_or(0.0),
                tilt: number(tilt, time).unwrap_or(0.0).to_radians(),
                is_on_glass: false,
            },
        };
        // Whatever is given of the glass, what does not count must not split the time.
        let tracks = match self.rate {
            Some(_) => [rate, None, None, None, None],
            None => [rate, rain, wind, speed, tilt],
        };
        let mut breaks: Vec<f64> = tracks.into_iter().flatten().flat_map(Track::breaks).collect();
        breaks.sort_by(f64::total_cmp);
        breaks.dedup();
        let least = 1e-3 * self.runs_from;
        let rain = GlassRain::new(
            -self.rained_before,
            &breaks,
            rainfall,
            self.contact_angle.to_radians(),
            self.size,
            least,
        );
        Glass {
            distance: self.distance,
            aperture: 1e-3 * self.aperture,
            tilt: self.tilt.to_radians(),
            contact: self.contact_angle.to_radians(),
            runs_from: least,
            drying: self.drying,
            dirt: self.dirt,
            dirt_transmittance: self.dirt_transmittance,
            dirt_scatter: self.dirt_scatter,
            veil: self.veil,
            seed: self.seed as u64,
            time: now.time,
            rain,
        }
    }
}
