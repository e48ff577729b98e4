//! Learning on a GPU: splats and moments stay there, and a thread moves a splat.

use crate::gpu::recorder::{Bindings, Groups, Recorder};
use crate::gpu::source::{StagePrograms, texts};
use crate::stages::project::gpu::{PIECES, Piece};
use std::borrow::Cow;

/// The programs of the optimiser.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) enum OptimizeProgram {
    /// Moves splats along their gradients.
    Optimize,
    /// Adds the gradients of another render to those of a step.
    AddGradients,
    /// Moves nearly transparent splats at random.
    Explore,
    /// Moves the optimiser's memory to where splats are now.
    Rearrange,
}

impl StagePrograms for OptimizeProgram {
    fn all() -> Vec<Self> {
        vec![Self::Optimize, Self::AddGradients, Self::Explore, Self::Rearrange]
    }

    fn entry(&self) -> &'static str {
        match self {
            Self::Optimize => "optimize",
            Self::AddGradients => "add_gradients",
            Self::Explore => "explore",
            Self::Rearrange => "rearrange",
        }
    }

    fn parts(&self) -> Vec<Cow<'static, str>> {
        match self {
            Self::Optimize => texts([PIECES, include_str!("optimize.wgsl")]),
            Self::AddGradients => texts([PIECES, include_str!("add.wgsl")]),
            Self::Explore => texts([PIECES, include_str!("explore.wgsl")]),
            Self::Rearrange => texts([include_str!("rearrange.wgsl")]),
        }
    }
}

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
    recorder.dispatch(OptimizeProgram::Optimize, Groups::Direct(piece.blocks), bindings);
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
    let mut bindings = of_piece(piece, other.blocks);
    bindings.extend([
        (2, to.blocks.as_entire_binding()),
        (5, other.gradients.as_entire_binding()),
        (6, other.by_sh.as_entire_binding()),
        (7, to.gradients.as_entire_binding()),
        (8, to.by_sh.as_entire_binding()),
        (10, learn),
    ]);
    recorder.dispatch(OptimizeProgram::AddGradients, Groups::Direct(piece.blocks), bindings);
}

/// Moves splats that are nearly transparent at random; `noise` is the structure `Noise`.
pub(crate) fn explore(recorder: &mut Recorder<'_>, piece: &Piece<'_>, noise: wgpu::BindingResource<'_>) {
    let bindings = vec![(1, piece.uniform.clone()), (2, piece.splats.as_entire_binding()), (10, noise)];
    recorder.dispatch(OptimizeProgram::Explore, Groups::Direct(piece.blocks), bindings);
}
