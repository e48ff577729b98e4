//! What rain and snowfall have in common: one set of parameters, different defaults.

/// Declares the parameters of a kind of precipitation and its [`Effect`](super::Effect).
macro_rules! drops {
    (
        name: $name:literal,
        about: $about:literal,
        kind: $kind:expr,
        $(#[doc = $meaning:literal])+
        rate: $rate:literal, $most:literal,
    ) => {
        $crate::params! {
            /// What can be set.
            pub struct Params {
                $(#[doc = $meaning])+
                rate: f64 = Value::Number($rate), 0.0 => $most, "mm/h";
                /// How long the camera's shutter is open: streaks are as long as the way in that time.
                exposure: f64 = Value::Number(0.0166), 0.000_01 => 1.0, "s";
                /// Factor on the diameters that are drawn; their number, speed and the air stay as they are.
                size: f64 = Value::Number(1.0), 0.1 => 10.0, "";
                /// Factor on what they cover.
                opacity: f64 = Value::Number(1.0), 0.0 => 100.0, "";
                /// Factor on their light.
                brightness: f64 = Value::Number(1.0), 0.0 => 10.0, "";
                /// Their colour; `auto` is that of the surroundings: three quarters of the airlight.
                color: Option<[f64; 3]> = Value::Auto, 0.0 => 1.0, "";
                /// Colour of an endless depth of it; `auto` takes the scene's sky near the horizon.
                airlight: Option<[f64; 3]> = Value::Auto, 0.0 => 1.0, "";
                /// Which of the equally likely falls: a whole number.
                seed: f64 = Value::Number(0.0), 0.0 => 9_007_199_254_740_992.0, "";
            }
        }

        /// The entry of [`EFFECTS`](super::EFFECTS).
        pub const EFFECT: Effect = Effect {
            name: $name,
            about: $about,
            slot: Slot::Particles,
            params: Params::PARAMS,
            act: |now, site| {
                let own = Params::of(now.values);
                let airlight = own.airlight.map_or(site.airlight, |color| color.map(srgb_decode));
                let look = Look {
                    seed: own.seed as u64,
                    exposure: own.exposure,
                    size: own.size,
                    opacity: own.opacity,
                    brightness: own.brightness,
                    radiance: own.color.map(|color| color.map(srgb_decode)),
                };
                Action::Precipitation(Box::new(Precipitation::new($kind, own.rate, airlight, look)))
            },
            act_as_paper: None,
        };
    };
}

/// What [`drops!`] needs in scope.
pub(super) mod prelude {
    pub(in crate::effects) use crate::effects::{Action, Effect};
    pub(in crate::effects) use crate::param::Value;
    pub(in crate::effects) use crate::particles::{Kind, Look, Precipitation};
    pub(in crate::effects) use wm_render::frame::srgb_decode;
    pub(in crate::effects) use wm_render::hooks::Slot;
}

pub(super) use drops;
