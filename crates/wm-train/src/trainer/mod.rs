//! The steps of a training: render, compare, derive, move.
//!
//! The trainer names no loss and knows no file. Its state after a number of steps is a pure
//! function of configuration, photos and starting splats: random numbers are keyed by the step, no
//! sum depends on threads. So a training that is broken off and gone on with ends in the same
//! bytes.

mod report;
mod step;
#[cfg(test)]
mod tests;

pub use report::{StepReport, StepTimes};

use crate::config::{ExposureMode, TrainConfig};
use crate::densify::Population;
use crate::exposure::Exposures;
use crate::learner::Learner;
use crate::losses::{self, LossTerm, TrainPhoto};
use crate::random::{Purpose, Random};
use crate::schedule;
use step::Work;
use wm_render::simd::SimdPath;
use wm_render::{
    Channels, Differentiable, DrawnSplats, EvenAir, ForwardConfig, Frame, Opacity, RenderError, StepClock,
};
use wm_scene::{Camera, Splats};

/// Steps after which what a device has learnt is read back, to go on with should it be lost.
const READ_BACK_STEPS: u32 = 500;

/// A training under way.
pub struct Trainer {
    config: TrainConfig,
    terms: Vec<Box<dyn LossTerm>>,
    learner: Learner,
    state: TrainState,
    /// The steps that the state here knows, where a device is ahead.
    known: u32,
    extent: f64,
    /// Photos that teach.
    photos: usize,
    work: Work,
    /// The haze that photos show and the scene is without.
    air: Option<EvenAir>,
    /// The orders of the last two epochs that were asked for: steps ahead reach into the next.
    orders: [Order; 2],
}

/// The order in which an epoch sees the photos.
#[derive(Default)]
struct Order {
    epoch: u32,
    places: Vec<usize>,
}

/// Everything that a step leaves to the next.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TrainState {
    /// Steps that are done.
    pub step: u32,
    /// The splats and what is known of them.
    pub(crate) population: Population,
    /// The photos' own exposures; none where they are shared.
    pub(crate) exposures: Exposures,
}

impl TrainState {
    /// Returns the state before the first step; `exposed` photos have exposures of their own.
    #[must_use]
    pub fn new(splats: Splats, exposed: usize) -> Self {
        Self { step: 0, population: Population::new(splats), exposures: Exposures::new(exposed) }
    }

    /// Returns the splats.
    #[must_use]
    pub fn splats(&self) -> &Splats {
        &self.population.splats
    }
}

impl Trainer {
    /// Begins with `splats` in a scene of `extent` units that `photos` photos show, on the back end
    /// `renderer`.
    #[must_use]
    pub fn new(
        config: TrainConfig,
        renderer: Box<dyn Differentiable>,
        splats: Splats,
        extent: f64,
        photos: usize,
    ) -> Self {
        let exposed = if config.exposure == ExposureMode::Photo { photos } else { 0 };
        let state = TrainState::new(splats, exposed);
        Self::resumed(config, renderer, state, extent, photos)
    }

    /// Goes on from `state`; `extent` and `photos` as at the beginning.
    #[must_use]
    pub fn resumed(
        config: TrainConfig,
        renderer: Box<dyn Differentiable>,
        state: TrainState,
        extent: f64,
        photos: usize,
    ) -> Self {
        let terms = losses::terms(&config, renderer.path());
        let (learner, known) = (Learner::new(renderer), state.step);
        let (work, orders) = (Work::default(), Default::default());
        Self { config, terms, learner, state, known, extent, photos, work, air: None, orders }
    }

    /// Returns true if photos have exposures of their own.
    #[must_use]
    pub(crate) fn has_exposures(&self) -> bool {
        !self.state.exposures.changes.is_empty()
    }

    /// Begins with these exposures of the photos, which go on learning. Without this photos have
    /// exposures of their own only under [`ExposureMode::Photo`].
    pub(crate) fn set_exposures(&mut self, exposures: Exposures) {
        self.state.exposures = exposures;
    }

    /// Sets the haze through which photos show the scene: splats learn the colours that they have
    /// without it.
    pub(crate) fn set_air(&mut self, air: Option<EvenAir>) {
        self.air = air;
    }

    /// The configuration.
    #[must_use]
    pub(crate) fn config(&self) -> &TrainConfig {
        &self.config
    }

    /// Steps that are done.
    #[must_use]
    pub(crate) fn steps_done(&self) -> u32 {
        self.state.step
    }

    /// Number of splats.
    #[must_use]
    pub fn len(&self) -> usize {
        self.learner.count(&self.state.population)
    }

    /// Returns true if there are no splats.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The state after the steps so far. Where the device on which it is fails and there is another
    /// to go on with, these are fewer steps than before.
    ///
    /// # Errors
    /// [`RenderError`] if the device fails.
    pub fn state(&mut self) -> Result<&TrainState, RenderError> {
        match self.learner.sync(&mut self.state.population) {
            Err(error) => _ = self.go_back(error)?,
            Ok(_) => self.known = self.state.step,
        }
        Ok(&self.state)
    }

    /// Goes on with another device after `error`, from what is known here; gives the number of
    /// steps that are lost.
    fn go_back(&mut self, error: RenderError) -> Result<u32, RenderError> {
        if !error.is_of_gpu() {
            return Err(error);
        }
        self.learner.give_up(error)?;
        // A step that failed after splats came and went is done.
        let lost = self.state.step.saturating_sub(self.known);
        self.state.step = self.known;
        Ok(lost)
    }

    /// The state as it is known here, after the steps before a device went ahead: what is left
    /// where it fails.
    pub(crate) fn known_state(&mut self) -> &TrainState {
        self.state.step = self.known;
        &self.state
    }

    /// The SIMD path in use.
    #[must_use]
    pub(crate) fn path(&self) -> SimdPath {
        self.learner.renderer().path()
    }

    /// Returns the back end in words.
    #[must_use]
    pub(crate) fn describe(&self) -> String {
        self.learner.renderer().describe()
    }

    /// Times of steps by the clock of the device on which splats learn, if it has one.
    pub fn clock(&mut self) -> Option<StepClock> {
        self.learner.clock()
    }

    /// Threads in use.
    #[must_use]
    pub fn threads(&self) -> usize {
        self.learner.renderer().pool().current_num_threads()
    }

    /// Returns true if all steps are done.
    #[must_use]
    pub fn is_done(&self) -> bool {
        self.state.step >= self.config.steps
    }

    /// The place in the list of photos of the one that step `step` (from 0) sees: each once an
    /// epoch, in an order of its own.
    #[must_use]
    pub(crate) fn photo_at(&mut self, step: u32) -> usize {
        let count = self.photos as u32;
        let epoch = step / count;
        let order = &mut self.orders[(epoch % 2) as usize];
        if order.epoch != epoch || order.places.is_empty() {
            let places = Random::new(self.config.seed, Purpose::Order, epoch).permutation(self.photos);
            *order = Order { epoch, places };
        }
        order.places[(step % count) as usize]
    }

    /// Returns how often the sides of photos are halved for step `step`.
    #[must_use]
    pub(crate) fn level_at(&self, step: u32, last_level: u8) -> u8 {
        schedule::level(&self.config, step, last_level)
    }

    /// One step, on photo `photo` of `truth`. Where a device fails and there is another to go on
    /// with, it is no step, and says what was lost.
    ///
    /// # Errors
    /// [`RenderError`] if the camera cannot be rendered with, memory is short or the device fails.
    pub fn step(&mut self, truth: &TrainPhoto<'_>, photo: usize) -> Result<StepReport, RenderError> {
        let pool = std::sync::Arc::clone(self.learner.renderer().pool());
        match pool.install(|| self.step_on_pool(truth, photo)) {
            Err(error) => Ok(StepReport { lost: self.go_back(error)?, ..StepReport::default() }),
            done => done,
        }
    }

    /// Renders what has been learnt, over black, without any photo's exposure and without the
    /// photos' haze.
    ///
    /// # Errors
    /// [`RenderError`] if the camera cannot be rendered with, memory is short or the device fails.
    pub fn render(&mut self, camera: &Camera, frame: &mut Frame) -> Result<(), RenderError> {
        self.render_through(None, camera, frame)
    }

    /// As [`Self::render`], through the photos' haze: to be compared with them.
    ///
    /// # Errors
    /// As [`Self::render`].
    pub(crate) fn render_as_photo(&mut self, camera: &Camera, frame: &mut Frame) -> Result<(), RenderError> {
        self.render_through(self.air, camera, frame)
    }

    fn render_through(
        &mut self,
        air: Option<EvenAir>,
        camera: &Camera,
        frame: &mut Frame,
    ) -> Result<(), RenderError> {
        let config = ForwardConfig {
            channels: Channels::Color,
            background: [0.0; 3],
            rasterization: self.config.rasterization,
            opacity: Opacity::Stored,
            drawn: DrawnSplats::All,
            sh_degree: self.config.sh_degree,
            air,
        };
        if let Err(error) = self.learner.forward(&self.state.population, camera, &config, frame) {
            self.go_back(error)?;
            self.learner.forward(&self.state.population, camera, &config, frame)?;
        }
        Ok(())
    }
}
