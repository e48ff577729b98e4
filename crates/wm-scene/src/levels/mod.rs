//! Scenes in levels of detail: leaves in space, each a run of splats in a file at every level.
//!
//! The files are a streamed SOG of PlayCanvas, version 1: `lod-meta.json` lists the leaves, and
//! folders beside it hold the splats of many leaves at one level each. [`LevelIndex`] is what
//! `lod-meta.json` says; [`LevelFile`] is one such folder, decoded. A SOG bundle may stand for a
//! folder: pages fetch it with one request.
//!
//! ```text
//! lod-meta.json = {
//!   "version": 1, "asset": {"generator"}, "count", "counts": [a level], "lodLevels",
//!   "lodErrors": true,                   every leaf has errors; absent if not
//!   "environment": "env/meta.json",      splats that are always drawn, such as the sky; may be absent
//!   "filenames": ["0_0/meta.json", ...],
//!   "tree": {"bound": {"min", "max"}, "children": [node, node]}
//!         | {"bound": {"min", "max"}, "lods": {"0": {"file", "offset", "count"}, ...}, "errors": [a level]},
//!   "wm": {...}                          this library's metadata
//! }
//! ```

mod bundles;
mod file;
mod index;
mod tiles;
mod tree;
mod writer;

#[cfg(test)]
mod tests;

pub use file::LevelFile;
pub use index::{INDEX_NAME, LevelIndex, LevelLeaf, LevelRun, MAX_LEVELS};
pub use tiles::TilePlan;
pub use writer::{LevelEnd, LevelFileJob, LevelWriteOptions, LevelWriter, NewLeaf};
