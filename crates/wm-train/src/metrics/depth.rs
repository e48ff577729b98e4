//! Errors of rendered depth.

/// Errors of depth over the pixels whose truth is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthErrors {
    /// Pixels whose truth is known.
    pub pixels: usize,
    /// AbsRel: the mean of |depth - truth| / truth. A pixel without depth counts as 1.
    pub abs_rel: f64,
    /// The median of the same.
    pub median_rel: f64,
    /// Share of pixels where max(depth / truth, truth / depth) is below 1.25, 0-1. One without
    /// depth is not.
    pub delta: f64,
    /// Share of pixels without depth, 0-1.
    pub missing: f64,
}

/// The ratio that depth within delta differs by (Eigen et al. 2014, section 4.1).
pub(crate) const DELTA_RATIO: f32 = 1.25;

/// Errors of `depth`, `[H, W]`, 0 where there is none, against `truth`, `[H, W]` in the same unit,
/// where that is above 0 and finite. `None` where it is nowhere.
///
/// # Panics
/// If the sizes differ.
pub(crate) fn depth_errors(depth: &[f32], truth: &[f32]) -> Option<DepthErrors> {
    assert_eq!(depth.len(), truth.len(), "two maps of one size");
    let known = depth.iter().zip(truth).filter(|(_, truth)| is_known(**truth));
    let (mut errors, mut sum, mut within, mut missing) = (Vec::new(), 0.0, 0usize, 0usize);
    for (depth, truth) in known {
        let has_depth = *depth > 0.0 && depth.is_finite();
        let error = if has_depth { ((depth - truth) / truth).abs() } else { 1.0 };
        missing += usize::from(!has_depth);
        within += usize::from(has_depth && (depth / truth).max(truth / depth) < DELTA_RATIO);
        sum += f64::from(error);
        errors.push(error);
    }
    let pixels = errors.len();
    let share = |count: usize| count as f64 / pixels as f64;
    Some(DepthErrors {
        pixels,
        median_rel: median(&mut errors)?,
        abs_rel: sum / pixels as f64,
        delta: share(within),
        missing: share(missing),
    })
}

/// Returns true if a true depth is that of a surface.
pub(super) fn is_known(truth: f32) -> bool {
    truth > 0.0 && truth.is_finite()
}

/// The middle one, of an even number the lower; `None` of none.
pub(super) fn median(values: &mut [f32]) -> Option<f64> {
    let middle = values.len().checked_sub(1)? / 2;
    let (_, median, _) = values.select_nth_unstable_by(middle, f32::total_cmp);
    Some(f64::from(*median))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_without_depth_are_errors_and_without_truth_are_none() {
        let truth = [2.0, 4.0, 10.0, 0.0, f32::INFINITY, 8.0];
        let found = depth_errors(&[2.2, 3.0, 0.0, 5.0, 5.0, 8.0], &truth).unwrap();
        assert_eq!((found.pixels, found.missing, found.delta), (4, 0.25, 0.5));
        assert!((found.abs_rel - (0.1 + 0.25 + 1.0 + 0.0) / 4.0).abs() < 1e-6);
        assert!((found.median_rel - 0.1).abs() < 1e-6);
        assert_eq!(depth_errors(&[1.0], &[0.0]), None);
    }
}
