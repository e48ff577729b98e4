//! Scenes, back ends and comparisons for tests and benches.

#[cfg(test)]
pub(crate) mod comparison;
#[cfg(feature = "gpu")]
pub(crate) mod programs;

use crate::config::CpuConfig;
#[cfg(feature = "gpu")]
use crate::device::AnyDifferentiable;
use crate::differentiable::{Channels, Upstream};
#[cfg(feature = "gpu")]
use crate::error::RenderError;
#[cfg(feature = "gpu")]
use crate::gpu::source::{Program, Subgroups};
#[cfg(feature = "gpu")]
use crate::gpu::{AdapterChoice, Gpu, GpuConfig, GpuDifferentiable, GpuError, GpuRenderer};
#[cfg(feature = "gpu")]
use crate::hooks::WgslSource;
use crate::hooks::{Medium, ShadeGroup};
use crate::renderer::RenderBackend;
use crate::simd::{SimdChoice, SimdPath};
use crate::stages::intersect::TILE;
use crate::stages::project::{Record, SQRT_HALF_LOG2E};
use crate::{CpuDifferentiable, CpuRenderer, Differentiable};
use glam::DVec3;
#[cfg(feature = "gpu")]
use std::sync::{Arc, OnceLock};
use wm_scene::{Camera, Group, Splats, splats::logit};

/// A back end under test.
#[derive(Clone, Copy, Debug)]
pub enum Backend {
    /// The CPU on one SIMD path.
    Cpu(SimdPath),
    /// A GPU: a real one, or one in software where there is no other.
    #[cfg(feature = "gpu")]
    Gpu,
}

impl Backend {
    /// The back end of `choice`, or `None` with a word on stderr where this machine lacks it. With
    /// `WM_REQUIRE_BACKENDS=1` in the environment, lacking it fails the test instead.
    ///
    /// # Panics
    /// As said.
    #[must_use]
    pub fn of(choice: SimdChoice) -> Option<Self> {
        let path = SimdPath::select(choice);
        if path.is_none() {
            let required = std::env::var("WM_REQUIRE_BACKENDS").is_ok_and(|v| v == "1");
            assert!(!required, "no {} on this machine, and WM_REQUIRE_BACKENDS=1", choice.name());
            eprintln!("skipped: no {} on this machine", choice.name());
        }
        path.map(Self::Cpu)
    }

    /// The GPU, or `None` with a word on stderr where there is none. With `WM_REQUIRE_GPU=1` in the
    /// environment, lacking it fails the test instead.
    ///
    /// # Panics
    /// As said.
    #[must_use]
    pub fn gpu() -> Option<Self> {
        #[cfg(feature = "gpu")]
        let found = shared_gpu().as_ref().map(|_| Self::Gpu);
        #[cfg(not(feature = "gpu"))]
        let found = Err("built without the GPU back end");
        found
            .inspect_err(|reason| {
                let required = std::env::var("WM_REQUIRE_GPU").is_ok_and(|v| v == "1");
                assert!(!required, "{reason}, and WM_REQUIRE_GPU=1");
                eprintln!("skipped: {reason}");
            })
            .ok()
    }

    /// Returns the SIMD path, for checks that concern the CPU alone.
    ///
    /// # Panics
    /// If this is the GPU.
    #[must_use]
    pub fn path(self) -> SimdPath {
        match self {
            Self::Cpu(path) => path,
            #[cfg(feature = "gpu")]
            Self::Gpu => panic!("this check is of the CPU alone: list it under `cpu_parity!`"),
        }
    }

    /// [`Medium::shade`] on this back end.
    ///
    /// # Panics
    /// If the GPU has no form of it.
    pub fn shade(self, medium: &dyn Medium, origin: [f32; 3], groups: &mut [ShadeGroup]) {
        match self {
            Self::Cpu(path) => medium.shade(path, origin, groups),
            #[cfg(feature = "gpu")]
            Self::Gpu => gpu_renderer().shade(medium, origin, groups).expect("a form for the GPU"),
        }
    }

    /// A renderer on this back end.
    ///
    /// # Panics
    /// If it cannot be started.
    #[must_use]
    pub fn renderer(self) -> Box<dyn RenderBackend> {
        match self {
            Self::Cpu(path) => {
                let config = CpuConfig { simd: path.choice(), ..threads(2) };
                Box::new(CpuRenderer::new(config).expect("threads start"))
            }
            #[cfg(feature = "gpu")]
            Self::Gpu => Box::new(gpu_renderer()),
        }
    }

    /// Makes a renderer for training on this back end.
    ///
    /// # Panics
    /// If it cannot be started.
    #[must_use]
    pub fn differentiable(self) -> Box<dyn Differentiable> {
        match self {
            Self::Cpu(path) => {
                let config = CpuConfig { simd: path.choice(), ..threads(2) };
                Box::new(CpuDifferentiable::new(config).expect("threads start"))
            }
            #[cfg(feature = "gpu")]
            Self::Gpu => Box::new(gpu_differentiable()),
        }
    }
}

/// Returns the settings of the CPU back end with so many threads.
#[must_use]
pub fn threads(count: usize) -> CpuConfig {
    CpuConfig { threads: Some(count), ..CpuConfig::default() }
}

/// The settings of whatever GPU there is.
#[cfg(feature = "gpu")]
pub(crate) const ANY_GPU: GpuConfig =
    GpuConfig { choice: AdapterChoice::Any, limits: None, subgroups: Subgroups::Used };

/// Makes a renderer for training on the shared GPU.
///
/// # Panics
/// If there is none; see [`Backend::gpu`].
#[cfg(feature = "gpu")]
#[must_use]
pub fn gpu_differentiable() -> GpuDifferentiable {
    let gpu = shared_gpu().clone().expect("a GPU");
    GpuDifferentiable::new(gpu, threads(2)).expect("threads start")
}

/// Makes a back end for training like `auto` on a GPU of its own, which may be taken away.
///
/// # Panics
/// If there is none; see [`Backend::gpu`].
#[cfg(feature = "gpu")]
#[must_use]
pub fn fallible_differentiable(warn: fn(&RenderError)) -> (AnyDifferentiable, Arc<Gpu>) {
    let gpu = Gpu::open(&ANY_GPU).expect("a GPU");
    (AnyDifferentiable::fallible(Arc::clone(&gpu), threads(2), warn).expect("threads start"), gpu)
}

/// Opens a GPU with the default limits of browsers, and bindings of at most `most_binding` bytes.
///
/// # Panics
/// If there is none; see [`Backend::gpu`].
#[cfg(feature = "gpu")]
#[must_use]
pub fn small_gpu(most_binding: u64) -> Arc<Gpu> {
    let limits = wgpu::Limits { max_storage_buffer_binding_size: most_binding, ..wgpu::Limits::default() };
    Gpu::open(&GpuConfig { limits: Some(limits), ..ANY_GPU }).expect("a GPU")
}

/// Returns the GPU that all tests of a program share, which is started once.
#[cfg(feature = "gpu")]
fn shared_gpu() -> &'static Result<Arc<Gpu>, GpuError> {
    static SHARED: OnceLock<Result<Arc<Gpu>, GpuError>> = OnceLock::new();
    SHARED.get_or_init(|| Gpu::open(&ANY_GPU))
}

/// Makes a renderer on the shared GPU.
///
/// # Panics
/// If there is none; see [`Backend::gpu`].
#[cfg(feature = "gpu")]
pub(crate) fn gpu_renderer() -> GpuRenderer {
    let gpu = shared_gpu().clone().expect("a GPU");
    GpuRenderer::new(gpu, threads(2)).expect("threads start")
}

/// The text of every program of the GPU, but for those with the air of a weather.
#[cfg(feature = "gpu")]
#[must_use]
pub fn program_texts() -> Vec<String> {
    programs::all().iter().map(Program::text).collect()
}

/// Checks that an air's WGSL is valid where the renderer puts it; needs no GPU.
///
/// # Errors
/// A message with the place in the text.
#[cfg(feature = "gpu")]
pub fn check_air(air: &WgslSource) -> Result<(), String> {
    use wgpu::naga::{front::wgsl, valid};
    for program in programs::air_programs(&air.wgsl) {
        let text = program.text();
        let module = wgsl::parse_str(&text).map_err(|error| error.emit_to_string(&text))?;
        let mut validator =
            valid::Validator::new(valid::ValidationFlags::all(), valid::Capabilities::empty());
        validator.validate(&module).map_err(|error| error.emit_to_string(&text))?;
    }
    Ok(())
}

/// Makes one test a back end of a check that takes a [`testing::Backend`](crate::testing::Backend):
/// every SIMD path, and the GPU.
#[macro_export]
macro_rules! parity {
    ($($name:ident => $check:expr;)*) => {$(
        mod $name {
            #[allow(unused_imports)]
            use super::*;

            $crate::tests_of_paths!($check);

            #[test]
            fn gpu() {
                $crate::testing::Backend::gpu().map($check);
            }
        }
    )*};
}

/// Makes one test per SIMD path of a check that concerns the CPU alone.
#[macro_export]
macro_rules! cpu_parity {
    ($($name:ident => $check:expr;)*) => {$(
        mod $name {
            #[allow(unused_imports)]
            use super::*;

            $crate::tests_of_paths!($check);
        }
    )*};
}

/// Makes one test per SIMD path.
#[doc(hidden)]
#[macro_export]
macro_rules! tests_of_paths {
    ($check:expr) => {
        #[test]
        fn portable() {
            $crate::testing::Backend::of($crate::simd::SimdChoice::Portable).map($check);
        }

        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        #[test]
        fn avx2() {
            $crate::testing::Backend::of($crate::simd::SimdChoice::Avx2).map($check);
        }

        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        #[test]
        fn avx512() {
            $crate::testing::Backend::of($crate::simd::SimdChoice::Avx512).map($check);
        }

        #[cfg(target_arch = "aarch64")]
        #[test]
        fn neon() {
            $crate::testing::Backend::of($crate::simd::SimdChoice::Neon).map($check);
        }
    };
}

pub use crate::bench_scene::{shell_camera, shell_splats};
pub use wm_base::random::uniform;

/// `count` random splats in a box of side 4 about the origin.
#[must_use]
pub fn random_splats(count: usize, sh_degree: u8, seed: u64) -> Splats {
    let mut splats = Splats::with_capacity(count, sh_degree);
    for i in 0..count as u64 {
        let u = |k: u64| uniform(seed, i * 128 + k);
        splats.means.push([0, 1, 2].map(|k| (u(k) * 4.0 - 2.0) as f32));
        splats.quats.push([3, 4, 5, 6].map(|k| (u(k) * 2.0 - 1.0) as f32));
        splats.log_scales.push([7, 8, 9].map(|k| (-4.5 + 3.5 * u(k)) as f32));
        splats.logit_opacities.push(logit(0.02 + 0.97 * u(10)) as f32);
        for k in 0..splats.sh_stride() as u64 {
            let size = if k < 3 { 1.7 } else { 0.3 };
            splats.sh.push(((u(16 + k) * 2.0 - 1.0) * size) as f32);
        }
        splats.groups.push(Group::Scene);
    }
    splats
}

/// 512 splats in view order with a standard deviation of about `sigma` px, spread over the tile at
/// the picture's corner and too faint to stop blending early.
#[must_use]
pub fn tile_records(sigma: f64) -> Vec<Record> {
    let tile = TILE as f64;
    (0..512)
        .map(|i| {
            let u = |k: u64| uniform(5, i * 8 + k);
            let stretch = (1.2 * (u(0) - 0.5)).exp();
            let (sin, cos) = (u(1) * std::f64::consts::PI).sin_cos();
            let (a, b) = ((sigma * stretch).powi(2) + 0.3, (sigma / stretch).powi(2) + 0.3);
            let (xx, yy, xy) =
                (cos * cos * a + sin * sin * b, sin * sin * a + cos * cos * b, sin * cos * (a - b));
            let vy = f64::from(SQRT_HALF_LOG2E) * (xx / (xx * yy - xy * xy)).sqrt();
            Record {
                x: (tile * u(2)) as f32,
                y: (tile * u(3)) as f32,
                ux: (f64::from(SQRT_HALF_LOG2E) / xx.sqrt()) as f32,
                vx: (-vy * xy / xx) as f32,
                vy: vy as f32,
                slope_y: (xy / xx) as f32,
                slope_x: (xy / yy) as f32,
                log2_opacity: (0.012 + 0.01 * u(4)).log2() as f32,
                rgb: [0.5, 0.4, 0.3],
                depth: 5.0,
                normal: [0.1, 0.2, 0.9],
                index: i as u32,
            }
        })
        .collect()
}

/// The camera that sees the test scenes: at (0, 0, -6), principal point off centre.
///
/// # Panics
/// Never: its numbers are fixed.
#[must_use]
pub fn camera(width: u32, height: u32) -> Camera {
    let eye = DVec3::new(0.0, 0.0, -6.0);
    let camera = Camera::looking((width, height), 45.0, eye, DVec3::new(0.3, 0.2, 0.0), DVec3::NEG_Y);
    let camera = camera.expect("a camera");
    Camera { cx: camera.cx + 0.11 * f64::from(width), cy: camera.cy - 0.07 * f64::from(height), ..camera }
}

/// A random derivative for each picture, of numbers in [-1, 1].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RandomLoss {
    /// `[H, W, 3]`.
    pub rgb: Vec<f32>,
    /// `[H, W]`.
    pub alpha: Vec<f32>,
    /// `[H, W]`.
    pub depth: Vec<f32>,
    /// `[H, W, 3]`.
    pub normal: Vec<f32>,
}

impl RandomLoss {
    /// For the pictures of `channels`, at pixels for which `wanted` holds; 0 elsewhere.
    #[must_use]
    pub fn new(channels: Channels, pixels: usize, seed: u64, wanted: impl Fn(usize) -> bool) -> Self {
        let values = |there: bool, channels: usize, from: u64| -> Vec<f32> {
            let count = if there { channels * pixels } else { 0 };
            let value = |i: usize| {
                let value = (uniform(seed, (from << 32) + i as u64) * 2.0 - 1.0) as f32;
                if wanted(i / channels) { value } else { 0.0 }
            };
            (0..count).map(value).collect()
        };
        Self {
            rgb: values(channels.has_color(), 3, 0),
            alpha: values(true, 1, 1),
            depth: values(channels.depth().is_some(), 1, 2),
            normal: values(channels.has_normal(), 3, 3),
        }
    }

    /// Returns the loss in the form of the backward pass.
    #[must_use]
    pub fn upstream(&self) -> Upstream<'_> {
        let Self { rgb, alpha, depth, normal } = self;
        Upstream { rgb, alpha, depth, normal, ..Upstream::default() }
    }
}
