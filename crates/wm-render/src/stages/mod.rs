//! The stages of a render, each with one contract (`mod.rs`), its CPU body (`cpu.rs`) and its
//! parity tests (`tests.rs`).
//!
//! | stage | takes | gives |
//! |---|---|---|
//! | [`project`] | splats, camera | 2D Gaussians of those in view |
//! | [`shade`] | splats, view directions, air | their colours |
//! | [`intersect`] | 2D Gaussians | for each tile, the splats that touch it |
//! | [`sort`] | one tile's splats | the same, front to back |
//! | [`rasterize`] | one tile's splats in order | blended colour, depth, normal, alpha |
//! | [`composite`] | one tile's sums, background, pixel effects | the finished frame |

pub mod composite;
pub mod intersect;
pub mod project;
pub mod rasterize;
pub mod shade;
pub mod sort;
