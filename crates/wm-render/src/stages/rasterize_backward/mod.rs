//! The derivative of blending: from each pixel of a tile to the splats of its list.
//!
//! Contract, with the names of [`super::rasterize`], `O_k = sum w_i f_ik` the blended sums,
//! `A = sum w_i`, `T` the transmittance at the end, and `v_k`, `v_A` the derivatives of the loss by
//! `O_k` and `A`. Of a frame's pictures they are:
//!
//! - `rgb = O + (1 - A) background`: `v_A -= v_rgb . background`.
//! - `depth = D / A`: `v_D = v_depth / A`, `v_A -= v_D D / A` unless detached.
//! - `normal = N / |N|`: `v_N = (v_n - (v_n . n) n) / |N|`.
//!
//! The forward pass is replayed front to back with one number per pixel, `R_i`, what is still to
//! come: `D_i = sum_k v_k f_ik`, `R_0 = sum_k v_k O_k - v_A T`, `R_i = R_{i-1} - w_i D_i`. Then
//! `dL/dalpha_i = T_i D_i - R_i / (1 - alpha_i)`, and `s_i = alpha_i dL/dalpha_i`, 0 where the
//! clamp at 0.99 acts. The cut, the clamp and the stop fall as in the forward pass, since the same
//! code decides.
//!
//! A [`GradientSlot`] holds a splat's sums over the pixels of one tile. Each pair of splat and tile
//! has its own, and they are added in the order of the tiles: no atomics, and the same bytes for
//! any number of threads. The moments are those of `(u, v)`, which are of order 1 for every shape
//! of splat.
//!
//! Tolerance: `R` by subtraction errs by `1e-7 |R_0|`, times at most 100 from `1 - alpha`; sums
//! over a few hundred pixels by a few ulp. Relative L2 over the splats of a scene below 1e-5.

pub mod cpu;
#[cfg(feature = "gpu")]
pub(crate) mod gpu;
#[cfg(test)]
mod tests;

/// The sums of one splat over one tile, one cache line.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(64))]
pub struct GradientSlot(pub [f32; GradientSlot::LEN]);

impl GradientSlot {
    /// Numbers of a slot.
    pub(crate) const LEN: usize = 16;
    /// `sum s`.
    pub(crate) const S: usize = 0;
    /// `sum s u`.
    pub(crate) const SU: usize = 1;
    /// `sum s v`.
    pub(crate) const SV: usize = 2;
    /// `sum s u^2`.
    pub(crate) const SUU: usize = 3;
    /// `sum s u v`.
    pub(crate) const SUV: usize = 4;
    /// `sum s v^2`.
    pub(crate) const SVV: usize = 5;
    /// `sum |s (ux u + vx v)|`.
    pub(crate) const ABS_X: usize = 6;
    /// `sum |s v|`.
    pub(crate) const ABS_Y: usize = 7;
    /// `sum w`.
    pub(crate) const WEIGHT: usize = 8;
    /// `sum w v_k` from here on.
    pub(crate) const FEATURES: usize = 9;
}

/// In place of a slot's number: the pair was never reached.
pub const NO_SLOT: u32 = u32::MAX;
