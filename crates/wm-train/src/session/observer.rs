//! The messages of a session to its caller.

use super::score::{HeldOutScore, HeldOutScores, StepSummary, TrainReport};
use crate::colmap::{self, UnregisteredPhoto};
use crate::movers::MoverOutcome;
use crate::photos::PhotoError;
use crate::poor_photos::PhotoDefect;
use crate::priors::folder::PriorsSummary;
use crate::video::VideoProgress;
use std::error::Error;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use thiserror::Error as Display;
use wm_capture::ground::CaptureGroundError;
use wm_render::Frame;
use wm_scene::{Camera, Remark};

/// An error of an observer, which ends the session.
pub type ObserverError = Box<dyn Error + Send + Sync>;

/// Receives the progress of a [`Session`](super::Session) and can stop it.
///
/// Every method has a default that does nothing, so an observer implements only what it needs; `()`
/// is the silent observer. All calls come from the thread that runs the session.
pub trait TrainObserver {
    /// Called between two pieces of work. [`ControlFlow::Break`] saves what was learnt and ends the
    /// session with [`SessionError::Stopped`](super::SessionError::Stopped).
    fn proceed(&mut self) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    /// Called for what the user should know and can usually do something about.
    fn on_warning(&mut self, _warning: &TrainWarning) {}

    /// Called for facts that the session found out.
    fn on_notice(&mut self, _notice: &TrainNotice) {}

    /// Called often while cameras are registered and priors are estimated, before the first step.
    fn on_preparation(&mut self, _preparation: &Preparation) {}

    /// Called once, before the first step.
    ///
    /// # Errors
    /// An error ends the session; nothing was written then but priors and configuration.
    fn on_start(&mut self, _start: &TrainStart<'_>) -> Result<(), ObserverError> {
        Ok(())
    }

    /// Called after every step.
    fn on_step(&mut self, _step: &StepProgress) {}

    /// Called about 200 times a training, with means over the steps since the last call.
    fn on_summary(&mut self, _summary: &StepSummary) {}

    /// Called about ten times a training, where photos are held out.
    fn on_evaluation(&mut self, _scores: &HeldOutScores) {}

    /// Called after a checkpoint with steps that are done was written.
    fn on_checkpoint(&mut self, _path: &Path, _step: u32) {}

    /// Returns the camera of an image that the observer wants now. `photo` is the camera of the
    /// photo that [`TrainStart::photo`] names.
    fn wants_image(&mut self, _moment: ImageMoment, _photo: &Camera) -> Option<Camera> {
        None
    }

    /// Called with an image that [`Self::wants_image`] asked for.
    ///
    /// # Errors
    /// An error ends the session.
    fn on_image(&mut self, _image: &TrainImage<'_>) -> Result<(), ObserverError> {
        Ok(())
    }

    /// Called after the last step and the last evaluation.
    fn on_finish(&mut self, _report: &TrainReport) {}
}

/// The observer that ignores everything and never stops.
impl TrainObserver for () {}

/// Something the user should know.
#[derive(Clone, Debug, Display, PartialEq)]
pub enum TrainWarning {
    /// The model has no points.
    #[error(
        "{}: the model has no points; splats begin anywhere in view, which takes longer and gives less", .0.display()
    )]
    NoPoints(PathBuf),
    /// The capture may have been read otherwise than it was meant.
    #[error("{}", .0.text)]
    Capture(Remark),
    /// The cameras of some photos were not found.
    #[error("{}", unregistered(.0))]
    Unregistered(Vec<UnregisteredPhoto>),
    /// The held-out photos were rendered better earlier in the training, by PSNR and by SSIM.
    #[error(
        "the held-out photos were better after {step} steps ({before}) than after all {steps} ({now}): train for about {step} steps, \
         or with more photos"
    )]
    TooManySteps {
        /// The steps after which they were best.
        step: u32,
        /// All steps.
        steps: u32,
        /// The mean score then.
        before: HeldOutScore,
        /// The mean score at the end.
        now: HeldOutScore,
    },
    /// A photo is missing or damaged and is left out.
    #[error("{0}; it is left out")]
    LeftOut(PhotoError),
    /// Photos are blurred, or white or black over much of the picture.
    #[error("{}", poor(.found, *.are_left_out))]
    PoorPhotos {
        /// Their names and defects.
        found: Vec<(String, PhotoDefect)>,
        /// False if they are so many that they are trained on nevertheless.
        are_left_out: bool,
    },
    /// The EXIF of these photos states a place where they cannot have been taken.
    #[error("{}", misplaced(.0))]
    Misplaced(Vec<String>),
    /// The GPU cannot be used or failed; the training continues on the CPU.
    #[error("{0}; the CPU goes on instead")]
    Gpu(String),
    /// Steps were lost with the GPU and are repeated.
    #[error("{0} steps were lost with the GPU and are taken again")]
    StepsLost(u32),
    /// Up is a guess.
    #[error("{0}")]
    DoubtfulUp(String),
    /// Estimating priors for this many photos takes long, so it is not done unless asked for.
    #[error("no priors are estimated for {photos} photos, since they are more than {most}")]
    ManyPhotos {
        /// Training photos.
        photos: usize,
        /// The most for which priors are estimated unasked.
        most: usize,
    },
    /// Haze is to be taken out, and the photos do not tell its light.
    #[error("the photos share too few points to tell the light of the haze; it is left in")]
    NoHaze,
    /// The scale of the scene is not known.
    #[error("{0}")]
    NoScale(String),
}

/// Most photos that are named in a warning.
const MAX_NAMED_PHOTOS: usize = 5;

/// Lists the first few, and says how many more there are.
fn list(photos: impl ExactSizeIterator<Item = String>) -> String {
    let more = photos.len().saturating_sub(MAX_NAMED_PHOTOS);
    let named = photos.take(MAX_NAMED_PHOTOS).collect::<Vec<_>>().join(", ");
    if more > 0 { format!("{named}, and {more} more") } else { named }
}

fn poor(found: &[(String, PhotoDefect)], are_left_out: bool) -> String {
    let named = list(found.iter().map(|(name, defect)| format!("{name} ({defect})")));
    let end = if are_left_out {
        "they are left out of the training"
    } else {
        "they are too many to leave out, and are trained on"
    };
    format!("poor photos: {named}; {end}")
}

fn misplaced(photos: &[String]) -> String {
    let named = list(photos.iter().cloned());
    format!(
        "{named}: the EXIF states a place where the photo cannot have been taken; up, north and scale are found without \
         it"
    )
}

fn unregistered(photos: &[UnregisteredPhoto]) -> String {
    format!(
        "{} of the photos have no camera and are left out: {}; take photos between them and the others",
        photos.len(),
        list(photos.iter().map(ToString::to_string))
    )
}

/// A fact that the session found out.
#[derive(Clone, Debug, Display, PartialEq)]
pub enum TrainNotice {
    /// Photos were taken out of a video.
    #[error("video: {0} frames were chosen")]
    FramesChosen(usize),
    /// Something about how the capture was read.
    #[error("capture: {}", .0.text)]
    Capture(Remark),
    /// COLMAP found the cameras of some of the photos.
    #[error("colmap: the cameras of {registered} of {photos} photos were found")]
    Registered {
        /// Photos whose camera was found.
        registered: usize,
        /// Photos in all.
        photos: usize,
    },
    /// Priors were estimated from the photos.
    #[error("geometry: {0}")]
    PriorsMade(PriorsSummary),
    /// The points of the reconstruction are brighter in some photos than in others, so every photo
    /// has an exposure of its own.
    #[error("exposure: one for each photo, their brightness differs by {:.0} %", 100.0 * .0)]
    ExposuresDiffer(f64),
    /// The training takes fewer steps than its preset has, since it has few photos.
    #[error("steps: {steps} instead of {of}, since more would learn {photos} photos by heart")]
    FewerSteps {
        /// The steps that it takes.
        steps: u32,
        /// The steps of the preset.
        of: u32,
        /// Training photos.
        photos: usize,
    },
    /// Movers were searched for.
    #[error("movers: {}", found_movers(.outcome, *.photos))]
    Movers {
        /// The conclusion.
        outcome: MoverOutcome,
        /// Training photos.
        photos: usize,
    },
    /// The photos were taken in haze, and the scene will be without it.
    #[error("haze: the photos were taken in haze of {0}; it is taken out")]
    Haze(String),
    /// Not every photo has priors.
    #[error("{}: {found} of {photos} photos have priors", .folder.display())]
    PriorsIncomplete {
        /// The folder of the priors.
        folder: PathBuf,
        /// Training photos with priors.
        found: usize,
        /// Training photos in all.
        photos: usize,
    },
    /// The training continues from a checkpoint.
    #[error("{}: continuing after step {step}", .folder.display())]
    Resumed {
        /// The run folder.
        folder: PathBuf,
        /// Steps that are done.
        step: u32,
    },
    /// The training in the run folder was ended before its first checkpoint, and starts from its
    /// first step.
    #[error("{}: no checkpoint was written yet, starting from the first step", .0.display())]
    StartsAgain(PathBuf),
    /// The height of the cameras gives no scale.
    #[error("scale: none from the height of the cameras: {0}")]
    NoScaleFromHeight(CaptureGroundError),
    /// The scale of the scene was found.
    #[error("scale: {metres_per_unit:.4} m per unit, from {source}")]
    Scale {
        /// Metres per scene unit.
        metres_per_unit: f64,
        /// The origin of the scale, in words.
        r#source: String,
    },
}

fn found_movers(outcome: &MoverOutcome, photos: usize) -> String {
    match outcome {
        MoverOutcome::Found { photos: with, share } => {
            format!("in {with} of {photos} photos, {:.1} % of the pixels, left out", 100.0 * share)
        }
        MoverOutcome::TooMany(share) => format!(
            "none are left out, since {:.0} % of the pixels differ between photos, which cannot be true",
            100.0 * share
        ),
        MoverOutcome::None | MoverOutcome::TooFewJudged(_) => "none were found".into(),
    }
}

/// Progress before the first step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Preparation {
    /// A video is being looked at.
    Video(VideoProgress),
    /// COLMAP is finding cameras.
    Colmap(colmap::ColmapProgress),
    /// Priors are being estimated: passes done and in all.
    Priors {
        /// Passes that are done.
        done: usize,
        /// Passes in all.
        total: usize,
    },
}

/// The state before the first step.
#[derive(Clone, Copy, Debug)]
pub struct TrainStart<'a> {
    /// Steps that are done already; above 0 after resuming.
    pub step: u32,
    /// Steps in all.
    pub steps: u32,
    /// The name of the photo whose view [`TrainObserver::wants_image`] is offered.
    pub photo: &'a str,
    /// The size of the scene, scene units.
    pub extent: f64,
}

/// The state after a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepProgress {
    /// Steps that are done.
    pub step: u32,
    /// Steps in all.
    pub steps: u32,
    /// The number of splats.
    pub splats: usize,
    /// The loss of this step.
    pub loss: f64,
}

/// The moment at which an image is offered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImageMoment {
    /// After any step.
    Step,
    /// About ten times a training, and at the end.
    Milestone,
}

/// A rendered image of the training.
#[derive(Clone, Copy, Debug)]
pub struct TrainImage<'a> {
    /// Steps that are done.
    pub step: u32,
    /// The moment at which it was offered.
    pub moment: ImageMoment,
    /// The name of the photo whose view was offered.
    pub photo: &'a str,
    /// The camera that was asked for.
    pub camera: Camera,
    /// The image.
    pub frame: &'a Frame,
    /// PSNR against the photo, dB; `None` for another camera than the photo's.
    pub psnr: Option<f64>,
}
