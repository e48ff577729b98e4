//! The lanes of vectors one by one, in memory.

use fearless_simd::{SimdBase, SimdFloat};
use wm_render::simd::Lanes;

/// 2^23: a whole number below it stands in the low mantissa bits of its sum with it.
pub(crate) const TWO_23: f32 = 8_388_608.0;

/// The lanes whose bits are set, from the lowest.
pub(crate) struct SetLanes(pub u32);

impl Iterator for SetLanes {
    type Item = usize;

    #[inline(always)]
    fn next(&mut self) -> Option<usize> {
        let lane = (self.0.trailing_zeros() & 15) as usize;
        let is_set = self.0 != 0;
        self.0 &= self.0.wrapping_sub(1);
        is_set.then_some(lane)
    }
}

/// A vector's lanes in memory.
pub(crate) struct LaneArray(pub [f32; 16]);

impl LaneArray {
    #[inline(always)]
    pub(crate) fn new<S: Lanes>(_: S, vector: S::F) -> Self {
        let mut kept = [0.0; 16];
        vector.store_slice(&mut kept[..S::N]);
        Self(kept)
    }
}

/// Whole numbers at or above 0 and below 2^23, of a vector's lanes, in memory.
pub(crate) struct LaneIndices(pub [u32; 16]);

impl LaneIndices {
    #[inline(always)]
    pub(crate) fn new<S: Lanes>(simd: S, vector: S::F) -> Self {
        let mut kept = [0; 16];
        let bits = (vector + TWO_23).to_bits() & S::U::splat(simd, 0x007f_ffff);
        bits.store_slice(&mut kept[..S::N]);
        Self(kept)
    }
}
