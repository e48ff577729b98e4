//! One frame on the GPU: its structures, and its commands stage by stage.

use super::buffers::Room;
use super::device::Gpu;
use super::model::GpuModel;
use super::recorder::{Recorder, Stage};
use super::source::{Behind, ENTRY_SORT, Falls, Program, VISIBLE_SORT};
use super::uniforms::{self, Capacity, Uniform};
use crate::cpu::Features;
use crate::hooks::Twin;
use crate::renderer::Job;
use crate::stages::composite::gpu::Composite;
use crate::stages::intersect::gpu::{Intersect, ranges};
use crate::stages::particles::gpu::fall;
use crate::stages::project::gpu::{Piece, cull, project};
use crate::stages::rasterize::gpu::Rasterize;
use crate::stages::scan::gpu::spine;
use crate::stages::sort::gpu::{Sort, passes};

/// Bits of a depth.
const DEPTH_BITS: u32 = 32;
// Slots of the structures.
const DEPTH_PASSES: usize = 1;
const TILE_PASSES: usize = 5;
const COUNT_TASK: usize = 9;
const WRITE_TASK: usize = 10;
const CHUNKS: usize = 11;

/// A frame to draw.
pub(crate) struct Plan<'a> {
    pub job: &'a Job<'a>,
    /// The sets, each with the factors of its splats and whether there are any.
    pub sets: Vec<(&'a GpuModel, wgpu::Buffer, bool)>,
    pub features: Features,
    pub air: Option<(Twin, wgpu::Buffer)>,
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
        let (columns, rows) = uniforms::tiles(self.job);
        columns * rows
    }

    pub fn pixels(&self) -> u32 {
        self.job.camera.width * self.job.camera.height
    }

    /// Passes of the sort by tile.
    fn tile_passes(&self) -> usize {
        passes(u32::BITS - self.tiles().leading_zeros()) as usize
    }

    /// All structures, in the order of their slots.
    pub fn uniforms(&self, capacity: Capacity) -> Vec<Uniform> {
        let mut uniforms = vec![uniforms::view(self.job, self.blocks(), self.drops.1, capacity)];
        let pass = |of_entries: bool| {
            (0..4).map(move |i| uniforms::sort_pass(8 * i, of_entries, !of_entries && i == 0))
        };
        uniforms.extend(pass(false));
        uniforms.extend(pass(true));
        uniforms.extend([false, true].map(uniforms::intersect_task));
        let mut first_block = 0;
        for (model, _, faded) in &self.sets {
            for chunk in &model.chunks {
                let (blocks, first_splat) = (chunk.blocks, chunk.first_splat);
                uniforms.push(uniforms::chunk(first_block, blocks, first_splat, model.sh_rows, *faded));
                first_block += blocks;
            }
        }
        uniforms
    }

    /// Number of [`Self::uniforms`].
    pub fn slots(&self) -> usize {
        CHUNKS + self.sets.iter().map(|(model, ..)| model.chunks.len()).sum::<usize>()
    }

    /// The commands of the whole frame, without the way back.
    pub fn record<'a>(
        &self,
        gpu: &'a Gpu,
        room: &'a Room,
        queries: Option<&'a wgpu::QuerySet>,
    ) -> Recorder<'a> {
        let mut recorder = Recorder::new(gpu, &room.uniforms, queries);
        recorder.encoder().clear_buffer(&room.counters, 0, None);
        if self.falls != Falls::Nothing {
            recorder.encoder().clear_buffer(&room.falling, 0, None);
        }
        self.front(&mut recorder, room);
        let tiles = self.lists(&mut recorder, room);
        recorder.begin(Stage::Rasterize);
        let rasterize = Rasterize {
            tile_offsets: &room.tile_offsets,
            entries: tiles.1,
            records: &room.records,
            rgb: &room.rgb,
            alpha: &room.alpha,
            depths: &room.depths,
            normal: &room.normal,
            counters: &room.counters,
        };
        rasterize.record(&mut recorder, self.tiles(), (self.features.geometry, self.features.median));
        recorder.begin(Stage::Fall);
        if self.falls != Falls::Nothing {
            fall(&mut recorder, (&self.drops.0, self.drops.1), (&room.alpha, &room.depths), &room.falling);
        }
        recorder.begin(Stage::Composite);
        let composite = Composite {
            rgb: &room.rgb,
            alpha: &room.alpha,
            background: &room.background,
            falling: &room.falling,
            apart: &room.apart,
        };
        composite.record(&mut recorder, self.pixels(), self.behind, self.falls);
        recorder
    }

    /// Splats to records.
    fn front(&self, recorder: &mut Recorder<'_>, room: &Room) {
        recorder.begin(Stage::Project);
        let mut pieces = Vec::new();
        for (model, visibility, _) in &self.sets {
            for chunk in &model.chunks {
                pieces.push(Piece {
                    uniform: recorder.uniform(CHUNKS + pieces.len()),
                    splats: &chunk.splats,
                    sh_rest: &chunk.sh_rest,
                    visibility,
                    blocks: chunk.blocks,
                });
            }
        }
        for piece in &pieces {
            cull(recorder, piece, &room.blocks);
        }
        spine(recorder, &Program::SpineVisible, &room.blocks, (&room.counters, &room.dispatches));
        let air = self.air.as_ref().map(|(twin, parameters)| (twin, parameters));
        for piece in &pieces {
            project(recorder, piece, &room.blocks, (&room.records, &room.depth_pairs[0][0]), air);
        }
    }

    /// Records to tile lists: tiles and names of the entries.
    fn lists<'r>(&self, recorder: &mut Recorder<'_>, room: &'r Room) -> (&'r wgpu::Buffer, &'r wgpu::Buffer) {
        let (counters, dispatches) = (&room.counters, &room.dispatches);
        let sort = |pairs: &'r [[wgpu::Buffer; 2]; 2], size: u32| Sort {
            pairs: pairs.each_ref().map(|[keys, values]| (keys, values)),
            counters,
            dispatches,
            size,
            histogram: &room.histogram,
            totals: &room.totals,
        };
        recorder.begin(Stage::Sort);
        let slots = DEPTH_PASSES..DEPTH_PASSES + passes(DEPTH_BITS) as usize;
        let (_, order) = sort(&room.depth_pairs, VISIBLE_SORT).record(recorder, slots);
        recorder.begin(Stage::Intersect);
        let [tiles, entries] = &room.entry_pairs[0];
        let (records, counts, sums) = (&room.records, &room.counts, &room.sums);
        let intersect = Intersect { counters, dispatches, records, order, counts, sums, tiles, entries };
        intersect.record(recorder, COUNT_TASK);
        spine(recorder, &Program::SpineEntries, sums, (counters, dispatches));
        intersect.record(recorder, WRITE_TASK);
        let slots = TILE_PASSES..TILE_PASSES + self.tile_passes();
        let lists = sort(&room.entry_pairs, ENTRY_SORT).record(recorder, slots);
        ranges(recorder, self.tiles(), (counters, lists.0), &room.tile_offsets);
        lists
    }
}
