//! Front-to-back blending of one tile.
//!
//! Contract, for each pixel with centre `p` and the tile's splats in order `i`:
//!
//! - `q_i = log2_opacity_i - u^2 - v^2` at `p` (see [`super::project`]); splats with
//!   `q_i < log2(1/255)` are skipped; `alpha_i = min(0.99, 2^q_i)`.
//! - `T_1 = 1`, `T_{i+1} = T_i (1 - alpha_i)`; blending stops before the splat that would bring `T`
//!   to 1e-4 or below. `w_i = alpha_i T_i`.
//! - `alpha = sum w_i`; colour, view z and normal are `sum w_i f_i`, not divided by alpha.
//! - Front, if the pass has a surface ([`crate::DrawPass::surface`]): colour and alpha summed over
//!   the splats that are nearer than the surface at the pixel, all where there is none; and for the
//!   others the sum of weights over view z. How far a splat is at a pixel is where it is densest
//!   along the ray, after it is flattened to a hundredth along the normal of the surface, about its
//!   centre, if no more than 0.15 of its variance is along the normal (from 0.3 on not at all): its
//!   reciprocal view z is linear over the picture, `1 / z - (S_zx, S_zy) S^-1 d / z^2` with the
//!   covariance `S` of the flattened splat, dilated by 0.02 px^2, and the distance `d` from its
//!   centre. For flat splats that is their plane, so that ground and walls are cut where the
//!   surface meets them, however large their splats are; blurred ground is on the side of its
//!   centre, so that ground of which photos tell little does not reach through water over it. The
//!   two slopes are rounded to 8 bits of precision. A picture of the surface is then laid between:
//!   what lies behind is the difference to the whole, and the light that reaches the surface is the
//!   transmittance `1 - alpha` of the front.
//! - Median depth: the view z of the last splat that starts with `T_i > 0.5`, if `T` ends at 0.5 or
//!   below. A pass that names splats ([`crate::MedianDepth::Splat`]) writes that splat's index in
//!   its place.
//!
//! Tolerance against f64: `q` errs by about 1e-6 |q| and by the error of `u`, `v` (see project),
//! 2^q by 3e-7 relative, a sum over n splats by n / 2 ulp. So colours agree to 1e-5 in the mean.
//! The cuts are steps: a pixel where some `q_i` is within 2e-3 of the cut, or some `T_{i+1}` within
//! 2 % of 1e-4, may differ by that splat's whole weight (`T_i / 255`, or `T_i <= 1e-2`) and no
//! more.

pub mod cpu;
#[cfg(feature = "gpu")]
pub(crate) mod gpu;
#[cfg(test)]
mod tests;

/// Largest alpha of one splat.
pub(crate) const MAX_ALPHA: f32 = 0.99;
/// log2 of [`MAX_ALPHA`].
pub(crate) const LOG2_MAX_ALPHA: f32 = -0.014_499_57;
/// Transmittance that blending never reaches.
pub(crate) const MIN_TRANSMITTANCE: f32 = 1e-4;
