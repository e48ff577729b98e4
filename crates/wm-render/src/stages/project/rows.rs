//! The rows of a group of splats on the GPU.

/// Rows of sixteen numbers of a group of splats on the GPU, see `geometry.wgsl`.
pub(crate) const ROWS: u32 = 15;
/// Mean, three rows.
pub(crate) const ROW_MEAN: u32 = 0;
/// Quaternion, wxyz, four rows: of length 1, or as stored.
pub(crate) const ROW_QUAT: u32 = 3;
/// Standard deviations, three rows, or their logarithms.
pub(crate) const ROW_SCALE: u32 = 7;
/// log2 of the opacity, or its logit.
pub(crate) const ROW_OPACITY: u32 = 10;
/// Coefficient 0 of the colour, three rows.
pub(crate) const ROW_DC: u32 = 11;
/// 1 for splats of the sky, else 0.
pub(crate) const ROW_SKY: u32 = 14;
