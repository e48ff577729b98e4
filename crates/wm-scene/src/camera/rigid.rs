//! Rigid poses: a rotation and a translation, nothing else.

use glam::{DMat3, DMat4, DQuat, DVec3};
use thiserror::Error;

/// Largest difference of an element of `R R^T` from the identity for
/// [`Camera::check`](super::Camera::check).
///
/// Rotations come from files as `f32`, at most 2^-25 off an element, or with six decimals, at most
/// 5e-7 off. Rows of length 1 whose elements are off by `e` have lengths and products off by
/// `2 sqrt(3) e` at most, 1.7e-6 for six decimals; a chain of six such rotations (scene, dataset
/// and camera transforms of other programs) adds up to 1e-5. In a picture 1000 px wide this is 0.01
/// px.
const RIGID_TOLERANCE: f64 = 1e-5;

/// Largest such difference in files that state what a matrix is: three
/// decimals. Such a matrix is replaced by the nearest rotation.
const FILE_TOLERANCE: f64 = 1e-3;

/// The reason why a matrix is not a rotation, or a pose is not rigid. Rows are numbered from 1.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum PoseFault {
    /// An element is NaN or infinite.
    #[error("it holds the number {0}, which is not finite")]
    NotFinite(f64),
    /// A row is scaled.
    #[error("row {row} has the length {length:.6}, not 1")]
    Scaled {
        /// The row.
        row: usize,
        /// Length of the row.
        length: f64,
    },
    /// Two rows are not perpendicular.
    #[error("rows {} and {} are not perpendicular: their product is {dot:.6}, not 0", rows.0, rows.1)]
    Sheared {
        /// The rows.
        rows: (usize, usize),
        /// Their dot product.
        dot: f64,
    },
    /// The matrix mirrors: its determinant is -1.
    #[error("it mirrors: its determinant is -1, not 1")]
    Mirrored,
    /// The last row of a 4x4 matrix is not that of a rigid transform.
    #[error("its last row is {} {} {} {}, not 0 0 0 1", .0[0], .0[1], .0[2], .0[3])]
    LastRow([f64; 4]),
}

/// Checks that a 4x4 matrix is a rotation with a translation, each element within
/// [`RIGID_TOLERANCE`].
///
/// # Errors
/// [`PoseFault`] says what is wrong with it.
pub(super) fn check_rigid(pose: &DMat4) -> Result<(), PoseFault> {
    if let Some(value) = pose.to_cols_array().into_iter().find(|value| !value.is_finite()) {
        return Err(PoseFault::NotFinite(value));
    }
    let last = pose.row(3).to_array();
    if last.iter().zip([0.0, 0.0, 0.0, 1.0]).any(|(value, exact)| (value - exact).abs() > RIGID_TOLERANCE) {
        return Err(PoseFault::LastRow(last));
    }
    check_rotation(&DMat3::from_mat4(*pose), RIGID_TOLERANCE)
}

/// The rotation that a file gives as a matrix with three decimals or more, exactly orthonormal.
///
/// # Errors
/// [`PoseFault`] if the matrix is further from a rotation than rounding explains.
pub fn rotation_of(matrix: &DMat3) -> Result<DMat3, PoseFault> {
    check_rotation(matrix, FILE_TOLERANCE)?;
    Ok(DMat3::from_quat(DQuat::from_mat3(matrix).normalize()))
}

/// `camera_from_world` of a camera with the rotation `camera_from_world` at `center`, world axes.
pub fn viewmat_at(rotation: DMat3, center: DVec3) -> DMat4 {
    viewmat_of(rotation, -(rotation * center))
}

fn check_rotation(matrix: &DMat3, tolerance: f64) -> Result<(), PoseFault> {
    if let Some(value) = matrix.to_cols_array().into_iter().find(|value| !value.is_finite()) {
        return Err(PoseFault::NotFinite(value));
    }
    let rows = [0, 1, 2].map(|row| matrix.row(row));
    for (row, values) in rows.iter().enumerate() {
        if (values.length_squared() - 1.0).abs() > tolerance {
            return Err(PoseFault::Scaled { row: row + 1, length: values.length() });
        }
    }
    for (a, b) in [(0, 1), (0, 2), (1, 2)] {
        let dot = rows[a].dot(rows[b]);
        if dot.abs() > tolerance {
            return Err(PoseFault::Sheared { rows: (a + 1, b + 1), dot });
        }
    }
    if matrix.determinant() < 0.0 { Err(PoseFault::Mirrored) } else { Ok(()) }
}

/// The 4x4 matrix of a rotation and a translation.
#[must_use]
pub fn viewmat_of(rotation: DMat3, translation: DVec3) -> DMat4 {
    let mut viewmat = DMat4::from_mat3(rotation);
    viewmat.w_axis = translation.extend(1.0);
    viewmat
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::rotation;
    use wm_base::random::uniform;

    #[test]
    fn rotations_of_files_pass_and_faults_are_named() {
        for seed in 0..200 {
            let exact = DMat3::from_quat(rotation(seed, 0));
            let pose = |matrix: DMat3| viewmat_of(matrix, DVec3::new(1e6, -3.0, 0.1));
            let rounded = [exact.as_mat3().as_dmat3(), exact * 1.0];
            let decimals = DMat3::from_cols_array(&exact.to_cols_array().map(|v| (v * 1e6).round() / 1e6));
            for matrix in rounded.into_iter().chain([decimals]) {
                assert_eq!(check_rigid(&pose(matrix)), Ok(()));
            }
            // One element off by a ten-thousandth: its row is too long or too short, or leans.
            let mut off = exact.to_cols_array();
            off[(uniform(seed, 9) * 9.0) as usize] += 1e-4;
            assert!(check_rigid(&pose(DMat3::from_cols_array(&off))).is_err());
            let nearest = rotation_of(&decimals).unwrap();
            assert!(nearest.abs_diff_eq(exact, 1e-6) && check_rigid(&pose(nearest)).is_ok());
        }
        let faults = [
            (DMat3::IDENTITY * 1.01, "row 1 has the length 1.010000, not 1"),
            (DMat3::IDENTITY * 1e200, "row 1 has the length inf, not 1"),
            (
                DMat3::from_cols(DVec3::X, DVec3::new(0.6, 0.8, 0.0), DVec3::Z).transpose(),
                "rows 1 and 2 are not perpendicular: their product is 0.600000, not 0",
            ),
            (DMat3::from_diagonal(DVec3::new(1.0, 1.0, -1.0)), "it mirrors: its determinant is -1, not 1"),
            (DMat3::IDENTITY * f64::NAN, "it holds the number NaN, which is not finite"),
        ];
        for (matrix, says) in faults {
            assert_eq!(check_rigid(&viewmat_of(matrix, DVec3::ZERO)).unwrap_err().to_string(), says);
            assert_eq!(rotation_of(&matrix).unwrap_err().to_string(), says);
        }
        let mut projective = DMat4::IDENTITY;
        projective.x_axis.w = 0.5;
        let says = "its last row is 0.5 0 0 1, not 0 0 0 1";
        assert_eq!(check_rigid(&projective).unwrap_err().to_string(), says);
    }
}
