//! The sRGB encoding of whole vectors: exact, and rough for what is only shown.

use super::lanes::Lanes;
use super::math::{exp2_rough, log2_rough, powf, reciprocal};
use fearless_simd::{Select, SimdBase, SimdFloat, SimdMask};

/// Linear light of sRGB values of 0.04045 to 1.5, highest power first: minimax, 1.4e-4 of what is
/// displayed.
const DECODE_COEFFICIENTS: [f32; 6] =
    [4.098_582_3e-2, -0.202_103_2, 0.587_016_4, 0.543_159_8, 3.021_332_8e-2, 9.924_074e-4];
/// The greatest sRGB value for which [`DECODE_COEFFICIENTS`] hold.
const MAX_DECODED: f32 = 1.5;
/// sRGB values of linear light of 0.0031308 to 1, a ratio of polynomials, highest power first:
/// minimax, 1.2e-4.
const ENCODE_COEFFICIENTS: ([f32; 5], [f32; 4]) = (
    [863.149_2, 4_325.308, 1_068.987_4, 20.784_203, -1.103_977_1e-2],
    [3_435.746_5, 2_659.511_7, 181.217_3, 1.0],
);

/// sRGB to linear light, by channel; 0 and more.
#[inline(always)]
pub fn srgb_decode<S: Lanes>(simd: S, value: [S::F; 3]) -> [S::F; 3] {
    let mut base = value;
    for k in 0..3 {
        base[k] = value[k].mul_add(simd.set(1.0 / 1.055), simd.set(0.055 / 1.055));
    }
    let mut result = powf(simd, base, 2.4);
    for k in 0..3 {
        let linear = value[k] * (1.0 / 12.92);
        result[k] = value[k].simd_le(simd.set(0.040_45)).select(linear, result[k]);
    }
    result
}

/// Linear light to sRGB, by channel; 0 and more.
#[inline(always)]
pub fn srgb_encode<S: Lanes>(simd: S, value: [S::F; 3]) -> [S::F; 3] {
    let mut result = powf(simd, value, 1.0 / 2.4);
    for k in 0..3 {
        let power = result[k].mul_add(simd.set(1.055), simd.set(-0.055));
        let linear = value[k] * 12.92;
        result[k] = value[k].simd_le(simd.set(0.003_130_8)).select(linear, power);
    }
    result
}

/// [`srgb_decode`] for what is only shown: within 2e-4 of what is displayed, a twentieth of a step
/// of 8 bits.
#[inline(always)]
pub fn srgb_decode_rough<S: Lanes>(simd: S, value: [S::F; 3]) -> [S::F; 3] {
    let most = value[0].max(value[1]).max(value[2]);
    if most.simd_gt(simd.set(MAX_DECODED)).any_true() {
        return srgb_decode(simd, value);
    }
    let mut result = [simd.set(DECODE_COEFFICIENTS[0]); 3];
    for coefficient in DECODE_COEFFICIENTS.into_iter().skip(1) {
        for k in 0..3 {
            result[k] = result[k].mul_add(value[k], simd.set(coefficient));
        }
    }
    for k in 0..3 {
        let linear = value[k] * (1.0 / 12.92);
        result[k] = value[k].simd_le(simd.set(0.040_45)).select(linear, result[k]);
    }
    result
}

/// [`srgb_encode`] for what is only shown: within 2e-4 up to 1, and within 2e-4 of the value above.
#[inline(always)]
pub fn srgb_encode_rough<S: Lanes>(simd: S, value: [S::F; 3]) -> [S::F; 3] {
    let mut curved = value;
    for k in 0..3 {
        curved[k] = value[k].max(simd.set(0.003_130_8));
    }
    let mut result = curved;
    if curved[0].max(curved[1]).max(curved[2]).simd_gt(simd.set(1.0)).any_true() {
        let mut exponent = log2_rough(simd, curved);
        for k in 0..3 {
            exponent[k] *= 1.0 / 2.4;
        }
        let power = exp2_rough(simd, exponent);
        for k in 0..3 {
            result[k] = power[k].mul_add(simd.set(1.055), simd.set(-0.055));
        }
    } else {
        let (above, below) = ENCODE_COEFFICIENTS;
        let (mut sum, mut divisor) = ([simd.set(above[0]); 3], [simd.set(below[0]); 3]);
        for coefficient in above.into_iter().skip(1) {
            for k in 0..3 {
                sum[k] = sum[k].mul_add(curved[k], simd.set(coefficient));
            }
        }
        for coefficient in below.into_iter().skip(1) {
            for k in 0..3 {
                divisor[k] = divisor[k].mul_add(curved[k], simd.set(coefficient));
            }
        }
        let factor = reciprocal(simd, divisor);
        for k in 0..3 {
            result[k] = sum[k] * factor[k];
        }
    }
    for k in 0..3 {
        let linear = value[k] * 12.92;
        result[k] = value[k].simd_le(simd.set(0.003_130_8)).select(linear, result[k]);
    }
    result
}
