//! Falling particles over the finished scene: one pass, no order, no layers.
//!
//! Contract. A [`Particle`](crate::hooks::Particle) with covariance S at view z becomes a 2D
//! Gaussian with `cov2d = J S J^T + 0.3 I` (J as in [`super::project`], but of its own centre, not
//! clamped) and the optical depth `tau = min(16, p k) exp(-q/2)`. What it hides, the integral of
//! `1 - e^-tau`, is its area in pixels, however small, thin or fast it is: of a Gaussian of depth p
//! it is `2 pi sqrt(det cov2d) Ein(p)`, so that `Ein(p) = w`, the area in pixels over
//! `2 pi sqrt(det)`; p = `w` where it is faint, and [`PEAK_COEFFICIENTS`] gives it within 0.2 % up
//! to 16. It ends at the radius where tau falls below 2^-8, as a splat does, but not below
//! `q = 4.5`; `k` gives back what is cut off there.
//!
//! At each pixel it counts whole if its view z is below that of the scene (expected depth), else by
//! the share of the pixel that the scene leaves open, `1 - alpha`. Over all particles `t = sum tau`
//! and `c = sum tau rgb / t`, and the pixel becomes `e^-t pixel + (1 - e^-t) c` in linear light:
//! transmittances multiply, colours average. The sums are whole numbers of 2^-16, so no order and
//! no number of threads changes a bit.
//!
//! The paper renders the particles in k clouds, one after another, since its masks compare whole
//! pictures; one depth test for each particle and pixel is the limit of many clouds.
//!
//! Tolerance: a term is rounded to 2^-17 in tau (half a step), and its exponent is good to 1e-4
//! (f32 positions of some thousand pixels, times slopes of up to 2 a pixel): 3e-5 + 2e-4 tau a
//! particle in tau, before the decision of the depth test, which is free within 1e-5 of z.

pub(crate) mod cpu;
#[cfg(feature = "gpu")]
pub(crate) mod gpu;
#[cfg(test)]
mod tests;

/// Added to the diagonal of the 2D covariance, px^2: as the splats' own.
pub const DILATION: f32 = super::project::DILATION;
/// Greatest optical depth of one particle.
pub const MAX_OPTICAL_DEPTH: f32 = 16.0;
/// Optical depth at which a particle ends.
pub(crate) const MIN_OPTICAL_DEPTH: f32 = 1.0 / 256.0;
/// Squared radius that every particle covers at least, standard deviations^2.
pub(crate) const MIN_SQUARED_RADIUS: f32 = 4.5;
/// Coefficients of w, w^2, ... of `ln(p / w)`, fitted.
pub(crate) const PEAK_COEFFICIENTS: [f32; 4] = [0.259_93, 0.012_677, 0.026_802, -0.003_624_7];
/// Greatest w: `Ein(16)`.
pub(crate) const MAX_COVER: f32 = 3.35;
/// Integer steps of an optical depth of 1.
pub(crate) const STEPS_PER_OPTICAL_DEPTH: f32 = 65536.0;
