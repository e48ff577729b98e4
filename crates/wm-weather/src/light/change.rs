//! A change of the light over a place.

use super::capture::CaptureLight;
use super::day::OpenLight;
use super::gains::NewLight;
use super::irradiance::{SceneLight, SkyGradation};
use crate::dome::{Dome, OVERCAST_ZENITH, SkyAppearance, overcast_horizon};
use crate::optics::{CapturedSky, LampSource, Site};
use std::sync::Arc;
use wm_base::color::{luminance, srgb_decode};
use wm_render::SkyGradient;
use wm_render::hooks::SkySplats;

/// Change of exposure under full clouds: a camera that follows the light keeps some of the gloom.
pub(crate) const OVERCAST_EXPOSURE: f64 = -0.3;
/// Least illuminance that exposures are found for, lx: under the stars.
pub(crate) const MIN_EXPOSED_LX: f64 = 1e-3;
/// Illuminance of level ground in photos under a sun and under clouds.
const PHOTO_ILLUMINANCES_LX: [f64; 2] = [60_000.0, 15_000.0];

/// A change of the light over a place.
#[derive(Clone, Debug, PartialEq)]
pub struct LightChange {
    /// Cloud cover, 0-1.
    pub(crate) clouds: f64,
    /// Optical depth of the air straight up, by channel.
    pub(crate) depth: [f64; 3],
    /// Exposure, EV.
    pub(crate) exposure: f64,
    /// Sun and sky of the weather's own; `None` where the captured sun stays.
    pub(crate) open: Option<Arc<OpenLight>>,
    /// The sun whose shadows are cast, towards it, world axes; `None` where the captured one stays,
    /// and where no sun shines.
    pub sun: Option<[f64; 3]>,
    /// The photos are said to have no shadows.
    pub is_diffuse: bool,
    /// The lamps, and the share of their light, 0-1; `None` where none shine.
    pub lamps: Option<(LampSource, f64)>,
    /// Illuminance that the exposure goes by beside that of the sky: the mean by lamps, lx.
    pub(crate) lamp_level: f64,
    /// The camera's car has its headlamps on.
    pub(crate) has_headlamps: bool,
    /// Broken clouds cast shadows.
    pub(crate) has_cloud_shadows: bool,
}

impl LightChange {
    /// The light of the capture as it was.
    pub(crate) const CAPTURED: Self = Self {
        clouds: 0.0,
        depth: [0.0; 3],
        exposure: 0.0,
        open: None,
        sun: None,
        is_diffuse: false,
        lamps: None,
        lamp_level: 0.0,
        has_headlamps: false,
        has_cloud_shadows: false,
    };

    /// Returns true if the light stays as it was captured.
    pub(crate) fn is_nothing(&self) -> bool {
        let is_captured = self.open.is_none() && self.clouds == 0.0 && self.depth == [0.0; 3];
        is_captured && self.exposure == 0.0 && !self.has_headlamps
    }

    /// Display value of a white surface in an irradiance of one lux: that of the capture's level
    /// ground in the open is 1.
    #[must_use]
    pub fn display(&self, site: &Site) -> f64 {
        let level = match &self.open {
            Some(open) => open.level() + self.lamp_level,
            None if site.captured_sky == CapturedSky::Overcast => PHOTO_ILLUMINANCES_LX[1],
            None => {
                PHOTO_ILLUMINANCES_LX[0] + (PHOTO_ILLUMINANCES_LX[1] - PHOTO_ILLUMINANCES_LX[0]) * self.clouds
            }
        };
        self.exposure.exp2() / level.max(MIN_EXPOSED_LX)
    }

    /// The light over a place that was captured in another.
    #[must_use]
    pub fn over(&self, capture: &CaptureLight, site: &Site) -> NewLight {
        let up = site.up;
        if let Some(open) = &self.open {
            let display = self.display(site);
            let mut light = open.light.times(display);
            if self.has_cloud_shadows {
                // The beam between the clouds; their shadows take it away.
                light.sun = light.sun.map(|v| v / (1.0 - self.clouds));
            }
            let lamps = self.lamps.map_or(0.0, |(_, share)| share * display);
            let (sin_sun, is_diffuse) = (open.sin_sun, self.is_diffuse);
            return NewLight { light, sin_sun, sky_gain: 0.0, sky_opacity: 1.0, is_diffuse, lamps };
        }
        let sin = capture.sin_sun(up);
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
        let cloudy = SkyGradation::overcast(overcast_tint(left));
        let light = SceneLight { sun, sky: clear.mixed(&cloudy, grey) }.times(self.exposure.exp2());
        let (sky_gain, sky_opacity) = (self.exposure.exp2(), 1.0 - self.clouds);
        NewLight { light, sin_sun: sin, sky_gain, sky_opacity, is_diffuse: self.is_diffuse, lamps: 0.0 }
    }

    /// The sky behind the scene; `None` where the captured one stays.
    pub(crate) fn dome(&self, site: &Site) -> Option<Dome> {
        if let Some(open) = &self.open {
            let (look, factor) = (SkyAppearance::Open(Arc::clone(open)), self.display(site));
            return Some(Dome::new(look, None, factor, site.up, SkySplats::LeftOut));
        }
        if self.clouds == 0.0 {
            return None;
        }
        // Behind what fades of the captured sky, or in the place of the plain one.
        let plain = SkyGradient::daylight(site.up.map(|v| v as f32));
        let (zenith, brightness) =
            (OVERCAST_ZENITH, (self.exposure - OVERCAST_EXPOSURE * self.clouds).exp2());
        let between = |from: [f32; 3], to: [f64; 3]| -> [f64; 3] {
            std::array::from_fn(|k| {
                let from = srgb_decode(f64::from(from[k]));
                from + (to[k] - from) * self.clouds
            })
        };
        let look = SkyAppearance::Overcast {
            zenith: between(plain.zenith, zenith),
            horizon: between(plain.horizon, overcast_horizon()),
        };
        let splats = if self.clouds < 1.0 { SkySplats::Kept } else { SkySplats::LeftOut };
        Some(Dome::new(look, None, brightness, site.up, splats))
    }
}

/// The tint of an overcast sky at the luminance of an irradiance.
fn overcast_tint(light: [f64; 3]) -> [f64; 3] {
    let zenith = OVERCAST_ZENITH;
    zenith.map(|v| v * luminance(light) / luminance(zenith))
}
