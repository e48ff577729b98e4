//! Gradients on the GPU: the slots of each splat are added in the order of its tiles, and derived
//! by a thread a splat, with the colours ([`shade_backward`](crate::stages::shade_backward)) in the
//! same program.

use crate::differentiable::Channels;
use crate::gpu::buffers::{Lists, Room};
use crate::gpu::recorder::{Groups, Recorder, with_buffers, with_numbered};
use crate::gpu::source::{COLOR, Program, VISIBLE_GROUPS, switches};
use crate::stages::optimize::gpu::Rows;
use crate::stages::project::gpu::{GEOMETRY, PIECES, ParameterForm, Piece};
use crate::stages::shade::gpu::{PHOTO_AIR, SHADE};

/// Numbers of a splat in view, see `project_backward.wgsl`.
pub(crate) const ROW: u32 = 18;
/// By the mean, three.
pub(crate) const MEAN: u32 = 0;
/// By the stored quaternion, four.
pub(crate) const QUAT: u32 = 3;
/// By the logarithms of the scales, three.
pub(crate) const SCALE: u32 = 7;
/// By the logit of the opacity.
pub(crate) const OPACITY: u32 = 10;
/// By the centre in the picture, px, two.
pub(crate) const MEAN2D: u32 = 11;
/// Sums of the absolute values of the pixels' derivatives by the centre, two.
pub(crate) const ABSGRAD: u32 = 13;
/// Sum of weights, px.
pub(crate) const WEIGHT: u32 = 15;
/// Three standard deviations along the longest axis, px.
pub(crate) const RADIUS: u32 = 16;
/// Index of the splat, as bits.
pub(crate) const INDEX: u32 = 17;

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
