//! Tile lists on the GPU: tiles of 16x16 px. The splats in view come by depth; each counts its
//! tiles, and after prefix sums writes an entry a tile. Sorted by tile, and no further, the entries
//! are the lists.

use crate::gpu::recorder::{Groups, Recorder, with_buffers};
use crate::gpu::source::{StagePrograms, VISIBLE_GROUPS, WORKGROUP, texts};
use crate::stages::prefix_sum::gpu::WORKGROUP_SUMS;
use std::borrow::Cow;

/// The programs of tile lists.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) enum IntersectProgram {
    /// Counts or writes the entries of the tile lists.
    Entries,
    /// Finds the start of each tile's list.
    Ranges,
}

impl StagePrograms for IntersectProgram {
    fn all() -> Vec<Self> {
        vec![Self::Entries, Self::Ranges]
    }

    fn entry(&self) -> &'static str {
        match self {
            Self::Entries => "intersect",
            Self::Ranges => "ranges",
        }
    }

    fn parts(&self) -> Vec<Cow<'static, str>> {
        match self {
            Self::Entries => texts([WORKGROUP_SUMS, include_str!("intersect.wgsl")]),
            Self::Ranges => texts([include_str!("ranges.wgsl")]),
        }
    }
}

/// The buffers that `intersect.wgsl` reads and writes.
pub(crate) struct Intersect<'a> {
    pub(crate) counters: &'a wgpu::Buffer,
    pub(crate) dispatches: &'a wgpu::Buffer,
    pub(crate) records: &'a wgpu::Buffer,
    pub(crate) order: &'a wgpu::Buffer,
    pub(crate) counts: &'a wgpu::Buffer,
    pub(crate) sums: &'a wgpu::Buffer,
    pub(crate) tiles: &'a wgpu::Buffer,
    pub(crate) entries: &'a wgpu::Buffer,
}

impl Intersect<'_> {
    /// Counts or writes, as the structure `Task` in `slot` says.
    pub(crate) fn record(&self, recorder: &mut Recorder<'_>, slot: usize) {
        let bindings = with_buffers(
            vec![(0, recorder.view()), (1, recorder.uniform(slot))],
            [self.counters, self.records, self.order, self.counts, self.sums, self.tiles, self.entries],
        );
        recorder.dispatch(
            IntersectProgram::Entries,
            Groups::Indirect(self.dispatches, VISIBLE_GROUPS),
            bindings,
        );
    }
}

/// Finds where each of `count` tiles' lists begins in the sorted entries.
pub(crate) fn ranges(
    recorder: &mut Recorder<'_>,
    count: u32,
    counters: &wgpu::Buffer,
    tiles: &wgpu::Buffer,
    tile_offsets: &wgpu::Buffer,
) {
    let bindings = with_buffers(vec![(0, recorder.view())], [counters, tiles, tile_offsets]);
    recorder.dispatch(IntersectProgram::Ranges, Groups::Direct((count + 1).div_ceil(WORKGROUP)), bindings);
}
