//! Records the dispatches of a frame, stage by stage.

use super::device::Gpu;
use super::error::GpuError;
use super::source::{DISPATCH_ROW, Program, Subgroups};
use super::uniforms::UNIFORM_SLOT_BYTES;
use wgpu::{BindGroupDescriptor, BindGroupEntry, BindingResource, BufferBinding, BufferSize, BufferUsages};

/// The number of workgroups of a dispatch.
#[derive(Clone, Copy)]
pub(crate) enum Groups<'a> {
    /// A known number of workgroups.
    Direct(u32),
    /// The number that the GPU wrote: buffer, and word in it.
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
    Compare,
    RasterizeBackward,
    ProjectBackward,
    Optimize,
    Explore,
}

impl Stage {
    /// Number of stages.
    const COUNT: usize = Self::Explore as usize + 1;
}

/// Timestamps of the begin and end of stages, by the GPU's clock.
pub(crate) struct Clock {
    queries: wgpu::QuerySet,
    /// Beginning and end of each stage, stages [`Self::QUERY_ALIGNMENT_BYTES`] apart.
    pub(crate) times: wgpu::Buffer,
    /// Seconds of a tick.
    tick: f64,
}

/// The numbers that a [`Clock`] has counted.
pub(crate) type Ticks = [u64; Clock::TICK_COUNT];

impl Clock {
    /// Alignment of resolved queries.
    const QUERY_ALIGNMENT_BYTES: usize = wgpu::QUERY_RESOLVE_BUFFER_ALIGNMENT as usize;
    const TICK_COUNT: usize = Self::QUERY_ALIGNMENT_BYTES / 8 * Stage::COUNT;

    /// A clock, where the adapter has one.
    pub(crate) fn new(gpu: &Gpu) -> Result<Option<Self>, GpuError> {
        let Some(tick) = gpu.tick else { return Ok(None) };
        let queries = gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
            label: Some("times of stages"),
            ty: wgpu::QueryType::Timestamp,
            count: 2 * Stage::COUNT as u32,
        });
        let usage = BufferUsages::QUERY_RESOLVE | BufferUsages::COPY_SRC;
        let times = gpu.buffer("times of stages", 8 * Self::TICK_COUNT as u64, usage)?;
        Ok(Some(Self { queries, times, tick: 1e-9 * f64::from(tick) }))
    }

    /// The place for what it has counted.
    pub(crate) fn ticks() -> Ticks {
        [0; Self::TICK_COUNT]
    }

    /// The time that a stage took the last time, seconds.
    pub(crate) fn seconds(&self, ticks: &Ticks, stage: Stage) -> f64 {
        let at = Self::QUERY_ALIGNMENT_BYTES / 8 * stage as usize;
        self.tick * ticks[at + 1].saturating_sub(ticks[at]) as f64
    }
}

/// Number and resource of each binding.
pub(crate) type Bindings<'a> = Vec<(u32, BindingResource<'a>)>;

/// Returns `first` followed by whole buffers, with consecutive numbers in the order in which the
/// shader declares them.
pub(crate) fn with_buffers<'a, const N: usize>(
    mut first: Bindings<'a>,
    buffers: [&'a wgpu::Buffer; N],
) -> Bindings<'a> {
    let next = first.last().map_or(0, |(number, _)| number + 1);
    first.extend((next..).zip(buffers.map(wgpu::Buffer::as_entire_binding)));
    first
}

/// Returns `first` followed by whole buffers, each with its number.
pub(crate) fn with_numbered<'a, const N: usize>(
    mut first: Bindings<'a>,
    buffers: [(u32, &'a wgpu::Buffer); N],
) -> Bindings<'a> {
    first.extend(buffers.map(|(number, buffer)| (number, buffer.as_entire_binding())));
    first
}

/// The commands of one frame.
pub(crate) struct Recorder<'a> {
    gpu: &'a Gpu,
    /// Uniform structures, [`UNIFORM_SLOT_BYTES`] apart; the first of each pass is `View`.
    uniforms: &'a wgpu::Buffer,
    clock: Option<&'a Clock>,
    /// The slot of the pass's first structure.
    first_slot: usize,
    encoder: wgpu::CommandEncoder,
    pass: Option<wgpu::ComputePass<'static>>,
    /// The stages that have begun.
    stages: Vec<Stage>,
    dispatches: u64,
}

impl<'a> Recorder<'a> {
    pub(crate) fn new(gpu: &'a Gpu, uniforms: &'a wgpu::Buffer, clock: Option<&'a Clock>) -> Self {
        let encoder =
            gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("frame") });
        Self { gpu, uniforms, clock, first_slot: 0, encoder, pass: None, stages: Vec::new(), dispatches: 0 }
    }

    /// The slots that follow are counted from this one: that of the first structure of a pass.
    pub(crate) fn set_first_slot(&mut self, slot: usize) {
        self.first_slot = slot;
    }

    /// The buffer that [`Self::tell_times`] writes.
    pub(crate) fn times(&self) -> Option<&'a wgpu::Buffer> {
        self.clock.map(|clock| &clock.times)
    }

    /// The dispatches that follow are of this stage; each stage begins once before
    /// [`Self::tell_times`].
    pub(crate) fn begin(&mut self, stage: Stage) {
        self.pass = None;
        self.stages.push(stage);
        let at = 2 * stage as u32;
        let timestamp_writes = self.clock.map(|clock| wgpu::ComputePassTimestampWrites {
            query_set: &clock.queries,
            beginning_of_pass_write_index: Some(at),
            end_of_pass_write_index: Some(at + 1),
        });
        let descriptor = wgpu::ComputePassDescriptor { label: None, timestamp_writes };
        self.pass = Some(self.encoder.begin_compute_pass(&descriptor).forget_lifetime());
    }

    /// The use of subgroups by programs.
    pub(crate) fn subgroups(&self) -> Subgroups {
        self.gpu.subgroups
    }

    /// The structure `View`.
    pub(crate) fn view(&self) -> BindingResource<'a> {
        self.uniform(0)
    }

    /// Returns the binding of the structure in a slot of this pass.
    pub(crate) fn uniform(&self, slot: usize) -> BindingResource<'a> {
        BindingResource::Buffer(BufferBinding {
            buffer: self.uniforms,
            offset: (self.first_slot + slot) as u64 * UNIFORM_SLOT_BYTES,
            size: BufferSize::new(UNIFORM_SLOT_BYTES),
        })
    }

    /// Records one dispatch, unless it has no workgroups.
    pub(crate) fn dispatch(&mut self, program: Program, groups: Groups<'_>, bindings: Bindings<'_>) {
        if let Groups::Direct(0) = groups {
            return;
        }
        let Some(pass) = &mut self.pass else { return };
        let pipeline = self.gpu.pipeline(&program);
        let entries: Vec<BindGroupEntry<'_>> =
            bindings.into_iter().map(|(binding, resource)| BindGroupEntry { binding, resource }).collect();
        let bind_group = self.gpu.device.create_bind_group(&BindGroupDescriptor {
            label: Some(program.entry),
            layout: &pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        self.dispatches += 1;
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &bind_group, &[]);
        match groups {
            Groups::Direct(count) => {
                pass.dispatch_workgroups(count.min(DISPATCH_ROW), count.div_ceil(DISPATCH_ROW), 1);
            }
            Groups::Indirect(buffer, word) => pass.dispatch_workgroups_indirect(buffer, 4 * u64::from(word)),
        }
    }

    /// Returns the encoder for commands outside of stages: copies and clears.
    pub(crate) fn encoder(&mut self) -> &mut wgpu::CommandEncoder {
        self.pass = None;
        &mut self.encoder
    }

    /// Resolves the timestamps of the stages so far to a buffer that can be read.
    pub(crate) fn tell_times(&mut self) {
        self.pass = None;
        if let Some(clock) = self.clock {
            for stage in self.stages.drain(..) {
                let (first, at) = (2 * stage as u32, Clock::QUERY_ALIGNMENT_BYTES * stage as usize);
                self.encoder.resolve_query_set(&clock.queries, first..first + 2, &clock.times, at as u64);
            }
        }
    }

    /// Hands everything to the GPU.
    pub(crate) fn submit(mut self) {
        self.tell_times();
        self.gpu.count(|work| {
            work.dispatches += self.dispatches;
            work.submissions += 1;
        });
        self.gpu.queue.submit([self.encoder.finish()]);
    }
}
