//! The numbers of a row of gradients on the GPU.

/// Numbers of a splat in view, see `project_backward.wgsl`.
pub(crate) const ROW: u32 = 18;
/// By the mean, three.
pub(crate) const MEAN: u32 = 0;
/// By the stored quaternion, four.
pub(crate) const QUAT: u32 = 3;
/// By the logarithms of the scales, three.
pub(crate) const SCALE: u32 = 7;
/// By the logit of the opacity.
pub(crate) const OPACITY: u32 = 10;
/// By the centre in the picture, px, two.
pub(crate) const MEAN2D: u32 = 11;
/// Sums of the absolute values of the pixels' derivatives by the centre, two.
pub(crate) const ABSGRAD: u32 = 13;
/// Sum of weights, px.
pub(crate) const WEIGHT: u32 = 15;
/// Three standard deviations along the longest axis, px.
pub(crate) const RADIUS: u32 = 16;
/// Index of the splat, as bits.
pub(crate) const INDEX: u32 = 17;
