//! Learning on a GPU: splats and moments stay there, and a thread moves a splat.

use crate::gpu::recorder::{Bindings, Groups, Recorder};
use crate::gpu::source::Program;
use crate::stages::project::gpu::Piece;

/// The optimiser's memory of the splats of a piece, see `optimize.wgsl`.
#[derive(Clone, Copy)]
pub(crate) struct Remembered<'a> {
    pub moments: &'a wgpu::Buffer,
    pub sh_moments: &'a wgpu::Buffer,
    /// Of all splats.
    pub known: &'a wgpu::Buffer,
}

/// Rows of gradients, and which splats they are of.
#[derive(Clone, Copy)]
pub(crate) struct Rows<'a> {
    pub gradients: &'a wgpu::Buffer,
    pub by_sh: &'a wgpu::Buffer,
    /// See `pieces.wgsl`.
    pub blocks: &'a wgpu::Buffer,
}

fn of_piece<'a>(piece: &Piece<'a>, blocks: &'a wgpu::Buffer) -> Bindings<'a> {
    vec![(1, piece.uniform.clone()), (4, blocks.as_entire_binding())]
}

/// Moves the splats of a piece that have rows; `step` is the structure `Step`.
pub(crate) fn optimize(
    recorder: &mut Recorder<'_>,
    piece: &Piece<'_>,
    rows: Rows<'_>,
    remembered: Remembered<'_>,
    step: wgpu::BindingResource<'_>,
) {
    let mut bindings = of_piece(piece, rows.blocks);
    bindings.extend([
        (2, piece.splats.as_entire_binding()),
        (3, piece.sh_rest.as_entire_binding()),
        (5, remembered.moments.as_entire_binding()),
        (6, remembered.sh_moments.as_entire_binding()),
        (7, rows.gradients.as_entire_binding()),
        (8, rows.by_sh.as_entire_binding()),
        (9, remembered.known.as_entire_binding()),
        (10, step),
    ]);
    recorder.dispatch(&Program::Optimize, Groups::Direct(piece.blocks), bindings);
}

/// Adds the rows of another render to those of a step, as far as `learn`, the structure `Learn`, says.
pub(crate) fn add(
    recorder: &mut Recorder<'_>,
    piece: &Piece<'_>,
    other: Rows<'_>,
    to: Rows<'_>,
    learn: wgpu::BindingResource<'_>,
) {
    let mut bindings = of_piece(piece, other.blocks);
    bindings.extend([
        (2, to.blocks.as_entire_binding()),
        (5, other.gradients.as_entire_binding()),
        (6, other.by_sh.as_entire_binding()),
        (7, to.gradients.as_entire_binding()),
        (8, to.by_sh.as_entire_binding()),
        (10, learn),
    ]);
    recorder.dispatch(&Program::AddGradients, Groups::Direct(piece.blocks), bindings);
}

/// Moves splats that are nearly transparent at random; `noise` is the structure `Noise`.
pub(crate) fn explore(recorder: &mut Recorder<'_>, piece: &Piece<'_>, noise: wgpu::BindingResource<'_>) {
    let bindings = vec![(1, piece.uniform.clone()), (2, piece.splats.as_entire_binding()), (10, noise)];
    recorder.dispatch(&Program::Explore, Groups::Direct(piece.blocks), bindings);
}
