//! The sweeps of training over tiles: to pixels, and back from them.

use crate::config::{Background, MedianDepth};
use crate::cpu::back::{RUN, Worker, bands, blend, finish, inside, own, runs};
use crate::differentiable::{Channels, ForwardConfig, Upstream};
use crate::dispatch;
use crate::frame::Frame;
use crate::hooks::{PATCH, PATCH_PIXELS};
use crate::plan::Shading;
use crate::renderer::Stats;
use crate::simd::SimdPath;
use crate::stages::composite::background::BackgroundView;
use crate::stages::composite::cpu::{Composite, OutputRows};
use crate::stages::intersect::{PATCHES, TILE, TileGrid};
use crate::stages::particles::cpu::Falling;
use crate::stages::project::Record;
use crate::stages::rasterize_backward::cpu::{
    BackwardScratch, RenderedPictures, blend_tile_backward, prepare_patch,
};
use crate::stages::rasterize_backward::{GradientSlot, NO_SLOT};
use rayon::prelude::*;
use std::ops::Add;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::Relaxed};
use web_time::Instant;
use wm_scene::Camera;

/// Working memory of one thread.
#[derive(Default)]
pub(super) struct BackwardWorker {
    scratch: BackwardScratch,
    keys: Vec<u64>,
    places: Vec<u32>,
}

/// The inputs that all tiles of one pass share.
pub(crate) struct Tiles<'a> {
    path: SimdPath,
    records: &'a [Record],
    entries: &'a [AtomicU64],
    bounds: &'a [u32],
    grid: TileGrid,
    camera: &'a Camera,
    config: &'a ForwardConfig,
}

impl<'a> Tiles<'a> {
    /// The tiles of one view.
    pub(crate) fn new(
        path: SimdPath,
        records: &'a [Record],
        entries: &'a [AtomicU64],
        bounds: &'a [u32],
        grid: TileGrid,
        camera: &'a Camera,
        config: &'a ForwardConfig,
    ) -> Self {
        Self { path, records, entries, bounds, grid, camera, config }
    }

    /// Kept arrays of a tile.
    fn arrays(&self) -> usize {
        PATCHES * (self.config.channels.count() + 1)
    }

    /// Width and height of the picture, px.
    fn size(&self) -> (usize, usize) {
        (self.camera.width as usize, self.camera.height as usize)
    }

    /// Sorts and blends all tiles into `frame`. Entries then name records and pairs, and `kept`
    /// holds the sums.
    pub(crate) fn forward(
        &self,
        words: &[AtomicU32],
        kept: &mut [[f32; PATCH_PIXELS]],
        workers: &[Mutex<Worker>],
        frame: &mut Frame,
        stats: &mut Stats,
    ) {
        let background = Background::Color(self.config.background);
        let background = BackgroundView::new(&background, None, Shading::Color, self.camera, self.path);
        let falling = Falling::default();
        let composite = Composite {
            path: self.path,
            features: self.config.channels.count().max(4),
            background: &background,
            falling: &falling,
            effects: &[],
        };
        let (width, columns) = (frame.width as usize, self.grid.columns as usize);
        let done = bands(frame, width)
            .into_par_iter()
            .zip(kept.par_chunks_mut(columns * self.arrays()))
            .enumerate()
            .flat_map_iter(|(band, (rows, kept))| {
                let kept = kept.chunks_mut(RUN * self.arrays());
                runs(rows).into_iter().zip(kept).enumerate().map(move |run| (band, run))
            })
            .map(|(band, (run, (mut rows, kept)))| {
                let mut stats = Stats::default();
                let mut worker = own(workers);
                for (i, kept) in kept.chunks_mut(self.arrays()).enumerate() {
                    let tile = (run * RUN + i, band);
                    self.forward_tile(
                        tile,
                        words,
                        &composite,
                        &mut worker,
                        kept,
                        i * TILE,
                        &mut rows,
                        &mut stats,
                    );
                }
                stats
            })
            .reduce(Stats::default, Stats::add);
        *stats += done;
    }

    #[allow(clippy::too_many_arguments, reason = "few callers; a struct would only repeat the names")]
    fn forward_tile(
        &self,
        tile: (usize, usize),
        words: &[AtomicU32],
        composite: &Composite<'_>,
        worker: &mut Worker,
        kept: &mut [[f32; PATCH_PIXELS]],
        offset: usize,
        rows: &mut OutputRows<'_>,
        stats: &mut Stats,
    ) {
        let begun = Instant::now();
        let index = tile.1 * self.grid.columns as usize + tile.0;
        let list = &self.entries[self.bounds[index] as usize..self.bounds[index + 1] as usize];
        worker.sort(list);
        for (key, entry) in worker.keys.iter_mut().zip(list) {
            let pair = *key as u32;
            *key = u64::from(pair) << 32 | u64::from(words[pair as usize].load(Relaxed));
            entry.store(*key, Relaxed);
        }
        let sorted = Instant::now();
        let (width, height) = self.size();
        let inside = inside(tile.0, tile.1, width, height);
        let (keys, scratch) = (&worker.keys[..], &mut worker.scratch);
        stats.evaluated_pairs += blend(
            self.path,
            self.config.channels.count(),
            MedianDepth::Off,
            self.records,
            keys,
            tile,
            inside,
            None,
            scratch,
        );
        let blended = Instant::now();
        let (channels, narrow) = (self.config.channels, self.path.narrow());
        for patch in (0..PATCHES).filter(|patch| inside >> patch & 1 == 1) {
            let sums = &mut worker.scratch.patches[patch];
            let kept = &mut kept[patch * (channels.count() + 1)..][..channels.count() + 1];
            kept[0] = sums.alpha;
            kept[1..].copy_from_slice(&sums.features[..channels.count()]);
            if channels == Channels::Depth {
                sums.features[3] = sums.features[0];
            }
            finish(narrow, composite, sums, tile, patch, &mut worker.pixels, offset, rows);
        }
        stats.sort += (sorted - begun).as_secs_f64();
        stats.rasterize += (blended - sorted).as_secs_f64();
        stats.composite += blended.elapsed().as_secs_f64();
    }

    /// Sums the derivatives of the pixels over each pair of splat and tile. `places` receives the
    /// slot of each pair.
    pub(crate) fn backward(
        &self,
        upstream: &Upstream<'_>,
        kept: &[[f32; PATCH_PIXELS]],
        slots: &mut [GradientSlot],
        places: &[AtomicU32],
        workers: &[Mutex<BackwardWorker>],
    ) {
        let mut tiles = Vec::with_capacity(self.grid.tiles());
        let mut rest = slots;
        for tile in 0..self.grid.tiles() {
            let (own, others) = rest.split_at_mut((self.bounds[tile + 1] - self.bounds[tile]) as usize);
            rest = others;
            tiles.push(own);
        }
        tiles.into_par_iter().enumerate().for_each(|(index, slots)| {
            let kept = &kept[index * self.arrays()..(index + 1) * self.arrays()];
            self.backward_tile(index, upstream, kept, slots, places, &mut own(workers));
        });
    }

    #[allow(clippy::too_many_arguments, reason = "few callers; a struct would only repeat the names")]
    fn backward_tile(
        &self,
        index: usize,
        upstream: &Upstream<'_>,
        kept: &[[f32; PATCH_PIXELS]],
        slots: &mut [GradientSlot],
        places: &[AtomicU32],
        worker: &mut BackwardWorker,
    ) {
        let tile = (index % self.grid.columns as usize, index / self.grid.columns as usize);
        let BackwardWorker { scratch, keys, places: own_places } = worker;
        let list = self.bounds[index] as usize..self.bounds[index + 1] as usize;
        keys.clear();
        keys.extend(self.entries[list.clone()].iter().map(|entry| entry.load(Relaxed)));
        own_places.resize(keys.len(), NO_SLOT);
        let (left, top) = (tile.0 * TILE, tile.1 * TILE);
        let (width, height) = self.size();
        let inside = inside(tile.0, tile.1, width, height);
        let count = self.config.channels.count();
        let pictures = RenderedPictures { config: self.config, upstream, size: self.size() };
        for patch in (0..PATCHES).filter(|patch| inside >> patch & 1 == 1) {
            let (x, y) = (left + patch % 2 * PATCH, top + patch / 2 * PATCH);
            let kept = &kept[patch * (count + 1)..(patch + 1) * (count + 1)];
            dispatch!(self.path, s => prepare_patch(s, pictures, kept, x, y, patch, scratch));
        }
        let (left, top) = (left as f32, top as f32);
        macro_rules! back {
            ($sums:literal) => {
                dispatch!(self.path, s => blend_tile_backward::<_, $sums>(s, self.records, keys, left, top, inside, scratch, &mut *slots, own_places))
            };
        }
        match count {
            1 => back!(1),
            3 => back!(3),
            4 => back!(4),
            _ => back!(7),
        };
        for (key, place) in keys.iter().zip(own_places) {
            let place = if *place == NO_SLOT { NO_SLOT } else { list.start as u32 + *place };
            places[(*key >> 32) as usize].store(place, Relaxed);
        }
    }
}
