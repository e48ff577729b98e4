//! Skies that stand behind everything: by elevation, or out of a panorama.
//!
//! Radiance is linear RGB, 1 = display white. By the sine `s` of the elevation:
//! - overcast: `L = H + (Z - H) s`, with `H = Z / 3` the CIE's overcast sky `L = Z (1 + 2 s) / 3`
//!   (Moon and Spencer 1942; CIE S 011);
//! - clear: `L = Z + (H - Z) (p(s) - p(1)) / (1 - p(1))`, `p(s) = 1 - e^(-0.32 / s)`: the gradation
//!   of the CIE's clear skies (CIE S 011, a = -1, b = -0.32), from a colour at the zenith to
//!   another at the horizon. The glow about the sun is left out: where the sun is nobody says;
//! - gradient: [`SkyGradient`], the sky that the program gives to scenes without one.
//!
//! Below the horizon there is no edge: the horizon turns smoothly into the ground's haze, complete
//! 30 degrees down. Scenes end before the horizon, and from above their end is seen against that. A
//! panorama is haze there too ([`crate::panorama`]), unless its own lower half is requested.
//!
//! Directions: heading 0 is the scene's x axis laid level (its y axis if x is within 26 degrees of
//! up), and headings turn clockwise seen from above.

pub use crate::level::level_axes;
use crate::level::{dot, from_level};
use crate::light::{FlashLight, OpenLight};
use crate::panorama::{LowerHemisphere, Panorama, smooth};
use std::f64::consts::PI;
use std::sync::Arc;
use wm_base::color::luminance;
use wm_render::frame::{srgb_decode, srgb_encode};
use wm_render::hooks::{Backdrop, Detail, GROUP, ShadeGroup, SkySplats};
use wm_render::{Background, SkyGradient};
use wm_scene::survey::{SkyPatch, airlight_of_sky, limited_airlight};

/// Gradation of the CIE's clear skies.
const CLEAR_SKY_GRADATION: f64 = -0.32;
/// Sine of the depth below the horizon at which all is ground: 30 degrees.
const FULL_GROUND_SINE: f64 = 0.5;
/// Light of the ground's haze against that of the horizon, where nothing says it: bare ground of
/// albedo 0.2 has 0.47 of it under an overcast sky, and air before it.
const GROUND_LIGHT: f64 = 0.6;
/// Intervals in which a sky by elevation is tabled, by sine from -1 to 1. Linear between; a test
/// has the error.
const ELEVATION_INTERVAL_COUNT: usize = 2048;
/// Intervals of the table by which a panorama is brightened, and its last colour.
const TONE_INTERVAL_COUNT: usize = 4096;
const MAX_TONE: f64 = 8.0;
/// Sine of the elevation up to which the airlight of a sky by elevation is its mean: 20 degrees.
const AIRLIGHT_BAND_SINE: f64 = 0.342;

/// Zenith of an overcast sky, linear RGB: a touch of blue, and brighter than white, as where a
/// picture is exposed for the ground. White is reached at 37 degrees.
pub(crate) const OVERCAST_ZENITH: [f64; 3] = [1.32, 1.35, 1.40];
/// The overcast horizon against its zenith (CIE).
pub(crate) const OVERCAST_HORIZON: f64 = 1.0 / 3.0;

/// The appearance of a sky.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum SkyAppearance {
    /// One colour, linear RGB.
    Plain([f64; 3]),
    /// Clear, by the colours of horizon and zenith, linear RGB.
    Clear {
        /// Straight up.
        zenith: [f64; 3],
        /// At the horizon.
        horizon: [f64; 3],
    },
    /// Overcast.
    Overcast {
        /// Straight up, linear RGB.
        zenith: [f64; 3],
        /// At the horizon, linear RGB.
        horizon: [f64; 3],
    },
    /// A clear sky with clouds for a position of the sun; its irradiances in lux times the dome's
    /// brightness are those of display white.
    Open(Arc<OpenLight>),
    /// The plain sky of the program.
    Gradient(SkyGradient),
    /// A picture of all directions.
    Panorama {
        /// The picture.
        panorama: Arc<Panorama>,
        /// Heading of its middle column, degrees.
        heading: f64,
        /// The lower half of the sky.
        below: LowerHemisphere,
    },
}

/// A sky over a place, at one instant.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Dome {
    look: SkyAppearance,
    ground: Option<[f64; 3]>,
    brightness: f64,
    up: [f64; 3],
    pub(crate) sky_splats: SkySplats,
    flash: Option<FlashLight>,
    /// Display-referred colours: of a sky by elevation by its sine, of a panorama's ways of being
    /// brighter by its own colours.
    table: Vec<[f32; 3]>,
}

impl Dome {
    /// A sky about `up` (world axes, length 1), its light times `brightness`. `ground` is the
    /// colour well below the horizon, linear RGB; without it a colour stays, and others take a grey
    /// of 0.6 times the light of the horizon.
    pub(crate) fn new(
        look: SkyAppearance,
        ground: Option<[f64; 3]>,
        brightness: f64,
        up: [f64; 3],
        sky_splats: SkySplats,
    ) -> Self {
        let mut dome = Self { look, ground, brightness, up, sky_splats, flash: None, table: Vec::new() };
        dome.table = match dome.look {
            SkyAppearance::Panorama { .. } if brightness == 1.0 => Vec::new(),
            SkyAppearance::Open(_) => Vec::new(),
            SkyAppearance::Panorama { .. } => (0..=TONE_INTERVAL_COUNT)
                .map(|i| [dome.brightened(MAX_TONE * i as f64 / TONE_INTERVAL_COUNT as f64) as f32; 3])
                .collect(),
            _ => (0..=ELEVATION_INTERVAL_COUNT)
                .map(|i| {
                    dome.by_elevation(2.0 * i as f64 / ELEVATION_INTERVAL_COUNT as f64 - 1.0)
                        .map(|v| v as f32)
                })
                .collect(),
        };
        dome
    }

    /// Adds a flash of lightning to the sky.
    pub(crate) fn lit_by(self, flash: Option<FlashLight>) -> Self {
        Self { flash, ..self }
    }

    /// The airlight under it, linear RGB: its mean radiance near the horizon, as the survey takes
    /// it from the splats of a sky; `None` of a sky that is black.
    pub(crate) fn airlight(&self) -> Option<[f64; 3]> {
        let light = match &self.look {
            SkyAppearance::Panorama { panorama, .. } => {
                limited_airlight(panorama.airlight()?.map(|v| self.brightness * v))
            }
            SkyAppearance::Open(open) => {
                let axes = level_axes(self.up);
                let patches = (0..256).map(|i| {
                    let (sin, turn) =
                        (AIRLIGHT_BAND_SINE * (f64::from(i / 16) + 0.5) / 16.0, f64::from(i % 16) * PI / 8.0);
                    let level = (1.0 - sin * sin).sqrt();
                    let direction = from_level(&axes, [level * turn.cos(), level * turn.sin(), sin]);
                    let rgb = open.radiance(direction, sin).map(|v| self.brightness * v);
                    SkyPatch { sin, weight: 1.0, rgb }
                });
                airlight_of_sky(patches.collect(), 0.0)?
            }
            // As wide as the band, all alike around.
            _ => {
                let sines = (0..64).map(|i| AIRLIGHT_BAND_SINE * (f64::from(i) + 0.5) / 64.0);
                let rgb = |sin| self.by_elevation(sin).map(srgb_decode);
                airlight_of_sky(sines.map(|sin| SkyPatch { sin, weight: 1.0, rgb: rgb(sin) }).collect(), 0.0)?
            }
        };
        (luminance(light) > 0.0).then_some(light.map(|v| v.min(1.0)))
    }

    /// The colour well below the horizon, linear RGB, without the brightness, where it is not
    /// `horizon`'s.
    fn ground_under(&self, horizon: [f64; 3]) -> [f64; 3] {
        self.ground.unwrap_or([GROUND_LIGHT * luminance(horizon); 3])
    }

    /// The display-referred colour at a sine of elevation; not for panoramas.
    fn by_elevation(&self, sin: f64) -> [f64; 3] {
        let above = sin.clamp(0.0, 1.0);
        let between = |from: [f64; 3], to: [f64; 3], share: f64| -> [f64; 3] {
            std::array::from_fn(|k| from[k] + (to[k] - from[k]) * share)
        };
        let light = match &self.look {
            SkyAppearance::Plain(color) => *color,
            SkyAppearance::Overcast { zenith, horizon } => between(*horizon, *zenith, above),
            SkyAppearance::Clear { zenith, horizon } => {
                let gradation = |sin: f64| 1.0 - (CLEAR_SKY_GRADATION / sin.max(1e-9)).exp();
                let share = (gradation(above) - gradation(1.0)) / (1.0 - gradation(1.0));
                between(*zenith, *horizon, share)
            }
            SkyAppearance::Gradient(gradient) => {
                let gradient = SkyGradient { up: [0.0, 0.0, 1.0], ..*gradient };
                let level = (1.0 - sin * sin).max(0.0).sqrt();
                // It has a ground of its own.
                let color = Background::Sky(gradient).color([level, 0.0, sin]);
                return color.map(|v| self.brightened(v));
            }
            SkyAppearance::Panorama { .. } | SkyAppearance::Open(_) => {
                unreachable!("it is not by elevation alone")
            }
        };
        let light = match (&self.look, self.ground) {
            (SkyAppearance::Plain(_), None) => light,
            _ => {
                between(light, self.ground_under(light), f64::from(smooth((-sin / FULL_GROUND_SINE) as f32)))
            }
        };
        light.map(|v| srgb_encode(self.brightness * v))
    }

    /// A display-referred value with the light times the brightness.
    fn brightened(&self, value: f64) -> f64 {
        srgb_encode(self.brightness * srgb_decode(value))
    }

    /// The axes turned so that the first points at the middle of a panorama.
    fn panorama_axes(&self, heading: f64) -> [[f64; 3]; 3] {
        let [forward, right, up] = level_axes(self.up);
        let (sin, cos) = heading.to_radians().sin_cos();
        [
            std::array::from_fn(|k| cos * forward[k] + sin * right[k]),
            std::array::from_fn(|k| cos * right[k] - sin * forward[k]),
            up,
        ]
    }
}

/// The overcast horizon, linear RGB.
pub(crate) fn overcast_horizon() -> [f64; 3] {
    OVERCAST_ZENITH.map(|v| OVERCAST_HORIZON * v)
}

/// A display-referred colour with more light, linear RGB.
fn brightened_by(color: [f64; 3], light: [f64; 3]) -> [f64; 3] {
    let sum = std::array::from_fn(|k| srgb_decode(color[k]) + light[k]);
    burned_out(sum).map(srgb_encode)
}

/// Light at which the brightest of a sky begins to burn out, of display white.
const SHOULDER_LIGHT: f64 = 0.7;

/// A light whose channels do not exceed display white: what is brighter goes over into white, as it
/// does in photos, where cutting off each channel would turn an evening sky neon.
fn burned_out(light: [f64; 3]) -> [f64; 3] {
    let most = light.into_iter().fold(0.0, f64::max);
    if most <= SHOULDER_LIGHT {
        return light;
    }
    let room = 1.0 - SHOULDER_LIGHT;
    let shown = 1.0 - room * (-(most - SHOULDER_LIGHT) / room).exp();
    // The more was taken, the whiter.
    let white = (1.0 - shown / most).powi(2);
    light.map(|v| {
        let v = v * shown / most;
        v + (shown - v) * white
    })
}

/// The table at a place from 0 to 1 along it.
#[inline(always)]
fn tabled(table: &[[f32; 3]], place: f32) -> (&[f32; 3], &[f32; 3], f32) {
    let last = table.len() - 2;
    let place = place.clamp(0.0, 1.0) * (last + 1) as f32;
    let first = (place as usize).min(last);
    (&table[first], &table[first + 1], place - first as f32)
}

impl Backdrop for Dome {
    fn paint(&self, pixel: f64, groups: &mut [ShadeGroup]) {
        self.paint_dark(pixel, groups);
        let Some(flash) = &self.flash else { return };
        for group in groups {
            for lane in 0..GROUP {
                let direction = group.direction.map(|axis| f64::from(axis[lane]));
                let color = [0, 1, 2].map(|k: usize| f64::from(group.rgb[k][lane]));
                let lit = brightened_by(color, flash.sky(direction));
                (0..3).for_each(|k| group.rgb[k][lane] = lit[k] as f32);
            }
        }
    }

    fn reference(&self, pixel: f64, direction: [f64; 3]) -> [f64; 3] {
        let color = self.reference_dark(pixel, direction);
        self.flash.as_ref().map_or(color, |flash| brightened_by(color, flash.sky(direction)))
    }

    fn uniform(&self) -> Option<[f32; 3]> {
        match self.look {
            SkyAppearance::Plain(_) if self.ground.is_none() && self.flash.is_none() => {
                self.table.first().copied()
            }
            _ => None,
        }
    }

    fn detail(&self) -> Detail {
        match self.look {
            SkyAppearance::Panorama { .. } => Detail::Fine,
            _ => Detail::Smooth,
        }
    }

    fn sky_splats(&self) -> SkySplats {
        self.sky_splats
    }
}

impl Dome {
    /// Paints the sky without lightning.
    fn paint_dark(&self, pixel: f64, groups: &mut [ShadeGroup]) {
        let up = self.up.map(|v| v as f32);
        if let SkyAppearance::Panorama { panorama, heading, below } = &self.look {
            let axes = self.panorama_axes(*heading).map(|axis| axis.map(|v| v as f32));
            panorama.paint(pixel, axes, *below, groups);
            self.finish_panorama(panorama, *below, up, groups);
            return;
        }
        if let SkyAppearance::Open(open) = &self.look {
            for group in groups {
                for lane in 0..GROUP {
                    let color = self.open_color(open, group.direction.map(|axis| f64::from(axis[lane])));
                    (0..3).for_each(|k| group.rgb[k][lane] = color[k] as f32);
                }
            }
            return;
        }
        for group in groups {
            for lane in 0..GROUP {
                let sin = (0..3).map(|k| group.direction[k][lane] * up[k]).sum::<f32>();
                let (from, to, share) = tabled(&self.table, 0.5 + 0.5 * sin);
                for k in 0..3 {
                    group.rgb[k][lane] = from[k] + (to[k] - from[k]) * share;
                }
            }
        }
    }

    /// The colour of a direction without lightning.
    fn reference_dark(&self, pixel: f64, direction: [f64; 3]) -> [f64; 3] {
        let sin = dot(direction, self.up);
        if let SkyAppearance::Open(open) = &self.look {
            return self.open_color(open, direction);
        }
        let SkyAppearance::Panorama { panorama, heading, below } = &self.look else {
            return self.by_elevation(sin);
        };
        let axes = self.panorama_axes(*heading);
        let color = panorama.reference(pixel, axes.map(|axis| dot(axis, direction)), *below);
        let color = color.map(|v| self.brightened(v));
        if *below == LowerHemisphere::Image {
            return color;
        }
        let ground = self.panorama_ground(panorama);
        let share = f64::from(smooth((-sin / FULL_GROUND_SINE) as f32));
        std::array::from_fn(|k| color[k] + (ground[k] - color[k]) * share)
    }

    /// The display-referred colour of the sky of a place of the sun.
    fn open_color(&self, open: &OpenLight, direction: [f64; 3]) -> [f64; 3] {
        let sin = dot(direction, self.up).clamp(-1.0, 1.0);
        let light = open.radiance(direction, sin);
        let (ground, share) = (self.ground_under(light), f64::from(smooth((-sin / FULL_GROUND_SINE) as f32)));
        let light: [f64; 3] =
            std::array::from_fn(|k| self.brightness * (light[k] + (ground[k] - light[k]) * share));
        burned_out(light).map(srgb_encode)
    }

    /// The display-referred colour well below the horizon of a panorama.
    fn panorama_ground(&self, panorama: &Panorama) -> [f64; 3] {
        let ground = self.ground_under(panorama.airlight().unwrap_or_default());
        ground.map(|v| srgb_encode(self.brightness * v))
    }

    /// Brightens a panorama's colours, and lays the ground below the horizon.
    fn finish_panorama(
        &self,
        panorama: &Panorama,
        below: LowerHemisphere,
        up: [f32; 3],
        groups: &mut [ShadeGroup],
    ) {
        let ground = self.panorama_ground(panorama).map(|v| v as f32);
        for group in groups {
            if !self.table.is_empty() {
                for value in group.rgb.as_flattened_mut() {
                    let (from, to, share) = tabled(&self.table, *value * (1.0 / MAX_TONE as f32));
                    *value = from[0] + (to[0] - from[0]) * share;
                }
            }
            if below == LowerHemisphere::Image {
                continue;
            }
            for lane in 0..GROUP {
                let sin = (0..3).map(|k| group.direction[k][lane] * up[k]).sum::<f32>();
                let share = smooth(-sin / FULL_GROUND_SINE as f32);
                for k in 0..3 {
                    group.rgb[k][lane] += (ground[k] - group.rgb[k][lane]) * share;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests;
