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

/// The factor on the slopes of nodes that gives the slopes mixed of them the variance of the nodes, from how alike nodes beside each other are. At most that of
/// waves of three nodes.
fn mixing_gain(nodes: &[[f32; 4]]) -> f32 {
    const MOST: f64 = 1.5;
    let product = |right: usize, down: usize| -> f64 {
        let other = |at: usize| (at / SIDE + down) % SIDE * SIDE + (at % SIDE + right) % SIDE;
        let dot = |at: usize| {
            let [a, b] = [nodes[at], nodes[other(at)]];
            f64::from(a[0] * b[0] + a[1] * b[1])
        };
        (0..nodes.len()).map(dot).sum()
    };
    let own = product(0, 0);
    // The mean over a cell of the squares of what is mixed between its corners.
    let diagonals = 0.5 * (product(1, 1) + product(SIDE - 1, 1));
    let mixed = 4.0 / 9.0 * own + 2.0 / 9.0 * (product(1, 0) + product(0, 1)) + diagonals / 9.0;
    if own > 0.0 { (own / mixed.max(1e-9 * own)).sqrt().min(MOST) as f32 } else { 1.0 }
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
        // What is mixed between nodes is flatter than they are: the shorter the waves the more.
        let gain = mixing_gain(&levels[0]);
        for [x, y, ..] in &mut levels[0] {
            (*x, *y) = (gain * *x, gain * *y);
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Waves of four nodes have their slopes between nodes too, in the mean.
    #[test]
    fn short_waves_keep_their_slopes() {
        let node = |at: usize| {
            let phase = std::f32::consts::TAU * (70 * (at % SIDE) + 30 * (at / SIDE)) as f32 / SIDE as f32;
            [0.1 * phase.cos(), 0.05 * phase.sin()]
        };
        let tile = SlopeTile::new(2.048, (0..SIDE * SIDE).into_par_iter().map(node));
        let mut sum = 0.0;
        let places = 40_000;
        for k in 0..places {
            let slope = tile.at(0.002_7 * f64::from(k), 0.001_3 * f64::from(k) * f64::from(k % 7), 0.001);
            sum += f64::from(slope.mean[0] * slope.mean[0] + slope.mean[1] * slope.mean[1]);
        }
        let rms = (sum / f64::from(places)).sqrt();
        let want = (0.5f64 * (0.1 * 0.1 + 0.05 * 0.05)).sqrt();
        assert!((rms / want - 1.0).abs() < 0.03, "{rms} {want}");
    }
}
