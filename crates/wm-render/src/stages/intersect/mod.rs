//! Finds the tiles that each splat touches, and lists the splats of each tile.
//!
//! Contract: the CPU's tile is 32x32 px, four patches of 16x16. Splat and patch intersect if the
//! splat's alpha reaches 1/255 at some point of the rectangle spanned by the patch's pixel centres:
//! the exact maximum of a concave quadratic over a rectangle, which lies in the rectangle at the
//! splat's centre or on one of the two edges that face it. A slack of 1e-3 in log2 alpha keeps
//! rounding from losing a pixel. The test may keep a splat that touches no pixel centre; it never
//! drops one that does.
//!
//! A tile's list holds [`key`]s, in no order; sorted as integers they are in the order of blending:
//! by view z, then by splat index. The lengths of the lists are counted, so that nothing overflows.
//!
//! Large tiles keep the lists short (a splat of a trained scene touches two or three of them), and
//! the patches keep the tests tight.
//!
//! Lists of tiles whose keys hold the patches as four bits have a quarter of the keys of lists of
//! 16x16 px to write and sort, and are nearly as exact.

pub(crate) mod cpu;
#[cfg(feature = "gpu")]
pub(crate) mod gpu;
#[cfg(test)]
mod tests;

use crate::sizes::PATCH;

/// Side of a tile, px.
pub(crate) const TILE: usize = 2 * PATCH;
/// Patches of a tile.
pub(crate) const PATCHES_PER_TILE: usize = 4;
/// Bits of a key that name the record.
const RECORD_BITS: u32 = 28;
/// Most splats in one frame: a key of the tile lists has no more bits for them.
pub(crate) const MAX_SPLATS: usize = 1 << RECORD_BITS;

/// One entry of a tile's list: bits of the view z (positive floats are in the order of their bits),
/// the splat's record, and a bit `2 row + column` for each patch of the tile that it touches.
#[inline(always)]
#[must_use]
pub fn key(depth_bits: u32, record: u32, patches: u32) -> u64 {
    u64::from(depth_bits) << 32 | u64::from(record << 4 | patches)
}

/// The record of a key.
#[inline(always)]
pub(crate) fn record_of(key: u64) -> usize {
    (key as u32 >> 4) as usize
}

/// The tiles of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct TileGrid {
    /// Columns.
    pub(crate) columns: u32,
    /// Rows.
    pub(crate) rows: u32,
}

impl TileGrid {
    /// The tiles of a picture of `width` x `height` px.
    pub(crate) fn new(width: u32, height: u32) -> Self {
        Self { columns: width.div_ceil(TILE as u32), rows: height.div_ceil(TILE as u32) }
    }

    /// Number of tiles.
    pub(crate) fn tiles(&self) -> usize {
        self.columns as usize * self.rows as usize
    }
}
