//! The effects. One file each, one line in the list below.
//!
//! An effect says what it is, where in the render it acts, and what parameters it has; from the
//! values of its parameters at one instant it makes what the renderer needs. It keeps no state: any
//! instant can be asked for alone.
//!
//! The shortest one is fog (`fog.rs`), one that falls is hail (`hail.rs`). An effect declares its
//! role ([`EffectRole`]), what a place must have prepared for it ([`Need`]) and, if it falls, a
//! table of laws ([`PrecipitationKind`]: sizes, speeds, shapes). Nobody infers these from a hook or
//! a name. The weather file, `--set`, `--help`, the viewer and `docs/reference/weather.md` are made
//! from the table of parameters of each effect.

use crate::particles::PrecipitationKind;
pub use effect::{Effect, EffectRole, Need};

mod air;
mod drops;
pub(crate) mod effect;
mod light_in_picture;

macro_rules! effects {
    ($($name:ident),+ $(,)?) => {
        $(pub(crate) mod $name;)+

        /// Every effect, in the order in which they act.
        pub const EFFECTS: &[Effect] = &[$($name::EFFECT),+];
    };
}

effects! { sky, light, lightning, dust_cover, snow_cover, wetness, flood, wind, fog, haze, smog, rain, snowfall, hail, splash, look, lens, rainbow, glare }

impl Effect {
    /// The effect of a name.
    #[must_use]
    pub fn named(name: &str) -> Option<&'static Self> {
        EFFECTS.iter().find(|effect| effect.name == name)
    }

    /// The effect of a kind of precipitation.
    #[must_use]
    pub fn of_precipitation(kind: &PrecipitationKind) -> Option<&'static Self> {
        EFFECTS.iter().find(|effect| effect.precipitation == Some(kind))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_unique_and_defaults_fit() {
        for (i, effect) in EFFECTS.iter().enumerate() {
            assert!(EFFECTS[..i].iter().all(|other| other.name != effect.name));
            for (k, param) in effect.params.iter().enumerate() {
                assert_eq!(effect.param(param.name), Some(k), "{} has {} twice", effect.name, param.name);
                assert_eq!(
                    param.check(param.default.clone()),
                    Ok(param.default.clone()),
                    "{}.{}",
                    effect.name,
                    param.name
                );
                assert!(!param.meaning.trim().is_empty());
            }
            assert_eq!(effect.precipitation.is_some(), effect.role == EffectRole::Falls, "{}", effect.name);
            let rate = effect.param("rate").map(|rate| effect.params[rate].unit);
            assert!(
                effect.role != EffectRole::Falls || rate == Some("mm/h"),
                "{} falls at a rate",
                effect.name
            );
        }
    }
}
