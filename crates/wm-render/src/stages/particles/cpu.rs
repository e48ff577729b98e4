//! Particles on the CPU: gathered and laid out over threads, added up patch by patch.

use super::{
    DILATION, MAX_COVER, MIN_OPTICAL_DEPTH, MIN_SQUARED_RADIUS, PEAK_COEFFICIENTS, STEPS_PER_OPTICAL_DEPTH,
};
use crate::RenderError;
use crate::budget::{FrameBudget, check_cells};
use crate::dispatch;
use crate::error::Listed;
use crate::frame::MIN_ALPHA;
use crate::hooks::{GROUP, PATCH, PATCH_PIXELS, ParticleGroup, ParticleView, Particles};
use crate::simd::{Lanes, ROUNDING_OFFSET, SimdPath, exp2, log2, srgb_decode, srgb_encode, transpose};
use crate::stages::intersect::cpu::{Ellipse, cell_lanes, cell_mask};
use crate::stages::project::SQRT_HALF_LOG2E;
use fearless_simd::{Select, SimdBase, SimdFloat, SimdMask};
use rayon::prelude::*;
use std::f32::consts::{LN_2, LOG2_E, TAU};
use web_time::Instant;

/// A particle in the picture: `log2 tau = peak - (ux dx)^2 - (vx dx + vy dy)^2`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(64))]
pub(crate) struct ProjectedDrop {
    /// Centre, px.
    pub(crate) mean2d: [f32; 2],
    /// Half the size of its bounding box, px.
    pub(crate) extent: [f32; 2],
    ux: f32,
    vx: f32,
    vy: f32,
    slope_y: f32,
    slope_x: f32,
    /// The distance from its peak to its end, log2.
    reach: f32,
    /// log2 of the optical depth at its centre.
    peak: f32,
    /// View z, scene units.
    pub(crate) depth: f32,
    /// Linear RGB.
    pub(crate) rgb: [f32; 3],
}

impl ProjectedDrop {
    /// From its numbers in the order of [`project`].
    #[inline(always)]
    fn of(n: &[f32; 16]) -> Self {
        Self {
            mean2d: [n[0], n[1]],
            extent: [n[2], n[3]],
            ux: n[4],
            vx: n[5],
            vy: n[6],
            slope_y: n[7],
            slope_x: n[8],
            reach: n[9],
            peak: n[10],
            depth: n[11],
            rgb: [n[12], n[13], n[14]],
        }
    }

    /// Returns the numbers of the drop in the order of `fall.wgsl`.
    #[cfg(feature = "gpu")]
    fn words(&self) -> [f32; 16] {
        let Self { mean2d: [x, y], extent: [width, height], ux, vx, vy, slope_y, slope_x, .. } = *self;
        let Self { reach, peak, depth, rgb: [red, green, blue], .. } = *self;
        [x, y, width, height, ux, vx, vy, slope_y, slope_x, reach, peak, depth, red, green, blue, 0.0]
    }

    /// Projects the particles of a group that are in the picture.
    #[cfg(test)]
    pub(crate) fn project(path: SimdPath, group: &ParticleGroup, view: &ParticleView) -> Vec<Self> {
        let mut numbers = [[0.0; 16]; 16];
        let seen = dispatch!(path, s => project(s, group, view, &mut numbers));
        (0..GROUP).filter(|lane| seen >> lane & 1 == 1).map(|lane| Self::of(&numbers[lane])).collect()
    }

    #[inline(always)]
    fn ellipse(&self) -> Ellipse {
        let Self { mean2d: [x, y], ux, vx, vy, slope_y, slope_x, reach, .. } = *self;
        Ellipse { x, y, ux, vx, vy, slope_y, slope_x, reach }
    }

    /// Calls `hit` with each patch of a grid that its ellipse touches.
    #[inline(always)]
    fn each_patch<S: Lanes>(
        &self,
        simd: S,
        columns: usize,
        rows: usize,
        lanes: (S::F, S::F),
        mut hit: impl FnMut(usize),
    ) {
        const PATCH_SIDE_PX: f32 = PATCH as f32;
        let [left, top] =
            [0, 1].map(|k| ((self.mean2d[k] - self.extent[k]) / PATCH_SIDE_PX).max(0.0) as usize);
        let [right, bottom] = [(0, columns), (1, rows)].map(|(k, count)| {
            (((self.mean2d[k] + self.extent[k]) / PATCH_SIDE_PX).max(0.0) as usize + 1).min(count)
        });
        if right == left + 1 && bottom == top + 1 {
            hit(top * columns + left);
            return;
        }
        let ellipse = self.ellipse();
        for row in (top..bottom).step_by(S::N / 4) {
            for column in (left..right).step_by(4) {
                let (left, top) = (column as f32 * PATCH_SIDE_PX, row as f32 * PATCH_SIDE_PX);
                let mut bits =
                    cell_mask(simd, &ellipse, left, top, PATCH_SIDE_PX, PATCH_SIDE_PX, lanes.0, lanes.1);
                while bits != 0 {
                    let cell = bits.trailing_zeros() as usize;
                    bits &= bits - 1;
                    let (column, row) = (column + cell % 4, row + cell / 4);
                    if column < right && row < bottom {
                        hit(row * columns + column);
                    }
                }
            }
        }
    }
}

#[inline(always)]
fn dot<S: Lanes>(a: &[S::F; 3], b: &[S::F; 3]) -> S::F {
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]))
}

/// The sixteen particles of a group in the picture: the numbers of each one in a row, and a bit for
/// each that is in it.
#[inline(always)]
fn project<S: Lanes>(simd: S, group: &ParticleGroup, view: &ParticleView, out: &mut [[f32; 16]; 16]) -> u32 {
    let mut seen = 0;
    for first in (0..GROUP).step_by(S::N) {
        let mut offset = [simd.set(0.0); 3];
        let mut rgb = offset;
        let mut reach = [offset; 2];
        let mut rotation = [offset; 3];
        for k in 0..3 {
            offset[k] = simd.load(&group.offset[k][first..]);
            rgb[k] = simd.load(&group.rgb[k][first..]);
            for direction in 0..2 {
                reach[direction][k] = simd.load(&group.reach[direction][k][first..]);
            }
            for row in 0..3 {
                rotation[row][k] = simd.set(view.rotation[row][k]);
            }
        }
        let area = simd.load(&group.area[first..]);
        let sigma = simd.load(&group.sigma[first..]);
        let z = dot::<S>(&rotation[2], &offset);
        let is_ahead = z.simd_gt(simd.set(view.near)) & area.simd_gt(simd.set(0.0));
        let per_z = simd.set(1.0) / z.max(simd.set(view.near.max(1e-12)));
        let mut tan = [simd.set(0.0); 2];
        let mut jacobian = [offset; 2];
        for k in 0..2 {
            tan[k] = dot::<S>(&rotation[k], &offset) * per_z;
            for axis in 0..3 {
                jacobian[k][axis] =
                    (rotation[k][axis] - tan[k] * rotation[2][axis]) * (per_z * view.focal[k]);
            }
        }
        let [jx, jy] = &jacobian;
        let variance = sigma * sigma;
        let mut xx = variance * dot::<S>(jx, jx);
        let mut xy = variance * dot::<S>(jx, jy);
        let mut yy = variance * dot::<S>(jy, jy);
        // The determinant without cancellation: needles have next to none. `wedge` adds the squares
        // of the areas that pairs of directions span.
        let [a, b] = [0, 1].map(|k| [dot::<S>(jx, &reach[k]), dot::<S>(jy, &reach[k])]);
        let mut det = xx * yy - xy * xy;
        for [rx, ry] in [a, b] {
            det += xx * ry * ry - xy * rx * ry * 2.0 + yy * rx * rx;
        }
        let wedge = a[0] * b[1] - a[1] * b[0];
        for [rx, ry] in [a, b] {
            xx = rx.mul_add(rx, xx);
            xy = rx.mul_add(ry, xy);
            yy = ry.mul_add(ry, yy);
        }
        det = wedge.mul_add(wedge, det).max(simd.set(0.0)) + (xx + yy) * DILATION + DILATION * DILATION;
        xx += DILATION;
        yy += DILATION;
        let secant = tan[0].mul_add(tan[0], tan[1].mul_add(tan[1], simd.set(1.0))).sqrt();
        let pixels = per_z * per_z * secant * (view.focal[0] * view.focal[1] / TAU);
        let whole = (area * pixels / det.sqrt()).min(simd.set(MAX_COVER)).max(simd.set(1e-30));
        // ln(p / w), and log2 p.
        let mut steeper = simd.set(0.0);
        for coefficient in PEAK_COEFFICIENTS.into_iter().rev() {
            steeper = (steeper + coefficient) * whole;
        }
        let peak = steeper.mul_add(simd.set(LOG2_E), log2(simd, [whole])[0]);
        let radius2 = ((peak - MIN_OPTICAL_DEPTH_LOG2) * (2.0 * LN_2)).max(simd.set(MIN_SQUARED_RADIUS));
        // What lies beyond falls off as the Gaussian does: to the least, or to that of the shortest
        // radius.
        let is_far = radius2.simd_gt(simd.set(MIN_SQUARED_RADIUS));
        let beyond = is_far.select(simd.set(MIN_OPTICAL_DEPTH) / whole, (steeper + 1.0) * MIN_RADIUS_FALLOFF);
        let peak = (peak - log2(simd, [simd.set(1.0) - beyond])[0]).min(simd.set(MAX_OPTICAL_DEPTH_LOG2));
        let extent = [(radius2 * xx).sqrt(), (radius2 * yy).sqrt()];
        let mean2d = [0, 1].map(|k| tan[k].mul_add(simd.set(view.focal[k]), simd.set(view.principal[k])));
        // Written so that NaN is not in it.
        let mut is_in = is_ahead & peak.simd_gt(simd.set(-40.0)) & det.simd_lt(simd.set(f32::MAX));
        for k in 0..2 {
            is_in &= (mean2d[k] + extent[k]).simd_gt(simd.set(0.0));
            is_in &= (mean2d[k] - extent[k]).simd_lt(simd.set(view.size[k]));
        }
        seen |= (is_in.to_bitmask() as u32) << first;
        let per_xx = simd.set(1.0) / xx;
        let vy = (xx / det).sqrt() * SQRT_HALF_LOG2E;
        let slope_y = xy * per_xx;
        let bright = simd.set(MAX_RADIANCE);
        let numbers = [
            mean2d[0],
            mean2d[1],
            extent[0],
            extent[1],
            per_xx.sqrt() * SQRT_HALF_LOG2E,
            -vy * slope_y,
            vy,
            slope_y,
            xy / yy,
            radius2 * (SQRT_HALF_LOG2E * SQRT_HALF_LOG2E),
            peak,
            z,
            rgb[0].max(simd.set(0.0)).min(bright),
            rgb[1].max(simd.set(0.0)).min(bright),
            rgb[2].max(simd.set(0.0)).min(bright),
        ];
        for (number, values) in numbers.iter().zip(out.iter_mut()) {
            number.store_slice(&mut values[first..first + S::N]);
        }
    }
    if seen != 0 {
        transpose(simd, out);
    }
    seen
}

/// The particles that one piece of work finds.
#[derive(Debug, Default)]
struct Part {
    drops: Vec<ProjectedDrop>,
    /// The patches of the first drop, of the second and so on: one at least of each.
    patches: Vec<u32>,
    /// The number that each drop has.
    counts: Vec<u32>,
    seconds: f64,
}

impl Part {
    fn clear(&mut self) {
        self.drops.clear();
        self.patches.clear();
        self.counts.clear();
    }

    #[inline(always)]
    fn add<S: Lanes>(&mut self, simd: S, group: &ParticleGroup, view: &ParticleView, grid: (usize, usize)) {
        let mut numbers = [[0.0; 16]; 16];
        let mut seen = project(simd, group, view, &mut numbers);
        let lanes = cell_lanes(simd);
        while seen != 0 {
            let lane = seen.trailing_zeros() as usize;
            seen &= seen - 1;
            let (drop, before) = (ProjectedDrop::of(&numbers[lane]), self.patches.len());
            drop.each_patch(simd, grid.0, grid.1, lanes, |patch| self.patches.push(patch as u32));
            let count = self.patches.len() - before;
            if count > 0 {
                self.drops.push(drop);
                self.counts.push(count as u32);
            }
        }
    }

    /// Bytes that it takes, with those of the frame's lists that are made of it.
    #[inline]
    fn bytes(&self) -> usize {
        2 * size_of::<u32>() * self.patches.len() + 2 * size_of::<ProjectedDrop>() * self.drops.len()
    }

    /// The drops, each with its patches.
    fn drops(&self) -> impl Iterator<Item = (&ProjectedDrop, &[u32])> {
        let mut rest = &self.patches[..];
        self.drops.iter().zip(&self.counts).map(move |(drop, count)| {
            let (own, others) = rest.split_at(*count as usize);
            rest = others;
            (drop, own)
        })
    }
}

/// The particles of a frame, patch by patch. Kept from frame to frame for its memory.
#[derive(Debug, Default)]
pub(crate) struct Falling {
    /// The first `count` are this frame's.
    drops: Vec<ProjectedDrop>,
    count: usize,
    /// The start of the list of each patch, and the end of the last.
    bounds: Vec<u32>,
    lists: Vec<u32>,
    parts: Vec<Part>,
    grid: (usize, usize),
}

impl Falling {
    /// Returns true if there are no particles.
    pub(crate) fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Number of particles in the picture.
    pub(crate) fn len(&self) -> usize {
        self.count
    }

    /// The particles as the GPU takes them, sixteen numbers each.
    #[cfg(feature = "gpu")]
    pub(crate) fn words(&self) -> Vec<f32> {
        self.drops[..self.count].iter().flat_map(ProjectedDrop::words).collect()
    }

    /// Gathers what `sources` let fall and finds the patches; returns the time of all threads, s.
    ///
    /// # Errors
    /// [`RenderError::TooManyCells`] or [`RenderError::TooMuch`].
    pub(crate) fn fill(
        &mut self,
        path: SimdPath,
        sources: &[&dyn Particles],
        view: &ParticleView,
    ) -> Result<f64, RenderError> {
        self.count = 0;
        if sources.is_empty() {
            return Ok(0.0);
        }
        let [width, height] = [view.size[0] as u32, view.size[1] as u32];
        check_cells(sources.iter().map(|particles| particles.cells(view)).sum(), width, height)?;
        let budget = FrameBudget::new(width, height);
        self.grid = ((view.size[0] as usize).div_ceil(PATCH), (view.size[1] as usize).div_ceil(PATCH));
        let patches = self.grid.0 * self.grid.1;
        let work: Vec<(usize, [i32; 4])> = sources
            .iter()
            .enumerate()
            .flat_map(|(source, particles)| particles.parts(view).into_iter().map(move |part| (source, part)))
            .collect();
        let grid = self.grid;
        if self.parts.len() < work.len() {
            self.parts.resize_with(work.len(), Part::default);
        }
        let parts = &mut self.parts[..work.len()];
        work.par_iter().zip(&mut *parts).for_each(|((source, piece), part)| {
            let begun = Instant::now();
            part.clear();
            let mut is_full = false;
            sources[*source].gather(path, view, *piece, &mut |group| {
                if !is_full {
                    let before = part.bytes();
                    dispatch!(path, s => part.add(s, group, view, grid));
                    is_full = !budget.take(part.bytes() - before);
                }
            });
            part.seconds = begun.elapsed().as_secs_f64();
        });
        budget.check(Listed::Falling)?;
        let laying = Instant::now();
        // Two counting sorts by one thread (atomics of several cost many times as much): of the
        // lists, and of the drops by the first patch of each, so that those of one patch lie
        // together.
        self.bounds.clear();
        self.bounds.resize(patches + 2, 0);
        let mut homes = vec![0; patches + 1];
        for (_, own) in parts.iter().flat_map(Part::drops) {
            homes[own[0] as usize + 1] += 1;
            for patch in own {
                self.bounds[*patch as usize + 2] += 1;
            }
        }
        for patch in 1..=patches {
            self.bounds[patch + 1] += self.bounds[patch];
            homes[patch] += homes[patch - 1];
        }
        self.count = homes[patches] as usize;
        if self.drops.len() < self.count {
            self.drops.resize(self.count, ProjectedDrop::default());
        }
        self.lists.resize(self.bounds[patches + 1] as usize, 0);
        for (drop, own) in parts.iter().flat_map(Part::drops) {
            let home = &mut homes[own[0] as usize];
            self.drops[*home as usize] = *drop;
            for patch in own {
                // The place of the next entry, and in the end where the next list begins.
                let place = &mut self.bounds[*patch as usize + 1];
                self.lists[*place as usize] = *home;
                *place += 1;
            }
            *home += 1;
        }
        Ok(parts.iter().map(|part| part.seconds).sum::<f64>() + laying.elapsed().as_secs_f64())
    }

    /// Draws what falls in patch `(column, row)` over its pixels: display-referred colour, row by
    /// row. `behind`: coverage and sum of weight times view z, block by block as `path` blends.
    /// `apart`, if given, holds zeros, and takes the linear light of what falls and its coverage,
    /// row by row.
    pub(crate) fn draw(
        &self,
        path: SimdPath,
        column: usize,
        row: usize,
        rgb: &mut [[f32; PATCH_PIXELS]; 3],
        behind: (&[f32; PATCH_PIXELS], &[f32; PATCH_PIXELS]),
        apart: Option<&mut [[f32; PATCH_PIXELS]; 4]>,
    ) {
        if self.is_empty() || column >= self.grid.0 || row >= self.grid.1 {
            return;
        }
        let patch = row * self.grid.0 + column;
        let list = &self.lists[self.bounds[patch] as usize..self.bounds[patch + 1] as usize];
        if list.is_empty() {
            return;
        }
        let corner = [(column * PATCH) as f32, (row * PATCH) as f32];
        dispatch!(path, s => draw(s, &self.drops, list, corner, rgb, behind.0, behind.1, apart));
    }
}

/// Most blocks of a patch: of 8 pixels.
const MAX_BLOCKS: usize = PATCH_PIXELS / 8;

/// The particles of one patch, in whole numbers of an optical depth, block by block: a vector is
/// four columns of some rows, as in [`crate::stages::rasterize`], since streaks are thin.
#[repr(C, align(64))]
struct Sums {
    /// Optical depth, and with it red, green and blue: four vectors a block. Each term has
    /// [`ROUNDING_OFFSET`]'s bits in it.
    sums: [u32; 4 * PATCH_PIXELS],
    /// Column and row of each pixel, view z of the scene (infinite where there is none), and steps
    /// of an optical depth of 1 behind it, of what it leaves open: four vectors a block.
    pixels: [f32; 4 * PATCH_PIXELS],
    /// Terms in each block.
    terms: [u32; MAX_BLOCKS],
}

#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "few callers; a struct would only repeat the names")]
fn draw<S: Lanes>(
    simd: S,
    drops: &[ProjectedDrop],
    list: &[u32],
    corner: [f32; 2],
    rgb: &mut [[f32; PATCH_PIXELS]; 3],
    alpha: &[f32; PATCH_PIXELS],
    depth_sum: &[f32; PATCH_PIXELS],
    mut apart: Option<&mut [[f32; PATCH_PIXELS]; 4]>,
) {
    let mut sums =
        Sums { sums: [0; 4 * PATCH_PIXELS], pixels: [0.0; 4 * PATCH_PIXELS], terms: [0; MAX_BLOCKS] };
    let lanes = cell_lanes(simd);
    for block in 0..PATCH_PIXELS / S::N {
        let at = block * S::N;
        let alpha = simd.load(&alpha[at..]);
        let depth = simd.load(&depth_sum[at..]) / alpha.max(simd.set(MIN_ALPHA));
        let pixels = &mut sums.pixels[4 * at..4 * (at + S::N)];
        let numbers = [
            lanes.0 + (block % 4 * 4) as f32,
            lanes.1 + (block / 4 * (S::N / 4)) as f32,
            alpha.simd_ge(simd.set(MIN_ALPHA)).select(depth, simd.set(f32::INFINITY)),
            (simd.set(1.0) - alpha) * STEPS_PER_OPTICAL_DEPTH,
        ];
        for (number, pixels) in numbers.iter().zip(pixels.chunks_exact_mut(S::N)) {
            number.store_slice(pixels);
        }
    }
    for entry in list {
        add(simd, &drops[*entry as usize], corner, lanes, &mut sums);
    }
    for block in 0..PATCH_PIXELS / S::N {
        let terms = sums.terms[block];
        if terms == 0 {
            continue;
        }
        // What the terms brought with them goes, modulo 2^32.
        let rounds = S::U::splat(simd, terms.wrapping_mul(ROUNDING_OFFSET.to_bits()));
        let mut totals = [simd.set(0.0); 4];
        for k in 0..4 {
            let bits = S::U::from_slice(simd, &sums.sums[(4 * block + k) * S::N..][..S::N]);
            totals[k] = to_float(simd, bits - rounds);
        }
        let [steps, light @ ..] = totals;
        let corner = block / 4 * (S::N / 4) * PATCH + block % 4 * 4;
        let kept = exp2(simd, [(steps * (-LOG2_E / STEPS_PER_OPTICAL_DEPTH)).max(simd.set(-126.0))])[0];
        let share = (simd.set(1.0) - kept) / steps.max(simd.set(1.0));
        let mut color = [simd.set(0.0); 3];
        for k in 0..3 {
            color[k] = from_rows(simd, &rgb[k][corner..]);
        }
        let mut seen = srgb_decode(simd, color);
        for k in 0..3 {
            seen[k] = seen[k].mul_add(kept, light[k] * share);
        }
        let shown = srgb_encode(simd, seen);
        for k in 0..3 {
            to_rows::<S>(shown[k], &mut rgb[k][corner..]);
        }
        if let Some(apart) = &mut apart {
            for k in 0..3 {
                to_rows::<S>(light[k] * share, &mut apart[k][corner..]);
            }
            to_rows::<S>(simd.set(1.0) - kept, &mut apart[3][corner..]);
        }
    }
}

/// The block whose first pixel is the first of `rows`: four pixels of each row of the patch.
#[inline(always)]
fn from_rows<S: Lanes>(simd: S, rows: &[f32]) -> S::F {
    let mut block = [0.0; 16];
    for (row, four) in block.chunks_exact_mut(4).take(S::N / 4).enumerate() {
        four.copy_from_slice(&rows[row * PATCH..][..4]);
    }
    simd.load(&block)
}

/// Puts a block where [`from_rows`] took it from.
#[inline(always)]
fn to_rows<S: Lanes>(block: S::F, rows: &mut [f32]) {
    for (row, four) in block.as_slice().chunks_exact(4).enumerate() {
        rows[row * PATCH..][..4].copy_from_slice(four);
    }
}

/// Converts whole numbers to floats: by halves of 16 bits, each as the mantissa of 2^23.
#[inline(always)]
fn to_float<S: Lanes>(simd: S, bits: S::U) -> S::F {
    let float = |half: S::U| S::F::from_bits(half | S::U::splat(simd, 0x4b00_0000)) - 8_388_608.0;
    float(bits >> 16).mul_add(simd.set(65536.0), float(bits & S::U::splat(simd, 0xffff)))
}

/// log2 of [`MIN_OPTICAL_DEPTH`] and [`super::MAX_OPTICAL_DEPTH`].
const MIN_OPTICAL_DEPTH_LOG2: f32 = -8.0;
const MAX_OPTICAL_DEPTH_LOG2: f32 = 4.0;
/// `exp(-MIN_SQUARED_RADIUS / 2)`.
const MIN_RADIUS_FALLOFF: f32 = 0.105_399_22;
/// Largest radiance of a particle: more would overflow the integer sums.
const MAX_RADIANCE: f32 = 3.0;

#[inline(always)]
fn add<S: Lanes>(simd: S, drop: &ProjectedDrop, corner: [f32; 2], lanes: (S::F, S::F), sums: &mut Sums) {
    let [dx, dy] = [0, 1].map(|k| simd.set(corner[k] + 0.5 - drop.mean2d[k]));
    let (round, steps) = (simd.set(ROUNDING_OFFSET), simd.set(STEPS_PER_OPTICAL_DEPTH));
    let (depth, peak) = (simd.set(drop.depth), simd.set(drop.peak));
    let (ux, vx, vy) = (simd.set(drop.ux), simd.set(drop.vx), simd.set(drop.vy));
    // Powers below this do not count.
    let end = simd.set(drop.peak - drop.reach);
    let ellipse = drop.ellipse();
    let height = S::N / 4;
    for field in 0..PATCH_PIXELS / (S::N * S::N) {
        let top = corner[1] + (field * height * height) as f32;
        let mut bits = cell_mask(simd, &ellipse, corner[0], top, 4.0, height as f32, lanes.0, lanes.1);
        while bits != 0 {
            // Never more than it may be, for the compiler to know.
            let block = (field * S::N + bits.trailing_zeros() as usize) & (PATCH_PIXELS / S::N - 1);
            bits &= bits - 1;
            let range = 4 * block * S::N..4 * (block + 1) * S::N;
            let (pixels, to) = (&sums.pixels[range.clone()], &mut sums.sums[range]);
            let x = simd.load(pixels) + dx;
            let y = simd.load(&pixels[S::N..]) + dy;
            let u = x * ux;
            let v = x.mul_add(vx, y * vy);
            let exponent = peak - u.mul_add(u, v * v);
            // 2^-126 is none.
            let exponent = exponent.simd_ge(end).select(exponent, simd.set(-126.0));
            let z = simd.load(&pixels[2 * S::N..]);
            let open = depth.simd_lt(z).select(steps, simd.load(&pixels[3 * S::N..]));
            let tau = exp2(simd, [exponent])[0] * open;
            for k in 0..4 {
                let term = if k == 0 { tau + round } else { tau.mul_add(simd.set(drop.rgb[k - 1]), round) };
                let to = &mut to[k * S::N..(k + 1) * S::N];
                let sum = S::U::from_slice(simd, to) + term.to_bits();
                sum.store_slice(to);
            }
            sums.terms[block] += 1;
        }
    }
}
