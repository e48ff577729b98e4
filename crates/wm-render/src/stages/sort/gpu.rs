//! A radix sort on the GPU for keys of 32 bits with a value each, see `sort.wgsl`. It is stable, so
//! splats in the order of their index come out in the order of the contract when they are sorted by
//! depth, and entries in that order come out tile by tile, each tile's by depth, when they are
//! sorted by tile.

use crate::gpu::recorder::{Groups, Recorder};
use crate::gpu::source::{DIGIT_BITS, DIGITS, StagePrograms, texts};
use crate::stages::prefix_sum::gpu::WORKGROUP_SUMS;
use std::borrow::Cow;

/// Pairs to sort: keys, values.
pub(crate) type Pairs<'a> = (&'a wgpu::Buffer, &'a wgpu::Buffer);

/// The programs of the sort.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) enum SortProgram {
    /// Counts each digit in each block of pairs.
    Count,
    /// Makes prefix sums of these counts.
    Scan,
    /// Moves the pairs to their places.
    Scatter,
}

impl StagePrograms for SortProgram {
    fn all() -> Vec<Self> {
        vec![Self::Count, Self::Scan, Self::Scatter]
    }

    fn entry(&self) -> &'static str {
        match self {
            Self::Count => "count",
            Self::Scan => "scan_digits",
            Self::Scatter => "scatter",
        }
    }

    fn parts(&self) -> Vec<Cow<'static, str>> {
        texts([WORKGROUP_SUMS, include_str!("sort.wgsl")])
    }
}

/// The buffers of a sort.
pub(crate) struct Sort<'a> {
    /// The pairs, and room for as many.
    pub(crate) pairs: [Pairs<'a>; 2],
    /// Their number.
    pub(crate) counters: &'a wgpu::Buffer,
    /// The sizes of the dispatches.
    pub(crate) dispatches: &'a wgpu::Buffer,
    /// The word of them that counts.
    pub(crate) size: u32,
    /// Room for the counts of digits.
    pub(crate) histogram: &'a wgpu::Buffer,
    /// Room for 256 totals.
    pub(crate) totals: &'a wgpu::Buffer,
}

/// Returns the number of passes for keys of `bits` bits.
pub(crate) fn passes(bits: u32) -> u32 {
    bits.div_ceil(DIGIT_BITS)
}

impl<'a> Sort<'a> {
    /// Sorts; `slots` are those of the structures `Pass`, one a pass. Returns the sorted pairs: in
    /// the first place after an even number of passes, else in the second.
    pub(crate) fn record(self, recorder: &mut Recorder<'_>, slots: std::ops::Range<usize>) -> Pairs<'a> {
        let [mut from, mut to] = self.pairs;
        for slot in slots {
            let base = vec![
                (0, recorder.uniform(slot)),
                (1, self.counters.as_entire_binding()),
                (4, self.histogram.as_entire_binding()),
            ];
            let over = Groups::Indirect(self.dispatches, self.size);
            let mut count = base.clone();
            count.push((2, from.0.as_entire_binding()));
            recorder.dispatch(SortProgram::Count, over, count);

            let mut scan = base.clone();
            scan.push((5, self.totals.as_entire_binding()));
            recorder.dispatch(SortProgram::Scan, Groups::Direct(DIGITS), scan);

            let mut scatter = base;
            scatter.extend([
                (2, from.0.as_entire_binding()),
                (3, from.1.as_entire_binding()),
                (5, self.totals.as_entire_binding()),
                (6, to.0.as_entire_binding()),
                (7, to.1.as_entire_binding()),
            ]);
            recorder.dispatch(SortProgram::Scatter, over, scatter);
            std::mem::swap(&mut from, &mut to);
        }
        from
    }
}
