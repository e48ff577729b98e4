//! The CPU back end: the stages in order over threads.
//!
//! Two parallel sweeps a frame. `front` runs over clusters of splats in model order: cull, project,
//! shade, intersect, all while 256 splats are in the first cache. Then the lists of the tiles are
//! laid out and filled. `back` runs over tiles: sort, blend, finish, each tile in the first cache.
//! No value depends on which thread did what, so the bytes are the same for any number of threads.
//!
//! | sweep | stage | work |
//! |---|---|---|
//! | clusters of 256 splats | [`project`](crate::stages::project) | culls; makes 2D Gaussians |
//! | | [`shade`](crate::stages::shade) | colours by direction, relit, then through the air |
//! | | [`intersect`](crate::stages::intersect) | tests splats against tiles and their patches |
//! | before the tiles | [`particles`](crate::stages::particles) | the drops in view, by the patches that they touch |
//! | tiles of 32x32 px | [`sort`](crate::stages::sort) | by depth |
//! | | [`rasterize`](crate::stages::rasterize) | blends colour, depth and normal in one pass, block by block |
//! | | [`composite`](crate::stages::composite) | background, particles, pixel effects, output |

mod back;
mod differentiable;
mod front;
pub mod model;
mod pool;

pub use differentiable::CpuDifferentiable;
pub use pool::pool;
pub(crate) use pool::start;

use crate::budget::FrameBudget;
use crate::config::{CpuConfig, SetId};
use crate::error::Listed;
use crate::error::RenderError;
use crate::frame::Frame;
use crate::hooks::{Hooks, ParticleView};
use crate::plan::{DrawPass, FramePass, FramePlan, Pictures};
use crate::renderer::Models;
use crate::renderer::{RenderBackend, Stats, WEIGHT_UNITS, check_count, check_weighed, transient};
use crate::simd::SimdPath;
use crate::stages::composite::{background::BackgroundView, cpu::Composite};
use crate::stages::intersect::{TileGrid, cpu as intersect};
use crate::stages::particles::cpu::Falling;
use crate::stages::project::{ProjectCamera, Record};
use back::{Back, Worker};
pub(crate) use back::{Features, arrays};
use front::{Front, Part, Unit, scatter};
use model::CpuModel;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use web_time::Instant;
use wm_scene::Splats;

/// The CPU back end. It keeps its working memory from frame to frame.
pub struct CpuRenderer {
    pub(crate) path: SimdPath,
    pub(crate) pool: Arc<rayon::ThreadPool>,
    models: Models<CpuModel>,
    records: Vec<Record>,
    parts: Vec<Part>,
    bounds: Vec<u32>,
    keys: Vec<AtomicU64>,
    falling: Falling,
    workers: Vec<Mutex<Worker>>,
}

impl CpuRenderer {
    /// Starts the threads.
    ///
    /// # Errors
    /// [`RenderError`] if the processor lacks the SIMD path or threads cannot be started.
    pub fn new(config: CpuConfig) -> Result<Self, RenderError> {
        let (path, pool) = start(config)?;
        let workers = (0..pool.current_num_threads()).map(|_| Mutex::default()).collect();
        Ok(Self {
            path,
            pool,
            models: Models::default(),
            records: Vec::new(),
            parts: Vec::new(),
            bounds: Vec::new(),
            keys: Vec::new(),
            falling: Falling::default(),
            workers,
        })
    }

    /// Number of threads in use.
    pub(crate) fn threads(&self) -> usize {
        self.pool.current_num_threads()
    }

    fn draw(&mut self, pass: &DrawPass<'_>, target: Target<'_>) -> Result<Stats, RenderError> {
        let started = Instant::now();
        pass.camera.check()?;
        let features = Features::of(pass);
        let mut target = target;
        match &mut target {
            Target::Picture(frame) => {
                frame.prepare(pass.camera.width, pass.camera.height, pass.encoding(), arrays(pass))?;
            }
            Target::Weights(_) => check_weighed(&pass.camera)?,
        }
        let transient = transient(pass, CpuModel::new)?;
        let mut sets = Vec::with_capacity(pass.sets.len());
        for (view, own) in pass.sets.iter().zip(&transient) {
            sets.push((self.models.drawn(view, own.as_ref())?, view.attributes));
        }
        let total: usize = sets.iter().map(|(model, _)| model.source.len()).sum();
        check_count(total)?;
        grow(&mut self.records, total, Record::default);
        let grid = TileGrid::new(pass.camera.width, pass.camera.height);
        let camera = ProjectCamera::new(&pass.camera).part_of(pass.whole.as_ref());
        let units = Unit::split(&sets, (8 * self.threads()).max(32), &mut self.records);
        self.parts.resize_with(units.len(), Part::default);
        let budget = FrameBudget::new(pass.camera.width, pass.camera.height);
        let front = Front::new(self.path, &camera, pass, grid, &budget);
        units.into_par_iter().zip(&mut self.parts).for_each(|(unit, part)| front.run(unit, part));

        budget.check(Listed::Splats)?;

        let mut stats = Stats::default();
        self.parts.iter().for_each(|part| stats += part.stats);
        let laying = Instant::now();
        intersect::offsets(grid.tiles(), self.parts.iter_mut().map(|part| &mut part.pairs), &mut self.bounds);
        let pairs = self.bounds[grid.tiles()] as usize;
        grow(&mut self.keys, pairs, AtomicU64::default);
        stats.intersections = pairs as u64;
        stats.intersect += laying.elapsed().as_secs_f64();
        let keys = &self.keys[..];
        stats.intersect += scatter(&mut self.parts, |part| part.pairs.scatter(keys));

        stats.fall = self.falling.fill(self.path, pass.particles(), &ParticleView::new(&pass.camera))?;
        stats.particles = self.falling.len() as u64;

        let background = BackgroundView::of(pass, self.path);
        let back = Back {
            path: self.path,
            narrow: self.path.narrow(),
            records: &self.records,
            keys,
            bounds: &self.bounds,
            grid,
            size: (pass.camera.width as usize, pass.camera.height as usize),
            sums: features.count(),
            median: features.median,
            surface: pass.surface.map(|surface| surface.depth),
            composite: Composite {
                path: self.path,
                features: features.count(),
                background: &background,
                falling: &self.falling,
                effects: &pass.hooks.pixels,
            },
            workers: &self.workers,
        };
        match target {
            Target::Picture(frame) => back.run(&mut vec![(); grid.tiles()], frame, &mut stats),
            Target::Weights(weights) => {
                let units: Vec<AtomicU32> = (0..total).map(|_| AtomicU32::new(0)).collect();
                back.weigh(&units);
                let mut ends: Vec<(usize, usize)> = vec![(0, 0)];
                for (model, _) in &sets {
                    let (records, splats) = ends[ends.len() - 1];
                    ends.push((records + model.source.len(), splats + model.len));
                }
                weights.clear();
                weights.resize(ends[ends.len() - 1].1, 0.0);
                for part in &self.parts {
                    let first = part.first_record;
                    let set = ends.partition_point(|(records, _)| *records <= first) - 1;
                    let source = &sets[set].0.source;
                    for record in first..first + part.visible() {
                        let splat = source[self.records[record].index as usize] as usize;
                        weights[ends[set].1 + splat] =
                            units[record].load(Ordering::Relaxed) as f32 / WEIGHT_UNITS;
                    }
                }
            }
        }
        stats.wall = started.elapsed().as_secs_f64();
        Ok(stats)
    }
}

/// Makes a list at least `count` long, and a little longer if it has to grow. The contents are
/// lost: the old list is freed first, since both together would be the largest part of a frame's
/// memory.
fn grow<T>(list: &mut Vec<T>, count: usize, new: impl FnMut() -> T) {
    if list.len() < count {
        *list = Vec::new();
        list.reserve_exact(count + count / 8);
        list.resize_with(count + count / 8, new);
    }
}

/// The result of a pass.
enum Target<'a> {
    Picture(&'a mut Frame),
    /// The weight of each splat.
    Weights(&'a mut Vec<f32>),
}

impl RenderBackend for CpuRenderer {
    fn describe(&self) -> String {
        format!("cpu, {}, {} threads", self.path, self.threads())
    }

    fn load(&mut self, splats: &Splats) -> Result<SetId, RenderError> {
        let model = self.pool.install(|| CpuModel::new(splats))?;
        Ok(self.models.add(model))
    }

    fn unload(&mut self, set: SetId) {
        self.models.remove(set);
    }

    fn weigh(&mut self, pass: &DrawPass<'_>, weights: &mut Vec<f32>) -> Result<Stats, RenderError> {
        let pool = Arc::clone(&self.pool);
        // Weather does not count.
        let pass = DrawPass { hooks: Hooks::default(), ..pass.clone() };
        pool.install(|| self.draw(&pass, Target::Weights(weights)))
    }

    fn execute(&mut self, plan: &FramePlan<'_>, pictures: &mut Pictures) -> Result<Stats, RenderError> {
        let pool = Arc::clone(&self.pool);
        pool.install(|| {
            let started = Instant::now();
            let mut stats = Stats::default();
            pictures.fit(plan.pictures);
            for pass in &plan.passes {
                match pass {
                    FramePass::Draw { target, pass } => {
                        stats += self.draw(pass, Target::Picture(&mut pictures[*target]))?;
                    }
                    FramePass::Picture(pass) => pass.run(self.path, pictures),
                }
            }
            stats.wall = started.elapsed().as_secs_f64();
            Ok(stats)
        })
    }
}
