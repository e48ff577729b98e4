//! What weather is on, over time, and how it reaches the renderer.

use crate::dome::Dome;
use crate::effects::look::Grade;
use crate::effects::{Action, EFFECTS, Effect};
use crate::optics::{Atmosphere, Daylight, Site};
use crate::panorama::Panorama;
use crate::paper::PaperFog;
use crate::param::Value;
use crate::picture::Picture;
use crate::track::Track;
use std::path::Path;
use std::sync::Arc;
use wm_render::hooks::{Backdrop, Hooks, Medium, PixelEffect, SkySplats};

/// Whose formulas are used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Fidelity {
    /// Physical units, linear light, each splat at its own ray length.
    #[default]
    Physical,
    /// The paper's formulas as they are printed.
    Paper,
}

impl Fidelity {
    /// Every fidelity.
    pub const ALL: [Self; 2] = [Self::Physical, Self::Paper];

    /// The name in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Physical => "physical",
            Self::Paper => "paper",
        }
    }
}

/// A weather: effects with their parameters over time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Weather {
    /// Its name.
    pub name: String,
    /// What it is, in one line.
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
    pub(crate) fn pictures(&mut self) -> impl Iterator<Item = &mut Picture> {
        self.active.iter_mut().flat_map(|(_, tracks)| tracks.iter_mut().flat_map(Track::pictures))
    }

    /// Reads the pictures that its parameters name, each by `read`; to be called before anything is
    /// rendered. What is not read is not shown.
    ///
    /// # Errors
    /// The first of `read`.
    pub fn load_pictures<E>(&mut self, mut read: impl FnMut(&Path) -> Result<Panorama, E>) -> Result<(), E> {
        for picture in self.pictures() {
            let panorama = read(picture.path())?;
            picture.fill(Arc::new(panorama));
        }
        Ok(())
    }

    /// The weather at one instant, `time` in seconds.
    #[must_use]
    pub fn at(&self, time: f64) -> Instant {
        let values = |tracks: &[Track]| tracks.iter().map(|track| track.at(time)).collect();
        let effects = self.active.iter().map(|(effect, tracks)| (*effect, values(tracks))).collect();
        Instant { fidelity: self.fidelity, effects }
    }
}

/// The weather at one instant: all that a frame depends on.
#[derive(Clone, Debug, PartialEq)]
pub struct Instant {
    /// Whose formulas are used.
    pub fidelity: Fidelity,
    effects: Vec<(usize, Vec<Value>)>,
}

impl Instant {
    /// The effects that are on, with their values in the order of their tables.
    pub fn effects(&self) -> impl Iterator<Item = (&'static Effect, &[Value])> {
        self.effects.iter().map(|(effect, values)| (&EFFECTS[*effect], &values[..]))
    }

    /// What the renderer needs of this weather at one place.
    #[must_use]
    pub fn over(&self, site: &Site) -> Sky {
        let (mut site, mut dome) = (*site, None);
        let mut layers = Vec::new();
        let mut paper = Vec::new();
        let mut grade = None;
        for (effect, values) in self.effects() {
            let act = match self.fidelity {
                Fidelity::Physical => effect.act,
                Fidelity::Paper => effect.act_as_paper.unwrap_or(effect.act),
            };
            match act(values, &site) {
                // First of all effects: the light of the others is its.
                Action::Sky(sky) => {
                    let is_its = site.daylight == Daylight::Guessed || sky.scenes_sky() == SkySplats::LeftOut;
                    site.airlight = sky.airlight().filter(|_| is_its).unwrap_or(site.airlight);
                    dome = Some(sky);
                }
                Action::Layer(layer) => layers.push(layer),
                Action::PaperFog(fog) => paper.push(fog),
                Action::Grade(change) => grade = (!change.is_neutral()).then_some(change),
            }
        }
        Sky { air: Atmosphere::new(layers, site), paper, dome, grade }
    }
}

/// One instant's weather over one site, ready to render through.
#[derive(Clone, Debug, PartialEq)]
pub struct Sky {
    /// The air.
    pub air: Atmosphere,
    paper: Vec<PaperFog>,
    /// What stands behind everything, if the weather says it.
    dome: Option<Dome>,
    /// Exposure and colour of the finished picture; `None` leaves it as it is.
    grade: Option<Grade>,
}

impl Sky {
    /// What stands behind everything, if the weather says it.
    #[must_use]
    pub fn dome(&self) -> Option<&Dome> {
        self.dome.as_ref()
    }

    /// Calls `render` with the hooks of this weather.
    pub fn with_hooks<R>(&self, render: impl FnOnce(Hooks<'_>) -> R) -> R {
        let mut pixels: Vec<&dyn PixelEffect> =
            self.paper.iter().map(|fog| fog as &dyn PixelEffect).collect();
        // The lens comes last.
        pixels.extend(self.grade.as_ref().map(|grade| grade as &dyn PixelEffect));
        let medium = (!self.air.is_clear()).then_some(&self.air as &dyn Medium);
        let background = self.dome.as_ref().map(|dome| dome as &dyn Backdrop);
        render(Hooks { background, medium, pixels: &pixels })
    }
}
