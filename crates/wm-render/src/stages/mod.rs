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
//! | [`particles`] | what falls, camera | for each patch, the drops that touch it; their cover |
//! | [`composite`] | one tile's sums, background, pixel effects | the finished frame |
//! | [`rays`] | splats, rays from anywhere | what each ray meets |
//!
//! and back, for training:
//!
//! | stage | takes | gives |
//! |---|---|---|
//! | [`compare`] | a picture and its photo | losses of colour, and their derivative |
//! | [`rasterize_backward`] | a loss's derivative by one tile's pixels | what they pull on its splats |
//! | [`shade_backward`] | pulls on colours | gradients by coefficients and directions |
//! | [`project_backward`] | pulls on 2D Gaussians | gradients by the stored parameters |
//! | [`optimize`] | gradients | parameters, moved |
//!
//! The GPU's body of a stage is `gpu.rs`, with its WGSL beside it. The contract says the formula,
//! the shapes, the cutoffs, and the tolerance with its derivation. The parity tests run every back
//! end and every SIMD path against [`mod@crate::reference`], which knows nothing of tiles; the
//! macro `parity!` lists them. Without an adapter the tests of the GPU are skipped, or fail with
//! `WM_REQUIRE_GPU=1`. One kernel source serves all SIMD paths ([`crate::simd`]).

pub mod compare;
pub(crate) mod composite;
pub mod intersect;
pub mod optimize;
pub mod particles;
#[cfg(feature = "gpu")]
pub(crate) mod prefix_sum;
pub mod project;
pub(crate) mod project_backward;
pub mod rasterize;
pub mod rasterize_backward;
pub mod rays;
pub mod shade;
pub(crate) mod shade_backward;
pub mod sort;
