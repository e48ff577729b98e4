//! One step: render, compare, derive, move, densify.

use super::Trainer;
use super::report::StepReport;
use crate::config::BackgroundKind;
use crate::densify::DensifyTime;
use crate::losses::{self, LossInput, LossTerm, OwnRender, TrainPhoto};
use crate::random::{Purpose, Random};
use crate::schedule;
use std::time::Instant;
use wm_render::training::{Compared, Comparison, NO_EXPOSURE};
use wm_render::training::{SplatTerms, Step};
use wm_render::{Channels, DepthAlpha, ForwardConfig, Frame, RenderError};

/// Steps between reads of the splats from a device, from which the training continues if the
/// device fails.
const READ_BACK_STEPS: u32 = 500;

/// The result of a render.
struct RenderResult {
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

impl Trainer {
    /// Takes a step; called on the threads of the back end.
    pub(super) fn step_on_pool(
        &mut self,
        truth: &TrainPhoto<'_>,
        photo: usize,
    ) -> Result<StepReport, RenderError> {
        let step = self.state.step;
        let mut rates = schedule::rates(&self.config.rates, step, self.config.steps, self.extent);
        if self.air.is_some() {
            let share = schedule::colors_in_haze(step, self.config.steps);
            (rates.sh_dc, rates.sh_rest) = (share * rates.sh_dc, share * rates.sh_rest);
        }
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
            sh_degree: schedule::sh_degree(&self.config, step),
            air: self.air,
            ..ForwardConfig::default()
        };
        let seen = self.see(truth, photo, None, &forward, &mut report)?;
        report.visible = seen.visible;
        if !self.state.exposures.changes.is_empty() {
            let (work, exposures, rate) =
                (&mut self.work, &mut self.state.exposures, self.config.rates.exposure);
            match &seen.compared {
                Some(compared) => exposures.step(photo, &compared.by_exposure, rate),
                None => {
                    let path = self.learner.renderer.path();
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
        let SplatTerms { opacity, scale, .. } = strategy.terms(self.extent);
        (terms.opacity, terms.scale) = (terms.opacity + opacity, terms.scale + scale);
        let population = &mut self.state.population;
        let size = (truth.camera.width, truth.camera.height);
        let moved = Step { number: step + 1, rates, terms, size };
        self.learner.optimize(population, &moved, strategy.sums_gradients())?;
        report.times.optimizer = lap();

        if strategy.is_due(step + 1) {
            let random = random(Purpose::Sample);
            let time = DensifyTime { step: step + 1, photos: self.photos, extent: self.extent, random };
            self.learner.change(population, |population| strategy.apply(&time, population))?;
        }
        let noise = random(Purpose::Noise);
        if let Some(size) = strategy.noise(rates.means, self.extent, noise) {
            self.learner.explore(population, &size, noise)?;
        }
        report.times.densify = lap();
        self.state.step += 1;
        if self.state.step - self.known >= READ_BACK_STEPS {
            self.learner.sync(population)?;
            self.known = self.state.step;
        }
        Ok(report)
    }

    /// Renders for the terms of `own`, or of the common render, and adds up what they say; the
    /// derivative is in the work, or on the device where all of them can be found out there.
    fn see(
        &mut self,
        truth: &TrainPhoto<'_>,
        photo: usize,
        own: Option<OwnRender>,
        config: &ForwardConfig,
        report: &mut StepReport,
    ) -> Result<RenderResult, RenderError> {
        let (started, step, path) = (Instant::now(), self.state.step, self.learner.renderer.path());
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
        for term in self.terms.iter().filter(|term| is_active(term.as_ref(), own, step, truth)) {
            term.prepare(step, &mut comparison);
            if let Some(which) = term.on_device() {
                comparison.weights[which as usize] += term.weight(step, truth);
            }
        }
        let (work, population, camera) = (&mut self.work, &self.state.population, truth.camera);
        let (visible, compared) = if self.learner.compares() {
            let (visible, compared) = self.learner.compare(population, camera, config, &comparison)?;
            // The derivatives stay on the device.
            work.loss.clear(&Frame::default());
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
                Some(compared) => term.on_device().map_or(0.0, |which| compared.values[which as usize]),
            };
            report.loss += weight * value;
            report.terms.push((term.name(), value));
        }
        Ok(RenderResult { visible, compared, forward })
    }

    /// Adds to the gradients what terms take from renders of their own; equal renders are made
    /// once.
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
}
