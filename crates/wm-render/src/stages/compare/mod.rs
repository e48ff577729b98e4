//! Losses of rendered pictures on the device that holds them: their distance from the photo and
//! from the priors of its depth, normals and sky, and its derivative by the rendered pictures.
//!
//! Contract of colours, with `c` the rendered colour of a pixel, `[M | b]` the photo's exposure,
//! `x = M c + b`, `y` the photo and `m` its mask:
//!
//! - `L1 = sum m |x - y| / (3 sum m)`, over pixels and channels; where both are equal there is no
//!   way to go.
//! - `DSSIM = 1 - mean S(m x, m y)` over all pixels and channels, with the Gaussian [`WINDOW`] as
//!   rows and columns, zero beyond the border (Wang et al. 2004). Windowed means
//!   `mx my exx + eyy exy` of it make
//!   `S = (2 mx my + c1)(2 (exy - mx my) + c2) / ((mx^2 + my^2 + c1)(exx - mx^2 + eyy - my^2 + c2))`;
//!   its derivative by `x` is `W dS/dmx + 2 x W dS/dexx + y W dS/dexy`, windowed again.
//! - With `g` the derivative of their weighted sum by `x`, that by `c` is `M^T g`, and that by the
//!   exposure `sum g [c, 1]^T`.
//!
//! Contract of geometry, with the expected depth `D`, the coverage `A` and the normal `N` of a
//! pixel that is covered (`A >= ` [`COVERED`], `D > 0`), the [`Belief`] in it, and a grid of G
//! pixels:
//!
//! - `Depth = sum sqrt(o^2 + t^2) - t over G`, `o = ln(D d)` with the believed inverse depth
//!   `d > 0` and `t = max(sigma / d, `[`EXACT`]`)`.
//! - `Normal = sum |N - M|^2 over G`.
//! - `Coverage = sum max(|A - S| - `[`SLACK`]`, 0) over all pixels`, covered or not.
//! - `Patches`: [`Patches`] of the grid, of `x = 1 / D` and `d >= 0`. With means and deviations of
//!   a patch's covered pixels, `s` the deviation of all (global) or the patch's (local) and
//!   [`FLOOR`] of that of all added, `o = (x - mean x) / s_x - (d - mean d) / s_d`; the mean of the
//!   squares of those above the margin, globally and, by its share, locally. The deviation of all
//!   is a constant of the derivative; patches of fewer than [`FEWEST`] do not count.
//! - `Smooth = sum exp(-|y_i - y_j| / `[`EDGE`]`) |x_i - x_j| over sum x`, over neighbouring
//!   covered pixels, with the mean of the channels' differences; the sum below is a constant of the
//!   derivative.
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
/// The constant that keeps its first factor from 0 over 0, for values 0-1.
pub const C1: f32 = 0.01 * 0.01;
/// The second's.
pub const C2: f32 = 0.03 * 0.03;

/// Least coverage of a pixel whose depth and normal count.
pub const COVERED: f32 = 0.5;
/// Difference from the believed coverage that counts as none: coverage comes near to 1 only slowly,
/// and a pull that never ends makes splats large.
pub const SLACK: f32 = 0.05;
/// Least `t` of believed depth.
pub const EXACT: f32 = 0.01;
/// Share of the photo's deviation that is added to every one, so that flat patches do not explode.
pub const FLOOR: f64 = 0.01;
/// Fewest pixels of a patch that says something.
pub const FEWEST: usize = 6;
/// Difference of brightness that parts surfaces, 0-1.
pub const EDGE: f32 = 0.1;

/// A term of the loss that a device can compute.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Term {
    /// Mean absolute difference of colours.
    L1,
    /// Structural dissimilarity.
    Dssim,
    /// Believed depth.
    Depth,
    /// Believed normals.
    Normal,
    /// Believed coverage.
    Coverage,
    /// Believed relative depth of patches.
    Patches,
    /// Smooth depth.
    Smooth,
}

impl Term {
    /// Number of terms.
    pub const COUNT: usize = 7;
}

/// An affine change of colour: the rows of M, each with its b behind it.
pub type Exposure = [f32; 12];
/// None.
pub const NO_EXPOSURE: Exposure = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];

/// The prior of one pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Belief {
    /// Inverse view z, 1 / scene unit: 0 in the sky, below 0 where nothing is known or the pixel is
    /// not of the grid.
    pub disparity: f32,
    /// World axes, length 1; 0 as well.
    pub normal: [f32; 3],
    /// Coverage, 0-1; below 0 as well.
    pub coverage: f32,
}

impl Belief {
    /// Nothing.
    pub const NONE: Self = Self { disparity: -1.0, normal: [0.0; 3], coverage: -1.0 };
}

/// The priors of a photo.
#[derive(Clone, Copy)]
pub struct Believed<'a> {
    /// The standard deviation of disparities, 1 / scene unit.
    pub sigma: f32,
    /// Columns and rows of the grid, at most those of the photo: column `i` of `n` is at
    /// `(2 i + 1) width / (2 n)`.
    pub grid: (u32, u32),
    /// `[H, W]`, asked for where the device does not have it.
    pub pixels: &'a (dyn Fn() -> Vec<Belief> + Sync),
}

/// The cut of a grid into patches, and the differences that count.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Patches {
    /// Their side, pixels of the grid.
    pub side: u32,
    /// Share of differences by their own deviations.
    pub local: f32,
    /// Differences up to this are none.
    pub margin: f32,
}

/// A photo to compare with; without any weight.
#[derive(Clone, Copy, Default)]
pub struct Comparison<'a> {
    /// Its number: of one size it always is the same photo, so that a device can keep it and what
    /// is believed of it.
    pub photo: usize,
    /// `[H, W, 3]`, 0-1, display-referred.
    pub rgb: &'a [f32],
    /// `[H, W]`, 0-1, what each pixel counts in colours; `None` where all count alike.
    pub mask: Option<&'a [f32]>,
    /// The exposure that is applied to rendered colours first.
    pub exposure: Exposure,
    /// The priors; without them only colours and smoothness have terms.
    pub believed: Option<Believed<'a>>,
    /// Of [`Term::Patches`].
    pub patches: Patches,
    /// The weight of each [`Term`].
    pub weights: [f64; Term::COUNT],
}

impl Comparison<'_> {
    /// The weight of a term.
    #[must_use]
    pub fn weight(&self, term: Term) -> f64 {
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
