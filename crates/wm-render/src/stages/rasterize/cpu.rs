//! Block-major blending: a tile is four patches, a patch is cut in blocks of one vector (4x4 px
//! with 16 lanes, 4x2 px with 8). For a batch of splats an exact test gives the blocks that each
//! touches; then each block walks its own splats with transmittance and sums in registers.

use super::{LOG2_MAX_ALPHA, MIN_TRANSMITTANCE};
use crate::frame::FRONT_CHANNELS;
use crate::hooks::{PATCH, PATCH_PIXELS};
use crate::simd::{Lanes, exp2, exp2_looped};
use crate::stages::intersect::cpu::{cell_lanes, cell_mask};
use crate::stages::intersect::{PATCHES_PER_TILE, record_of};
use crate::stages::project::{LOG2_MIN_ALPHA, Record, unpack_slopes};
use fearless_simd::{Select, SimdBase, SimdFloat, SimdMask, u8x32, u8x64};

/// Splats walked at a time; the record after them is never visible and pads lists.
const SPLATS_PER_BATCH: usize = 255;
/// Splats in flight in the blend loop: enough to hide the latency of the exponential.
pub(crate) const SPLATS_IN_FLIGHT: usize = 4;
/// Entries of a list that are made at a time.
pub(crate) const ENTRIES_PER_CHUNK: usize = 64;

/// Sums of one patch, each `[256]` in block order: block by block, lane by lane.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(crate) struct PatchSums {
    /// Transmittance; 0 where blending has stopped.
    pub(crate) transmittance: [f32; PATCH_PIXELS],
    /// Sum of weights.
    pub(crate) alpha: [f32; PATCH_PIXELS],
    /// Sums of colour, view z and normal; as many as the render asks for are filled.
    pub(crate) features: [[f32; PATCH_PIXELS]; 7],
    /// Median depth; meaningful where alpha is at least 0.5.
    pub(crate) median: [f32; PATCH_PIXELS],
    /// Reciprocal view z of the surface, 1/scene units; negative infinity where there is none.
    pub(crate) surface: [f32; PATCH_PIXELS],
    /// The sums that the surface splits, as in [`crate::Frame::front`]. While they are blended,
    /// those of blocks in `whole` are not filled.
    pub(crate) front: [[f32; PATCH_PIXELS]; FRONT_CHANNELS],
    /// A bit for each block that the surface crosses at some pixel.
    crossed: u32,
    /// A bit for each block in which all splats so far are before the surface: its front is all
    /// that is blended.
    whole: u32,
}

/// View z of a surface at each pixel of a picture, and the picture's width and height, px.
pub(crate) type Surface<'a> = (&'a [f32], (usize, usize));

impl PatchSums {
    /// Reads the surface in one patch, in the order in which a SIMD path with `lanes` lanes walks
    /// the blocks.
    pub(crate) fn set_surface(&mut self, lanes: usize, surface: Surface<'_>, patch_x: usize, patch_y: usize) {
        let (depths, (width, height)) = surface;
        let block_height = lanes / 4;
        self.crossed = 0;
        for (run, to) in self.surface.as_chunks_mut::<4>().0.iter_mut().enumerate() {
            let (block, row) = (run / block_height, run % block_height);
            let x = patch_x * PATCH + block % 4 * 4;
            let y = patch_y * PATCH + block / 4 * block_height + row;
            let mut own = [f32::NAN; 4];
            if y < height && x < width {
                let line = &depths[y * width + x..(y + 1) * width];
                match line.first_chunk::<4>() {
                    Some(whole) => own = *whole,
                    None => own[..line.len()].copy_from_slice(line),
                }
            }
            *to = own.map(|depth| if depth.is_nan() { f32::NEG_INFINITY } else { 1.0 / depth });
            let is_crossed = own.iter().any(|depth| !depth.is_nan());
            self.crossed |= u32::from(is_crossed) << block;
        }
    }
}

impl Default for PatchSums {
    fn default() -> Self {
        let zero = [0.0; PATCH_PIXELS];
        Self {
            transmittance: zero,
            alpha: zero,
            features: [zero; 7],
            median: zero,
            surface: zero,
            front: [zero; FRONT_CHANNELS],
            crossed: 0,
            whole: 0,
        }
    }
}

/// A list of indices into the batch.
pub(crate) type List = [u8; 256 + ENTRIES_PER_CHUNK];

/// Working memory of one thread.
#[derive(Clone, Debug, Default)]
#[repr(C, align(64))]
pub struct BlendScratch {
    /// The sums of the tile's patches.
    pub(crate) patches: [PatchSums; PATCHES_PER_TILE],
    batch: Batch,
    lists: Lists,
    /// The sum of the weights of each splat of the tile's list over its pixels, filled where they
    /// are asked for.
    pub(crate) weights: Vec<f32>,
    /// Columns and rows of the tile that are in the picture: pixels beside it have no weights.
    pub(crate) weighed: (usize, usize),
    batch_weights: BatchWeights,
}

/// The weights of the splats of a batch, a vector each.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
struct BatchWeights([[f32; 16]; 256]);

impl Default for BatchWeights {
    fn default() -> Self {
        Self([[0.0; 16]; 256])
    }
}

/// The splats of the batch that touch the current patch, and those that touch each of its blocks.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(crate) struct Lists {
    pub(crate) patch: List,
    /// The blocks that each splat of `patch` touches, eight blocks an array.
    pub(crate) masks: [[u8; 256]; 4],
    pub(crate) block: List,
}

impl Default for Lists {
    fn default() -> Self {
        Self {
            patch: [0; 256 + ENTRIES_PER_CHUNK],
            masks: [[0; 256]; 4],
            block: [0; 256 + ENTRIES_PER_CHUNK],
        }
    }
}

/// Splats in the first cache.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(crate) struct Batch {
    pub(crate) records: [Record; 256],
    /// u and v of each at the tile's corner.
    pub(crate) origins: [(f32, f32); 256],
    /// The tile's first pixel.
    pub(crate) corner: (f32, f32),
    /// The patches that each touches.
    pub(crate) touched: [u8; 256],
    /// Slopes of the reciprocal view z of each, and its value at the tile's corner; filled where a
    /// surface splits the blend.
    planes: [[f32; 3]; 256],
}

impl Default for Batch {
    fn default() -> Self {
        // Its depth is a number whose reciprocal is one.
        let never = Record {
            log2_opacity: crate::cpu::model::NEVER_DRAWN_LOG2_OPACITY,
            depth: 1.0,
            ..Record::default()
        };
        Self {
            records: [never; 256],
            origins: [(0.0, 0.0); 256],
            corner: (0.0, 0.0),
            touched: [0; 256],
            planes: [[0.0; 3]; 256],
        }
    }
}

impl Batch {
    /// Takes the splats of `keys`, at most 255, for the tile whose first pixel is `(left, top)`.
    #[inline(always)]
    pub(crate) fn fill(&mut self, records: &[Record], keys: &[u64], left: f32, top: f32) {
        // Copied first and used after: nothing waits for one record, so many fetches overlap.
        for (i, key) in keys.iter().enumerate() {
            self.records[i] = records[record_of(*key)];
            self.touched[i] = (*key & 15) as u8;
        }
        for (record, origin) in self.records.iter().zip(&mut self.origins).take(keys.len()) {
            let (x, y) = (record.x - left, record.y - top);
            *origin = (-record.ux * x, -(record.vx * x + record.vy * y));
        }
        self.touched[keys.len()..].fill(0);
        self.corner = (left, top);
    }

    /// Finds the planes of the first `len` splats, from which a surface may part them.
    #[inline(always)]
    fn find_planes(&mut self, len: usize) {
        let (left, top) = self.corner;
        for (s, plane) in self.records.iter().zip(&mut self.planes).take(len) {
            let [slope_x, slope_y] = unpack_slopes(s.index);
            *plane = [slope_x, slope_y, 1.0 / s.depth - slope_x * (s.x - left) - slope_y * (s.y - top)];
        }
    }
}

/// Blends the splats of `keys` (sorted) over the tile whose first pixel is `(left, top)`. `C`
/// features are summed: 3 colour, 4 and view z, 7 and normal. Patches without a bit in `inside` lie
/// outside the picture. With `WEIGH` the sums of each splat's weights are left in the scratch.
///
/// Returns the number of splat-pixel pairs evaluated.
#[inline(always)]
pub fn blend_tile<S: Lanes, const C: usize, const MEDIAN: bool, const SPLIT: bool, const WEIGH: bool>(
    simd: S,
    records: &[Record],
    keys: &[u64],
    left: f32,
    top: f32,
    inside: u32,
    scratch: &mut BlendScratch,
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
        if SPLIT {
            sums.whole = u32::MAX >> (32 - blocks);
            sums.front[3] = [0.0; PATCH_PIXELS];
        }
    }
    let lanes = cell_lanes(simd);
    let block_height = (S::N / 4) as f32;
    // A bit for each block that still takes light: blocks that have stopped are not walked again.
    let mut live = [0u32; PATCHES_PER_TILE];
    for patch in 0..PATCHES_PER_TILE {
        live[patch] = if inside >> patch & 1 == 1 { u32::MAX >> (32 - blocks) } else { 0 };
    }
    let mut evaluated = 0;
    if WEIGH {
        let block_height = S::N / 4;
        for (patch, sums) in scratch.patches.iter_mut().enumerate() {
            for (run, pixels) in sums.transmittance.as_chunks_mut::<4>().0.iter_mut().enumerate() {
                let (block, row) = (run / block_height, run % block_height);
                let x = patch % 2 * PATCH + block % 4 * 4;
                let y = patch / 2 * PATCH + block / 4 * block_height + row;
                for (lane, pixel) in pixels.iter_mut().enumerate() {
                    // Pixels beside the picture start without light and add no weight.
                    if x + lane >= scratch.weighed.0 || y >= scratch.weighed.1 {
                        *pixel = 0.0;
                    }
                }
            }
        }
        scratch.weights.clear();
        scratch.weights.resize(keys.len(), 0.0);
    }
    for (number, batch) in keys.chunks(SPLATS_PER_BATCH).enumerate() {
        scratch.batch.fill(records, batch, left, top);
        let len = batch.len();
        if SPLIT {
            scratch.batch.find_planes(len);
        }
        if WEIGH {
            scratch.batch_weights.0[..len].fill([0.0; 16]);
        }
        for patch in 0..PATCHES_PER_TILE {
            if live[patch] == 0 {
                continue;
            }
            let corner = ((patch % 2 * PATCH) as f32, (patch / 2 * PATCH) as f32);
            let BlendScratch { patches, batch, lists, batch_weights, .. } = scratch;
            let splats = list(simd, &batch.touched, len, 1 << patch, None, &mut lists.patch);
            let field = (left + corner.0, top + corner.1);
            mask_blocks(simd, batch, splats, field, lanes, lists);
            let mut todo = live[patch];
            while todo != 0 {
                let block = todo.trailing_zeros() as usize;
                todo &= todo - 1;
                let Lists { patch: names, masks, block: walk } = lists;
                let count = list(simd, &masks[block / 8], splats, 1 << (block % 8), Some(names), walk);
                if count == 0 {
                    continue;
                }
                // Padded to whole flights with the record that is never drawn.
                walk[count..count + SPLATS_IN_FLIGHT].fill(SPLATS_PER_BATCH as u8);
                let walk = &walk[..count.next_multiple_of(SPLATS_IN_FLIGHT)];
                let corner = (
                    corner.0 + (block % 4 * 4) as f32 + 0.5,
                    corner.1 + (block / 4) as f32 * block_height + 0.5,
                );
                let sums = &mut patches[patch];
                // Where there is no surface, the front is all that is blended.
                let (alive, walked) = if SPLIT && sums.crossed >> block & 1 == 1 {
                    blend_block::<S, C, MEDIAN, true, WEIGH>(
                        simd,
                        batch,
                        walk,
                        corner,
                        lanes.0,
                        lanes.1,
                        block,
                        sums,
                        batch_weights,
                    )
                } else {
                    blend_block::<S, C, MEDIAN, false, WEIGH>(
                        simd,
                        batch,
                        walk,
                        corner,
                        lanes.0,
                        lanes.1,
                        block,
                        sums,
                        batch_weights,
                    )
                };
                evaluated += (walked.min(count) * S::N) as u64;
                if !alive {
                    live[patch] &= !(1 << block);
                }
            }
        }
        if WEIGH {
            let sums = scratch.batch_weights.0[..len].iter().map(|lanes| lanes.iter().sum::<f32>());
            scratch.weights[number * SPLATS_PER_BATCH..]
                .iter_mut()
                .zip(sums)
                .for_each(|(weight, sum)| *weight = sum);
        }
        if live == [0; PATCHES_PER_TILE] {
            break;
        }
    }
    if SPLIT {
        for sums in &mut scratch.patches {
            let mut whole = sums.whole;
            while whole != 0 {
                let block = whole.trailing_zeros() as usize;
                whole &= whole - 1;
                let own = block * S::N..(block + 1) * S::N;
                for c in 0..3 {
                    sums.front[c][own.clone()].copy_from_slice(&sums.features[c][own.clone()]);
                }
                sums.front[4][own.clone()].copy_from_slice(&sums.alpha[own]);
            }
        }
    }
    evaluated
}

/// Finds the blocks of a patch that its splats touch: `splats` of them are in `lists.patch`, and
/// the patch begins at pixel `field`.
#[inline(always)]
pub(crate) fn mask_blocks<S: Lanes>(
    simd: S,
    batch: &Batch,
    splats: usize,
    field: (f32, f32),
    lanes: (S::F, S::F),
    lists: &mut Lists,
) {
    let rows = S::N / 4;
    let Lists { patch, masks, .. } = lists;
    for (i, name) in patch[..splats].iter().enumerate() {
        let record = &batch.records[usize::from(*name)];
        let mut mask = 0;
        for part in 0..PATCH_PIXELS / S::N / S::N {
            let top = field.1 + (part * rows * rows) as f32;
            let (ellipse, height) = (record.ellipse(), rows as f32);
            let cells = cell_mask(simd, &ellipse, field.0, top, 4.0, height, lanes.0, lanes.1);
            mask |= cells << (part * S::N);
        }
        for group in 0..PATCH_PIXELS / S::N / 8 {
            masks[group][i & 255] = (mask >> (8 * group)) as u8;
        }
    }
    for group in 0..PATCH_PIXELS / S::N / 8 {
        masks[group][splats..splats.next_multiple_of(ENTRIES_PER_CHUNK)].fill(0);
    }
}

/// Lists those of the first `len` entries of `masks` that hold `bit`: their positions, or what
/// `names` says of them. Returns how many. Entries from `len` on to the next multiple of 64 hold no
/// bit.
#[inline(always)]
pub(crate) fn list<S: Lanes>(
    simd: S,
    masks: &[u8; 256],
    len: usize,
    bit: u8,
    names: Option<&List>,
    out: &mut List,
) -> usize {
    let mut count = 0;
    if S::PACKS {
        let names = names.map_or(&ALL_POSITIONS[..], |names| &names[..]);
        let bit = u8x64::splat(simd, bit);
        for first in (0..len).step_by(64) {
            let holds = (u8x64::from_slice(simd, &masks[first..first + 64]) & bit).simd_eq(bit);
            let packed = u8x64::from_slice(simd, &names[first..first + 64]).compress(holds);
            packed.store_slice(&mut out[count..count + 64]);
            count += holds.to_bitmask().count_ones() as usize;
        }
        return count;
    }
    // Without a packing instruction: eight positions at a time from a table, none of them a branch.
    let bit = u8x32::splat(simd, bit);
    for first in (0..len).step_by(32) {
        let holds = (u8x32::from_slice(simd, &masks[first..first + 32]) & bit).simd_eq(bit);
        let mut word = holds.to_bitmask() as u32;
        for byte in 0..4 {
            let here = (word & 255) as usize;
            let positions = BIT_POSITIONS[here]
                .wrapping_add((first as u64 + 8 * byte).wrapping_mul(0x0101_0101_0101_0101));
            out[count..count + 8].copy_from_slice(&positions.to_le_bytes());
            count += here.count_ones() as usize;
            word >>= 8;
        }
    }
    if let Some(names) = names {
        for position in &mut out[..count] {
            *position = names[usize::from(*position)];
        }
    }
    count
}

/// The positions 0 to 255.
const ALL_POSITIONS: [u8; 256] = {
    let mut positions = [0; 256];
    let mut i = 0;
    while i < 256 {
        positions[i] = i as u8;
        i += 1;
    }
    positions
};

/// The positions of the bits of each byte, one per byte of a word, lowest first.
const BIT_POSITIONS: [u64; 256] = {
    let mut packed = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        let (mut bit, mut count) = (0, 0);
        while bit < 8 {
            if byte >> bit & 1 == 1 {
                packed[byte] |= (bit as u64) << (8 * count);
                count += 1;
            }
            bit += 1;
        }
        byte += 1;
    }
    packed
};

/// log2 of the alphas, and the alphas, of a flight of splats at pixels `(px, py)` from the tile's
/// corner. `LOOPED` chooses the exponential, see [`exp2_looped`]; the numbers are the same.
#[inline(always)]
pub(crate) fn alphas<S: Lanes, const LOOPED: bool>(
    simd: S,
    batch: &Batch,
    at: &[usize; SPLATS_IN_FLIGHT],
    px: S::F,
    py: S::F,
) -> ([S::F; SPLATS_IN_FLIGHT], [S::F; SPLATS_IN_FLIGHT]) {
    let mut q = [simd.set(0.0); SPLATS_IN_FLIGHT];
    let mut capped = q;
    for k in 0..SPLATS_IN_FLIGHT {
        let (s, origin) = (&batch.records[at[k]], &batch.origins[at[k]]);
        let u = px.mul_add(simd.set(s.ux), simd.set(origin.0));
        let v = px.mul_add(simd.set(s.vx), py.mul_add(simd.set(s.vy), simd.set(origin.1)));
        q[k] = (-v).mul_add(v, (-u).mul_add(u, simd.set(s.log2_opacity)));
        capped[k] = q[k].min(simd.set(LOG2_MAX_ALPHA));
    }
    let mut alpha = if LOOPED && S::N == 16 { exp2_looped(simd, capped) } else { exp2(simd, capped) };
    for k in 0..SPLATS_IN_FLIGHT {
        let drawn = q[k].simd_ge(simd.set(LOG2_MIN_ALPHA));
        // Selected as integers: the mask then folds into the exponential's last operation.
        alpha[k] = S::F::from_bits(drawn.select(alpha[k].to_bits(), S::U::splat(simd, 0)));
    }
    (q, alpha)
}

/// Blends one block, whose first pixel centre is `corner` px from the tile's corner. Returns
/// whether any pixel still takes light, and the number of splats walked.
#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "few callers; a struct would only repeat the names")]
fn blend_block<S: Lanes, const C: usize, const MEDIAN: bool, const SPLIT: bool, const WEIGH: bool>(
    simd: S,
    batch: &Batch,
    walk: &[u8],
    corner: (f32, f32),
    column: S::F,
    row: S::F,
    block: usize,
    sums: &mut PatchSums,
    own_weights: &mut BatchWeights,
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
    let surface = if SPLIT { simd.load(&sums.surface[lanes.clone()]) } else { zero };
    let mut front = [zero; FRONT_CHANNELS];
    // All splats so far are before the surface: then the sums before it are all sums, and are not
    // kept twice.
    let mut is_whole = SPLIT && sums.whole >> block & 1 == 1;
    if SPLIT && !is_whole {
        for c in 0..FRONT_CHANNELS {
            front[c] = simd.load(&sums.front[c][lanes.clone()]);
        }
    }

    let mut walked = 0;
    let mut alive = true;
    // The exponentials of a flight do not depend on each other and hide their latency; only the
    // transmittance is a chain from splat to splat.
    for flight in walk.chunks_exact(SPLATS_IN_FLIGHT) {
        let mut at = [0; SPLATS_IN_FLIGHT];
        for k in 0..SPLATS_IN_FLIGHT {
            at[k] = usize::from(flight[k]);
        }
        let (_, alpha) = alphas::<S, true>(simd, batch, &at, px, py);
        let mut parting = SurfaceSplit::Both;
        let mut weights = [zero; SPLATS_IN_FLIGHT];
        let mut reciprocals = [zero; SPLATS_IN_FLIGHT];
        // Mostly all splats of a flight lie on one side of the surface at all pixels: then nothing
        // has to be selected per pixel.
        if SPLIT {
            for k in 0..SPLATS_IN_FLIGHT {
                let [slope_x, slope_y, center] = batch.planes[at[k]];
                reciprocals[k] =
                    px.mul_add(simd.set(slope_x), py.mul_add(simd.set(slope_y), simd.set(center)));
            }
            let least = reciprocals[0].min(reciprocals[1]).min(reciprocals[2].min(reciprocals[3]));
            let most = reciprocals[0].max(reciprocals[1]).max(reciprocals[2].max(reciprocals[3]));
            parting = match () {
                () if least.simd_gt(surface).all_true() => SurfaceSplit::Before,
                () if !most.simd_gt(surface).any_true() => SurfaceSplit::Behind,
                () => SurfaceSplit::Both,
            };
            if is_whole && parting != SurfaceSplit::Before {
                is_whole = false;
                front = [features[0], features[1], features[2], zero, alpha_sum];
            }
        }
        for k in 0..SPLATS_IN_FLIGHT {
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
            weights[k] = weight;
            if WEIGH {
                let own = &mut own_weights.0[at[k] & 255][..S::N];
                (simd.load(own) + weight).store_slice(own);
            }
            if k == SPLATS_IN_FLIGHT - 1 {
                alive = open.any_true();
            }
        }
        if SPLIT && !is_whole {
            for k in 0..SPLATS_IN_FLIGHT {
                let before = reciprocals[k].simd_gt(surface);
                if parting != SurfaceSplit::Before {
                    let behind = before.select(zero, weights[k]);
                    front[3] = behind.mul_add(reciprocals[k].max(zero), front[3]);
                }
                if parting != SurfaceSplit::Behind {
                    let weight = before.select(weights[k], zero);
                    let rgb = batch.records[at[k]].rgb;
                    for c in 0..3 {
                        front[c] = weight.mul_add(simd.set(rgb[c]), front[c]);
                    }
                    front[4] += weight;
                }
            }
        }
        walked += SPLATS_IN_FLIGHT;
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
    if SPLIT && !is_whole {
        sums.whole &= !(1 << block);
        for c in 0..FRONT_CHANNELS {
            front[c].store_slice(&mut sums.front[c][lanes.clone()]);
        }
    }
    (alive, walked)
}

/// The side of the surface on which the splats of a flight are, in one block.
#[derive(Clone, Copy, PartialEq, Eq)]
enum SurfaceSplit {
    Before,
    Behind,
    Both,
}
