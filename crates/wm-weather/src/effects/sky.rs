//! Sky: what stands behind everything, for scenes that have none and for those whose sky is to be
//! another.
//!
//! It lies at infinity, is seen through the air as all else, and shows where no splat covers it.
//! Formulas and directions: [`crate::dome`]; panoramas: [`crate::panorama`].
//!
//! A sky by elevation is evaluated at coarse nodes of the picture, a panorama at every pixel.
//! Whoever knows file formats reads the panorama that `sky` names
//! ([`crate::Weather::load_images`]).
//!
//! Weather must not look at frames, so the airlight of fog, haze and smog is taken from this sky,
//! near its horizon, where the scene has neither a sky nor an airlight of its own; and wherever the
//! scene's sky is replaced.
//!
//! The paper has no such thing.

use crate::dome::{Dome, OVERCAST_HORIZON, OVERCAST_ZENITH, SkyAppearance};
use crate::effects::effect::{Effect, EffectRole};
use crate::image_file::ImageFile;
use crate::optics::Site;
use crate::panorama::LowerHemisphere;
use crate::param::{ParamKind, ParamType, ParamValue};
use wm_render::SkyGradient;
use wm_render::frame::srgb_decode;
use wm_render::hooks::SkySplats;

crate::param::words! {
    /// The appearance of the sky.
    enum Model {
        /// The panorama that is given, else the colour, else clear.
        Auto = "auto",
        /// The CIE's clear gradation from horizon to zenith, without a sun.
        Clear = "clear",
        /// The CIE's overcast sky.
        Overcast = "overcast",
        /// The sky that scenes without one get anyway.
        Gradient = "gradient",
    }
}

crate::param::words! {
    /// The treatment of the scene's own sky splats.
    enum SceneSky {
        /// It stays before this one.
        Keep = "keep",
        /// It is left out.
        Replace = "replace",
    }
}

impl ParamType for LowerHemisphere {
    const KIND: ParamKind = ParamKind::Word(&["haze", "picture"]);

    fn of(value: ParamValue) -> Self {
        match value {
            ParamValue::Word("haze") => Self::Haze,
            _ => Self::Image,
        }
    }
}

crate::param::params! {
    /// The parameters of the effect.
    struct SkyParams {
        /// Appearance of the sky: `clear` or `overcast` (CIE), `gradient` (the default of a scene
        /// without a sky); `auto` takes the panorama if one is given, else the colour, else
        /// `clear`.
        model: Model = ParamValue::Word("auto"), 0.0 => 0.0, "";
        /// One colour all around.
        color: Option<[f64; 3]> = ParamValue::Auto, 0.0 => 1.0, "";
        /// Colour straight up; `auto` is the model's, white and more in an overcast sky.
        zenith: Option<[f64; 3]> = ParamValue::Auto, 0.0 => 1.0, "";
        /// Colour at the horizon; `auto` is the model's: pale in a clear sky, a third of the light
        /// of the zenith in an overcast one.
        horizon: Option<[f64; 3]> = ParamValue::Auto, 0.0 => 1.0, "";
        /// Colour of the haze well below the horizon, where the scene has ended; `auto` is grey
        /// with 60 % of the horizon's light, and `color` itself if there is one.
        ground: Option<[f64; 3]> = ParamValue::Auto, 0.0 => 1.0, "";
        /// Picture of all directions: equirectangular, PNG, JPEG or EXR (linear light), at most
        /// 8192x4096 px; its path, from the folder of the weather file.
        panorama: Option<ImageFile> = ParamValue::Auto, 0.0 => 0.0, "";
        /// Direction of the middle of the panorama, clockwise seen from above; 0 is the scene's x
        /// axis, laid level (its y axis where x is up).
        heading: f64 = ParamValue::Number(0.0), -36_000.0 => 36_000.0, "deg";
        /// Lower half of a panorama: `haze` of the colours just above the horizon, or the lower
        /// half of the `picture`.
        below: LowerHemisphere = ParamValue::Word("haze"), 0.0 => 0.0, "";
        /// Factor on its light.
        brightness: f64 = ParamValue::Number(1.0), 0.0 => 100.0, "";
        /// Treatment of the scene's own sky, if it has one: `keep` draws it in front of this one,
        /// `replace` leaves it out, and takes the airlight from this one whatever the scene says.
        scene_sky: SceneSky = ParamValue::Word("keep"), 0.0 => 0.0, "";
    }
}

/// The entry of [`EFFECTS`](super::EFFECTS).
pub(crate) const EFFECT: Effect = Effect {
    name: "sky",
    about: "What stands behind everything: clear, overcast, a colour or a panorama",
    role: EffectRole::Sky,
    needs: &[],
    precipitation: None,
    params: SkyParams::PARAMS,
    contribute: |now, weather| {
        let dome = SkyParams::of(now.values).dome(weather.site());
        weather.set_sky(dome);
    },
    contribute_as_paper: None,
};

impl SkyParams {
    fn dome(&self, site: &Site) -> Dome {
        let scenes_sky = match self.scene_sky {
            SceneSky::Keep => SkySplats::Kept,
            SceneSky::Replace => SkySplats::LeftOut,
        };
        let ground = self.ground.map(|color| color.map(srgb_decode));
        Dome::new(self.look(site), ground, self.brightness, site.up, scenes_sky)
    }

    fn look(&self, site: &Site) -> SkyAppearance {
        let plain = SkyGradient::daylight(site.up.map(|v| v as f32));
        let or = |color: Option<[f64; 3]>, other: [f64; 3]| color.unwrap_or(other).map(srgb_decode);
        match self.model {
            Model::Auto => {
                let panorama = self.panorama.as_ref().and_then(ImageFile::panorama);
                if let Some(panorama) = panorama {
                    return SkyAppearance::Panorama {
                        panorama: panorama.clone(),
                        heading: self.heading,
                        below: self.below,
                    };
                }
                if let Some(color) = self.color {
                    return SkyAppearance::Plain(color.map(srgb_decode));
                }
                Self { model: Model::Clear, ..self.clone() }.look(site)
            }
            Model::Clear => SkyAppearance::Clear {
                zenith: or(self.zenith, plain.zenith.map(f64::from)),
                horizon: or(self.horizon, plain.horizon.map(f64::from)),
            },
            Model::Overcast => {
                let zenith = self.zenith.map_or(OVERCAST_ZENITH, |color| color.map(srgb_decode));
                let horizon = self.horizon.map(|color| color.map(srgb_decode));
                SkyAppearance::Overcast {
                    zenith,
                    horizon: horizon.unwrap_or(zenith.map(|v| OVERCAST_HORIZON * v)),
                }
            }
            Model::Gradient => {
                let take = |color: Option<[f64; 3]>, other| color.map_or(other, |c| c.map(|v| v as f32));
                SkyAppearance::Gradient(SkyGradient {
                    zenith: take(self.zenith, plain.zenith),
                    horizon: take(self.horizon, plain.horizon),
                    ground: take(self.ground, plain.ground),
                    up: plain.up,
                })
            }
        }
    }
}
