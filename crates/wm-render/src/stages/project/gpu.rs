//! Projection on the GPU: one pass finds the splats in view, a bit each; after prefix sums over
//! blocks of 256 a second one writes their records in the order of the splats, so that nothing
//! depends on which workgroup came first.

use crate::gpu::recorder::{Bindings, Groups, Recorder};
use crate::gpu::source::{COLOR, StagePrograms, texts};
use crate::hooks::WgslSource;
use crate::plan::Shading;
use crate::stages::shade::gpu::{AirText, SHADE};
use std::borrow::Cow;

/// Rows of sixteen numbers of a group of splats on the GPU, see `geometry.wgsl`.
pub(crate) const ROWS: u32 = 15;
/// Mean, three rows.
pub(crate) const ROW_MEAN: u32 = 0;
/// Quaternion, wxyz, four rows: of length 1, or as stored.
pub(crate) const ROW_QUAT: u32 = 3;
/// Standard deviations, three rows, or their logarithms.
pub(crate) const ROW_SCALE: u32 = 7;
/// log2 of the opacity, or its logit.
pub(crate) const ROW_OPACITY: u32 = 10;
/// Coefficient 0 of the colour, three rows.
pub(crate) const ROW_DC: u32 = 11;
/// 1 for splats of the sky, else 0.
pub(crate) const ROW_SKY: u32 = 14;

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

/// The programs of the projection.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) enum ProjectProgram {
    /// Finds the splats in view.
    Cull(ParameterForm),
    /// Writes their records, with colours through the air.
    Project(ParameterForm, AirText),
}

impl StagePrograms for ProjectProgram {
    fn all() -> Vec<Self> {
        let project = Self::Project;
        vec![
            Self::Cull(ParameterForm::Activated),
            Self::Cull(ParameterForm::Stored),
            project(ParameterForm::Activated, AirText::Clear),
            project(ParameterForm::Activated, AirText::FullShare),
            project(ParameterForm::Stored, AirText::Photos),
        ]
    }

    fn entry(&self) -> &'static str {
        match self {
            Self::Cull(_) => "cull",
            Self::Project(..) => "project_visible",
        }
    }

    fn parts(&self) -> Vec<Cow<'static, str>> {
        match self {
            Self::Cull(form) => texts([PIECES, COLOR, form.text(), GEOMETRY, include_str!("cull.wgsl")]),
            Self::Project(form, air) => {
                let mut parts =
                    texts([PIECES, COLOR, form.text(), GEOMETRY, SHADE, include_str!("project.wgsl")]);
                parts.extend(air.parts());
                parts
            }
        }
    }
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
        let mut bindings = vec![
            (0, recorder.view()),
            (1, self.uniform.clone()),
            (2, self.splats.as_entire_binding()),
            (4, blocks.as_entire_binding()),
        ];
        bindings.extend(self.attributes.map(|attributes| (3, attributes.as_entire_binding())));
        bindings
    }
}

/// Finds which splats of a piece are in view.
pub(crate) fn cull(recorder: &mut Recorder<'_>, piece: &Piece<'_>, blocks: &wgpu::Buffer) {
    let bindings = piece.bindings(recorder, blocks);
    recorder.dispatch(ProjectProgram::Cull(piece.form()), Groups::Direct(piece.blocks), bindings);
}

/// Writes the records and depths of those in view, through the air.
pub(crate) fn project(
    recorder: &mut Recorder<'_>,
    piece: &Piece<'_>,
    blocks: &wgpu::Buffer,
    records: &wgpu::Buffer,
    depths: &wgpu::Buffer,
    shading: Shading,
    air: Option<(&WgslSource, &wgpu::Buffer)>,
) {
    let mut bindings = piece.bindings(recorder, blocks);
    bindings.extend([
        (5, piece.sh_rest.as_entire_binding()),
        (6, records.as_entire_binding()),
        (7, depths.as_entire_binding()),
    ]);
    bindings.extend(air.map(|(_, parameters)| (8, parameters.as_entire_binding())));
    let air = match piece.form() {
        ParameterForm::Activated => AirText::new(shading, air.map(|(air, _)| air)),
        ParameterForm::Stored => AirText::Photos,
    };
    recorder.dispatch(ProjectProgram::Project(piece.form(), air), Groups::Direct(piece.blocks), bindings);
}
