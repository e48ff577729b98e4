//! The GPU back end: the stages of the CPU's, in WGSL, on any adapter that wgpu drives.
//!
//! The draw passes of a plan are one submission ([`crate::plan`]), or two if the CPU gathers
//! particles or paints a detailed sky for one of them, which it does while the GPU draws the first
//! splats. The GPU counts by itself what is in view and what touches the tiles, and sizes its own
//! dispatches by it; nothing is read back before the pictures are. Lists have room for what the
//! frames before needed and some more. Where that is not enough they are cut off, the counts say so
//! when they come back with the picture, and the frame is made again with more room.
//!
//! | pass | stage | programs |
//! |---|---|---|
//! | project | [`project`](crate::stages::project), [`shade`](crate::stages::shade), [`prefix_sum`](crate::stages::prefix_sum) | cull, spine, project with the air |
//! | sort | [`sort`](crate::stages::sort) | four radix passes over depths |
//! | intersect | [`intersect`](crate::stages::intersect) | count, spine, write, radix passes over tiles, ranges |
//! | rasterize | [`rasterize`](crate::stages::rasterize) | a workgroup per tile |
//! | fall | [`particles`](crate::stages::particles) | a workgroup per drop, sums of whole numbers |
//! | composite | [`composite`](crate::stages::composite) | background, particles |
//!
//! Everything is summed in an order that is fixed, so a frame is the same, byte by byte, each time
//! on one adapter. Ties in depth are broken as on the CPU, since splats are in the same order.
//!
//! Tiles have 16x16 px, with a thread per pixel. Splats in view are sorted by depth first; the sort
//! of the entries by tile is stable, so that each list is in the order of depth.
//!
//! Rays from anywhere ([`GpuRaySplats`], stage [`rays`](crate::stages::rays)) find their splats as
//! tiles do, packet by packet, and are no frame.
//!
//! Hooks: the air runs on the GPU if it has a [`WgslSource`](crate::hooks::WgslSource); otherwise
//! the frame is refused. Attributes of splats, backgrounds of several colours and pixel effects are
//! still computed by the CPU, and uploaded or applied to the picture that came back.
//!
//! A program has at most eight storage buffers, and models are in pieces that fit one binding, so
//! any adapter will do. Constants are written into the WGSL from those of the Rust code
//! (`source.rs`). Tests hold structures of both against each other, and parse and validate every
//! program without an adapter.

#[cfg(any(test, feature = "testing"))]
mod air;
pub(crate) mod buffers;
pub(crate) mod device;
mod differentiable;
pub(crate) mod error;
mod hosted;
mod lists;
pub(crate) mod model;
mod pass;
#[cfg(test)]
pub(crate) mod probe;
mod rays;
mod readback;
pub(crate) mod recorder;
mod renderer;
mod resident;
pub(crate) mod source;
mod stored;
pub(crate) mod uniforms;

pub(crate) use device::{AdapterChoice, GpuConfig};
pub use device::{AdapterKind, Gpu, ListedAdapter, adapters};
pub use differentiable::GpuDifferentiable;
pub use error::GpuError;
pub use rays::GpuRaySplats;
pub use renderer::GpuRenderer;
#[cfg(test)]
pub(crate) use source::Subgroups;

#[cfg(test)]
mod tests;
