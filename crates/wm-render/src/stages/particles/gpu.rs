//! Particles on the GPU: the CPU gathers and projects them, a workgroup adds up each drop's cover
//! in whole numbers by atomics, so that no order counts.

use crate::gpu::recorder::{Groups, Recorder, with_buffers};
use crate::gpu::source::{StagePrograms, texts};
use std::borrow::Cow;

/// The text that blends particles over a pixel.
pub(crate) const OVER: &str = include_str!("over.wgsl");

/// The programs of particles.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) enum ParticleProgram {
    /// Adds up the cover of particles.
    Fall,
}

impl StagePrograms for ParticleProgram {
    fn all() -> Vec<Self> {
        vec![Self::Fall]
    }

    fn entry(&self) -> &'static str {
        "fall"
    }

    fn parts(&self) -> Vec<Cow<'static, str>> {
        texts([include_str!("fall.wgsl")])
    }
}

/// Adds up the cover of `count` drops: before a scene of that coverage and expected depth, to sums
/// that were 0.
pub(crate) fn fall(
    recorder: &mut Recorder<'_>,
    drops: &wgpu::Buffer,
    count: u32,
    alpha: &wgpu::Buffer,
    depths: &wgpu::Buffer,
    sums: &wgpu::Buffer,
) {
    let bindings = with_buffers(vec![(0, recorder.view())], [drops, alpha, depths, sums]);
    recorder.dispatch(ParticleProgram::Fall, Groups::Direct(count), bindings);
}
