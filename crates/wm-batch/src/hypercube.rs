//! A Latin hypercube of any size by random access: point `i` is found without the others.
//!
//! Along each dimension the N points lie in N strata of equal width, one in each, in the order of a
//! random permutation: `x = (permutation(i) + u) / N`. The permutation is a Feistel network of four
//! rounds on the smallest even number of bits that holds N, walked until it lands below N (Black
//! and Rogaway 2002), so that it takes no memory.

use wm_base::random::{bits, mix, uniform};

const FEISTEL_ROUNDS: u64 = 4;

/// A random permutation of the numbers below a count.
#[derive(Clone, Copy, Debug)]
pub struct RandomPermutation {
    count: u64,
    half: u32,
    seed: u64,
}

impl RandomPermutation {
    /// The permutation of a seed; `count` must be above 0 and at most 2^62.
    #[must_use]
    pub fn new(seed: u64, count: u64) -> Self {
        let needed = u64::BITS - count.saturating_sub(1).leading_zeros();
        Self { count, half: needed.div_ceil(2).max(1), seed }
    }

    /// The place of number `index` in the permutation.
    #[must_use]
    pub fn at(&self, index: u64) -> u64 {
        let mut value = index;
        // Less than four times as many numbers as are needed: the walk is short.
        loop {
            value = self.network(value);
            if value < self.count {
                return value;
            }
        }
    }

    fn network(&self, value: u64) -> u64 {
        let mask = (1u64 << self.half) - 1;
        let (mut left, mut right) = (value >> self.half, value & mask);
        for round in 0..FEISTEL_ROUNDS {
            let mixed = bits(self.seed.wrapping_add(round), right) & mask;
            (left, right) = (right, left ^ mixed);
        }
        left << self.half | right
    }
}

/// A Latin hypercube. Dimensions are named, so that one more changes none of the others.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LatinHypercube {
    seed: u64,
    count: u64,
}

impl LatinHypercube {
    /// So many points; `count` must be above 0 and at most 2^62.
    pub(crate) fn new(seed: u64, count: u64) -> Self {
        Self { seed, count }
    }

    /// The coordinate of a point along a dimension, from 0 up to 1.
    pub(crate) fn at(&self, index: u64, dimension: &str) -> f64 {
        let seed = self.dimension(dimension);
        let stratum = RandomPermutation::new(seed, self.count).at(index);
        // Below 1, whatever the rounding.
        ((stratum as f64 + uniform(!seed, index)) / self.count as f64).min(1.0 - f64::EPSILON)
    }

    fn dimension(&self, name: &str) -> u64 {
        name.bytes().fold(mix(self.seed), |hash, byte| mix(hash ^ u64::from(byte)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn permutations_reach_every_number_once() {
        for count in [1u64, 2, 3, 4, 5, 16, 17, 1000] {
            let permutation = RandomPermutation::new(7, count);
            let mut reached: Vec<u64> = (0..count).map(|index| permutation.at(index)).collect();
            reached.sort_unstable();
            assert!(reached.iter().copied().eq(0..count), "{count}");
        }
    }

    #[test]
    fn a_million_points_are_one_in_each_stratum_and_dimensions_are_independent() {
        const COUNT: u64 = 1_000_000;
        let cube = LatinHypercube::new(3, COUNT);
        let mut seen = vec![false; COUNT as usize];
        let (mut product, mut squares) = (0.0, 0.0);
        for index in 0..COUNT {
            let [x, y] = ["fog.mor", "rain.rate"].map(|name| cube.at(index, name));
            let stratum = (x * COUNT as f64) as usize;
            assert!(!std::mem::replace(&mut seen[stratum], true), "stratum {stratum} twice");
            product += (x - 0.5) * (y - 0.5);
            squares += (y - 0.5).powi(2);
        }
        // The Kolmogorov-Smirnov distance of points that are one in each stratum is at most a
        // stratum.
        assert!((squares / COUNT as f64 - 1.0 / 12.0).abs() < 1e-6);
        // The correlation of independent numbers has a standard deviation of 0.001.
        let correlation = 12.0 * product / COUNT as f64;
        assert!(correlation.abs() < 0.005, "{correlation}");
    }

    #[test]
    fn a_part_of_the_points_is_even_too() {
        // The first thousand of a million: their distance from even is that of random numbers, 1.63
        // / sqrt(n) at 1 %.
        let cube = LatinHypercube::new(11, 1_000_000);
        let mut xs: Vec<f64> = (0..1000).map(|index| cube.at(index, "wind.speed")).collect();
        xs.sort_by(f64::total_cmp);
        let distance =
            |k: usize| (xs[k] - k as f64 / 1000.0).abs().max((xs[k] - (k + 1) as f64 / 1000.0).abs());
        let most = (0..1000).map(distance).fold(0.0, f64::max);
        assert!(most < 1.63 / 1000f64.sqrt(), "{most}");
    }
}
