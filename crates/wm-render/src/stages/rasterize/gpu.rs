//! Blending on the GPU: a workgroup a tile of 16x16 px, a thread a pixel.

use crate::differentiable::Channels;
use crate::gpu::recorder::{Groups, Recorder};
use crate::gpu::source::{StagePrograms, switches};
use crate::renderer::{Geometry, MedianDepth};
use std::borrow::Cow;

/// The programs of blending.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum RasterizeProgram {
    /// Blends colour, and the outputs beside it.
    Frame(Geometry, MedianDepth),
    /// Blends the sums of a step of training, and keeps them.
    Sums(Channels),
}

impl StagePrograms for RasterizeProgram {
    fn all() -> Vec<Self> {
        let mut all: Vec<Self> = Channels::ALL.map(Self::Sums).into();
        for geometry in [Geometry::None, Geometry::Depth, Geometry::DepthNormal] {
            all.extend([MedianDepth::Off, MedianDepth::On].map(|median| Self::Frame(geometry, median)));
        }
        all
    }

    fn entry(&self) -> &'static str {
        "rasterize"
    }

    fn parts(&self) -> Vec<Cow<'static, str>> {
        let (channels, keeps_sums, is_median, input) = match self {
            Self::Frame(geometry, median) => {
                let channels = match geometry {
                    Geometry::None => Channels::Color,
                    Geometry::Depth => Channels::ColorDepth,
                    Geometry::DepthNormal => Channels::ColorDepthNormal,
                };
                (channels, false, *median == MedianDepth::On, include_str!("records.wgsl"))
            }
            Self::Sums(channels) => (*channels, true, false, include_str!("pairs.wgsl")),
        };
        let constants = format!("const KEEPS_SUMS = {keeps_sums};\nconst MEDIAN = {is_median};");
        let blending = include_str!("rasterize.wgsl");
        vec![switches(channels), constants.into(), input.into(), blending.into()]
    }
}

/// The buffers that `rasterize.wgsl` reads and writes. Pictures that are not wanted are not written, and may be small.
pub(crate) struct Rasterize<'a> {
    pub tile_offsets: &'a wgpu::Buffer,
    pub entries: &'a wgpu::Buffer,
    pub records: &'a wgpu::Buffer,
    pub rgb: &'a wgpu::Buffer,
    pub alpha: &'a wgpu::Buffer,
    pub depths: &'a wgpu::Buffer,
    pub normal: &'a wgpu::Buffer,
}

impl Rasterize<'_> {
    /// Blends all tiles, whose entries name records; `counters` learn how many were walked.
    pub fn record(
        &self,
        recorder: &mut Recorder<'_>,
        tiles: u32,
        (geometry, median): (Geometry, MedianDepth),
        counters: &wgpu::Buffer,
    ) {
        self.dispatch(recorder, tiles, RasterizeProgram::Frame(geometry, median), counters);
    }

    /// Blends the sums of a step of training. Entries name pairs, and `names` has the record of each.
    pub fn record_sums(
        &self,
        recorder: &mut Recorder<'_>,
        tiles: u32,
        channels: Channels,
        names: &wgpu::Buffer,
    ) {
        self.dispatch(recorder, tiles, RasterizeProgram::Sums(channels), names);
    }

    fn dispatch(
        &self,
        recorder: &mut Recorder<'_>,
        tiles: u32,
        program: RasterizeProgram,
        last: &wgpu::Buffer,
    ) {
        let bindings = vec![
            (0, recorder.view()),
            (1, self.tile_offsets.as_entire_binding()),
            (2, self.entries.as_entire_binding()),
            (3, self.records.as_entire_binding()),
            (4, self.rgb.as_entire_binding()),
            (5, self.alpha.as_entire_binding()),
            (6, self.depths.as_entire_binding()),
            (7, self.normal.as_entire_binding()),
            (8, last.as_entire_binding()),
        ];
        recorder.dispatch(program, Groups::Direct(tiles), bindings);
    }
}
