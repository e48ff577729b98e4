//! Level axes about an up direction, and vectors along them.

use glam::DMat3;

/// Heading 0, a quarter turn clockwise from it seen from above, and `up` itself, all of length 1:
/// the axes of panoramas.
#[must_use]
pub fn level_axes(up: [f64; 3]) -> [[f64; 3]; 3] {
    let mut forward = if up[0].abs() < 0.9 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    let along = dot(forward, up);
    (0..3).for_each(|k| forward[k] -= along * up[k]);
    let length = dot(forward, forward).sqrt();
    let f = forward.map(|v| v / length);
    let right = [f[1] * up[2] - f[2] * up[1], f[2] * up[0] - f[0] * up[2], f[0] * up[1] - f[1] * up[0]];
    [f, right, up]
}

/// The rotation from world to [`level_axes`].
pub(crate) fn level_matrix(up: [f64; 3]) -> DMat3 {
    DMat3::from_cols_array_2d(&level_axes(up)).transpose()
}

/// A vector of world axes along [`level_axes`].
pub(crate) fn to_level(axes: &[[f64; 3]; 3], world: [f64; 3]) -> [f64; 3] {
    axes.map(|axis| dot(axis, world))
}

/// A vector along [`level_axes`] in world axes.
pub(crate) fn from_level(axes: &[[f64; 3]; 3], level: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| (0..3).map(|axis| axes[axis][k] * level[axis]).sum())
}

/// The dot product of two vectors.
pub(crate) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
