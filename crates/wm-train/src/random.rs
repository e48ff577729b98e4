//! Random numbers as a pure function of what they are for: a training that is broken off and gone on with
//! draws the same.

use wm_scene::synthetic::uniform;

/// The purpose of random numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// The order of the photos.
    Order = 1,
    /// Starting positions of splats.
    Start = 2,
    /// The choice of splats that are copied.
    Sample = 3,
    /// Exploring.
    Noise = 4,
    /// The colour behind.
    Background = 5,
    /// The sizes of patches in which depths are compared.
    Patch = 6,
}

/// The numbers of one purpose at one time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Random(u64);

impl Random {
    /// Of a training's seed, for a purpose, at a step (or epoch).
    #[must_use]
    pub fn new(seed: u64, purpose: Purpose, time: u32) -> Self {
        let mixed = seed ^ (purpose as u64) << 56 ^ u64::from(time) << 20;
        Self(uniform(mixed, 0x5ca1_ab1e).to_bits() ^ mixed.rotate_left(23))
    }

    /// Returns the seed for [`wm_scene::synthetic::uniform`].
    #[must_use]
    pub fn seed(self) -> u64 {
        self.0
    }

    /// Number `index`, uniform in [0, 1).
    #[must_use]
    pub fn uniform(self, index: u64) -> f64 {
        uniform(self.0, index)
    }

    /// Number `index` below `count`, which is above 0.
    #[must_use]
    pub fn below(self, index: u64, count: usize) -> usize {
        ((self.uniform(index) * count as f64) as usize).min(count - 1)
    }

    /// Three independent normal numbers of mean 0 and variance 1 for `index`.
    #[must_use]
    pub fn normal3(self, index: u64) -> [f64; 3] {
        let u = |k: u64| self.uniform(4 * index + k);
        let pair = |k: u64| {
            let radius = (-2.0 * (1.0 - u(k)).ln()).sqrt();
            let (sin, cos) = (std::f64::consts::TAU * u(k + 1)).sin_cos();
            [radius * cos, radius * sin]
        };
        let ([a, b], [c, _]) = (pair(0), pair(2));
        [a, b, c]
    }

    /// `0..count` in random order.
    #[must_use]
    pub fn permutation(self, count: usize) -> Vec<usize> {
        let mut order: Vec<usize> = (0..count).collect();
        for last in (1..count).rev() {
            order.swap(last, self.below(last as u64, last + 1));
        }
        order
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_spread_and_independent_of_each_other() {
        let random = Random::new(7, Purpose::Noise, 3);
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
        assert_ne!(order, Random::new(7, Purpose::Noise, 4).permutation(100));
        order.sort_unstable();
        assert_eq!(order, (0..100).collect::<Vec<_>>());
    }
}
