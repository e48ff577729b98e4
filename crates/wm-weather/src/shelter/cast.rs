//! Casts splats onto the grid, front to back along the fall, in bands of rows.

use super::grid::Grid;
use super::occluder::Occluder;
use crate::threads::map;
use fearless_simd::{Select, Simd, SimdBase, SimdMask, f32x8, u32x8};
use rayon::prelude::*;
use wm_render::dispatch;
use wm_render::simd::{SimdPath, exp2_unfused};
use wm_render::stages::sort::cpu::sort;

/// Variance of the filter through which a cell sees splats, cells^2: the renderer's of pixels.
pub(super) const FILTER_VARIANCE_CELLS2: f64 = wm_render::stages::project::DILATION as f64;
/// Alphas below are nothing.
pub(super) const LEAST_ALPHA: f64 = wm_scene::health::MIN_OPACITY;
/// Default transmittance below which the fall counts as stopped.
pub(super) const STOPPING_TRANSMITTANCE: f32 = 0.5;
/// Extent of the most opaque splat, standard deviations: `sqrt(2 ln 255)` and a little.
const MOST_REACH: f64 = 3.4;
/// Rows of a band: a band of a large grid fits the second cache.
const BAND_ROW_COUNT: usize = 32;
/// Cells of a row that are covered at once.
const LANES: usize = 8;
const COUNT_UP: [i32; LANES] = [0, 1, 2, 3, 4, 5, 6, 7];
const COUNT_UP_F32: [f32; LANES] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];
/// Footprints after which a band is examined for whether it is done.
const FOOTPRINTS_PER_CHECK: usize = 1 << 12;
/// Splats that are projected at once.
const CHUNK_SPLAT_COUNT: usize = 1 << 14;

/// A splat on the grid: with `d` from its mean to a cell's middle, in cells, and L L^T its filtered
/// covariance, rows first, `w = L^-1 d`: `alpha = opacity exp(-|w|^2 / 2)`, depth `t + slope . w`.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Footprint {
    /// Column and row of its mean, and its place in that cell: together exact far from the first
    /// corner.
    cell: [i32; 2],
    place: [f32; 2],
    /// Distance of the mean, scene units from the origin.
    t: f32,
    /// L: row-row, column-row and column-column, cells.
    row: f32,
    skew: f32,
    column: f32,
    slope: [f32; 2],
    opacity: f32,
    /// |w|^2 at which alpha is the least.
    reach: f32,
    /// The index of the splat.
    splat: u32,
}

/// The footprints in order of depth, and the rows that each covers, first and last.
pub(super) struct Footprints {
    pub(crate) all: Vec<Footprint>,
    rows: Vec<[u32; 2]>,
}

/// Projects occluders, and sorts those that cover a cell by the depth of their means, equal ones by
/// index.
pub(super) fn project(all: &[Occluder], grid: &Grid) -> Footprints {
    // Floats in the order of integers: negative ones are turned round.
    let ordered = |t: f32| {
        let bits = t.to_bits();
        if bits >> 31 == 0 { bits | 1 << 31 } else { !bits }
    };
    let path = SimdPath::widest();
    let found = map(all.len().div_ceil(CHUNK_SPLAT_COUNT), |chunk| {
        let splats = &all[chunk * CHUNK_SPLAT_COUNT..all.len().min((chunk + 1) * CHUNK_SPLAT_COUNT)];
        let mut found = Vec::with_capacity(splats.len());
        dispatch!(path, simd => project_each(simd, splats, grid, &mut found));
        found
    })
    .concat();
    let keys = found.iter().enumerate().map(|(i, (it, _))| u64::from(ordered(it.t)) << 32 | i as u64);
    let mut keys: Vec<u64> = keys.collect();
    sort(&mut keys, &mut Vec::new());
    let (all, rows) = keys.iter().map(|key| found[*key as u32 as usize]).unzip();
    Footprints { all, rows }
}

/// Projects occluders, compiled for a SIMD path: square roots and rounding are single instructions
/// there.
#[inline(always)]
fn project_each<S: Simd>(_: S, splats: &[Occluder], grid: &Grid, found: &mut Vec<(Footprint, [u32; 2])>) {
    for splat in splats {
        found.extend(Footprint::new(splat, grid));
    }
}

impl Footprint {
    /// The footprint and its rows; `None` if it covers no cell.
    #[inline(always)]
    fn new(splat: &Occluder, grid: &Grid) -> Option<(Self, [u32; 2])> {
        let ([across, down, fall], cell) = (grid.axes, grid.cell);
        let [column, row] =
            [(across, grid.low[0]), (down, grid.low[1])].map(|(axis, low)| (splat.along(axis) - low) / cell);
        // Most are far off in a map of a part of the scene.
        let [xx, _, _, yy, _, zz] = splat.covariance.map(f64::from);
        let area = cell * cell;
        let widest = (xx + yy + zz) / area;
        let far = MOST_REACH * (widest.sqrt() + FILTER_VARIANCE_CELLS2.sqrt()) + 1.0;
        let is_off = |at: f64, count: usize| at < -far || at > count as f64 + far;
        // Or so narrow that the filter leaves next to nothing of them.
        let is_faint = f64::from(splat.opacity) * widest < LEAST_ALPHA * (widest + FILTER_VARIANCE_CELLS2);
        if is_faint || is_off(column, grid.columns) || is_off(row, grid.rows) {
            return None;
        }
        let [cc, cr, rr] =
            [(across, across), (across, down), (down, down)].map(|(a, b)| splat.between(a, b) / area);
        let (wide_cc, wide_rr) = (cc + FILTER_VARIANCE_CELLS2, rr + FILTER_VARIANCE_CELLS2);
        let share = (cc * rr - cr * cr).max(0.0) / (wide_cc * wide_rr - cr * cr);
        let mut opacity = f64::from(splat.opacity) * share.sqrt();
        if splat.opacity > 1.0 {
            opacity = 1.0 - (-opacity).exp();
        }
        let reach = 2.0 * (opacity / LEAST_ALPHA).ln();
        if reach.is_nan() || reach <= 0.0 {
            return None;
        }
        let l_row = wide_rr.sqrt();
        let skew = cr / l_row;
        let l_column = (wide_cc - skew * skew).sqrt();
        let rows = covered(row, l_row * reach.sqrt(), grid.rows)?;
        covered(column, wide_cc.sqrt() * reach.sqrt(), grid.columns)?;
        let [with_column, with_row] = [across, down].map(|axis| splat.between(fall, axis) / cell);
        let slope_row = with_row / l_row;
        let slope = [slope_row, (with_column - skew * slope_row) / l_column];
        let footprint = Self {
            cell: [column.floor() as i32, row.floor() as i32],
            place: [column - column.floor(), row - row.floor()].map(|v| v as f32),
            t: splat.along(fall) as f32,
            row: l_row as f32,
            skew: skew as f32,
            column: l_column as f32,
            slope: slope.map(|v| v as f32),
            opacity: opacity as f32,
            reach: reach as f32,
            splat: splat.splat,
        };
        Some((footprint, rows))
    }
}

impl Footprints {
    /// Lists the projections that reach each band of rows, in order.
    fn by_bands(&self, grid: &Grid) -> Vec<Vec<u32>> {
        let mut lists = vec![Vec::new(); grid.rows.div_ceil(BAND_ROW_COUNT)];
        for (index, [top, bottom]) in (0u32..).zip(&self.rows) {
            for list in &mut lists[*top as usize / BAND_ROW_COUNT..=*bottom as usize / BAND_ROW_COUNT] {
                list.push(index);
            }
        }
        lists
    }

    /// Selects the projections that reach cells which are clear, out of many that do not.
    pub(crate) fn over(&self, grid: &Grid, clear: &[f32]) -> Self {
        // Clear cells above and left of each corner of a cell: any box holds some or none by four
        // of them.
        let width = grid.columns + 1;
        let mut sums = vec![0u32; width * (grid.rows + 1)];
        for (row, cells) in clear.chunks(grid.columns.max(1)).enumerate() {
            let mut sum = 0;
            for (column, left) in cells.iter().enumerate() {
                sum += u32::from(*left >= grid.stopped);
                sums[(row + 1) * width + column + 1] = sums[row * width + column + 1] + sum;
            }
        }
        let mut out = Self { all: Vec::new(), rows: Vec::new() };
        for (footprint, rows) in self.all.iter().zip(&self.rows) {
            let half = footprint.skew.hypot(footprint.column) * footprint.reach.sqrt() + 1.0;
            let column =
                |to: i32| footprint.cell[0].saturating_add(to).clamp(0, grid.columns as i32) as usize;
            let (left, right) =
                (column(-(half.ceil() as i32)), column((half.ceil() as i32).saturating_add(1)));
            let [top, bottom] = [rows[0] as usize * width, (rows[1] as usize + 1) * width];
            // Empty boxes have their last row above their first.
            if sums[bottom + right] + sums[top + left] > sums[bottom + left] + sums[top + right] {
                out.all.push(*footprint);
                out.rows.push(*rows);
            }
        }
        out
    }
}

/// First and last of `count` cells whose middle is within `reach` of `at`, cells; `None` if none
/// is.
#[inline(always)]
fn covered(at: f64, reach: f64, count: usize) -> Option<[u32; 2]> {
    let first = (at - reach - 0.5).ceil().max(0.0);
    let last = (at + reach - 0.5).floor().min(count as f64 - 1.0);
    (first <= last).then_some([first as u32, last as u32])
}

/// Fills in the cells that are clear: `clear` is what is left of the fall, 1 at the start, and less
/// than stops it in cells that are done. `stops` comes with the distance that surfaces must be
/// beyond, and leaves with that of the surface, or infinity.
pub(super) fn cast(
    footprints: &Footprints,
    grid: &Grid,
    stops: &mut [f32],
    clear: &mut [f32],
    splats: &mut [u32],
) {
    let columns = grid.columns;
    let cells = (BAND_ROW_COUNT * columns).max(1);
    let (stops, clear) = (stops.par_chunks_mut(cells), clear.par_chunks_mut(cells));
    let bands = stops.zip(clear).zip(splats.par_chunks_mut(cells)).enumerate();
    let (path, lists) = (SimdPath::widest(), footprints.by_bands(grid));
    bands.for_each(|(number, ((stops, clear), splats))| {
        if clear.iter().all(|left| *left < grid.stopped) {
            return;
        }
        let mut band = Band::new(number * BAND_ROW_COUNT, columns, grid.stopped, stops, clear, splats);
        for list in lists[number].chunks(FOOTPRINTS_PER_CHECK) {
            dispatch!(path, simd => band.cover(simd, footprints, list));
            if !band.is_open() {
                break;
            }
        }
        band.copy_to(stops, clear, splats);
        for (stop, left) in stops.iter_mut().zip(clear) {
            if *left >= grid.stopped {
                *stop = f32::INFINITY;
            }
        }
    });
}

/// A band of rows that is cast, each row with room behind it for whole vectors.
struct Band {
    /// First row of the band.
    first: usize,
    columns: usize,
    stride: usize,
    stopped: f32,
    stops: Vec<f32>,
    clear: Vec<f32>,
    splats: Vec<u32>,
}

impl Band {
    fn new(first: usize, columns: usize, stopped: f32, stops: &[f32], clear: &[f32], splats: &[u32]) -> Self {
        let stride = columns + LANES;
        // Nothing is open behind a row.
        Self {
            first,
            columns,
            stride,
            stopped,
            stops: padded(stops, columns, f32::INFINITY),
            clear: padded(clear, columns, 0.0),
            splats: padded(splats, columns, 0),
        }
    }

    /// Returns true if something still falls through a cell.
    fn is_open(&self) -> bool {
        self.clear.iter().any(|left| *left >= self.stopped)
    }

    /// Copies its cells back, without the room behind its rows.
    fn copy_to(&self, stops: &mut [f32], clear: &mut [f32], splats: &mut [u32]) {
        for row in 0..stops.len() / self.columns {
            let (to, from) = (row * self.columns, row * self.stride);
            let (to, from) = (to..to + self.columns, from..from + self.columns);
            stops[to.clone()].copy_from_slice(&self.stops[from.clone()]);
            clear[to.clone()].copy_from_slice(&self.clear[from.clone()]);
            splats[to].copy_from_slice(&self.splats[from]);
        }
    }

    /// Covers its cells with some footprints.
    #[inline(always)]
    fn cover<S: Simd>(&mut self, simd: S, footprints: &Footprints, list: &[u32]) {
        let end = self.first + self.stops.len() / self.stride;
        // No closures in here: they would be compiled without the path's instructions.
        for index in list {
            let (it, [top, bottom]) = (&footprints.all[*index as usize], footprints.rows[*index as usize]);
            for row in (top as usize).max(self.first)..(bottom as usize + 1).min(end) {
                let w_row = ((row as i32).saturating_sub(it.cell[1]) as f32 + 0.5 - it.place[1]) / it.row;
                let left = it.reach - w_row * w_row;
                if left < 0.0 {
                    continue;
                }
                // Columns from that of the mean.
                let (middle, half) = (it.place[0] - 0.5 + it.skew * w_row, it.column * left.sqrt());
                let last = self.columns as i32 - 1;
                let from = ((middle - half).ceil() as i32).saturating_add(it.cell[0]).max(0);
                let to = ((middle + half).floor() as i32).saturating_add(it.cell[0]).min(last);
                let start = (row - self.first) * self.stride;
                let t = it.t + it.slope[0] * w_row;
                let mut column = from;
                while column <= to {
                    let at = start + column as usize;
                    let open = f32x8::from_slice(simd, &self.clear[at..at + LANES]);
                    let is_open = open.simd_ge(f32x8::splat(simd, self.stopped));
                    if is_open.any_true() {
                        let first = column.saturating_sub(it.cell[0]).min(i32::MAX - LANES as i32);
                        let aside = COUNT_UP.map(|k| (first + k) as f32);
                        let is_within = f32x8::from_slice(simd, &COUNT_UP_F32)
                            .simd_le(f32x8::splat(simd, (to - column) as f32));
                        let w = (f32x8::from_slice(simd, &aside) - middle) / f32x8::splat(simd, it.column);
                        let depth = w * it.slope[1] + t;
                        let beyond = f32x8::from_slice(simd, &self.stops[at..at + LANES]);
                        let is_met = is_open & is_within & depth.simd_gt(beyond);
                        let power = (w * w + w_row * w_row) * (-0.5 * std::f32::consts::LOG2_E);
                        let passed = f32x8::splat(simd, 1.0) - exp2_unfused(simd, power) * it.opacity;
                        let passes = is_met.select(open * passed, open);
                        let is_stopped = is_met & passes.simd_lt(f32x8::splat(simd, self.stopped));
                        passes.store_slice(&mut self.clear[at..at + LANES]);
                        if is_stopped.any_true() {
                            is_stopped.select(depth, beyond).store_slice(&mut self.stops[at..at + LANES]);
                            let known = u32x8::from_slice(simd, &self.splats[at..at + LANES]);
                            let own = u32x8::splat(simd, it.splat);
                            is_stopped.select(own, known).store_slice(&mut self.splats[at..at + LANES]);
                        }
                    }
                    column += LANES as i32;
                }
            }
        }
    }
}

/// The rows of a band, with so much behind each that vectors from any cell on are whole.
fn padded<T: Copy>(rows: &[T], columns: usize, behind: T) -> Vec<T> {
    let mut out = Vec::with_capacity(rows.len() / columns.max(1) * (columns + LANES));
    for row in rows.chunks(columns.max(1)) {
        out.extend_from_slice(row);
        out.extend([behind; LANES]);
    }
    out
}
