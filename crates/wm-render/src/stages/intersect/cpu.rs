//! Exact ellipse tests of 8 or 16 rectangles at a time, and the scatter into tile lists.

use super::{PATCHES_PER_TILE, TILE, TileGrid, key, record_of};
use crate::hooks::PATCH;
use crate::simd::Lanes;
use crate::stages::project::{LOG2_MIN_ALPHA, Record, TEST_SLACK};
use fearless_simd::{SimdBase, SimdFloat, SimdMask};
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

/// Lane coordinates of a field of cells: 4 columns, `N / 4` rows.
#[inline(always)]
pub(crate) fn cell_lanes<S: Lanes>(simd: S) -> (S::F, S::F) {
    const LANE_COLUMNS: [f32; 16] = [0., 1., 2., 3., 0., 1., 2., 3., 0., 1., 2., 3., 0., 1., 2., 3.];
    const LANE_ROWS: [f32; 16] = [0., 0., 0., 0., 1., 1., 1., 1., 2., 2., 2., 2., 3., 3., 3., 3.];
    (simd.load(&LANE_COLUMNS), simd.load(&LANE_ROWS))
}

/// The ellipse that a 2D Gaussian touches: `(ux dx)^2 + (vx dx + vy dy)^2 <= reach`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Ellipse {
    /// Centre, px.
    pub(crate) x: f32,
    /// Centre, px.
    pub(crate) y: f32,
    /// Factor of dx in the first square, 1/px.
    pub(crate) ux: f32,
    /// Factor of dx in the second square, 1/px.
    pub(crate) vx: f32,
    /// Factor of dy in the second square, 1/px.
    pub(crate) vy: f32,
    /// The dy at which the sum is least for dx = 1.
    pub(crate) slope_y: f32,
    /// The dx at which it is least for dy = 1.
    pub(crate) slope_x: f32,
    /// Greatest sum.
    pub(crate) reach: f32,
}

impl Record {
    /// The ellipse in which its alpha is drawn, with some slack.
    #[inline(always)]
    pub(crate) fn ellipse(&self) -> Ellipse {
        let Self { x, y, ux, vx, vy, slope_y, slope_x, log2_opacity, .. } = *self;
        Ellipse { x, y, ux, vx, vy, slope_y, slope_x, reach: log2_opacity - (LOG2_MIN_ALPHA - TEST_SLACK) }
    }
}

/// Bits of the cells that an ellipse touches, in a field of 4 columns and `N / 4` rows of cells of
/// `width` x `height` px, the first at pixel `(left, top)`.
#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "few callers; a struct would only repeat the names")]
pub(crate) fn cell_mask<S: Lanes>(
    simd: S,
    splat: &Ellipse,
    left: f32,
    top: f32,
    width: f32,
    height: f32,
    column: S::F,
    row: S::F,
) -> u32 {
    // Pixel centres of each cell, relative to the splat's centre.
    let low_x = column.mul_add(simd.set(width), simd.set(left + 0.5 - splat.x));
    let low_y = row.mul_add(simd.set(height), simd.set(top + 0.5 - splat.y));
    let (high_x, high_y) = (low_x + (width - 1.0), low_y + (height - 1.0));
    let zero = simd.set(0.0);
    let near_x = zero.max(low_x).min(high_x);
    let near_y = zero.max(low_y).min(high_y);
    let best_y = (near_x * splat.slope_y).max(low_y).min(high_y);
    let best_x = (near_y * splat.slope_x).max(low_x).min(high_x);
    let u1 = near_x * splat.ux;
    let v1 = near_x.mul_add(simd.set(splat.vx), best_y * splat.vy);
    let u2 = best_x * splat.ux;
    let v2 = best_x.mul_add(simd.set(splat.vx), near_y * splat.vy);
    let q1 = u1.mul_add(u1, v1 * v1);
    let q2 = u2.mul_add(u2, v2 * v2);
    q1.min(q2).simd_le(simd.set(splat.reach)).to_bitmask() as u32
}

/// The patches that the box of a splat touches.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct PatchBox {
    /// First and last column.
    pub(crate) columns: [u16; 2],
    /// First and last row.
    pub(crate) rows: [u16; 2],
}

/// Pairs of a tile and a key, in the order of the splats, and how many there are of each tile.
#[derive(Debug, Default)]
pub(crate) struct Pairs {
    len: usize,
    tiles: Vec<u32>,
    keys: Vec<u64>,
    /// After [`offsets`]: the next free position in each tile's list.
    counts: Vec<u32>,
}

impl Pairs {
    /// Bytes of a pair, with those of its key in the list of the tile.
    pub(crate) const PAIR_BYTES: usize = size_of::<u32>() + 2 * size_of::<u64>();

    /// Forgets all pairs.
    pub(crate) fn clear(&mut self, grid: TileGrid) {
        self.len = 0;
        self.counts.clear();
        // One row and column more than there are tiles: pairs are written four at a time and only
        // those that are there are kept.
        self.counts.resize(grid.tiles() + grid.columns as usize + 2, 0);
    }

    /// Adds the tiles of splats, whose records are numbered from `first`.
    #[inline(always)]
    pub(crate) fn extend<S: Lanes>(
        &mut self,
        simd: S,
        splats: &[Record],
        boxes: &[PatchBox],
        first: u32,
        grid: TileGrid,
    ) {
        const PATCH_SIDE_PX: f32 = PATCH as f32;
        /// Bit k of the index at bit 4 k.
        const ROW_MASKS: [u32; 16] = [
            0x0000, 0x0001, 0x0010, 0x0011, 0x0100, 0x0101, 0x0110, 0x0111, 0x1000, 0x1001, 0x1010, 0x1011,
            0x1100, 0x1101, 0x1110, 0x1111,
        ];
        let lanes = cell_lanes(simd);
        let tile_columns = grid.columns as usize;
        let mut len = self.len;
        for (i, (splat, bounds)) in splats.iter().zip(boxes).enumerate() {
            let record = first + i as u32;
            let depth_bits = splat.depth.to_bits();
            let [first_x, last_x] = bounds.columns.map(u32::from);
            let [first_y, last_y] = bounds.rows.map(u32::from);
            // Fields of 4x4 patches, two tiles each way, the first on an even patch. Most splats
            // need one; there are no branches on what a field holds, since none could be predicted.
            let mut y = first_y & !1;
            loop {
                let mut x = first_x & !1;
                loop {
                    if self.tiles.len() < len + 4 {
                        self.grow();
                    }
                    let mut mask = 0;
                    for part in 0..16 / S::N {
                        let top = (y as f32 + (part * S::N / 4) as f32) * PATCH_SIDE_PX;
                        let bits = cell_mask(
                            simd,
                            &splat.ellipse(),
                            x as f32 * PATCH_SIDE_PX,
                            top,
                            PATCH_SIDE_PX,
                            PATCH_SIDE_PX,
                            lanes.0,
                            lanes.1,
                        );
                        mask |= bits << (part * S::N);
                    }
                    let columns = bits_between(first_x.saturating_sub(x), last_x - x);
                    let rows = bits_between(first_y.saturating_sub(y), last_y - y);
                    mask &= ROW_MASKS[rows as usize] * columns;
                    let tile = (y as usize >> 1) * tile_columns + (x as usize >> 1);
                    let fields =
                        [(tile, 0), (tile + 1, 2), (tile + tile_columns, 8), (tile + tile_columns + 1, 10)];
                    for (tile, shift) in fields {
                        let patches = (mask >> shift & 3) | (mask >> (shift + 4) & 3) << 2;
                        let present = u32::from(patches != 0);
                        self.tiles[len] = tile as u32;
                        self.keys[len] = key(depth_bits, record, patches);
                        self.counts[tile] += present;
                        len += present as usize;
                    }
                    x += 4;
                    if x > last_x {
                        break;
                    }
                }
                y += 4;
                if y > last_y {
                    break;
                }
            }
        }
        self.len = len;
    }

    #[cold]
    fn grow(&mut self) {
        let room = (2 * self.tiles.len()).max(1024);
        self.tiles.resize(room, 0);
        self.keys.resize(room, 0);
    }

    /// Writes the keys to the tile lists.
    ///
    /// The lists are atomics so that parts may write at once without unsafe code: each position has
    /// one writer, and a relaxed store is a plain one.
    pub(crate) fn scatter(&mut self, lists: &[AtomicU64]) {
        for (tile, key) in self.tiles[..self.len].iter().zip(&self.keys) {
            let slot = &mut self.counts[*tile as usize];
            lists[*slot as usize].store(*key, Ordering::Relaxed);
            *slot += 1;
        }
    }
}

impl Pairs {
    /// Number of pairs.
    pub(crate) fn len(&self) -> usize {
        self.len
    }

    /// The record of each pair, ascending.
    pub(crate) fn records(&self) -> impl Iterator<Item = usize> {
        self.keys[..self.len].iter().map(|key| record_of(*key))
    }

    /// Like [`Self::scatter`], but what the keys name is the pair, numbered from `first`; what they
    /// would have named goes to `words`, one a pair. The order of pairs is that of records, so the
    /// order of keys is the same.
    pub(crate) fn scatter_numbered(&mut self, first: usize, lists: &[AtomicU64], words: &[AtomicU32]) {
        let words = &words[first..first + self.len];
        for (i, (tile, key)) in self.tiles[..self.len].iter().zip(&self.keys).enumerate() {
            let slot = &mut self.counts[*tile as usize];
            lists[*slot as usize].store(*key >> 32 << 32 | (first + i) as u64, Ordering::Relaxed);
            words[i].store(*key as u32, Ordering::Relaxed);
            *slot += 1;
        }
    }
}

/// Bits `first` to `last` of four; `last` may lie beyond.
#[inline(always)]
fn bits_between(first: u32, last: u32) -> u32 {
    (0xf << first) & (0xf >> (3 - last.min(3)))
}

/// Lays out the tile lists: turns the counts of each part into its first position in each list, and
/// gives the lists' bounds, `[tiles + 1]`.
pub(crate) fn offsets<'a>(tiles: usize, parts: impl Iterator<Item = &'a mut Pairs>, bounds: &mut Vec<u32>) {
    bounds.clear();
    bounds.resize(tiles + 1, 0);
    let mut parts: Vec<&mut [u32]> = parts.map(|pairs| &mut pairs.counts[..tiles]).collect();
    let mut sum = 0;
    for tile in 0..tiles {
        bounds[tile] = sum;
        for counts in &mut parts {
            let count = counts[tile];
            counts[tile] = sum;
            sum += count;
        }
    }
    bounds[tiles] = sum;
}

const _: () =
    assert!(TILE == 2 * PATCH && PATCHES_PER_TILE == 4, "the fields of `Pairs::add` are two tiles wide");
