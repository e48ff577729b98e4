//! Light: sun and sky over the place, in the place of those that it was captured in.
//!
//! A captured place lies in the light of its photos, with the shadows of their sun. This effect
//! says what light it shall lie in; [`crate::light`] has how the light of each splat follows. The
//! paper has no such thing.
//!
//! Models `clear` and `night` bring sun and sky of their own ([`OpenLight`]), by the place of the
//! sun: given, or that of a day and an hour at the place's latitude and longitude. The others keep
//! the captured sun.
//!
//! Cloud cover `N` takes the beam `1 - N` of the sun, and brings the CIE's overcast sky as a share
//! `N` of the sky. What floats in the air dims the beam by its own optical depth along it; what it
//! takes comes back from all of the sky. Exposure follows the light of level ground in the open,
//! by sun, sky and lamps, not the frame: pans and zooms change no brightness. By night it stays
//! behind, as a camera's does.

use crate::dome::{Dome, OVERCAST_ZENITH, SkyAppearance, overcast_horizon};
use crate::effects::effect::{Effect, EffectContext, EffectRole, Need};
use crate::level::level_axes;
use crate::light::change::{LightChange, MIN_EXPOSED_LX, OVERCAST_EXPOSURE};
use crate::light::{OpenLight, SunPosition};
use crate::optics::{CapturedSky, LampSource, Site};
use crate::param::ParamValue;
use crate::track::Track;
use crate::weather::builder::WeatherBuilder;
use glam::DVec3;
use std::sync::Arc;
use wm_render::hooks::SkySplats;

crate::param::words! {
    /// The source of the light.
    enum LightModel {
        /// The weather decides.
        Auto = "auto",
        /// The light of the photos, with its shadows.
        Captured = "captured",
        /// Clouds from horizon to horizon.
        Overcast = "overcast",
        /// A sun and its sky.
        Clear = "clear",
        /// The sun far below the horizon.
        Night = "night",
    }
}

crate::param::words! {
    /// The light in the photos of a place.
    enum PhotoLight {
        /// As it was found.
        Auto = "auto",
        /// No sun's shadows.
        Diffuse = "diffuse",
    }
}

crate::param::words! {
    /// The lamps that shine.
    enum LampChoice {
        /// The lamps that the scene states, when it is dark.
        Auto = "auto",
        /// The lamps that the scene states, at any time.
        On = "on",
        /// None.
        Off = "off",
        /// As `auto`; where the scene states none, those on its posts, and without posts a row
        /// along the path of the photos.
        Path = "path",
    }
}

crate::param::words! {
    /// Something that is there or not.
    enum Switch {
        /// It is not.
        Off = "off",
        /// It is.
        On = "on",
    }
}

crate::param::params! {
    /// The parameters of the effect.
    struct LightParams {
        /// Light over the place: `auto` (clouds where rain or snow falls, the captured sun dimmed
        /// by fog and haze), `captured` (that of the photos), `overcast`, `clear` (a sun at
        /// `sun_elevation`, or at `hour` and `day`) or `night`.
        model: LightModel = ParamValue::Word("auto"), 0.0 => 0.0, "";
        /// Cloud cover: the share of the sun's beam that is lost, and of the sky that is overcast;
        /// `auto` is the model's. By the weather they gather in the 10 s before it falls.
        clouds: Option<f64> = ParamValue::Auto, 0.0 => 1.0, "";
        /// Exposure against one that brings level ground in the open to its captured brightness;
        /// `auto` is 0.3 EV darker under full clouds, and 3.5 EV at 0.5 lx and less.
        exposure: Option<f64> = ParamValue::Auto, -10.0 => 10.0, "EV";
        /// Elevation of the sun of model `clear`, below 0 under the horizon; `auto` is that of
        /// `hour`, and 45 without one.
        sun_elevation: Option<f64> = ParamValue::Auto, -90.0 => 90.0, "deg";
        /// Azimuth of the sun of model `clear`, clockwise from north (from the scene's x axis where
        /// north is not known); `auto` is that of `hour`, and without one where it lights most of
        /// the place: 180 if no side is better.
        sun_azimuth: Option<f64> = ParamValue::Auto, -36_000.0 => 36_000.0, "deg";
        /// Hour of the day of model `clear`, in mean solar time: the sun is highest at about 12.
        hour: Option<f64> = ParamValue::Auto, -8_760.0 => 8_760.0, "h";
        /// Day of the year for `hour`; `auto` is that of the photos, and 172 (21 June) where they
        /// do not say.
        day: Option<f64> = ParamValue::Auto, 1.0 => 366.0, "";
        /// Latitude for `hour`; `auto` is that of the photos.
        latitude: Option<f64> = ParamValue::Auto, -90.0 => 90.0, "deg";
        /// Haziness of the clear sky: 2 very clear, 3 clear, 6 hazy.
        turbidity: f64 = ParamValue::Number(2.5), 1.0 => 10.0, "";
        /// Light in the photos: `diffuse` says that no sun cast shadows in them, so that a new sun
        /// may; `auto` goes by what was found.
        photos: PhotoLight = ParamValue::Word("auto"), 0.0 => 0.0, "";
        /// Glow of the sky by the lamps of towns, on level ground; `auto` is 0.06, and ten times
        /// that under clouds.
        glow: Option<f64> = ParamValue::Auto, 0.0 => 100.0, "lx";
        /// Lamps and lit windows, with models `clear` and `night`: `auto` (those that the scene
        /// states, when it gets dark), `on`, `off`, or `path` (as `auto`; a scene that states none
        /// gets one on each post that is found, or else a row along the path of its photos).
        lamps: LampChoice = ParamValue::Word("auto"), 0.0 => 0.0, "";
        /// Headlamps of the car that carries the camera.
        headlamps: Switch = ParamValue::Word("off"), 0.0 => 0.0, "";
        /// Shadows of broken clouds that drift with the wind, with model `clear` and `clouds`
        /// between 0 and 1.
        cloud_shadows: Switch = ParamValue::Word("off"), 0.0 => 0.0, "";
    }
}

/// The entry of [`EFFECTS`](super::EFFECTS).
pub(crate) const EFFECT: Effect = Effect {
    name: "light",
    about: "Sun and sky over the place, instead of those of its photos",
    role: EffectRole::Light,
    needs: &[Need::Light],
    precipitation: None,
    params: LightParams::PARAMS,
    contribute: |now, weather| {
        let change = LightParams::of(now.values).change(now, weather.site());
        weather.change_light(change);
    },
    // The paper changes no light; under full clouds its sky is overcast.
    contribute_as_paper: Some(|now, weather| {
        let change = LightParams::of(now.values).change(now, weather.site());
        if change.clouds < 1.0 {
            return;
        }
        let (zenith, horizon) = (OVERCAST_ZENITH, overcast_horizon());
        let look = SkyAppearance::Overcast { zenith, horizon };
        let up = weather.site().up;
        weather.set_sky(Dome::new(look, None, 1.0, up, SkySplats::LeftOut));
    }),
};

/// Rate at which what falls comes from full clouds, mm/h.
const FULL_CLOUDS: f64 = 0.3;
/// Time over which clouds gather before it falls, and steps in which it is looked at, s.
const CLOUD_GATHERING_S: f64 = 10.0;
const CLOUD_GATHERING_STEP_S: f64 = 0.5;
/// Height of air that is as dense above as on the ground, m.
const AIR_HEIGHT_M: f64 = 100.0;

/// Change of exposure by night: what is left is dark, and can be seen.
const NIGHT_EXPOSURE: f64 = -3.5;
/// Illuminances of dusk and of the night, lx, between which the exposure falls behind.
const DUSK_LX: [f64; 2] = [100.0, 0.5];
/// Sun of the model `night`.
const NIGHT_SUN_ELEVATION_DEG: f64 = -30.0;
/// Steps of the sun's place by which its shadows move, degrees.
const SUN_STEP: f64 = 0.5;
/// Lowest sun that casts shadows, degrees.
pub(crate) const LOWEST_SHADOWS: f64 = 0.5;
/// Glow of the sky under no and under full clouds.
const SKY_GLOW_LX: [f64; 2] = [0.06, 0.6];

/// Natural illuminances at which lamps are at full and out.
const LAMP_LX: [f64; 2] = [20.0, 60.0];
/// Cloud cover from which clouds have no gaps to cast shadows with.
const CLOSED_CLOUD_COVER: f64 = 0.97;

/// Mean light of a place by night over that under its lamps, by which cameras expose, so that what
/// is straight under a lamp is bright.
const UNDER_LAMPS: f64 = 0.1;
/// Illuminance of the road that headlamps light, by which cameras expose, lx.
const HEADLAMP_LEVEL: f64 = 12.0;

impl LightParams {
    /// Elevation and azimuth of the sun, degrees.
    fn sun(&self, site: &Site) -> [f64; 2] {
        let mut elevation = 45.0;
        let mut azimuth = None;
        let latitude = self.latitude.or(site.earth.map(|earth| earth.location[0]));
        if let (Some(hour), Some(latitude)) = (self.hour, latitude) {
            let captured = site.earth.and_then(|earth| earth.captured);
            let year = captured.map_or(THIS_YEAR, |time| (time / A_YEAR).floor());
            let new_year = 365.0 * year + ((year + 1.0) / 4.0).floor();
            let of_capture = || captured.map_or(172.0, |time| (time / A_DAY).floor() - new_year + 1.0);
            // At longitude 0 mean solar time is UTC.
            let time = (new_year + self.day.unwrap_or_else(of_capture) - 1.0) * A_DAY + hour * 3600.0;
            if let Ok(sun) = SunPosition::at(latitude, 0.0, time) {
                (elevation, azimuth) = (sun.elevation.to_degrees(), Some(sun.azimuth.to_degrees()));
            }
        }
        let elevation = self.sun_elevation.unwrap_or(elevation);
        let by_place = || {
            let (towards, _) = site.sunny_side.towards(elevation)?;
            let [north, east] = compass(site).map(DVec3::from_array);
            Some(towards.dot(east).atan2(towards.dot(north)).to_degrees().rem_euclid(360.0))
        };
        [elevation, self.sun_azimuth.or(azimuth).or_else(by_place).unwrap_or(180.0)]
    }

    /// The change to a sun and a sky of its own.
    fn open(&self, now: &EffectContext<'_>, site: &Site) -> LightChange {
        let [elevation, azimuth] = match self.model {
            LightModel::Night => [NIGHT_SUN_ELEVATION_DEG, 180.0],
            _ => self.sun(site),
        };
        let [north, east] = compass(site);
        let towards = |azimuth: f64| -> [f64; 3] {
            let (sin, cos) = azimuth.to_radians().sin_cos();
            std::array::from_fn(|k| cos * north[k] + sin * east[k])
        };
        let clouds = self.clouds.unwrap_or(clouds_by_weather(now));
        let glow = self.glow.unwrap_or(SKY_GLOW_LX[0] + (SKY_GLOW_LX[1] - SKY_GLOW_LX[0]) * clouds);
        let depth = depth(now, site);
        let open = OpenLight::new(towards(azimuth), site.up, elevation, self.turbidity, clouds, depth, glow);
        let shines = elevation > LOWEST_SHADOWS && open.light.sun[1] > 0.0;
        let step = |degrees: f64| (degrees / SUN_STEP).round() * SUN_STEP;
        let sun = shines.then(|| {
            let ((sin, cos), level) = (step(elevation).to_radians().sin_cos(), towards(step(azimuth)));
            std::array::from_fn(|k| cos * level[k] + sin * site.up[k])
        });
        let lamps = self.lamps_by(open.level());
        let has_headlamps = self.headlamps == Switch::On;
        let lamp_level = lamps.map_or(0.0, |(source, share)| UNDER_LAMPS * share * site.lamps.of(source))
            + if has_headlamps { HEADLAMP_LEVEL } else { 0.0 };
        let level = (open.level() + lamp_level).max(MIN_EXPOSED_LX);
        let dark = ((DUSK_LX[0] / level).ln() / (DUSK_LX[0] / DUSK_LX[1]).ln()).clamp(0.0, 1.0);
        let exposure = OVERCAST_EXPOSURE * clouds + (NIGHT_EXPOSURE - OVERCAST_EXPOSURE * clouds) * dark;
        let exposure = self.exposure.unwrap_or(exposure);
        let is_diffuse = self.photos == PhotoLight::Diffuse;
        LightChange {
            clouds,
            depth,
            exposure,
            open: Some(Arc::new(open)),
            sun,
            is_diffuse,
            lamps,
            lamp_level,
            has_headlamps,
            has_cloud_shadows: self.cloud_shadows == Switch::On
                && shines
                && (1e-3..CLOSED_CLOUD_COVER).contains(&clouds),
        }
    }

    /// The lamps that shine in a natural light, lx, and the share of theirs.
    fn lamps_by(&self, level: f64) -> Option<(LampSource, f64)> {
        // Eyes and switches go by the logarithm.
        let dark = ((LAMP_LX[1] / level).ln() / (LAMP_LX[1] / LAMP_LX[0]).ln()).clamp(0.0, 1.0);
        let (source, share) = match self.lamps {
            LampChoice::Off => return None,
            LampChoice::On => (LampSource::Scene, 1.0),
            LampChoice::Auto => (LampSource::Scene, dark),
            LampChoice::Path => (LampSource::Path, dark),
        };
        (share > 0.0).then_some((source, share))
    }

    fn change(&self, now: &EffectContext<'_>, site: &Site) -> LightChange {
        if matches!(self.model, LightModel::Clear | LightModel::Night) {
            return self.open(now, site);
        }
        let is_diffuse = self.photos == PhotoLight::Diffuse;
        let captured =
            LightChange { is_diffuse, has_headlamps: self.headlamps == Switch::On, ..LightChange::CAPTURED };
        if is_diffuse || site.captured_sky == CapturedSky::Overcast {
            // It lies in diffuse light already.
            let exposure = self.exposure.unwrap_or(0.0);
            return LightChange { exposure, ..captured };
        }
        let by_weather = match self.model {
            LightModel::Captured => 0.0,
            LightModel::Overcast => 1.0,
            _ => clouds_by_weather(now),
        };
        let clouds = self.clouds.unwrap_or(by_weather);
        let depth = match self.model {
            LightModel::Captured => [0.0; 3],
            _ => depth(now, site),
        };
        let exposure = self.exposure.unwrap_or(OVERCAST_EXPOSURE * clouds);
        LightChange { clouds, depth, exposure, ..captured }
    }
}

/// North and east, level, world axes; of a site whose north is not known, the axis that azimuths
/// count from and the one clockwise of it.
fn compass(site: &Site) -> [[f64; 3]; 2] {
    let [forward, right, _] = level_axes(site.up);
    site.earth.map_or([forward, right], |earth| {
        let [north, up] = [earth.north, site.up].map(DVec3::from_array);
        [north, north.cross(up)].map(|axis| axis.to_array())
    })
}

/// Cloud cover by all that falls: it gathers before, and goes after.
fn clouds_by_weather(now: &EffectContext<'_>) -> f64 {
    let falls = now.weather.effects().filter(|(effect, _)| effect.role == EffectRole::Falls);
    let rates: Vec<&Track> = falls.filter_map(|(effect, _)| now.weather.track(effect.name, "rate")).collect();
    let cover = |time: f64| {
        let rate: f64 = rates.iter().filter_map(|rate| rate.at(time).number()).sum();
        (rate / FULL_CLOUDS).min(1.0) * (1.0 - (time - now.time).abs() / CLOUD_GATHERING_S).max(0.0)
    };
    // Fixed instants, so that nothing steps as time goes on.
    let first = ((now.time - CLOUD_GATHERING_S) / CLOUD_GATHERING_STEP_S).ceil();
    let around = (0..=(2.0 * CLOUD_GATHERING_S / CLOUD_GATHERING_STEP_S) as u32)
        .map(|k| CLOUD_GATHERING_STEP_S * (first + f64::from(k)));
    let keys = rates.iter().flat_map(|rate| rate.keys()).map(|key| key.time);
    around.chain(keys).chain([now.time]).map(cover).fold(0.0, f64::max)
}

/// Optical depth of the air straight up.
fn depth(now: &EffectContext<'_>, site: &Site) -> [f64; 3] {
    let mut air = WeatherBuilder::new(*site, now.time);
    for (effect, values) in now.weather.effects().filter(|(effect, _)| effect.role == EffectRole::Air) {
        (effect.contribute)(&EffectContext { values, ..*now }, &mut air);
    }
    let mut sum = [0.0; 3];
    for layer in &air.prepared.floating {
        let height = if layer.scale_height.is_finite() { layer.scale_height } else { AIR_HEIGHT_M };
        (0..3).for_each(|k| sum[k] += layer.sigma_t[k] * height);
    }
    sum
}

const A_DAY: f64 = 86_400.0;
/// Mean year of the Gregorian calendar, s.
const A_YEAR: f64 = 31_556_952.0;
/// The year of places that do not say when they were captured, from 1970: 2026.
const THIS_YEAR: f64 = 56.0;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::SITE;
    use crate::{Weather, optics::EarthPlace};
    use wm_base::color::luminance;

    fn change(text: &str, site: &Site) -> LightChange {
        let weather = Weather::parse(&format!("[light]\n{text}\n"), "test").unwrap();
        weather.at(0.0).prepare(site).light().unwrap().clone()
    }

    fn utrecht() -> Site {
        let place = EarthPlace { north: [0.0, 1.0, 0.0], location: [52.1, 5.2], captured: None };
        Site { earth: Some(place), ..SITE }
    }

    /// At the summer solstice the sun over a latitude stands 90 - latitude + 23.4 degrees high in
    /// the south.
    #[test]
    fn the_hour_places_the_sun() {
        let open = change("model = 'clear'\nhour = 12", &utrecht()).open.unwrap();
        assert!((open.sin_sun.asin().to_degrees() - 61.4).abs() < 0.3, "{}", open.sin_sun);
        assert!(open.sun[1] < -0.45 && open.sun[0].abs() < 0.03, "{:?}", open.sun);
        let morning = change("model = 'clear'\nhour = 7", &utrecht()).open.unwrap();
        assert!(morning.sun[0] > 0.5, "{:?}", morning.sun);
        let south = change("model = 'clear'\nhour = 12\nlatitude = -35", &utrecht()).open.unwrap();
        assert!(south.sun[1] > 0.5, "{:?}", south.sun);
    }

    /// A shower that begins at once: the clouds are there when it does, and never jump.
    #[test]
    fn clouds_gather_before_the_rain() {
        let text =
            "[light]\nmodel = 'clear'\n[rain]\nrate = { keys = [[30, 0, 'hold'], [30.001, 20], [60, 0]] }\n";
        let weather = Weather::parse(text, "test").unwrap();
        let clouds = |time: f64| weather.at(time).prepare(&SITE).light().unwrap().clouds;
        assert_eq!([clouds(0.0), clouds(30.5), clouds(80.0)], [0.0, 1.0, 0.0]);
        assert!((clouds(25.0) - 0.5).abs() < 1e-3, "{}", clouds(25.0));
        for step in 0..800 {
            let time = 0.1 * f64::from(step);
            assert!((clouds(time + 0.1) - clouds(time)).abs() < 0.011, "{time}");
        }
    }

    /// A white card on level ground, from noon into the night and into clouds: no step, and darker
    /// only when there is little light.
    #[test]
    fn exposure_follows_the_light_without_a_jump() {
        let card = |elevation: f64, clouds: f64| {
            let change =
                change(&format!("model = 'clear'\nsun_elevation = {elevation}\nclouds = {clouds}"), &SITE);
            let open = change.open.as_ref().unwrap();
            luminance(open.light.irradiance(open.sin_sun)) * change.display(&SITE)
        };
        assert!((card(50.0, 0.0) - 1.0).abs() < 1e-9 && (card(50.0, 1.0) - 0.812).abs() < 1e-3);
        let mut before = card(60.0, 0.0);
        for step in 1..=800 {
            let now = card(60.0 - 0.1 * f64::from(step), 0.0);
            assert!(now <= before + 1e-12 && now > 0.88 * before, "{step}: {before} to {now}");
            before = now;
        }
        assert!((before - NIGHT_EXPOSURE.exp2()).abs() < 1e-9, "{before}");
    }
}
