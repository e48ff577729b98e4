//! Scenes in levels of detail: what of them is drawn under a budget of splats.
//!
//! [`LevelCut`] chooses a level for each leaf of a [`wm_scene::levels::LevelIndex`].

mod coverage;
mod cut;

pub use coverage::coverage;
pub use cut::{CutBudget, LevelCut};
