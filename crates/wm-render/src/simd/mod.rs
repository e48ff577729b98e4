//! The SIMD paths of the CPU back end: one kernel source, compiled once a path, chosen at run time.
//!
//! Kernels are generic over [`Lanes`] and entered through [`dispatch!`](crate::dispatch). The wide
//! vector of a path is `S::F`: 16 lanes with AVX-512 (one 4x4 px block), 8 lanes elsewhere (4x2
//! px). The portable path is the twin that every other path is tested against: IEEE arithmetic
//! without fused operations and estimates, whose bytes are the same on every processor.

mod color;
mod lanes;
mod math;

#[cfg(any(target_arch = "x86", target_arch = "x86_64", target_arch = "aarch64"))]
use fearless_simd::Level;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

#[cfg(target_arch = "aarch64")]
use fearless_simd::Neon;
#[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
use fearless_simd::{Avx2, Avx512};

pub use color::{srgb_decode, srgb_decode_rough, srgb_encode, srgb_encode_rough};
pub use lanes::{Lanes, Portable};
pub(crate) use math::{ROUNDING_OFFSET, exp2_looped, sums, transpose};
pub use math::{exp2, exp2_unfused, log2, log2_rough, powf, reciprocal};

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
    pub(crate) const ALL: [Self; 5] = [Self::Auto, Self::Avx512, Self::Avx2, Self::Neon, Self::Portable];

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

/// A SIMD path that this processor has: a value of this type proves it.
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

    /// The path that all browsers have that this program was built for.
    #[cfg(all(target_arch = "wasm32", target_feature = "simd128"))]
    fn portable() -> Self {
        Self::Portable(fearless_simd::Level::new().as_wasm_simd128().expect("the target has it"))
    }

    /// The path that every processor has.
    #[cfg(not(any(target_arch = "x86_64", all(target_arch = "wasm32", target_feature = "simd128"))))]
    fn portable() -> Self {
        Self::Portable(Portable::new())
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
    pub(crate) fn narrow(self) -> Self {
        match self {
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            Self::Avx512(_) => Self::select(SimdChoice::Avx2).unwrap_or(self),
            other => other,
        }
    }

    /// Number of lanes of its vectors.
    pub(crate) fn lanes(self) -> usize {
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

#[cfg(test)]
mod tests;
