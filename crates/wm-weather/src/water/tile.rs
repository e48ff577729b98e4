//! Slopes of a water surface on a tile that repeats, at every fineness.

use super::fft::SIDE;
use rayon::prelude::*;

/// Halvings of a tile down to one node.
const LEVELS: usize = SIDE.trailing_zeros() as usize + 1;

/// The slope of a piece of a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Slope {
    /// Mean slopes along the two level axes.
    pub mean: [f32; 2],
    /// Variance within the piece, along one axis.
    pub variance: f32,
}

/// Slopes of one instant, each level half as fine as the one before: slopes along the two axes and the sum of their
/// squares.
#[derive(Clone, Debug)]
pub struct SlopeTile {
    /// Side of the tile, m.
    size: f32,
    levels: Vec<Vec<[f32; 4]>>,
}

impl SlopeTile {
    /// A tile of `size` metres with these slopes, `[SIDE, SIDE]`.
    #[must_use]
    pub fn new(size: f64, slopes: impl IndexedParallelIterator<Item = [f32; 2]>) -> Self {
        let finest: Vec<[f32; 4]> = slopes.map(|[x, y]| [x, y, x * x + y * y, 0.0]).collect();
        let mut levels = vec![finest];
        for level in 1..LEVELS {
            let (side, from) = (SIDE >> level, &levels[level - 1]);
            let node = |i: usize| -> [f32; 4] {
                let first = 2 * (i / side) * 2 * side + 2 * (i % side);
                std::array::from_fn(|k| {
                    let [a, b] = [first, first + 2 * side].map(|at| from[at][k] + from[at + 1][k]);
                    0.25 * (a + b)
                })
            };
            levels.push((0..side * side).map(node).collect());
        }
        Self { size: size as f32, levels }
    }

    /// The slope of a piece of the surface `width` metres wide about a point, metres.
    #[inline(always)]
    #[must_use]
    pub fn at(&self, x: f64, y: f64, width: f32) -> Slope {
        let size = f64::from(self.size);
        let nodes = (width * SIDE as f32 / self.size).max(1.0).log2();
        let level = nodes.min((LEVELS - 1) as f32);
        let (whole, part) = (level as usize, level.fract());
        // Cut towards 0, far on the positive side: as a remainder, and faster.
        let share = |along: f64| {
            let tiles = along / size + 1e6;
            (tiles - tiles as u64 as f64) as f32
        };
        let (u, v) = (share(x), share(y));
        let mut sum = self.bilinear(whole, u, v);
        if part > 0.0 {
            let coarse = self.bilinear((whole + 1).min(LEVELS - 1), u, v);
            for k in 0..3 {
                sum[k] += part * (coarse[k] - sum[k]);
            }
        }
        let variance = 0.5 * (sum[2] - sum[0] * sum[0] - sum[1] * sum[1]).max(0.0);
        Slope { mean: [sum[0], sum[1]], variance }
    }

    #[inline(always)]
    fn bilinear(&self, level: usize, u: f32, v: f32) -> [f32; 4] {
        let side = SIDE >> level;
        let nodes = &self.levels[level];
        let (u, v) = (u * side as f32 - 0.5 + side as f32, v * side as f32 - 0.5 + side as f32);
        let (column, row) = (u as usize, v as usize);
        let (fx, fy) = (u - column as f32, v - row as f32);
        let [left, right] = [column & (side - 1), (column + 1) & (side - 1)];
        let [top, bottom] = [row & (side - 1), (row + 1) & (side - 1)].map(|row| row * side);
        let [a, b, c, d] = [top + left, top + right, bottom + left, bottom + right].map(|at| &nodes[at]);
        std::array::from_fn(|k| {
            let upper = a[k] + fx * (b[k] - a[k]);
            let lower = c[k] + fx * (d[k] - c[k]);
            upper + fy * (lower - upper)
        })
    }
}
