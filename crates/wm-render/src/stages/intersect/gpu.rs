//! Tile lists on the GPU: tiles of 16x16 px. The splats in view come by depth; each counts its
//! tiles, and after prefix sums writes an entry per tile. Sorted by tile, and no further, the
//! entries are the lists.

use crate::gpu::buffers::{Lists, Room};
use crate::gpu::recorder::{Groups, Recorder, with_buffers};
use crate::gpu::source::{Program, VISIBLE_GROUPS, WORKGROUP};
use crate::stages::prefix_sum::gpu::WORKGROUP_SUMS;

/// Counts or writes the entries of the tile lists.
pub(crate) const INTERSECT: Program =
    Program::new("intersect", &[WORKGROUP_SUMS, include_str!("intersect.wgsl")]);
/// Finds the start of each tile's list.
pub(crate) const RANGES: Program = Program::new("ranges", &[include_str!("ranges.wgsl")]);

/// Counts or writes, as the structure `Task` in `slot` says.
pub(crate) fn intersect(
    recorder: &mut Recorder<'_>,
    slot: usize,
    room: &Room,
    order: &wgpu::Buffer,
    entries: &wgpu::Buffer,
) {
    let Lists { counters, dispatches, counts, sums, entry_pairs, .. } = &room.lists;
    let bindings = with_buffers(
        vec![(0, recorder.view()), (1, recorder.uniform(slot))],
        [counters, &room.records, order, counts, sums, &entry_pairs[0][0], entries],
    );
    recorder.dispatch(INTERSECT, Groups::Indirect(dispatches, VISIBLE_GROUPS), bindings);
}

/// Finds where each of `count` lists begins in the sorted entries.
pub(crate) fn ranges(recorder: &mut Recorder<'_>, count: u32, lists: &Lists, tiles: &wgpu::Buffer) {
    let bindings = with_buffers(vec![(0, recorder.view())], [&lists.counters, tiles, &lists.offsets]);
    recorder.dispatch(RANGES, Groups::Direct((count + 1).div_ceil(WORKGROUP)), bindings);
}
