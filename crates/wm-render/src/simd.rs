//! The SIMD paths of the CPU back end: one kernel source, compiled once a path, chosen at run time.
//!
//! Kernels are generic over [`Lanes`] and entered through [`dispatch!`](crate::dispatch). The wide
//! vector of a path is `S::F`: 16 lanes with AVX-512 (one 4x4 px block), 8 lanes elsewhere (4x2
//! px). The portable path is the twin that every other path is tested against: IEEE arithmetic
//! without fused operations and estimates, whose bytes are the same on every processor.

#[cfg(any(target_arch = "x86", target_arch = "x86_64", target_arch = "aarch64"))]
use fearless_simd::Level;
use fearless_simd::{Select, Simd, SimdBase, SimdFloat, SimdInt, SimdMask, f32x8, mask32x8, u32x8};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

#[cfg(any(
    test,
    not(any(target_arch = "x86_64", all(target_arch = "wasm32", target_feature = "simd128")))
))]
use fearless_simd::Fallback;
#[cfg(target_arch = "aarch64")]
use fearless_simd::Neon;
#[cfg(all(target_arch = "wasm32", target_feature = "simd128"))]
use fearless_simd::wasm32::WasmSimd128;
#[cfg(target_arch = "x86_64")]
use fearless_simd::x86::Sse2;
#[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
use fearless_simd::{Avx2, Avx512, f32x16, mask32x16, u32x16};

/// The token of the portable path: what every processor of the target has. On x86-64 that is SSE2:
/// the bytes of plain Rust, whose lanes unrolled were two thirds of this crate's code and nine
/// tenths of the time to compile it.
#[cfg(target_arch = "x86_64")]
pub type Portable = Sse2;
/// The token of the portable path: the 128-bit vectors of WebAssembly.
#[cfg(all(target_arch = "wasm32", target_feature = "simd128"))]
pub type Portable = WasmSimd128;
/// The token of the portable path: plain Rust.
#[cfg(not(any(target_arch = "x86_64", all(target_arch = "wasm32", target_feature = "simd128"))))]
pub type Portable = Fallback;

/// The choice of a SIMD path.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SimdChoice {
    /// The widest that this processor has.
    #[default]
    Auto,
    /// AVX-512 as of Ice Lake.
    Avx512,
    /// AVX2 with FMA.
    Avx2,
    /// NEON of 64-bit Arm.
    Neon,
    /// The path that every processor has, with the same bytes on all: SSE2 on x86-64, 128-bit
    /// vectors of WebAssembly in a browser, elsewhere plain Rust.
    Portable,
}

impl SimdChoice {
    /// Every choice, widest first after `Auto`.
    pub const ALL: [Self; 5] = [Self::Auto, Self::Avx512, Self::Avx2, Self::Neon, Self::Portable];

    /// The name on the command line and in reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Avx512 => "avx512",
            Self::Avx2 => "avx2",
            Self::Neon => "neon",
            Self::Portable => "portable",
        }
    }
}

impl FromStr for SimdChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::ALL.into_iter().find(|choice| choice.name() == text).ok_or_else(|| {
            let names = Self::ALL.map(Self::name).join(", ");
            format!("`{text}` is no SIMD path: use one of {names}")
        })
    }
}

/// A SIMD path that this processor has: holding one is the proof.
#[derive(Clone, Copy, Debug)]
pub enum SimdPath {
    /// 16 lanes.
    #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
    Avx512(Avx512),
    /// 8 lanes.
    #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
    Avx2(Avx2),
    /// 8 lanes in two registers.
    #[cfg(target_arch = "aarch64")]
    Neon(Neon),
    /// 8 lanes in plain arrays, or in two registers of SSE2.
    Portable(Portable),
}

impl SimdPath {
    /// The path of `choice`; `None` where this processor does not have it.
    #[must_use]
    pub fn select(choice: SimdChoice) -> Option<Self> {
        match choice {
            SimdChoice::Auto => {
                [SimdChoice::Avx512, SimdChoice::Avx2, SimdChoice::Neon, SimdChoice::Portable]
                    .into_iter()
                    .find_map(Self::select)
            }
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            SimdChoice::Avx512 => Level::new().as_avx512().map(Self::Avx512),
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            SimdChoice::Avx2 => Level::new().as_avx2().map(Self::Avx2),
            #[cfg(target_arch = "aarch64")]
            SimdChoice::Neon => Level::new().as_neon().map(Self::Neon),
            SimdChoice::Portable => Some(Self::portable()),
            _ => None,
        }
    }

    /// The path that every processor has.
    #[cfg(target_arch = "x86_64")]
    fn portable() -> Self {
        Self::Portable(Level::baseline().as_sse2().expect("SSE2 is part of x86-64"))
    }

    /// The path that every browser has which this program was built for.
    #[cfg(all(target_arch = "wasm32", target_feature = "simd128"))]
    fn portable() -> Self {
        Self::Portable(fearless_simd::Level::new().as_wasm_simd128().expect("the target has it"))
    }

    /// The path that every processor has.
    #[cfg(not(any(target_arch = "x86_64", all(target_arch = "wasm32", target_feature = "simd128"))))]
    fn portable() -> Self {
        Self::Portable(Fallback::new())
    }

    /// The choice that gives this path.
    #[must_use]
    pub fn choice(self) -> SimdChoice {
        match self {
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            Self::Avx512(_) => SimdChoice::Avx512,
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            Self::Avx2(_) => SimdChoice::Avx2,
            #[cfg(target_arch = "aarch64")]
            Self::Neon(_) => SimdChoice::Neon,
            Self::Portable(_) => SimdChoice::Portable,
        }
    }

    /// The path with half as wide vectors where this one has AVX-512, else this one: for code that
    /// only moves numbers about.
    #[must_use]
    pub fn narrow(self) -> Self {
        match self {
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            Self::Avx512(_) => Self::select(SimdChoice::Avx2).unwrap_or(self),
            other => other,
        }
    }

    /// Number of lanes of its vectors.
    #[must_use]
    pub fn lanes(self) -> usize {
        match self {
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            Self::Avx512(_) => <Avx512 as Lanes>::N,
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            Self::Avx2(_) => <Avx2 as Lanes>::N,
            #[cfg(target_arch = "aarch64")]
            Self::Neon(_) => <Neon as Lanes>::N,
            Self::Portable(_) => <Portable as Lanes>::N,
        }
    }

    /// The widest path of this processor. Loops without fused multiplication give the same bytes on
    /// all paths.
    #[must_use]
    pub fn widest() -> Self {
        Self::select(SimdChoice::Auto).unwrap_or_else(Self::portable)
    }

    /// The paths that this processor has, widest first.
    #[must_use]
    pub fn available() -> Vec<Self> {
        SimdChoice::ALL.into_iter().skip(1).filter_map(Self::select).collect()
    }
}

impl fmt::Display for SimdPath {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.choice().name())
    }
}

/// A SIMD token with the vector that the kernels are written in.
pub trait Lanes: Simd {
    /// The vector of f32.
    type F: SimdFloat<Self, Element = f32, Bits = Self::U, Mask = Self::M>;
    /// The vector of u32 of the same width.
    type U: SimdInt<Self, Element = u32, Mask = Self::M>;
    /// The mask of both.
    type M: SimdMask<Self, Element = i32> + Select<Self::F> + Select<Self::U>;
    /// Number of lanes: 8 or 16.
    const N: usize;
    /// True if the path packs the selected lanes of a vector in one instruction.
    const PACKS: bool;
    /// True for the portable path: sums add lane after lane and nothing is estimated, so that its
    /// bytes are the same on every processor.
    const PLAIN: bool;

    /// `value` in every lane.
    #[inline(always)]
    fn set(self, value: f32) -> Self::F {
        Self::F::splat(self, value)
    }

    /// The first N of `values`.
    #[inline(always)]
    fn load(self, values: &[f32]) -> Self::F {
        Self::F::from_slice(self, &values[..Self::N])
    }
}

macro_rules! lanes {
    ($token:ty, $f:ident, $u:ident, $m:ident, $n:literal, $packs:literal, $plain:literal) => {
        impl Lanes for $token {
            type F = $f<Self>;
            type U = $u<Self>;
            type M = $m<Self>;
            const N: usize = $n;
            const PACKS: bool = $packs;
            const PLAIN: bool = $plain;
        }
    };
}
#[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
lanes!(Avx512, f32x16, u32x16, mask32x16, 16, true, false);
#[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
lanes!(Avx2, f32x8, u32x8, mask32x8, 8, false, false);
#[cfg(target_arch = "aarch64")]
lanes!(Neon, f32x8, u32x8, mask32x8, 8, false, false);
#[cfg(target_arch = "x86_64")]
lanes!(Sse2, f32x8, u32x8, mask32x8, 8, false, true);
#[cfg(all(target_arch = "wasm32", target_feature = "simd128"))]
lanes!(WasmSimd128, f32x8, u32x8, mask32x8, 8, false, true);
// On x86-64 only for tests, which hold SSE2 against it.
#[cfg(any(test, not(any(target_arch = "x86_64", all(target_arch = "wasm32", target_feature = "simd128")))))]
lanes!(Fallback, f32x8, u32x8, mask32x8, 8, false, true);

/// Runs `$call` compiled for the path `$path`, with its token bound to `$simd`.
///
/// `$call` must be one call of an `#[inline(always)]` function generic over [`Lanes`]: what is not
/// inlined into the call is compiled without the path's instructions.
#[macro_export]
macro_rules! dispatch {
    ($path:expr, $simd:ident => $call:expr) => {
        match $path {
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            $crate::simd::SimdPath::Avx512($simd) => ::fearless_simd::Simd::vectorize(
                $simd,
                #[inline(always)]
                || $call,
            ),
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            $crate::simd::SimdPath::Avx2($simd) => ::fearless_simd::Simd::vectorize(
                $simd,
                #[inline(always)]
                || $call,
            ),
            #[cfg(target_arch = "aarch64")]
            $crate::simd::SimdPath::Neon($simd) => ::fearless_simd::Simd::vectorize(
                $simd,
                #[inline(always)]
                || $call,
            ),
            $crate::simd::SimdPath::Portable($simd) => ::fearless_simd::Simd::vectorize(
                $simd,
                #[inline(always)]
                || $call,
            ),
        }
    };
}

/// 1.5 * 2^23: adding it to a small float leaves the rounded integer in the low mantissa bits.
const ROUND: f32 = 12_582_912.0;

/// `2^x` on [-0.5, 0.5], highest power first; minimax, relative error 2.0e-7.
const EXP2: [f32; 6] = [1.338_130_3e-3, 9.666_369e-3, 5.550_381e-2, 2.402_235e-1, 6.931_472e-1, 1.0];

/// The same with a relative error of 7.5e-5.
const EXP2_ROUGH: [f32; 4] = [5.517_234e-2, 0.242_611_53, 0.693_260_8, 0.999_928];

/// `log2(1 + t) / t` on [sqrt(1/2) - 1, sqrt(2) - 1], highest power first; minimax, error 5e-8.
const LOG2: [f32; 9] = [
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

/// The same with an error of 1.0e-4.
const LOG2_ROUGH: [f32; 4] = [-0.329_631_1, 0.517_511_1, -0.724_904_2, 1.441_760_5];

/// Linear light of sRGB values of 0.04045 to 1.5, highest power first: minimax, 1.4e-4 of what is
/// displayed.
const DECODE: [f32; 6] =
    [4.098_582_3e-2, -0.202_103_2, 0.587_016_4, 0.543_159_8, 3.021_332_8e-2, 9.924_074e-4];
/// The greatest value of [`DECODE`].
const DECODE_MOST: f32 = 1.5;
/// sRGB values of linear light of 0.0031308 to 1, a ratio of polynomials, highest power first:
/// minimax, 1.2e-4.
const ENCODE: ([f32; 5], [f32; 4]) = (
    [863.149_2, 4_325.308, 1_068.987_4, 20.784_203, -1.103_977_1e-2],
    [3_435.746_5, 2_659.511_7, 181.217_3, 1.0],
);

/// `2^x` for x in [-126, 127]; relative error below 3e-7. Values outside give nonsense: clamp
/// before.
///
/// Several vectors step by step: a chain of dependent operations fills the processor only if others
/// run beside it, and its window is too short to find them in the next call.
#[inline(always)]
pub fn exp2<S: Lanes, const N: usize>(simd: S, x: [S::F; N]) -> [S::F; N] {
    exp2_with(
        simd,
        (x, EXP2[0]),
        #[inline(always)]
        |poly, fraction| {
            for power in 1..EXP2.len() {
                for k in 0..N {
                    poly[k] = poly[k].mul_add(fraction[k], simd.set(EXP2[power]));
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
        (x, highest),
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
        (x, EXP2[0]),
        #[inline(always)]
        |poly, fraction| {
            let [powers @ .., last] = EXP2;
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
    (x, highest): ([S::F; N], f32),
    evaluate: impl Fn(&mut [S::F; N], &[S::F; N]),
) -> [S::F; N] {
    let mut shifted = x;
    let mut fraction = x;
    for k in 0..N {
        shifted[k] = x[k] + ROUND;
    }
    for k in 0..N {
        fraction[k] = x[k] - (shifted[k] - ROUND);
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
    let shifted = x + ROUND;
    let fraction = x - (shifted - ROUND);
    let mut poly = f32x8::splat(simd, EXP2[0]);
    for coefficient in EXP2.into_iter().skip(1) {
        poly = poly * fraction + coefficient;
    }
    f32x8::from_bits(poly.to_bits() + (shifted.to_bits() << 23))
}

/// `log2(x)` for normal positive x; absolute error below 2e-7 near 1, relative 1e-7 elsewhere.
#[inline(always)]
pub fn log2<S: Lanes, const N: usize>(simd: S, x: [S::F; N]) -> [S::F; N] {
    log2_by(simd, x, LOG2)
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
    if most.simd_gt(simd.set(DECODE_MOST)).any_true() {
        return srgb_decode(simd, value);
    }
    let mut result = [simd.set(DECODE[0]); 3];
    for coefficient in DECODE.into_iter().skip(1) {
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
        let (above, below) = ENCODE;
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

/// `1 / x` for x in [1e-30, 1e30]; relative error below 4e-7 on x86. A division holds up its port
/// for as long as all of this takes four times.
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
pub fn sums<S: Lanes, const M: usize>(simd: S, mut vectors: [S::F; M]) -> S::F {
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

/// Swaps rows and columns.
#[inline(always)]
pub fn transpose<S: Lanes>(simd: S, matrix: &mut [[f32; 16]; 16]) {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[inline(always)]
    fn map<S: Lanes>(simd: S, values: &mut [f32], f: impl Fn(S, S::F) -> S::F) {
        for chunk in values.chunks_exact_mut(S::N) {
            f(simd, S::F::from_slice(simd, chunk)).store_slice(chunk);
        }
    }

    #[inline(always)]
    fn map_exp2<S: Lanes>(simd: S, values: &mut [f32]) {
        map(
            simd,
            values,
            #[inline(always)]
            |s, x| exp2(s, [x])[0],
        );
    }

    #[inline(always)]
    fn map_log2<S: Lanes>(simd: S, values: &mut [f32]) {
        map(
            simd,
            values,
            #[inline(always)]
            |s, x| log2(s, [x])[0],
        );
    }

    #[inline(always)]
    fn map_powf<S: Lanes>(simd: S, values: &mut [f32]) {
        map(
            simd,
            values,
            #[inline(always)]
            |s, x| powf(s, [x], 2.4)[0],
        );
    }

    fn grid(from: f32, to: f32) -> Vec<f32> {
        (0..4096).map(|i| from + (to - from) * i as f32 / 4095.0).collect()
    }

    #[test]
    fn exp2_is_exact_to_three_ulp() {
        for path in SimdPath::available() {
            let x = grid(-30.0, 4.0);
            let mut y = x.clone();
            dispatch!(path, s => map_exp2(s, &mut y));
            for (x, y) in x.iter().zip(&y) {
                let want = f64::from(*x).exp2();
                assert!((f64::from(*y) / want - 1.0).abs() < 3e-7, "{path}: 2^{x} = {y}");
            }
        }
    }

    #[inline(always)]
    fn map_exp2_unfused<S: Simd>(simd: S, values: &mut [f32]) {
        for chunk in values.chunks_exact_mut(8) {
            exp2_unfused(simd, f32x8::from_slice(simd, chunk)).store_slice(chunk);
        }
    }

    #[test]
    fn exp2_without_fused_multiplication_has_the_same_bytes_on_all_paths() {
        let x = grid(-30.0, 4.0);
        let evaluate = |path: SimdPath| {
            let mut y = x.clone();
            dispatch!(path, s => map_exp2_unfused(s, &mut y));
            y
        };
        let first = evaluate(SimdPath::widest());
        for (x, y) in x.iter().zip(&first) {
            assert!((f64::from(*y) / f64::from(*x).exp2() - 1.0).abs() < 5e-7, "2^{x} = {y}");
        }
        for path in SimdPath::available() {
            let bits = |values: &[f32]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
            assert_eq!(bits(&evaluate(path)), bits(&first), "{path}");
        }
    }

    #[test]
    fn log2_is_exact_over_many_magnitudes() {
        for path in SimdPath::available() {
            let x: Vec<f32> = grid(-90.0, 90.0).iter().map(|e| e.exp2()).chain(grid(0.5, 2.0)).collect();
            let mut y = x.clone();
            dispatch!(path, s => map_log2(s, &mut y));
            for (x, y) in x.iter().zip(&y) {
                let want = f64::from(*x).log2();
                assert!((f64::from(*y) - want).abs() < 2e-7 * want.abs().max(1.0), "{path}: log2 {x} = {y}");
            }
        }
    }

    #[test]
    fn powf_keeps_zero_and_is_exact_enough() {
        for path in SimdPath::available() {
            let x = grid(0.0, 3.0);
            let mut y = x.clone();
            dispatch!(path, s => map_powf(s, &mut y));
            assert_eq!(y[0], 0.0);
            for (x, y) in x.iter().zip(&y).skip(1) {
                let want = f64::from(*x).powf(2.4);
                assert!((f64::from(*y) - want).abs() < 2e-6 * want + 1e-12, "{path}: {x}^2.4 = {y}");
            }
        }
    }

    #[inline(always)]
    fn map_color<S: Lanes>(simd: S, values: &mut [f32], f: impl Fn(S, [S::F; 3]) -> [S::F; 3]) {
        for chunk in values.chunks_exact_mut(S::N) {
            // Each channel has its own values.
            let value = S::F::from_slice(simd, chunk);
            f(simd, [simd.set(0.1), value, simd.set(0.0)])[1].store_slice(chunk);
        }
    }

    #[inline(always)]
    fn map_decode_rough<S: Lanes>(simd: S, values: &mut [f32]) {
        map_color(
            simd,
            values,
            #[inline(always)]
            |s, x| srgb_decode_rough(s, x),
        );
    }

    #[inline(always)]
    fn map_encode_rough<S: Lanes>(simd: S, values: &mut [f32]) {
        map_color(
            simd,
            values,
            #[inline(always)]
            |s, x| srgb_encode_rough(s, x),
        );
    }

    #[test]
    fn rough_colors_are_within_a_twentieth_of_a_step_of_8_bits() {
        use wm_scene::color::srgb_encode;
        for path in SimdPath::available() {
            // Linear light has one curve from 0 to some light 50 times as bright as white.
            let x: Vec<f32> =
                grid(0.0, 0.05).into_iter().chain(grid(0.0, 1.4)).chain(grid(1.0, 50.0)).collect();
            let mut y = x.clone();
            dispatch!(path, s => map_encode_rough(s, &mut y));
            for (x, y) in x.iter().zip(&y) {
                let want = srgb_encode(f64::from(*x));
                assert!(
                    (f64::from(*y) - want).abs() < 2e-4 * want.max(1.0),
                    "{path}: {x} to {y}, want {want}"
                );
            }
            let x: Vec<f32> = grid(0.0, 0.1).into_iter().chain(grid(0.0, 2.5)).collect();
            let mut y = x.clone();
            dispatch!(path, s => map_decode_rough(s, &mut y));
            for (x, y) in x.iter().zip(&y) {
                let shown = srgb_encode(f64::from(*y));
                assert!((shown - f64::from(*x)).abs() < 2e-4, "{path}: {x} to {y}, shown as {shown}");
            }
        }
    }

    #[inline(always)]
    fn map_reciprocal<S: Lanes>(simd: S, values: &mut [f32]) {
        map(
            simd,
            values,
            #[inline(always)]
            |s, x| reciprocal(s, [x])[0],
        );
    }

    #[test]
    fn reciprocals_are_exact_to_six_ulp() {
        for path in SimdPath::available() {
            let x: Vec<f32> = grid(0.009, 1.0).into_iter().chain(grid(1.0, 1e6)).collect();
            let mut y = x.clone();
            dispatch!(path, s => map_reciprocal(s, &mut y));
            for (x, y) in x.iter().zip(&y) {
                assert!((f64::from(*y) * f64::from(*x) - 1.0).abs() < 4e-7, "{path}: 1 / {x} = {y}");
            }
        }
    }

    #[inline(always)]
    fn row_sums<S: Lanes>(simd: S, rows: &[[f32; 16]; 16], out: &mut [f32; 16]) {
        if S::N == 16 {
            let mut vectors = [simd.set(0.0); 16];
            for k in 0..16 {
                vectors[k] = simd.load(&rows[k]);
            }
            sums::<S, 16>(simd, vectors).store_slice(out);
        } else {
            for half in 0..2 {
                let mut vectors = [simd.set(0.0); 8];
                for k in 0..8 {
                    vectors[k] = simd.load(&rows[8 * half + k]) + simd.load(&rows[8 * half + k][8..]);
                }
                sums::<S, 8>(simd, vectors).store_slice(&mut out[8 * half..8 * half + 8]);
            }
        }
    }

    #[test]
    fn rows_are_summed_and_turned() {
        let matrix: [[f32; 16]; 16] =
            std::array::from_fn(|i| std::array::from_fn(|j| (i * i + 3 * j) as f32));
        for path in SimdPath::available() {
            let mut out = [0.0; 16];
            dispatch!(path, s => row_sums(s, &matrix, &mut out));
            assert!((0..16).all(|i| out[i] == matrix[i].iter().sum::<f32>()), "{path}: {out:?}");
            let mut turned = matrix;
            dispatch!(path, s => transpose(s, &mut turned));
            assert!((0..16).all(|i| (0..16).all(|j| turned[i][j] == matrix[j][i])), "{path}");
        }
    }

    #[cfg(target_arch = "x86_64")]
    #[test]
    fn the_portable_path_has_the_bytes_of_plain_rust() {
        let plain = Fallback::new();
        let SimdPath::Portable(portable) = SimdPath::portable() else { unreachable!() };
        let x: Vec<f32> = [grid(0.0, 0.05), grid(-3.0, 3.0), grid(-30.0, 30.0)].concat();
        macro_rules! same {
            ($($map:ident of $x:expr;)*) => {$(
                let x: Vec<f32> = $x;
                let (mut a, mut b) = (x.clone(), x.clone());
                $map(plain, &mut a);
                $map(portable, &mut b);
                for ((x, a), b) in x.iter().zip(&a).zip(&b) {
                    assert_eq!(a.to_bits(), b.to_bits(), "{} of {x}: {a} and {b}", stringify!($map));
                }
            )*};
        }
        let positive: Vec<f32> = x.iter().map(|x| x.abs().max(1e-6)).collect();
        same! {
            map_exp2 of x.clone();
            map_exp2_unfused of x;
            map_log2 of positive.clone();
            map_powf of positive.clone();
            map_decode_rough of positive.clone();
            map_encode_rough of positive.clone();
            map_reciprocal of positive;
        }
        let matrix: [[f32; 16]; 16] =
            std::array::from_fn(|i| std::array::from_fn(|j| (i as f32 - 3.3) * (j as f32 + 0.7)));
        let (mut a, mut b) = ([0.0; 16], [0.0; 16]);
        row_sums(plain, &matrix, &mut a);
        row_sums(portable, &matrix, &mut b);
        assert_eq!(a.map(f32::to_bits), b.map(f32::to_bits));
    }

    #[test]
    fn names_round_trip() {
        for choice in SimdChoice::ALL {
            assert_eq!(choice.name().parse::<SimdChoice>(), Ok(choice));
        }
        assert!("avx3".parse::<SimdChoice>().is_err());
        assert!(SimdPath::select(SimdChoice::Portable).is_some());
    }
}
