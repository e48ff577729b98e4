//! Projection on the GPU: one pass finds the splats in view, a bit each; after prefix sums over blocks of 256 a second
//! one writes their records in the order of the splats, so that nothing depends on which workgroup came first.

use crate::gpu::recorder::{Groups, Recorder};
use crate::gpu::source::Program;
use crate::hooks::Twin;

/// Rows of sixteen numbers of a group of splats on the GPU, see `geometry.wgsl`.
pub const ROWS: u32 = 15;
/// Mean, three rows.
pub const ROW_MEAN: u32 = 0;
/// Unit quaternion, wxyz, four rows.
pub const ROW_QUAT: u32 = 3;
/// Standard deviations, three rows.
pub const ROW_SCALE: u32 = 7;
/// log2 of the opacity.
pub const ROW_LOG2_OPACITY: u32 = 10;
/// Coefficient 0 of the colour, three rows.
pub const ROW_DC: u32 = 11;
/// 1 for splats of the sky, else 0.
pub const ROW_SKY: u32 = 14;

/// One piece of a set with what changes of it from frame to frame.
pub(crate) struct Piece<'a> {
    /// `Chunk` of `geometry.wgsl`.
    pub uniform: wgpu::BindingResource<'a>,
    /// See `geometry.wgsl`.
    pub splats: &'a wgpu::Buffer,
    /// See `shade.wgsl`.
    pub sh_rest: &'a wgpu::Buffer,
    /// See `geometry.wgsl`.
    pub visibility: &'a wgpu::Buffer,
    /// Blocks of 256 splats.
    pub blocks: u32,
}

/// Finds which splats of a piece are in view.
pub(crate) fn cull(recorder: &mut Recorder<'_>, piece: &Piece<'_>, blocks: &wgpu::Buffer) {
    let view = recorder.view();
    recorder.dispatch(
        &Program::Cull,
        Groups::Direct(piece.blocks),
        vec![
            (0, view),
            (1, piece.uniform.clone()),
            (2, piece.splats.as_entire_binding()),
            (3, piece.visibility.as_entire_binding()),
            (4, blocks.as_entire_binding()),
        ],
    );
}

/// Writes the records and depths of those in view, through the air.
pub(crate) fn project(
    recorder: &mut Recorder<'_>,
    piece: &Piece<'_>,
    blocks: &wgpu::Buffer,
    (records, depths): (&wgpu::Buffer, &wgpu::Buffer),
    air: Option<(&Twin, &wgpu::Buffer)>,
) {
    let mut bindings = vec![
        (0, recorder.view()),
        (1, piece.uniform.clone()),
        (2, piece.splats.as_entire_binding()),
        (3, piece.visibility.as_entire_binding()),
        (4, blocks.as_entire_binding()),
        (5, piece.sh_rest.as_entire_binding()),
        (6, records.as_entire_binding()),
        (7, depths.as_entire_binding()),
    ];
    bindings.extend(air.map(|(_, parameters)| (8, parameters.as_entire_binding())));
    let program = Program::Project(air.map(|(twin, _)| twin.wgsl.clone()));
    recorder.dispatch(&program, Groups::Direct(piece.blocks), bindings);
}
