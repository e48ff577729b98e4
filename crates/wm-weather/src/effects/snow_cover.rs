//! Snow cover: snow that lies, as deep as is asked for on open level ground, or as what has fallen
//! is.
//!
//! Spreading, sliding and drawing: [`crate::cover`]. Growth, settling and melting:
//! [`crate::cover::snowpack`]. In fidelity `paper` it is [`PaperCover`]: no depth, and snow on all
//! that looks up.

use crate::cover::{CoverMaterial, CoverRequest, Snowpack};
use crate::effects::effect::{Effect, EffectRole, Need, WeatherSample};
use crate::paper::PaperCover;
use crate::paper::cover::{MAX_SNOW_SPLATS, USUAL_DARTS};
use crate::param::ParamValue;

/// Wind that carries dry and wet snow along the ground, m/s at 10 m, and the air in which it is
/// wet, degrees Celsius.
const DRIFT_WIND_SPEEDS: [f64; 2] = [7.7, 9.9];
const WET_SNOW_CELSIUS: f64 = -1.0;

crate::param::params! {
    /// The parameters of the effect.
    struct SnowCoverParams {
        /// Depth on open level ground, less what melts. Below some 2 cm the ground shows between
        /// flakes. Over time by keyframes: what it grows by is new snow; `auto` for what
        /// `snowfall.rate` has left: so many `hours` of it before the start, and what has fallen
        /// since.
        depth: Option<f64> = ParamValue::Number(0.1), 0.0 => 10.0, "m";
        /// For a depth of `auto`: how long it had snowed before time 0, as it does then.
        hours: f64 = ParamValue::Number(6.0), 0.0 => 1000.0, "h";
        /// Temperature of the air. Above 0 snow melts, 4 mm of water a day and degree, half as fast
        /// in full shade, and leaves the ground wet for some hours; between -1 and 1 it sticks to
        /// walls that the wind throws it at.
        temperature: f64 = ParamValue::Number(-2.0), -40.0 => 40.0, "degC";
        /// Density of new snow; 100 makes 1 cm of 1 mm of water. `auto` follows the temperature: 92
        /// at -2 degrees. It settles towards 300 in some days.
        density: Option<f64> = ParamValue::Auto, 20.0 => 600.0, "kg/m^3";
        /// Time lapse: seconds of falling, settling and melting in one of the shot; 3600 for an
        /// hour a second.
        lapse: f64 = ParamValue::Number(1.0), 0.0 => 1_000_000.0, "";
        /// Steepest that it lies. Dry snow 38 to 50, wet snow more.
        repose: f64 = ParamValue::Number(42.0), 5.0 => 80.0, "deg";
        /// Share of the light that it throws back: fresh snow 0.9, old 0.5.
        albedo: f64 = ParamValue::Number(0.9), 0.0 => 1.0, "";
        /// Fidelity `paper`, as all that follow: least cosine between up and the normal of a splat
        /// that holds snow.
        paper_seed_cosine: f64 = ParamValue::Number(0.5), 0.0 => 1.0, "";
        /// Steepest plane that is filled.
        paper_fill_angle: f64 = ParamValue::Number(30.0), 0.0 => 90.0, "deg";
        /// k: neighbours that a plane is estimated from.
        paper_k: f64 = ParamValue::Number(16.0), 3.0 => 64.0, "";
        /// Weight of sigma / mean in the radius of a plane.
        paper_spread: f64 = ParamValue::Number(2.0), 0.0 => 100.0, "";
        /// Distance between Gaussians of snow, in median distances of neighbours.
        paper_spacing: f64 = ParamValue::Number(0.5), 0.05 => 10.0, "";
        /// Standard deviations from the mean at which a Gaussian is an outlier.
        paper_outlier_sigmas: f64 = ParamValue::Number(2.0), 0.0 => 100.0, "";
        /// Neighbours that no outlier has.
        paper_outlier_neighbours: f64 = ParamValue::Number(6.0), 0.0 => 64.0, "";
        /// Standard deviation of a Gaussian of snow along its plane, in spacings.
        paper_size: f64 = ParamValue::Number(0.7), 0.01 => 10.0, "";
        /// The same across the plane against that.
        paper_flatness: f64 = ParamValue::Number(0.2), 0.001 => 1.0, "";
        /// Height above the covered surface, in spacings.
        paper_lift: f64 = ParamValue::Number(0.25), 0.0 => 10.0, "";
        /// Its opacity.
        paper_opacity: f64 = ParamValue::Number(0.97), 0.0 => 1.0, "";
        /// Its colour, sRGB.
        paper_color: Option<[f64; 3]> = ParamValue::Auto, 0.0 => 1.0, "";
        /// Seed of the random filling: a whole number.
        paper_seed: f64 = ParamValue::Number(0.0), 0.0 => 9_007_199_254_740_992.0, "";
    }
}

/// The entry of [`EFFECTS`](super::EFFECTS).
pub(crate) const EFFECT: Effect = Effect {
    name: "snow_cover",
    about: "Snow that lies: on what is open to the sky, sliding off what is steep",
    role: EffectRole::Lies,
    needs: &[Need::Cover],
    precipitation: None,
    params: SnowCoverParams::PARAMS,
    contribute: |now, weather| {
        let SnowCoverParams { depth, repose, albedo, temperature, .. } = SnowCoverParams::of(now.values);
        let pack = snowpack(now.weather).expect("its own").at(now.time);
        // In the shade blue sky is all that is left.
        let material = CoverMaterial::at([albedo; 3], [0.34, 0.37, 0.44], 0.95, weather.site());
        weather.add_cover(CoverRequest {
            depth: depth.unwrap_or_else(|| stepped(pack.fell.depth())),
            // What is wet by itself needs no wet ground of the snow's own.
            thaw: pack.thaw().map(|thaw| if now.weather.is_on("wetness") { thaw.dry() } else { thaw }),
            wet_fall: stepped(pack.wet_fall()),
            repose: repose.to_radians().tan(),
            threshold: DRIFT_WIND_SPEEDS[usize::from(temperature > WET_SNOW_CELSIUS)],
            material,
        });
    },
    contribute_as_paper: Some(|now, weather| {
        let params = SnowCoverParams::of(now.values);
        weather.prepared.paper_cover = Some(PaperCover {
            seed_cosine: params.paper_seed_cosine,
            fill_angle: params.paper_fill_angle,
            neighbours: params.paper_k as usize,
            spread: params.paper_spread,
            spacing: params.paper_spacing,
            outlier_sigmas: params.paper_outlier_sigmas,
            outlier_neighbours: params.paper_outlier_neighbours as usize,
            size: params.paper_size,
            flatness: params.paper_flatness,
            lift: params.paper_lift,
            opacity: params.paper_opacity,
            // 0.82, 0.85 and 0.88 in linear light.
            color: params.paper_color.map_or([0.92, 0.93, 0.95], |rgb| rgb.map(|v| v as f32)),
            seed: params.paper_seed as u64,
            darts: USUAL_DARTS,
            most: MAX_SNOW_SPLATS,
        });
    }),
};

/// The snow of a weather over time; `None` if none lies at any time.
pub(crate) fn snowpack(weather: &WeatherSample) -> Option<Snowpack<'_>> {
    let own = |param| weather.track("snow_cover", param);
    let number = |param| own(param)?.at(weather.time).number();
    let (depth, temperature) = (own("depth")?, own("temperature")?);
    Some(Snowpack {
        depth: depth.at(weather.time).number().map(|_| depth),
        rate: weather.track("snowfall", "rate"),
        temperature,
        density: number("density"),
        hours: number("hours")?,
        lapse: number("lapse")?,
    })
}

/// Depths in steps of 0.3 %, so that what changes by less is not laid out anew.
fn stepped(depth: f64) -> f64 {
    if depth < 1e-5 { 0.0 } else { ((depth.log2() * 256.0).round() / 256.0).exp2() }
}
