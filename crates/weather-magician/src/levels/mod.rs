//! Scenes in levels of detail: what of them is drawn under a budget of splats.
//!
//! [`LevelCut`] chooses a level for each leaf of a [`wm_scene::levels::LevelIndex`].

mod build;
mod coverage;
mod cut;
mod judge;
mod leaves;
mod merge;
mod seen;

pub use build::{LevelBuilder, LevelOptions, LevelSummary};
pub use coverage::coverage;
pub use cut::{CutBudget, LevelCut};
pub use seen::seen_shares;
