//! Blending on the GPU: a workgroup per tile of 16x16 px, a thread per pixel.

use crate::config::{Geometry, MedianDepth};
use crate::differentiable::Channels;
use crate::frame::FRONT_CHANNELS;
use crate::gpu::buffers::Room;
use crate::gpu::recorder::{Groups, Recorder, with_buffers};
use crate::gpu::source::{Program, switches};
use crate::hooks::GROUP;
use crate::renderer::WEIGHT_UNITS;

/// Pictures of depths before that of the surface in the buffer of depths: expected and median
/// depth. The sums of [`crate::Frame::front`] follow the surface.
pub(crate) const SURFACE_PLANE: u64 = 2;

/// Blends colour and the outputs beside it, and what is in front of a surface if it is split there.
pub(crate) fn frame_program(geometry: Geometry, median: MedianDepth, is_split: bool) -> Program {
    let channels = match geometry {
        Geometry::None => Channels::Color,
        Geometry::Depth => Channels::ColorDepth,
        Geometry::DepthNormal => Channels::ColorDepthNormal,
    };
    let constants = constants(false, median == MedianDepth::On, is_split);
    let program = Program::new("rasterize", &[include_str!("records.wgsl"), BLENDING]);
    program.with(switches(channels)).with(constants)
}

/// Blends the sums of a step of training, and keeps them.
pub(crate) fn sums_program(channels: Channels) -> Program {
    let program = Program::new("rasterize", &[include_str!("pairs.wgsl"), BLENDING]);
    program.with(switches(channels)).with(constants(true, false, false))
}

/// Sums the weights of each record, and blends nothing.
pub(crate) fn weights_program() -> Program {
    let program = Program::new("weigh", &[include_str!("weigh.wgsl")]);
    program.with(switches(Channels::Depth)).with(format!("const WEIGHT_UNITS = {WEIGHT_UNITS:?};"))
}

const BLENDING: &str = include_str!("rasterize.wgsl");

fn constants(keeps_sums: bool, is_median: bool, is_split: bool) -> String {
    format!(
        "const KEEPS_SUMS = {keeps_sums};\nconst MEDIAN = {is_median};\nconst SPLIT = {is_split};\n\
         const SURFACE_PLANE = {SURFACE_PLANE}u;\nconst FRONT_CHANNELS = {FRONT_CHANNELS}u;\nconst FRONT_GROUP = {GROUP}u;"
    )
}

/// Blends all tiles by a program. The `entries` of a frame name records, and `last` are the
/// counters, which learn how many were walked; those of a step of training name pairs, and `last`
/// has the record of each. Pictures that are not wanted are not written, and may be small.
pub(crate) fn rasterize(
    recorder: &mut Recorder<'_>,
    tiles: u32,
    program: Program,
    room: &Room,
    entries: &wgpu::Buffer,
    last: &wgpu::Buffer,
) {
    let Room { records, rgb, alpha, depths, normal, lists, .. } = room;
    let buffers = [&lists.offsets, entries, records, rgb, alpha, depths, normal, last];
    recorder.dispatch(program, Groups::Direct(tiles), with_buffers(vec![(0, recorder.view())], buffers));
}

/// Adds the weights of the records to the counts of the lists, one per record, in [`WEIGHT_UNITS`].
pub(crate) fn weigh(recorder: &mut Recorder<'_>, tiles: u32, room: &Room, entries: &wgpu::Buffer) {
    let buffers = [&room.lists.offsets, entries, &room.records, &room.lists.counts];
    let bindings = with_buffers(vec![(0, recorder.view())], buffers);
    recorder.dispatch(weights_program(), Groups::Direct(tiles), bindings);
}
