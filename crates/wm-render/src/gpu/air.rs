//! The air alone on the GPU, for checks of effects.

use super::buffers::GrowingBuffer;
use super::error::GpuError;
use super::readback;
use super::recorder::{Recorder, Stage};
use super::renderer::GpuRenderer;
use super::source::FAR_AWAY;
use crate::error::RenderError;
use crate::hooks::{Medium, ShadeGroup};
use crate::stages::shade::gpu::shade_groups;
use wgpu::BufferUsages;

impl GpuRenderer {
    /// [`Medium::shade`] on the GPU.
    ///
    /// # Errors
    /// [`RenderError`] if the air has no form for the GPU, or the GPU fails.
    pub(crate) fn shade(
        &self,
        medium: &dyn Medium,
        origin: [f32; 3],
        groups: &mut [ShadeGroup],
    ) -> Result<(), RenderError> {
        let gpu = &self.gpu;
        let source = medium.wgsl(origin).ok_or(GpuError::Effect(medium.name()))?;
        let mut words = Vec::new();
        for group in &*groups {
            words.extend(group.distance.map(|distance| distance.min(FAR_AWAY)));
            words.extend_from_slice(group.direction.as_flattened());
            words.extend_from_slice(group.rgb.as_flattened());
        }
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
        let [parameters, buffer] = [&source.parameters, &words]
            .map(|numbers| GrowingBuffer::default().write(gpu, "the air", numbers, usage));
        let (parameters, buffer) = (parameters?, buffer?);
        let mut recorder = Recorder::new(gpu, &parameters, None);
        recorder.begin(Stage::Project);
        shade_groups(&mut recorder, &source, &parameters, &buffer, groups.len() as u32);
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut words);
        readback::copy(gpu, recorder, &mut GrowingBuffer::default(), &mut [(&buffer, 0, bytes)])?;
        let rows = words.chunks_exact(size_of::<ShadeGroup>() / 4);
        for (group, row) in groups.iter_mut().zip(rows) {
            group.rgb.as_flattened_mut().copy_from_slice(&row[row.len() - 48..]);
        }
        Ok(())
    }
}
