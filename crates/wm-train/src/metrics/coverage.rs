//! Measures whether splats cover surfaces, and leave the sky open.

use super::depth::is_known;

/// Coverage by splats that counts as a surface: where the median depth begins.
pub const MIN_SURFACE_COVERAGE: f32 = 0.5;
/// A depth is in front of another or behind it if it differs by more than this share of the true
/// one.
pub const DEPTH_TOLERANCE_SHARE: f32 = 0.05;

/// Lost surfaces, over the pixels whose true depth is known; shares are 0-1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceLost {
    /// Pixels whose true depth is known.
    pub pixels: usize,
    /// Share of those that are covered by less than a half: one looks through.
    pub open: f64,
    /// Share of those that are covered, but by something more than 5 % farther away.
    pub behind: f64,
}

impl SurfaceLost {
    /// Both.
    #[must_use]
    pub fn lost(&self) -> f64 {
        self.open + self.behind
    }
}

/// Returns the shares of surfaces in `truth` that are lost, given the `coverage` and `median_depth`
/// of all splats but the sky's, each `[H, W]`, in the unit of `truth`. `None` where no truth is
/// known.
///
/// # Panics
/// If the sizes differ.
pub(crate) fn surface_lost(coverage: &[f32], median_depth: &[f32], truth: &[f32]) -> Option<SurfaceLost> {
    assert!(coverage.len() == truth.len() && median_depth.len() == truth.len(), "maps of one size");
    let (mut pixels, mut open, mut behind) = (0usize, 0usize, 0usize);
    for ((coverage, depth), truth) in coverage.iter().zip(median_depth).zip(truth) {
        if !is_known(*truth) {
            continue;
        }
        pixels += 1;
        // Rounding may leave a pixel that is covered by just a half without a median depth.
        if *coverage < MIN_SURFACE_COVERAGE || *depth <= 0.0 {
            open += 1;
        } else if *depth > truth * (1.0 + DEPTH_TOLERANCE_SHARE) {
            behind += 1;
        }
    }
    let share = |count: usize| count as f64 / pixels as f64;
    (pixels > 0).then(|| SurfaceLost { pixels, open: share(open), behind: share(behind) })
}

/// Share of the sky's pixels that are covered by more than a half by splats that are not the sky's,
/// 0-1; `sky` and `coverage` are `[H, W]`, `sky` above 0.5 in the sky. `None` where there is no
/// sky.
///
/// # Panics
/// If the sizes differ.
pub(crate) fn sky_covered(coverage: &[f32], sky: &[f32]) -> Option<f64> {
    assert_eq!(coverage.len(), sky.len(), "two maps of one size");
    let sky = coverage.iter().zip(sky).filter(|(_, sky)| **sky > 0.5);
    let (pixels, covered) = sky.fold((0usize, 0usize), |(pixels, covered), (coverage, _)| {
        (pixels + 1, covered + usize::from(*coverage > MIN_SURFACE_COVERAGE))
    });
    (pixels > 0).then(|| covered as f64 / pixels as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_surface_is_lost_where_one_looks_through_or_behind() {
        let truth = [10.0, 10.0, 10.0, 10.0, 0.0, f32::INFINITY];
        let coverage = [0.9, 0.4, 0.9, 0.9, 0.0, 0.0];
        let depth = [10.4, 0.0, 10.6, 5.0, 0.0, 0.0];
        let lost = surface_lost(&coverage, &depth, &truth).unwrap();
        assert_eq!((lost.pixels, lost.open, lost.behind, lost.lost()), (4, 0.25, 0.25, 0.5));
        assert_eq!(surface_lost(&[1.0], &[1.0], &[0.0]), None);
    }

    #[test]
    fn the_sky_should_be_open() {
        assert_eq!(sky_covered(&[0.9, 0.4, 0.1, 0.9], &[1.0, 1.0, 1.0, 0.0]), Some(1.0 / 3.0));
        assert_eq!(sky_covered(&[0.9], &[0.0]), None);
    }
}
