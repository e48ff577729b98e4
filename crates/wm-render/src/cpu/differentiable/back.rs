//! The sweeps of training over tiles: to pixels, and back from them.

use crate::config::{Background, MedianDepth};
use crate::cpu::back::{Back, Keep, Worker, inside, lock_worker};
use crate::differentiable::{Channels, ForwardConfig, Upstream};
use crate::dispatch;
use crate::frame::Frame;
use crate::hooks::{PATCH, PATCH_PIXELS};
use crate::plan::Shading;
use crate::renderer::Stats;
use crate::simd::SimdPath;
use crate::stages::composite::background::BackgroundView;
use crate::stages::composite::cpu::Composite;
use crate::stages::intersect::{PATCHES_PER_TILE, TILE, TileGrid};
use crate::stages::particles::cpu::Falling;
use crate::stages::project::Record;
use crate::stages::rasterize::cpu::PatchSums;
use crate::stages::rasterize_backward::cpu::{
    BackwardScratch, RenderedPictures, blend_tile_backward, prepare_patch,
};
use crate::stages::rasterize_backward::{GradientSlot, NO_SLOT};
use rayon::prelude::*;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::Relaxed};
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
    pub(super) path: SimdPath,
    pub(super) records: &'a [Record],
    pub(super) entries: &'a [AtomicU64],
    pub(super) bounds: &'a [u32],
    pub(super) grid: TileGrid,
    pub(super) camera: &'a Camera,
    pub(super) config: &'a ForwardConfig,
}

/// The kept sums of a tile, one array after the other, patch by patch; and the record of each pair.
struct TileSums<'a> {
    words: &'a [AtomicU32],
    channels: Channels,
    sums: &'a mut [[f32; PATCH_PIXELS]],
}

impl Keep for TileSums<'_> {
    /// Adds to each key, which names a pair, the record of the pair, and keeps it in the list.
    fn keys(&mut self, keys: &mut [u64], list: &[AtomicU64]) {
        for (key, entry) in keys.iter_mut().zip(list) {
            let pair = *key as u32;
            *key = u64::from(pair) << 32 | u64::from(self.words[pair as usize].load(Relaxed));
            entry.store(*key, Relaxed);
        }
    }

    fn sums(&mut self, patch: usize, sums: &mut PatchSums) {
        let count = self.channels.count();
        let kept = &mut self.sums[patch * (count + 1)..][..count + 1];
        kept[0] = sums.alpha;
        kept[1..].copy_from_slice(&sums.features[..count]);
        if self.channels == Channels::Depth {
            sums.features[3] = sums.features[0];
        }
    }
}

impl Tiles<'_> {
    /// Kept arrays of a tile.
    fn arrays(&self) -> usize {
        PATCHES_PER_TILE * (self.config.channels.count() + 1)
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
        let back = Back {
            path: self.path,
            narrow: self.path.narrow(),
            records: self.records,
            keys: self.entries,
            bounds: self.bounds,
            grid: self.grid,
            size: self.size(),
            sums: self.config.channels.count(),
            median: MedianDepth::Off,
            composite,
            surface: None,
            workers,
        };
        let kept = kept.chunks_mut(self.arrays());
        let mut kept: Vec<TileSums<'_>> =
            kept.map(|sums| TileSums { words, channels: self.config.channels, sums }).collect();
        back.run(&mut kept, frame, stats);
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
            self.backward_tile(index, upstream, kept, slots, places, &mut lock_worker(workers));
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
        let inside = inside(tile, self.size());
        let count = self.config.channels.count();
        let pictures = RenderedPictures { config: self.config, upstream, size: self.size() };
        for patch in (0..PATCHES_PER_TILE).filter(|patch| inside >> patch & 1 == 1) {
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
