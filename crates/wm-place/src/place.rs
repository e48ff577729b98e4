//! A scene that a renderer holds, and what weather knows of it.

mod answers;
mod attributes;
mod draw;
mod in_levels;
mod levels;
mod load;
mod prepared;
mod sensors;
mod supply;
mod surface;

pub use levels::LevelCounts;
pub(crate) use prepared::check_owner;
pub use prepared::{PlaceFacts, PlaceOptions, PreparedPlace};
