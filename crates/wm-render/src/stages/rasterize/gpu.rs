//! Blending on the GPU: a workgroup a tile of 16x16 px, a thread a pixel.

use crate::differentiable::Channels;
use crate::frame::FRONT;
use crate::gpu::recorder::{Groups, Recorder, with_buffers};
use crate::gpu::source::{StagePrograms, switches};
use crate::hooks::GROUP;
use crate::renderer::{Geometry, MedianDepth, WEIGHT_UNITS};
use std::borrow::Cow;

/// Pictures of depths before that of the surface in the buffer of depths: expected and median
/// depth. The sums of [`crate::Frame::front`] follow the surface.
pub(crate) const SURFACE_PLANE: u64 = 2;

/// The programs of blending.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) enum RasterizeProgram {
    /// Blends colour, and the outputs beside it.
    Frame(Geometry, MedianDepth),
    /// Blends the same sums, and what is in front of a surface.
    Split(Geometry, MedianDepth),
    /// Blends the sums of a step of training, and keeps them.
    Sums(Channels),
    /// Sums the weights of each record, and blends nothing.
    Weights,
}

impl StagePrograms for RasterizeProgram {
    fn all() -> Vec<Self> {
        let mut all: Vec<Self> = Channels::ALL.map(Self::Sums).into();
        all.push(Self::Weights);
        for geometry in [Geometry::None, Geometry::Depth, Geometry::DepthNormal] {
            all.extend([MedianDepth::Off, MedianDepth::On].map(|median| Self::Frame(geometry, median)));
            if geometry != Geometry::None {
                all.extend([MedianDepth::Off, MedianDepth::On].map(|median| Self::Split(geometry, median)));
            }
        }
        all
    }

    fn entry(&self) -> &'static str {
        match self {
            Self::Weights => "weigh",
            _ => "rasterize",
        }
    }

    fn parts(&self) -> Vec<Cow<'static, str>> {
        let (channels, keeps_sums, is_median, input) = match self {
            Self::Frame(geometry, median) | Self::Split(geometry, median) => {
                let channels = match geometry {
                    Geometry::None => Channels::Color,
                    Geometry::Depth => Channels::ColorDepth,
                    Geometry::DepthNormal => Channels::ColorDepthNormal,
                };
                (channels, false, *median == MedianDepth::On, include_str!("records.wgsl"))
            }
            Self::Sums(channels) => (*channels, true, false, include_str!("pairs.wgsl")),
            Self::Weights => {
                let constants = format!("const WEIGHT_UNITS = {WEIGHT_UNITS:?};");
                return vec![switches(Channels::Depth), constants.into(), include_str!("weigh.wgsl").into()];
            }
        };
        let is_split = matches!(self, Self::Split(..));
        let constants = format!(
            "const KEEPS_SUMS = {keeps_sums};\nconst MEDIAN = {is_median};\nconst SPLIT = {is_split};\n\
             const SURFACE_PLANE = {SURFACE_PLANE}u;\nconst FRONT = {FRONT}u;\nconst FRONT_GROUP = {GROUP}u;"
        );
        let blending = include_str!("rasterize.wgsl");
        vec![switches(channels), constants.into(), input.into(), blending.into()]
    }
}

/// The buffers that `rasterize.wgsl` reads and writes. Pictures that are not wanted are not
/// written, and may be small.
pub(crate) struct Rasterize<'a> {
    pub(crate) tile_offsets: &'a wgpu::Buffer,
    pub(crate) entries: &'a wgpu::Buffer,
    pub(crate) records: &'a wgpu::Buffer,
    pub(crate) rgb: &'a wgpu::Buffer,
    pub(crate) alpha: &'a wgpu::Buffer,
    pub(crate) depths: &'a wgpu::Buffer,
    pub(crate) normal: &'a wgpu::Buffer,
}

impl Rasterize<'_> {
    /// Blends all tiles, whose entries name records; `counters` learn how many were walked.
    pub(crate) fn record(
        &self,
        recorder: &mut Recorder<'_>,
        tiles: u32,
        geometry: Geometry,
        median: MedianDepth,
        is_split: bool,
        counters: &wgpu::Buffer,
    ) {
        let program = match is_split {
            false => RasterizeProgram::Frame(geometry, median),
            true => RasterizeProgram::Split(geometry, median),
        };
        self.dispatch(recorder, tiles, program, counters);
    }

    /// Blends the sums of a step of training. Entries name pairs, and `names` has the record of
    /// each.
    pub(crate) fn record_sums(
        &self,
        recorder: &mut Recorder<'_>,
        tiles: u32,
        channels: Channels,
        names: &wgpu::Buffer,
    ) {
        self.dispatch(recorder, tiles, RasterizeProgram::Sums(channels), names);
    }

    /// Adds the weights of the records to `weights`, one a record, in [`WEIGHT_UNITS`].
    pub(crate) fn record_weights(&self, recorder: &mut Recorder<'_>, tiles: u32, weights: &wgpu::Buffer) {
        let bindings = with_buffers(
            vec![(0, recorder.view())],
            [self.tile_offsets, self.entries, self.records, weights],
        );
        recorder.dispatch(RasterizeProgram::Weights, Groups::Direct(tiles), bindings);
    }

    fn dispatch(
        &self,
        recorder: &mut Recorder<'_>,
        tiles: u32,
        program: RasterizeProgram,
        last: &wgpu::Buffer,
    ) {
        let bindings = with_buffers(
            vec![(0, recorder.view())],
            [
                self.tile_offsets,
                self.entries,
                self.records,
                self.rgb,
                self.alpha,
                self.depths,
                self.normal,
                last,
            ],
        );
        recorder.dispatch(program, Groups::Direct(tiles), bindings);
    }
}
