//! Learning on a GPU: splats and moments stay there, and a thread moves a splat.

use crate::gpu::recorder::{Groups, Recorder, with_numbered};
use crate::gpu::source::Program;
use crate::stages::project::gpu::{PIECES, Piece};

/// Moves splats along their gradients.
pub(crate) const OPTIMIZE: Program = Program::new("optimize", &[PIECES, include_str!("optimize.wgsl")]);
/// Adds the gradients of another render to those of a step.
pub(crate) const ADD_GRADIENTS: Program = Program::new("add_gradients", &[PIECES, include_str!("add.wgsl")]);
/// Moves nearly transparent splats at random.
pub(crate) const EXPLORE: Program = Program::new("explore", &[PIECES, include_str!("explore.wgsl")]);
/// Moves the optimiser's memory to where splats are now.
pub(crate) const REARRANGE: Program = Program::new("rearrange", &[include_str!("rearrange.wgsl")]);

/// The optimiser's memory of the splats of a piece, see `optimize.wgsl`.
#[derive(Clone, Copy)]
pub(crate) struct Remembered<'a> {
    pub(crate) moments: &'a wgpu::Buffer,
    pub(crate) sh_moments: &'a wgpu::Buffer,
    /// Step counters and statistics of all splats.
    pub(crate) known: &'a wgpu::Buffer,
}

/// Rows of gradients, and which splats they are of.
#[derive(Clone, Copy)]
pub(crate) struct Rows<'a> {
    pub(crate) gradients: &'a wgpu::Buffer,
    pub(crate) by_sh: &'a wgpu::Buffer,
    /// See `pieces.wgsl`.
    pub(crate) blocks: &'a wgpu::Buffer,
}

/// Moves the splats of a piece that have rows; `step` is the structure `Step`.
pub(crate) fn optimize(
    recorder: &mut Recorder<'_>,
    piece: &Piece<'_>,
    rows: Rows<'_>,
    remembered: Remembered<'_>,
    step: wgpu::BindingResource<'_>,
) {
    let Remembered { moments, sh_moments, known } = remembered;
    let Rows { gradients, by_sh, blocks } = rows;
    let first = with_numbered(vec![(1, piece.uniform.clone()), (10, step)], [(2, piece.splats)]);
    let own = with_numbered(first, [(3, piece.sh_rest), (4, blocks), (5, moments), (6, sh_moments)]);
    let bindings = with_numbered(own, [(7, gradients), (8, by_sh), (9, known)]);
    recorder.dispatch(OPTIMIZE, Groups::Direct(piece.blocks), bindings);
}

/// Adds the rows of another render to those of a step, as far as `learn`, the structure `Learn`,
/// says.
pub(crate) fn add(
    recorder: &mut Recorder<'_>,
    piece: &Piece<'_>,
    other: Rows<'_>,
    to: Rows<'_>,
    learn: wgpu::BindingResource<'_>,
) {
    let first = vec![(1, piece.uniform.clone()), (10, learn)];
    let read = [(2, to.blocks), (4, other.blocks), (5, other.gradients), (6, other.by_sh)];
    let bindings = with_numbered(with_numbered(first, read), [(7, to.gradients), (8, to.by_sh)]);
    recorder.dispatch(ADD_GRADIENTS, Groups::Direct(piece.blocks), bindings);
}

/// Moves splats that are nearly transparent at random; `noise` is the structure `Noise`.
pub(crate) fn explore(recorder: &mut Recorder<'_>, piece: &Piece<'_>, noise: wgpu::BindingResource<'_>) {
    let bindings = with_numbered(vec![(1, piece.uniform.clone()), (10, noise)], [(2, piece.splats)]);
    recorder.dispatch(EXPLORE, Groups::Direct(piece.blocks), bindings);
}
