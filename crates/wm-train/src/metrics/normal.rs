//! Errors of rendered normals.

use super::depth::median;

/// Angles between normals over the pixels whose truth is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NormalErrors {
    /// Pixels whose truth is known.
    pub pixels: usize,
    /// Mean angle, degrees. A pixel without normal counts as 90.
    pub mean: f64,
    /// Median angle, degrees.
    pub median: f64,
    /// Share of pixels without normal, 0-1.
    pub missing: f64,
}

/// The angle between two vectors, degrees, 0-180; `None` if either is (0, 0, 0).
#[must_use]
pub fn angle(a: &[f32], b: &[f32]) -> Option<f32> {
    let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum::<f64>();
    let lengths = (dot(a, a) * dot(b, b)).sqrt();
    (lengths > 0.0).then(|| (dot(a, b) / lengths).clamp(-1.0, 1.0).acos().to_degrees() as f32)
}

/// Angles between `normals` and `truth`, both `[H, W, 3]` in the same axes, where `truth` is not 0.
/// `None` where it is nowhere.
///
/// # Panics
/// If the sizes differ.
pub(crate) fn normal_errors(normals: &[f32], truth: &[f32]) -> Option<NormalErrors> {
    assert_eq!(normals.len(), truth.len(), "two maps of one size");
    let (mut angles, mut missing) = (Vec::new(), 0usize);
    for (normal, truth) in normals.chunks_exact(3).zip(truth.chunks_exact(3)) {
        if truth.iter().all(|v| *v == 0.0) {
            continue;
        }
        let angle = angle(normal, truth);
        missing += usize::from(angle.is_none());
        angles.push(angle.unwrap_or(90.0));
    }
    let pixels = angles.len();
    let mean = angles.iter().map(|v| f64::from(*v)).sum::<f64>() / pixels as f64;
    Some(NormalErrors { pixels, mean, median: median(&mut angles)?, missing: missing as f64 / pixels as f64 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_are_degrees() {
        let truth = [0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let found = [0.0, 0.6, 0.6, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0];
        let errors = normal_errors(&found, &truth).unwrap();
        assert_eq!(errors.pixels, 3);
        assert!((errors.mean - (45.0 + 0.0 + 90.0) / 3.0).abs() < 1e-4);
        assert!((errors.median - 45.0).abs() < 1e-4);
        assert!((errors.missing - 1.0 / 3.0).abs() < 1e-9);
        assert_eq!(normal_errors(&[1.0, 0.0, 0.0], &[0.0; 3]), None);
    }
}
