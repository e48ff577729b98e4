//! From photos to splats.
//!
//! - [`photos`]: the photos of a capture, decoded, resized and undistorted when they are needed.
//! - [`colmap`]: a capture from a plain folder of photos, by the COLMAP that is installed.
//! - [`start`]: the splats to begin with.
//! - [`trainer`]: steps of training, with [`losses`], [`densify`], [`schedule`] and
//!   [`exposure`] for their parts, and [`config`] (and its [`check`]) for what they depend on.
//! - [`checkpoint`]: a training on disk.
//! - [`maps`]: depth, normals and masks of photos, out of files.
//! - [`metrics`]: how near a picture is to a photo.

#![allow(clippy::needless_range_loop)] // Lane loops index several arrays at once.

pub mod check;
pub mod checkpoint;
pub mod colmap;
pub mod config;
pub mod dataset;
pub mod densify;
pub mod evaluation;
pub mod exposure;
mod learner;
pub mod losses;
pub mod maps;
pub mod metrics;
pub mod photos;
pub mod plan;
pub mod priors;
pub mod random;
pub mod schedule;
pub mod session;
pub mod ssim;
pub mod start;
pub mod trainer;

pub use config::{Preset, TrainConfig};
pub use dataset::{Dataset, DatasetReadOptions, HeldOut};
pub use plan::TrainPlan;
pub use session::{Session, SessionError, SessionOptions, TrainObserver};
pub use trainer::{StepReport, StepTimes, TrainState, Trainer};
