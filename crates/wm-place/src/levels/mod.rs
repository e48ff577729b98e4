//! Scenes in levels of detail: how they are built, and which part is drawn under a budget of
//! splats.
//!
//! [`LevelBuilder`] takes splats block by block and writes leaves, each at levels with half the
//! splats of the one before. A cut (`LevelCut`) chooses a level for each leaf of a
//! [`wm_scene::levels::LevelIndex`]; small renders (`LevelLooks`) tell it which leaves are hidden,
//! and which splats a picture draws.
//!
//! With a quarter of the splats against all, at 960x640 px, the least of four views: garden 72.4
//! dB, flowers 41.5 dB, the built-in park 41.4 dB, the built-in street 39.8 dB, taebak 34.4 dB;
//! depth within 0.6 %, alpha within 0.004. Two to four times the splats that are drawn are held.
//! `examples/level_quality.rs` measures it.

mod budget;
mod build;
mod coverage;
mod cut;
mod judge;
mod leaves;
mod merge;
mod seen;
mod shot;
mod stream;
mod weather_scene;
mod worth;

pub(crate) use budget::BudgetShares;
#[cfg(test)]
pub(crate) use budget::held_bytes;
pub use budget::{LevelBudget, MAX_FRAME_SPLATS, parse_memory};
pub use build::{LevelBuilder, LevelOptions, LevelSummary};
pub(crate) use coverage::coverage;
pub(crate) use cut::{CutBudget, LevelCut, VisibleLeaf};
pub(crate) use seen::DrawnAttributes;
pub(crate) use seen::{CoarseLeaves, DrawnPart, HeldLeaf, LevelLooks};
pub use shot::shot_cameras;
pub(crate) use stream::{LevelStream, RunId};
pub(crate) use weather_scene::{WeatherFocus, WeatherScene, nearest_of};
