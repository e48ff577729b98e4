//! The second sweep: tiles to pixels.

use crate::config::{Geometry, MedianDepth, ParticlePass};
use crate::dispatch;
use crate::frame::{Arrays, CHANNEL_COUNTS, Frame};
use crate::hooks::PATCH;
use crate::plan::DrawPass;
use crate::renderer::{Stats, WEIGHT_UNITS};
use crate::simd::SimdPath;
use crate::stages::composite::cpu::{Composite, OutputRows, PatchPixels, finish_patch};
use crate::stages::intersect::{PATCHES_PER_TILE, TILE, TileGrid, record_of};
use crate::stages::project::Record;
use crate::stages::rasterize::cpu::{BlendScratch, PatchSums, blend_tile};
use crate::stages::sort::cpu::sort;
use rayon::prelude::*;
use std::ops::Add;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use web_time::Instant;

/// Tiles of one task: small enough to share out, large enough to write whole lines.
const TILES_PER_TASK: usize = 4;

/// The sums that are blended beside the colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Features {
    pub(crate) geometry: Geometry,
    pub(crate) median: MedianDepth,
}

impl Features {
    /// The sums that a pass needs: its outputs, and depth where particles or a pixel effect read
    /// it.
    pub(crate) fn of(pass: &DrawPass<'_>) -> Self {
        let asked = pass.config.outputs;
        let effects =
            !(pass.hooks.pixels.is_empty() && pass.particles().is_empty() && pass.surface.is_none());
        let geometry =
            if effects && asked.geometry == Geometry::None { Geometry::Depth } else { asked.geometry };
        // The median of splat indices is found like that of depths.
        let median = match asked.median_depth {
            MedianDepth::Off => MedianDepth::Off,
            MedianDepth::On | MedianDepth::Splat => MedianDepth::On,
        };
        Self { geometry, median }
    }

    /// Returns the number of blended sums.
    pub(crate) fn count(self) -> usize {
        match self.geometry {
            Geometry::None => 3,
            Geometry::Depth => 4,
            Geometry::DepthNormal => 7,
        }
    }
}

/// The arrays that `pass` asks for.
pub(crate) fn arrays(pass: &DrawPass<'_>) -> Arrays {
    let outputs = pass.config.outputs;
    Arrays {
        rgb: true,
        depth: outputs.geometry != Geometry::None,
        median_depth: outputs.median_depth != MedianDepth::Off,
        normal: outputs.geometry == Geometry::DepthNormal,
        particles: outputs.particles == ParticlePass::On,
        front: pass.surface.is_some(),
    }
}

/// The inputs that all tiles of one frame share.
pub(crate) struct Back<'a> {
    pub(crate) path: SimdPath,
    /// The path for code that only moves pixels.
    pub(crate) narrow: SimdPath,
    pub(crate) records: &'a [Record],
    pub(crate) keys: &'a [AtomicU64],
    pub(crate) bounds: &'a [u32],
    pub(crate) grid: TileGrid,
    /// Width and height of the picture, px.
    pub(crate) size: (usize, usize),
    /// Number of blended sums: 3, 4, 7, or 1, see
    /// [`Channels::Depth`](crate::differentiable::Channels).
    pub(crate) sums: usize,
    pub(crate) median: MedianDepth,
    pub(crate) composite: Composite<'a>,
    /// View z of the surface that splits the blend ([`DrawPass::surface`]), `[H, W]`.
    pub(crate) surface: Option<&'a [f32]>,
    pub(crate) workers: &'a [Mutex<Worker>],
}

/// Working memory of one thread, kept from frame to frame.
#[derive(Default)]
pub(crate) struct Worker {
    scratch: BlendScratch,
    pixels: PatchPixels,
    keys: Vec<u64>,
    sort_scratch: Vec<u64>,
}

/// Receives the results of a tile that do not go into the picture.
pub(crate) trait Keep: Send {
    /// Takes the sorted keys of the tile, which `list` holds unsorted.
    fn keys(&mut self, keys: &mut [u64], list: &[AtomicU64]);

    /// Takes the sums of a patch before its pixels are made.
    fn sums(&mut self, patch: usize, sums: &mut PatchSums);
}

/// Keeps nothing.
impl Keep for () {
    fn keys(&mut self, _: &mut [u64], _: &[AtomicU64]) {}

    fn sums(&mut self, _: usize, _: &mut PatchSums) {}
}

impl Worker {
    /// Reads the list of a tile and sorts it.
    fn sort(&mut self, list: &[AtomicU64]) {
        self.keys.clear();
        self.keys.extend(list.iter().map(|key| key.load(Ordering::Relaxed)));
        sort(&mut self.keys, &mut self.sort_scratch);
    }
}

/// Locks the working memory of the current thread.
pub(crate) fn lock_worker<T>(workers: &[Mutex<T>]) -> MutexGuard<'_, T> {
    let thread = rayon::current_thread_index().unwrap_or(0) % workers.len();
    workers[thread].lock().unwrap_or_else(PoisonError::into_inner)
}

impl Back<'_> {
    /// Renders all tiles into `frame` and adds counts and times to `stats`; `kept` has an element
    /// for each tile.
    pub(crate) fn run<K: Keep>(&self, kept: &mut [K], frame: &mut Frame, stats: &mut Stats) {
        let done = bands(frame)
            .into_par_iter()
            .zip(kept.par_chunks_mut(self.grid.columns as usize))
            .enumerate()
            .flat_map_iter(|(band, (rows, kept))| {
                runs(rows)
                    .into_iter()
                    .zip(kept.chunks_mut(TILES_PER_TASK))
                    .enumerate()
                    .map(move |run| (band, run))
            })
            .map(|(band, (run, (mut rows, kept)))| {
                let mut stats = Stats::default();
                let mut worker = lock_worker(self.workers);
                for (i, kept) in kept.iter_mut().enumerate() {
                    let tile = (run * TILES_PER_TASK + i, band);
                    self.tile(&mut worker, tile, i * TILE, kept, &mut rows, &mut stats);
                }
                stats
            })
            .reduce(Stats::default, Stats::add);
        *stats += done;
    }

    /// Returns the unsorted list of a tile.
    fn list(&self, index: usize) -> &[AtomicU64] {
        &self.keys[self.bounds[index] as usize..self.bounds[index + 1] as usize]
    }

    /// Adds the weights of all records to `weights`, one per record, in [`WEIGHT_UNITS`]: integers,
    /// whose sum does not depend on the order of the threads.
    pub(crate) fn weigh(&self, weights: &[AtomicU32]) {
        (0..self.grid.tiles()).into_par_iter().with_min_len(TILES_PER_TASK).for_each(|index| {
            let columns = self.grid.columns as usize;
            let tile = (index % columns, index / columns);
            let mut worker = lock_worker(self.workers);
            worker.sort(self.list(index));
            let Worker { scratch, keys, .. } = &mut *worker;
            let (left, top) = ((tile.0 * TILE) as f32, (tile.1 * TILE) as f32);
            let inside = inside(tile, self.size);
            scratch.weighed = (self.size.0 - tile.0 * TILE, self.size.1 - tile.1 * TILE);
            dispatch!(self.path, s => blend_tile::<_, 1, false, false, true>(s, self.records, keys, left, top, inside, scratch));
            for (key, weight) in keys.iter().zip(&scratch.weights) {
                let units = (*weight * WEIGHT_UNITS).round() as u32;
                if units > 0 {
                    weights[record_of(*key)].fetch_add(units, Ordering::Relaxed);
                }
            }
        });
    }

    fn tile<K: Keep>(
        &self,
        worker: &mut Worker,
        tile: (usize, usize),
        offset: usize,
        kept: &mut K,
        rows: &mut OutputRows<'_>,
        stats: &mut Stats,
    ) {
        let begun = Instant::now();
        let list = self.list(tile.1 * self.grid.columns as usize + tile.0);
        worker.sort(list);
        kept.keys(&mut worker.keys, list);
        let sorted = Instant::now();
        let inside = inside(tile, self.size);
        stats.evaluated_pairs += self.blend(&worker.keys, tile, inside, &mut worker.scratch);
        let blended = Instant::now();
        for patch in (0..PATCHES_PER_TILE).filter(|patch| inside >> patch & 1 == 1) {
            let sums = &mut worker.scratch.patches[patch];
            kept.sums(patch, sums);
            self.finish(sums, tile, patch, &mut worker.pixels, offset, rows);
        }
        stats.sort += (sorted - begun).as_secs_f64();
        stats.rasterize += (blended - sorted).as_secs_f64();
        stats.composite += blended.elapsed().as_secs_f64();
    }

    /// Blends one tile. Not generic over [`Keep`]: it has every form of the kernel for every path,
    /// which is enough to compile once.
    fn blend(&self, keys: &[u64], tile: (usize, usize), inside: u32, scratch: &mut BlendScratch) -> u64 {
        let (left, top) = ((tile.0 * TILE) as f32, (tile.1 * TILE) as f32);
        macro_rules! blend {
            ($sums:literal, $median:literal) => {
                blend!($sums, $median, false)
            };
            ($sums:literal, $median:literal, $split:literal) => {
                dispatch!(self.path, s => blend_tile::<_, $sums, $median, $split, false>(s, self.records, keys, left, top, inside, scratch))
            };
        }
        if let Some(depth) = self.surface {
            for patch in (0..PATCHES_PER_TILE).filter(|patch| inside >> patch & 1 == 1) {
                let (column, row) = (2 * tile.0 + patch % 2, 2 * tile.1 + patch / 2);
                scratch.patches[patch].set_surface(self.path.lanes(), (depth, self.size), column, row);
            }
            return match (self.sums, self.median) {
                (4, MedianDepth::Off) => blend!(4, false, true),
                (4, _) => blend!(4, true, true),
                (_, MedianDepth::Off) => blend!(7, false, true),
                _ => blend!(7, true, true),
            };
        }
        match (self.sums, self.median) {
            (1, _) => blend!(1, false),
            (3, MedianDepth::Off) => blend!(3, false),
            (3, _) => blend!(3, true),
            (4, MedianDepth::Off) => blend!(4, false),
            (4, _) => blend!(4, true),
            (_, MedianDepth::Off) => blend!(7, false),
            _ => blend!(7, true),
        }
    }

    /// Makes pixels of a blended patch of a tile, and writes them into `rows`, in which the tile
    /// begins at column `offset`. Not generic over [`Keep`], like [`Self::blend`].
    fn finish(
        &self,
        sums: &PatchSums,
        tile: (usize, usize),
        patch: usize,
        pixels: &mut PatchPixels,
        offset: usize,
        rows: &mut OutputRows<'_>,
    ) {
        let (right, down) = (patch % 2, patch / 2);
        let (column, row) = (2 * tile.0 + right, 2 * tile.1 + down);
        let corner = (offset + right * PATCH, down * PATCH);
        let composite = &self.composite;
        macro_rules! finish {
            ($lanes:literal) => {
                dispatch!(self.narrow, s => finish_patch::<_, $lanes>(s, composite, sums, column, row, pixels, corner, rows))
            };
        }
        if self.path.lanes() == 16 { finish!(16) } else { finish!(8) }
    }
}

/// Returns a bit for each patch of a tile that holds pixels of a picture of so many columns and
/// rows.
pub(crate) fn inside(tile: (usize, usize), size: (usize, usize)) -> u32 {
    let within =
        |patch: usize| (2 * tile.0 + patch % 2) * PATCH < size.0 && (2 * tile.1 + patch / 2) * PATCH < size.1;
    (0..PATCHES_PER_TILE).map(|patch| u32::from(within(patch)) << patch).sum()
}

/// Splits the rows of a frame into bands of one row of tiles.
fn bands(frame: &mut Frame) -> Vec<OutputRows<'_>> {
    let width = frame.width as usize;
    let count = (frame.height as usize).div_ceil(TILE);
    let mut bands: Vec<OutputRows<'_>> = (0..count).map(|_| OutputRows::default()).collect();
    for (k, array) in frame.arrays_mut().into_iter().enumerate() {
        for (y, row) in array.chunks_mut(width * CHANNEL_COUNTS[k]).enumerate() {
            bands[y / TILE][k].push(row);
        }
    }
    bands
}

/// Splits the rows of a band into runs of tiles.
fn runs(band: OutputRows<'_>) -> Vec<OutputRows<'_>> {
    let mut runs: Vec<OutputRows<'_>> = Vec::new();
    for (k, rows) in band.into_iter().enumerate() {
        for row in rows {
            for (run, part) in row.chunks_mut(TILES_PER_TASK * TILE * CHANNEL_COUNTS[k]).enumerate() {
                if runs.len() <= run {
                    runs.push(OutputRows::default());
                }
                runs[run][k].push(part);
            }
        }
    }
    runs
}
