//! Renders splats: stages with one contract each, a CPU back end, an f64 reference, and the slots in
//! which weather acts.

#![allow(clippy::needless_range_loop)] // Lane loops index several arrays at once.

pub mod attributes;
pub mod cpu;
pub mod device;
pub mod differentiable;
pub mod frame;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod hooks;
pub mod parts;
pub mod plan;
pub mod reference;
pub mod reference_backward;
pub mod reference_particles;
pub mod renderer;
pub mod simd;
pub mod stages;
pub mod testing;

pub use cpu::{CpuDifferentiable, CpuRenderer};
pub use device::{AnyDifferentiable, AnyRenderer, Device};
pub use differentiable::{
    Channels, DepthAlpha, Differentiable, Drawn, ForwardConfig, Gradients, Learn, Opacity, Resident,
    StepClock, Target, Upstream,
};
pub use frame::{Encoding, Frame};
#[cfg(feature = "gpu")]
pub use gpu::{Choice, Gpu, GpuConfig, GpuDifferentiable, GpuRenderer};
pub use plan::{
    DrawPass, FramePass, FramePlan, PictureEffect, PictureId, PicturePass, Pictures, SetView, Shading,
    SplatSource,
};
pub use renderer::{
    Background, CpuConfig, DeviceWork, Geometry, MedianDepth, Outputs, ParticlePass, RenderBackend,
    RenderConfig, RenderError, SetId, SkyGradient, Stats,
};
