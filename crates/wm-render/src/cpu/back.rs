//! The second sweep: tiles to pixels.

use crate::config::{Geometry, MedianDepth, ParticlePass};
use crate::dispatch;
use crate::frame::{Arrays, Frame};
use crate::hooks::PATCH;
use crate::plan::DrawPass;
use crate::renderer::{Stats, WEIGHT_UNITS};
use crate::simd::SimdPath;
use crate::stages::composite::cpu::{Composite, OutputRows, PatchPixels, finish_patch};
use crate::stages::intersect::{PATCHES, TILE, TileGrid, record_of};
use crate::stages::project::Record;
use crate::stages::rasterize::cpu::{BlendScratch, PatchSums, Surface, blend_tile};
use crate::stages::sort::cpu::sort;
use rayon::prelude::*;
use std::ops::Add;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use web_time::Instant;

/// Tiles of one task: small enough to share out, large enough to write whole lines.
pub(crate) const RUN: usize = 4;

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
        // Blending treats a splat index like a depth.
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
    pub(crate) features: Features,
    pub(crate) composite: Composite<'a>,
    /// View z of the surface that splits the blend ([`DrawPass::surface`]), `[H, W]`.
    pub(crate) surface: Option<&'a [f32]>,
    pub(crate) workers: &'a [Mutex<Worker>],
}

/// Working memory of one thread, kept from frame to frame.
#[derive(Default)]
pub(crate) struct Worker {
    pub(crate) scratch: BlendScratch,
    pub(crate) pixels: PatchPixels,
    pub(crate) keys: Vec<u64>,
    pub(crate) sort_scratch: Vec<u64>,
}

impl Worker {
    /// Reads the list of a tile and sorts it.
    pub(crate) fn sort(&mut self, list: &[AtomicU64]) {
        self.keys.clear();
        self.keys.extend(list.iter().map(|key| key.load(Ordering::Relaxed)));
        sort(&mut self.keys, &mut self.sort_scratch);
    }
}

/// Locks the working memory of the current thread.
pub(crate) fn own<T>(workers: &[Mutex<T>]) -> MutexGuard<'_, T> {
    let thread = rayon::current_thread_index().unwrap_or(0) % workers.len();
    workers[thread].lock().unwrap_or_else(PoisonError::into_inner)
}

impl Back<'_> {
    /// Renders all tiles into `frame` and adds counts and times to `stats`.
    pub(crate) fn run(&self, frame: &mut Frame, stats: &mut Stats) {
        let width = frame.width as usize;
        let bands = bands(frame, width);
        let done = bands
            .into_par_iter()
            .enumerate()
            .flat_map_iter(|(band, rows)| runs(rows).into_iter().enumerate().map(move |run| (band, run)))
            .map(|(band, (run, mut rows))| {
                let mut stats = Stats::default();
                let mut worker = own(self.workers);
                let first = run * RUN;
                let last = (first + RUN).min(self.grid.columns as usize);
                for column in first..last {
                    self.tile(&mut worker, (column, band), (column - first) * TILE, &mut rows, &mut stats);
                }
                stats
            })
            .reduce(Stats::default, Stats::add);
        *stats += done;
    }

    /// Adds the weights of all records to `weights`, one per record, in [`WEIGHT_UNITS`]: integers,
    /// whose sum does not depend on the order of the threads.
    pub(crate) fn weigh(&self, weights: &[AtomicU32]) {
        (0..self.grid.tiles()).into_par_iter().with_min_len(RUN).for_each(|index| {
            let columns = self.grid.columns as usize;
            let tile = (index % columns, index / columns);
            let list = &self.keys[self.bounds[index] as usize..self.bounds[index + 1] as usize];
            let mut worker = own(self.workers);
            worker.sort(list);
            let Worker { scratch, keys, .. } = &mut *worker;
            let (left, top) = ((tile.0 * TILE) as f32, (tile.1 * TILE) as f32);
            let inside = inside(tile.0, tile.1, self.size.0, self.size.1);
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

    fn tile(
        &self,
        worker: &mut Worker,
        tile: (usize, usize),
        offset: usize,
        rows: &mut OutputRows<'_>,
        stats: &mut Stats,
    ) {
        let begun = Instant::now();
        let index = tile.1 * self.grid.columns as usize + tile.0;
        let list = &self.keys[self.bounds[index] as usize..self.bounds[index + 1] as usize];
        worker.sort(list);
        let sorted = Instant::now();
        let inside = inside(tile.0, tile.1, self.size.0, self.size.1);
        let (keys, scratch) = (&worker.keys[..], &mut worker.scratch);
        stats.evaluated_pairs += blend(
            self.path,
            self.features.count(),
            self.features.median,
            self.records,
            keys,
            tile,
            inside,
            self.surface.map(|z| (z, self.size)),
            scratch,
        );
        let blended = Instant::now();
        for patch in (0..PATCHES).filter(|patch| inside >> patch & 1 == 1) {
            let sums = &worker.scratch.patches[patch];
            finish(self.narrow, &self.composite, sums, tile, patch, &mut worker.pixels, offset, rows);
        }
        stats.sort += (sorted - begun).as_secs_f64();
        stats.rasterize += (blended - sorted).as_secs_f64();
        stats.composite += blended.elapsed().as_secs_f64();
    }
}

/// Blends one tile with `features` sums (3, 4, 7, or 1: see
/// [`Channels::Depth`](crate::differentiable::Channels)) and perhaps the median depth. One function
/// for all callers, since every form of it is compiled for every path.
#[allow(clippy::too_many_arguments, reason = "few callers; a struct would only repeat the names")]
pub(crate) fn blend(
    path: SimdPath,
    features: usize,
    median: MedianDepth,
    records: &[Record],
    keys: &[u64],
    tile: (usize, usize),
    inside: u32,
    surface: Option<Surface<'_>>,
    scratch: &mut BlendScratch,
) -> u64 {
    let (left, top) = ((tile.0 * TILE) as f32, (tile.1 * TILE) as f32);
    macro_rules! blend {
        ($features:literal, $median:literal) => {
            blend!($features, $median, false)
        };
        ($features:literal, $median:literal, $split:literal) => {
            dispatch!(path, s => blend_tile::<_, $features, $median, $split, false>(s, records, keys, left, top, inside, scratch))
        };
    }
    if let Some(surface) = surface {
        for patch in (0..PATCHES).filter(|patch| inside >> patch & 1 == 1) {
            let (column, row) = (2 * tile.0 + patch % 2, 2 * tile.1 + patch / 2);
            scratch.patches[patch].set_surface(path.lanes(), surface, column, row);
        }
        return match (features, median) {
            (4, MedianDepth::Off) => blend!(4, false, true),
            (4, _) => blend!(4, true, true),
            (_, MedianDepth::Off) => blend!(7, false, true),
            _ => blend!(7, true, true),
        };
    }
    match (features, median) {
        (1, _) => blend!(1, false),
        (3, MedianDepth::Off) => blend!(3, false),
        (3, _) => blend!(3, true),
        (4, MedianDepth::Off) => blend!(4, false),
        (4, _) => blend!(4, true),
        (_, MedianDepth::Off) => blend!(7, false),
        _ => blend!(7, true),
    }
}

/// Returns a bit for each patch of tile `(column, row)` that holds pixels of a picture of `width` x
/// `height` px.
pub(crate) fn inside(column: usize, row: usize, width: usize, height: usize) -> u32 {
    let within =
        |patch: usize| (2 * column + patch % 2) * PATCH < width && (2 * row + patch / 2) * PATCH < height;
    (0..PATCHES).map(|patch| u32::from(within(patch)) << patch).sum()
}

/// Makes pixels of a blended patch of a tile, and writes them into `rows`, in which the tile begins
/// at column `offset`. `narrow` is the path that moves pixels. One function for all callers, as
/// [`blend`].
#[allow(clippy::too_many_arguments, reason = "few callers; a struct would only repeat the names")]
pub(crate) fn finish(
    narrow: SimdPath,
    composite: &Composite<'_>,
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
    macro_rules! finish {
        ($lanes:literal) => {
            dispatch!(narrow, s => finish_patch::<_, $lanes>(s, composite, sums, column, row, pixels, corner, rows))
        };
    }
    if composite.path.lanes() == 16 { finish!(16) } else { finish!(8) }
}

/// Splits the rows of a frame into bands of one row of tiles.
pub(crate) fn bands(frame: &mut Frame, width: usize) -> Vec<OutputRows<'_>> {
    let count = (frame.height as usize).div_ceil(TILE);
    let mut bands: Vec<OutputRows<'_>> = (0..count).map(|_| OutputRows::default()).collect();
    let Frame { rgb, alpha, depth, median_depth, normal, particles, front, .. } = frame;
    let arrays = [rgb, alpha, depth, median_depth, normal, particles, front];
    for (k, array) in arrays.into_iter().enumerate() {
        for (y, row) in array.chunks_mut(width * OutputRows::CHANNELS[k]).enumerate() {
            bands[y / TILE].array(k).push(row);
        }
    }
    bands
}

/// Splits the rows of a band into runs of tiles.
pub(crate) fn runs(band: OutputRows<'_>) -> Vec<OutputRows<'_>> {
    let mut runs: Vec<OutputRows<'_>> = Vec::new();
    let mut band = band;
    for (k, channels) in OutputRows::CHANNELS.into_iter().enumerate() {
        for row in std::mem::take(band.array(k)) {
            for (run, part) in row.chunks_mut(RUN * TILE * channels).enumerate() {
                if runs.len() <= run {
                    runs.push(OutputRows::default());
                }
                runs[run].array(k).push(part);
            }
        }
    }
    runs
}
