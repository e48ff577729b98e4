//! What training makes of the colours of a picture and of its photo, on a device where they are: the mean absolute
//! difference, structural dissimilarity, and the derivative of both by what was rendered.
//!
//! Contract, with `c` the rendered colour of a pixel, `[M | b]` the photo's exposure, `x = M c + b`, `y` the photo and
//! `m` its mask:
//!
//! - `L1 = sum m |x - y| / (3 sum m)`, over pixels and channels; where both are equal there is no way to go.
//! - `DSSIM = 1 - mean S(m x, m y)` over all pixels and channels, with the Gaussian [`WINDOW`] as rows and columns, zero
//!   beyond the border (Wang et al. 2004). Windowed means `mx my exx + eyy exy` of it make
//!   `S = (2 mx my + c1)(2 (exy - mx my) + c2) / ((mx^2 + my^2 + c1)(exx - mx^2 + eyy - my^2 + c2))`; its derivative by `x`
//!   is `W dS/dmx + 2 x W dS/dexx + y W dS/dexy`, windowed again.
//! - With `g` the derivative of their weighted sum by `x`, that by `c` is `M^T g`, and that by the exposure
//!   `sum g [c, 1]^T`.
//!
//! The CPU's terms are the trainer's; this is for a device on which splats stay ([`Resident`](crate::Resident)).
//!
//! Tolerance: photos are kept as 16-bit fractions, off by at most 7.7e-6. Windowed squares about 1 less their means err by
//! a few ulp, 1e-7, and are divided by at least `c2` = 9e-4: 1e-4 of `S` where a picture is flat, 1e-6 where it is not.
//! Relative L2 of the derivative below 1e-4.

#[cfg(feature = "gpu")]
pub mod gpu;
#[cfg(all(test, feature = "gpu"))]
mod tests;

/// Pixels of the window to each side of its middle.
pub const RADIUS: usize = 5;
/// The window of structural similarity: Gaussian of standard deviation 1.5 px, sum 1.
pub const WINDOW: [f32; 2 * RADIUS + 1] = [
    0.001_028_38,
    0.007_598_76,
    0.036_000_77,
    0.109_360_69,
    0.213_005_53,
    0.266_011_72,
    0.213_005_53,
    0.109_360_69,
    0.036_000_77,
    0.007_598_76,
    0.001_028_38,
];
/// What keeps its first factor from 0 over 0, for values 0-1.
pub const C1: f32 = 0.01 * 0.01;
/// The second's.
pub const C2: f32 = 0.03 * 0.03;

/// A term of the loss over colours that a device can compute.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColorTerm {
    /// Mean absolute difference.
    L1,
    /// Structural dissimilarity.
    Dssim,
}

impl ColorTerm {
    /// Number of terms.
    pub const COUNT: usize = 2;
}

/// An affine change of colour: the rows of M, each with its b behind it.
pub type Exposure = [f32; 12];
/// None.
pub const NO_EXPOSURE: Exposure = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];

/// A photo to compare with.
#[derive(Clone, Copy, Debug)]
pub struct Comparison<'a> {
    /// Its number: of one size it always is the same photo, so that a device can keep it.
    pub photo: usize,
    /// `[H, W, 3]`, 0-1, display-referred.
    pub rgb: &'a [f32],
    /// `[H, W]`, 0-1, what each pixel counts; `None` where all count alike.
    pub mask: Option<&'a [f32]>,
    /// What becomes of rendered colours before.
    pub exposure: Exposure,
    /// The weight of each [`ColorTerm`].
    pub weights: [f64; ColorTerm::COUNT],
}

/// What came of it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Compared {
    /// The value of each [`ColorTerm`], before weighting.
    pub values: [f64; ColorTerm::COUNT],
    /// The derivative of the weighted sum by the exposure.
    pub by_exposure: [f64; 12],
}
