//! Scenes in levels of detail: what of them is drawn under a budget of splats.
//!
//! [`LevelCut`] chooses a level for each leaf of a [`wm_scene::levels::LevelIndex`].

mod budget;
mod build;
mod coverage;
mod cut;
mod judge;
mod leaves;
mod merge;
mod seen;
mod stream;
mod weather_scene;

pub(crate) use budget::BudgetShares;
#[cfg(test)]
pub(crate) use budget::held_bytes;
pub use budget::{LevelBudget, MOST_SPLATS};
pub use build::{LevelBuilder, LevelOptions, LevelSummary};
pub use coverage::coverage;
pub use cut::{CutBudget, LevelCut};
pub use seen::CoarseLeaves;
pub(crate) use stream::{LevelStream, RunId};
pub use weather_scene::cameras_around;
pub(crate) use weather_scene::{WeatherFocus, WeatherScene, nearest_of};
