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
