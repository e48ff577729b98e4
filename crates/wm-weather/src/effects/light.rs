//! Light: sun and sky over the place, in the place of those that it was captured in.
//!
//! A captured place lies in the light of its photos, with the shadows of their sun. This effect says what light it shall
//! lie in; [`crate::light`] has how the light of each splat follows. The paper has no such thing.
//!
//! Cloud cover `N` takes the beam `1 - N` of the sun, and brings the CIE's overcast sky as a share `N` of the sky. What
//! floats in the air dims the beam by its own optical depth along it; what it takes comes back from all of the sky.
//! Exposure follows the light of level ground in the open, not the frame: pans and zooms change no brightness.

use super::sky::overcast_zenith;
use crate::dome::{Dome, SkyAppearance};
use crate::effects::{Action, Effect, EffectContext, EffectRole, Need};
use crate::light::{CaptureLight, SceneLight, SkyGradation};
use crate::optics::{CapturedSky, Site};
use crate::param::ParamValue;
use wm_render::hooks::{SkySplats, Slot};

crate::words! {
    /// The source of the light.
    pub enum LightModel {
        /// The weather decides.
        Auto = "auto",
        /// That of the photos, with its shadows.
        Captured = "captured",
        /// Clouds from horizon to horizon.
        Overcast = "overcast",
    }
}

crate::params! {
    /// The parameters of the effect.
    pub struct LightParams {
        /// Light over the place: `auto` (clouds where rain or snow falls, the captured sun dimmed by fog and haze),
        /// `captured` (that of the photos) or `overcast`.
        model: LightModel = ParamValue::Word("auto"), 0.0 => 0.0, "";
        /// Cloud cover: the share of the sun's beam that is lost, and of the sky that is overcast; `auto` is the
        /// model's.
        clouds: Option<f64> = ParamValue::Auto, 0.0 => 1.0, "";
        /// Exposure against one that brings level ground in the open to its captured brightness; `auto` is 0.3 EV
        /// darker under full clouds.
        exposure: Option<f64> = ParamValue::Auto, -10.0 => 10.0, "EV";
    }
}

/// The entry of [`EFFECTS`](super::EFFECTS).
pub const EFFECT: Effect = Effect {
    name: "light",
    about: "Sun and sky over the place, instead of those of its photos",
    role: EffectRole::Light,
    needs: &[Need::Light],
    precipitation: None,
    slot: Slot::Light,
    params: LightParams::PARAMS,
    act: |now, site| Action::Light(LightParams::of(now.values).change(now, site)),
    act_as_paper: None,
};

/// Change of exposure under full clouds: a camera that follows the light keeps some of the gloom.
const OVERCAST_EXPOSURE: f64 = -0.3;
/// Rate at which what falls comes from full clouds, mm/h.
const FULL_CLOUDS: f64 = 0.3;
/// Height of air that is as dense above as on the ground, m.
const HIGH: f64 = 100.0;

/// A change of the light over a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightChange {
    /// Cloud cover, 0-1.
    pub clouds: f64,
    /// Optical depth of the air straight up, by channel.
    pub depth: [f64; 3],
    /// Exposure, EV.
    pub exposure: f64,
}

impl LightParams {
    fn change(&self, now: &EffectContext<'_>, site: &Site) -> LightChange {
        if site.captured_sky == CapturedSky::Overcast {
            // It lies in diffuse light already.
            return LightChange { clouds: 0.0, depth: [0.0; 3], exposure: self.exposure.unwrap_or(0.0) };
        }
        let by_weather = match self.model {
            LightModel::Captured => 0.0,
            LightModel::Overcast => 1.0,
            LightModel::Auto => (falling(now) / FULL_CLOUDS).min(1.0),
        };
        let clouds = self.clouds.unwrap_or(by_weather);
        let depth = match self.model {
            LightModel::Captured => [0.0; 3],
            LightModel::Auto | LightModel::Overcast => depth(now, site),
        };
        LightChange { clouds, depth, exposure: self.exposure.unwrap_or(OVERCAST_EXPOSURE * clouds) }
    }
}

/// Rate of all that falls, mm/h.
fn falling(now: &EffectContext<'_>) -> f64 {
    let falls = now.weather.effects().filter(|(effect, _)| effect.role == EffectRole::Falls);
    let rate = |(effect, values): (&Effect, &[ParamValue])| values[effect.param("rate")?].number();
    falls.filter_map(rate).sum()
}

/// Optical depth of the air straight up.
fn depth(now: &EffectContext<'_>, site: &Site) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for (effect, values) in now.weather.effects().filter(|(effect, _)| effect.role == EffectRole::Air) {
        if let Action::Layer(layer) = (effect.act)(&EffectContext { values, ..*now }, site) {
            let height = if layer.scale_height.is_finite() { layer.scale_height } else { HIGH };
            (0..3).for_each(|k| sum[k] += layer.sigma_t[k] * height);
        }
    }
    sum
}

impl LightChange {
    /// Returns true if the light stays as it was captured.
    #[must_use]
    pub fn is_nothing(&self) -> bool {
        self.clouds == 0.0 && self.depth == [0.0; 3] && self.exposure == 0.0
    }

    /// The light over a place that was captured in another.
    #[must_use]
    pub fn over(&self, capture: &CaptureLight, up: [f64; 3]) -> SceneLight {
        let sin = capture.sun.map_or(0.0, |sun| (0..3).map(|k| sun.direction[k] * up[k]).sum::<f64>());
        let level = capture.light.irradiance(sin);
        let beam: [f64; 3] = std::array::from_fn(|k| {
            let through = if sin > 0.0 { (-self.depth[k] / sin).exp() } else { 1.0 };
            (1.0 - self.clouds) * through
        });
        let sun: [f64; 3] = std::array::from_fn(|k| capture.light.sun[k] * beam[k]);
        // The sky brings what the beam has lost, so that level ground keeps its light.
        let left: [f64; 3] = std::array::from_fn(|k| (level[k] - sun[k] * sin.max(0.0)).max(0.0));
        let grey = 1.0 - beam[1];
        let clear = SkyGradation::even(left);
        let cloudy = SkyGradation::overcast(white_as(left));
        SceneLight { sun, sky: clear.mixed(&cloudy, grey) }.times(self.exposure.exp2())
    }

    /// The sky behind the scene; `None` where the captured one stays.
    #[must_use]
    pub fn dome(&self, site: &Site) -> Option<Dome> {
        if self.clouds < 0.5 {
            return None;
        }
        let zenith = overcast_zenith();
        let look = SkyAppearance::Overcast { zenith, horizon: zenith.map(|v| v / 3.0) };
        let brightness = (self.exposure - OVERCAST_EXPOSURE).exp2();
        Some(Dome::new(look, None, brightness, site.up, SkySplats::LeftOut))
    }
}

/// The tint of an overcast sky at the luminance of an irradiance.
fn white_as(light: [f64; 3]) -> [f64; 3] {
    use wm_scene::color::luminance;
    let zenith = overcast_zenith();
    zenith.map(|v| v * luminance(light) / luminance(zenith))
}
