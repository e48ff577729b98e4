use super::cpu::sort;
use proptest::prelude::*;

proptest! {
    #[test]
    fn any_list_is_sorted(mut keys in prop::collection::vec(any::<u64>(), 0..400)) {
        let mut want = keys.clone();
        want.sort_unstable();
        sort(&mut keys, &mut Vec::new());
        prop_assert_eq!(keys, want);
    }

    /// Depths as scenes have them: few bits differ, many ties.
    #[test]
    fn near_ties_are_sorted_by_index(depths in prop::collection::vec(0u32..50, 0..400), spread in 0u32..20) {
        let mut keys: Vec<u64> = depths
            .iter()
            .enumerate()
            .map(|(i, d)| u64::from(0x4100_0000 + (d << spread)) << 32 | (depths.len() - i) as u64)
            .collect();
        let mut want = keys.clone();
        want.sort_unstable();
        sort(&mut keys, &mut Vec::new());
        prop_assert_eq!(keys, want);
    }
}

/// The GPU's sort by keys of any bits: as a stable sort, for no pair and for those that end in the
/// middle of a block.
#[cfg(feature = "gpu")]
#[test]
fn the_gpu_sorts_and_keeps_the_order_of_equal_keys() {
    let Some(_) = crate::testing::Backend::gpu() else { return };
    let renderer = crate::testing::gpu_renderer();
    for (count, bits, spread) in [
        (0, 32, 0),
        (1, 32, 0),
        (2047, 32, 3),
        (2049, 12, 0),
        (20_000, 32, 17),
        (30_000, 13, 5),
        (9_000, 24, 31),
    ] {
        let mut keys: Vec<u32> = (0..count)
            .map(|i: u64| (crate::testing::uniform(count, i) * 4_294_967_296.0) as u32 >> spread)
            .collect();
        if bits < 32 {
            keys.iter_mut().for_each(|key| *key &= (1 << bits) - 1);
        }
        let mut want: Vec<(u32, u32)> = keys.iter().copied().zip(0..).collect();
        want.sort_by_key(|(key, _)| *key);
        let (keys, values) = crate::gpu::probe::sorted(&renderer.gpu, &keys, bits);
        let got: Vec<(u32, u32)> = keys.into_iter().zip(values).collect();
        assert!(got == want, "{count} keys of {bits} bits");
    }
}
