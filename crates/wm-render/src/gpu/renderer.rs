//! The renderer: uploads, room, and frames that are made again where the room was too small.

use super::buffers::{Extent, Memory, Room};
use super::device::Gpu;
use super::hosted;
use super::model::GpuModel;
use super::pass::GpuPass;
use super::readback::{Part, Readback, ReadbackResults, copy};
use super::recorder::{Clock, Recorder};
use super::source::{BLOCK_WORDS, COUNTER_WORDS, WORKGROUP};
use super::uniforms::{Capacity, ItemBytes, Uniform, bytes_of};
use crate::at_once::at_once;
use crate::config::{CpuConfig, SetId};
use crate::cpu;
use crate::error::RenderError;
use crate::hooks::Hooks;
use crate::plan::{DrawPass, FramePass, FramePlan, Pictures};
use crate::renderer::{Models, RenderBackend, Stats, check_count, check_weighed, transient};
use crate::simd::SimdPath;
use crate::stages::particles::cpu::Falling;
use std::sync::Arc;
use web_time::Instant;
use wm_scene::Splats;

/// Most bytes of pictures that are read back together, unless one pass alone has more: pictures in
/// the staging buffer are in memory twice.
const MAX_READBACK_BYTES: u64 = 256 << 20;

/// The GPU back end. It keeps its working memory from frame to frame.
pub struct GpuRenderer {
    pub(crate) gpu: Arc<Gpu>,
    /// The SIMD path of the CPU's part of a frame.
    path: SimdPath,
    pub(crate) pool: Arc<rayon::ThreadPool>,
    models: Models<GpuModel>,
    memory: Memory,
    /// The buffers of the last frame.
    room: Option<Room>,
    capacity: Capacity,
    clock: Option<Clock>,
    falling: Falling,
}

impl GpuRenderer {
    /// Starts a renderer on `gpu`; `host` says how the CPU does its part.
    ///
    /// # Errors
    /// [`RenderError`] if the processor lacks the SIMD path or threads cannot be started.
    pub(crate) fn new(gpu: Arc<Gpu>, host: CpuConfig) -> Result<Self, RenderError> {
        let (path, pool) = cpu::start(host)?;
        let clock = Clock::new(&gpu)?;
        Ok(Self {
            gpu,
            path,
            pool,
            models: Models::default(),
            memory: Memory::default(),
            room: None,
            capacity: Capacity::default(),
            clock,
            falling: Falling::default(),
        })
    }

    /// The buffers of the last frame.
    #[cfg(test)]
    pub(crate) fn room(&self) -> Option<&Room> {
        self.room.as_ref()
    }

    /// Carries out a plan, as [`RenderBackend::execute`] does, and lets others work while the GPU
    /// does.
    ///
    /// # Errors
    /// As of [`RenderBackend::execute`].
    pub(crate) async fn execute_async(
        &mut self,
        plan: &FramePlan<'_>,
        pictures: &mut Pictures,
    ) -> Result<Stats, RenderError> {
        let started = Instant::now();
        self.gpu.check()?;
        let before = self.gpu.work();
        let mut stats = Stats::default();
        pictures.fit(plan.pictures);
        let mut passes = &plan.passes[..];
        while !passes.is_empty() {
            let (batch, later) = passes.split_at(batch_length(passes));
            self.run(batch, pictures, &mut stats).await?;
            passes = later;
        }
        stats.device = self.gpu.work().since(before);
        stats.wall = started.elapsed().as_secs_f64();
        Ok(stats)
    }

    /// Runs passes whose pictures come back together: the draw passes in one submission, or in two
    /// where the CPU has work of its own for them, which it does while the GPU draws the first
    /// splats. Then everything that works on finished pictures, in order.
    async fn run(
        &mut self,
        passes: &[FramePass<'_>],
        pictures: &mut Pictures,
        stats: &mut Stats,
    ) -> Result<(), RenderError> {
        let Self { gpu, path, models, memory, room: last, capacity, clock, falling, .. } = self;
        let (clock, most) = (clock.as_ref(), gpu.most_binding);
        let draws: Vec<&DrawPass<'_>> = passes.iter().filter_map(drawn).collect();
        let transient = draws.iter().map(|pass| transient(pass, |splats| GpuModel::new(gpu, splats)));
        let transient = transient.collect::<Result<Vec<_>, _>>()?;
        memory.start_batch();
        let mut work: Vec<GpuPass<'_>> = Vec::with_capacity(draws.len());
        let mut slots = 0;
        for (pass, transient) in draws.into_iter().zip(&transient) {
            pass.camera.check()?;
            let prepared = GpuPass::new(gpu, memory, *path, models, pass, transient, slots)?;
            check_count(prepared.splats())?;
            capacity.start(prepared.splats(), most, ItemBytes::FRAME);
            slots += prepared.slots();
            work.push(prepared);
        }
        let mut is_hosted = !work.iter().any(GpuPass::is_hosted);
        let way_back = loop {
            if work.is_empty() {
                break None;
            }
            let extents = work.iter().map(|pass| pass.extent(*capacity));
            let extent = Extent { slots, ..extents.fold(Extent::default(), Extent::max) };
            // Let go of first, or nothing that grows is freed.
            *last = None;
            let room = memory.room(gpu, &extent)?;
            let mut way_back = Readback::new(gpu, &mut memory.staging, clock, &work, &room)?;
            let structures = |work: &[GpuPass<'_>], capacity: Capacity| {
                let all: Vec<Uniform> = work.iter().flat_map(|pass| pass.uniforms(capacity)).collect();
                gpu.write(&room.uniforms, 0, &bytes_of(&all));
            };
            structures(&work, *capacity);
            work.iter().for_each(|pass| pass.upload_surface(gpu, &room));
            let mut recorder = Recorder::new(gpu, &room.uniforms, clock);
            for i in 0..work.len() {
                recorder.set_first_slot(work[i].first_slot);
                work[i].record_splats(&mut recorder, &room);
                if !is_hosted && work[i].is_hosted() {
                    recorder.submit();
                    for pass in &mut work {
                        stats.gather += pass.host(gpu, memory, *path, falling)?;
                    }
                    is_hosted = true;
                    // How many particles there are is known only now.
                    structures(&work, *capacity);
                    recorder = Recorder::new(gpu, &room.uniforms, clock);
                    recorder.set_first_slot(work[i].first_slot);
                }
                work[i].record_composite(&mut recorder, &room);
                way_back.record(&mut recorder, &work[i], &room);
            }
            let returned = way_back.submit(gpu, recorder).await?;
            let mut fits = true;
            for counted in returned.counted() {
                fits &= !capacity.grow(counted.visible, counted.entries, most, ItemBytes::FRAME);
            }
            if fits {
                *last = Some(room);
                break Some(returned);
            }
        };
        take(passes, &work, way_back, *path, clock, pictures, stats)
    }
}

impl GpuRenderer {
    fn weigh_on_pool(&mut self, pass: &DrawPass<'_>, weights: &mut Vec<f32>) -> Result<Stats, RenderError> {
        let started = Instant::now();
        self.gpu.check()?;
        pass.camera.check()?;
        check_weighed(&pass.camera)?;
        let before = self.gpu.work();
        let Self { gpu, path, models, memory, room: last, capacity, clock, .. } = self;
        let (clock, most) = (clock.as_ref(), gpu.most_binding);
        // Weather does not count.
        let pass = DrawPass { hooks: Hooks::default(), ..pass.clone() };
        let transient = transient(&pass, |splats| GpuModel::new(gpu, splats))?;
        memory.start_batch();
        let own = GpuPass::new(gpu, memory, *path, models, &pass, &transient, 0)?;
        check_count(own.splats())?;
        capacity.start(own.splats(), most, ItemBytes::FRAME);
        let mut stats = Stats::default();
        loop {
            *last = None;
            let extent = Extent { slots: own.slots(), ..own.extent(*capacity) };
            let room = memory.room(gpu, &extent)?;
            gpu.write(&room.uniforms, 0, &bytes_of(&own.uniforms(*capacity)));
            let mut recorder = Recorder::new(gpu, &room.uniforms, clock);
            own.record_weights(&mut recorder, &room);
            let mut counters = [0u32; COUNTER_WORDS as usize];
            let mut blocks = vec![0u32; BLOCK_WORDS as usize * extent.blocks as usize];
            let mut units = vec![0u32; capacity.visible as usize];
            let parts = [&mut counters[..], &mut blocks, &mut units].map(bytemuck::cast_slice_mut);
            let buffers = [&room.lists.counters, &room.lists.blocks, &room.lists.counts];
            let mut parts: Vec<Part<'_>> =
                buffers.into_iter().zip(parts).map(|(buffer, part)| (buffer, 0, part)).collect();
            copy(gpu, recorder, &mut memory.staging, &mut parts)?;
            let [_, _, visible, entries, _] = counters;
            if !capacity.grow(visible, entries, most, ItemBytes::FRAME) {
                own.weights_of(&blocks, &units, weights);
                *last = Some(room);
                (stats.visible, stats.intersections) = (visible.into(), entries.into());
                break;
            }
        }
        drop(own);
        stats.device = self.gpu.work().since(before);
        stats.wall = started.elapsed().as_secs_f64();
        Ok(stats)
    }
}

/// Takes the pictures of the draw passes out of what came back, and carries out what works on
/// finished pictures, in order.
fn take(
    passes: &[FramePass<'_>],
    work: &[GpuPass<'_>],
    mut returned: Option<ReadbackResults>,
    path: SimdPath,
    clock: Option<&Clock>,
    pictures: &mut Pictures,
    stats: &mut Stats,
) -> Result<(), RenderError> {
    let mut work = work.iter();
    for pass in passes {
        match (pass, &mut returned) {
            (FramePass::Picture(pass), _) => pass.run(path, pictures),
            (FramePass::Draw { target, pass }, Some(returned)) => {
                let drawn = work.next().expect("a draw pass of this batch");
                let frame = &mut pictures[*target];
                frame.prepare(pass.camera.width, pass.camera.height, pass.encoding(), drawn.arrays)?;
                let mut hidden = vec![0.0; if drawn.hides_depth() { frame.pixels() } else { 0 }];
                let counted = returned.take(frame, &mut hidden, clock, stats);
                stats.visible += u64::from(counted.visible);
                stats.intersections += u64::from(counted.entries);
                stats.evaluated_pairs += u64::from(counted.walked) * u64::from(WORKGROUP);
                stats.particles += u64::from(drawn.particles());
                drawn.name_splats(frame);
                hosted::pixel_effects(path, pass, frame, &hidden);
            }
            (FramePass::Draw { .. }, None) => unreachable!("what was drawn comes back"),
        }
    }
    Ok(())
}

/// The draw pass, if it is one.
fn drawn<'a>(pass: &'a FramePass<'_>) -> Option<&'a DrawPass<'a>> {
    match pass {
        FramePass::Draw { pass, .. } => Some(&**pass),
        FramePass::Picture(_) => None,
    }
}

/// Number of passes whose pictures come back together.
fn batch_length(passes: &[FramePass<'_>]) -> usize {
    let mut bytes = 0;
    for (i, pass) in passes.iter().enumerate() {
        let Some(pass) = drawn(pass) else { continue };
        // A surface is uploaded before the first pass, and others would draw over it.
        if bytes > 0 && pass.surface.is_some() {
            return i;
        }
        let arrays = cpu::arrays(pass);
        let own = 4 * arrays.channels() as u64 * u64::from(pass.camera.width) * u64::from(pass.camera.height);
        if bytes > 0 && bytes + own > MAX_READBACK_BYTES {
            return i;
        }
        bytes += own;
    }
    passes.len()
}

impl RenderBackend for GpuRenderer {
    fn describe(&self) -> String {
        self.gpu.describe()
    }

    fn load(&mut self, splats: &Splats) -> Result<SetId, RenderError> {
        let (pool, gpu) = (Arc::clone(&self.pool), Arc::clone(&self.gpu));
        let model = pool.install(|| GpuModel::new(&gpu, splats))?;
        Ok(self.models.add(model))
    }

    fn unload(&mut self, set: SetId) {
        self.models.remove(set);
    }

    fn weigh(&mut self, pass: &DrawPass<'_>, weights: &mut Vec<f32>) -> Result<Stats, RenderError> {
        let pool = Arc::clone(&self.pool);
        pool.install(|| self.weigh_on_pool(pass, weights))
    }

    fn execute(&mut self, plan: &FramePlan<'_>, pictures: &mut Pictures) -> Result<Stats, RenderError> {
        let pool = Arc::clone(&self.pool);
        pool.install(|| at_once(self.execute_async(plan, pictures)))
    }
}
