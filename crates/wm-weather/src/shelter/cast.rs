//! Casts splats onto the grid, front to back along the fall, in bands of rows.

use super::Grid;
use super::occluders::Occluder;
use crate::threads::map;
use std::sync::Mutex;

/// Variance of the filter through which a cell sees splats, cells^2: the renderer's of pixels.
pub(super) const FILTER: f64 = wm_render::stages::project::DILATION as f64;
/// Alphas below are nothing.
pub(super) const LEAST_ALPHA: f64 = wm_scene::health::LEAST_OPACITY;
/// Default transmittance below which the fall counts as stopped.
pub(super) const STOPPED: f32 = 0.5;
/// Extent of the most opaque splat, standard deviations: `sqrt(2 ln 255)` and a little.
const MOST_REACH: f64 = 3.4;
/// Rows of a band: a band of a large grid fits the second cache.
const BAND: usize = 32;
/// Splats that are projected at once.
const CHUNK: usize = 1 << 14;

/// A splat on the grid: with `d` from its mean to a cell's middle, in cells, and L L^T its filtered covariance,
/// rows first, `w = L^-1 d`: `alpha = opacity exp(-|w|^2 / 2)`, depth `t + slope . w`.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Footprint {
    /// Column and row of its mean, and its place in that cell: together exact far from the first corner.
    cell: [i32; 2],
    place: [f32; 2],
    /// Of the mean, scene units from the origin.
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
    pub all: Vec<Footprint>,
    rows: Vec<[u32; 2]>,
}

/// Projects occluders, and sorts those that cover a cell by the depth of their means, equal ones by index.
pub(super) fn project(all: &[Occluder], grid: &Grid, threads: usize) -> Footprints {
    // Floats in the order of integers: negative ones are turned round.
    let ordered = |t: f32| {
        let bits = t.to_bits();
        if bits >> 31 == 0 { bits | 1 << 31 } else { !bits }
    };
    let found = map(all.len().div_ceil(CHUNK), threads, |chunk| {
        let splats = all[chunk * CHUNK..].iter().take(CHUNK);
        splats.filter_map(|splat| Footprint::of(splat, grid)).collect::<Vec<_>>()
    })
    .concat();
    let keys = found.iter().enumerate().map(|(i, (it, _))| u64::from(ordered(it.t)) << 32 | i as u64);
    let mut keys: Vec<u64> = keys.collect();
    keys.sort_unstable();
    let (all, rows) = keys.iter().map(|key| found[*key as u32 as usize]).unzip();
    Footprints { all, rows }
}

impl Footprint {
    /// The footprint and its rows; `None` if it covers no cell.
    fn of(splat: &Occluder, grid: &Grid) -> Option<(Self, [u32; 2])> {
        let ([across, down, fall], cell) = (grid.axes, grid.cell);
        let [column, row] =
            [(across, grid.low[0]), (down, grid.low[1])].map(|(axis, low)| (splat.along(axis) - low) / cell);
        // Most are far off in a map of a part of the scene.
        let [xx, _, _, yy, _, zz] = splat.covariance.map(f64::from);
        let area = cell * cell;
        let widest = (xx + yy + zz) / area;
        let far = MOST_REACH * (widest.sqrt() + FILTER.sqrt()) + 1.0;
        let is_off = |at: f64, count: usize| at < -far || at > count as f64 + far;
        // Or so narrow that the filter leaves next to nothing of them.
        let is_faint = f64::from(splat.opacity) * widest < LEAST_ALPHA * (widest + FILTER);
        if is_faint || is_off(column, grid.columns) || is_off(row, grid.rows) {
            return None;
        }
        let [cc, cr, rr] =
            [(across, across), (across, down), (down, down)].map(|(a, b)| splat.between(a, b) / area);
        let (wide_cc, wide_rr) = (cc + FILTER, rr + FILTER);
        let share = (cc * rr - cr * cr).max(0.0) / (wide_cc * wide_rr - cr * cr);
        let opacity = f64::from(splat.opacity) * share.sqrt();
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
    /// Those that reach cells which are clear, out of many that do not.
    pub fn over(&self, grid: &Grid, clear: &[f32]) -> Self {
        // Clear cells above and left of each corner of a cell: any box holds some or none by four of them.
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
            let (left, right) = (column(-(half.ceil() as i32)), column(half.ceil() as i32 + 1));
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

/// First and last of `count` cells whose middle is within `reach` of `at`, cells; `None` if none is.
fn covered(at: f64, reach: f64, count: usize) -> Option<[u32; 2]> {
    let first = (at - reach - 0.5).ceil().max(0.0);
    let last = (at + reach - 0.5).floor().min(count as f64 - 1.0);
    (first <= last).then_some([first as u32, last as u32])
}

/// Fills in the cells that are clear: `clear` is what is left of the fall, 1 at the start, and less than stops it in
/// cells that are done. `stops` comes with the distance that surfaces must be beyond, and leaves with that of the
/// surface, or infinity.
pub(super) fn cast(
    footprints: &Footprints,
    grid: &Grid,
    stops: &mut [f32],
    clear: &mut [f32],
    splats: &mut [u32],
    threads: usize,
) {
    let cells = (BAND * grid.columns).max(1);
    let bands =
        stops.chunks_mut(cells).zip(clear.chunks_mut(cells)).zip(splats.chunks_mut(cells)).enumerate();
    share(bands, threads, |(band, ((stops, clear), splats))| {
        if clear.iter().all(|left| *left < grid.stopped) {
            return;
        }
        let (first, end) = (band * BAND, band * BAND + stops.len() / grid.columns);
        for (footprint, [top, bottom]) in footprints.all.iter().zip(&footprints.rows) {
            let (top, end) = ((*top as usize).max(first), (*bottom as usize + 1).min(end));
            for row in top..end {
                let from = (row - first) * grid.columns;
                let cells = from..from + grid.columns;
                let (stops, splats) = (&mut stops[cells.clone()], &mut splats[cells.clone()]);
                footprint.cover(row, grid.stopped, stops, &mut clear[cells], splats);
            }
        }
        for (stop, left) in stops.iter_mut().zip(clear) {
            if *left >= grid.stopped {
                *stop = f32::INFINITY;
            }
        }
    });
}

impl Footprint {
    /// Covers one row of the grid.
    #[inline]
    fn cover(&self, row: usize, stopped: f32, stops: &mut [f32], clear: &mut [f32], splats: &mut [u32]) {
        let w_row = ((row as i32 - self.cell[1]) as f32 + 0.5 - self.place[1]) / self.row;
        let left = self.reach - w_row * w_row;
        if left < 0.0 {
            return;
        }
        // Columns from that of the mean.
        let (middle, half) = (self.place[0] - 0.5 + self.skew * w_row, self.column * left.sqrt());
        let last = stops.len() as i32 - 1;
        let from = ((middle - half).ceil() as i32).saturating_add(self.cell[0]).max(0);
        let to = ((middle + half).floor() as i32).saturating_add(self.cell[0]).min(last);
        let t = self.t + self.slope[0] * w_row;
        for column in from..=to {
            let cell = column as usize;
            if clear[cell] < stopped {
                continue;
            }
            let w = ((column - self.cell[0]) as f32 - middle) / self.column;
            let depth = t + self.slope[1] * w;
            if depth <= stops[cell] {
                continue;
            }
            clear[cell] *= 1.0 - self.opacity * (-0.5 * (w_row * w_row + w * w)).exp();
            if clear[cell] < stopped {
                stops[cell] = depth;
                splats[cell] = self.splat;
            }
        }
    }
}

/// Does the work of all items, `threads` at once. No item may depend on another.
fn share<T: Send>(items: impl Iterator<Item = T> + Send, threads: usize, work: impl Fn(T) + Sync) {
    let items = Mutex::new(items);
    let run = || {
        loop {
            let next = items.lock().expect("no thread panics while it takes an item").next();
            let Some(item) = next else { break };
            work(item);
        }
    };
    std::thread::scope(|scope| {
        for _ in 1..threads {
            scope.spawn(run);
        }
        run();
    });
}
