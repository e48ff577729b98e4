//! The common parameters of fog, haze and smog, with different defaults.

/// Declares the parameters of a kind of air and its [`Effect`](super::Effect).
macro_rules! air {
    (
        name: $name:literal,
        about: $about:literal,
        mor: $mor:literal,
        angstrom: $angstrom:literal,
        albedo: $albedo:literal,
        tint: $tint:expr,
        scale_height: $scale_height:expr,
    ) => {
        $crate::param::params! {
            /// The parameters of the effect.
            struct AirParams {
                /// Meteorological optical range at the base height: the distance at which 5 % of
                /// the light is left (WMO). Green light, where the colours differ.
                mor: f64 = ParamValue::Number($mor), 1.0 => f64::INFINITY, "m";
                /// The same as Koschmieder's visual range (2 % of the light left); if given, it is
                /// used and `mor` is not.
                visual_range: Option<f64> = ParamValue::Auto, 1.0 => f64::INFINITY, "m";
                /// Colour of an endless depth of it; `auto` takes the scene's sky near the horizon,
                /// times albedo and tint.
                airlight: Option<[f64; 3]> = ParamValue::Auto, 0.0 => 1.0, "";
                /// Share of the light that the particles scatter and do not absorb.
                albedo: f64 = ParamValue::Number($albedo), 0.0 => 1.0, "";
                /// Colour by which the particles tint the airlight.
                tint: Option<[f64; 3]> = $tint, 0.0 => 1.0, "";
                /// Angstrom exponent: extinction goes with the wavelength
                /// to the power of minus this; 0 for grey.
                angstrom: f64 = ParamValue::Number($angstrom), 0.0 => 4.0, "";
                /// Height over which it thins to 1/e; inf for the same at all heights.
                scale_height: f64 = ParamValue::Number($scale_height), 0.1 => f64::INFINITY, "m";
                /// Height above the ground at which `mor` holds.
                base_height: f64 = ParamValue::Number(0.0), -10_000.0 => 10_000.0, "m";
                /// Fidelity `paper`: I_style; `auto` takes the extinction times `paper_d_max`.
                paper_intensity: Option<f64> = ParamValue::Auto, 0.0 => 1000.0, "";
                /// Fidelity `paper`: C_fog; `auto` takes the airlight.
                paper_color: Option<[f64; 3]> = ParamValue::Auto, 0.0 => 1.0, "";
                /// Fidelity `paper`: depth that D_ref takes for 1; `auto` takes three times the
                /// radius of the scene.
                paper_d_max: Option<f64> = ParamValue::Auto, 0.01 => 1e7, "m";
            }
        }

        /// The entry of [`EFFECTS`](super::EFFECTS).
        pub(crate) const EFFECT: Effect = Effect {
            name: $name,
            about: $about,
            role: EffectRole::Air,
            needs: &[],
            precipitation: None,
            params: AirParams::PARAMS,
            contribute: |now, weather| {
                let layer = AirParams::of(now.values).layer(weather.site());
                weather.add_air(layer);
            },
            contribute_as_paper: Some(|now, weather| {
                let fog = AirParams::of(now.values).paper_fog(weather.site());
                weather.prepared.paper.push(fog);
            }),
        };

        impl AirParams {
            /// Extinction of green light at the base, 1/m.
            pub(crate) fn sigma(&self) -> f64 {
                self.visual_range.map_or_else(|| sigma_of_mor(self.mor), sigma_of_visual_range)
            }

            /// Radiance of an endless depth, linear RGB.
            #[must_use]
            pub fn airlight(&self, site: &Site) -> [f64; 3] {
                if let Some(color) = self.airlight {
                    return color.map(srgb_decode);
                }
                let tint = self.tint.map_or([1.0; 3], |tint| tint.map(srgb_decode));
                std::array::from_fn(|k| site.airlight[k] * self.albedo * tint[k])
            }

            fn layer(&self, site: &Site) -> AirLayer {
                AirLayer {
                    sigma_t: spectrum(self.angstrom).map(|relative| self.sigma() * relative),
                    airlight: self.airlight(site),
                    scale_height: self.scale_height,
                    base_height: self.base_height,
                }
            }

            fn paper_fog(&self, site: &Site) -> PaperFog {
                let d_max = self.paper_d_max.unwrap_or(site.far);
                PaperFog {
                    intensity: self.paper_intensity.unwrap_or_else(|| self.sigma() * d_max),
                    color: self.paper_color.unwrap_or_else(|| self.airlight(site).map(srgb_encode)),
                    d_max: d_max / site.metres_per_unit,
                }
            }
        }
    };
}

/// The names that [`air!`] needs in scope.
pub(super) mod prelude {
    pub(in crate::effects) use crate::effects::effect::{Effect, EffectRole};
    pub(in crate::effects) use crate::optics::{
        AirLayer, Site, sigma_of_mor, sigma_of_visual_range, spectrum,
    };
    pub(in crate::effects) use crate::paper::PaperFog;
    pub(in crate::effects) use crate::param::ParamValue;
    pub(in crate::effects) use wm_render::frame::{srgb_decode, srgb_encode};
}

pub(super) use air;
