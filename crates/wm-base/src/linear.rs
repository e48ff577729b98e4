//! The little linear algebra that a survey needs.

use crate::jacobi::jacobi;
use glam::{DMat3, DVec3};

/// Eigenvalues and unit eigenvectors of a symmetric matrix, the smallest value first.
pub fn eigen(matrix: DMat3) -> [(f64, DVec3); 3] {
    let (values, vectors) = jacobi(matrix.to_cols_array_2d());
    let mut pairs = [0, 1, 2].map(|k| (values[k], DVec3::from_array(vectors[k])));
    pairs.sort_by(|x, y| x.0.total_cmp(&y.0));
    pairs
}

/// `weight v v^T`, to sum up second moments.
pub fn outer(v: DVec3, weight: f64) -> DMat3 {
    DMat3::from_cols(v * (v.x * weight), v * (v.y * weight), v * (v.z * weight))
}

/// Two unit vectors that make a right-handed frame with `up` as the third.
///
/// They follow the world axes where `up` does, so that sizes are told along them.
pub fn horizontals(up: DVec3) -> (DVec3, DVec3) {
    let least = up.abs().min_position();
    let x = (DVec3::AXES[least] - up * up[least]).normalize();
    (x, up.cross(x))
}

/// `count` directions spread evenly over the sphere (a Fibonacci spiral), the index-th of them.
pub fn direction(index: usize, count: usize) -> DVec3 {
    let z = 1.0 - (2 * index + 1) as f64 / count as f64;
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let (sin, cos) = (golden * index as f64).sin_cos();
    let r = (1.0 - z * z).sqrt();
    DVec3::new(r * cos, r * sin, z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn eigenvectors_are_found(values in prop::array::uniform3(-5.0..5.0f64), q in prop::array::uniform4(-1.0..1.0f64)) {
            let q = DQuat::from_array(q);
            prop_assume!(q.length() > 0.1);
            let rotation = DMat3::from_quat(q.normalize());
            let matrix = rotation * DMat3::from_diagonal(DVec3::from_array(values)) * rotation.transpose();
            let found = eigen(matrix);
            let mut sorted = values;
            sorted.sort_by(f64::total_cmp);
            for ((value, vector), want) in found.into_iter().zip(sorted) {
                prop_assert!((value - want).abs() < 1e-9);
                prop_assert!((matrix * vector - value * vector).length() < 1e-9);
                prop_assert!((vector.length() - 1.0).abs() < 1e-9);
            }
        }

        #[test]
        fn horizontals_are_level(v in prop::array::uniform3(-1.0..1.0f64)) {
            prop_assume!(DVec3::from_array(v).length() > 0.1);
            let up = DVec3::from_array(v).normalize();
            let (x, y) = horizontals(up);
            prop_assert!(x.dot(up).abs() < 1e-12 && y.dot(up).abs() < 1e-12 && (x.cross(y) - up).length() < 1e-9);
        }
    }
}
