//! Random numbers of particles, on vector lanes: the SIMD form of [`wm_base::random::pcg4d`].

use fearless_simd::{SimdBase, SimdFloat};
use wm_base::random::PCG;
use wm_render::simd::Lanes;

pub use wm_base::random::RandomSequence;

/// [`wm_base::random::pcg4d`] on every lane.
#[inline(always)]
pub(crate) fn pcg4d<S: Lanes>(simd: S, mut v: [S::U; 4]) -> [S::U; 4] {
    for k in 0..4 {
        v[k] = v[k] * S::U::splat(simd, PCG[0]) + S::U::splat(simd, PCG[1]);
    }
    for round in 0..2 {
        if round == 1 {
            for k in 0..4 {
                v[k] = v[k] ^ v[k] >> 16;
            }
        }
        v[0] += v[1] * v[3];
        v[1] += v[2] * v[0];
        v[2] += v[0] * v[1];
        v[3] += v[1] * v[2];
    }
    v
}

/// Bits as numbers uniform in (0, 1), from their upper 23.
#[inline(always)]
pub(crate) fn uniform<S: Lanes>(simd: S, bits: S::U) -> S::F {
    // In [1, 2), and down to the middle of the step.
    S::F::from_bits(bits >> 9 | S::U::splat(simd, 0x3f80_0000)) - (1.0 - 0.5 / 8_388_608.0)
}

/// Sine and cosine of a number of turns from -2 to 2, within 2e-6.
#[inline(always)]
pub(crate) fn wave<S: Lanes>(simd: S, turns: S::F) -> [S::F; 2] {
    /// Adding it leaves the nearest whole number, and one and a half times 2^23.
    const ROUNDING_OFFSET: f32 = 12_582_912.0;
    const SIN_COEFFICIENTS: [f32; 5] = [1.0 / 362_880.0, -1.0 / 5040.0, 1.0 / 120.0, -1.0 / 6.0, 1.0];
    const COS_COEFFICIENTS: [f32; 6] =
        [-1.0 / 3_628_800.0, 1.0 / 40_320.0, -1.0 / 720.0, 1.0 / 24.0, -0.5, 1.0];
    // Of half the angle, by their series on a quarter turn either way, and doubled.
    let x = (turns - ((turns + ROUNDING_OFFSET) - ROUNDING_OFFSET)) * std::f32::consts::PI;
    let q = x * x;
    let (mut sin, mut cos) = (simd.set(-1.0 / 39_916_800.0), simd.set(0.0));
    for term in SIN_COEFFICIENTS {
        sin = sin.mul_add(q, simd.set(term));
    }
    for term in COS_COEFFICIENTS {
        cos = cos.mul_add(q, simd.set(term));
    }
    sin *= x;
    [sin * cos * 2.0, (cos - sin) * (cos + sin)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use wm_render::dispatch;
    use wm_render::simd::SimdPath;

    #[inline(always)]
    fn waves<S: Lanes>(simd: S, turns: &[f32; 16]) -> [[f32; 16]; 2] {
        let mut out = [[0.0; 16]; 2];
        for first in (0..16).step_by(S::N) {
            for (wave, out) in wave(simd, simd.load(&turns[first..])).into_iter().zip(&mut out) {
                wave.store_slice(&mut out[first..first + S::N]);
            }
        }
        out
    }

    #[test]
    fn waves_are_sines() {
        for path in SimdPath::available() {
            for i in 0..250 {
                let turns: [f32; 16] = std::array::from_fn(|lane| (16 * i + lane) as f32 * 1e-3 - 2.0);
                let [sin, cos] = dispatch!(path, s => waves(s, &turns));
                for lane in 0..16 {
                    let (s, c) = (std::f64::consts::TAU * f64::from(turns[lane])).sin_cos();
                    let off = (f64::from(sin[lane]) - s).abs().max((f64::from(cos[lane]) - c).abs());
                    assert!(off < 2e-6, "{path} {}: {off}", turns[lane]);
                }
            }
        }
    }

    #[inline(always)]
    fn hashed<S: Lanes>(simd: S, from: [u32; 4]) -> [u32; 4] {
        let v = pcg4d(simd, from.map(|v| S::U::splat(simd, v)));
        [v[0][0], v[1][0], v[2][0], v[3][0]]
    }

    /// Every bit of the four numbers in turns half of the time with any bit of what they are made
    /// of.
    #[test]
    fn one_bit_changes_half_of_all() {
        for path in SimdPath::available() {
            let mut changed = [0u32; 128];
            for i in 0..512u32 {
                let from = [i % 8, i / 8 % 8, i / 64, 77];
                let before = dispatch!(path, s => hashed(s, from));
                assert_eq!(before, wm_base::random::pcg4d(from), "{path}");
                for bit in 0..128 {
                    let mut other = from;
                    other[bit / 32] ^= 1 << (bit % 32);
                    let after = dispatch!(path, s => hashed(s, other));
                    changed[bit] += (0..4).map(|k| (before[k] ^ after[k]).count_ones()).sum::<u32>();
                }
            }
            // 65,536 bits a sum; those of the upper bits of what goes in reach the lower ones
            // least.
            for (bit, count) in changed.into_iter().enumerate() {
                let share = f64::from(count) / 65_536.0;
                let least = if bit % 32 < 16 { 0.45 } else { 0.2 };
                assert!((least..0.55).contains(&share), "{path} bit {bit}: {share}");
            }
        }
    }
}
