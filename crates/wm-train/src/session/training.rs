//! A training that is under way: steps, checkpoints, metrics and evaluations.

use super::data::TrainData;
use super::error::SessionError;
use super::folder::{Metrics, RunFolder};
use super::observer::{
    ImageMoment, StepProgress, TrainImage, TrainNotice, TrainObserver, TrainStart, TrainWarning,
};
use super::options::SessionOptions;
use super::scene;
use super::score::{HeldOutScore, HeldOutScores, PerceptualMetric, StepSums, TrainReport};
use crate::checkpoint::{self, CheckpointHead};
use crate::config::TrainConfig;
use crate::exposure::Exposures;
use crate::haze::{PhotoHaze, without_hidden};
use crate::losses::TrainPhoto;
use crate::metrics::Ssim;
use crate::movers::MoverMask;
use crate::photos::{BadPhotos, Photo};
use crate::priors::{Prior, Priors};
use crate::start;
use crate::trainer::Trainer;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{self, Receiver};
use std::time::Instant;
use wm_image::quality::psnr;
use wm_render::{AnyDifferentiable, Differentiable, Frame, RenderError};
use wm_scene::{Camera, Scene, Splats};

/// Photos that are decoded ahead of their step.
const PREFETCHED_STEPS: u32 = 4;
/// Shortest side of a photo in coarse steps, px.
const MIN_COARSE_SIDE_PX: u32 = 100;
/// Summaries and milestones in a training.
const SUMMARY_COUNT: u32 = 200;
const MILESTONE_COUNT: u32 = 10;
/// Loss of PSNR of held-out photos that is worth a warning, dB.
const WORSE_PSNR_DB: f64 = 0.1;

/// A training that is ready to run or under way; [`Session::prepare`](super::Session::prepare)
/// makes it.
///
/// [`Self::run`] does everything; the other methods are its parts, for programs with a loop of
/// their own.
pub struct Training {
    trainer: Trainer,
    /// Receives the reasons why the GPU was given up.
    failures: Receiver<String>,
    inputs: TrainInputs,
    metrics: Metrics,
    /// The number of halvings that leave photos large enough.
    last_level: u8,
    pixels: PhotoPixels,
    /// The haze that photos show and the scene is without.
    haze: Option<PhotoHaze>,
    /// Indices of photos that turned out to be damaged.
    damaged: BTreeSet<usize>,
    sums: StepSums,
    /// Steps that were done before.
    begun: u32,
    held_out_psnr: Option<f64>,
    /// The steps of the milestone with the highest PSNR, and its scores.
    best: Option<(u32, HeldOutScore)>,
    saved: Instant,
}

/// Memory for photos as the losses read them.
#[derive(Default)]
struct PhotoPixels {
    rgb: Vec<f32>,
    mask: Option<Vec<f32>>,
}

impl PhotoPixels {
    /// Returns the photo without the pixels that show movers.
    fn truth<'b>(&'b mut self, photo: &'b Photo, movers: Option<&MoverMask>) -> TrainPhoto<'b> {
        self.rgb.clear();
        self.rgb.extend(photo.rgb.iter().map(|v| f32::from(*v) / 255.0));
        self.mask = photo.mask_f32();
        if let Some(movers) = movers.filter(|movers| !movers.is_empty()) {
            let mask = self.mask.get_or_insert_with(|| vec![1.0; photo.rgb.len() / 3]);
            movers.pixels(photo.width, photo.height).iter().for_each(|pixel| mask[*pixel] = 0.0);
        }
        TrainPhoto { rgb: &self.rgb, mask: self.mask.as_deref(), camera: &photo.camera, prior: None }
    }
}

/// The inputs of a training.
pub(super) struct TrainInputs {
    pub(super) dataset: PathBuf,
    pub(super) data: TrainData,
    pub(super) priors: Option<Priors>,
    /// The pixels of each training photo that show movers; empty if there are none.
    pub(super) movers: Vec<MoverMask>,
    pub(super) folder: RunFolder,
    pub(super) options: SessionOptions,
    /// Takes a second per photo, so it is only used at the end.
    pub(super) metric: Option<Box<dyn PerceptualMetric>>,
    /// The back end of the caller; `None` for that of the options.
    pub(super) backend: Option<Box<dyn Differentiable>>,
}

impl Training {
    /// Starts a training, or continues the one in the run folder.
    pub(super) fn new(
        config: TrainConfig,
        mut inputs: TrainInputs,
        observer: &mut dyn TrainObserver,
    ) -> Result<Self, SessionError> {
        let backend = inputs.backend.take();
        let TrainInputs { dataset, data, priors, folder, options, .. } = &inputs;
        let (sender, failures) = mpsc::channel();
        let renderer: Box<dyn Differentiable> = match backend {
            Some(backend) => backend,
            None => Box::new(AnyDifferentiable::new(&options.device, options.cpu, move |error| {
                // The receiver lives as long as the back end.
                let _ = sender.send(error.to_string());
            })?),
        };
        failures.try_iter().for_each(|error| observer.on_warning(&TrainWarning::Gpu(error)));
        let extent = start::extent(&data.cameras());
        let photos = data.set.places.len();
        let (haze, gains) = scene::haze(config.haze, data, priors.as_ref(), options, observer)?.unzip();
        let mut trainer = match folder.resumed()? {
            Some((head, state)) => {
                let trainer = Trainer::resumed(config, renderer, state, extent, photos);
                let same = head.config == trainer.config
                    && head.photos == data.taught()
                    && head.simd == trainer.path().to_string();
                if !same {
                    return Err(SessionError::OtherTraining(folder.path().to_owned()));
                }
                let folder = folder.path().to_owned();
                observer.on_notice(&TrainNotice::Resumed { folder, step: head.step() });
                trainer
            }
            None => {
                let gains = data.first_exposures(config.exposure, gains.as_ref());
                let (part, known) = (options.part.as_deref(), priors.as_ref());
                let splats = scene::start(dataset, &config, data, known, haze.as_ref(), gains, part)?;
                let mut trainer = Trainer::new(config, renderer, splats, extent, photos);
                if let Some(found) = gains {
                    trainer.state.exposures = Exposures::with_gains(&found.gains);
                    observer.on_notice(&TrainNotice::ExposuresDiffer(found.spread));
                }
                trainer
            }
        };
        trainer.air = haze.map(|haze| haze.air());
        let (step, steps) = (trainer.steps_done(), trainer.config.steps);
        let last_level = data.set.photos.last_level(MIN_COARSE_SIDE_PX);
        let photo = data.set.name(data.shown());
        let start = TrainStart { step, steps, photo, extent };
        observer.on_start(&start).map_err(SessionError::Observer)?;
        if let Some(path) = folder.checkpoint().filter(|_| !folder.resumes()) {
            // From now on the folder holds this training, and no other whose files were there
            // before.
            write_checkpoint(&path, &mut trainer, data)?;
        }
        folder.write_config(&trainer.config)?;
        let metrics = folder.metrics(step, steps)?;
        Ok(Self {
            trainer,
            failures,
            inputs,
            metrics,
            last_level,
            pixels: PhotoPixels::default(),
            haze,
            damaged: BTreeSet::new(),
            sums: StepSums::default(),
            begun: step,
            held_out_psnr: None,
            best: None,
            saved: Instant::now(),
        })
    }

    /// Trains to the end and returns the scene.
    ///
    /// # Errors
    /// [`SessionError`]; where a checkpoint can be written, what was learnt is saved first.
    pub fn run(mut self, observer: &mut dyn TrainObserver) -> Result<Scene, SessionError> {
        self.run_to_end(observer)?;
        self.scene(observer)
    }

    /// Takes all steps that are left, with their evaluations, images and checkpoints, and reports
    /// the end.
    ///
    /// # Errors
    /// [`SessionError`] as for [`Self::run`].
    pub(crate) fn run_to_end(&mut self, observer: &mut dyn TrainObserver) -> Result<(), SessionError> {
        let started = Instant::now();
        self.saved = started;
        let steps = self.trainer.config.steps;
        while !self.trainer.is_done() {
            if observer.proceed().is_break() {
                self.save(observer)?;
                return Err(SessionError::Stopped { step: self.trainer.steps_done(), steps });
            }
            self.step(observer)?;
        }
        let seconds = started.elapsed().as_secs_f64();
        self.save(observer)?;
        self.show(ImageMoment::Milestone, observer)?;
        self.report(seconds, observer)
    }

    /// Takes one step, with the summary, evaluation, images and checkpoint that are due after it.
    ///
    /// # Errors
    /// [`SessionError`]; where a checkpoint can be written, what was learnt is saved first.
    pub fn step(&mut self, observer: &mut dyn TrainObserver) -> Result<(), SessionError> {
        let steps = self.trainer.config.steps;
        let loss = self.train(observer)?;
        let (step, splats) = (self.trainer.steps_done(), self.trainer.len());
        observer.on_step(&StepProgress { step, steps, splats, loss });
        self.show(ImageMoment::Step, observer)?;
        if step.is_multiple_of((steps / MILESTONE_COUNT).max(1)) && step < steps {
            let scores = self.evaluate(observer)?;
            self.show(ImageMoment::Milestone, observer)?;
            if let (Some(line), Some(mean)) = (scores.json(), scores.mean()) {
                self.metrics.add(&line)?;
                self.held_out_psnr = Some(mean.psnr);
                if self.best.is_none_or(|(_, best)| mean.psnr > best.psnr) {
                    self.best = Some((step, mean));
                }
                observer.on_evaluation(&scores);
            }
        }
        if step.is_multiple_of((steps / SUMMARY_COUNT).max(1)) {
            let summary = self.sums.summary(step, self.trainer.len(), self.held_out_psnr);
            observer.on_summary(&summary);
            self.metrics.add(&summary.json())?;
        }
        if self.saved.elapsed() > self.inputs.options.checkpoint_every {
            self.save(observer)?;
            self.saved = Instant::now();
        }
        Ok(())
    }

    /// Returns true after the last step.
    #[must_use]
    pub fn is_done(&self) -> bool {
        self.trainer.is_done()
    }

    /// Renders what has been learnt, over black.
    ///
    /// # Errors
    /// [`RenderError`] if the camera cannot be rendered with, memory is short or the device fails.
    pub fn render(&mut self, camera: &Camera, frame: &mut Frame) -> Result<(), RenderError> {
        self.trainer.render(camera, frame)
    }

    /// Scores the held-out photos, without the perceptual metric.
    ///
    /// # Errors
    /// [`SessionError`] if a photo is damaged or the device fails.
    pub fn evaluate(&mut self, observer: &mut dyn TrainObserver) -> Result<HeldOutScores, SessionError> {
        self.scores(None, observer)
    }

    /// Writes a checkpoint, if the session has a run folder.
    ///
    /// # Errors
    /// [`SessionError`] if the file cannot be written or the device fails.
    pub fn save(&mut self, observer: &mut dyn TrainObserver) -> Result<(), SessionError> {
        let Some(path) = self.inputs.folder.checkpoint() else { return Ok(()) };
        let step = write_checkpoint(&path, &mut self.trainer, &self.inputs.data)?;
        observer.on_checkpoint(&path, step);
        Ok(())
    }

    /// Returns the scene as it is now, with the metadata that photos and splats tell.
    ///
    /// # Errors
    /// [`SessionError`] if the device fails.
    pub fn scene(&mut self, observer: &mut dyn TrainObserver) -> Result<Scene, SessionError> {
        let splats = self.splats()?;
        let (config, haze) = (&self.trainer.config, self.haze.as_ref());
        let TrainInputs { data, options, priors, .. } = &self.inputs;
        scene::finish(splats, config, data, options, priors.as_ref(), haze, observer)
    }

    /// Returns the splats as they are now, of which nothing is labelled yet but the sky that the
    /// training began with.
    ///
    /// # Errors
    /// [`SessionError`] if the device fails.
    pub(crate) fn splats(&mut self) -> Result<Splats, SessionError> {
        Ok(self.trainer.state()?.population.drawn())
    }

    /// Takes one step and returns its loss.
    fn train(&mut self, observer: &mut dyn TrainObserver) -> Result<f64, SessionError> {
        let step = self.trainer.steps_done();
        let last = self.trainer.config.steps.saturating_sub(1);
        for ahead in step + 1..=(step + PREFETCHED_STEPS).min(last) {
            let place = self.inputs.data.set.places[self.trainer.photo_at(ahead)];
            self.inputs.data.set.photos.prefetch(place, self.trainer.level_at(ahead, self.last_level));
        }
        let level = self.trainer.level_at(step, self.last_level);
        let (index, photo) = self.photo_at(step, level, observer)?;
        let prior = self.prior(self.inputs.data.set.places[index])?;
        let prior = match (prior, &self.haze) {
            (Some(prior), Some(haze)) => Some(Arc::new(without_hidden(&prior, &photo, haze))),
            (prior, _) => prior,
        };
        let truth = TrainPhoto {
            prior: prior.as_deref(),
            ..self.pixels.truth(&photo, self.inputs.movers.get(index))
        };
        let done = self.trainer.step(&truth, index);
        self.failures.try_iter().for_each(|error| observer.on_warning(&TrainWarning::Gpu(error)));
        let report = match done {
            Err(error) if error.is_of_gpu() => {
                return Err(self.saved_before(observer, |step, steps| SessionError::GpuLost {
                    error,
                    step,
                    steps,
                }));
            }
            done => done?,
        };
        if report.lost > 0 {
            observer.on_warning(&TrainWarning::StepsLost(report.lost));
        }
        if !report.loss.is_finite() {
            return Err(SessionError::NotFinite(step));
        }
        self.sums.add(&report);
        Ok(report.loss)
    }

    /// Returns the photo of a step and its index among the training photos: in place of a damaged
    /// one the next that is not, so that a training that is resumed takes the same way.
    fn photo_at(
        &mut self,
        step: u32,
        level: u8,
        observer: &mut dyn TrainObserver,
    ) -> Result<(usize, Arc<Photo>), SessionError> {
        let count = self.inputs.data.set.places.len();
        let first = self.trainer.photo_at(step);
        for index in (0..count).map(|further| (first + further) % count) {
            if let Some(photo) = self.photo(self.inputs.data.set.places[index], level, observer)? {
                return Ok((index, photo));
            }
        }
        Err(SessionError::NoPhotoLeft(self.inputs.dataset.clone()))
    }

    /// Reads a photo; `None` if it is damaged and may be left out.
    fn photo(
        &mut self,
        place: usize,
        level: u8,
        observer: &mut dyn TrainObserver,
    ) -> Result<Option<Arc<Photo>>, SessionError> {
        if self.damaged.contains(&place) {
            return Ok(None);
        }
        match self.inputs.data.set.photos.get(place, level) {
            Ok(photo) => Ok(Some(photo)),
            Err(error) if self.inputs.options.dataset.bad == BadPhotos::Skip => {
                observer.on_warning(&TrainWarning::LeftOut(error));
                self.damaged.insert(place);
                Ok(None)
            }
            Err(error) => Err(self.saved_before(observer, |step, steps| SessionError::DamagedPhoto {
                error,
                step,
                steps,
            })),
        }
    }

    /// Saves what was learnt before the session ends with an error.
    fn saved_before(
        &mut self,
        observer: &mut dyn TrainObserver,
        error: impl FnOnce(u32, u32) -> SessionError,
    ) -> SessionError {
        let saved = self.save(observer);
        let error = error(self.trainer.steps_done(), self.trainer.config.steps);
        match saved {
            Ok(()) => error,
            Err(checkpoint) => {
                SessionError::NotSaved { error: error.to_string(), checkpoint: Box::new(checkpoint) }
            }
        }
    }

    fn prior(&self, place: usize) -> Result<Option<Arc<Prior>>, SessionError> {
        let Some(priors) = &self.inputs.priors else { return Ok(None) };
        Ok(priors.get(self.inputs.data.set.name(place), &self.inputs.data.set.photos.camera(place, 0))?)
    }

    /// Returns the gain with which a photo is compared. Where each photo has an exposure of its own
    /// a held-out one learns none: the points that it shares with others tell its gain. In haze
    /// they do not, since haze changes their brightness too.
    fn gain(&self, place: usize) -> [f32; 3] {
        let at = self.inputs.data.held_out.iter().position(|held_out| *held_out == place);
        at.filter(|_| !self.trainer.state.exposures.changes.is_empty() && self.haze.is_none())
            .map_or([1.0; 3], |at| self.inputs.data.held_out_gains()[at])
    }

    fn scores(
        &mut self,
        metric: Option<&dyn PerceptualMetric>,
        observer: &mut dyn TrainObserver,
    ) -> Result<HeldOutScores, SessionError> {
        let (mut photos, mut ssim) = (Vec::new(), Ssim::new(self.trainer.path()));
        for place in self.inputs.data.held_out.clone() {
            let Some(photo) = self.photo(place, 0, observer)? else { continue };
            let mut frame = Frame::default();
            self.trainer.render_as_photo(&photo.camera, &mut frame)?;
            let gain = self.gain(place);
            let truth = self.pixels.truth(&photo, None);
            let width = photo.width as usize;
            let shown = displayed(&frame, gain);
            let ssim = ssim.masked_value(&shown, truth.rgb, truth.mask, width);
            let lpips = metric.map(|metric| metric.distance(&shown, truth.rgb, truth.mask, width));
            let score = HeldOutScore { psnr: psnr(&shown, truth.rgb, truth.mask), ssim, lpips };
            photos.push((self.inputs.data.set.name(place).to_owned(), score));
        }
        Ok(HeldOutScores { step: self.trainer.steps_done(), splats: self.trainer.len(), photos })
    }

    /// Renders an image, if the observer wants one.
    fn show(&mut self, moment: ImageMoment, observer: &mut dyn TrainObserver) -> Result<(), SessionError> {
        let place = self.inputs.data.shown();
        let photo_camera = self.inputs.data.set.photos.camera(place, 0);
        let Some(camera) = observer.wants_image(moment, &photo_camera) else { return Ok(()) };
        let mut frame = Frame::default();
        // Milestones are kept as files, which have no score.
        let is_scored = moment == ImageMoment::Step && camera == photo_camera;
        let photo = if is_scored {
            self.trainer.render_as_photo(&camera, &mut frame)?;
            self.photo(place, 0, observer)?
        } else {
            self.trainer.render(&camera, &mut frame)?;
            None
        };
        let psnr = photo.map(|photo| {
            let gain = self.gain(place);
            let truth = self.pixels.truth(&photo, None);
            psnr(&displayed(&frame, gain), truth.rgb, truth.mask)
        });
        let step = self.trainer.steps_done();
        let image =
            TrainImage { step, moment, photo: self.inputs.data.set.name(place), camera, frame: &frame, psnr };
        observer.on_image(&image).map_err(SessionError::Observer)
    }

    fn report(&mut self, seconds: f64, observer: &mut dyn TrainObserver) -> Result<(), SessionError> {
        let metric = self.inputs.metric.take();
        let held_out = self.scores(metric.as_deref(), observer)?;
        if let Some(line) = held_out.json() {
            self.metrics.add(&line)?;
        }
        let steps = self.trainer.config.steps;
        if let (Some((step, before)), Some(now)) = (self.best, held_out.mean())
            && was_better(&before, &now)
        {
            observer.on_warning(&TrainWarning::TooManySteps {
                step,
                steps,
                before,
                now: HeldOutScore { lpips: None, ..now },
            });
        }
        observer.on_finish(&TrainReport {
            steps: self.trainer.config.steps - self.begun,
            seconds,
            times: self.sums.times,
            backend: self.trainer.describe(),
            held_out,
        });
        Ok(())
    }
}

/// Writes a checkpoint; returns its steps.
fn write_checkpoint(path: &Path, trainer: &mut Trainer, data: &TrainData) -> Result<u32, SessionError> {
    match trainer.state().map(|_| ()) {
        // The state before the GPU failed is kept.
        Err(error) if error.is_of_gpu() => {}
        done => done?,
    }
    let (config, simd) = (trainer.config.clone(), trainer.path().to_string());
    let state = trainer.known_state();
    let head = CheckpointHead::new(&config, data.taught(), simd, state);
    checkpoint::write(path, &head, state).map_err(|error| SessionError::Unsaved(Box::new(error)))?;
    Ok(head.step())
}

/// Returns true if earlier scores are clearly better than those at the end.
fn was_better(before: &HeldOutScore, now: &HeldOutScore) -> bool {
    before.psnr > now.psnr + WORSE_PSNR_DB && before.ssim > now.ssim
}

/// Returns the colours times `gain` as a screen shows them: 0 to 1.
fn displayed(frame: &Frame, gain: [f32; 3]) -> Vec<f32> {
    frame.rgb.iter().zip(gain.iter().cycle()).map(|(v, gain)| (v * gain).clamp(0.0, 1.0)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_worse_in_both_scores_is_overtrained() {
        let score = |psnr, ssim| HeldOutScore { psnr, ssim, lpips: None };
        assert!(was_better(&score(20.0, 0.70), &score(19.5, 0.69)));
        assert!(!was_better(&score(20.0, 0.70), &score(19.5, 0.71)));
        assert!(!was_better(&score(20.0, 0.70), &score(19.95, 0.69)));
    }
}
