//! The vectors of each SIMD path.

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
use fearless_simd::{Select, Simd, SimdBase, SimdFloat, SimdInt, SimdMask, f32x8, mask32x8, u32x8};

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
