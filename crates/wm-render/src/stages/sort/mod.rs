//! One tile's splats in the order of blending: by view z, then by splat index.
//!
//! Contract: keys are `depth bits << 32 | record index`, all different; the result is their
//! ascending order as integers. Exact, so every back end agrees.

pub mod cpu;
#[cfg(feature = "gpu")]
pub(crate) mod gpu;
#[cfg(test)]
mod tests;
