//! Slopes of a water surface on a tile that repeats, at every fineness.
//!
//! A coarser level has the means of the slopes and of their squares. The squares tell how rough a
//! pixel is that is too wide to show the waves.

use super::fft::TILE_SIDE_NODES;
use crate::lanes::{LaneArray, LaneIndices, SetLanes, TWO_23};
use fearless_simd::{Select, Simd, SimdBase, SimdFloat, f32x4, f32x8};
use rayon::prelude::*;
use wm_render::simd::Lanes;

/// Levels of a tile, each half as fine as the one before, down to one node.
const LEVEL_COUNT: usize = TILE_SIDE_NODES.trailing_zeros() as usize + 1;

/// Slopes of one instant, each level half as fine as the one before: slopes along the two axes and
/// the sum of their squares.
#[derive(Clone, Debug)]
pub(crate) struct SlopeTile {
    /// Side of the tile, m.
    size: f32,
    /// All levels, finest first. Each row ends with its first node once more, and each level with
    /// its first row.
    nodes: Vec<[f32; 4]>,
}

/// The first node of each level.
const FIRST_NODES: [usize; LEVEL_COUNT] = {
    let (mut first, mut level) = ([0; LEVEL_COUNT], 1);
    while level < LEVEL_COUNT {
        let stride = (TILE_SIDE_NODES >> (level - 1)) + 1;
        first[level] = first[level - 1] + stride * stride;
        level += 1;
    }
    first
};

/// The factor on the slopes of nodes that gives the slopes mixed of them the variance of the nodes,
/// from how alike nodes beside each other are. At most that of waves of three nodes.
fn mixing_gain(nodes: &[[f32; 4]]) -> f32 {
    const MAX_GAIN: f64 = 1.5;
    let product = |right: usize, down: usize| -> f64 {
        let other = |at: usize| {
            (at / TILE_SIDE_NODES + down) % TILE_SIDE_NODES * TILE_SIDE_NODES
                + (at % TILE_SIDE_NODES + right) % TILE_SIDE_NODES
        };
        let dot = |at: usize| {
            let [a, b] = [nodes[at], nodes[other(at)]];
            f64::from(a[0] * b[0] + a[1] * b[1])
        };
        (0..nodes.len()).map(dot).sum()
    };
    let own = product(0, 0);
    // The mean over a cell of the squares of what is mixed between its corners.
    let diagonals = 0.5 * (product(1, 1) + product(TILE_SIDE_NODES - 1, 1));
    let mixed = 4.0 / 9.0 * own + 2.0 / 9.0 * (product(1, 0) + product(0, 1)) + diagonals / 9.0;
    if own > 0.0 { (own / mixed.max(1e-9 * own)).sqrt().min(MAX_GAIN) as f32 } else { 1.0 }
}

impl SlopeTile {
    /// A tile of `size` metres with these slopes, `[TILE_SIDE_NODES, TILE_SIDE_NODES]`.
    pub(crate) fn new(size: f64, slopes: impl IndexedParallelIterator<Item = [f32; 2]>) -> Self {
        let mut level: Vec<[f32; 4]> = slopes.map(|[x, y]| [x, y, x * x + y * y, 0.0]).collect();
        // What is mixed between nodes is flatter than they are: the shorter the waves the more.
        let gain = mixing_gain(&level);
        let mut nodes = Vec::with_capacity(FIRST_NODES[LEVEL_COUNT - 1] + 4);
        for side in (0..LEVEL_COUNT).map(|level| TILE_SIDE_NODES >> level) {
            let row = |y: usize| &level[y * side..(y + 1) * side];
            for y in (0..side).chain([0]) {
                nodes.extend_from_slice(row(y));
                nodes.push(row(y)[0]);
            }
            let node = |x: usize, y: usize| -> [f32; 4] {
                let [above, below] = [&row(2 * y)[2 * x..][..2], &row(2 * y + 1)[2 * x..][..2]];
                std::array::from_fn(|k| 0.25 * (above[0][k] + above[1][k] + (below[0][k] + below[1][k])))
            };
            let half = side / 2;
            level = (0..half).flat_map(|y| (0..half).map(move |x| (x, y))).map(|(x, y)| node(x, y)).collect();
        }
        for [x, y, ..] in &mut nodes[..FIRST_NODES[1]] {
            (*x, *y) = (gain * *x, gain * *y);
        }
        Self { size: size as f32, nodes }
    }

    /// The share of a tile at which a point lies, metres.
    pub(crate) fn phase(&self, along: f64) -> f32 {
        (along / f64::from(self.size)).rem_euclid(1.0) as f32
    }

    /// The slopes of pieces of the surface about points: metres from a point whose [`Self::phase`]
    /// along both axes is `phase`, with the logarithms to base 2 of their widths, m. Lanes without
    /// a bit in `wanted` have none. Returns the two mean slopes, and their variance within the
    /// piece along one axis.
    #[inline(always)]
    pub(crate) fn at<S: Lanes>(
        &self,
        simd: S,
        points: [S::F; 2],
        phase: [f32; 2],
        log_width: S::F,
        wanted: u32,
    ) -> [S::F; 3] {
        let finest = (TILE_SIDE_NODES as f32 / self.size).log2();
        let level = (log_width + finest).max(simd.set(0.0)).min(simd.set((LEVEL_COUNT - 1) as f32));
        let whole = level.floor();
        let coarse = (whole + 1.0).min(simd.set((LEVEL_COUNT - 1) as f32));
        let mut share = points;
        for k in 0..2 {
            let tiles = points[k].mul_add(simd.set(1.0 / self.size), simd.set(phase[k]));
            share[k] = tiles - tiles.floor();
        }
        // Written out: a closure in `map` would be compiled without the path's instructions.
        let spots = [Spots::new(simd, share, whole), Spots::new(simd, share, coarse)];
        let part = LaneArray::new(simd, level - whole);
        let mut sums = [[0.0f32; 16]; 3];
        for i in SetLanes(wanted) {
            let (fine, coarse) = (spots[0].look(simd, i, &self.nodes), spots[1].look(simd, i, &self.nodes));
            let mut sum = [0.0; 4];
            ((coarse - fine) * part.0[i] + fine).store_slice(&mut sum);
            for k in 0..3 {
                sums[k][i] = sum[k];
            }
        }
        let [x, y, squares] = [simd.load(&sums[0]), simd.load(&sums[1]), simd.load(&sums[2])];
        [x, y, ((squares - x * x - y * y) * 0.5).max(simd.set(0.0))]
    }
}

/// `2^-level` of whole levels.
#[inline(always)]
pub(super) fn fineness<S: Lanes>(simd: S, level: S::F) -> S::F {
    let level = (level + TWO_23).to_bits() & S::U::splat(simd, 0xff);
    S::F::from_bits((S::U::splat(simd, 127) - level) << 23)
}

/// The nodes about points, one level each.
struct Spots {
    level: LaneIndices,
    column: LaneIndices,
    row: LaneIndices,
    right: LaneArray,
    down: LaneArray,
}

impl Spots {
    /// About points that lie at these shares of the tile.
    #[inline(always)]
    fn new<S: Lanes>(simd: S, share: [S::F; 2], level: S::F) -> Self {
        let side = fineness(simd, level) * TILE_SIDE_NODES as f32;
        let (mut node, mut part) = (share, share);
        for k in 0..2 {
            let at = share[k].mul_add(side, simd.set(-0.5));
            let at = at.simd_lt(simd.set(0.0)).select(at + side, at);
            node[k] = at.floor().min(side - 1.0);
            part[k] = at - node[k];
        }
        Self {
            level: LaneIndices::new(simd, level),
            column: LaneIndices::new(simd, node[0]),
            row: LaneIndices::new(simd, node[1]),
            right: LaneArray::new(simd, part[0]),
            down: LaneArray::new(simd, part[1]),
        }
    }

    /// Mixes the nodes about point `i`.
    #[inline(always)]
    fn look<S: Simd>(&self, simd: S, i: usize, nodes: &[[f32; 4]]) -> f32x4<S> {
        let level = self.level.0[i] as usize % LEVEL_COUNT;
        let stride = (TILE_SIDE_NODES >> level) + 1;
        let at = FIRST_NODES[level] + self.row.0[i] as usize * stride + self.column.0[i] as usize;
        bilinear(simd, nodes, at, stride, self.right.0[i], self.down.0[i])
    }
}

/// Mixes the node `at`, the next one, and those `stride` after both.
#[inline(always)]
pub(super) fn bilinear<S: Simd>(
    simd: S,
    nodes: &[[f32; 4]],
    at: usize,
    stride: usize,
    right: f32,
    down: f32,
) -> f32x4<S> {
    // Both columns at once.
    let above = f32x8::from_slice(simd, nodes[at..at + 2].as_flattened());
    let below = f32x8::from_slice(simd, nodes[at + stride..at + stride + 2].as_flattened());
    let (a, b) = simd.split_f32x8((below - above).mul_add(down, above));
    (b - a).mul_add(right, a)
}

#[cfg(test)]
mod tests {
    use super::*;
    use wm_render::dispatch;
    use wm_render::simd::SimdPath;

    /// The mean slopes of a millimetre about a place, m.
    #[inline(always)]
    fn at<S: Lanes>(simd: S, tile: &SlopeTile, place: [f64; 2]) -> [f32; 2] {
        let phase = place.map(|along| tile.phase(along));
        let [x, y, _] = tile.at(simd, [simd.set(0.0); 2], phase, simd.set(-10.0), 1);
        [x, y].map(|slope| LaneArray::new(simd, slope).0[0])
    }

    /// Waves of four nodes have their slopes between nodes too, in the mean.
    #[test]
    fn short_waves_keep_their_slopes() {
        let node = |at: usize| {
            let phase = std::f32::consts::TAU
                * (70 * (at % TILE_SIDE_NODES) + 30 * (at / TILE_SIDE_NODES)) as f32
                / TILE_SIDE_NODES as f32;
            [0.1 * phase.cos(), 0.05 * phase.sin()]
        };
        let tile = SlopeTile::new(2.048, (0..TILE_SIDE_NODES * TILE_SIDE_NODES).into_par_iter().map(node));
        let mut sum = 0.0;
        let places = 40_000;
        for k in 0..places {
            let place = [0.002_7 * f64::from(k), 0.001_3 * f64::from(k) * f64::from(k % 7)];
            let [x, y] = dispatch!(SimdPath::widest(), s => at(s, &tile, place));
            sum += f64::from(x * x + y * y);
        }
        let rms = (sum / f64::from(places)).sqrt();
        let want = (0.5f64 * (0.1 * 0.1 + 0.05 * 0.05)).sqrt();
        assert!((rms / want - 1.0).abs() < 0.03, "{rms} {want}");
    }
}
