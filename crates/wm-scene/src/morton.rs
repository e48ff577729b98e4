//! Morton curves: numbers of cells such that neighbours in space are mostly neighbours in number.

use crate::values::ends;

/// The number of a cell: the bits of its three coordinates, 21 of each, x lowest.
#[must_use]
pub fn code(cell: [u64; 3]) -> u64 {
    spread(cell[0]) | spread(cell[1]) << 1 | spread(cell[2]) << 2
}

/// Puts two zero bits between the 21 low bits of `x`.
fn spread(x: u64) -> u64 {
    let x = x & 0x001f_ffff;
    let x = (x | x << 32) & 0x001f_0000_0000_ffff;
    let x = (x | x << 16) & 0x001f_0000_ff00_00ff;
    let x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
    let x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
    (x | x << 2) & 0x1249_2492_4924_9249
}

/// Cells along an axis of [`order`], less one.
const MAX_CELL: f32 = ((1 << 20) - 1) as f32;

/// Indices of splats along a Morton curve through their means: neighbours in space become
/// neighbours in the file. Means that are NaN come last.
pub(crate) fn order(means: &[[f32; 3]]) -> Vec<u32> {
    let is_finite = |mean: &[f32; 3]| mean.iter().all(|v| v.is_finite());
    let [low, high] = ends(means.iter().copied().filter(is_finite));
    let key = |mean: &[f32; 3]| {
        if !is_finite(mean) {
            return u64::MAX;
        }
        let cell: [u64; 3] = std::array::from_fn(|k| {
            // Logarithmic about the middle, so that a sky shell does not put all that is near into
            // one cell.
            let middle = 0.5 * low[k] + 0.5 * high[k];
            let (value, end) = (mean[k] - middle, (high[k] - middle).max(f32::MIN_POSITIVE));
            let curved = value.signum() * (1.0 + value.abs()).ln() / (1.0 + end).ln().max(f32::MIN_POSITIVE);
            ((curved + 1.0) * 0.5 * MAX_CELL).clamp(0.0, MAX_CELL) as u64
        });
        code(cell)
    };
    sorted(means.iter().map(key))
}

/// Indices of splats by their numbers on a curve, of equals in their order.
pub(crate) fn sorted(codes: impl Iterator<Item = u64>) -> Vec<u32> {
    let mut keyed: Vec<(u64, u32)> = codes.zip(0..).collect();
    keyed.sort_unstable();
    keyed.into_iter().map(|(_, index)| index).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn an_order_is_a_permutation(means in prop::collection::vec(prop::array::uniform3(prop::num::f32::ANY), 0..50)) {
            let mut order = order(&means);
            order.sort_unstable();
            prop_assert_eq!(order, (0..means.len() as u32).collect::<Vec<_>>());
        }
    }

    #[test]
    fn bits_are_interleaved() {
        assert_eq!(code([1, 0, 0]) | code([0, 1, 0]) << 3, 0b10_001);
        assert_eq!(code([(1 << 21) - 1; 3]), (1 << 63) - 1);
    }
}
