//! Renders 3D Gaussian splats in weather, on CPUs and GPUs, and derives renders for training.
//!
//! The types to know:
//!
//! - [`AnyRenderer`] draws on the device of your choice: a [`CpuRenderer`] or a [`GpuRenderer`]
//!   behind the trait [`RenderBackend`]. Splat sets are loaded once and drawn many times.
//! - [`DrawPass`] is one view: splat sets, a camera, and a [`RenderConfig`] with outputs and
//!   background.
//! - [`hooks::Hooks`] is the weather of a pass: air, particles, a sky, pixel effects.
//! - [`Frame`] holds the pictures of a view: colour, coverage, depth, normals.
//! - [`FramePlan`] is a list of passes for frames that take several; its pictures are in
//!   [`Pictures`].
//!
//! ```
//! use wm_render::{AnyRenderer, CpuConfig, Device, DrawPass, Frame, RenderBackend, RenderConfig, SetView};
//! use wm_scene::{Camera, Group, Splats};
//!
//! // One white ball of radius 0.5 at (4, 0, 0), seen along x.
//! let mut splats = Splats::with_capacity(1, 0);
//! splats.means.push([4.0, 0.0, 0.0]);
//! splats.quats.push([1.0, 0.0, 0.0, 0.0]);
//! splats.log_scales.push([0.5f32.ln(); 3]);
//! splats.logit_opacities.push(5.0);
//! splats.sh.extend([1.77; 3]);
//! splats.groups.push(Group::Scene);
//! let camera = Camera::looking((64, 48), 50.0, glam::DVec3::ZERO, glam::DVec3::X, glam::DVec3::Z)?;
//!
//! let warn = |error: &wm_render::RenderError| eprintln!("{error}");
//! let mut renderer = AnyRenderer::new(&Device::Cpu, CpuConfig::default(), warn)?;
//! let set = renderer.load(&splats)?;
//! let mut frame = Frame::default();
//! renderer.render(&DrawPass::new(&[SetView::plain(set)], &camera, &RenderConfig::default()), &mut frame)?;
//!
//! assert!(frame.rgb_at(32, 24)[0] > 0.9 && frame.rgb_at(0, 0)[0] < 0.1);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Training goes through [`Differentiable`]; [`mod@reference`] is the f64 reference that all back
//! ends are tested against.

#![allow(clippy::needless_range_loop)] // Lane loops index several arrays at once.

mod at_once;
mod attributes;
pub mod bench_scene;
mod budget;
mod config;
pub mod cpu;
mod device;
mod differentiable;
mod error;
mod even_air;
pub mod frame;
#[cfg(feature = "gpu")]
pub mod gpu;
mod gradients;
pub mod hooks;
pub mod parts;
pub mod pixel_effects;
mod plan;
mod ray_tracer;
pub mod reference;
mod renderer;
pub mod simd;
mod sizes;
#[doc(hidden)]
pub mod stages;
#[cfg(any(test, feature = "testing"))]
pub mod testing;
pub mod training;

pub use at_once::at_once;
pub use config::{
    Background, CpuConfig, Geometry, MedianDepth, Outputs, ParticlePass, RenderConfig, SetId, SkyGradient,
    WaterPass,
};
pub use cpu::{CpuDifferentiable, CpuRenderer};
pub use device::{AnyDifferentiable, AnyRenderer, Device};
pub use differentiable::{
    Channels, DepthAlpha, Differentiable, DrawnSplats, ForwardConfig, Opacity, Resident, StepClock, Target,
    Upstream,
};
pub use error::{Listed, RenderError};
pub use even_air::EvenAir;
pub use frame::{ColorEncoding, FRONT_CHANNELS, Frame};
#[cfg(feature = "gpu")]
pub use gpu::{Gpu, GpuDifferentiable, GpuRaySplats, GpuRenderer};
pub use gradients::{Gradients, Learn};
pub use plan::{
    BlendSurface, CutPlane, DrawPass, FramePass, FramePlan, PictureEffect, PictureId, PicturePass, Pictures,
    SetView, Shading, SplatSource,
};
pub use ray_tracer::AnyRaySplats;
pub use renderer::{DeviceWork, ExecuteFuture, RenderBackend, Stats, bytes_of_set};
pub use stages::rays::{RayHits, RayOutputs, RayTracer, Rays, cpu::RaySplats};
