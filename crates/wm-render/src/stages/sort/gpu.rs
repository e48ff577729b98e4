//! A radix sort on the GPU for keys of 32 bits with a value each, see `sort.wgsl`. It is stable, so
//! splats in the order of their index come out in the order of the contract when they are sorted by
//! depth, and entries in that order come out tile by tile, each tile's by depth, when they are
//! sorted by tile.

use crate::gpu::buffers::Lists;
use crate::gpu::recorder::{Groups, Recorder, with_numbered};
use crate::gpu::source::{DIGIT_BITS, DIGITS, Program};
use crate::stages::prefix_sum::gpu::WORKGROUP_SUMS;
use std::ops::Range;

/// Pairs to sort: keys, values.
pub(crate) type Pairs<'a> = (&'a wgpu::Buffer, &'a wgpu::Buffer);

const SORT: &[&str] = &[WORKGROUP_SUMS, include_str!("sort.wgsl")];
/// Counts each digit in each block of pairs.
pub(crate) const COUNT: Program = Program::new("count", SORT);
/// Makes prefix sums of these counts.
pub(crate) const SCAN: Program = Program::new("scan_digits", SORT);
/// Moves the pairs to their places.
pub(crate) const SCATTER: Program = Program::new("scatter", SORT);

/// Returns the number of passes for keys of `bits` bits.
pub(crate) fn passes(bits: u32) -> u32 {
    bits.div_ceil(DIGIT_BITS)
}

/// Sorts the first of `pairs`; the second are room for as many. `size` is the word of the sizes of
/// dispatches that counts, `slots` are those of the structures `Pass`, one a pass. Returns the
/// sorted pairs: in the first place after an even number of passes, else in the second.
pub(crate) fn sort<'a>(
    recorder: &mut Recorder<'_>,
    lists: &Lists,
    pairs: &'a [[wgpu::Buffer; 2]; 2],
    size: u32,
    slots: Range<usize>,
) -> Pairs<'a> {
    let [mut from, mut to] = pairs.each_ref().map(|[keys, values]| (keys, values));
    let (histogram, totals) = (&lists.histogram, &lists.totals);
    let over = Groups::Indirect(&lists.dispatches, size);
    for slot in slots {
        let base = with_numbered(vec![(0, recorder.uniform(slot))], [(1, &lists.counters), (4, histogram)]);
        recorder.dispatch(COUNT, over, with_numbered(base.clone(), [(2, from.0)]));
        recorder.dispatch(SCAN, Groups::Direct(DIGITS), with_numbered(base.clone(), [(5, totals)]));
        let moved = [(2, from.0), (3, from.1), (5, totals), (6, to.0), (7, to.1)];
        recorder.dispatch(SCATTER, over, with_numbered(base, moved));
        std::mem::swap(&mut from, &mut to);
    }
    from
}
