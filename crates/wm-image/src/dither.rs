//! A blue-noise pattern to add before rounding: 64x64, three channels, the same on every machine.
//!
//! Rounding a slow gradient to 8 bits draws contours, which the eye finds at once in fog. Adding an
//! offset `t(x, y)` within half a step first makes the mean over a neighbourhood right instead, if
//! the offsets in every neighbourhood are spread evenly over (-1/2, 1/2); and the noise is hard to
//! see if its energy is at high frequencies. Both hold for the void-and-cluster method (R.
//! Ulichney, "The void-and-cluster method for dither array generation", Proc. SPIE 1913, 1993),
//! followed here with one departure: the paper's third phase, which looks for clusters of the
//! minority, picks the same pixels as its second one since the filter is linear, so one loop does
//! both.
//!
//! The pattern does not change from frame to frame: a still picture stays still, and a video
//! encoder need not send it again.

use std::sync::LazyLock;

/// Side of the pattern, which repeats after that.
pub(crate) const PATTERN_SIDE_PX: usize = 64;
const PATTERN_CELLS: usize = PATTERN_SIDE_PX * PATTERN_SIDE_PX;
/// Standard deviation of the filter that finds voids and clusters (Ulichney's choice).
const FILTER_SIGMA_PX: f64 = 1.5;

/// Offsets of three channels, each `[side, side]`, in steps, within 1/2 - 1/8192 of 0.
///
/// That they keep away from 1/2 lets a value that is a multiple of the quantisation step, up to
/// rounding errors of f32, come out as this multiple at every pixel.
pub(crate) static OFFSETS: LazyLock<[Vec<f32>; 3]> = LazyLock::new(|| {
    let ranks = void_and_cluster();
    // Shifts of one pattern by about a third of its side do not resemble each other, and equal
    // values in three channels then do not dither to grey noise.
    [(0, 0), (23, 41), (43, 19)].map(|(shift_x, shift_y)| {
        (0..PATTERN_CELLS)
            .map(|cell| {
                let (x, y) = (
                    (cell % PATTERN_SIDE_PX + shift_x) % PATTERN_SIDE_PX,
                    (cell / PATTERN_SIDE_PX + shift_y) % PATTERN_SIDE_PX,
                );
                (f32::from(ranks[y * PATTERN_SIDE_PX + x]) + 0.5) / PATTERN_CELLS as f32 - 0.5
            })
            .collect()
    })
});

/// [`OFFSETS`] as `[side, side, 3]`, for interleaved pixels.
pub(crate) static INTERLEAVED: LazyLock<Vec<f32>> = LazyLock::new(|| {
    (0..PATTERN_CELLS).flat_map(|cell| OFFSETS.each_ref().map(|channel| channel[cell])).collect()
});

/// Ranks of all cells, `[side, side]`: pixels of rank below `n` are spread evenly for every `n`.
fn void_and_cluster() -> Vec<u16> {
    let kernel = kernel();
    let mut pattern = Pattern::new(&kernel);
    let mut seed = 1u32;
    while pattern.count < PATTERN_CELLS / 10 {
        // Any start will do: the relaxation below forgets it.
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let cell = (seed >> 20) as usize;
        if !pattern.set[cell] {
            pattern.flip(cell);
        }
    }
    // Move the pixel in the tightest cluster to the largest void until it is the same place.
    loop {
        let cluster = pattern.tightest_cluster();
        pattern.flip(cluster);
        let void = pattern.largest_void();
        pattern.flip(void);
        if void == cluster {
            break;
        }
    }
    let mut ranks = vec![0u16; PATTERN_CELLS];
    let start = (pattern.set.clone(), pattern.energy.clone(), pattern.count);
    while pattern.count > 0 {
        let cluster = pattern.tightest_cluster();
        pattern.flip(cluster);
        ranks[cluster] = pattern.count as u16;
    }
    (pattern.set, pattern.energy, pattern.count) = start;
    while pattern.count < PATTERN_CELLS {
        let void = pattern.largest_void();
        ranks[void] = pattern.count as u16;
        pattern.flip(void);
    }
    ranks
}

/// A Gaussian on the torus, in integers: adding and removing pixels then leaves no rounding errors,
/// and ties are the same everywhere. `[side, side]`, indexed by the distances in x and y.
fn kernel() -> Vec<u64> {
    (0..PATTERN_CELLS)
        .map(|cell| {
            let wrapped = |d: usize| d.min(PATTERN_SIDE_PX - d) as f64;
            let (dx, dy) = (wrapped(cell % PATTERN_SIDE_PX), wrapped(cell / PATTERN_SIDE_PX));
            // exp(-q) as (1 - q/n)^n, n = 2^16: plain products are the same on every machine, the
            // system's exp is not.
            let mut value =
                (1.0 - (dx * dx + dy * dy) / (2.0 * FILTER_SIGMA_PX * FILTER_SIGMA_PX) / 65_536.0).max(0.0);
            for _ in 0..16 {
                value *= value;
            }
            (value * 2f64.powi(40)) as u64
        })
        .collect()
}

/// A set of pixels on the torus and its density.
struct Pattern<'a> {
    kernel: &'a [u64],
    set: Vec<bool>,
    energy: Vec<u64>,
    count: usize,
}

impl<'a> Pattern<'a> {
    fn new(kernel: &'a [u64]) -> Self {
        Self { kernel, set: vec![false; PATTERN_CELLS], energy: vec![0; PATTERN_CELLS], count: 0 }
    }

    /// Adds the pixel or takes it away.
    fn flip(&mut self, cell: usize) {
        let (x, y) = (cell % PATTERN_SIDE_PX, cell / PATTERN_SIDE_PX);
        let add = !self.set[cell];
        self.set[cell] = add;
        self.count = if add { self.count + 1 } else { self.count - 1 };
        for (row, energy) in self.energy.chunks_exact_mut(PATTERN_SIDE_PX).enumerate() {
            let kernel_row = &self.kernel[row.abs_diff(y) * PATTERN_SIDE_PX..][..PATTERN_SIDE_PX];
            for (column, energy) in energy.iter_mut().enumerate() {
                let term = kernel_row[column.abs_diff(x)];
                *energy = if add { *energy + term } else { *energy - term };
            }
        }
    }

    fn tightest_cluster(&self) -> usize {
        // Of equals the first, in both searches.
        (0..PATTERN_CELLS)
            .filter(|&cell| self.set[cell])
            .min_by_key(|&cell| u64::MAX - self.energy[cell])
            .expect("a pixel")
    }

    fn largest_void(&self) -> usize {
        (0..PATTERN_CELLS)
            .filter(|&cell| !self.set[cell])
            .min_by_key(|&cell| self.energy[cell])
            .expect("a gap")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn is_a_permutation_and_the_same_everywhere() {
        let ranks = void_and_cluster();
        let mut sorted = ranks.clone();
        sorted.sort_unstable();
        assert!(sorted.iter().enumerate().all(|(index, &rank)| index == usize::from(rank)));
        // FNV-1a: a change of the pattern changes every picture's bytes, so it must be meant.
        let hash = ranks.iter().fold(0xcbf2_9ce4_8422_2325u64, |hash, &rank| {
            (hash ^ u64::from(rank)).wrapping_mul(0x0100_0000_01b3)
        });
        assert_eq!(format!("{hash:016x}"), "ba7a8ef29faebbe9");
    }

    #[test]
    fn small_neighbourhoods_are_spread_evenly() {
        // A flat area's mean is off by how many offsets too many lie below its fraction: measured
        // at most 0.034 of a step over 16x16 pixels anywhere, 0.091 over 8x8.
        for channel in OFFSETS.iter() {
            for level in [0.05, 0.25, 0.5, 0.75, 0.95] {
                for start in 0..PATTERN_CELLS {
                    let below = (0..256).filter(|i| {
                        let (x, y) = (start % PATTERN_SIDE_PX + i % 16, start / PATTERN_SIDE_PX + i / 16);
                        channel[y % PATTERN_SIDE_PX * PATTERN_SIDE_PX + x % PATTERN_SIDE_PX] + 0.5 < level
                    });
                    let error = below.count() as f32 / 256.0 - level;
                    assert!(error.abs() < 0.05, "{error} at {start}, level {level}");
                }
            }
        }
    }
}
