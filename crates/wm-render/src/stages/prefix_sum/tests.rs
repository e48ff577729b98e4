use crate::gpu::probe::scanned;
use crate::testing::{Backend, gpu_renderer, uniform};

#[test]
fn sums_are_those_before_and_the_total_is_cut_off_at_the_room() {
    let Some(_) = Backend::gpu() else { return };
    let renderer = gpu_renderer();
    for count in [0u64, 1, 255, 256, 257, 3000] {
        let sums: Vec<u32> = (0..count).map(|i| (1000.0 * uniform(count, i)) as u32).collect();
        let mut total = 0;
        let want: Vec<u32> = sums
            .iter()
            .map(|sum| {
                total += sum;
                total - sum
            })
            .collect();
        let (got, counts) = scanned(&renderer.gpu, &sums, 10_000);
        assert!(got == want && counts == [total.min(10_000), total], "{count}: {counts:?}, want {total}");
    }
}

#[test]
fn what_is_more_than_a_word_holds_is_no_small_number() {
    let Some(_) = Backend::gpu() else { return };
    let renderer = gpu_renderer();
    for sums in [vec![1 << 23; 1000], vec![1 << 25, 3, 4]] {
        let (_, counts) = scanned(&renderer.gpu, &sums, 10_000);
        assert_eq!(counts, [10_000, u32::MAX]);
    }
}
