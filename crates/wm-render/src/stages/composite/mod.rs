//! One tile's sums to the finished frame: background, pixel effects, output.
//!
//! Contract: `rgb = sum w_i c_i + (1 - alpha) background`, the background seen through the air at
//! infinity. Then what falls in front ([`super::particles`]), then the pixel effects in order. Then
//! `depth = sum w z / alpha`, `normal` at length 1, both 0 where alpha is below 1/255; median depth
//! 0 where alpha is below 0.5.
//!
//! A pass with a surface ([`crate::DrawPass::surface`]) keeps its particles out of the colour: they
//! fall before what is laid on the surface, and are in [`crate::Frame::particles`] if that is asked
//! for.
//!
//! The background is evaluated at nodes at most half a degree and a third of a patch apart, and
//! interpolated linearly: airlight and plain skies have no detail finer than that. A backdrop that
//! has ([`crate::hooks::Detail::Fine`]) is evaluated at every pixel's centre.

pub(crate) mod background;
pub(crate) mod cpu;
#[cfg(feature = "gpu")]
pub(crate) mod gpu;
#[cfg(test)]
mod tests;
