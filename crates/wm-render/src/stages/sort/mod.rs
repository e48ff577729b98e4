//! One tile's splats in the order of blending: by view z, then by splat index.
//!
//! Contract: keys are `depth bits << 32 | record index`, all different; the result is their
//! ascending order as integers. Exact, so every back end agrees.
//!
//! The order is that of one tile, not of the picture. So there is no global sort, tiles need not
//! wait for each other, and any number of threads gives the same bytes.

pub mod cpu;
#[cfg(feature = "gpu")]
pub(crate) mod gpu;
#[cfg(test)]
mod tests;
