//! Elementary functions of whole vectors, and sums over lanes.
//!
//! Functions take several vectors and go step by step over all of them: a chain of dependent
//! operations fills the processor only if others run beside it.

use super::lanes::Lanes;
use fearless_simd::{Select, Simd, SimdBase, SimdFloat, f32x8};

/// 1.5 * 2^23: adding it to a number below 2^22 leaves the rounded whole number in the low mantissa
/// bits.
pub(crate) const ROUNDING_OFFSET: f32 = 12_582_912.0;

/// `2^x` on [-0.5, 0.5], highest power first; minimax, relative error 2.0e-7.
const EXP2_COEFFICIENTS: [f32; 6] =
    [1.338_130_3e-3, 9.666_369e-3, 5.550_381e-2, 2.402_235e-1, 6.931_472e-1, 1.0];

/// `2^x` on [-0.5, 0.5], highest power first; minimax, relative error 7.5e-5.
const EXP2_ROUGH: [f32; 4] = [5.517_234e-2, 0.242_611_53, 0.693_260_8, 0.999_928];

/// `log2(1 + t) / t` on [sqrt(1/2) - 1, sqrt(2) - 1], highest power first; minimax, error 5e-8.
const LOG2_COEFFICIENTS: [f32; 9] = [
    0.123_109_68,
    -0.205_861_88,
    0.216_078_23,
    -0.239_169_88,
    0.287_903_26,
    -0.360_693_28,
    0.480_910_75,
    -0.721_347_5,
    std::f32::consts::LOG2_E,
];

/// `log2(1 + t) / t` on [sqrt(1/2) - 1, sqrt(2) - 1], highest power first; minimax, error 1.0e-4.
const LOG2_ROUGH: [f32; 4] = [-0.329_631_1, 0.517_511_1, -0.724_904_2, 1.441_760_5];

/// `2^x` for x in [-126, 127]; relative error below 3e-7. Values outside give nonsense: clamp
/// before.
///
/// Several vectors step by step: a chain of dependent operations fills the processor only if others
/// run beside it, and its window is too short to find them in the next call.
#[inline(always)]
pub fn exp2<S: Lanes, const N: usize>(simd: S, x: [S::F; N]) -> [S::F; N] {
    exp2_with(
        simd,
        x,
        EXP2_COEFFICIENTS[0],
        #[inline(always)]
        |poly, fraction| {
            for power in 1..EXP2_COEFFICIENTS.len() {
                for k in 0..N {
                    poly[k] = poly[k].mul_add(fraction[k], simd.set(EXP2_COEFFICIENTS[power]));
                }
            }
        },
    )
}

/// [`exp2`] for what is only shown: relative error below 8e-5.
#[inline(always)]
pub(crate) fn exp2_rough<S: Lanes, const N: usize>(simd: S, x: [S::F; N]) -> [S::F; N] {
    let [highest, lower @ ..] = EXP2_ROUGH;
    exp2_with(
        simd,
        x,
        highest,
        #[inline(always)]
        |poly, fraction| {
            for coefficient in lower {
                for k in 0..N {
                    poly[k] = poly[k].mul_add(fraction[k], simd.set(coefficient));
                }
            }
        },
    )
}

/// [`exp2`], bit for bit, with a loop over the powers that the compiler does not unroll. Unrolled,
/// it puts one vector's chain after the other's, which costs the blending of 16 lanes 6 %; with 8
/// lanes, and where registers are short, the loop's own work costs more.
#[inline(always)]
pub(crate) fn exp2_looped<S: Lanes, const N: usize>(simd: S, x: [S::F; N]) -> [S::F; N] {
    exp2_with(
        simd,
        x,
        EXP2_COEFFICIENTS[0],
        #[inline(always)]
        |poly, fraction| {
            let [powers @ .., last] = EXP2_COEFFICIENTS;
            for coefficient in powers.into_iter().skip(1).chain([last]) {
                for k in 0..N {
                    poly[k] = poly[k].mul_add(fraction[k], simd.set(coefficient));
                }
            }
        },
    )
}

#[inline(always)]
fn exp2_with<S: Lanes, const N: usize>(
    simd: S,
    x: [S::F; N],
    highest: f32,
    evaluate: impl Fn(&mut [S::F; N], &[S::F; N]),
) -> [S::F; N] {
    let mut shifted = x;
    let mut fraction = x;
    for k in 0..N {
        shifted[k] = x[k] + ROUNDING_OFFSET;
    }
    for k in 0..N {
        fraction[k] = x[k] - (shifted[k] - ROUNDING_OFFSET);
    }
    let mut poly = [simd.set(highest); N];
    evaluate(&mut poly, &fraction);
    for k in 0..N {
        poly[k] = S::F::from_bits(poly[k].to_bits() + (shifted[k].to_bits() << 23));
    }
    poly
}

/// [`exp2`] of eight lanes without fused multiplication: the same bytes on all paths. Relative
/// error below 5e-7.
#[inline(always)]
pub fn exp2_unfused<S: Simd>(simd: S, x: f32x8<S>) -> f32x8<S> {
    let shifted = x + ROUNDING_OFFSET;
    let fraction = x - (shifted - ROUNDING_OFFSET);
    let mut poly = f32x8::splat(simd, EXP2_COEFFICIENTS[0]);
    for coefficient in EXP2_COEFFICIENTS.into_iter().skip(1) {
        poly = poly * fraction + coefficient;
    }
    f32x8::from_bits(poly.to_bits() + (shifted.to_bits() << 23))
}

/// `log2(x)` for normal positive x; absolute error below 2e-7 near 1, relative 1e-7 elsewhere.
#[inline(always)]
pub fn log2<S: Lanes, const N: usize>(simd: S, x: [S::F; N]) -> [S::F; N] {
    log2_by(simd, x, LOG2_COEFFICIENTS)
}

/// [`log2`] for what is only shown: absolute error below 1.1e-4.
#[inline(always)]
pub fn log2_rough<S: Lanes, const N: usize>(simd: S, x: [S::F; N]) -> [S::F; N] {
    log2_by(simd, x, LOG2_ROUGH)
}

#[inline(always)]
fn log2_by<S: Lanes, const N: usize, const P: usize>(
    simd: S,
    x: [S::F; N],
    coefficients: [f32; P],
) -> [S::F; N] {
    // Split so that the mantissa lies in [sqrt(1/2), sqrt(2)): no cancellation around x = 1. The
    // exponent stays biased and so above 0, and becomes a float as the mantissa of 2^23.
    const SQRT_HALF: u32 = 0x3f35_04f3;
    const TWO_23: u32 = 0x4b00_0000;
    let mut exponent = x;
    let mut t = x;
    for k in 0..N {
        let bits = x[k].to_bits() + S::U::splat(simd, 0x3f80_0000 - SQRT_HALF);
        exponent[k] = S::F::from_bits((bits >> 23) | S::U::splat(simd, TWO_23)) - (8_388_608.0 + 127.0);
        let mantissa = (bits & S::U::splat(simd, 0x007f_ffff)) + S::U::splat(simd, SQRT_HALF);
        t[k] = S::F::from_bits(mantissa) - 1.0;
    }
    let mut poly = [simd.set(coefficients[0]); N];
    for power in 1..P {
        for k in 0..N {
            poly[k] = poly[k].mul_add(t[k], simd.set(coefficients[power]));
        }
    }
    for k in 0..N {
        poly[k] = poly[k].mul_add(t[k], exponent[k]);
    }
    poly
}

/// `x^power` for x at or above 0 (0 where x is below 1e-30); relative error below 1e-6 for powers
/// near 2.
#[inline(always)]
pub fn powf<S: Lanes, const N: usize>(simd: S, x: [S::F; N], power: f32) -> [S::F; N] {
    let tiny = simd.set(1e-30);
    let mut kept = x;
    for k in 0..N {
        kept[k] = x[k].max(tiny);
    }
    let mut exponent = log2(simd, kept);
    for k in 0..N {
        exponent[k] = (exponent[k] * power).max(simd.set(-126.0));
    }
    let mut result = exp2(simd, exponent);
    for k in 0..N {
        result[k] = x[k].simd_gt(tiny).select(result[k], simd.set(0.0));
    }
    result
}

/// `1 / x` for x in [1e-30, 1e30]; relative error below 4e-7 on x86. A division blocks its port for
/// as long as four of these take.
#[inline(always)]
pub fn reciprocal<S: Lanes, const N: usize>(simd: S, x: [S::F; N]) -> [S::F; N] {
    // 12 to 14 bits on x86, 8 on Arm, all in plain Rust: each round of Newton's doubles them.
    let rounds = if cfg!(target_arch = "aarch64") { 2 } else { 1 };
    let mut guess = x;
    for k in 0..N {
        guess[k] = if S::PLAIN { simd.set(1.0) / x[k] } else { x[k].approximate_recip() };
    }
    for _ in 0..rounds {
        for k in 0..N {
            guess[k] *= (-x[k]).mul_add(guess[k], simd.set(2.0));
        }
    }
    guess
}

/// Lane k of the result is the sum over the lanes of `vectors[k]`. M must be the number of lanes.
#[inline(always)]
pub(crate) fn sums<S: Lanes, const M: usize>(simd: S, mut vectors: [S::F; M]) -> S::F {
    if S::PLAIN {
        let mut sums = [0.0; M];
        for (sum, vector) in sums.iter_mut().zip(&vectors) {
            let mut lanes = [0.0; M];
            vector.store_slice(&mut lanes[..S::N]);
            *sum = lanes.iter().sum();
        }
        return simd.load(&sums);
    }
    // Each round adds the halves of two vectors in one; the last bit of a lane then names the
    // vector.
    debug_assert_eq!(M, S::N);
    let mut count = M;
    while count > 1 {
        count /= 2;
        for k in 0..count {
            let (low, high) = vectors[k].interleave(vectors[k + count]);
            vectors[k] = low + high;
        }
    }
    vectors[0]
}

/// Transposes a matrix.
#[inline(always)]
pub(crate) fn transpose<S: Lanes>(simd: S, matrix: &mut [[f32; 16]; 16]) {
    if S::PLAIN {
        for i in 0..16 {
            for j in 0..i {
                (matrix[i][j], matrix[j][i]) = (matrix[j][i], matrix[i][j]);
            }
        }
        return;
    }
    // Each round of perfect shuffles turns the bits of (row, lane) by one place: as many rounds as
    // a lane has bits swap rows and lanes.
    if S::N == 16 {
        let mut rows = [simd.set(0.0); 16];
        for k in 0..16 {
            rows[k] = simd.load(&matrix[k]);
        }
        for _ in 0..4 {
            let mut next = rows;
            for k in 0..8 {
                (next[2 * k], next[2 * k + 1]) = rows[k].interleave(rows[k + 8]);
            }
            rows = next;
        }
        for k in 0..16 {
            rows[k].store_slice(&mut matrix[k]);
        }
        return;
    }
    let from = *matrix;
    for (top, left) in [(0, 0), (0, 8), (8, 0), (8, 8)] {
        let mut rows = [simd.set(0.0); 8];
        for k in 0..8 {
            rows[k] = simd.load(&from[top + k][left..]);
        }
        for _ in 0..3 {
            let mut next = rows;
            for k in 0..4 {
                (next[2 * k], next[2 * k + 1]) = rows[k].interleave(rows[k + 4]);
            }
            rows = next;
        }
        for k in 0..8 {
            rows[k].store_slice(&mut matrix[left + k][top..top + 8]);
        }
    }
}
