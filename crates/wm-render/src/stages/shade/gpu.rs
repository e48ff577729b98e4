//! The air on the GPU: part of the projection (`crate::stages::project::gpu`), and here by itself.

use crate::gpu::recorder::{Groups, Recorder};
use crate::gpu::source::{Program, WORKGROUP};
use crate::hooks::{GROUP, WgslSource};

/// Changes the colours of `count` groups; see `groups.wgsl`.
pub(crate) fn shade_groups(
    recorder: &mut Recorder<'_>,
    (air, parameters): (&WgslSource, &wgpu::Buffer),
    (groups, count): (&wgpu::Buffer, u32),
) {
    let bindings = vec![(0, groups.as_entire_binding()), (8, parameters.as_entire_binding())];
    let size = Groups::Direct((count * GROUP as u32).div_ceil(WORKGROUP));
    recorder.dispatch(&Program::Air(air.wgsl.clone()), size, bindings);
}
