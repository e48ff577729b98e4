//! The steps of a training: render, compare, derive, move.
//!
//! The trainer names no loss and knows no file. Its state after a number of steps is a pure function of
//! configuration, photos and starting splats: random numbers are keyed by the step, no sum depends on
//! threads. So a training that is broken off and gone on with ends in the same bytes.

use crate::config::{BackgroundKind, ExposureMode, TrainConfig};
use crate::densify::{Densified, DensifyTime, Population};
use crate::exposure::Exposures;
use crate::learner::Learner;
use crate::losses::{self, LossGradients, LossInput, LossTerm, OwnRender, Reads, TrainPhoto};
use crate::random::{Purpose, Random};
use crate::schedule;
use std::time::Instant;
use wm_render::simd::SimdPath;
use wm_render::stages::compare::{Compared, Comparison, NO_EXPOSURE};
use wm_render::stages::optimize::{SplatTerms, Step};
use wm_render::{
    Channels, DepthAlpha, Differentiable, Drawn, ForwardConfig, Frame, Opacity, RenderError, StepClock,
};
use wm_scene::{Camera, Splats};

/// Steps after which what a device has learnt is read back, to go on with should it be lost.
const KNOWN_EVERY: u32 = 500;

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
    pub population: Population,
    /// The photos' own exposures; none where they are shared.
    pub exposures: Exposures,
}

/// Memory of one step.
#[derive(Default)]
struct Work {
    frame: Frame,
    /// The colours of the scene before the photo's exposure.
    rendered: Vec<f32>,
    loss: LossGradients,
}

/// The result of a render.
struct Seen {
    /// Splats in view.
    visible: usize,
    /// The result of the device's comparison, if it compared.
    compared: Option<Compared>,
    /// Seconds up to its pictures.
    forward: f64,
}

/// Returns true if a term has a weight at a step, for its own render `own` or the common one.
fn is_active(term: &dyn LossTerm, own: Option<OwnRender>, step: u32, truth: &TrainPhoto<'_>) -> bool {
    term.own_render() == own && term.weight(step, truth) != 0.0
}

/// The report of a step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StepReport {
    /// The sum of the terms with their weights.
    pub loss: f64,
    /// Each term's name and value before weighting.
    pub terms: Vec<(&'static str, f64)>,
    /// Splats that came, moved and went.
    pub densified: Densified,
    /// Splats in view.
    pub visible: usize,
    /// Steps that were lost with a device: the training goes on without it after those that are left.
    pub lost: u32,
    /// The times of its parts.
    pub times: StepTimes,
}

/// Wall time of the parts of a step, seconds. A GPU is told what to do and waited for where pictures are read: most of
/// its time for a step is in the forward passes that follow.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepTimes {
    /// Rendering.
    pub forward: f64,
    /// Comparing.
    pub loss: f64,
    /// Deriving.
    pub backward: f64,
    /// Renders of single terms.
    pub own: f64,
    /// Moving.
    pub optimizer: f64,
    /// Splats that come and go.
    pub densify: f64,
}

impl StepTimes {
    /// The sum of it all.
    #[must_use]
    pub fn total(&self) -> f64 {
        self.forward + self.loss + self.backward + self.own + self.optimizer + self.densify
    }

    /// Adds another step's.
    pub fn add(&mut self, other: &Self) {
        self.forward += other.forward;
        self.loss += other.loss;
        self.backward += other.backward;
        self.own += other.own;
        self.optimizer += other.optimizer;
        self.densify += other.densify;
    }
}

impl Trainer {
    /// Begins with `splats` in a scene of `extent` units that `photos` photos show, on the back end `renderer`.
    #[must_use]
    pub fn new(
        config: TrainConfig,
        renderer: Box<dyn Differentiable>,
        splats: Splats,
        extent: f64,
        photos: usize,
    ) -> Self {
        let exposures = match config.exposure {
            ExposureMode::Shared => Exposures::default(),
            ExposureMode::Photo => Exposures::new(photos),
        };
        let state = TrainState { step: 0, population: Population::new(splats), exposures };
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
        Self { config, terms, learner, state, known, extent, photos, work, orders }
    }

    /// Adds a term to those that the configuration names.
    pub fn add_term(&mut self, term: Box<dyn LossTerm>) {
        self.terms.push(term);
    }

    /// The configuration.
    #[must_use]
    pub fn config(&self) -> &TrainConfig {
        &self.config
    }

    /// Steps that are done.
    #[must_use]
    pub fn steps_done(&self) -> u32 {
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

    /// The state after the steps so far. Where the device on which it is fails and there is another to go on with, these
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

    /// Goes on with another device after `error`, from what is known here; gives the number of steps that are lost.
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

    /// The state as it is known here, after the steps before a device went ahead: what is left where it fails.
    pub fn known_state(&mut self) -> &TrainState {
        self.state.step = self.known;
        &self.state
    }

    /// The SIMD path in use.
    #[must_use]
    pub fn path(&self) -> SimdPath {
        self.learner.renderer().path()
    }

    /// Returns the back end in words.
    #[must_use]
    pub fn describe(&self) -> String {
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

    /// The place in the list of photos of the one that step `step` (from 0) sees: each once an epoch, in an
    /// order of its own.
    #[must_use]
    pub fn photo_at(&mut self, step: u32) -> usize {
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
    pub fn level_at(&self, step: u32, last_level: u8) -> u8 {
        schedule::level(&self.config, step, last_level)
    }

    /// One step, on photo `photo` of `truth`. Where a device fails and there is another to go on with, it is no step, and
    /// says what was lost.
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

    fn step_on_pool(&mut self, truth: &TrainPhoto<'_>, photo: usize) -> Result<StepReport, RenderError> {
        let step = self.state.step;
        let rates = schedule::rates(&self.config.rates, step, self.config.steps, self.extent);
        let seed = self.config.seed;
        let random = move |purpose| Random::new(seed, purpose, step);
        let mut report = StepReport::default();

        let mut clock = Instant::now();
        let mut lap = move || {
            let passed = clock.elapsed().as_secs_f64();
            clock = Instant::now();
            passed
        };
        let background = match self.config.background {
            BackgroundKind::Black => [0.0; 3],
            BackgroundKind::Random => [0, 1, 2].map(|k| random(Purpose::Background).uniform(k) as f32),
        };
        let common = self.terms.iter().filter(|term| is_active(term.as_ref(), None, step, truth));
        let channels = common.map(|term| term.channels()).max_by_key(|channels| channels.count());
        let forward = ForwardConfig {
            channels: channels.unwrap_or(Channels::Color),
            background,
            rasterization: self.config.rasterization,
            opacity: Opacity::Stored,
            drawn: Drawn::All,
            sh_degree: schedule::sh_degree(&self.config, step),
        };
        let seen = self.see(truth, photo, None, &forward, &mut report)?;
        report.visible = seen.visible;
        if !self.state.exposures.changes.is_empty() {
            let (work, exposures, rate) =
                (&mut self.work, &mut self.state.exposures, self.config.rates.exposure);
            match &seen.compared {
                Some(compared) => exposures.step(photo, &compared.by_exposure, rate),
                None => {
                    let path = self.learner.renderer().path();
                    exposures.learn(path, photo, &work.rendered, &mut work.loss.rgb, rate);
                }
            }
        }
        report.times.forward = seen.forward;
        report.times.loss = lap() - seen.forward;

        let (work, population) = (&self.work, &self.state.population);
        self.learner.backward(population, &work.loss.upstream(DepthAlpha::Learns))?;
        report.times.backward = lap();
        self.add_own_renders(truth, photo, &forward, &mut report)?;
        report.times.own = lap();

        let mut terms = SplatTerms::default();
        for term in &self.terms {
            let weight = term.weight(step, truth);
            if weight != 0.0 {
                term.splat_terms(weight, &mut terms);
            }
        }
        let strategy = self.config.densify.strategy();
        let SplatTerms { opacity, scale, .. } = strategy.terms();
        (terms.opacity, terms.scale) = (terms.opacity + opacity, terms.scale + scale);
        let population = &mut self.state.population;
        let size = (truth.camera.width, truth.camera.height);
        let moved = Step { number: step + 1, rates, terms, size };
        self.learner.optimize(population, &moved, strategy.gradients())?;
        report.times.optimizer = lap();

        if strategy.is_due(step + 1) {
            let random = random(Purpose::Sample);
            let time = DensifyTime { step: step + 1, photos: self.photos, extent: self.extent, random };
            report.densified =
                self.learner.change(population, |population| strategy.apply(&time, population))?;
        }
        let noise = random(Purpose::Noise);
        if let Some(size) = strategy.noise(rates.means, self.extent, noise) {
            self.learner.explore(population, &size, noise)?;
        }
        report.times.densify = lap();
        self.state.step += 1;
        if self.state.step - self.known >= KNOWN_EVERY {
            self.learner.sync(population)?;
            self.known = self.state.step;
        }
        Ok(report)
    }

    /// Renders for the terms of `own`, or of the common render, and adds up what they say; the derivative is in the work,
    /// or on the device where all of them can be found out there.
    fn see(
        &mut self,
        truth: &TrainPhoto<'_>,
        photo: usize,
        own: Option<OwnRender>,
        config: &ForwardConfig,
        report: &mut StepReport,
    ) -> Result<Seen, RenderError> {
        let (started, step, path) = (Instant::now(), self.state.step, self.learner.renderer().path());
        // Only common renders have the photo's exposure.
        let exposed = own.is_none() && !self.state.exposures.changes.is_empty();
        let beliefs = || losses::beliefs(truth);
        let mut comparison = Comparison {
            photo,
            rgb: truth.rgb,
            mask: truth.mask,
            exposure: if exposed { self.state.exposures.of(photo) } else { NO_EXPOSURE },
            believed: truth.prior.map(|prior| losses::believed(truth, prior, &beliefs)),
            ..Comparison::default()
        };
        let mut on_device = self.learner.compares();
        for term in self.terms.iter().filter(|term| is_active(term.as_ref(), own, step, truth)) {
            match term.reads(step, truth, &mut comparison) {
                Reads::Frame => on_device = false,
                Reads::Device(which) => comparison.weights[which as usize] += term.weight(step, truth),
                Reads::Nothing => {}
            }
        }
        let (work, population, camera) = (&mut self.work, &self.state.population, truth.camera);
        let (visible, compared) = if on_device {
            let (visible, compared) = self.learner.compare(population, camera, config, &comparison)?;
            work.loss.forget();
            (visible, Some(compared))
        } else {
            let visible = self.learner.forward(population, camera, config, &mut work.frame)?;
            work.loss.clear(&work.frame);
            (visible, None)
        };
        let forward = started.elapsed().as_secs_f64();
        if exposed && compared.is_none() {
            std::mem::swap(&mut work.rendered, &mut work.frame.rgb);
            work.frame.rgb.resize(work.rendered.len(), 0.0);
            self.state.exposures.apply(path, photo, &work.rendered, &mut work.frame.rgb);
        }
        let input = LossInput { frame: &work.frame, truth, step, path };
        for term in self.terms.iter_mut().filter(|term| is_active(term.as_ref(), own, step, truth)) {
            let weight = term.weight(step, truth);
            let value = match &compared {
                None => term.add(&input, weight, &mut work.loss),
                Some(compared) => match term.reads(step, truth, &mut comparison) {
                    Reads::Device(which) => compared.values[which as usize],
                    Reads::Frame | Reads::Nothing => 0.0,
                },
            };
            report.loss += weight * value;
            report.terms.push((term.name(), value));
        }
        Ok(Seen { visible, compared, forward })
    }

    /// Adds to the gradients what terms take from renders of their own; equal renders are made once.
    fn add_own_renders(
        &mut self,
        truth: &TrainPhoto<'_>,
        photo: usize,
        common: &ForwardConfig,
        report: &mut StepReport,
    ) -> Result<(), RenderError> {
        let step = self.state.step;
        let mut renders = Vec::new();
        for term in &self.terms {
            if let Some(own) = term.own_render().filter(|own| !renders.contains(own))
                && term.weight(step, truth) != 0.0
            {
                renders.push(own);
            }
        }
        for own in renders {
            let config =
                ForwardConfig { channels: own.channels, opacity: own.opacity, drawn: own.drawn, ..*common };
            self.see(truth, photo, Some(own), &config, report)?;
            let upstream = self.work.loss.upstream(own.depth_alpha);
            self.learner.add_backward(&self.state.population, &upstream, own.learn)?;
        }
        Ok(())
    }

    /// Renders what has been learnt, over black, without any photo's exposure.
    ///
    /// # Errors
    /// [`RenderError`] if the camera cannot be rendered with, memory is short or the device fails.
    pub fn render(&mut self, camera: &Camera, frame: &mut Frame) -> Result<(), RenderError> {
        let config = ForwardConfig {
            channels: Channels::Color,
            background: [0.0; 3],
            rasterization: self.config.rasterization,
            opacity: Opacity::Stored,
            drawn: Drawn::All,
            sh_degree: self.config.sh_degree,
        };
        if let Err(error) = self.learner.forward(&self.state.population, camera, &config, frame) {
            self.go_back(error)?;
            self.learner.forward(&self.state.population, camera, &config, frame)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Densify, GeometryConfig, LossConfig, Preset};
    use crate::densify::fixed::FixedConfig;
    use crate::densify::mcmc::McmcConfig;
    use crate::losses::OwnRender;
    use glam::DVec3;
    use std::sync::Arc;
    use std::sync::atomic::{AtomicU32, Ordering};
    use wm_render::testing::{Backend, fallible_differentiable, random_splats, uniform};
    use wm_render::{CpuConfig, CpuDifferentiable, Learn};

    const SIZE: (u32, u32) = (48, 32);

    /// Splats about the origin, large enough to be seen.
    fn truth_splats() -> Splats {
        let mut splats = random_splats(30, 0, 5);
        splats.log_scales.iter_mut().flatten().for_each(|v| *v = v.max(-2.0));
        splats
    }

    fn cameras() -> Vec<Camera> {
        let eyes = [[0.0, 0.0, -7.0], [6.0, 1.0, -3.0], [-6.0, -1.0, -3.0], [1.0, 5.0, -5.0]];
        let look = |eye: [f64; 3]| {
            Camera::looking(SIZE, 45.0, DVec3::from_array(eye), DVec3::ZERO, DVec3::NEG_Y).unwrap()
        };
        eyes.map(look).into()
    }

    fn config(steps: u32) -> TrainConfig {
        let mut config = TrainConfig::preset(Preset::Quick);
        config.set_steps(steps);
        config.sh_degree = 0;
        // Photos of the truth are over black.
        config.background = BackgroundKind::Black;
        config.densify = Densify::Fixed(FixedConfig {});
        config
    }

    fn trainer(config: TrainConfig, splats: Splats) -> Trainer {
        let run = CpuConfig { threads: Some(1), ..CpuConfig::default() };
        Trainer::new(config, Box::new(CpuDifferentiable::new(run).unwrap()), splats, 3.0, 4)
    }

    /// Returns what each camera sees of the truth.
    fn photos() -> Vec<Vec<f32>> {
        let mut truth = trainer(config(1), truth_splats());
        let mut frame = Frame::default();
        let mut see = |camera: &Camera| {
            truth.render(camera, &mut frame).unwrap();
            frame.rgb.clone()
        };
        cameras().iter().map(&mut see).collect()
    }

    /// The truth moved, resized and recoloured at random.
    fn perturbed() -> Splats {
        let mut splats = truth_splats();
        let off = |i: usize| uniform(77, i as u64) as f32 - 0.5;
        splats.means.as_flattened_mut().iter_mut().enumerate().for_each(|(i, v)| *v += 0.2 * off(i));
        splats.log_scales.as_flattened_mut().iter_mut().enumerate().for_each(|(i, v)| *v += off(1000 + i));
        splats.sh.iter_mut().enumerate().for_each(|(i, v)| *v += off(2000 + i));
        splats
    }

    #[test]
    fn what_was_perturbed_is_learnt_again() {
        let (cameras, photos) = (cameras(), photos());
        let mut trainer = trainer(config(800), perturbed());
        // Of one round of the four photos.
        let mut losses = Vec::new();
        while !trainer.is_done() {
            let mut sum = 0.0;
            for _ in 0..4 {
                let step = trainer.steps_done();
                let index = trainer.photo_at(step);
                let truth =
                    TrainPhoto { rgb: &photos[index], mask: None, camera: &cameras[index], prior: None };
                sum += trainer.step(&truth, index).unwrap().loss;
            }
            losses.push(sum / 4.0);
        }
        let (first, last) = (losses[0], losses[losses.len() - 1]);
        assert!(last < first / 5.0, "{first} to {last}");
    }

    /// Pulls everything that it is let pull.
    struct Pull {
        weight: f64,
        own: Option<OwnRender>,
        calls: Arc<AtomicU32>,
    }

    impl LossTerm for Pull {
        fn name(&self) -> &'static str {
            "pull"
        }

        fn weight(&self, _: u32, _: &TrainPhoto<'_>) -> f64 {
            self.weight
        }

        fn own_render(&self) -> Option<OwnRender> {
            self.own
        }

        fn add(&mut self, _: &LossInput<'_>, weight: f64, out: &mut LossGradients) -> f64 {
            self.calls.fetch_add(1, Ordering::Relaxed);
            out.rgb.iter_mut().enumerate().for_each(|(i, v)| *v += (weight * (i as f64).sin()) as f32);
            1.0
        }
    }

    /// One step with the configured losses off and a [`Pull`]: the splats before and after, calls, loss.
    fn pulled(weight: f64, own: Option<OwnRender>) -> (Splats, Splats, u32, StepReport) {
        let mut config = config(10);
        config.loss = LossConfig { l1: 0.0, ssim: 0.0, geometry: GeometryConfig::NONE };
        let mut trainer = trainer(config, perturbed());
        let calls = Arc::new(AtomicU32::new(0));
        trainer.add_term(Box::new(Pull { weight, own, calls: Arc::clone(&calls) }));
        let (cameras, photos) = (cameras(), photos());
        let before = trainer.state().unwrap().population.splats.clone();
        let truth = TrainPhoto { rgb: &photos[0], mask: None, camera: &cameras[0], prior: None };
        let report = trainer.step(&truth, 0).unwrap();
        (before, trainer.state().unwrap().population.splats.clone(), calls.load(Ordering::Relaxed), report)
    }

    const OWN: OwnRender = OwnRender {
        channels: Channels::Color,
        opacity: Opacity::Fixed(0.5),
        drawn: Drawn::All,
        learn: Learn::MEANS,
        depth_alpha: DepthAlpha::Learns,
    };

    #[test]
    fn a_term_with_a_render_of_its_own_moves_what_it_may() {
        let (before, after, calls, report) = pulled(2.0, Some(OWN));
        assert_eq!((calls, report.loss, report.terms), (1, 2.0, vec![("pull", 1.0)]));
        assert_ne!(after.means, before.means);
        assert_eq!(Splats { means: before.means.clone(), ..after }, before);
        let (before, after, ..) = pulled(2.0, None);
        assert!(after.means != before.means && after.sh != before.sh);
        assert_ne!(after.logit_opacities, before.logit_opacities);
    }

    #[test]
    fn a_term_without_weight_is_never_called() {
        for own in [None, Some(OWN)] {
            let (before, after, calls, report) = pulled(0.0, own);
            assert_eq!((calls, report.terms.len(), report.loss), (0, 0, 0.0));
            assert_eq!(after, before);
        }
    }

    /// Adaptive control looks at what pulls on the common picture, whatever other renders learn from.
    #[test]
    fn a_term_with_a_render_of_its_own_leaves_the_pulls() {
        let mut config = config(1000);
        config.densify = Densify::Adaptive(crate::densify::adaptive::AdaptiveConfig::for_steps(1000, 100));
        let (cameras, photos) = (cameras(), photos());
        let truth = TrainPhoto { rgb: &photos[0], mask: None, camera: &cameras[0], prior: None };
        let pulls = [None, Some(OWN)].map(|own| {
            let mut trainer = trainer(config.clone(), perturbed());
            if own.is_some() {
                trainer.add_term(Box::new(Pull { weight: 1.0, own, calls: Arc::default() }));
            }
            trainer.step(&truth, 0).unwrap();
            trainer.state().unwrap().population.pulls.clone()
        });
        assert_eq!(pulls[0], pulls[1]);
    }

    /// Trains on a GPU that is lost on the way, and says after how many steps what was lost.
    fn losing(gpu_at: u32, config: &TrainConfig) -> (Trainer, Vec<(u32, u32)>) {
        let (renderer, gpu) = fallible_differentiable(|_| {});
        let mut trainer = Trainer::new(config.clone(), Box::new(renderer), perturbed(), 3.0, 4);
        let (cameras, photos) = (cameras(), photos());
        let mut lost = Vec::new();
        let mut taken = 0;
        while !trainer.is_done() {
            match taken {
                20 => assert_eq!(trainer.state().unwrap().step, 20),
                _ if taken == gpu_at => gpu.lose(),
                _ => {}
            }
            taken += 1;
            let step = trainer.steps_done();
            let index = trainer.photo_at(step);
            let truth = TrainPhoto { rgb: &photos[index], mask: None, camera: &cameras[index], prior: None };
            let report = trainer.step(&truth, index).unwrap();
            if trainer.steps_done() <= step {
                lost.push((step, report.lost));
            }
        }
        (trainer, lost)
    }

    /// Splats come every five steps. After 20 the state is asked for: at 26 the six since are taken again.
    #[test]
    fn a_training_goes_on_without_its_gpu() {
        if Backend::gpu().is_none() {
            return;
        }
        let mut config = config(40);
        let chain = McmcConfig { from: 1, until: 30, every: 5, ..McmcConfig::for_steps(40, 40) };
        config.densify = Densify::Mcmc(chain);
        let (mut trainer, lost) = losing(26, &config);
        assert_eq!(lost, [(26, 6)]);
        assert!(trainer.describe().starts_with("cpu, "));
        assert_eq!((trainer.steps_done(), trainer.state().unwrap().step), (40, 40));
        let (mut whole, lost) = losing(u32::MAX, &config);
        assert!(lost.is_empty() && whole.describe().starts_with("gpu, "));
        assert_eq!(whole.len(), trainer.len());
        let [one, two] = [&mut whole, &mut trainer].map(|trainer| {
            let mut frame = Frame::default();
            trainer.render(&cameras()[0], &mut frame).unwrap();
            frame.rgb
        });
        let off = one.iter().zip(&two).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
        let psnr = -10.0 * (off / one.len() as f64).log10();
        eprintln!("{psnr:.1} dB");
        assert!(psnr > 30.0, "{psnr}");
    }
}
