//! Rotations in eight bits a component, and which axis of an ellipsoid is called which so that they
//! round it best.

use crate::formats::pack::{from_smallest_three, smallest_three, unit, unorm};
use std::f32::consts::{FRAC_1_SQRT_2, SQRT_2};

/// Turns that call axes differently: the quaternion (wxyz) to multiply by, and which axis is then
/// called x, y, z. Half turns about an axis beside them would round alike.
pub(in crate::formats) const NAMINGS: [([f32; 4], [usize; 3]); 6] = [
    ([1.0, 0.0, 0.0, 0.0], [0, 1, 2]),
    ([FRAC_1_SQRT_2, FRAC_1_SQRT_2, 0.0, 0.0], [0, 2, 1]),
    ([FRAC_1_SQRT_2, 0.0, FRAC_1_SQRT_2, 0.0], [2, 1, 0]),
    ([FRAC_1_SQRT_2, 0.0, 0.0, FRAC_1_SQRT_2], [1, 0, 2]),
    ([0.5, 0.5, 0.5, 0.5], [1, 2, 0]),
    ([0.5, -0.5, -0.5, -0.5], [2, 0, 1]),
];

/// Least ratio of an axis to the longest one: thinner axes count as so thick, since the difference
/// is not visible.
const MIN_AXIS_RATIO: f32 = 0.05;

/// The quaternion (wxyz) of which `bytes` are three components and the `largest` is the other.
pub(super) fn from_bytes(largest: usize, bytes: [u8; 3]) -> [f32; 4] {
    from_smallest_three(largest, bytes.map(|byte| (f32::from(byte) / 255.0 - 0.5) * SQRT_2))
}

/// A rotation as a pixel.
#[derive(Clone, Copy)]
pub(super) struct Rounded {
    /// Three components, and 252 and which is the fourth.
    pub(crate) pixel: [u8; 4],
    naming: u8,
}

impl Rounded {
    /// The former axis of each of its axes.
    pub(crate) fn axes(self) -> [usize; 3] {
        NAMINGS[usize::from(self.naming)].1
    }

    /// Chooses the naming of axes whose rounding changes an ellipsoid least.
    ///
    /// A turn by w about an axis shears the ellipsoid across it by w (a / b - b / a), where a and b
    /// are the scales there: between equal ones nothing changes.
    pub(crate) fn best(quat: [f32; 4], log_scale: [f32; 3]) -> Self {
        let quat = unit(quat);
        let longest = log_scale.iter().copied().fold(f32::MIN, f32::max);
        let [x, y, z] = log_scale.map(|v| (v - longest).exp().max(MIN_AXIS_RATIO));
        let counts = [(y, z), (x, z), (x, y)].map(|(a, b)| (a / b - b / a).powi(2));
        let mut best = (f32::INFINITY, Self { pixel: [0; 4], naming: 0 });
        for (naming, (turn, axes)) in NAMINGS.iter().enumerate() {
            let named = product(quat, *turn);
            let (largest, rest) = smallest_three(named);
            let bytes = rest.map(|v| unorm(v * FRAC_1_SQRT_2 + 0.5, 255) as u8);
            let back = from_bytes(largest, bytes);
            // The vector of the small turn between them, half its angle long.
            let [w, x, y, z] = named;
            let [_, off @ ..] = product([w, -x, -y, -z], back);
            let error: f32 = off.iter().zip(axes).map(|(off, axis)| off * off * counts[*axis]).sum();
            if error < best.0 {
                let [p, q, r] = bytes;
                best = (error, Self { pixel: [p, q, r, 252 + largest as u8], naming: naming as u8 });
            }
        }
        best.1
    }
}

/// The Hamilton product of quaternions (wxyz).
pub(in crate::formats) fn product(left: [f32; 4], right: [f32; 4]) -> [f32; 4] {
    let ([a, b, c, d], [w, x, y, z]) = (left, right);
    [
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quat::to_matrix;
    use proptest::prelude::*;

    type Matrix = [[f64; 3]; 3];

    fn covariance(quat: [f32; 4], scales: [f64; 3]) -> Matrix {
        let m = to_matrix(quat.map(f64::from));
        let sum = |i: usize, j: usize| (0..3).map(|k| m[i][k] * m[j][k] * scales[k] * scales[k]).sum();
        std::array::from_fn(|i| std::array::from_fn(|j| sum(i, j)))
    }

    fn max_difference(a: &Matrix, b: &Matrix) -> f64 {
        a.as_flattened().iter().zip(b.as_flattened()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    }

    proptest! {
        #[test]
        fn an_ellipsoid_stays_what_it_is(q in prop::array::uniform4(-1.0..1.0f32), log in prop::array::uniform3(-4.0..0.0f32)) {
            let rounded = Rounded::best(q, log);
            let [a, b, c, largest] = rounded.pixel;
            let back = from_bytes(usize::from(largest - 252), [a, b, c]);
            let scales = log.map(|v| f64::from(v).exp());
            let renamed = rounded.axes().map(|axis| scales[axis]);
            // Half a step of each component is 0.0028 of a quaternion, 0.0096 rad in all, of
            // squares of 1 at most.
            let off = max_difference(&covariance(unit(q), scales), &covariance(back, renamed));
            prop_assert!(off < 0.01, "{off}");
        }
    }

    #[test]
    fn each_naming_is_the_same_ellipsoid() {
        let (quat, scales) = (unit([0.3, -0.5, 0.7, 0.2]), [1.0, 2.0, 3.0]);
        for (turn, axes) in NAMINGS {
            let named = covariance(product(quat, turn), axes.map(|axis| scales[axis]));
            assert!(max_difference(&covariance(quat, scales), &named) < 1e-5, "{axes:?}");
        }
    }

    #[test]
    fn a_choice_of_names_is_worth_it() {
        // Of discs and needles, how far the covariance is off, beside that without a choice.
        let (mut chosen, mut plain) = (0.0, 0.0);
        for i in 0..1000 {
            let angle = i as f32;
            let quat = unit([angle.sin(), (1.7 * angle).cos(), (2.3 * angle).sin(), (0.9 * angle).cos()]);
            let log = if i % 2 == 0 { [0.0, 0.0, -5.0] } else { [0.0, -3.0, -3.0] };
            let scales = log.map(|v: f32| f64::from(v).exp());
            let truth = covariance(quat, scales);
            let best = Rounded::best(quat, log);
            let [a, b, c, largest] = best.pixel;
            let back = from_bytes(usize::from(largest - 252), [a, b, c]);
            chosen += max_difference(&truth, &covariance(back, best.axes().map(|axis| scales[axis])));
            let (largest, rest) = smallest_three(quat);
            let bytes = rest.map(|v| unorm(v * FRAC_1_SQRT_2 + 0.5, 255) as u8);
            plain += max_difference(&truth, &covariance(from_bytes(largest, bytes), scales));
        }
        assert!(chosen < 0.65 * plain, "{chosen} {plain}");
    }
}
