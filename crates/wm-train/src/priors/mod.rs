//! Priors: depth, normals and sky of photos that are known or estimated before training, one source
//! per file.
//!
//! - [`photos`]: from the photos themselves, by multi-view stereo.
//! - [`files`]: from maps in files.
//! - [`given`]: what a source says of a photo, made a prior; [`relative`]: its depth, fitted to the
//!   points.
//! - [`sky`]: which pixels are the sky.
//! - [`folder`]: priors on disk.
//!
//! Photos tell most of what a training needs to know of depth, without a network: stereo over the
//! known cameras, the points of the reconstruction where stereo is silent, and the sky by its look.
//! A network or maps give the same kind of prior. Relative depth is fitted to the points when
//! priors are made (`fit.rs`), not in the loss: training sees one kind of prior, and what does not
//! fit is named before it starts.

pub mod files;
pub mod fit;
pub mod folder;
pub mod given;
pub(crate) mod normals;
pub mod photos;
pub mod points;
mod prior;
pub mod relative;
pub mod sky;
pub(crate) mod stereo;

pub use folder::{Priors, PriorsWriter};
pub use prior::{Prior, SkyClass};

/// The name of the folder of priors in a data set and in a run folder.
pub const FOLDER: &str = "priors";
