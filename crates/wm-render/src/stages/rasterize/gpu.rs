//! Blending on the GPU: a workgroup a tile of 16x16 px, a thread a pixel.

use crate::differentiable::Channels;
use crate::gpu::recorder::{Groups, Recorder};
use crate::gpu::source::Program;
use crate::renderer::{Geometry, MedianDepth};

/// The buffers that `rasterize.wgsl` reads and writes. Pictures that are not wanted are not written, and may be small.
pub(crate) struct Rasterize<'a> {
    pub tile_offsets: &'a wgpu::Buffer,
    pub entries: &'a wgpu::Buffer,
    pub records: &'a wgpu::Buffer,
    pub rgb: &'a wgpu::Buffer,
    pub alpha: &'a wgpu::Buffer,
    pub depths: &'a wgpu::Buffer,
    pub normal: &'a wgpu::Buffer,
}

impl Rasterize<'_> {
    /// Blends all tiles, whose entries name records; `counters` learn how many were walked.
    pub fn record(
        &self,
        recorder: &mut Recorder<'_>,
        tiles: u32,
        (geometry, median): (Geometry, MedianDepth),
        counters: &wgpu::Buffer,
    ) {
        self.dispatch(recorder, tiles, &Program::Rasterize(geometry, median), counters);
    }

    /// Blends the sums of a step of training. Entries name pairs, and `names` has the record of each.
    pub fn record_sums(
        &self,
        recorder: &mut Recorder<'_>,
        tiles: u32,
        channels: Channels,
        names: &wgpu::Buffer,
    ) {
        self.dispatch(recorder, tiles, &Program::BlendSums(channels), names);
    }

    fn dispatch(&self, recorder: &mut Recorder<'_>, tiles: u32, program: &Program, last: &wgpu::Buffer) {
        let bindings = vec![
            (0, recorder.view()),
            (1, self.tile_offsets.as_entire_binding()),
            (2, self.entries.as_entire_binding()),
            (3, self.records.as_entire_binding()),
            (4, self.rgb.as_entire_binding()),
            (5, self.alpha.as_entire_binding()),
            (6, self.depths.as_entire_binding()),
            (7, self.normal.as_entire_binding()),
            (8, last.as_entire_binding()),
        ];
        recorder.dispatch(program, Groups::Direct(tiles), bindings);
    }
}
