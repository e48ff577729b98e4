//! The derivative of blending on the GPU: a workgroup per tile. Each pair of splat and tile has its
//! own slot, whose number the tile lists carry through their sort.

use crate::differentiable::Channels;
use crate::gpu::buffers::Room;
use crate::gpu::recorder::{Groups, Recorder, with_buffers};
use crate::gpu::source::{Program, Subgroups, TRAINING, WORKGROUP, switches};

/// Turns derivatives by pictures into derivatives by sums.
pub(crate) fn by_sums_program(channels: Channels) -> Program {
    Program::new("by_sums", &[TRAINING, include_str!("upstream.wgsl")]).with(switches(channels))
}

/// Derives by each splat of a tile.
pub(crate) fn backward_program(channels: Channels, subgroups: Subgroups) -> Program {
    let sums = match subgroups {
        Subgroups::Used => include_str!("subgroups.wgsl"),
        Subgroups::Unused => include_str!("shared.wgsl"),
    };
    let program = Program::new("rasterize_backward", &[include_str!("rasterize_backward.wgsl")]);
    program.with(switches(channels)).with(sums)
}

/// Turns the derivatives by the pictures to those by the sums, see `upstream.wgsl`; `training` is
/// the structure of that name.
pub(crate) fn by_sums(
    recorder: &mut Recorder<'_>,
    pixels: u32,
    channels: Channels,
    training: wgpu::BindingResource<'_>,
    room: &Room,
    upstream: &wgpu::Buffer,
    states: &wgpu::Buffer,
) {
    let bindings = with_buffers(
        vec![(0, recorder.view()), (1, training)],
        [&room.rgb, &room.alpha, &room.depths, &room.normal, upstream, states],
    );
    recorder.dispatch(by_sums_program(channels), Groups::Direct(pixels.div_ceil(WORKGROUP)), bindings);
}

/// Sums what the pixels of all tiles pull. `pairs` has the pair of each entry, `names` the record
/// of each pair.
#[allow(clippy::too_many_arguments, reason = "one caller; a struct would only repeat the names")]
pub(crate) fn rasterize_backward(
    recorder: &mut Recorder<'_>,
    tiles: u32,
    channels: Channels,
    room: &Room,
    pairs: &wgpu::Buffer,
    names: &wgpu::Buffer,
    states: &wgpu::Buffer,
    slots: &wgpu::Buffer,
) {
    let bindings = with_buffers(
        vec![(0, recorder.view())],
        [&room.lists.offsets, pairs, names, &room.records, states, slots],
    );
    let program = backward_program(channels, recorder.subgroups());
    recorder.dispatch(program, Groups::Direct(tiles), bindings);
}
