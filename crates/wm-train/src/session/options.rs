//! Everything about a session that can be chosen.

use super::folder::Resume;
use super::part::TrainPart;
use crate::config::TrainConfig;
use crate::dataset::{DatasetReadOptions, HeldOut};
use crate::plan::TrainPlan;
use crate::poor_photos::PoorPhotoMode;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;
use wm_render::{CpuConfig, Device};
use wm_scene::Metadata;

/// The priors of a training: depth, normals and sky of its photos.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum PriorSource {
    /// The folder `priors` in the data set if it exists, else they are estimated from the photos,
    /// if these are not very many.
    #[default]
    Auto,
    /// They are estimated from the photos.
    Photos,
    /// This folder.
    Folder(PathBuf),
    /// There are none.
    None,
}

/// Everything about a session but its data set.
#[derive(Clone, Debug, PartialEq)]
pub struct SessionOptions {
    /// The places of photos, masks and cameras, and the size of photos.
    pub dataset: DatasetReadOptions,
    /// The photos that are held out for evaluation.
    pub held_out: HeldOut,
    /// The treatment of blurred, white and black photos.
    pub poor_photos: PoorPhotoMode,
    /// The preset and what is changed of it.
    pub plan: TrainPlan,
    /// A whole configuration, in place of `plan`.
    pub config: Option<TrainConfig>,
    /// The priors.
    pub priors: PriorSource,
    /// Facts about the place that are known: up, ground, scale.
    pub facts: Metadata,
    /// The height of the cameras above the ground, metres: gives the scale where `facts` does not.
    pub camera_height: Option<f64>,
    /// The folder for configuration, checkpoint and metrics; without it none of these are written.
    pub run_folder: Option<PathBuf>,
    /// The choice of whether the training in the run folder is continued.
    pub resume: Resume,
    /// The longest time between two checkpoints.
    pub checkpoint_every: Duration,
    /// The device to train on.
    pub device: Device,
    /// Threads and SIMD path of the CPU's work.
    pub cpu: CpuConfig,
    /// The part of the data set that is learnt, in place of `held_out` and all other photos; `None`
    /// learns all of it. See [`crate::blocks`].
    pub part: Option<Arc<TrainPart>>,
}

impl Default for SessionOptions {
    fn default() -> Self {
        Self {
            dataset: DatasetReadOptions::default(),
            held_out: HeldOut::default(),
            poor_photos: PoorPhotoMode::Auto,
            plan: TrainPlan::default(),
            config: None,
            priors: PriorSource::Auto,
            facts: Metadata::default(),
            camera_height: None,
            run_folder: None,
            resume: Resume::Never,
            checkpoint_every: Duration::from_secs(45),
            device: Device::Auto,
            cpu: CpuConfig::default(),
            part: None,
        }
    }
}
