//! One tile's sums to the finished frame: background, pixel effects, output.
//!
//! Contract: `rgb = sum w_i c_i + (1 - alpha) background`, the background seen through the air at
//! infinity. Then the pixel effects in order. Then `depth = sum w z / alpha`, `normal` at length 1,
//! both 0 where alpha is below 1/255; median depth 0 where alpha is below 0.5.
//!
//! The background is evaluated at nodes at most half a degree and a third of a patch apart, and
//! interpolated linearly: skies and airlight have no detail finer than that.

pub mod background;
pub mod cpu;
#[cfg(test)]
mod tests;
