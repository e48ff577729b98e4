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

use crate::param::{Param, ParamKind, ParamValue};
use crate::particles::PrecipitationKind;
use crate::track::Track;
use crate::weather::{WeatherBuilder, WeatherSample};
pub use flood::Flood;
pub(crate) use light::LightChange;
pub use light::{LampSource, light_fault};
pub(crate) use look::ColorGrade;

mod air;
mod drops;

/// Adds an effect to a weather at one instant of one place.
pub(crate) type Contribute = fn(&EffectContext<'_>, &mut WeatherBuilder);

/// One kind of weather.
pub struct Effect {
    /// Name in files and flags.
    pub name: &'static str,
    /// A description in one line.
    pub about: &'static str,
    /// The kind of effect.
    pub role: EffectRole,
    /// Data of the place that must be prepared before the effect is rendered in physical units.
    pub needs: &'static [Need],
    /// The laws of what falls; `Some` for every effect whose role is [`EffectRole::Falls`], whose
    /// parameter `rate` is then in mm/h of water, and for no other.
    pub precipitation: Option<&'static PrecipitationKind>,
    /// Table of parameters.
    pub params: &'static [Param],
    /// Adds what the effect contributes at the values of its parameters.
    pub(crate) contribute: Contribute,
    /// The same by the paper's formulas; `None` if the paper does not have the effect.
    pub(crate) contribute_as_paper: Option<Contribute>,
}

/// The kind of an effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EffectRole {
    /// Changes what stands behind the scene.
    Sky,
    /// Changes the light on the scene.
    Light,
    /// Fills the air with particles too small to be seen.
    Air,
    /// Falls through the air.
    Falls,
    /// Lies on the ground.
    Lies,
    /// Wets surfaces, or stands on the ground and mirrors.
    Water,
    /// Moves the air.
    Wind,
    /// Changes the finished picture.
    Lens,
}

impl EffectRole {
    /// The name in documentation and JSON.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Sky => "sky",
            Self::Light => "light",
            Self::Air => "air",
            Self::Falls => "falls",
            Self::Lies => "lies",
            Self::Water => "water",
            Self::Wind => "wind",
            Self::Lens => "lens",
        }
    }
}

/// Data of a place that an effect needs, beside its [`Site`], before the first frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Need {
    /// The map of what roofs and trees shelter ([`crate::shelter`]).
    Shelter,
    /// The surfaces that something can lie on ([`crate::cover`]).
    Cover,
    /// The light of the capture ([`crate::light`]).
    Light,
    /// The surfaces that get wet, and the ground that water stands on ([`crate::wetness`]).
    Water,
}

/// The parameters of an effect at one instant, in the order of its table.
#[derive(Clone, Copy, Debug)]
pub(crate) struct EffectContext<'a> {
    /// Their values, each checked by its entry.
    pub(crate) values: &'a [ParamValue],
    /// The parameters over all time, for what adds up over time.
    pub(crate) tracks: &'a [Track],
    /// The instant, seconds.
    pub(crate) time: f64,
    /// The whole weather: what one effect leaves may depend on another.
    pub(crate) weather: &'a WeatherSample,
}

macro_rules! effects {
    ($($name:ident),+ $(,)?) => {
        $(pub(crate) mod $name;)+

        /// Every effect, in the order in which they act.
        pub const EFFECTS: &[Effect] = &[$($name::EFFECT),+];
    };
}

effects! { sky, light, lightning, dust_cover, snow_cover, wetness, flood, wind, fog, haze, smog, rain, snowfall, hail, splash, look, lens, rainbow }

impl Effect {
    /// The effect of a name.
    #[must_use]
    pub fn named(name: &str) -> Option<&'static Self> {
        EFFECTS.iter().find(|effect| effect.name == name)
    }

    /// The words that stand for the whole effect, `sky = "clear"`: those of its first parameter.
    #[must_use]
    pub fn words(&self) -> &'static [&'static str] {
        match self.params.first().map(|param| param.kind) {
            Some(ParamKind::Word(words)) => words,
            _ => &[],
        }
    }

    /// The effect of a kind of precipitation.
    #[must_use]
    pub fn of_precipitation(kind: &PrecipitationKind) -> Option<&'static Self> {
        EFFECTS.iter().find(|effect| effect.precipitation == Some(kind))
    }

    /// The position of a parameter in the table.
    #[must_use]
    pub fn param(&self, name: &str) -> Option<usize> {
        self.params.iter().position(|param| param.name == name)
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
