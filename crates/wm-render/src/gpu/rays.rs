//! Splats for rays in the GPU's memory, see [`crate::stages::rays`].

use super::buffers::{BufferPool, GrowingBuffer, ListNames, Lists, READ_BACK, STRUCTURES};
use super::device::{AdapterKind, Gpu, WRITTEN};
use super::error::GpuError;
use super::readback::copy;
use super::recorder::{Recorder, Stage};
use super::source::{COUNTER_WORDS, ENTRY_SORT, VISIBLE_SORT, WORKGROUP};
use super::uniforms::{self, Capacity, UNIFORM_SLOT_BYTES, Uniform, bytes_of};
use crate::cpu::model::morton_order;
use crate::stages::intersect::gpu::ranges;
use crate::stages::prefix_sum::gpu::{SPINE_ENTRIES, SPINE_VISIBLE, spine};
use crate::stages::rays::gpu::{
    CONE_WORDS, HIT_WORDS, RAY_WORDS, RECORD_INDEX, RECORD_WORDS, RayBuffers, WRITE_TASK, record,
};
use crate::stages::rays::packets::{CHILDREN, PACKET, Packets, RayGroup};
use crate::stages::rays::{RayHits, RayOutputs, Rays};
use crate::stages::sort::gpu::{passes, sort};
use rayon::prelude::*;
use std::fmt;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};
use wm_scene::Splats;

/// Most entries of packets' lists that are held at once, unless there are more splats: 256 MiB with
/// the buffers to sort them. Packets that have more together are traced in several parts.
const MAX_ENTRIES: u32 = 1 << 24;
/// Most packets that are traced at once: a million rays.
const MAX_PACKETS: u32 = 1 << 14;
/// Largest angles between the axis of a packet and its rays, radians. A few rays in all directions,
/// or a packet where the curve that orders rays jumps, would have most splats in their lists. The
/// next smaller angle is tried if a list is still too long; with the last each packet is one ray.
const MAX_PACKET_ANGLES: [f64; 4] = [0.2, 0.05, 0.01, 0.0];
/// Most entries of one packet on a GPU in software: Mesa's ends all loops of a thread after 65,535
/// turns, of which blending takes three per entry.
const MAX_ENTRIES_IN_SOFTWARE: u32 = 20_000;
/// Bytes of coefficients of colour that are uploaded at once.
const COLOR_BYTES: u64 = 64 << 20;
/// Bits of a distance.
const DISTANCE_BITS: u32 = 32;
// Slots of the structures behind `View` and the tasks.
const DISTANCE_PASSES: usize = WRITE_TASK + 1;
const PACKET_PASSES: usize = DISTANCE_PASSES + 4;
const FIRST_PIECE_SLOT: usize = PACKET_PASSES + 4;

/// The names of the lists' buffers.
const NAMES: ListNames = ListNames {
    depths: ["splats by distance"; 2],
    counts: "packets of splats",
    entries: "lists of packets",
    offsets: "offsets of lists",
};

/// Splats that rays can meet, in the memory of a GPU: the twin of [`RaySplats`](crate::RaySplats).
pub struct GpuRaySplats {
    gpu: Arc<Gpu>,
    /// In Morton order, like those of the CPU.
    records: wgpu::Buffer,
    count: u32,
    colors: Vec<ColorPiece>,
    /// Coefficients of colour per splat.
    sh_stride: u32,
    /// See [`MAX_ENTRIES`].
    most_entries: u32,
    working: Mutex<Working>,
}

/// The coefficients of colour of consecutive records.
struct ColorPiece {
    first: u32,
    count: u32,
    sh: wgpu::Buffer,
}

/// Memory that is kept from call to call.
#[derive(Default)]
struct Working {
    kept: BufferPool,
    staging: GrowingBuffer,
    /// Capacity of the lists, entries.
    entries: u32,
}

/// Some packets of a group.
struct Part<'a> {
    group: &'a RayGroup,
    /// The packets of the group that are traced.
    packets: Range<u32>,
    /// Cones of the group's tree, level by level.
    cones: &'a [f32],
    asked: RayOutputs,
}

/// The outcome of tracing some packets.
enum TraceOutcome {
    /// All packets are traced.
    Whole,
    /// The packets have more entries together than can be held at once.
    TooMany,
    /// One packet has more entries than a GPU in software can walk.
    TooLong,
}

impl fmt::Debug for GpuRaySplats {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("GpuRaySplats").field("count", &self.count).finish_non_exhaustive()
    }
}

impl GpuRaySplats {
    /// Uploads the splats for which `is_met` returns true, such as those that are no sky, each with
    /// a value for [`RayOutputs::value`]. Uses the threads of the current pool.
    ///
    /// # Errors
    /// [`GpuError`] if the GPU has no room, or one array is larger than it binds.
    pub(crate) fn new(
        gpu: Arc<Gpu>,
        splats: &Splats,
        is_met: impl Fn(usize) -> bool + Sync,
        value: impl Fn(usize) -> f32 + Sync,
    ) -> Result<Self, GpuError> {
        let of = |index: &u32| {
            let index = *index as usize;
            is_met(index).then(|| record(splats, index, value(index))).flatten()
        };
        let records: Vec<[u32; RECORD_WORDS]> =
            morton_order(&splats.means).par_iter().filter_map(of).collect();
        let words = records.as_flattened();
        let buffer = gpu.upload("splats for rays", bytemuck::cast_slice(words))?;
        let stride = splats.sh_stride();
        let most = COLOR_BYTES.min(gpu.most_binding) / (4 * stride as u64);
        let mut colors: Vec<ColorPiece> = Vec::new();
        for piece in records.chunks((most as usize).max(1)) {
            let of = |record: &[u32; RECORD_WORDS]| splats.sh_of(record[RECORD_INDEX] as usize);
            let numbers: Vec<f32> = piece.iter().flat_map(of).copied().collect();
            let sh = gpu.upload("colours for rays", bytemuck::cast_slice(&numbers))?;
            // What waits to be copied goes with the first submission: not all of a large scene at
            // once.
            gpu.queue.submit([]);
            let first = colors.last().map_or(0, |last| last.first + last.count);
            colors.push(ColorPiece { first, count: piece.len() as u32, sh });
        }
        gpu.check()?;
        Ok(Self {
            gpu,
            records: buffer,
            count: records.len() as u32,
            colors,
            sh_stride: stride as u32,
            most_entries: MAX_ENTRIES,
            working: Mutex::default(),
        })
    }

    /// Limits the entries that are held at once: for tests.
    #[cfg(test)]
    pub(crate) fn holding(self, most_entries: u32) -> Self {
        Self { most_entries, ..self }
    }

    /// Traces rays, as [`RayTracer::trace`](crate::RayTracer::trace) does. Equal from call to call
    /// on one adapter.
    ///
    /// # Errors
    /// [`GpuError`] if the GPU has no room, or fails.
    ///
    /// # Panics
    /// If there are fewer origins than directions.
    pub(crate) fn trace(&self, rays: &Rays, asked: RayOutputs) -> Result<RayHits, GpuError> {
        for widest in MAX_PACKET_ANGLES {
            if let Some(hits) = self.trace_within(rays, asked, widest)? {
                return Ok(hits);
            }
        }
        let [bytes, most] = [self.count, MAX_ENTRIES_IN_SOFTWARE].map(|entries| 4 * u64::from(entries));
        Err(GpuError::TooLarge { what: "the splats along a ray", bytes, most })
    }

    /// Traces rays in packets no wider than an angle, radians; `None` if a list is too long.
    fn trace_within(&self, rays: &Rays, asked: RayOutputs, widest: f64) -> Result<Option<RayHits>, GpuError> {
        let count = rays.len();
        let mut hits = RayHits::none(count, asked);
        if self.count == 0 || count == 0 {
            return Ok(Some(hits));
        }
        let mut working = self.working.lock().unwrap_or_else(PoisonError::into_inner);
        let packets = Packets::no_wider(rays, widest);
        let ray_bytes = (4 * PACKET * RAY_WORDS.max(HIT_WORDS + asked.features())) as u64;
        let most = (self.gpu.most_binding / ray_bytes).clamp(1, u64::from(MAX_PACKETS)) as u32;
        let mut made = Vec::new();
        for group in &packets.groups {
            let cones = cones(group);
            let all = group.packets.len() as u32;
            let mut todo: Vec<Range<u32>> =
                (0..all).step_by(most as usize).map(|first| first..all.min(first + most)).collect();
            while let Some(range) = todo.pop() {
                let part = Part { group, packets: range.clone(), cones: &cones, asked };
                let numbers = ray_words(rays, &packets, &part);
                match self.run(&mut working, &part, &numbers, &mut made)? {
                    TraceOutcome::Whole => take(&mut hits, &packets, &part, &made),
                    TraceOutcome::TooMany => {
                        let middle = range.start + (range.end - range.start) / 2;
                        todo.extend([middle..range.end, range.start..middle]);
                    }
                    TraceOutcome::TooLong => return Ok(None),
                }
            }
        }
        Ok(Some(hits))
    }

    /// Traces some packets; grows the lists until they are large enough.
    fn run(
        &self,
        working: &mut Working,
        part: &Part<'_>,
        rays: &[f32],
        made: &mut Vec<u32>,
    ) -> Result<TraceOutcome, GpuError> {
        // One packet has at most one entry per splat, for which the lists always have room.
        let most = (self.gpu.most_binding / 4).min(u64::from(self.most_entries)) as u32;
        let most = most.max(self.count);
        working.entries = working.entries.max(self.count.max(1 << 16)).min(most);
        loop {
            let (needed, longest) = self.attempt(working, part, rays, made)?;
            if needed <= working.entries {
                let is_too_long = longest > MAX_ENTRIES_IN_SOFTWARE && self.gpu.kind == AdapterKind::Software;
                return Ok(if is_too_long { TraceOutcome::TooLong } else { TraceOutcome::Whole });
            }
            if needed > most {
                return Ok(TraceOutcome::TooMany);
            }
            working.entries = needed.saturating_add(needed / 4).min(most);
        }
    }

    /// The structures in the order of their slots.
    fn uniforms(&self, part: &Part<'_>, capacity: Capacity) -> Vec<Uniform> {
        let lists = part.packets.len() as u32;
        let mut all = vec![uniforms::view_of_lists(lists, self.count.div_ceil(WORKGROUP), capacity)];
        all.extend(
            [false, true].map(|emits| uniforms::ray_task(part.group, &part.packets, self.count, emits)),
        );
        for of_entries in [false, true] {
            all.extend((0..4).map(|pass| uniforms::sort_pass(8 * pass, of_entries, false)));
        }
        if part.asked.color {
            let piece = |piece: &ColorPiece| uniforms::color_piece(piece.first, piece.count, self.sh_stride);
            all.extend(self.colors.iter().map(piece));
        } else {
            all.push(uniforms::color_piece(0, self.count, self.sh_stride));
        }
        all
    }

    /// Traces some packets with the room that there is; returns the entries that room is needed
    /// for, and those of the longest list.
    fn attempt(
        &self,
        working: &mut Working,
        part: &Part<'_>,
        rays: &[f32],
        made: &mut Vec<u32>,
    ) -> Result<(u32, u32), GpuError> {
        let gpu = &*self.gpu;
        let packets = part.packets.len() as u32;
        let capacity = Capacity { visible: self.count, entries: working.entries };
        let structures = self.uniforms(part, capacity);
        let hit_words = HIT_WORDS + part.asked.features();
        let ray_count = packets as usize * PACKET;
        let kept = &mut working.kept;
        kept.restart();
        let lists = Lists::fit(gpu, kept, &NAMES, self.count.div_ceil(WORKGROUP), capacity, packets)?;
        let mut fit = |what, bytes, usage| kept.fit(gpu, what, bytes, usage);
        let uniforms = fit("structures", UNIFORM_SLOT_BYTES * structures.len() as u64, STRUCTURES)?;
        let cones = fit("cones of rays", size_of_val(part.cones) as u64, WRITTEN)?;
        let feature_bytes = 4 * part.asked.features() as u64 * u64::from(self.count);
        let features = fit("colours of splats", feature_bytes, READ_BACK)?;
        let ray_buffer = fit("rays", size_of_val(rays) as u64, WRITTEN)?;
        let hits = fit("hits of rays", 4 * (hit_words * ray_count) as u64, READ_BACK)?;
        gpu.write(&uniforms, 0, &bytes_of(&structures));
        gpu.write(&cones, 0, bytemuck::cast_slice(part.cones));
        gpu.write(&ray_buffer, 0, bytemuck::cast_slice(rays));

        let buffers =
            RayBuffers { lists: &lists, records: &self.records, cones: &cones, features: &features };
        let mut recorder = Recorder::new(gpu, &uniforms, None);
        recorder.encoder().clear_buffer(&lists.counters, 0, None);
        recorder.begin(Stage::Intersect);
        buffers.count(&mut recorder, self.count);
        spine(&mut recorder, SPINE_VISIBLE, &lists, &lists.blocks);
        buffers.list(&mut recorder, self.count);
        let slots = DISTANCE_PASSES..DISTANCE_PASSES + passes(DISTANCE_BITS) as usize;
        let (_, order) = sort(&mut recorder, &lists, &lists.depth_pairs, VISIBLE_SORT, slots);
        buffers.sum(&mut recorder, order);
        spine(&mut recorder, SPINE_ENTRIES, &lists, &lists.sums);
        buffers.write(&mut recorder, order);
        let slots = PACKET_PASSES..PACKET_PASSES + passes(u32::BITS - packets.leading_zeros()) as usize;
        let (keys, listed) = sort(&mut recorder, &lists, &lists.entry_pairs, ENTRY_SORT, slots);
        ranges(&mut recorder, packets, &lists, keys);
        if part.asked.color {
            for (at, piece) in self.colors.iter().enumerate() {
                buffers.see(&mut recorder, part.asked, FIRST_PIECE_SLOT + at, order, &piece.sh);
            }
        } else if part.asked.normal {
            // Without colours one piece covers all records, and its coefficients are not read.
            buffers.see(&mut recorder, part.asked, FIRST_PIECE_SLOT, order, &lists.counts);
        }
        buffers.blend(&mut recorder, part.asked, packets, listed, &ray_buffer, &hits);
        let mut numbers = [0u32; COUNTER_WORDS as usize];
        made.resize(hit_words * ray_count, 0);
        copy(
            gpu,
            recorder,
            &mut working.staging,
            &mut [
                (&lists.counters, 0, bytemuck::cast_slice_mut(&mut numbers)),
                (&hits, 0, bytemuck::cast_slice_mut(made)),
            ],
        )?;
        let [_, _, _, needed, longest] = numbers;
        Ok((needed, longest))
    }
}

/// Returns the cones of a group's tree in the layout of `touch.wgsl`, level by level.
fn cones(group: &RayGroup) -> Vec<f32> {
    let mut numbers = Vec::new();
    let mut size = group.packets.len();
    for level in &group.levels {
        for at in 0..size {
            let (cones, child) = (&level[at / CHILDREN], at % CHILDREN);
            let [x, y, z] = [0, 1, 2].map(|k| cones.axis[k][child]);
            let own: [f32; CONE_WORDS] = [x, y, z, cones.cos[child], cones.sin[child], 0.0, 0.0, 0.0];
            numbers.extend(own);
        }
        size = size.div_ceil(CHILDREN);
    }
    numbers
}

/// Returns the rays of some packets in the layout of `blend.wgsl`, each packet padded to
/// [`PACKET`].
fn ray_words(rays: &Rays, packets: &Packets, part: &Part<'_>) -> Vec<f32> {
    let mut numbers = Vec::with_capacity(part.packets.len() * PACKET * RAY_WORDS);
    for packet in part.packets.clone() {
        let end = numbers.len() + PACKET * RAY_WORDS;
        for ray in packets.rays(part.group.packets.start + packet as usize) {
            let ray = *ray as usize;
            let ([x, y, z], origin) = (rays.directions[ray], rays.origins[ray]);
            let [u, v, w] = [0, 1, 2].map(|k| origin[k] - part.group.center[k]);
            let own: [f32; RAY_WORDS] = [x, y, z, 1.0, u, v, w, 0.0];
            numbers.extend(own);
        }
        numbers.resize(end, 0.0);
    }
    numbers
}

/// Copies the results of some packets to those of all rays.
fn take(hits: &mut RayHits, packets: &Packets, part: &Part<'_>, made: &[u32]) {
    let words = HIT_WORDS + part.asked.features();
    for (at, of_packet) in made.chunks_exact(words * PACKET).enumerate() {
        let own = packets.rays(part.group.packets.start + part.packets.start as usize + at);
        for (ray, numbers) in own.iter().map(|ray| *ray as usize).zip(of_packet.chunks_exact(words)) {
            hits.coverage[ray] = f32::from_bits(numbers[0]);
            hits.distance[ray] = f32::from_bits(numbers[1]);
            hits.splat[ray] = numbers[2];
            if let Some(value) = hits.value.get_mut(ray) {
                *value = f32::from_bits(numbers[3]);
            }
            let mut sums = numbers[HIT_WORDS..].as_chunks::<3>().0.iter();
            for of in [&mut hits.color, &mut hits.normal] {
                if !of.is_empty()
                    && let Some(sum) = sums.next()
                {
                    of[ray] = sum.map(f32::from_bits);
                }
            }
        }
    }
}
