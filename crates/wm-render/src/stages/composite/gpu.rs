//! The background on the GPU. It is one colour, or a picture that the CPU paints and uploads: skies and panoramas have no
//! form for the GPU yet. Pixel effects run on the CPU, on the picture that came back.

use crate::gpu::recorder::{Groups, Recorder};
use crate::gpu::source::{Behind, Falls, Program, WORKGROUP};

/// What the composite reads and writes, see `composite.wgsl`.
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
    pub fn record(&self, recorder: &mut Recorder<'_>, pixels: u32, behind: Behind, falls: Falls) {
        let mut bindings = vec![
            (0, recorder.view()),
            (1, self.rgb.as_entire_binding()),
            (2, self.alpha.as_entire_binding()),
            (3, self.background.as_entire_binding()),
        ];
        if falls != Falls::Nothing {
            bindings.extend([(4, self.falling.as_entire_binding()), (5, self.apart.as_entire_binding())]);
        }
        let groups = Groups::Direct(pixels.div_ceil(WORKGROUP));
        recorder.dispatch(&Program::Composite(behind, falls), groups, bindings);
    }
}
