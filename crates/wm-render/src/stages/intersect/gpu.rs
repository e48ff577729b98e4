//! Tile lists on the GPU: tiles of 16x16 px. The splats in view come by depth; each counts its tiles, and after prefix
//! sums writes an entry a tile. Sorted by tile, and no further, the entries are the lists.

use crate::gpu::recorder::{Groups, Recorder};
use crate::gpu::source::{Program, VISIBLE_GROUPS, WORKGROUP};

/// The buffers that `intersect.wgsl` reads and writes.
pub(crate) struct Intersect<'a> {
    pub counters: &'a wgpu::Buffer,
    pub dispatches: &'a wgpu::Buffer,
    pub records: &'a wgpu::Buffer,
    pub order: &'a wgpu::Buffer,
    pub counts: &'a wgpu::Buffer,
    pub sums: &'a wgpu::Buffer,
    pub tiles: &'a wgpu::Buffer,
    pub entries: &'a wgpu::Buffer,
}

impl Intersect<'_> {
    /// Counts or writes, as the structure `Task` in `slot` says.
    pub fn record(&self, recorder: &mut Recorder<'_>, slot: usize) {
        let bindings = vec![
            (0, recorder.view()),
            (1, recorder.uniform(slot)),
            (2, self.counters.as_entire_binding()),
            (3, self.records.as_entire_binding()),
            (4, self.order.as_entire_binding()),
            (5, self.counts.as_entire_binding()),
            (6, self.sums.as_entire_binding()),
            (7, self.tiles.as_entire_binding()),
            (8, self.entries.as_entire_binding()),
        ];
        recorder.dispatch(&Program::Intersect, Groups::Indirect(self.dispatches, VISIBLE_GROUPS), bindings);
    }
}

/// Finds where each of `count` tiles' lists begins in the sorted entries.
pub(crate) fn ranges(
    recorder: &mut Recorder<'_>,
    count: u32,
    (counters, tiles): (&wgpu::Buffer, &wgpu::Buffer),
    tile_offsets: &wgpu::Buffer,
) {
    let bindings = vec![
        (0, recorder.view()),
        (1, counters.as_entire_binding()),
        (2, tiles.as_entire_binding()),
        (3, tile_offsets.as_entire_binding()),
    ];
    recorder.dispatch(&Program::Ranges, Groups::Direct((count + 1).div_ceil(WORKGROUP)), bindings);
}
