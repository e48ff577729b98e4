//! Random numbers of production code: each a pure function of a seed and an index.
//!
//! There is no hidden state and no order of calls: the same key gives the same number on every
//! thread, in every process and on the GPU, so pictures and trainings repeat bit for bit and a
//! training that was interrupted continues with the numbers it would have drawn. All generators
//! share one 64-bit mixing function, [`mix`]; the particles of weather use the 32-bit [`pcg4d`],
//! which GPUs and SIMD lanes compute natively.
//!
//! - [`uniform`]: number `index` of a seed.
//! - [`RandomStream`]: the numbers of one purpose at one time, also normal numbers and
//!   permutations.
//! - [`RandomSequence`]: numbers drawn one after the other, for code that needs an unknown number
//!   of them.
//! - [`pcg4d`]: four 32-bit numbers as a function of four.
//!
//! These numbers are part of the file formats in effect: pictures and checkpoints depend on them,
//! and tests pin them. None of the generators is cryptographic.
//!
//! ```
//! use wm_base::random::{RandomStream, uniform};
//!
//! assert_eq!(uniform(7, 3), uniform(7, 3));
//! assert!((0.0..1.0).contains(&uniform(7, 4)));
//! let order = RandomStream::new(7, 1u64, 0).permutation(10);
//! assert!((0..10).all(|index| order.contains(&index)));
//! ```

use std::f64::consts::TAU;

/// 2^64 over the golden ratio, odd: the step of RandomSequence's Weyl sequence, and the factor of
/// seeds in [`bits`].
pub const SEED_FACTOR: u64 = 0x9e37_79b9_7f4a_7c15;
/// The factor of indices in [`bits`].
pub const INDEX_FACTOR: u64 = 0xd1b5_4a32_d192_ed03;
/// The factors of the two rounds of [`mix`].
pub const MIX_FACTORS: [u64; 2] = [0xbf58_476d_1ce4_e5b9, 0x94d0_49bb_1331_11eb];
/// Multiplier and increment of the first step of [`pcg4d`] (Numerical Recipes).
pub const PCG: [u32; 2] = [1_664_525, 1_013_904_223];

/// The finaliser of RandomSequence (Steele, Lea and Flood 2014): every input bit changes half of
/// the output bits.
#[inline]
#[must_use]
pub const fn mix(mut z: u64) -> u64 {
    z = (z ^ z >> 30).wrapping_mul(MIX_FACTORS[0]);
    z = (z ^ z >> 27).wrapping_mul(MIX_FACTORS[1]);
    z ^ z >> 31
}

/// The 64 random bits of `index` under `seed`.
#[inline]
#[must_use]
pub const fn bits(seed: u64, index: u64) -> u64 {
    mix(seed.wrapping_mul(SEED_FACTOR) ^ index.wrapping_mul(INDEX_FACTOR))
}

/// The random number of `index` under `seed`, uniform in [0, 1): [`bits`] over 2^64.
///
/// Rounding to `f64` gives exactly 1 with a probability of 2^-54.
#[inline]
#[must_use]
pub fn uniform(seed: u64, index: u64) -> f64 {
    bits(seed, index) as f64 / 2f64.powi(64)
}

/// The random numbers of one purpose at one time, each known by its index.
///
/// ```
/// use wm_base::random::RandomStream;
///
/// let noise = RandomStream::new(1, 4u64, 600);
/// assert_eq!(noise.uniform(12), noise.uniform(12));
/// assert_ne!(noise.uniform(12), RandomStream::new(1, 4u64, 601).uniform(12));
/// assert!(noise.below(0, 6) < 6);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RandomStream(u64);

impl RandomStream {
    /// The stream of a seed for a purpose (0 to 255) at a time (0 to 2^32 - 1), such as a training
    /// step.
    #[must_use]
    pub fn new(seed: u64, purpose: impl Into<u64>, time: u32) -> Self {
        let mixed = seed ^ purpose.into() << 56 ^ u64::from(time) << 20;
        Self(uniform(mixed, 0x5ca1_ab1e).to_bits() ^ mixed.rotate_left(23))
    }

    /// The seed under which [`uniform`] gives this stream's numbers.
    #[must_use]
    pub fn seed(self) -> u64 {
        self.0
    }

    /// Number `index`, uniform in [0, 1).
    #[must_use]
    pub fn uniform(self, index: u64) -> f64 {
        uniform(self.0, index)
    }

    /// Number `index` as a whole number below `count`, which must be above 0.
    #[must_use]
    pub fn below(self, index: u64, count: usize) -> usize {
        ((self.uniform(index) * count as f64) as usize).min(count - 1)
    }

    /// Three independent normal numbers of mean 0 and variance 1 for `index`, by Box and Muller's
    /// method.
    ///
    /// They use the uniform numbers `4 * index` to `4 * index + 3`.
    #[must_use]
    pub fn normal3(self, index: u64) -> [f64; 3] {
        let u = |k: u64| self.uniform(4 * index + k);
        let pair = |k: u64| {
            let radius = (-2.0 * (1.0 - u(k)).ln()).sqrt();
            let (sin, cos) = (TAU * u(k + 1)).sin_cos();
            [radius * cos, radius * sin]
        };
        let ([a, b], [c, _]) = (pair(0), pair(2));
        [a, b, c]
    }

    /// The numbers `0..count` in random order (Fisher and Yates).
    #[must_use]
    pub fn permutation(self, count: usize) -> Vec<usize> {
        let mut order: Vec<usize> = (0..count).collect();
        for last in (1..count).rev() {
            order.swap(last, self.below(last as u64, last + 1));
        }
        order
    }
}

/// Random numbers of a key, drawn one after the other: RandomSequence (Steele, Lea and Flood 2014).
#[derive(Clone, Copy, Debug)]
pub struct RandomSequence(u64);

impl RandomSequence {
    /// Starts the sequence of a key.
    #[inline]
    #[must_use]
    pub fn new(key: u64) -> Self {
        Self(key)
    }

    /// Draws the next 64 bits.
    #[inline]
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(SEED_FACTOR);
        mix(self.0)
    }

    /// Draws the next number, uniform in [0, 1), from the upper 53 bits.
    #[inline]
    pub fn uniform(&mut self) -> f64 {
        (self.bits() >> 11) as f64 * 2f64.powi(-53)
    }
}

/// Four 32-bit numbers as a function of four: PCG4D (Jarzynski and Olano 2020).
///
/// The lower half of the bits is mixed less well than the upper half: use the upper bits.
#[must_use]
pub fn pcg4d(mut v: [u32; 4]) -> [u32; 4] {
    v = v.map(|v| v.wrapping_mul(PCG[0]).wrapping_add(PCG[1]));
    for round in 0..2 {
        if round == 1 {
            v = v.map(|v| v ^ v >> 16);
        }
        v[0] = v[0].wrapping_add(v[1].wrapping_mul(v[3]));
        v[1] = v[1].wrapping_add(v[2].wrapping_mul(v[0]));
        v[2] = v[2].wrapping_add(v[0].wrapping_mul(v[1]));
        v[3] = v[3].wrapping_add(v[1].wrapping_mul(v[2]));
    }
    v
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pictures and checkpoints depend on these numbers.
    #[test]
    fn numbers_are_pinned() {
        assert_eq!([bits(0, 0), bits(7, 3)], [0, 0x2ba7_d3aa_3eec_7657]);
        assert_eq!(uniform(7, 3).to_bits(), 0x3fc5_d3e9_d51f_763b);
        assert_eq!(RandomStream::new(7, 3u64, 600).seed(), 0x3fca_fc38_561f_ba99);
        let mut sequence = RandomSequence::new(7);
        assert_eq!(
            [sequence.bits(), sequence.uniform().to_bits()],
            [0x63cb_e1e4_5932_0dd7, 0x3f91_30f3_5fd0_f180]
        );
        assert_eq!(pcg4d([1, 2, 3, 4]), [0x3622_cd16, 0xf114_71d8, 0xe110_9b3f, 0x02b9_4c2f]);
    }

    #[test]
    fn numbers_are_spread_and_independent_of_each_other() {
        let random = RandomStream::new(7, 4u64, 3);
        let count = 20_000;
        let normals: Vec<[f64; 3]> = (0..count).map(|i| random.normal3(i)).collect();
        for k in 0..3 {
            let mean = normals.iter().map(|n| n[k]).sum::<f64>() / count as f64;
            let square = normals.iter().map(|n| n[k] * n[k]).sum::<f64>() / count as f64;
            let cross = normals.iter().map(|n| n[k] * n[(k + 1) % 3]).sum::<f64>() / count as f64;
            // Standard errors are 0.007, 0.01 and 0.007.
            assert!(mean.abs() < 0.03 && (square - 1.0).abs() < 0.04 && cross.abs() < 0.03);
        }
        let mut order = random.permutation(100);
        assert_ne!(order, RandomStream::new(7, 4u64, 4).permutation(100));
        order.sort_unstable();
        assert_eq!(order, (0..100).collect::<Vec<_>>());
    }
}
