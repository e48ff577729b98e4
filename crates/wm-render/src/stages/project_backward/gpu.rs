//! Gradients on the GPU: the slots of each splat are added in the order of its tiles, and derived
//! by a thread per splat, with the colours ([`shade_backward`](crate::stages::shade_backward)) in
//! the same program.

use crate::differentiable::Channels;
use crate::gpu::buffers::{Lists, Room};
use crate::gpu::recorder::{Groups, Recorder, with_buffers, with_numbered};
use crate::gpu::source::{COLOR, Program, VISIBLE_GROUPS, switches};
use crate::stages::optimize::gpu::Rows;
use crate::stages::project::gpu::{GEOMETRY, PIECES, ParameterForm, Piece};
use crate::stages::shade::gpu::{PHOTO_AIR, SHADE};

/// The text that derives the shading of one splat.
const SHADE_BACKWARD: &str = include_str!("../shade_backward/shade_backward.wgsl");

/// Adds up the derivatives of all tiles.
pub(crate) const GATHER: Program = Program::new("gather", &[include_str!("gather.wgsl")]);

/// Turns them into gradients by the stored parameters.
pub(crate) fn backward_program(channels: Channels) -> Program {
    const OWN: &str = include_str!("project_backward.wgsl");
    let texts = &[PIECES, GEOMETRY, SHADE, COLOR, PHOTO_AIR, SHADE_BACKWARD, OWN];
    Program::new("project_backward", texts).with(switches(channels)).with(ParameterForm::Stored.text())
}

/// Adds the slots of all splats in view. The counts of the lists are those after entries were
/// written: the ends of the slots.
pub(crate) fn gather(
    recorder: &mut Recorder<'_>,
    lists: &Lists,
    order: &wgpu::Buffer,
    slots: &wgpu::Buffer,
    pulls: &wgpu::Buffer,
) {
    let bindings = with_buffers(vec![], [&lists.counters, order, &lists.counts, slots, pulls]);
    recorder.dispatch(GATHER, Groups::Indirect(&lists.dispatches, VISIBLE_GROUPS), bindings);
}

/// Derives the splats of one piece, and writes their rows.
pub(crate) fn project_backward(
    recorder: &mut Recorder<'_>,
    piece: &Piece<'_>,
    channels: Channels,
    room: &Room,
    pulls: &wgpu::Buffer,
    rows: Rows<'_>,
) {
    let own = [(5, piece.sh_rest), (6, &room.records), (7, pulls), (8, rows.gradients), (9, rows.by_sh)];
    let bindings = with_numbered(piece.bindings(recorder, &room.lists.blocks), own);
    recorder.dispatch(backward_program(channels), Groups::Direct(piece.blocks), bindings);
}
