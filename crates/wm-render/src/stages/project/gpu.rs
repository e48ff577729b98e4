//! Projection on the GPU: one pass finds the splats in view, a bit each; after prefix sums over
//! blocks of 256 a second one writes their records in the order of the splats, so that nothing
//! depends on which workgroup came first.

use crate::gpu::buffers::Room;
use crate::gpu::recorder::{Bindings, Groups, Recorder, with_numbered};
use crate::gpu::source::{COLOR, Program};
use crate::hooks::WgslSource;
use crate::plan::Shading;
use crate::stages::shade::gpu::{AirText, SHADE};

/// The first text of all programs over splats.
pub(crate) const PIECES: &str = include_str!("pieces.wgsl");
/// The text that projects one splat.
pub(crate) const GEOMETRY: &str = include_str!("geometry.wgsl");

/// The form of the parameters of splats.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum ParameterForm {
    /// Made ready once, to be rendered often.
    Activated,
    /// Parameters as they are stored, for splats that learn.
    Stored,
}

impl ParameterForm {
    /// The text that reads them.
    pub(crate) fn text(self) -> &'static str {
        match self {
            Self::Activated => include_str!("activated.wgsl"),
            Self::Stored => include_str!("stored.wgsl"),
        }
    }
}

/// Finds the splats in view.
pub(crate) fn cull_program(form: ParameterForm) -> Program {
    Program::new("cull", &[PIECES, COLOR, GEOMETRY, include_str!("cull.wgsl")]).with(form.text())
}

/// Writes their records, with colours through the air.
pub(crate) fn project_program(form: ParameterForm, air: &AirText) -> Program {
    let texts = &[PIECES, COLOR, GEOMETRY, SHADE, include_str!("project.wgsl")];
    air.added_to(Program::new("project_visible", texts).with(form.text()))
}

/// One piece of a set with what changes of it from frame to frame.
pub(crate) struct Piece<'a> {
    /// `Chunk` of `geometry.wgsl`.
    pub(crate) uniform: wgpu::BindingResource<'a>,
    /// See `geometry.wgsl`.
    pub(crate) splats: &'a wgpu::Buffer,
    /// See `shade.wgsl`.
    pub(crate) sh_rest: &'a wgpu::Buffer,
    /// See `activated.wgsl`; `None` of splats in stored form.
    pub(crate) attributes: Option<&'a wgpu::Buffer>,
    /// Blocks of 256 splats.
    pub(crate) blocks: u32,
}

impl Piece<'_> {
    fn form(&self) -> ParameterForm {
        if self.attributes.is_some() { ParameterForm::Activated } else { ParameterForm::Stored }
    }

    /// The bindings that all programs over splats share.
    pub(crate) fn bindings<'a>(&'a self, recorder: &Recorder<'a>, blocks: &'a wgpu::Buffer) -> Bindings<'a> {
        let structures = vec![(0, recorder.view()), (1, self.uniform.clone())];
        let mut bindings = with_numbered(structures, [(2, self.splats), (4, blocks)]);
        bindings.extend(self.attributes.map(|attributes| (3, attributes.as_entire_binding())));
        bindings
    }
}

/// Finds which splats of a piece are in view.
pub(crate) fn cull(recorder: &mut Recorder<'_>, piece: &Piece<'_>, blocks: &wgpu::Buffer) {
    let bindings = piece.bindings(recorder, blocks);
    recorder.dispatch(cull_program(piece.form()), Groups::Direct(piece.blocks), bindings);
}

/// Writes the records and depths of those in view, through the air.
pub(crate) fn project(
    recorder: &mut Recorder<'_>,
    piece: &Piece<'_>,
    room: &Room,
    shading: Shading,
    air: Option<(&WgslSource, &wgpu::Buffer)>,
) {
    let own = [(5, piece.sh_rest), (6, &room.records), (7, &room.lists.depth_pairs[0][0])];
    let mut bindings = with_numbered(piece.bindings(recorder, &room.lists.blocks), own);
    bindings.extend(air.map(|(_, parameters)| (8, parameters.as_entire_binding())));
    let air = match piece.form() {
        ParameterForm::Activated => AirText::new(shading, air.map(|(air, _)| air)),
        ParameterForm::Stored => AirText::Photos,
    };
    recorder.dispatch(project_program(piece.form(), &air), Groups::Direct(piece.blocks), bindings);
}
