//! The renderer: uploads, room, and frames that are made again where the room was too small.

use super::buffers::{Extent, Memory, Room};
use super::device::Gpu;
use super::error::GpuError;
use super::hosted;
use super::model::GpuModel;
use super::plan::Plan;
use super::readback::{Counted, submit};
use super::recorder::Stage;
use super::source::{Behind, Falls, WORKGROUP};
use super::uniforms::{Capacity, Each, bytes_of};
use crate::cpu::{self, Features};
use crate::frame::Frame;
use crate::hooks::{ParticleView, Twin};
use crate::renderer::Models;
use crate::renderer::{CpuConfig, Geometry, Job, MAX_SPLATS, RenderError, Renderer, SetId, Stats};
use crate::simd::SimdPath;
use crate::stages::particles::cpu::Falling;
use std::sync::Arc;
use std::time::Instant;
use wm_scene::Splats;

/// The GPU back end. It keeps its working memory from frame to frame.
pub struct GpuRenderer {
    gpu: Arc<Gpu>,
    /// For what the CPU does of a frame.
    path: SimdPath,
    pool: Arc<rayon::ThreadPool>,
    models: Models<GpuModel>,
    memory: Memory,
    /// That of the last frame.
    room: Option<Room>,
    capacity: Capacity,
    queries: Option<wgpu::QuerySet>,
    falling: Falling,
}

impl GpuRenderer {
    /// A renderer on `gpu`; `host` says how the CPU does its part.
    ///
    /// # Errors
    /// [`RenderError`] if the processor lacks the SIMD path or threads cannot be started.
    pub fn new(gpu: Arc<Gpu>, host: CpuConfig) -> Result<Self, RenderError> {
        let (path, pool) = cpu::start(host)?;
        let queries = gpu.tick().map(|_| {
            gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("times of stages"),
                ty: wgpu::QueryType::Timestamp,
                count: 2 * Stage::COUNT,
            })
        });
        Ok(Self {
            gpu,
            path,
            pool,
            models: Models::default(),
            memory: Memory::default(),
            room: None,
            capacity: Capacity::default(),
            queries,
            falling: Falling::default(),
        })
    }

    /// The GPU.
    #[must_use]
    pub fn gpu(&self) -> &Arc<Gpu> {
        &self.gpu
    }

    /// The threads of the CPU's part.
    #[must_use]
    pub fn pool(&self) -> &rayon::ThreadPool {
        &self.pool
    }

    /// The buffers of the last frame.
    #[cfg(test)]
    pub(crate) fn room(&self) -> Option<&Room> {
        self.room.as_ref()
    }

    fn render_on_pool(&mut self, job: &Job<'_>, frame: &mut Frame) -> Result<Stats, RenderError> {
        let started = Instant::now();
        job.camera.check()?;
        self.gpu.check()?;
        let features = Features::of(job);
        let arrays = cpu::arrays(job);
        let size = (job.camera.width, job.camera.height);
        frame.prepare(size, arrays)?;
        let mut stats = Stats::default();

        let Self { gpu, path, models, memory, room: last, capacity, queries, falling, .. } = self;
        let mut sets = Vec::with_capacity(job.sets.len());
        for (i, view) in job.sets.iter().enumerate() {
            let model = models.get(view.set)?;
            let factors = view.visibility.map(|visibility| hosted::factors(visibility, &model.source));
            let buffer = memory.visibility(gpu, i, factors.as_deref().unwrap_or_default())?;
            sets.push((model, buffer, factors.is_some()));
        }
        let total = sets.iter().map(|(model, ..)| model.source.len()).sum();
        if total > MAX_SPLATS {
            return Err(RenderError::TooMany(total));
        }
        let background = hosted::background(*path, job);
        stats.fall = falling.fill(*path, job.hooks.particles, &ParticleView::new(job.camera));
        stats.particles = falling.len() as u64;
        let plan = Plan {
            job,
            sets,
            features,
            air: air(gpu, memory, job)?,
            behind: if background.len() == 3 { Behind::Color } else { Behind::Picture },
            falls: match (falling.is_empty(), arrays.particles) {
                (true, false) => Falls::Nothing,
                (false, false) => Falls::InColor,
                (_, true) => Falls::Apart,
            },
            drops: (memory.drops(gpu, &falling.words())?, falling.len() as u32),
        };
        capacity.start(total, gpu.most_binding(), Each::FRAME);
        // The depth that effects on the CPU need and the frame does not hold.
        let mut hidden = Vec::new();
        if !job.hooks.pixels.is_empty() && !arrays.depth {
            hidden.resize(frame.pixels(), 0.0);
        }
        let counted = loop {
            let extent = Extent {
                slots: plan.slots(),
                blocks: plan.blocks(),
                capacity: *capacity,
                tiles: plan.tiles(),
                pixels: plan.pixels().into(),
                planes: if arrays.median_depth { 2 } else { u64::from(features.geometry != Geometry::None) },
                normal: arrays.normal,
                falls: plan.falls,
                background: background.len(),
            };
            // Let go of first, or nothing that grows is freed.
            *last = None;
            let room = memory.room(gpu, &extent)?;
            gpu.queue.write_buffer(&room.uniforms, 0, &bytes_of(&plan.uniforms(*capacity)));
            gpu.queue.write_buffer(&room.background, 0, bytemuck::cast_slice(&background));
            let recorder = plan.record(gpu, &room, queries.as_ref());
            let pictures = (&mut *frame, &mut hidden);
            let counted = submit(gpu, recorder, (&room, memory), queries.as_ref(), pictures, &mut stats)?;
            if !capacity.grow(counted.visible, counted.entries, gpu.most_binding(), Each::FRAME) {
                *last = Some(room);
                break counted;
            }
        };
        let Counted { visible, entries, walked } = counted;
        stats.visible = visible.into();
        stats.intersections = entries.into();
        stats.evaluated_pairs = u64::from(walked) * u64::from(WORKGROUP);
        hosted::pixel_effects(*path, job, frame, &hidden);
        stats.wall = started.elapsed().as_secs_f64();
        Ok(stats)
    }
}

/// The air's text and its parameters on the GPU.
fn air(gpu: &Gpu, memory: &mut Memory, job: &Job<'_>) -> Result<Option<(Twin, wgpu::Buffer)>, GpuError> {
    let Some(medium) = job.hooks.medium else { return Ok(None) };
    let origin = job.camera.center().to_array().map(|v| v as f32);
    let twin = medium.twin(origin).ok_or(GpuError::Effect(medium.name()))?;
    let buffer = memory.air(gpu, &twin.parameters)?;
    Ok(Some((twin, buffer)))
}

impl Renderer for GpuRenderer {
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

    fn render(&mut self, job: &Job<'_>, frame: &mut Frame) -> Result<Stats, RenderError> {
        let pool = Arc::clone(&self.pool);
        pool.install(|| self.render_on_pool(job, frame))
    }
}
