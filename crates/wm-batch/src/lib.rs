//! Data sets of many weathers: a plan in, files in the layouts that training code reads out.
//!
//! A [`BatchPlan`] crosses scenes, weathers, paths and sensors. Its clips, frames and blocks are
//! found by their numbers alone, so that any machine can make any block: [`BatchRun::make`]. Files
//! of a block are put in place whole, with hashes, and marked as done last; [`merge()`] lists what
//! lacks and writes the tables over all.
//!
//! ```
//! use wm_batch::{BatchClips, BatchPlan};
//! use std::path::Path;
//!
//! # let folder = tempfile::tempdir()?;
//! # std::fs::write(folder.path().join("street.ply"), "")?;
//! let plan = BatchPlan::parse(
//!     r#"
//!     seed = 7
//!
//!     [[scene]]
//!     file = "street.ply"
//!
//!     [[weather]]
//!     from = ["fog", "heavy-rain"]
//!
//!     [[weather]]
//!     samples = 98              # weathers as they come, one Latin hypercube over the set
//!     "#,
//!     "plan.toml",
//!     folder.path(),
//!     "plan",
//! )?;
//! let clips = BatchClips::of(&plan, &mut |_| Ok(Vec::new()))?;
//! assert_eq!(clips.frames(), 100);
//! assert_eq!(clips.clip(&plan, 42)?.weather.weather, clips.clip(&plan, 42)?.weather.weather);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # How a set is made
//! A plan (`plan/`) numbers clips by scenes, weathers and paths, frames by clips, and blocks by
//! runs of frames of one scene (`clips.rs`). Each is found by its number. So are samples, since a
//! Latin hypercube is a keyed permutation (`hypercube.rs`). So a block depends on the plan alone,
//! and shards know nothing of each other.
//!
//! `shots.rs` renders and scans what the sensors of a block read, and `writers.rs` writes it on a
//! second thread, into the folder `.work`. `store.rs` renames the files into place and writes the
//! marker of the block last, in the folder `done`. Markers hold poses and times, from which
//! `merge.rs` makes the tables of all layouts without a scene. A reading that is asked for alone
//! (`sample.rs`) goes through `shots.rs` too; `places.rs` keeps the scenes open that were used
//! last.
//!
//! A layout ([`Layout`]) knows only [`SetInfo`],
//! [`ClipInfo`] and [`SensorReading`], not the renderer.

mod array_files;
mod cameras;
mod clips;
mod condition;
mod distribution;
mod error;
mod hypercube;
mod layouts;
mod merge;
mod picture_files;
mod places;
mod plan;
mod records;
mod run;
mod sample;
mod set;
mod shots;
mod splits;
mod stills;
mod store;
mod summary;
#[cfg(any(test, feature = "testing"))]
pub mod testing;
mod utc;
mod weathers;
mod writers;

#[cfg(test)]
mod sample_tests;
#[cfg(test)]
mod tests;

pub use clips::{BatchClips, PlannedBlock, PlannedClip};
pub use error::SetError;
pub use hypercube::RandomPermutation;
pub use layouts::{BlockWriter, ClipStream, FileSink, LAYOUTS, LayerNeeds, Layout};
pub use merge::{FRAMES, MANIFEST, MergedSet, merge, missing_blocks, runs_of};
pub use plan::{BatchPlan, FRAMES_LAYOUT, PlanScene};
pub use records::{
    BlockInfo, CameraInfo, ClipInfo, ClipRecord, Condition, DatasetDetection, DatasetPoint, PictureReading,
    PlaceInfo, PointSource, ReadingData, ReadingInfo, SensorInfo, SensorInfoKind, SensorReading, SetInfo,
    WeatherInfo,
};
pub use run::{BatchRun, WriteShare};
pub use sample::{BatchSample, SampleArray, SampleData, SampleOptions, SampleValues};
pub use splits::SplitClips;
pub use store::{BatchStore, scene_digest_of};
pub use summary::PAGE;
pub use weathers::PlannedWeather;
pub use wm_capture::RigidPose;
