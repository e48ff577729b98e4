//! An effect, and the weather at an instant that it reads.

use crate::param::{Param, ParamKind, ParamValue};
use crate::particles::PrecipitationKind;
use crate::track::Track;
use crate::weather::builder::WeatherBuilder;
use crate::weather::fidelity::Fidelity;
use std::fmt;

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
    /// The effect by the paper's formulas; `None` if the paper does not have the effect.
    pub(crate) contribute_as_paper: Option<Contribute>,
}

impl PartialEq for Effect {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

impl fmt::Debug for Effect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name)
    }
}

impl Effect {
    /// The words that stand for the whole effect, `sky = "clear"`: those of its first parameter.
    #[must_use]
    pub fn words(&self) -> &'static [&'static str] {
        match self.params.first().map(|param| param.kind) {
            Some(ParamKind::Word(words)) => words,
            _ => &[],
        }
    }

    /// The position of a parameter in the table.
    #[must_use]
    pub fn param(&self, name: &str) -> Option<usize> {
        self.params.iter().position(|param| param.name == name)
    }
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

/// Data of a place that an effect needs, beside its [`Site`](crate::Site), before the first frame.
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
    /// The values of the parameters, each checked by its entry.
    pub(crate) values: &'a [ParamValue],
    /// The parameters over all time, for what adds up over time.
    pub(crate) tracks: &'a [Track],
    /// The instant, seconds.
    pub(crate) time: f64,
    /// The whole weather: what one effect leaves may depend on another.
    pub(crate) weather: &'a WeatherSample,
}

/// The weather at one instant: all that a frame depends on.
#[derive(Clone, Debug, PartialEq)]
pub struct WeatherSample {
    /// Whose formulas are used.
    pub fidelity: Fidelity,
    /// Seconds.
    pub time: f64,
    /// The effects that are on, in the order in which they act, with their values and tracks.
    pub(crate) effects: Vec<(&'static Effect, Vec<ParamValue>, Vec<Track>)>,
}

impl WeatherSample {
    /// The effects that are on, with their values in the order of their tables.
    pub fn effects(&self) -> impl Iterator<Item = (&'static Effect, &[ParamValue])> {
        self.effects.iter().map(|(effect, values, _)| (*effect, &values[..]))
    }

    /// Returns true if an effect is on.
    #[must_use]
    pub fn is_on(&self, effect: &str) -> bool {
        self.effects.iter().any(|(on, _, _)| on.name == effect)
    }

    /// A parameter over time, if its effect is on.
    #[must_use]
    pub fn track(&self, effect: &str, param: &str) -> Option<&Track> {
        let (on, _, tracks) = self.effects.iter().find(|(on, _, _)| on.name == effect)?;
        tracks.get(on.param(param)?)
    }

    /// Returns true if lamps are wanted where the scene states none.
    #[must_use]
    pub fn asks_for_guessed_lamps(&self) -> bool {
        let lamps = self.track("light", "lamps").map(|track| track.at(self.time));
        matches!(lamps, Some(ParamValue::Word("path")))
    }
}
