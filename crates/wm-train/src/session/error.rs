//! The error of a session.

use super::observer::ObserverError;
use crate::checkpoint::CheckpointError;
use crate::colmap::ColmapError;
use crate::dataset::DatasetError;
use crate::photos::PhotoError;
use crate::plan::PlanError;
use crate::priors::folder::PriorsError;
use crate::priors::photos::PhotoPriorsError;
use crate::video::VideoError;
use std::io;
use std::path::PathBuf;
use thiserror::Error;
use wm_base::FormatError;
use wm_render::RenderError;

/// A reason why a session ends without a scene.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SessionError {
    /// The capture, the scene or another file cannot be read or written.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// The photos cannot be opened.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// A photo is damaged.
    #[error(transparent)]
    Photo(#[from] PhotoError),
    /// COLMAP found no cameras.
    #[error(transparent)]
    Colmap(#[from] ColmapError),
    /// A video gave no photos.
    #[error(transparent)]
    Video(#[from] VideoError),
    /// The folder holds plain photos, and a model in it was named.
    #[error("{}: there is no model that COLMAP wrote", .0.display())]
    NoModel(PathBuf),
    /// Too few photos are left to train on.
    #[error(
        "{}: {left} of {photos} photos are left to learn from, at least 3 are needed; take more photos, or hold out fewer",
        dataset.display()
    )]
    TooFewPhotos {
        /// The data set.
        dataset: PathBuf,
        /// Photos that are not held out.
        left: usize,
        /// Photos in all.
        photos: usize,
    },
    /// A held-out photo is too small for the perceptual metric.
    #[error(
        "{photo}: {width}x{height} px is too small for the perceptual metric, which needs {smallest} on each side"
    )]
    SmallPhoto {
        /// The name of the photo.
        photo: String,
        /// The width of the photo, px.
        width: u32,
        /// The height of the photo, px.
        height: u32,
        /// The shortest side that the metric takes, px.
        smallest: u32,
    },
    /// There is a metric for held-out photos, and none are held out.
    #[error("the perceptual metric measures held-out photos, and none are held out")]
    NothingHeldOut,
    /// A part of the data set names a photo that it does not have.
    #[error("{}: has no photo {photo}, which a block is to learn from; plan the blocks again", dataset.display())]
    NoSuchPhoto {
        /// The data set.
        dataset: PathBuf,
        /// The name of the photo.
        photo: String,
    },
    /// The plan or the configuration is not valid.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The height of the cameras is not a finite number above 0.
    #[error("the camera height is {0}: it must be finite and above 0")]
    CameraHeight(f64),
    /// There is no checkpoint to resume from.
    #[error("{}: there is no training to go on with", .0.display())]
    NothingToResume(PathBuf),
    /// The run folder holds a training that is not finished, and the session would overwrite it.
    #[error("{}: holds a training that is not done", .0.display())]
    Unfinished(PathBuf),
    /// Another training runs in the run folder.
    #[error("{}: another training runs in this folder; wait until it is done, or give another output", .0.display())]
    InUse(PathBuf),
    /// The run folder holds a finished training, and the session would overwrite it.
    #[error("{}: holds a finished training", .0.display())]
    Finished(PathBuf),
    /// The run folder holds a checkpoint that cannot be read, and the session would overwrite it.
    #[error("{} holds a training: {reason}", folder.display())]
    BadCheckpoint {
        /// The run folder.
        folder: PathBuf,
        /// The fault of the checkpoint.
        reason: Box<CheckpointError>,
    },
    /// A checkpoint cannot be written.
    #[error("the training cannot be saved: {0}")]
    Unsaved(Box<CheckpointError>),
    /// The checkpoint cannot be read.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// The checkpoint is of another training than this one.
    #[error("{}: holds a training of other photos, options or SIMD path", .0.display())]
    OtherTraining(PathBuf),
    /// A folder cannot be made.
    #[error("cannot make the folder {}: {reason}", path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// The error of the system.
        reason: io::Error,
    },
    /// The metrics cannot be written.
    #[error("cannot write {}: {reason}", path.display())]
    Metrics {
        /// The file.
        path: PathBuf,
        /// The error of the system.
        reason: io::Error,
    },
    /// The folder that was named holds no priors.
    #[error("{}: holds no priors; make them with `weather-magician priors`", .0.display())]
    NoPriors(PathBuf),
    /// The priors are of another data set.
    #[error("{}: no prior is of a photo of this data set; make them with `weather-magician priors`", .0.display())]
    OtherPriors(PathBuf),
    /// Priors cannot be read.
    #[error(transparent)]
    Priors(#[from] PriorsError),
    /// Priors cannot be estimated from the photos.
    #[error(transparent)]
    PhotoPriors(#[from] PhotoPriorsError),
    /// No point of the model has finite coordinates.
    #[error("{}: no point of the model is finite; make it again", .0.display())]
    NoFinitePoint(PathBuf),
    /// All training photos turned out to be damaged.
    #[error("{}: no photo is left to learn from; copy them again", .0.display())]
    NoPhotoLeft(PathBuf),
    /// A photo turned out to be damaged after some steps; what was learnt is saved.
    #[error("{error}; {step} of {steps} steps are done")]
    DamagedPhoto {
        /// The fault of the photo.
        error: PhotoError,
        /// Steps that are done.
        step: u32,
        /// Steps in all.
        steps: u32,
    },
    /// The GPU failed after some steps; what was learnt is saved.
    #[error("{error}; {step} of {steps} steps are done")]
    GpuLost {
        /// The error of the GPU.
        error: RenderError,
        /// Steps that are done.
        step: u32,
        /// Steps in all.
        steps: u32,
    },
    /// The training ended early, and what was learnt could not be saved.
    #[error("{error}; and what was learnt is lost: {checkpoint}")]
    NotSaved {
        /// The reason why it ended.
        error: String,
        /// The reason why the checkpoint could not be written.
        checkpoint: Box<SessionError>,
    },
    /// The back end failed.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// The loss is not finite.
    #[error("the training came to numbers that are not finite at step {0}: report this with the photos")]
    NotFinite(u32),
    /// The observer stopped the session before the first step.
    #[error("stopped: no step is done yet")]
    StoppedEarly,
    /// The observer stopped the training; what was learnt is saved if the session has a run folder.
    #[error("stopped: {step} of {steps} steps are done")]
    Stopped {
        /// Steps that are done.
        step: u32,
        /// Steps in all.
        steps: u32,
    },
    /// The observer failed.
    #[error("{0}")]
    Observer(ObserverError),
    /// Worker threads cannot be started.
    #[error("cannot start threads: {0}")]
    Threads(String),
}
