//! Writes down the dispatches of a frame, stage by stage.

use super::device::Gpu;
use super::source::{DISPATCH_ROW, Program};
use super::uniforms::SLOT;
use wgpu::{BindGroupDescriptor, BindGroupEntry, BindingResource, BufferBinding, BufferSize};

/// How many workgroups a dispatch has.
#[derive(Clone, Copy)]
pub(crate) enum Groups<'a> {
    /// As many.
    Direct(u32),
    /// As the GPU wrote there: buffer and word.
    Indirect(&'a wgpu::Buffer, u32),
}

/// Stages that are timed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stage {
    Project,
    Sort,
    Intersect,
    Rasterize,
    Fall,
    Composite,
}

impl Stage {
    /// Number of stages.
    pub const COUNT: u32 = 6;
}

/// Number and resource of each binding.
pub(crate) type Bindings<'a> = Vec<(u32, BindingResource<'a>)>;

/// The commands of one frame.
pub(crate) struct Recorder<'a> {
    gpu: &'a Gpu,
    /// A structure every [`SLOT`] bytes, the first of them `View`.
    uniforms: &'a wgpu::Buffer,
    queries: Option<&'a wgpu::QuerySet>,
    encoder: wgpu::CommandEncoder,
    pass: Option<wgpu::ComputePass<'static>>,
}

impl<'a> Recorder<'a> {
    pub fn new(gpu: &'a Gpu, uniforms: &'a wgpu::Buffer, queries: Option<&'a wgpu::QuerySet>) -> Self {
        let encoder =
            gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("frame") });
        Self { gpu, uniforms, queries, encoder, pass: None }
    }

    /// The dispatches that follow are of this stage; each stage begins once.
    pub fn begin(&mut self, stage: Stage) {
        self.pass = None;
        let at = 2 * stage as u32;
        let timestamp_writes = self.queries.map(|query_set| wgpu::ComputePassTimestampWrites {
            query_set,
            beginning_of_pass_write_index: Some(at),
            end_of_pass_write_index: Some(at + 1),
        });
        let descriptor = wgpu::ComputePassDescriptor { label: None, timestamp_writes };
        self.pass = Some(self.encoder.begin_compute_pass(&descriptor).forget_lifetime());
    }

    /// The structure `View`.
    pub fn view(&self) -> BindingResource<'a> {
        self.uniform(0)
    }

    /// The structure in a slot.
    pub fn uniform(&self, slot: usize) -> BindingResource<'a> {
        BindingResource::Buffer(BufferBinding {
            buffer: self.uniforms,
            offset: slot as u64 * SLOT,
            size: BufferSize::new(SLOT),
        })
    }

    /// One dispatch; none of no workgroups.
    pub fn dispatch(&mut self, program: &Program, groups: Groups<'_>, bindings: Bindings<'_>) {
        if let Groups::Direct(0) = groups {
            return;
        }
        let Some(pass) = &mut self.pass else { return };
        let pipeline = self.gpu.pipeline(program);
        let entries: Vec<BindGroupEntry<'_>> =
            bindings.into_iter().map(|(binding, resource)| BindGroupEntry { binding, resource }).collect();
        let bind_group = self.gpu.device.create_bind_group(&BindGroupDescriptor {
            label: Some(program.entry()),
            layout: &pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &bind_group, &[]);
        match groups {
            Groups::Direct(count) => {
                pass.dispatch_workgroups(count.min(DISPATCH_ROW), count.div_ceil(DISPATCH_ROW), 1);
            }
            Groups::Indirect(buffer, word) => pass.dispatch_workgroups_indirect(buffer, 4 * u64::from(word)),
        }
    }

    /// The commands outside of stages: copies and clearing.
    pub fn encoder(&mut self) -> &mut wgpu::CommandEncoder {
        self.pass = None;
        &mut self.encoder
    }

    /// All commands.
    pub fn finish(mut self) -> wgpu::CommandBuffer {
        self.pass = None;
        self.encoder.finish()
    }
}
