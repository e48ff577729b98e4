//! Block-major blending: a tile is four patches, a patch is cut in blocks of one vector (4x4 px with
//! 16 lanes, 4x2 px with 8). For a batch of splats an exact test gives the blocks that each touches;
//! then each block walks its own splats with transmittance and sums in registers.

use super::{LOG2_MAX_ALPHA, MIN_TRANSMITTANCE};
use crate::hooks::{PATCH, PATCH_PIXELS};
use crate::simd::{Lanes, exp2};
use crate::stages::intersect::cpu::{cell_lanes, cell_mask};
use crate::stages::intersect::{PATCHES, record_of};
use crate::stages::project::{LOG2_MIN_ALPHA, Record};
use fearless_simd::{Select, SimdBase, SimdFloat, SimdMask, u16x32};

/// Splats walked at a time; the record after them is never visible and pads lists.
const BATCH: usize = 255;
/// Splats in flight in the blend loop: enough to hide the latency of the exponential.
const FLIGHT: usize = 4;
/// Vector length of the list compaction.
const CHUNK: usize = 32;

/// Sums of one patch, each `[256]` in block order: block by block, lane by lane.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub struct PatchSums {
    /// Transmittance; 0 where blending has stopped.
    pub transmittance: [f32; PATCH_PIXELS],
    /// Sum of weights.
    pub alpha: [f32; PATCH_PIXELS],
    /// Sums of colour, view z and normal; as many as the render asks for are filled.
    pub features: [[f32; PATCH_PIXELS]; 7],
    /// Median depth; meaningful where alpha is at least 0.5.
    pub median: [f32; PATCH_PIXELS],
}

impl Default for PatchSums {
    fn default() -> Self {
        let zero = [0.0; PATCH_PIXELS];
        Self { transmittance: zero, alpha: zero, features: [zero; 7], median: zero }
    }
}

/// A list of indices into the batch.
type List = [u16; 256 + CHUNK];

/// Working memory of one thread.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub struct Scratch {
    /// The sums of the tile's patches.
    pub patches: [PatchSums; PATCHES],
    batch: Batch,
    /// Which patches each splat of the batch touches.
    touched: [u16; 256],
    lists: Lists,
}

/// Which splats of the batch touch the patch at hand, and which each of its blocks.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
struct Lists {
    patch: List,
    /// The blocks that each splat of `patch` touches.
    masks: [u16; 256],
    blocks: [List; 32],
    /// Length of each list in `blocks`.
    counts: [usize; 32],
}

/// Splats in the first cache.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
struct Batch {
    records: [Record; 256],
    /// u and v of each at the tile's corner.
    origins: [(f32, f32); 256],
}

impl Default for Scratch {
    fn default() -> Self {
        let never = Record { log2_opacity: crate::cpu::model::NEVER, ..Record::default() };
        Self {
            patches: Default::default(),
            batch: Batch { records: [never; 256], origins: [(0.0, 0.0); 256] },
            touched: [0; 256],
            lists: Lists {
                patch: [0; 256 + CHUNK],
                masks: [0; 256],
                blocks: [[0; 256 + CHUNK]; 32],
                counts: [0; 32],
            },
        }
    }
}

/// Blends the splats of `keys` (sorted) over the tile whose first pixel is `(left, top)`. `C` features
/// are summed: 3 colour, 4 and view z, 7 and normal. Patches without a bit in `inside` lie outside the
/// picture.
///
/// Returns the number of splat-pixel pairs evaluated.
#[inline(always)]
pub fn blend_tile<S: Lanes, const C: usize, const MEDIAN: bool>(
    simd: S,
    records: &[Record],
    keys: &[u64],
    (left, top): (f32, f32),
    inside: u32,
    scratch: &mut Scratch,
) -> u64 {
    let blocks = PATCH_PIXELS / S::N;
    for sums in &mut scratch.patches {
        sums.transmittance = [1.0; PATCH_PIXELS];
        sums.alpha = [0.0; PATCH_PIXELS];
        for feature in &mut sums.features[..C] {
            *feature = [0.0; PATCH_PIXELS];
        }
        if MEDIAN {
            sums.median = [0.0; PATCH_PIXELS];
        }
    }
    let lanes = cell_lanes(simd);
    let block_height = (S::N / 4) as f32;
    let mut live = [0u32; PATCHES];
    for patch in 0..PATCHES {
        live[patch] = if inside >> patch & 1 == 1 { u32::MAX >> (32 - blocks) } else { 0 };
    }
    let mut evaluated = 0;
    for batch in keys.chunks(BATCH) {
        // Copied first and used after: nothing waits for one record, so many fetches overlap.
        for (i, key) in batch.iter().enumerate() {
            scratch.batch.records[i] = records[record_of(*key)];
            scratch.touched[i] = (*key & 15) as u16;
        }
        for (record, origin) in scratch.batch.records.iter().zip(&mut scratch.batch.origins).take(batch.len())
        {
            let (x, y) = (record.x - left, record.y - top);
            *origin = (-record.ux * x, -(record.vx * x + record.vy * y));
        }
        let len = batch.len();
        scratch.touched[len..].fill(0);
        for patch in 0..PATCHES {
            if live[patch] == 0 {
                continue;
            }
            let corner = ((patch % 2 * PATCH) as f32, (patch / 2 * PATCH) as f32);
            let Scratch { patches, batch, touched, lists } = scratch;
            let splats =
                list(simd, &touched[..len.next_multiple_of(CHUNK)], 1 << patch, None, &mut lists.patch);
            let field = (left + corner.0, top + corner.1);
            list_blocks(simd, batch, splats, field, lanes, live[patch], lists);
            let mut todo = live[patch];
            while todo != 0 {
                let block = todo.trailing_zeros() as usize;
                todo &= todo - 1;
                let count = lists.counts[block];
                if count == 0 {
                    continue;
                }
                let walk = &mut lists.blocks[block];
                walk[count..count + FLIGHT].fill(BATCH as u16);
                let walk = &walk[..count.next_multiple_of(FLIGHT)];
                let corner = (
                    corner.0 + (block % 4 * 4) as f32 + 0.5,
                    corner.1 + (block / 4) as f32 * block_height + 0.5,
                );
                let (alive, walked) =
                    blend_block::<S, C, MEDIAN>(simd, batch, walk, corner, lanes, block, &mut patches[patch]);
                evaluated += (walked.min(count) * S::N) as u64;
                if !alive {
                    live[patch] &= !(1 << block);
                }
            }
        }
        if live == [0; PATCHES] {
            break;
        }
    }
    evaluated
}

/// Lists for each block of a patch the splats that touch it: `splats` of them are in `lists.patch`, and
/// the patch begins at pixel `field`.
#[inline(always)]
fn list_blocks<S: Lanes>(
    simd: S,
    batch: &Batch,
    splats: usize,
    field: (f32, f32),
    lanes: (S::F, S::F),
    live: u32,
    lists: &mut Lists,
) {
    let rows = S::N / 4;
    let Lists { patch, masks, blocks, counts } = lists;
    if S::PACKS {
        for (name, mask) in patch[..splats].iter().zip(masks.iter_mut()) {
            let record = &batch.records[usize::from(name & 255)];
            *mask = cell_mask(simd, record, field, (4.0, rows as f32), lanes) as u16;
        }
        masks[splats..].fill(0);
        let mut todo = live;
        while todo != 0 {
            let block = todo.trailing_zeros() as usize;
            todo &= todo - 1;
            counts[block] = list(
                simd,
                &masks[..splats.next_multiple_of(CHUNK)],
                1 << block,
                Some(patch),
                &mut blocks[block],
            );
        }
        return;
    }
    counts.fill(0);
    for name in &patch[..splats] {
        let record = &batch.records[usize::from(name & 255)];
        let mut mask = 0;
        for part in 0..PATCH_PIXELS / S::N / S::N {
            let corner = (field.0, field.1 + (part * rows * rows) as f32);
            mask |= cell_mask(simd, record, corner, (4.0, rows as f32), lanes) << (part * S::N);
        }
        mask &= live;
        while mask != 0 {
            let block = (mask.trailing_zeros() & 31) as usize;
            mask &= mask - 1;
            blocks[block][counts[block] & 255] = *name;
            counts[block] += 1;
        }
    }
}

/// Lists the entries of `masks` that hold `bit`: their positions, or what `names` says of them. Returns
/// how many. The length of `masks` is a multiple of 32.
#[inline(always)]
fn list<S: Lanes>(simd: S, masks: &[u16], bit: u16, names: Option<&List>, out: &mut List) -> usize {
    const POSITIONS: [u16; 256] = {
        let mut positions = [0; 256];
        let mut i = 0;
        while i < 256 {
            positions[i] = i as u16;
            i += 1;
        }
        positions
    };
    let names = names.map_or(&POSITIONS[..], |names| &names[..]);
    let mut count = 0;
    if !S::PACKS {
        for (mask, name) in masks.iter().zip(names) {
            out[count & 255] = *name;
            count += usize::from(mask & bit != 0);
        }
        return count;
    }
    let bit = u16x32::splat(simd, bit);
    for first in (0..masks.len()).step_by(CHUNK) {
        let holds = (u16x32::from_slice(simd, &masks[first..first + CHUNK]) & bit).simd_eq(bit);
        let packed = u16x32::from_slice(simd, &names[first..first + CHUNK]).compress(holds);
        packed.store_slice(&mut out[count..count + CHUNK]);
        count += holds.to_bitmask().count_ones() as usize;
    }
    count
}

/// Blends one block, whose first pixel centre is `corner` px from the tile's corner. Returns whether
/// any pixel still takes light, and the number of splats walked.
#[inline(always)]
fn blend_block<S: Lanes, const C: usize, const MEDIAN: bool>(
    simd: S,
    batch: &Batch,
    walk: &[u16],
    corner: (f32, f32),
    (column, row): (S::F, S::F),
    block: usize,
    sums: &mut PatchSums,
) -> (bool, usize) {
    let zero = simd.set(0.0);
    let (px, py) = (column + corner.0, row + corner.1);
    let lanes = block * S::N..(block + 1) * S::N;
    let mut transmittance = simd.load(&sums.transmittance[lanes.clone()]);
    let mut alpha_sum = simd.load(&sums.alpha[lanes.clone()]);
    let mut median = if MEDIAN { simd.load(&sums.median[lanes.clone()]) } else { zero };
    let mut features = [zero; C];
    for c in 0..C {
        features[c] = simd.load(&sums.features[c][lanes.clone()]);
    }

    let mut walked = 0;
    let mut alive = true;
    for flight in walk.chunks_exact(FLIGHT) {
        // The mask proves the index in bounds.
        let mut at = [0; FLIGHT];
        for k in 0..FLIGHT {
            at[k] = usize::from(flight[k] & 255);
        }
        let mut alpha = [zero; FLIGHT];
        for k in 0..FLIGHT {
            let (s, origin) = (&batch.records[at[k]], &batch.origins[at[k]]);
            let u = px.mul_add(simd.set(s.ux), simd.set(origin.0));
            let v = px.mul_add(simd.set(s.vx), py.mul_add(simd.set(s.vy), simd.set(origin.1)));
            let q = (-v).mul_add(v, (-u).mul_add(u, simd.set(s.log2_opacity)));
            let drawn = q.simd_ge(simd.set(LOG2_MIN_ALPHA));
            // Selected as integers: the mask then folds into the exponential's last operation.
            let exponential = exp2(simd, q.min(simd.set(LOG2_MAX_ALPHA))).to_bits();
            alpha[k] = S::F::from_bits(drawn.select(exponential, S::U::splat(simd, 0)));
        }
        for k in 0..FLIGHT {
            // A pixel that has stopped carries transmittance 0, so one comparison does for both.
            let next = (-alpha[k]).mul_add(transmittance, transmittance);
            let open = next.simd_gt(simd.set(MIN_TRANSMITTANCE));
            let weight = open.select(alpha[k] * transmittance, zero);
            let s = &batch.records[at[k]];
            if MEDIAN {
                let crosses = transmittance.simd_gt(simd.set(0.5)) & weight.simd_gt(zero);
                median = crosses.select(simd.set(s.depth), median);
            }
            transmittance = open.select(next, zero);
            alpha_sum += weight;
            let values = [s.rgb[0], s.rgb[1], s.rgb[2], s.depth, s.normal[0], s.normal[1], s.normal[2]];
            for c in 0..C {
                features[c] = weight.mul_add(simd.set(values[c]), features[c]);
            }
            if k == FLIGHT - 1 {
                alive = open.any_true();
            }
        }
        walked += FLIGHT;
        if !alive {
            break;
        }
    }

    transmittance.store_slice(&mut sums.transmittance[lanes.clone()]);
    alpha_sum.store_slice(&mut sums.alpha[lanes.clone()]);
    if MEDIAN {
        median.store_slice(&mut sums.median[lanes.clone()]);
    }
    for c in 0..C {
        features[c].store_slice(&mut sums.features[c][lanes.clone()]);
    }
    (alive, walked)
}
