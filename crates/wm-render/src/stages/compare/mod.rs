//! Losses of rendered pictures on the device that holds them: their distance from the photo and
//! from the priors of its depth, normals and sky, and its derivative by the rendered pictures.
//!
//! Contract of colours, with `c` the rendered colour of a pixel, `[M | b]` the photo's exposure,
//! `x = M c + b`, `y` the photo and `m` its mask:
//!
//! - `L1 = sum m |x - y| / (3 sum m)`, over pixels and channels; where both are equal there is no
//!   way to go.
//! - `DSSIM = 1 - mean S(m x, m y)` over all pixels and channels, with the Gaussian
//!   [`WINDOW_WEIGHTS`] as rows and columns, zero beyond the border (Wang et al. 2004). Windowed
//!   means `mx my exx + eyy exy` of it make
//!   `S = (2 mx my + c1)(2 (exy - mx my) + c2) / ((mx^2 + my^2 + c1)(exx - mx^2 + eyy - my^2 + c2))`;
//!   its derivative by `x` is `W dS/dmx + 2 x W dS/dexx + y W dS/dexy`, windowed again.
//! - With `g` the derivative of their weighted sum by `x`, that by `c` is `M^T g`, and that by the
//!   exposure `sum g [c, 1]^T`.
//!
//! Contract of geometry, with the expected depth `D`, the coverage `A` and the normal `N` of a
//! pixel that is covered (`A >= ` [`MIN_COVERAGE`], `D > 0`), the [`PixelPrior`] in it, and a grid of
//! G pixels:
//!
//! - `Depth = sum sqrt(o^2 + t^2) - t over G`, `o = ln(D d)` with the believed inverse depth
//!   `d > 0` and `t = max(sigma / d, `[`MIN_RELATIVE_SIGMA`]`)`.
//! - `Normal = sum |N - M|^2 over G`.
//! - `Coverage = sum max(|A - S| - `[`COVERAGE_TOLERANCE`]`, 0) over all pixels`, covered or not.
//! - `Patches`: [`Patches`] of the grid, of `x = 1 / D` and `d >= 0`. With means and deviations of
//!   a patch's covered pixels, `s` the deviation of all (global) or the patch's (local) and
//!   [`DEVIATION_FLOOR`] of that of all added, `o = (x - mean x) / s_x - (d - mean d) / s_d`; the
//!   mean of the squares of those above the margin, globally and, by its share, locally. The
//!   deviation of all is a constant of the derivative; patches of fewer than [`MIN_PATCH_PIXELS`]
//!   do not count.
//! - `Smooth = sum exp(-|y_i - y_j| / `[`EDGE_CONTRAST`]`) |x_i - x_j| over sum x`, over
//!   neighbouring covered pixels, with the mean of the channels' differences; the sum below is a
//!   constant of the derivative.
//!
//! The CPU's terms are the trainer's; this is for a device on which splats stay
//! ([`Resident`](crate::Resident)).
//!
//! Tolerance: photos, normals and coverage are kept as 16-bit fractions, off by at most 1.6e-5.
//! Windowed squares about 1 less their means err by a few ulp, 1e-7, and are divided by at least
//! `c2` = 9e-4: 1e-4 of `S` where a picture is flat, 1e-6 where it is not. Deviations of a patch
//! are merged from those of its pixels, not differences of squares. Relative L2 of each derivative
//! below 1e-4.

#[cfg(feature = "gpu")]
pub mod gpu;
#[cfg(all(test, feature = "gpu"))]
mod tests;

/// Reach of the window to each side of its middle.
pub const WINDOW_RADIUS_PX: usize = 5;
/// The window of structural similarity: Gaussian of standard deviation 1.5 px, sum 1.
pub const WINDOW_WEIGHTS: [f32; 2 * WINDOW_RADIUS_PX + 1] = [
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
/// The constant that keeps the first factor of structural similarity from 0 / 0, for values 0-1.
pub const C1: f32 = 0.01 * 0.01;
/// The constant that keeps the second factor from 0 / 0.
pub const C2: f32 = 0.03 * 0.03;

/// Least coverage of a pixel whose depth and normal are compared.
pub const MIN_COVERAGE: f32 = 0.5;
/// Difference from the prior of coverage that counts as none: coverage approaches 1 only slowly,
/// and a gradient that never vanishes makes splats large.
pub const COVERAGE_TOLERANCE: f32 = 0.05;
/// Least relative standard deviation `t` of a depth prior.
pub const MIN_RELATIVE_SIGMA: f32 = 0.01;
/// Share of the photo's deviation that is added to that of each patch, so that flat patches do not
/// divide by nearly 0.
pub const DEVIATION_FLOOR: f64 = 0.01;
/// Fewest covered pixels of a patch that counts.
pub const MIN_PATCH_PIXELS: usize = 6;
/// Difference of brightness that tells surfaces apart, 0-1.
pub const EDGE_CONTRAST: f32 = 0.1;

/// A term of the loss that a device can compute.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Term {
    /// Mean absolute difference of colours.
    L1,
    /// Structural dissimilarity.
    Dssim,
    /// Depth against its prior.
    Depth,
    /// Normals against their priors.
    Normal,
    /// Coverage against its prior.
    Coverage,
    /// Relative depth of patches against its prior.
    Patches,
    /// Smooth depth.
    Smooth,
}

impl Term {
    /// Number of terms.
    pub(crate) const COUNT: usize = 7;
}

/// An affine change of colour: the rows of M, each with its b behind it.
pub type Exposure = [f32; 12];
/// The exposure that changes nothing.
pub const NO_EXPOSURE: Exposure = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];

/// The prior of one pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelPrior {
    /// Inverse view z, 1 / scene unit: 0 in the sky, below 0 where nothing is known or the pixel is
    /// not of the grid.
    pub disparity: f32,
    /// Unit normal, world axes; 0 where nothing is known.
    pub normal: [f32; 3],
    /// Coverage, 0-1; below 0 where nothing is known.
    pub coverage: f32,
}

impl PixelPrior {
    /// A pixel about which nothing is known.
    pub const NONE: Self = Self { disparity: -1.0, normal: [0.0; 3], coverage: -1.0 };
}

/// The priors of a photo.
#[derive(Clone, Copy)]
pub struct GridPriors<'a> {
    /// The standard deviation of disparities, 1 / scene unit.
    pub sigma: f32,
    /// Columns and rows of the grid, at most those of the photo: column `i` of `n` is at
    /// `(2 i + 1) width / (2 n)`.
    pub grid: (u32, u32),
    /// `[H, W]`, asked for where the device does not have it.
    pub pixels: &'a (dyn Fn() -> Vec<PixelPrior> + Sync),
}

/// The division of a grid into patches, and the differences that count.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Patches {
    /// Side of a patch, pixels of the grid.
    pub side: u32,
    /// Weight of the differences that are divided by the deviations of the patch itself.
    pub local: f32,
    /// Differences up to this count as none.
    pub margin: f32,
}

/// A photo to compare with, and the weights of the terms; all 0 by default.
#[derive(Clone, Copy, Default)]
pub struct Comparison<'a> {
    /// Number of the photo. Together with the size it names one photo for ever, so that a device
    /// can keep it and the priors of it.
    pub photo: usize,
    /// `[H, W, 3]`, 0-1, display-referred.
    pub rgb: &'a [f32],
    /// Weight of each pixel in the terms of colour, `[H, W]`, 0-1; `None` if all have weight 1.
    pub mask: Option<&'a [f32]>,
    /// The exposure that is applied to rendered colours first.
    pub exposure: Exposure,
    /// The priors; without them only colours and smoothness have terms.
    pub believed: Option<GridPriors<'a>>,
    /// Settings of [`Term::Patches`].
    pub patches: Patches,
    /// The weight of each [`Term`].
    pub weights: [f64; Term::COUNT],
}

impl Comparison<'_> {
    /// The weight of a term.
    #[cfg(feature = "gpu")]
    pub(crate) fn weight(&self, term: Term) -> f64 {
        self.weights[term as usize]
    }
}

/// The result of a comparison.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Compared {
    /// The value of each [`Term`] that has a weight, before weighting.
    pub values: [f64; Term::COUNT],
    /// The derivative of the weighted sum by the exposure.
    pub by_exposure: [f64; 12],
}

/// Workgroups that add up a picture on a GPU.
#[cfg(feature = "gpu")]
pub(crate) const WORKGROUP_COUNT: u32 = 64;
