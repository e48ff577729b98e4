//! Builds places out of primitives.
//!
//! `builder` has the tools: frames of reference, blocks, posts. `street` and `park` say what stands
//! where and call the rest; nearly every other file builds one kind of thing, in a frame of its
//! own.

mod builder;
mod facade;
mod far;
mod fences;
mod furniture;
mod gardens;
mod growth;
mod house;
mod houses;
mod lots;
pub(crate) mod movers;
mod palette;
pub(crate) mod park;
mod pavilion;
mod porch;
mod props;
mod roof;
mod species;
pub(crate) mod street;
mod terrain;
mod tree;

pub(crate) use builder::{Builder, Primitive};
pub(crate) use houses::porch;
