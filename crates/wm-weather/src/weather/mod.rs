//! A weather over time, sampled at an instant and prepared for the renderer.

pub(crate) mod builder;
pub(crate) mod fidelity;
pub(crate) mod observer;
mod pass;
pub(crate) mod prepared;
mod sample;
pub(crate) mod slant;

pub use crate::effects::effect::WeatherSample;
use crate::effects::{EFFECTS, Effect, EffectRole, Need};
use crate::image_file::ImageFile;
use crate::optics::LampSource;
use crate::panorama::Panorama;
use crate::param::ParamValue;
use crate::track::Track;
pub use fidelity::Fidelity;
pub use observer::Observer;
pub use pass::PassWeather;
pub use prepared::{PixelContribution, PreparedWeather};
use std::path::Path;
use std::sync::Arc;

/// A weather: effects with their parameters over time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Weather {
    /// Name of the weather.
    pub name: String,
    /// A description in one line.
    pub about: String,
    /// Whose formulas are used.
    pub fidelity: Fidelity,
    /// For each effect of [`EFFECTS`] that is on, its tracks in the order of its table.
    active: Vec<(usize, Vec<Track>)>,
}

impl Weather {
    /// No weather at all.
    #[must_use]
    pub fn clear() -> Self {
        Self { name: "clear".into(), about: "No weather".into(), ..Self::default() }
    }

    /// The effects that are on, in the order in which they act, with their tracks.
    pub fn effects(&self) -> impl Iterator<Item = (&'static Effect, &[Track])> {
        self.active.iter().map(|(effect, tracks)| (&EFFECTS[*effect], &tracks[..]))
    }

    /// The weather as a camera of another exposure time sees it: the exposure of all that falls, s.
    #[must_use]
    pub fn exposed_for(&self, seconds: f64) -> Self {
        let mut exposed = self.clone();
        for (effect, tracks) in &mut exposed.active {
            for (param, track) in EFFECTS[*effect].params.iter().zip(tracks) {
                if param.name == "exposure" && param.unit == "s" {
                    *track = Track::constant(ParamValue::Number(seconds.clamp(param.range.0, param.range.1)));
                }
            }
        }
        exposed
    }

    /// Returns true if no parameter changes over time.
    #[must_use]
    pub fn is_constant(&self) -> bool {
        self.effects().all(|(_, tracks)| tracks.iter().all(|track| track.keys().len() == 1))
    }

    /// Returns true if an effect of a role is on.
    #[must_use]
    pub fn has(&self, role: EffectRole) -> bool {
        self.effects().any(|(effect, _)| effect.role == role)
    }

    /// Returns true if an effect that is on needs this of a place, in this weather's fidelity:
    /// effects in the paper's own form need nothing.
    #[must_use]
    pub fn needs(&self, need: Need) -> bool {
        let is_physical =
            |effect: &Effect| self.fidelity == Fidelity::Physical || effect.contribute_as_paper.is_none();
        self.effects().any(|(effect, _)| is_physical(effect) && effect.needs.contains(&need))
    }

    /// Returns true if it has a sun of its own at some time, and its light changes over time.
    #[must_use]
    pub fn moves_sun(&self) -> bool {
        let mut light = self.effects().filter(|(effect, _)| effect.role == EffectRole::Light);
        light.any(|(effect, tracks)| {
            let is_clear = |value: &ParamValue| *value == ParamValue::Word("clear");
            let model = effect.param("model").map(|param| &tracks[param]);
            let has_sun = model.is_some_and(|track| track.keys().iter().any(|key| is_clear(&key.value)));
            has_sun && tracks.iter().any(|track| track.keys().len() > 1)
        })
    }

    /// The lamps that it asks for at some time.
    #[must_use]
    pub fn lamp_sources(&self) -> Vec<LampSource> {
        let light = self.effects().find(|(effect, _)| effect.name == "light");
        let lamps = light.and_then(|(effect, tracks)| Some(&tracks[effect.param("lamps")?]));
        let mut found: Vec<LampSource> = Vec::new();
        for key in lamps.iter().flat_map(|track| track.keys()) {
            let source = match key.value {
                ParamValue::Word("off") => continue,
                ParamValue::Word("path") => LampSource::Path,
                _ => LampSource::Scene,
            };
            if !found.contains(&source) {
                found.push(source);
            }
        }
        found
    }

    /// Turns an effect on with its defaults; leaves it as it is if it is on.
    pub(crate) fn turn_on(&mut self, effect: usize) -> &mut Vec<Track> {
        let place = self.active.partition_point(|(on, _)| *on < effect);
        if self.active.get(place).is_none_or(|(on, _)| *on != effect) {
            let defaults = EFFECTS[effect].params.iter().map(|param| Track::constant(param.default.clone()));
            self.active.insert(place, (effect, defaults.collect()));
        }
        &mut self.active[place].1
    }

    /// Turns an effect off.
    pub(crate) fn turn_off(&mut self, effect: usize) {
        self.active.retain(|(on, _)| *on != effect);
    }

    /// The pictures that its parameters name.
    pub(crate) fn images(&mut self) -> impl Iterator<Item = &mut ImageFile> {
        self.active.iter_mut().flat_map(|(_, tracks)| tracks.iter_mut().flat_map(Track::images))
    }

    /// Takes the relative paths of its pictures as from `folder`.
    pub fn resolve_images(&mut self, folder: &Path) {
        self.images().for_each(|picture| picture.move_to(folder));
    }

    /// Reads the pictures that its parameters name, each by `read`; to be called before anything is
    /// rendered. What is not read is not shown.
    ///
    /// # Errors
    /// The first of `read`.
    pub fn load_images<E>(
        &mut self,
        mut read: impl FnMut(&Path) -> Result<Arc<Panorama>, E>,
    ) -> Result<(), E> {
        for picture in self.images() {
            let panorama = read(picture.path())?;
            picture.fill(panorama);
        }
        Ok(())
    }

    /// The weather at one instant, `time` in seconds.
    #[must_use]
    pub fn at(&self, time: f64) -> WeatherSample {
        let values = |tracks: &[Track]| tracks.iter().map(|track| track.at(time)).collect();
        let active = self.active.iter();
        let effects =
            active.map(|(effect, tracks)| (&EFFECTS[*effect], values(tracks), tracks.clone())).collect();
        WeatherSample { fidelity: self.fidelity, time, effects }
    }
}
