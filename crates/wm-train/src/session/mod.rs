//! A training from photos to a scene, in one call.
//!
//! [`Session`] takes a data set and options, opens the photos (with COLMAP's help if there are no
//! cameras), estimates priors, trains, and returns a [`Scene`]. What happens on the way goes to a
//! [`TrainObserver`]: progress, warnings, scores of held-out photos, images. With a run folder the
//! session writes checkpoints and metrics and can be resumed.
//!
//! ```no_run
//! use wm_train::{Preset, Session};
//!
//! let session = Session::new("photos").preset(Preset::Quick).steps(1000).run_folder("photos.run");
//! let scene = session.run(&mut ())?;
//! wm_scene::formats::write_scene("place.ply".as_ref(), &scene)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! An observer implements the methods that it needs:
//!
//! ```
//! use std::ops::ControlFlow;
//! use wm_train::session::{StepProgress, TrainObserver, TrainWarning};
//!
//! /// Prints warnings and stops after a number of steps.
//! struct Limit(u32);
//!
//! impl TrainObserver for Limit {
//!     fn proceed(&mut self) -> ControlFlow<()> {
//!         if self.0 == 0 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
//!     }
//!
//!     fn on_step(&mut self, _: &StepProgress) {
//!         self.0 -= 1;
//!     }
//!
//!     fn on_warning(&mut self, warning: &TrainWarning) {
//!         eprintln!("warning: {warning}");
//!     }
//! }
//! ```

mod data;
mod error;
mod folder;
mod movers;
mod observer;
mod options;
mod painted_sky;
mod part;
mod priors;
mod scene;
mod score;
#[cfg(test)]
mod tests;
mod training;
mod whole;

pub use crate::movers::MoverOutcome;
pub use crate::movers::sheet::FILE as MOVERS_FILE;
pub use crate::poor_photos::{PhotoDefect, PoorPhotoMode};
pub use error::SessionError;
pub use folder::{CHECKPOINT, ConfigFileError, Resume};
pub use observer::{
    ImageMoment, ObserverError, Preparation, StepProgress, TrainImage, TrainNotice, TrainObserver,
    TrainStart, TrainWarning,
};
pub use options::{PriorSource, SessionOptions};
pub use part::TrainPart;
pub use score::{HeldOutScore, HeldOutScores, PerceptualMetric, StepSummary, TrainReport};
pub use training::Training;
pub(crate) use whole::{WholeSession, confirmed_of};

use crate::config::Preset;
use crate::plan::PlanError;
use data::TrainData;
use folder::RunFolder;
use std::path::PathBuf;
use training::TrainInputs;
use wm_render::{Device, Differentiable};
use wm_scene::Scene;

/// A training from photos to a scene.
///
/// Equal photos, options and SIMD path give the same scene, byte for byte, also if the training was
/// stopped and resumed.
pub struct Session {
    dataset: PathBuf,
    options: SessionOptions,
    metric: Option<Box<dyn PerceptualMetric>>,
    backend: Option<Box<dyn Differentiable>>,
}

impl Session {
    /// Returns a session with the usual options for a data set: a folder with a COLMAP model, a
    /// `transforms.json` or another capture, or a folder of photos where COLMAP is installed.
    /// Nothing is read yet.
    #[must_use]
    pub fn new(dataset: impl Into<PathBuf>) -> Self {
        Self { dataset: dataset.into(), options: SessionOptions::default(), metric: None, backend: None }
    }

    /// Sets all options.
    #[must_use]
    pub fn options(mut self, options: SessionOptions) -> Self {
        self.options = options;
        self
    }

    /// Sets the preset: how much time the training may take.
    #[must_use]
    pub fn preset(mut self, preset: Preset) -> Self {
        self.options.plan.preset = preset;
        self
    }

    /// Sets the number of steps.
    #[must_use]
    pub fn steps(mut self, steps: u32) -> Self {
        self.options.plan.steps = Some(steps);
        self
    }

    /// Sets the largest number of splats.
    #[must_use]
    pub fn max_splats(mut self, most: usize) -> Self {
        self.options.plan.max_splats = Some(most);
        self
    }

    /// Sets the scale of the scene, metres per scene unit.
    #[must_use]
    pub fn metres_per_unit(mut self, metres: f64) -> Self {
        self.options.facts.metres_per_unit = Some(metres);
        self
    }

    /// Holds out every N-th photo and evaluates on it.
    #[must_use]
    pub fn hold_out(mut self, every: u32) -> Self {
        self.options.held_out.every = every;
        self
    }

    /// Sets the folder for configuration, checkpoint and metrics.
    #[must_use]
    pub fn run_folder(mut self, folder: impl Into<PathBuf>) -> Self {
        self.options.run_folder = Some(folder.into());
        self
    }

    /// Continues the training in the run folder.
    #[must_use]
    pub fn resume(mut self) -> Self {
        self.options.resume = Resume::Always;
        self
    }

    /// Replaces a training in the run folder.
    #[must_use]
    pub fn overwrite(mut self) -> Self {
        self.options.resume = Resume::Overwrite;
        self
    }

    /// Sets the device to train on.
    #[must_use]
    pub fn device(mut self, device: Device) -> Self {
        self.options.device = device;
        self
    }

    /// Sets a back end of the caller's, in place of that of [`SessionOptions::device`].
    #[must_use]
    pub fn backend(mut self, backend: Box<dyn Differentiable>) -> Self {
        self.backend = Some(backend);
        self
    }

    /// Sets a metric that is measured on the held-out photos at the end.
    #[must_use]
    pub fn metric(mut self, metric: Box<dyn PerceptualMetric>) -> Self {
        self.metric = Some(metric);
        self
    }

    /// Trains to the end and returns the scene.
    ///
    /// # Errors
    /// [`SessionError`] says what is wrong with the data set, the options or the run folder, or why
    /// the training ended early.
    pub fn run(self, observer: &mut dyn TrainObserver) -> Result<Scene, SessionError> {
        self.prepare(observer)?.run(observer)
    }

    /// Does everything before the first step: opens the data set and the run folder, opens or
    /// estimates priors, and makes the splats to start with.
    ///
    /// # Errors
    /// [`SessionError`] as for [`Self::run`].
    pub fn prepare(self, observer: &mut dyn TrainObserver) -> Result<Training, SessionError> {
        let Self { dataset, options, metric, backend } = self;
        if let Some(height) = options.camera_height.filter(|height| !(height.is_finite() && *height > 0.0)) {
            return Err(SessionError::CameraHeight(height));
        }
        if let Some(config) = &options.config {
            config.check().map_err(PlanError::from)?;
        }
        if metric.is_some() && options.held_out.every == 0 {
            return Err(SessionError::NothingHeldOut);
        }
        let mut folder = RunFolder::open(options.run_folder.as_deref(), options.resume)?;
        if folder.starts_again() {
            observer.on_notice(&TrainNotice::StartsAgain(folder.path().to_owned()));
        }
        let data = TrainData::open(&dataset, &options, &folder, observer)?;
        if let Some(metric) = &metric {
            check_sizes(&data, metric.smallest_side())?;
        }
        folder.make()?;
        data.write_poor(&folder)?;
        let config = match options.config.clone() {
            Some(config) => config,
            None => options.plan.config(data.set.places.len(), data.confirmed_pixels())?,
        };
        let (steps, photos) = (options.plan.preset.steps(), data.set.places.len());
        if options.config.is_none() && options.plan.steps.is_none() && config.steps < steps {
            observer.on_notice(&TrainNotice::FewerSteps { steps: config.steps, of: steps, photos });
        }
        if !folder.resumes() {
            // A folder that cannot be written should be found before the photos are compared.
            folder.write_config(&config)?;
        }
        let mut priors = priors::open(&dataset, &options, &data, &folder, observer)?;
        let movers = movers::search(&config, &options, &data, priors.as_mut(), &folder, observer)?;
        let inputs = TrainInputs { dataset, data, priors, movers, folder, options, metric, backend };
        Training::new(config, inputs, observer)
    }
}

/// Refuses held-out photos that are too small for the metric.
fn check_sizes(data: &TrainData, smallest: u32) -> Result<(), SessionError> {
    for place in &data.held_out {
        let camera = data.set.photos.camera(*place, 0);
        if camera.width.min(camera.height) < smallest {
            return Err(SessionError::SmallPhoto {
                photo: data.set.name(*place).to_owned(),
                width: camera.width,
                height: camera.height,
                smallest,
            });
        }
    }
    Ok(())
}
