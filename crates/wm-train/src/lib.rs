//! Training: from photos to a scene of Gaussian splats.
//!
//! [`Session`] does everything: it opens a data set, finds cameras with COLMAP where there are
//! none, estimates depth, normals and sky of the photos, trains, and returns a scene with its scale
//! and its ground.
//!
//! ```no_run
//! let scene = wm_train::Session::new("photos").steps(2000).run(&mut ())?;
//! wm_scene::formats::write_scene("place.ply".as_ref(), &scene)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! The types to know:
//! - [`Session`]: a training in one call, with [`SessionOptions`] for everything that can be
//!   chosen.
//! - [`TrainObserver`]: receives progress, warnings, scores and images, and can stop the training.
//! - [`TrainPlan`]: a preset with changes; it makes a [`TrainConfig`], on which the result depends.
//! - [`Trainer`]: single steps, for programs with a loop and photos of their own.
//! - [`Dataset`]: an open data set, for [`priors`] and [`evaluation`].
//!
//! ```
//! use wm_train::{Preset, TrainPlan};
//!
//! let plan = TrainPlan {
//!     preset: Preset::Quick,
//!     steps: Some(500),
//!     loss: vec![("depth".into(), 0.1)],
//!     ..TrainPlan::default()
//! };
//! // For 24 photos with 46 million pixels that several photos show.
//! let config = plan.config(24, 24 * 1600 * 1200)?;
//! assert_eq!(config.steps, 500);
//! assert_eq!(config.loss.geometry.depth, 0.1);
//! # Ok::<(), wm_train::plan::PlanError>(())
//! ```
//!
//! Modules, from photos to scores:
//! - [`photos`]: the photos of a capture, decoded, resized and undistorted on demand; [`colmap`]:
//!   cameras of plain photos; [`video`]: photos out of a video.
//! - [`wm_image::maps`]: depth, normals and masks of photos in files; [`priors`]: the same, fitted
//!   to the scene before a training.
//! - [`config`], [`plan`]: the configuration; [`checkpoint`]: a training on disk.
//! - [`blocks`]: trainings of the parts of a large place, and their join.
//! - [`evaluation`], [`metrics`]: scores against photos and ground truth.
//!
//! Private modules hold the steps: `start` (the first splats), `trainer`, `losses`, `densify`,
//! `schedule` and `exposure`; `haze` and `movers` find what is in the photos and not in the scene.

#![allow(clippy::needless_range_loop)] // Lane loops index several arrays at once.

pub mod blocks;
mod brightness;
mod check;
pub mod checkpoint;
pub mod colmap;
pub mod config;
pub mod dataset;
mod densify;
pub mod evaluation;
mod exposure;
mod files;
mod fill;
mod haze;
mod learner;
mod losses;
pub mod metrics;
mod movers;
mod overlap;
mod photo_warp;
pub mod photos;
mod pieces;
pub mod plan;
mod poor_photos;
pub mod priors;
mod random;
mod schedule;
pub mod session;
mod ssim;
mod start;
mod trainer;
pub mod video;

pub use config::{Preset, TrainConfig};
pub use dataset::{Dataset, DatasetReadOptions, HeldOut};
pub use losses::TrainPhoto;
pub use plan::TrainPlan;
pub use session::{Session, SessionError, SessionOptions, TrainObserver};
pub use trainer::{StepReport, StepTimes, TrainState, Trainer};
