//! The CPU back end for training: renders stored parameters that change with every step, and gives
//! their gradients.
//!
//! The sweeps of a render, over the same stages, and three more back: over tiles, from pixels to
//! slots ([`rasterize_backward`](crate::stages::rasterize_backward)); over splats in view, from
//! slots to gradients. In the tile lists an entry names the pair of splat and tile; pairs are
//! numbered splat by splat, so that a splat's slots are found and added in one order, whatever the
//! threads did.

mod back;
mod front;
mod gather;

use super::back::Worker;
use super::front::{Part, scatter};
use super::pool::start;
use crate::config::CpuConfig;
use crate::differentiable::{Differentiable, ForwardConfig, Upstream};
use crate::error::RenderError;
use crate::frame::Frame;
use crate::gradients::{Gradients, Learn};
use crate::hooks::PATCH_PIXELS;
use crate::renderer::Stats;
use crate::simd::SimdPath;
use crate::stages::intersect::{PATCHES_PER_TILE, TileGrid, cpu as intersect};
use crate::stages::project::{ProjectCamera, Record};
use crate::stages::rasterize_backward::GradientSlot;
use back::{BackwardWorker, Tiles};
use front::{Front, Unit};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU32, AtomicU64};
use std::sync::{Arc, Mutex};
use web_time::Instant;
use wm_scene::{Camera, Splats};

/// The CPU back end of training. It holds no copy of the parameters, only its working memory and
/// what the backward pass needs of the last forward pass.
pub struct CpuDifferentiable {
    path: SimdPath,
    pool: Arc<rayon::ThreadPool>,
    records: Vec<Record>,
    parts: Vec<Part>,
    bounds: Vec<u32>,
    /// Tile by tile, sorted: `pair << 32 | record << 4 | patches`.
    entries: Vec<AtomicU64>,
    /// `record << 4 | patches` of each pair.
    words: Vec<AtomicU32>,
    /// The slot of each pair.
    places: Vec<AtomicU32>,
    slots: Vec<GradientSlot>,
    /// Tile by tile, patch by patch: alpha and the sums, in block order.
    kept: Vec<[f32; PATCH_PIXELS]>,
    workers: Vec<Mutex<Worker>>,
    backward_workers: Vec<Mutex<BackwardWorker>>,
    last: Option<View>,
}

/// The view of the last forward pass.
#[derive(Clone, Copy)]
struct View {
    camera: Camera,
    config: ForwardConfig,
    splats: usize,
    visible: usize,
}

impl CpuDifferentiable {
    /// Starts the threads.
    ///
    /// # Errors
    /// [`RenderError`] if the processor lacks the SIMD path or threads cannot be started.
    pub fn new(config: CpuConfig) -> Result<Self, RenderError> {
        let (path, pool) = start(config)?;
        let threads = pool.current_num_threads();
        Ok(Self {
            path,
            pool,
            records: Vec::new(),
            parts: Vec::new(),
            bounds: Vec::new(),
            entries: Vec::new(),
            words: Vec::new(),
            places: Vec::new(),
            slots: Vec::new(),
            kept: Vec::new(),
            workers: (0..threads).map(|_| Mutex::default()).collect(),
            backward_workers: (0..threads).map(|_| Mutex::default()).collect(),
            last: None,
        })
    }

    fn forward_on_pool(
        &mut self,
        splats: &Splats,
        camera: &Camera,
        config: &ForwardConfig,
        frame: &mut Frame,
    ) -> Stats {
        let started = Instant::now();
        self.last = None;
        let grid = TileGrid::new(camera.width, camera.height);
        let project_camera = ProjectCamera::new(camera);
        let wanted = (8 * self.pool.current_num_threads()).max(32);
        let units = Unit::split(splats.len(), wanted, &mut self.records);
        self.parts.resize_with(units.len(), Part::default);
        let front = Front::new(self.path, splats, &project_camera, config, grid);
        units.into_par_iter().zip(&mut self.parts).for_each(|(unit, part)| front.run(unit, part));

        let mut stats = Stats::default();
        let mut pairs = 0;
        for part in &mut self.parts {
            part.first_pair = pairs;
            pairs += part.pairs.len();
            stats += part.stats;
        }
        let laying = Instant::now();
        intersect::offsets(grid.tiles(), self.parts.iter_mut().map(|part| &mut part.pairs), &mut self.bounds);
        if self.entries.len() < pairs {
            let room = pairs + pairs / 4;
            self.entries.resize_with(room, AtomicU64::default);
            self.words.resize_with(room, AtomicU32::default);
            self.places.resize_with(room, AtomicU32::default);
            self.slots.resize(room, GradientSlot::default());
        }
        stats.intersections = pairs as u64;
        stats.intersect += laying.elapsed().as_secs_f64();
        let (entries, words) = (&self.entries[..], &self.words[..]);
        stats.intersect += scatter(&mut self.parts, |part| {
            part.pairs.scatter_numbered(part.first_pair, entries, words);
        });

        let arrays = grid.tiles() * PATCHES_PER_TILE * (config.channels.count() + 1);
        if self.kept.len() < arrays {
            self.kept.resize(arrays, [0.0; PATCH_PIXELS]);
        }
        let (path, records, bounds) = (self.path, &self.records[..], &self.bounds[..]);
        let tiles = Tiles { path, records, entries, bounds, grid, camera, config };
        tiles.forward(words, &mut self.kept[..arrays], &self.workers, frame, &mut stats);
        self.last = Some(View {
            camera: *camera,
            config: *config,
            splats: splats.len(),
            visible: stats.visible as usize,
        });
        stats.wall = started.elapsed().as_secs_f64();
        stats
    }

    fn backward_on_pool(
        &mut self,
        view: View,
        splats: &Splats,
        upstream: &Upstream<'_>,
        learn: Learn,
        gradients: &mut Gradients,
    ) {
        let View { camera, config, visible, .. } = view;
        let grid = TileGrid::new(camera.width, camera.height);
        let (path, records, entries) = (self.path, &self.records[..], &self.entries[..]);
        let tiles =
            Tiles { path, records, entries, bounds: &self.bounds, grid, camera: &camera, config: &config };
        let workers = &self.backward_workers;
        tiles.backward(upstream, &self.kept, &mut self.slots, &self.places, workers);
        gradients.resize(visible, learn, config.sh_degree);
        let project_camera = ProjectCamera::new(&camera);
        let gather = gather::Gather {
            path: self.path,
            splats,
            camera: &project_camera,
            config: &config,
            learn,
            records: &self.records,
            slots: &self.slots,
            places: &self.places,
        };
        gather.run(&self.parts, gradients);
    }
}

impl Differentiable for CpuDifferentiable {
    fn describe(&self) -> String {
        format!("cpu, {}, {} threads", self.path, self.pool.current_num_threads())
    }

    fn path(&self) -> SimdPath {
        self.path
    }

    fn pool(&self) -> &Arc<rayon::ThreadPool> {
        &self.pool
    }

    fn forward(
        &mut self,
        splats: &Splats,
        camera: &Camera,
        config: &ForwardConfig,
        frame: &mut Frame,
    ) -> Result<Stats, RenderError> {
        config.check(splats, camera, frame)?;
        let pool = Arc::clone(&self.pool);
        Ok(pool.install(|| self.forward_on_pool(splats, camera, config, frame)))
    }

    fn backward(
        &mut self,
        splats: &Splats,
        upstream: &Upstream<'_>,
        learn: Learn,
        gradients: &mut Gradients,
    ) -> Result<(), RenderError> {
        let view = self.last.expect("a backward pass follows a forward pass");
        assert_eq!(view.splats, splats.len(), "the splats are not those of the forward pass");
        upstream.check(view.camera.width as usize * view.camera.height as usize, view.config.channels);
        let learn = view.config.learns(learn);
        let pool = Arc::clone(&self.pool);
        pool.install(|| self.backward_on_pool(view, splats, upstream, learn, gradients));
        Ok(())
    }
}
