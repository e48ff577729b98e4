//! Gradients on the GPU: the slots of each splat are added in the order of its tiles, and derived
//! by a thread a splat, with the colours ([`shade_backward`](crate::stages::shade_backward)) in the
//! same program.

use crate::differentiable::Channels;
use crate::gpu::recorder::{Groups, Recorder, with_buffers};
use crate::gpu::source::{COLOR, StagePrograms, VISIBLE_GROUPS, switches, texts};
use crate::stages::project::gpu::{GEOMETRY, PIECES, ParameterForm, Piece};
use crate::stages::shade::gpu::{PHOTO_AIR, SHADE};
use std::borrow::Cow;

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

/// The programs of the derivative of the projection.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) enum ProjectBackwardProgram {
    /// Adds up the derivatives of all tiles.
    Gather,
    /// Turns them into gradients by the stored parameters.
    Backward(Channels),
}

impl StagePrograms for ProjectBackwardProgram {
    fn all() -> Vec<Self> {
        let mut all = vec![Self::Gather];
        all.extend(Channels::ALL.map(Self::Backward));
        all
    }

    fn entry(&self) -> &'static str {
        match self {
            Self::Gather => "gather",
            Self::Backward(_) => "project_backward",
        }
    }

    fn parts(&self) -> Vec<Cow<'static, str>> {
        match self {
            Self::Gather => texts([include_str!("gather.wgsl")]),
            Self::Backward(channels) => {
                let mut parts = vec![switches(*channels)];
                parts.extend(texts([PIECES, ParameterForm::Stored.text(), GEOMETRY, SHADE]));
                parts.extend(texts([COLOR, PHOTO_AIR, SHADE_BACKWARD]));
                parts.extend(texts([include_str!("project_backward.wgsl")]));
                parts
            }
        }
    }
}

/// The buffers that `gather.wgsl` reads and writes.
pub(crate) struct Gather<'a> {
    pub(crate) counters: &'a wgpu::Buffer,
    pub(crate) dispatches: &'a wgpu::Buffer,
    pub(crate) order: &'a wgpu::Buffer,
    /// `counts` of `intersect.wgsl`, after entries were written.
    pub(crate) ends: &'a wgpu::Buffer,
    pub(crate) slots: &'a wgpu::Buffer,
    pub(crate) pulls: &'a wgpu::Buffer,
}

impl Gather<'_> {
    /// Adds the slots of all splats in view.
    pub(crate) fn record(&self, recorder: &mut Recorder<'_>) {
        let bindings = with_buffers(vec![], [self.counters, self.order, self.ends, self.slots, self.pulls]);
        recorder.dispatch(
            ProjectBackwardProgram::Gather,
            Groups::Indirect(self.dispatches, VISIBLE_GROUPS),
            bindings,
        );
    }
}

/// The buffers that `project_backward.wgsl` and `shade_backward.wgsl` read and write.
pub(crate) struct ProjectBackward<'a> {
    pub(crate) blocks: &'a wgpu::Buffer,
    pub(crate) records: &'a wgpu::Buffer,
    pub(crate) pulls: &'a wgpu::Buffer,
    pub(crate) gradients: &'a wgpu::Buffer,
    pub(crate) by_sh: &'a wgpu::Buffer,
}

impl ProjectBackward<'_> {
    /// Derives the splats of one piece.
    pub(crate) fn record(&self, recorder: &mut Recorder<'_>, piece: &Piece<'_>, channels: Channels) {
        let mut bindings = piece.bindings(recorder, self.blocks);
        bindings.extend([
            (5, piece.sh_rest.as_entire_binding()),
            (6, self.records.as_entire_binding()),
            (7, self.pulls.as_entire_binding()),
            (8, self.gradients.as_entire_binding()),
            (9, self.by_sh.as_entire_binding()),
        ]);
        recorder.dispatch(ProjectBackwardProgram::Backward(channels), Groups::Direct(piece.blocks), bindings);
    }
}
