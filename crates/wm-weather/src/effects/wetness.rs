//! Wetness: surfaces darken by the rain and the melt water that have reached them, and dry after
//! it.
//!
//! [`crate::wetness`] computes how much water is where, and how it looks. In fidelity `paper`
//! nothing gets wet.

use crate::effects::effect::{Effect, EffectContext, EffectRole, Need};
use crate::effects::snow_cover;
use crate::level::{from_level, level_axes};
use crate::optics::Site;
use crate::param::ParamValue;
use crate::particles::{LEAST_RATE, ParticleAppearance, Precipitation, RAIN};
use crate::track::Track;
use crate::weather::slant::fall_of;
use crate::wetness::drying::penman;
use crate::wetness::timeline::RainHistory;
use crate::wetness::{SlantedRain, WetRequest, driving_rain};

crate::param::params! {
    /// The parameters of the effect.
    struct WetnessParams {
        /// Wetness of what rain reaches: at 0.5 pores are full of water, at 1 a film stands on the
        /// ground. `auto` goes by the rain so far, with `rained_before`, by the snow of
        /// `snow_cover` that has melted, and by what has dried since.
        amount: Option<f64> = ParamValue::Auto, 0.0 => 1.0, "";
        /// Share of the water that the hollows of the ground can hold; `auto` goes by the rain so
        /// far, or by `amount` above 0.5 if that is given.
        puddles: Option<f64> = ParamValue::Auto, 0.0 => 1.0, "";
        /// Duration of the rain before time 0. With 0 the ground is dry when the rain of the
        /// weather begins.
        rained_before: f64 = ParamValue::Number(10.0), 0.0 => 10_000.0, "min";
        /// Rain before time 0; `auto` is `rain.rate` at time 0.
        rate_before: Option<f64> = ParamValue::Auto, 0.0 => 300.0, "mm/h";
        /// Time between the end of that rain and time 0.
        stopped: f64 = ParamValue::Number(0.0), 0.0 => 10_000.0, "min";
        /// Factor on how much surfaces darken: 1 for stone, concrete, asphalt and soil; less for
        /// paint and metal. Leaves have 0.3 times of it.
        porosity: f64 = ParamValue::Number(1.0), 0.0 => 1.0, "";
        /// Mean depth of the texture of the ground, which holds water before a film stands on it:
        /// asphalt 0.5 to 1, smooth stone 0.2.
        texture: f64 = ParamValue::Number(0.8), 0.05 => 10.0, "mm";
        /// Share of the water of roofs that falls from their eaves in drops: 1 where there are no
        /// gutters, 0 where these take it all. The drops are drawn if `splash` is on.
        eaves: f64 = ParamValue::Number(0.0), 0.0 => 1.0, "";
        /// Drying of wet ground when it does not rain; `auto` by Penman from `temperature`,
        /// `humidity`, `radiation` and the wind.
        drying: Option<f64> = ParamValue::Auto, 0.0 => 10.0, "mm/h";
        /// Temperature of the air.
        temperature: f64 = ParamValue::Number(15.0), -40.0 => 60.0, "degC";
        /// Relative humidity of the air after the rain.
        humidity: f64 = ParamValue::Number(0.75), 0.0 => 1.0, "";
        /// Net radiation on the ground: 400 under bright clouds, 600 on a summer noon, -30 by
        /// night. `auto` is 150, with model `clear` of `light` that of its sun, and -30 by night.
        radiation: Option<f64> = ParamValue::Auto, -200.0 => 1200.0, "W/m^2";
        /// Time lapse: seconds of wetting and drying in one of the shot; 60 for a minute a second.
        /// With snow that melts it must be that of `snow_cover`.
        lapse: f64 = ParamValue::Number(1.0), 0.0 => 1_000_000.0, "";
    }
}

/// The entry of [`EFFECTS`](super::EFFECTS).
pub(crate) const EFFECT: Effect = Effect {
    name: "wetness",
    about: "Ground and walls that rain and melting snow wet, and puddles that fill",
    role: EffectRole::Water,
    needs: &[Need::Shelter, Need::Light, Need::Water],
    precipitation: None,
    params: WetnessParams::PARAMS,
    contribute: |now, weather| {
        let request = WetnessParams::of(now.values).request(now, weather.site());
        weather.prepared.wetness = Some(request);
    },
    contribute_as_paper: Some(|_, weather| weather.prepared.wetness = Some(dry(weather.site()))),
};

/// Net radiation where nothing says what it is, and by night, W/m^2; the share of the light of the
/// sun and the sky that is left of it.
const USUAL_RADIATION: f64 = 150.0;
const NIGHT_RADIATION: f64 = -30.0;
const NET_SHARE: f64 = 0.65;
/// Rain of a weather that says none, mm/h: how it slants.
const DEFAULT_RAIN_RATE: f64 = 10.0;

/// A request that wets nothing.
fn dry(site: &Site) -> WetRequest {
    let rain = SlantedRain { fall: site.up.map(|v| -v), driving: [0.0; 3] };
    WetRequest {
        steps: Vec::new(),
        amount: None,
        puddles: None,
        porosity: 0.0,
        texture: 1.0,
        eaves: 0.0,
        rain,
    }
}

impl WetnessParams {
    fn request(&self, now: &EffectContext<'_>, site: &Site) -> WetRequest {
        let rate = now.weather.track("rain", "rate");
        let at_start = rate.map_or(0.0, |rate| rate.at(0.0).number().unwrap_or(0.0));
        let before = self.rate_before.unwrap_or(at_start);
        let wind = |param: &str| {
            let value = now.weather.track("wind", param).and_then(|track| track.at(0.0).number());
            value.unwrap_or(0.0)
        };
        let (speed, heading) = (wind("speed"), wind("direction").to_radians());
        let (sin, cos) = heading.sin_cos();
        // One direction for all times, so that no edge of what is dry jumps.
        let most = rate.map_or(0.0, Track::most).max(before);
        let most = if most >= LEAST_RATE { most } else { DEFAULT_RAIN_RATE };
        let drops = Precipitation::new(&RAIN, most, site.airlight, ParticleAppearance::default());
        let fall = fall_of([speed * cos, speed * sin], drops.mean_speed(), site.up);
        let driving = driving_rain(speed, most);
        let driving = from_level(&level_axes(site.up), [driving * cos, driving * sin, 0.0]);
        let dries = self
            .drying
            .unwrap_or_else(|| penman(self.temperature, self.humidity, speed, self.radiation(now)));
        let history = RainHistory {
            rate,
            before: [before, self.rained_before / 60.0],
            stopped: self.stopped / 60.0,
            // The air is full of water while it rains.
            drying: [0.0, dries],
            lapse: self.lapse,
            snow: snow_cover::snowpack(now.weather),
        };
        WetRequest {
            steps: history.steps(now.time),
            amount: self.amount,
            puddles: self.puddles,
            porosity: self.porosity,
            texture: self.texture,
            eaves: self.eaves,
            rain: SlantedRain { fall, driving },
        }
    }

    /// Net radiation on the ground, W/m^2.
    fn radiation(&self, now: &EffectContext<'_>) -> f64 {
        let light = |param: &str| now.weather.track("light", param).map(|track| track.at(now.time));
        let by_light = match light("model") {
            Some(ParamValue::Word("night")) => NIGHT_RADIATION,
            Some(ParamValue::Word("clear")) => {
                let elevation = light("sun_elevation").and_then(|value| value.number()).unwrap_or(45.0);
                let clouds = light("clouds").and_then(|value| value.number()).unwrap_or(0.0);
                global_radiation(elevation.to_radians().sin(), clouds)
            }
            _ => USUAL_RADIATION,
        };
        self.radiation.unwrap_or(by_light)
    }
}

/// Net radiation under a sun of this sine of elevation, W/m^2: Haurwitz's clear sky, less by clouds
/// as Kasten and Czeplak found.
fn global_radiation(sin: f64, clouds: f64) -> f64 {
    if sin <= 0.0 {
        return NIGHT_RADIATION;
    }
    (NET_SHARE * 1098.0 * sin * (-0.057 / sin).exp() * (1.0 - 0.75 * clouds.powf(3.4))).max(NIGHT_RADIATION)
}
