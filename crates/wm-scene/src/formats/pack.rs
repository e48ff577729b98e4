//! Packing that several formats share: rounding, quaternions by their smallest three, colours and
//! opacities in bytes.

use crate::{sh, splats::logit};
use std::sync::LazyLock;

/// `value` of `[0, 1]` as a whole number of `0..=most`, rounded; what is outside is moved to the
/// end, NaN to 0.
pub(crate) fn unorm(value: f32, most: u32) -> u32 {
    (value * most as f32 + 0.5).clamp(0.0, most as f32) as u32
}

/// A byte of `low..=high`.
pub(crate) fn ranged(value: f32, low: f32, high: f32, most: u32) -> u32 {
    let width = high - low;
    if width > 0.0 { unorm((value - low) / width, most) } else { 0 }
}

/// Opacity of a byte as a logit, finite: bytes 0 and 255 mean what rounds to them.
pub(crate) fn logit_of_byte(byte: u8) -> f32 {
    static LOGITS: LazyLock<[f32; 256]> = LazyLock::new(|| {
        std::array::from_fn(|i| logit((i as f64 / 255.0).clamp(0.25 / 255.0, 1.0 - 0.25 / 255.0)) as f32)
    });
    LOGITS[usize::from(byte)]
}

/// The byte of an opacity given as a logit.
pub(crate) fn byte_of_logit(logit: f32) -> u8 {
    unorm(1.0 / (1.0 + (-logit).exp()), 255) as u8
}

/// The SH coefficient of degree 0 that shows a byte's colour.
pub(crate) fn dc_of_byte(byte: u8) -> f32 {
    static COLORS: LazyLock<[f32; 256]> =
        LazyLock::new(|| std::array::from_fn(|i| sh::dc_of(i as f64 / 255.0) as f32));
    COLORS[usize::from(byte)]
}

/// The byte of the colour that a coefficient of degree 0 shows.
pub(crate) fn byte_of_dc(dc: f32) -> u8 {
    unorm(0.5 + dc * sh::C0 as f32, 255) as u8
}

/// `q` at length 1; the identity where that cannot be.
pub(crate) fn unit(q: [f32; 4]) -> [f32; 4] {
    let length = q.iter().map(|v| v * v).sum::<f32>().sqrt();
    if length.is_finite() && length > 1e-15 { q.map(|v| v / length) } else { [1.0, 0.0, 0.0, 0.0] }
}

/// Place of the largest component of a unit quaternion, and the others in their order, of the sign
/// that makes the largest positive; each is within `1 / sqrt(2)`.
pub(crate) fn smallest_three(q: [f32; 4]) -> (usize, [f32; 3]) {
    let mut largest = 0;
    for k in 1..4 {
        if q[k].abs() > q[largest].abs() {
            largest = k;
        }
    }
    let sign = if q[largest] < 0.0 { -1.0 } else { 1.0 };
    let mut rest = [0.0; 3];
    let others = (0..4).filter(|k| *k != largest);
    for (slot, k) in rest.iter_mut().zip(others) {
        *slot = q[k] * sign;
    }
    (largest, rest)
}

/// The unit quaternion of its smallest three.
pub(crate) fn from_smallest_three(largest: usize, rest: [f32; 3]) -> [f32; 4] {
    let mut q = [0.0; 4];
    let others = (0..4).filter(|k| *k != largest);
    for (value, k) in rest.iter().zip(others) {
        q[k] = *value;
    }
    q[largest] = (1.0 - rest.iter().map(|v| v * v).sum::<f32>()).max(0.0).sqrt();
    q
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn three_components_give_the_fourth(q in prop::array::uniform4(-1.0..1.0f32)) {
            let q = unit(q);
            let (largest, rest) = smallest_three(q);
            let back = from_smallest_three(largest, rest);
            let dot: f32 = q.iter().zip(back).map(|(a, b)| a * b).sum();
            prop_assert!((dot.abs() - 1.0).abs() < 1e-5, "{q:?} {back:?}");
            prop_assert!(rest.iter().all(|v| v.abs() <= 0.5f32.sqrt() + 1e-6));
        }
    }

    #[test]
    fn bytes_come_back() {
        for byte in 0..=255 {
            assert_eq!(byte_of_logit(logit_of_byte(byte)), byte);
            assert_eq!(byte_of_dc(dc_of_byte(byte)), byte);
        }
        assert_eq!((unorm(f32::NAN, 255), unorm(f32::INFINITY, 255), unorm(-1.0, 255)), (0, 255, 0));
    }
}
