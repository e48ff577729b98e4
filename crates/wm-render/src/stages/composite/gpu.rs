//! The background on the GPU. It is one colour, or a picture that the CPU paints and uploads: skies and panoramas have no
//! form for the GPU yet. Pixel effects run on the CPU, on the picture that came back.

use crate::differentiable::Channels;
use crate::gpu::recorder::{Groups, Recorder};
use crate::gpu::source::{BackgroundForm, ParticleBlend, Program, WORKGROUP};
use crate::stages::rasterize_backward::gpu::Kept;

/// The buffers that `composite.wgsl` reads and writes.
pub(crate) struct Composite<'a> {
    pub rgb: &'a wgpu::Buffer,
    pub alpha: &'a wgpu::Buffer,
    pub background: &'a wgpu::Buffer,
    /// Sums of what falls, see `over.wgsl`.
    pub falling: &'a wgpu::Buffer,
    /// Its picture.
    pub apart: &'a wgpu::Buffer,
}

impl Composite<'_> {
    /// Finishes `pixels` pixels.
    pub fn record(
        &self,
        recorder: &mut Recorder<'_>,
        pixels: u32,
        behind: BackgroundForm,
        falls: ParticleBlend,
    ) {
        let mut bindings = vec![
            (0, recorder.view()),
            (1, self.rgb.as_entire_binding()),
            (2, self.alpha.as_entire_binding()),
            (3, self.background.as_entire_binding()),
        ];
        if falls != ParticleBlend::None {
            bindings.extend([(4, self.falling.as_entire_binding()), (5, self.apart.as_entire_binding())]);
        }
        let groups = Groups::Direct(pixels.div_ceil(WORKGROUP));
        recorder.dispatch(&Program::Composite(behind, falls), groups, bindings);
    }
}

/// The buffers that `finish.wgsl` reads and writes: the pictures of a step of training.
pub(crate) struct Finish<'a> {
    pub kept: Kept<'a>,
    pub rgb: &'a wgpu::Buffer,
    pub depths: &'a wgpu::Buffer,
    pub normal: &'a wgpu::Buffer,
}

impl Finish<'_> {
    /// Finishes `pixels` pixels; `training` is the structure of that name.
    pub fn record(
        &self,
        recorder: &mut Recorder<'_>,
        (pixels, channels): (u32, Channels),
        training: wgpu::BindingResource<'_>,
    ) {
        let bindings = vec![
            (0, recorder.view()),
            (1, training),
            (2, self.kept.rgb.as_entire_binding()),
            (3, self.kept.alpha.as_entire_binding()),
            (4, self.kept.depths.as_entire_binding()),
            (5, self.kept.normal.as_entire_binding()),
            (6, self.rgb.as_entire_binding()),
            (7, self.depths.as_entire_binding()),
            (8, self.normal.as_entire_binding()),
        ];
        recorder.dispatch(&Program::Finish(channels), Groups::Direct(pixels.div_ceil(WORKGROUP)), bindings);
    }
}
