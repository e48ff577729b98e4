//! The steps of a training: render, compare, derive, move.
//!
//! The trainer knows no single loss and no files. Its state after a number of steps is a pure
//! function of configuration, photos and first splats: random numbers are keyed by the step, and
//! no sum depends on the number of threads. So a training that is interrupted and resumed ends in
//! the same bytes.

mod report;
mod step;
#[cfg(test)]
mod tests;

pub use report::{StepReport, StepTimes};

use crate::config::{ExposureMode, TrainConfig};
use crate::densify::Population;
use crate::exposure::Exposures;
use crate::learner::Learner;
use crate::losses::{self, LossGradients, LossTerm, TrainPhoto};
use crate::random::{Purpose, Random};
use crate::schedule;
use wm_render::simd::SimdPath;
use wm_render::{Differentiable, EvenAir, ForwardConfig, Frame, RenderError, StepClock};
use wm_scene::{Camera, Splats};

/// A training in progress.
pub struct Trainer {
    pub(crate) config: TrainConfig,
    terms: Vec<Box<dyn LossTerm>>,
    learner: Learner,
    pub(crate) state: TrainState,
    /// The number of steps that `state` contains; a device may be ahead.
    known: u32,
    extent: f64,
    /// The number of training photos.
    photos: usize,
    work: Work,
    /// The haze of the photos, which the scene does not contain.
    pub(crate) air: Option<EvenAir>,
    /// The orders of the last two epochs in use: prefetched steps may belong to the next epoch.
    orders: [Order; 2],
}

/// The order in which an epoch sees the photos.
#[derive(Default)]
struct Order {
    epoch: u32,
    places: Vec<usize>,
}

/// The state of a training between two steps.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TrainState {
    /// Steps that are done.
    pub step: u32,
    /// The splats and what is known of them.
    pub(crate) population: Population,
    /// The exposures of the photos; empty if they are shared.
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
    /// Returns a trainer that begins with `splats`, for a scene of `extent` units and `photos`
    /// photos, on the back end `renderer`.
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

    /// Returns a trainer that continues from `state`; `extent` and `photos` are those of the
    /// start.
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

    /// Steps that are done.
    pub(crate) fn steps_done(&self) -> u32 {
        self.state.step
    }

    /// Returns the number of splats.
    #[must_use]
    pub fn len(&self) -> usize {
        self.learner.count(&self.state.population)
    }

    /// Returns true if there are no splats.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the state after the steps so far. If the device fails and another takes over, these
    /// are fewer steps than before.
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

    /// Continues on another device after `error`, from the state in memory; returns the number of
    /// lost steps.
    fn go_back(&mut self, error: RenderError) -> Result<u32, RenderError> {
        if !error.is_of_gpu() {
            return Err(error);
        }
        self.learner.give_up(error)?;
        // A step that failed after densification counts as done.
        let lost = self.state.step.saturating_sub(self.known);
        self.state.step = self.known;
        Ok(lost)
    }

    /// Returns the state in memory, which may be behind that on the device: what is left if the
    /// device fails.
    pub(crate) fn known_state(&mut self) -> &TrainState {
        self.state.step = self.known;
        &self.state
    }

    /// Returns the SIMD path in use.
    pub(crate) fn path(&self) -> SimdPath {
        self.learner.renderer.path()
    }

    /// Returns the back end in words.
    pub(crate) fn describe(&self) -> String {
        self.learner.renderer.describe()
    }

    /// Returns the times of the last step by the clock of the device, if it has one.
    pub fn clock(&mut self) -> Option<StepClock> {
        self.learner.clock()
    }

    /// Returns the number of threads in use.
    #[must_use]
    pub fn threads(&self) -> usize {
        self.learner.renderer.pool().current_num_threads()
    }

    /// Returns true if all steps are done.
    #[must_use]
    pub fn is_done(&self) -> bool {
        self.state.step >= self.config.steps
    }

    /// Returns the index of the photo of step `step` (from 0): each photo occurs once per epoch,
    /// in a random order.
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
    pub(crate) fn level_at(&self, step: u32, last_level: u8) -> u8 {
        schedule::level(&self.config, step, last_level)
    }

    /// Takes one step on `truth`, the photo with index `photo`. If the device fails and another
    /// takes over, no step is taken, and the report states the lost steps.
    ///
    /// # Errors
    /// [`RenderError`] if the camera cannot be rendered with, memory is short or the device fails.
    pub fn step(&mut self, truth: &TrainPhoto<'_>, photo: usize) -> Result<StepReport, RenderError> {
        let pool = std::sync::Arc::clone(self.learner.renderer.pool());
        match pool.install(|| self.step_on_pool(truth, photo)) {
            Err(error) => Ok(StepReport { lost: self.go_back(error)?, ..StepReport::default() }),
            done => done,
        }
    }

    /// Renders the splats over black, without the exposure and haze of any photo.
    ///
    /// # Errors
    /// [`RenderError`] if the camera cannot be rendered with, memory is short or the device fails.
    pub fn render(&mut self, camera: &Camera, frame: &mut Frame) -> Result<(), RenderError> {
        self.render_through(None, camera, frame)
    }

    /// Renders as [`Self::render`], but through the haze of the photos, for comparison with them.
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
            rasterization: self.config.rasterization,
            sh_degree: self.config.sh_degree,
            air,
            ..ForwardConfig::default()
        };
        if let Err(error) = self.learner.forward(&self.state.population, camera, &config, frame) {
            self.go_back(error)?;
            self.learner.forward(&self.state.population, camera, &config, frame)?;
        }
        Ok(())
    }
}

/// Memory of one step.
#[derive(Default)]
struct Work {
    frame: Frame,
    /// The colours of the scene before the photo's exposure.
    rendered: Vec<f32>,
    loss: LossGradients,
}
