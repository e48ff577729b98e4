//! One frame on the GPU: its structures, and its commands stage by stage.

use super::buffers::Room;
use super::device::Gpu;
use super::lists::{self, CHUNKS, Entries};
use super::model::GpuModel;
use super::recorder::{Clock, Recorder, Stage};
use super::source::{Behind, Falls};
use super::uniforms::{self, Capacity, Sight, Uniform};
use crate::cpu::Features;
use crate::hooks::WgslSource;
use crate::plan::DrawPass;
use crate::stages::composite::gpu::Composite;
use crate::stages::particles::gpu::fall;
use crate::stages::project::gpu::Piece;
use crate::stages::rasterize::gpu::Rasterize;

/// A frame to draw.
pub(crate) struct Plan<'a> {
    pub pass: &'a DrawPass<'a>,
    /// The sets, each with the factors of its splats and whether there are any.
    pub sets: Vec<(&'a GpuModel, wgpu::Buffer, bool)>,
    pub features: Features,
    pub air: Option<(WgslSource, wgpu::Buffer)>,
}

/// What comes before and behind the splats.
pub(crate) struct Around {
    pub behind: Behind,
    pub falls: Falls,
    /// What falls, and how many.
    pub drops: (wgpu::Buffer, u32),
}

impl Plan<'_> {
    /// Blocks of 256 splats in all sets.
    pub fn blocks(&self) -> u32 {
        self.sets.iter().map(|(model, ..)| model.blocks()).sum()
    }

    pub fn tiles(&self) -> u32 {
        Sight::of(self.pass).tile_count()
    }

    pub fn pixels(&self) -> u32 {
        self.pass.camera.width * self.pass.camera.height
    }

    /// The structure `View`, where so many drops fall.
    pub fn view(&self, drops: u32, capacity: Capacity) -> Uniform {
        uniforms::view(&Sight::of(self.pass), self.blocks(), drops, capacity)
    }

    /// All structures, in the order of their slots; nothing falls yet.
    pub fn uniforms(&self, capacity: Capacity) -> Vec<Uniform> {
        let mut uniforms = lists::uniforms(self.view(0, capacity), Entries::Records);
        let mut first_block = 0;
        for (model, _, has_attributes) in &self.sets {
            for chunk in &model.chunks {
                let (blocks, first_splat) = (chunk.blocks, chunk.first_splat);
                let piece = uniforms::Piece::whole(first_block, blocks, first_splat, model.sh_rows);
                uniforms.push(uniforms::chunk(piece, *has_attributes));
                first_block += blocks;
            }
        }
        uniforms
    }

    /// Number of [`Self::uniforms`].
    pub fn slots(&self) -> usize {
        CHUNKS + self.sets.iter().map(|(model, ..)| model.chunks.len()).sum::<usize>()
    }

    /// The commands up to the picture of the splats.
    pub fn record_splats<'a>(&self, gpu: &'a Gpu, room: &'a Room, clock: Option<&'a Clock>) -> Recorder<'a> {
        let mut recorder = Recorder::new(gpu, &room.uniforms, clock);
        recorder.encoder().clear_buffer(&room.counters, 0, None);
        let air = self.air.as_ref().map(|(source, parameters)| (source, parameters));
        let pieces = self.pieces(&recorder);
        lists::front(&mut recorder, room, &pieces, self.pass.shading, air);
        let listed = lists::lists(&mut recorder, room, self.tiles(), Entries::Records);
        recorder.begin(Stage::Rasterize);
        let rasterize = Rasterize {
            tile_offsets: &room.tile_offsets,
            entries: listed.1,
            records: &room.records,
            rgb: &room.rgb,
            alpha: &room.alpha,
            depths: &room.depths,
            normal: &room.normal,
        };
        let sums = (self.features.geometry, self.features.median);
        rasterize.record(&mut recorder, self.tiles(), sums, &room.counters);
        recorder
    }

    /// The commands of what is around them, without the way back.
    pub fn record_around<'a>(&self, recorder: &mut Recorder<'a>, room: &'a Room, around: &'a Around) {
        if around.falls != Falls::Nothing {
            recorder.encoder().clear_buffer(&room.falling, 0, None);
        }
        recorder.begin(Stage::Fall);
        if around.falls != Falls::Nothing {
            let (drops, count) = &around.drops;
            fall(recorder, (drops, *count), (&room.alpha, &room.depths), &room.falling);
        }
        recorder.begin(Stage::Composite);
        let composite = Composite {
            rgb: &room.rgb,
            alpha: &room.alpha,
            background: &room.background,
            falling: &room.falling,
            apart: &room.apart,
        };
        composite.record(recorder, self.pixels(), around.behind, around.falls);
    }

    /// The pieces of all sets.
    fn pieces<'r>(&'r self, recorder: &Recorder<'r>) -> Vec<Piece<'r>> {
        let mut pieces = Vec::new();
        for (model, attributes, _) in &self.sets {
            for chunk in &model.chunks {
                pieces.push(Piece {
                    uniform: recorder.uniform(CHUNKS + pieces.len()),
                    splats: &chunk.splats,
                    sh_rest: &chunk.sh_rest,
                    attributes: Some(attributes),
                    blocks: chunk.blocks,
                });
            }
        }
        pieces
    }
}
