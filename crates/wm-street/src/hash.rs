//! The place's only randomness: a counter-based hash, and smooth noise made of it.
//!
//! A number depends on its key alone, so nothing here depends on the order of calls.

use glam::{DVec2, DVec3};

/// 64 well mixed bits for `index` under `seed`.
pub(super) fn bits(seed: u64, index: u64) -> u64 {
    let mut state = index.wrapping_mul(0x9E6D_62D0_6F6A_02BB) ^ seed.rotate_left(29) ^ 0x6A09_E667_F3BC_C909;
    for shift in [31, 29, 32] {
        state = (state ^ (state >> shift)).wrapping_mul(0xD1B5_4A32_D192_ED03);
    }
    state ^ (state >> 30)
}

/// A number of `[0, 1)` for `index` under `seed`.
pub(super) fn unit(seed: u64, index: u64) -> f64 {
    (bits(seed, index) >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
}

/// A key for a point of a surface: equal points have equal keys, bit for bit.
pub(super) fn key_of(point: DVec3) -> u64 {
    bits(bits(point.x.to_bits(), point.y.to_bits()), point.z.to_bits())
}

/// A run of numbers under one seed, for building things step by step.
#[derive(Clone, Debug)]
pub(super) struct Dice {
    seed: u64,
    next: u64,
}

impl Dice {
    /// The run of `tag` under `seed`.
    pub(super) fn new(seed: u64, tag: u64) -> Self {
        Self { seed: bits(seed, tag), next: 0 }
    }

    /// The next number of `[0, 1)`.
    pub(super) fn unit(&mut self) -> f64 {
        self.next += 1;
        unit(self.seed, self.next)
    }

    /// The next number between `low` and `high`.
    pub(super) fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// The next number around 0, nearly normal with standard deviation 1, never beyond 3.
    pub(super) fn bell(&mut self) -> f64 {
        (self.unit() + self.unit() + self.unit() + self.unit() - 2.0) * 3f64.sqrt() * 0.866
    }

    /// The next direction, evenly over the sphere.
    pub(super) fn direction(&mut self) -> DVec3 {
        let z = self.range(-1.0, 1.0);
        let (sin, cos) = self.range(0.0, std::f64::consts::TAU).sin_cos();
        let r = (1.0 - z * z).sqrt();
        DVec3::new(r * cos, r * sin, z)
    }
}

/// A number of `[0, 1)` for a lattice cell: 32-bit, since textures ask for it most.
pub(super) fn cell(x: i64, y: i64, seed: u32) -> f64 {
    cell3(x, y, 0, seed)
}

fn cell3(x: i64, y: i64, z: i64, seed: u32) -> f64 {
    let mut h = seed.wrapping_mul(0x9E37_79B1);
    for value in [x as u32, y as u32, z as u32] {
        h = (h ^ value).wrapping_mul(0x85EB_CA6B);
        h ^= h >> 15;
    }
    h = h.wrapping_mul(0xC2B2_AE35);
    f64::from(h ^ (h >> 16)) * (1.0 / 4_294_967_296.0)
}

fn smooth(t: f64) -> f64 {
    t * t * (3.0 - 2.0 * t)
}

/// 0 below `low`, 1 above `high`, smooth between.
pub(super) fn smoothstep(low: f64, high: f64, value: f64) -> f64 {
    smooth(((value - low) / (high - low)).clamp(0.0, 1.0))
}

/// Smooth noise of the plane, cell size 1, between -1 and 1 with mean 0.
pub(super) fn noise2(p: DVec2, seed: u32) -> f64 {
    let base = p.floor();
    let (x, y) = (base.x as i64, base.y as i64);
    let f = DVec2::new(smooth(p.x - base.x), smooth(p.y - base.y));
    let row = |y: i64| {
        let (a, b) = (cell(x, y, seed), cell(x + 1, y, seed));
        a + (b - a) * f.x
    };
    let (low, high) = (row(y), row(y + 1));
    2.0 * (low + (high - low) * f.y) - 1.0
}

/// Smooth noise of space, cell size 1, between -1 and 1 with mean 0.
pub(super) fn noise3(p: DVec3, seed: u32) -> f64 {
    let base = p.floor();
    let (x, y, z) = (base.x as i64, base.y as i64, base.z as i64);
    let f = DVec3::new(smooth(p.x - base.x), smooth(p.y - base.y), smooth(p.z - base.z));
    let row = |y: i64, z: i64| {
        let (a, b) = (cell3(x, y, z, seed), cell3(x + 1, y, z, seed));
        a + (b - a) * f.x
    };
    let slice = |z: i64| {
        let (low, high) = (row(y, z), row(y + 1, z));
        low + (high - low) * f.y
    };
    let (low, high) = (slice(z), slice(z + 1));
    2.0 * (low + (high - low) * f.z) - 1.0
}

/// Octaves of [`noise3`], each half as large and half as strong; `size` is the largest cell, and
/// octaves finer than `width` are left out, so that what is drawn that coarsely does not alias.
pub(super) fn octaves3(p: DVec3, size: f64, octaves: u32, width: f64, seed: u32) -> f64 {
    sum_octaves(size, octaves, width, seed, |cell, seed| noise3(p / cell, seed))
}

/// Octaves of [`noise2`]; see [`octaves3`].
pub(super) fn octaves2(p: DVec2, size: f64, octaves: u32, width: f64, seed: u32) -> f64 {
    sum_octaves(size, octaves, width, seed, |cell, seed| noise2(p / cell, seed))
}

/// Octaves of `noise`, a function of the cell and the seed; see [`octaves3`].
#[inline]
fn sum_octaves(size: f64, octaves: u32, width: f64, seed: u32, noise: impl Fn(f64, u32) -> f64) -> f64 {
    let (mut sum, mut weight, mut cell) = (0.0, 0.55, size);
    for octave in 0..octaves {
        let kept = smoothstep(0.7, 2.0, cell / width);
        if kept <= 0.0 {
            break;
        }
        sum += weight * kept * noise(cell, seed.wrapping_add(octave * 101));
        weight *= 0.5;
        cell *= 0.5;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_even() {
        let n = 20_000;
        let (mut mean, mut square) = (0.0, 0.0);
        for i in 0..n {
            let value = unit(7, i);
            assert!((0.0..1.0).contains(&value));
            mean += value / n as f64;
            square += value * value / n as f64;
        }
        // Standard errors are 0.002 and 0.0021: five of them.
        assert!((mean - 0.5).abs() < 0.01 && (square - 1.0 / 3.0).abs() < 0.011);
    }

    #[test]
    fn noise_is_smooth_and_centred() {
        let (mut sum, mut largest) = (0.0, 0.0f64);
        for i in 0..4000 {
            let p = DVec3::new(f64::from(i) * 0.37, f64::from(i) * 0.11, f64::from(i) * 0.23);
            let value = noise3(p, 3);
            sum += value;
            largest = largest.max((noise3(p + DVec3::splat(1e-4), 3) - value).abs());
        }
        assert!((sum / 4000.0).abs() < 0.05);
        assert!(largest < 2e-3, "{largest}");
    }
}
