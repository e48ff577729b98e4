//! The derivative of blending on the GPU: a workgroup a tile. Each pair of splat and tile has its
//! own slot, whose number the tile lists carry through their sort.

use crate::differentiable::Channels;
use crate::gpu::recorder::{Groups, Recorder, with_buffers};
use crate::gpu::source::{StagePrograms, Subgroups, TRAINING, WORKGROUP, switches};
use std::borrow::Cow;

/// The programs of the derivative of blending.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) enum RasterizeBackwardProgram {
    /// Turns derivatives by pictures into derivatives by sums.
    BySums(Channels),
    /// Derives by each splat of a tile.
    Backward(Channels, Subgroups),
}

impl StagePrograms for RasterizeBackwardProgram {
    fn all() -> Vec<Self> {
        let mut all = Vec::new();
        for channels in Channels::ALL {
            all.push(Self::BySums(channels));
            all.extend([Subgroups::Used, Subgroups::Unused].map(|used| Self::Backward(channels, used)));
        }
        all
    }

    fn entry(&self) -> &'static str {
        match self {
            Self::BySums(_) => "by_sums",
            Self::Backward(..) => "rasterize_backward",
        }
    }

    fn parts(&self) -> Vec<Cow<'static, str>> {
        match self {
            Self::BySums(channels) => {
                vec![switches(*channels), TRAINING.into(), include_str!("upstream.wgsl").into()]
            }
            Self::Backward(channels, subgroups) => {
                let sums = match subgroups {
                    Subgroups::Used => include_str!("subgroups.wgsl"),
                    Subgroups::Unused => include_str!("shared.wgsl"),
                };
                vec![switches(*channels), include_str!("rasterize_backward.wgsl").into(), sums.into()]
            }
        }
    }
}

/// The sums of a step of training.
#[derive(Clone, Copy)]
pub(crate) struct ForwardPictures<'a> {
    pub(crate) rgb: &'a wgpu::Buffer,
    pub(crate) alpha: &'a wgpu::Buffer,
    pub(crate) depths: &'a wgpu::Buffer,
    pub(crate) normal: &'a wgpu::Buffer,
}

/// Turns the derivatives by the pictures to those by the sums, see `upstream.wgsl`; `training` is
/// the structure of that name.
pub(crate) fn by_sums(
    recorder: &mut Recorder<'_>,
    pixels: u32,
    channels: Channels,
    training: wgpu::BindingResource<'_>,
    kept: ForwardPictures<'_>,
    upstream: &wgpu::Buffer,
    states: &wgpu::Buffer,
) {
    let bindings = with_buffers(
        vec![(0, recorder.view()), (1, training)],
        [kept.rgb, kept.alpha, kept.depths, kept.normal, upstream, states],
    );
    recorder.dispatch(
        RasterizeBackwardProgram::BySums(channels),
        Groups::Direct(pixels.div_ceil(WORKGROUP)),
        bindings,
    );
}

/// The buffers that `rasterize_backward.wgsl` reads and writes.
pub(crate) struct RasterizeBackward<'a> {
    pub(crate) tile_offsets: &'a wgpu::Buffer,
    /// The pair of each entry.
    pub(crate) pairs: &'a wgpu::Buffer,
    /// The record of each pair.
    pub(crate) names: &'a wgpu::Buffer,
    pub(crate) records: &'a wgpu::Buffer,
    pub(crate) states: &'a wgpu::Buffer,
    pub(crate) slots: &'a wgpu::Buffer,
}

impl RasterizeBackward<'_> {
    /// Sums what the pixels of all tiles pull.
    pub(crate) fn record(&self, recorder: &mut Recorder<'_>, tiles: u32, channels: Channels) {
        let bindings = with_buffers(
            vec![(0, recorder.view())],
            [self.tile_offsets, self.pairs, self.names, self.records, self.states, self.slots],
        );
        let program = RasterizeBackwardProgram::Backward(channels, recorder.subgroups());
        recorder.dispatch(program, Groups::Direct(tiles), bindings);
    }
}
