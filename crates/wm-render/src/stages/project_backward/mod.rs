//! The derivative of projection: from what the pixels pull on a splat to its stored parameters.
//!
//! Contract, with the names of [`super::project`] and the sums of
//! [`rasterize_backward`](super::rasterize_backward) over all tiles. Let `P = [[ux, 0], [vx, vy]]`
//! and `C = 4 ln^2 2 [[suu, suv], [suv, svv]]`:
//!
//! - Centre: `dL/dx = 2 ln2 (ux su + vx sv)`, `dL/dy = 2 ln2 vy sv`.
//! - Opacity: `dL/dlogit = s (1 - o)`.
//! - Shape: `dL/dM = P^T C P M`, from `d cov2d = dM M^T + M dM^T`. The antialiased mode adds
//!   `s / 2` times the derivative of `ln(sharp / det)`, where its floor does not act: with the
//!   minors `d_jk` of M, `sharp = sum d_jk^2` and `det = sharp + 0.3 tr(M M^T) + 0.09`.
//! - `Q_jk = M_j . dL/dM_k` over the columns of M is symmetric and is all that scale and rotation
//!   need: `dL/dlog s_j = Q_jj`, and by a turn about the splat's own axis i, with (i, j, k) cyclic,
//!   `dL/dturn_i = Q_jk (s_j^2 - s_k^2) / (s_j s_k)`.
//! - Normal `n = +-R_m`: adds `e_m x (R^T dL/dn)` to the turn; which axis and sign do not change.
//! - Quaternion of length l, unit `q`: `dL/dquat = 2 / l sum_i dL/dturn_i q (0, e_i)`.
//! - Mean: through the centre, through view z, through the Jacobian's `1 / z` (which scales M as a
//!   whole, so `-sum_j Q_jj / z`) and its tangents (0 where they are held at their limit), and
//!   through the direction of the colour.
//!
//! `P M` is computed without cancellation, as `cov2d` is: its second row is
//! `vy (sum_j M_xj d_jk + 0.3 M_yk) / cov2d_xx`. For a needle the plain product loses all digits.
//!
//! Tolerance: each value is a sum of products of like magnitude. Relative L2 over a scene's splats
//! 1e-5; for needles and splats at the near plane 1e-3, since `u` and `v` lose digits there. The
//! centre errs by some ulp of its coordinate in px: for splats smaller than a pixel that alone is
//! 1e-4 of their gradients.

pub(crate) mod cpu;
#[cfg(feature = "gpu")]
pub(crate) mod gpu;
#[cfg(feature = "gpu")]
pub(crate) mod rows;
#[cfg(test)]
mod tests;
