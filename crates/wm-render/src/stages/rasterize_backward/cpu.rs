//! In two phases for a batch of splats. First block by block, as in blending: transmittance, what
//! is to come and the derivatives by the sums stay in registers, and w and s of each splat at each
//! pixel go to a scratch in the second cache. Then splat by splat: sixteen sums in registers over
//! the blocks it touches. Both at once do not fit any register file.

use super::{GradientSlot, NO_SLOT};
use crate::differentiable::{DepthAlpha, ForwardConfig, Upstream};
use crate::frame::MIN_ALPHA;
use crate::hooks::{PATCH, PATCH_PIXELS};
use crate::simd::{Lanes, reciprocal, sums};
use crate::stages::intersect::PATCHES_PER_TILE;
use crate::stages::intersect::cpu::cell_lanes;
use crate::stages::project::Record;
use crate::stages::rasterize::cpu::{
    Batch, ENTRIES_PER_CHUNK, Lists, SPLATS_IN_FLIGHT, alphas, list, mask_blocks,
};
use crate::stages::rasterize::{LOG2_MAX_ALPHA, MIN_TRANSMITTANCE};
use fearless_simd::{Select, SimdBase, SimdFloat, SimdMask};

/// Splats of a batch: their scratch is in the second cache, since most touch few blocks.
const SPLATS_PER_BATCH: usize = 128;
/// Lines of scratch a splat: w and s of the tile's pixels.
const LINES_PER_SPLAT: usize = 2 * PATCHES_PER_TILE * PATCH_PIXELS / 16;
/// From one splat's lines to the next's: not a power of two, or the splats of one block would fight
/// for one set of the cache.
const STRIDE_LINES: usize = LINES_PER_SPLAT + 2;
/// Rows of scratch: one for each splat of the batch and for the one that pads lists, and on to the
/// next power of two, so that a masked index is proof enough that it is within.
const SCRATCH_ROWS: usize = 2 * SPLATS_PER_BATCH;

/// The pixels of one patch in block order, see [`crate::stages::rasterize::cpu::PatchSums`].
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(crate) struct PatchState {
    /// Transmittance; 0 where blending has stopped and outside the picture.
    transmittance: [f32; PATCH_PIXELS],
    /// R, less v_A times the transmittance at the end.
    remaining: [f32; PATCH_PIXELS],
    /// Derivatives of the loss by the sums.
    upstream: [[f32; PATCH_PIXELS]; 7],
}

/// Working memory of one thread.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub struct BackwardScratch {
    /// The pixels of the tile's patches.
    pub(crate) patches: [PatchState; PATCHES_PER_TILE],
    batch: Batch,
    lists: Lists,
    /// Blocks of each patch in which each splat of the batch was weighed.
    reached: [[u32; PATCHES_PER_TILE]; SPLATS_PER_BATCH],
    /// Coordinates of the blocks' lanes from the tile's corner, by column and row of blocks.
    columns: [[f32; 16]; 8],
    rows: [[f32; 16]; 16],
    /// w and s of each splat, patch and block.
    weighed: Box<WeightLines>,
    raw: RawUpstream,
}

type WeightLines = [Line; SCRATCH_ROWS * STRIDE_LINES];

/// The first line of splat `i` of the batch at `block` of `patch`; with 16 lanes s is in the next.
#[inline(always)]
fn line_of<S: Lanes>(i: usize, patch: usize, block: usize) -> usize {
    (i % SCRATCH_ROWS) * STRIDE_LINES
        + (patch * (PATCH_PIXELS / S::N) + block) * (2 * S::N / 16) % LINES_PER_SPLAT
}

#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(64))]
struct Line([f32; 16]);

/// One patch of the upstream pictures in block order.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
struct RawUpstream {
    alpha: [f32; PATCH_PIXELS],
    /// Colour, depth, normal.
    values: [[f32; PATCH_PIXELS]; 7],
}

impl Default for BackwardScratch {
    fn default() -> Self {
        let zero = [0.0; PATCH_PIXELS];
        let patch = PatchState { transmittance: zero, remaining: zero, upstream: [zero; 7] };
        Self {
            patches: std::array::from_fn(|_| patch.clone()),
            batch: Batch::default(),
            lists: Lists::default(),
            reached: [[0; PATCHES_PER_TILE]; SPLATS_PER_BATCH],
            columns: [[0.0; 16]; 8],
            rows: [[0.0; 16]; 16],
            weighed: vec![Line::default(); SCRATCH_ROWS * STRIDE_LINES]
                .into_boxed_slice()
                .try_into()
                .unwrap_or_else(|_| unreachable!("the length is the type's")),
            raw: RawUpstream { alpha: zero, values: [zero; 7] },
        }
    }
}

/// The pictures of a view, and what the loss says of them.
#[derive(Clone, Copy)]
pub struct RenderedPictures<'a> {
    /// The channels that were rendered.
    pub config: &'a ForwardConfig,
    /// The loss's derivative by each pixel.
    pub upstream: &'a Upstream<'a>,
    /// Width and height, px.
    pub size: (usize, usize),
}

/// Sets up patch `patch` of the tile, whose first pixel is `(left, top)`. `kept` are the forward
/// pass's sums in block order: alpha, then the features.
#[inline(always)]
pub fn prepare_patch<S: Lanes>(
    simd: S,
    pictures: RenderedPictures<'_>,
    kept: &[[f32; PATCH_PIXELS]],
    left: usize,
    top: usize,
    patch: usize,
    scratch: &mut BackwardScratch,
) {
    let RenderedPictures { config, upstream, size } = pictures;
    let BackwardScratch { patches, raw, .. } = scratch;
    let state = &mut patches[patch];
    let channels = config.channels;
    // Runs of four pixels of one row, in block order.
    let block_height = S::N / 4;
    for run in 0..PATCH_PIXELS / 4 {
        let (block, row) = (run / block_height, run % block_height);
        let x = left + block % 4 * 4;
        let y = top + block / 4 * block_height + row;
        let inside = if y < size.1 { size.0.saturating_sub(x).min(4) } else { 0 };
        let (at, to) = (y * size.0 + x, 4 * run);
        let open = [0, 1, 2, 3].map(|i| if i < inside { 1.0 } else { 0.0 });
        state.transmittance[to..to + 4].copy_from_slice(&open);
        let one = |values: &[f32], out: &mut [f32; PATCH_PIXELS]| {
            let run = load_run::<4>(values, at, inside);
            out[to..to + 4].copy_from_slice(&run);
        };
        one(upstream.alpha, &mut raw.alpha);
        if let Some(k) = channels.depth() {
            one(upstream.depth, &mut raw.values[k]);
        }
        let three = |values: &[f32], out: &mut [[f32; PATCH_PIXELS]]| {
            let run = load_run::<12>(values, 3 * at, 3 * inside);
            for k in 0..3 {
                out[k][to..to + 4].copy_from_slice(&[run[k], run[k + 3], run[k + 6], run[k + 9]]);
            }
        };
        if channels.has_color() {
            three(upstream.rgb, &mut raw.values[..3]);
        }
        if channels.has_normal() {
            three(upstream.normal, &mut raw.values[4..]);
        }
    }

    let (zero, one) = (simd.set(0.0), simd.set(1.0));
    let (sums_alpha, sums) = (&kept[0], &kept[1..]);
    for first in (0..PATCH_PIXELS).step_by(S::N) {
        let lanes = first..first + S::N;
        let alpha = simd.load(&sums_alpha[first..]);
        let mut by_alpha = simd.load(&raw.alpha[first..]);
        let mut remaining = zero;
        if channels.has_color() {
            for k in 0..3 {
                let by = simd.load(&raw.values[k][first..]);
                by_alpha = by.mul_add(simd.set(-config.background[k]), by_alpha);
                remaining = by.mul_add(simd.load(&sums[k][first..]), remaining);
                by.store_slice(&mut state.upstream[k][lanes.clone()]);
            }
        }
        let covered = alpha.simd_ge(simd.set(MIN_ALPHA));
        if let Some(k) = channels.depth() {
            let inverse = covered.select(one / alpha, zero);
            let by = simd.load(&raw.values[k][first..]) * inverse;
            let share = by * simd.load(&sums[k][first..]);
            if upstream.depth_alpha == DepthAlpha::Learns {
                by_alpha = (-share).mul_add(inverse, by_alpha);
            }
            remaining += share;
            by.store_slice(&mut state.upstream[k][lanes.clone()]);
        }
        if channels.has_normal() {
            let (mut squared, mut along) = (zero, zero);
            for k in 4..7 {
                let sum = simd.load(&sums[k][first..]);
                squared = sum.mul_add(sum, squared);
                along = sum.mul_add(simd.load(&raw.values[k][first..]), along);
            }
            let sound = covered & squared.simd_gt(simd.set(1e-20));
            let inverse = sound.select(one / squared.sqrt(), zero);
            along *= inverse * inverse;
            // Turning a normal pulls on nothing along it: what is to come is 0.
            for k in 4..7 {
                let sum = simd.load(&sums[k][first..]);
                let by = (-along).mul_add(sum, simd.load(&raw.values[k][first..])) * inverse;
                by.store_slice(&mut state.upstream[k][lanes.clone()]);
                remaining = by.mul_add(sum, remaining);
            }
        }
        let remaining = (-by_alpha).mul_add(one - alpha, remaining);
        remaining.store_slice(&mut state.remaining[lanes]);
    }
}

/// `count` of N values from `first` on, and 0 where there are no more; none of an empty picture.
#[inline(always)]
fn load_run<const N: usize>(values: &[f32], first: usize, count: usize) -> [f32; N] {
    if count == N
        && let Some(run) = values.get(first..).and_then(|values| values.first_chunk::<N>())
    {
        return *run;
    }
    let mut run = [0.0; N];
    if !values.is_empty() && count > 0 {
        run[..count].copy_from_slice(&values[first..first + count]);
    }
    run
}

/// Sums the pulls of the tile's pixels on the splats of `keys`, the sorted list of the forward
/// pass. The tile's first pixel is `(left, top)`, its patches are prepared; `C` sums were blended.
///
/// Writes the slots one after another and to `places` the number of each key's slot, or
/// [`NO_SLOT`]. Returns how many slots there are.
#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "few callers; a struct would only repeat the names")]
pub fn blend_tile_backward<S: Lanes, const C: usize>(
    simd: S,
    records: &[Record],
    keys: &[u64],
    left: f32,
    top: f32,
    inside: u32,
    scratch: &mut BackwardScratch,
    slots: &mut [GradientSlot],
    places: &mut [u32],
) -> usize {
    let blocks = PATCH_PIXELS / S::N;
    let block_height = (S::N / 4) as f32;
    let lanes = cell_lanes(simd);
    for (k, column) in scratch.columns.iter_mut().enumerate() {
        (lanes.0 + ((4 * k) as f32 + 0.5)).store_slice(&mut column[..S::N]);
    }
    for (k, row) in scratch.rows.iter_mut().enumerate().take(2 * PATCH / (S::N / 4)) {
        (lanes.1 + (k as f32 * block_height + 0.5)).store_slice(&mut row[..S::N]);
    }
    let mut live = [0u32; PATCHES_PER_TILE];
    for patch in 0..PATCHES_PER_TILE {
        live[patch] = if inside >> patch & 1 == 1 { u32::MAX >> (32 - blocks) } else { 0 };
    }
    places.fill(NO_SLOT);
    let mut used = 0;
    for (batch_keys, places) in keys.chunks(SPLATS_PER_BATCH).zip(places.chunks_mut(SPLATS_PER_BATCH)) {
        scratch.batch.fill(records, batch_keys, left, top);
        scratch.reached = [[0; PATCHES_PER_TILE]; SPLATS_PER_BATCH];
        for patch in 0..PATCHES_PER_TILE {
            if live[patch] != 0 {
                weigh_patch::<S, C>(simd, scratch, batch_keys.len(), left, top, patch, &mut live[patch]);
            }
        }
        // Splats that no block has reached are behind opaque ones: they get no slot.
        for (i, place) in places.iter_mut().enumerate() {
            if scratch.reached[i] != [0; PATCHES_PER_TILE] {
                slots[used] = gather_splat::<S, C>(simd, scratch, i);
                *place = used as u32;
                used += 1;
            }
        }
        if live == [0; PATCHES_PER_TILE] {
            break;
        }
    }
    used
}

/// The first phase for one patch: weighs the batch's splats in each live block.
#[inline(always)]
fn weigh_patch<S: Lanes, const C: usize>(
    simd: S,
    scratch: &mut BackwardScratch,
    len: usize,
    left: f32,
    top: f32,
    patch: usize,
    live: &mut u32,
) {
    let BackwardScratch { patches, batch, lists, reached, columns, rows, weighed, .. } = scratch;
    let state = &mut patches[patch];
    let blocks = PATCH_PIXELS / S::N;
    let corner = ((patch % 2 * PATCH) as f32, (patch / 2 * PATCH) as f32);
    let splats = list(simd, &batch.touched, len, 1 << patch, None, &mut lists.patch);
    mask_blocks(simd, batch, splats, (left + corner.0, top + corner.1), cell_lanes(simd), lists);
    for i in 0..splats {
        let mut mask = 0;
        for group in 0..blocks / 8 {
            mask |= u32::from(lists.masks[group][i]) << (8 * group);
        }
        reached[usize::from(lists.patch[i]) & (SPLATS_PER_BATCH - 1)][patch] = mask & *live;
    }
    let mut todo = *live;
    while todo != 0 {
        let block = todo.trailing_zeros() as usize;
        todo &= todo - 1;
        let Lists { patch: names, masks, block: walk } = &mut *lists;
        let count = list(simd, &masks[block / 8], splats, 1 << (block % 8), Some(names), walk);
        if count == 0 {
            continue;
        }
        // Padded to whole flights with the record that is never drawn.
        walk[count..count + SPLATS_IN_FLIGHT].fill(SPLATS_PER_BATCH as u8);
        let column = simd.load(&columns[patch % 2 * 4 + block % 4]);
        let row = simd.load(&rows[patch / 2 * (blocks / 4) + block / 4]);
        let padded = &walk[..count.next_multiple_of(SPLATS_IN_FLIGHT)];
        let (alive, walked) =
            weigh_block::<S, C>(simd, batch, padded, (column, row), patch, block, state, weighed);
        if !alive {
            // The splats behind the last one that was walked have not reached this block.
            *live &= !(1 << block);
            for name in walk.iter().take(count).skip(walked) {
                reached[usize::from(*name) & (SPLATS_PER_BATCH - 1)][patch] &= !(1 << block);
            }
        }
    }
}

/// The first phase for one block: replays the blending and writes w and s of each splat. Returns
/// whether any pixel still takes light, and the number of splats walked.
#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "few callers; a struct would only repeat the names")]
fn weigh_block<S: Lanes, const C: usize>(
    simd: S,
    batch: &Batch,
    walk: &[u8],
    at_pixels: (S::F, S::F),
    patch: usize,
    block: usize,
    state: &mut PatchState,
    weighed: &mut WeightLines,
) -> (bool, usize) {
    let (zero, one) = (simd.set(0.0), simd.set(1.0));
    let lanes = block * S::N..(block + 1) * S::N;
    let mut transmittance = simd.load(&state.transmittance[lanes.clone()]);
    let mut remaining = simd.load(&state.remaining[lanes.clone()]);
    let mut upstream = [zero; C];
    for c in 0..C {
        upstream[c] = simd.load(&state.upstream[c][lanes.clone()]);
    }
    let mut walked = 0;
    let mut alive = true;
    for flight in walk.chunks_exact(SPLATS_IN_FLIGHT) {
        let mut at = [0; SPLATS_IN_FLIGHT];
        for k in 0..SPLATS_IN_FLIGHT {
            at[k] = usize::from(flight[k]);
        }
        let (q, alpha) = alphas::<S, false>(simd, batch, &at, at_pixels.0, at_pixels.1);
        let mut value = [zero; SPLATS_IN_FLIGHT];
        let mut open = [zero; SPLATS_IN_FLIGHT];
        for k in 0..SPLATS_IN_FLIGHT {
            let s = &batch.records[at[k]];
            let values = [s.rgb[0], s.rgb[1], s.rgb[2], s.depth, s.normal[0], s.normal[1], s.normal[2]];
            value[k] = upstream[0] * values[0];
            for c in 1..C {
                value[k] = upstream[c].mul_add(simd.set(values[c]), value[k]);
            }
            open[k] = one - alpha[k];
        }
        let inverse = reciprocal(simd, open);
        for k in 0..SPLATS_IN_FLIGHT {
            let next = (-alpha[k]).mul_add(transmittance, transmittance);
            let open = next.simd_gt(simd.set(MIN_TRANSMITTANCE));
            let weight = open.select(alpha[k] * transmittance, zero);
            let own = weight * value[k];
            remaining -= own;
            let pull = (-(alpha[k] * inverse[k])).mul_add(remaining, own);
            let pulls = open & q[k].simd_lt(simd.set(LOG2_MAX_ALPHA));
            let pull = pulls.select(pull, zero);
            transmittance = open.select(next, zero);
            let line = line_of::<S>(at[k], patch, block);
            if S::N == 16 {
                weight.store_slice(&mut weighed[line].0);
                pull.store_slice(&mut weighed[line | 1].0);
            } else {
                let line = &mut weighed[line].0;
                weight.store_slice(&mut line[..S::N]);
                pull.store_slice(&mut line[S::N..]);
            }
            if k == SPLATS_IN_FLIGHT - 1 {
                alive = open.any_true();
            }
        }
        walked += SPLATS_IN_FLIGHT;
        if !alive {
            break;
        }
    }
    transmittance.store_slice(&mut state.transmittance[lanes.clone()]);
    remaining.store_slice(&mut state.remaining[lanes]);
    (alive, walked)
}

/// The second phase for splat `i` of the batch: its sums over the blocks in which it was weighed.
#[inline(always)]
fn gather_splat<S: Lanes, const C: usize>(simd: S, scratch: &BackwardScratch, i: usize) -> GradientSlot {
    let zero = simd.set(0.0);
    let mut slot = GradientSlot::default();
    let weighed = &*scratch.weighed;
    if S::N == 16 {
        let mut sixteen = [zero; 16];
        each_block::<S>(
            scratch,
            i,
            #[inline(always)]
            |line, patch, block, column, row| {
                let (weight, pull) = (simd.load(&weighed[line].0), simd.load(&weighed[line | 1].0));
                add_moments(simd, scratch, i, pull, column, row, &mut sixteen);
                add_features::<S, C>(simd, &scratch.patches[patch], weight, block, &mut sixteen[8..]);
            },
        );
        sums::<S, 16>(simd, sixteen).store_slice(&mut slot.0);
    } else {
        // Eight sums at a time, which is what sixteen registers hold.
        let mut eight = [zero; 8];
        each_block::<S>(
            scratch,
            i,
            #[inline(always)]
            |line, _, _, column, row| {
                let pull = simd.load(&weighed[line].0[S::N..]);
                add_moments(simd, scratch, i, pull, column, row, &mut eight);
            },
        );
        sums::<S, 8>(simd, eight).store_slice(&mut slot.0[..8]);
        eight = [zero; 8];
        each_block::<S>(
            scratch,
            i,
            #[inline(always)]
            |line, patch, block, _, _| {
                let weight = simd.load(&weighed[line].0);
                add_features::<S, C>(simd, &scratch.patches[patch], weight, block, &mut eight);
            },
        );
        sums::<S, 8>(simd, eight).store_slice(&mut slot.0[8..]);
    }
    slot
}

/// Calls `f` with the line of scratch, patch, block and its column and row, for each block of splat
/// `i`.
#[inline(always)]
fn each_block<S: Lanes>(
    scratch: &BackwardScratch,
    i: usize,
    mut f: impl FnMut(usize, usize, usize, usize, usize),
) {
    let blocks = PATCH_PIXELS / S::N;
    for patch in 0..PATCHES_PER_TILE {
        let mut mask = scratch.reached[i][patch];
        while mask != 0 {
            // The mask proves the block in bounds.
            let block = mask.trailing_zeros() as usize % blocks;
            mask &= mask - 1;
            let (column, row) = (patch % 2 * 4 + block % 4, patch / 2 * (blocks / 4) + block / 4);
            f(line_of::<S>(i, patch, block), patch, block, column, row % 16);
        }
    }
}

/// Adds the moments of one block.
#[inline(always)]
fn add_moments<S: Lanes>(
    simd: S,
    scratch: &BackwardScratch,
    i: usize,
    pull: S::F,
    column: usize,
    row: usize,
    sums: &mut [S::F],
) {
    let (record, origin) = (&scratch.batch.records[i], &scratch.batch.origins[i]);
    let (px, py) = (simd.load(&scratch.columns[column]), simd.load(&scratch.rows[row]));
    let u = px.mul_add(simd.set(record.ux), simd.set(origin.0));
    let v = px.mul_add(simd.set(record.vx), py.mul_add(simd.set(record.vy), simd.set(origin.1)));
    let (by_u, by_v) = (pull * u, pull * v);
    sums[GradientSlot::S] += pull;
    sums[GradientSlot::SU] += by_u;
    sums[GradientSlot::SV] += by_v;
    sums[GradientSlot::SUU] = by_u.mul_add(u, sums[GradientSlot::SUU]);
    sums[GradientSlot::SUV] = by_u.mul_add(v, sums[GradientSlot::SUV]);
    sums[GradientSlot::SVV] = by_v.mul_add(v, sums[GradientSlot::SVV]);
    let along = by_u.mul_add(simd.set(record.ux), by_v * record.vx);
    sums[GradientSlot::ABS_X] += absolute(simd, along);
    sums[GradientSlot::ABS_Y] += absolute(simd, by_v);
}

/// Adds the weights of one block and what they pull on the features.
#[inline(always)]
fn add_features<S: Lanes, const C: usize>(
    simd: S,
    state: &PatchState,
    weight: S::F,
    block: usize,
    sums: &mut [S::F],
) {
    sums[0] += weight;
    for c in 0..C {
        sums[1 + c] = weight.mul_add(simd.load(&state.upstream[c][block * S::N..]), sums[1 + c]);
    }
}

#[inline(always)]
fn absolute<S: Lanes>(simd: S, x: S::F) -> S::F {
    S::F::from_bits(x.to_bits() & S::U::splat(simd, 0x7fff_ffff))
}

const _: () = assert!(
    SPLATS_PER_BATCH < 256 && SPLATS_PER_BATCH.is_multiple_of(ENTRIES_PER_CHUNK),
    "lists hold bytes, and are made by chunks"
);
