//! The common parameters of rain and snowfall, with different defaults.
//!
//! In fidelity `paper` only those whose names begin with `paper_` count, with `rate`, `airlight`
//! and `seed`.

/// Declares the parameters of a kind of precipitation and its [`Effect`](super::Effect).
macro_rules! drops {
    (
        name: $name:literal,
        about: $about:literal,
        kind: $kind:expr,
        $(#[doc = $meaning:literal])+
        rate: $rate:literal, $most:literal,
        paper: {
            number: $number:literal at $usual:literal,
            speed: $speed:literal,
            length: $length:literal,
            width: $width:expr,
            opacity: $opacity:literal,
            t: $t_min:literal, $t_max:literal,
            fog: $fog:literal,
        },
    ) => {
        $crate::param::params! {
            /// The parameters of the effect.
            struct DropsParams {
                $(#[doc = $meaning])+
                rate: f64 = ParamValue::Number($rate), 0.0 => $most, "mm/h";
                /// Exposure time: streaks are as long as the distance travelled in it.
                exposure: f64 = ParamValue::Number(0.0166), 0.000_01 => 1.0, "s";
                /// Factor on the diameters that are drawn; their number, speed and the air stay as
                /// they are.
                size: f64 = ParamValue::Number(1.0), 0.1 => 10.0, "";
                /// Factor on what they cover.
                opacity: f64 = ParamValue::Number(1.0), 0.0 => 100.0, "";
                /// Factor on their light.
                brightness: f64 = ParamValue::Number(1.0), 0.0 => 10.0, "";
                /// Their colour; `auto` is that of the surroundings: three quarters of the
                /// airlight.
                color: Option<[f64; 3]> = ParamValue::Auto, 0.0 => 1.0, "";
                /// Colour of an endless depth of it; `auto` takes the scene's sky near the horizon.
                airlight: Option<[f64; 3]> = ParamValue::Auto, 0.0 => 1.0, "";
                /// Seed of the random positions: a whole number.
                seed: f64 = ParamValue::Number(0.0), 0.0 => 9_007_199_254_740_992.0, "";
                /// Fidelity `paper`: drops or flakes in the box; `auto` goes by the root of `rate`.
                paper_number: Option<f64> = ParamValue::Auto, 0.0 => 4_000_000.0, "";
                /// Fidelity `paper`: edge of the box about the camera that they fill.
                paper_box: f64 = ParamValue::Number(24.0), 0.1 => 10_000.0, "m";
                /// Fidelity `paper`: their fall speed; over time by keyframes: they have come as
                /// far as its integral.
                paper_speed: f64 = ParamValue::Number($speed), 0.0 => 1000.0, "m/s";
                /// Fidelity `paper`: their colour as shown; `auto` is a light grey.
                paper_color: Option<[f64; 3]> = ParamValue::Auto, 0.0 => 1.0, "";
                /// Fidelity `paper`: opacity of each Gaussian.
                paper_opacity: f64 = ParamValue::Number($opacity), 0.0 => 1.0, "";
                /// Fidelity `paper`: length of a drop's long axis, or of a flake's three arms; four
                /// standard deviations.
                paper_length: f64 = ParamValue::Number($length), 0.000_01 => 100.0, "m";
                /// Fidelity `paper`: the same across; `auto` is a tenth of the length.
                paper_width: Option<f64> = $width, 0.000_01 => 100.0, "m";
                /// Fidelity `paper`: k, the number of sub-clouds that are rendered apart: a whole
                /// number.
                paper_k: f64 = ParamValue::Number(4.0), 1.0 => 64.0, "";
                /// Fidelity `paper`: L_sky, mean brightness of the sky as shown; `auto` takes the
                /// airlight.
                paper_l_sky: Option<f64> = ParamValue::Auto, 0.0 => 4.0, "";
                /// Fidelity `paper`: least `L_sky - L` that counts; below 0 they darken what is
                /// brighter than the sky.
                paper_t_min: f64 = ParamValue::Number($t_min), -4.0 => 4.0, "";
                /// Fidelity `paper`: greatest `L_sky - L` that counts.
                paper_t_max: f64 = ParamValue::Number($t_max), -4.0 => 4.0, "";
                /// Fidelity `paper`: t_D, up to where they are seen; `auto` is where they are 0.3
                /// px wide.
                paper_t_d: Option<f64> = ParamValue::Auto, 0.0 => 1e7, "m";
                /// Fidelity `paper`: t_C, brightness as shown below which noise is left out.
                paper_t_c: f64 = ParamValue::Number(0.02), 0.0 => 1.0, "";
                /// Fidelity `paper`: depth that D_ref takes for 1; `auto` takes three times the
                /// radius of the scene.
                paper_d_max: Option<f64> = ParamValue::Auto, 0.01 => 1e7, "m";
                /// Fidelity `paper`: I_style of the light fog over the distance; 0 for none.
                paper_fog: f64 = ParamValue::Number($fog), 0.0 => 1000.0, "";
                /// Fidelity `paper`: C_fog of it; `auto` takes the airlight.
                paper_fog_color: Option<[f64; 3]> = ParamValue::Auto, 0.0 => 1.0, "";
                /// Fidelity `paper`: standard deviation of the last blur; 0 for none.
                paper_blur: f64 = ParamValue::Number(0.5), 0.0 => 20.0, "px";
                /// Fidelity `paper`: exposure of the colour filter; see `look`.
                paper_exposure: f64 = ParamValue::Number(-0.5), -10.0 => 10.0, "EV";
                /// Fidelity `paper`: saturation of the colour filter.
                paper_saturation: f64 = ParamValue::Number(0.7), 0.0 => 4.0, "";
                /// Fidelity `paper`: contrast of the colour filter.
                paper_contrast: f64 = ParamValue::Number(0.85), 0.1 => 4.0, "";
                /// Fidelity `paper`: shift of the white balance by the colour filter.
                paper_temperature: f64 = ParamValue::Number(-0.2), -1.0 => 1.0, "";
            }
        }

        /// The entry of [`EFFECTS`](super::EFFECTS).
        pub(crate) const EFFECT: Effect = Effect {
            name: $name,
            about: $about,
            role: EffectRole::Falls,
            needs: &[Need::Shelter],
            precipitation: Some(&$kind),
            params: DropsParams::PARAMS,
            contribute: |now, weather| {
                let own = DropsParams::of(now.values);
                let airlight = own.airlight.map_or(weather.site().airlight, |color| color.map(srgb_decode));
                let look = ParticleAppearance {
                    seed: own.seed as u64,
                    exposure: own.exposure,
                    size: own.size,
                    opacity: own.opacity,
                    brightness: own.brightness,
                    radiance: own.color.map(|color| color.map(srgb_decode)),
                };
                weather.add_fall(Precipitation::new(&$kind, own.rate, airlight, look));
            },
            contribute_as_paper: Some(|now, weather| {
                let own = DropsParams::of(now.values);
                let fall = own.paper_fall(weather.site(), now.tracks, now.time);
                weather.prepared.paper_falls.push(fall);
            }),
        };

        impl DropsParams {
            fn paper_fall(&self, site: &Site, tracks: &[Track], time: f64) -> PaperFall {
                let airlight = self.airlight.unwrap_or_else(|| site.airlight.map(srgb_encode));
                let d_max = self.paper_d_max.unwrap_or(site.far) / site.metres_per_unit;
                let fallen = EFFECT.param("paper_speed").map(|track| tracks[track].integral(0.0, time));
                PaperFall {
                    kind: &$kind,
                    seed: self.seed as u64,
                    number: self.paper_number.unwrap_or_else(|| $number * (self.rate / $usual).sqrt()),
                    edge: self.paper_box,
                    speed: self.paper_speed,
                    fallen: fallen.unwrap_or_default(),
                    color: self.paper_color.unwrap_or(GREY),
                    opacity: self.paper_opacity,
                    length: self.paper_length,
                    width: self.paper_width.unwrap_or(0.1 * self.paper_length),
                    layers: self.paper_k as usize,
                    sky: self.paper_l_sky.unwrap_or_else(|| airlight.iter().sum::<f64>() / 3.0),
                    t: [self.paper_t_min, self.paper_t_max],
                    t_d: self.paper_t_d,
                    t_c: self.paper_t_c,
                    d_max,
                    fog: PaperFog {
                        intensity: self.paper_fog,
                        color: self.paper_fog_color.unwrap_or(airlight),
                        d_max,
                    },
                    blur: self.paper_blur,
                    filter: ColorGrade::new(
                        self.paper_exposure,
                        self.paper_saturation,
                        self.paper_contrast,
                        self.paper_temperature,
                    ),
                }
            }
        }
    };
}

/// The names that [`drops!`] needs in scope.
pub(super) mod prelude {
    pub(in crate::effects) use crate::effects::effect::{Effect, EffectRole, Need};
    pub(in crate::effects) use crate::grade::ColorGrade;
    pub(in crate::effects) use crate::optics::Site;
    pub(in crate::effects) use crate::paper::{PaperFall, PaperFog};
    pub(in crate::effects) use crate::param::ParamValue;
    pub(in crate::effects) use crate::particles::{ParticleAppearance, Precipitation};
    pub(in crate::effects) use crate::track::Track;
    pub(in crate::effects) use wm_render::frame::{srgb_decode, srgb_encode};

    /// The paper's "grayish RGB tone".
    pub(in crate::effects) const GREY: [f64; 3] = [0.8; 3];
}

pub(super) use drops;
