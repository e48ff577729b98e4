//! The renderer: uploads, room, and frames that are made again where the room was too small.

use super::buffers::{Extent, Memory, Room};
use super::device::Gpu;
use super::error::GpuError;
use super::hosted;
use super::model::GpuModel;
use super::plan::{Around, Plan};
use super::readback::{Counted, submit};
use super::recorder::{Clock, Recorder};
use super::source::{Behind, Falls, WORKGROUP};
use super::uniforms::{Capacity, Each, bytes_of};
use crate::cpu::{self, Features};
use crate::frame::Frame;
use crate::hooks::{ParticleView, WgslSource};
use crate::plan::{DrawPass, FramePass, FramePlan, Pictures, SplatSource};
use crate::renderer::Models;
use crate::renderer::{CpuConfig, Geometry, MAX_SPLATS, RenderBackend, RenderError, SetId, Stats};
use crate::simd::SimdPath;
use crate::stages::composite::background::BackgroundView;
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
    clock: Option<Clock>,
    falling: Falling,
}

impl GpuRenderer {
    /// A renderer on `gpu`; `host` says how the CPU does its part.
    ///
    /// # Errors
    /// [`RenderError`] if the processor lacks the SIMD path or threads cannot be started.
    pub fn new(gpu: Arc<Gpu>, host: CpuConfig) -> Result<Self, RenderError> {
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

    fn draw(&mut self, pass: &DrawPass<'_>, frame: &mut Frame) -> Result<Stats, RenderError> {
        let started = Instant::now();
        pass.camera.check()?;
        self.gpu.check()?;
        let features = Features::of(pass);
        let arrays = cpu::arrays(pass);
        let size = (pass.camera.width, pass.camera.height);
        frame.prepare(size, pass.encoding(), arrays)?;
        let mut stats = Stats::default();

        let Self { gpu, path, models, memory, room: last, capacity, clock, falling, .. } = self;
        let before = gpu.work();
        let transient = pass.sets.iter().map(|view| match view.splats {
            SplatSource::Loaded(_) => Ok(None),
            SplatSource::Transient(splats) => GpuModel::new(gpu, splats).map(Some),
        });
        let transient = transient.collect::<Result<Vec<_>, _>>()?;
        let mut sets = Vec::with_capacity(pass.sets.len());
        for (i, (view, own)) in pass.sets.iter().zip(&transient).enumerate() {
            let model = match (view.splats, own) {
                (SplatSource::Loaded(set), _) => models.get(set)?,
                (SplatSource::Transient(_), own) => own.as_ref().expect("it was loaded for this pass"),
            };
            let numbers = view.attributes.map(|attributes| hosted::attributes(attributes, &model.source));
            let buffer = memory.attributes(gpu, i, numbers.as_deref().unwrap_or_default())?;
            sets.push((model, buffer, numbers.is_some()));
        }
        let total = sets.iter().map(|(model, ..)| model.source.len()).sum();
        if total > MAX_SPLATS {
            return Err(RenderError::TooMany(total));
        }
        let plan = Plan { pass, sets, features, air: air(gpu, memory, pass)? };
        let backdrop = BackgroundView::of(pass, *path);
        let (behind, behind_numbers) = hosted::behind(&backdrop, size);
        // What the CPU does of the rest of the frame, while the GPU draws the splats.
        let is_apart = behind != Behind::Color || !pass.particles().is_empty();
        let mut found: Option<Around> = None;
        let mut background = Vec::new();
        capacity.start(total, gpu.most_binding(), Each::FRAME);
        // The depth that effects on the CPU need and the frame does not hold.
        let mut hidden = Vec::new();
        if !pass.hooks.pixels.is_empty() && !arrays.depth {
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
                falls: match (pass.particles().is_empty(), arrays.particles) {
                    (true, false) => Falls::Nothing,
                    (false, false) => Falls::InColor,
                    (_, true) => Falls::Apart,
                },
                background: behind_numbers,
            };
            // Let go of first, or nothing that grows is freed.
            *last = None;
            let room = memory.room(gpu, &extent)?;
            gpu.write(&room.uniforms, 0, &bytes_of(&plan.uniforms(*capacity)));
            let mut recorder = plan.record_splats(gpu, &room, clock.as_ref());
            if is_apart {
                recorder.submit();
                recorder = Recorder::new(gpu, &room.uniforms, clock.as_ref());
            }
            let around = match found.take() {
                Some(around) => around,
                None => {
                    background = hosted::background(&backdrop, size);
                    stats.fall = falling.fill(*path, pass.particles(), &ParticleView::new(&pass.camera));
                    let drops = (memory.drops(gpu, &falling.words())?, falling.len() as u32);
                    Around { behind, falls: extent.falls, drops }
                }
            };
            gpu.write(&room.background, 0, bytemuck::cast_slice(&background));
            if around.drops.1 > 0 {
                gpu.write(&room.uniforms, 0, &bytes_of(&[plan.view(around.drops.1, *capacity)]));
            }
            plan.record_around(&mut recorder, &room, &around);
            let pictures = (&mut *frame, &mut hidden);
            let counted = submit(gpu, recorder, (&room, memory), clock.as_ref(), pictures, &mut stats)?;
            if !capacity.grow(counted.visible, counted.entries, gpu.most_binding(), Each::FRAME) {
                *last = Some(room);
                break counted;
            }
            found = Some(around);
        };
        let Counted { visible, entries, walked } = counted;
        stats.visible = visible.into();
        stats.intersections = entries.into();
        stats.evaluated_pairs = u64::from(walked) * u64::from(WORKGROUP);
        hosted::pixel_effects(*path, pass, frame, &hidden);
        stats.particles = falling.len() as u64;
        stats.device = gpu.work().since(before);
        stats.wall = started.elapsed().as_secs_f64();
        Ok(stats)
    }
}

/// The air's text and its parameters on the GPU.
fn air(
    gpu: &Gpu,
    memory: &mut Memory,
    pass: &DrawPass<'_>,
) -> Result<Option<(WgslSource, wgpu::Buffer)>, GpuError> {
    let Some(medium) = pass.hooks.medium else { return Ok(None) };
    let origin = pass.camera.center().to_array().map(|v| v as f32);
    let source = medium.wgsl(origin).ok_or(GpuError::Effect(medium.name()))?;
    let buffer = memory.air(gpu, &source.parameters)?;
    Ok(Some((source, buffer)))
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

    fn execute(&mut self, plan: &FramePlan<'_>, pictures: &mut Pictures) -> Result<Stats, RenderError> {
        let pool = Arc::clone(&self.pool);
        pool.install(|| {
            let started = Instant::now();
            let mut stats = Stats::default();
            pictures.fit(plan.pictures());
            for pass in plan.passes() {
                match pass {
                    FramePass::Draw { target, pass } => stats += self.draw(pass, &mut pictures[*target])?,
                    FramePass::Picture(pass) => pass.run(self.path, pictures),
                }
            }
            stats.wall = started.elapsed().as_secs_f64();
            Ok(stats)
        })
    }
}
