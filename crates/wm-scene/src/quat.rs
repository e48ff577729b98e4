//! Unit quaternions in `wxyz` order, as 3DGS files store them.

/// The rotation matrix of `quat`, row by row: `matrix[row][column]`.
///
/// `quat` is normalised first; a zero quaternion gives the identity, as the reference 3DGS does not
/// define it and a NaN would spread through a whole picture.
#[must_use]
pub fn to_matrix(quat: [f64; 4]) -> [[f64; 3]; 3] {
    let [w, x, y, z] = normalize(quat);
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

/// `quat` at length 1; the identity where the length is zero or not finite.
#[must_use]
pub fn normalize(quat: [f64; 4]) -> [f64; 4] {
    let length = quat.iter().map(|v| v * v).sum::<f64>().sqrt();
    if length.is_finite() && length > 1e-20 { quat.map(|v| v / length) } else { [1.0, 0.0, 0.0, 0.0] }
}

/// The quaternion that turns the z axis onto the unit vector `normal`, by the shortest way.
#[must_use]
pub fn from_z_to(normal: [f64; 3]) -> [f64; 4] {
    let [x, y, z] = normal;
    if z < -0.999_999 {
        return [0.0, 1.0, 0.0, 0.0];
    }
    normalize([1.0 + z, -y, x, 0.0])
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn matrices_are_rotations(q in prop::array::uniform4(-3.0..3.0f64)) {
            let m = to_matrix(q);
            for i in 0..3 {
                for j in 0..3 {
                    let dot: f64 = (0..3).map(|k| m[i][k] * m[j][k]).sum();
                    prop_assert!((dot - f64::from(u8::from(i == j))).abs() < 1e-12);
                }
            }
        }

        #[test]
        fn z_is_turned_onto_the_normal(v in prop::array::uniform3(-1.0..1.0f64)) {
            let length = v.iter().map(|a| a * a).sum::<f64>().sqrt();
            prop_assume!(length > 0.1);
            let normal = v.map(|a| a / length);
            let m = to_matrix(from_z_to(normal));
            for i in 0..3 {
                prop_assert!((m[i][2] - normal[i]).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn a_zero_quaternion_is_the_identity() {
        assert_eq!(to_matrix([0.0; 4]), to_matrix([1.0, 0.0, 0.0, 0.0]));
    }
}
