//! The GPU's working memory: buffers that grow and are kept.

use super::device::Gpu;
use super::error::GpuError;
use super::source::{BLOCK_WORDS, COUNTER_WORDS, DIGITS, DISPATCH_WORDS, SORT_BLOCK, WORKGROUP};
use super::uniforms::{Capacity, SLOT};
use crate::stages::composite::gpu::ParticleBlend;
use wgpu::BufferUsages;

pub(crate) const WRITTEN: BufferUsages = BufferUsages::STORAGE.union(BufferUsages::COPY_DST);
pub(crate) const READ_BACK: BufferUsages = BufferUsages::STORAGE.union(BufferUsages::COPY_SRC);

/// A buffer that is allocated again when it is too small.
#[derive(Default)]
pub(crate) struct GrowingBuffer {
    buffer: Option<wgpu::Buffer>,
}

impl GrowingBuffer {
    /// Returns the buffer with at least `bytes` bytes; its contents are lost when it grows.
    pub(crate) fn fit(
        &mut self,
        gpu: &Gpu,
        what: &'static str,
        bytes: u64,
        usage: BufferUsages,
    ) -> Result<wgpu::Buffer, GpuError> {
        gpu.check_binding(what, bytes)?;
        self.fit_unbound(gpu, what, bytes, usage)
    }

    /// Fits a buffer that no program binds: it may be larger than the limit of bindings.
    pub(crate) fn fit_unbound(
        &mut self,
        gpu: &Gpu,
        what: &'static str,
        bytes: u64,
        usage: BufferUsages,
    ) -> Result<wgpu::Buffer, GpuError> {
        if let Some(buffer) = self.buffer.as_ref().filter(|buffer| buffer.size() >= bytes) {
            return Ok(buffer.clone());
        }
        // The old buffer is freed first, so that both need not fit at once.
        self.buffer = None;
        let buffer = gpu.buffer(what, bytes, usage)?;
        self.buffer = Some(buffer.clone());
        Ok(buffer)
    }
}

impl GrowingBuffer {
    /// Returns the buffer with `numbers` at its beginning.
    pub(crate) fn write(
        &mut self,
        gpu: &Gpu,
        what: &'static str,
        numbers: &[f32],
        usage: BufferUsages,
    ) -> Result<wgpu::Buffer, GpuError> {
        let bytes: &[u8] = bytemuck::cast_slice(numbers);
        let buffer = self.fit(gpu, what, bytes.len() as u64, usage)?;
        gpu.write(&buffer, 0, bytes);
        Ok(buffer)
    }
}

/// Room for a frame: handles to the kept buffers.
pub(crate) struct Room {
    /// Structures, one a slot.
    pub(crate) uniforms: wgpu::Buffer,
    pub(crate) counters: wgpu::Buffer,
    pub(crate) dispatches: wgpu::Buffer,
    /// `Block` of `geometry.wgsl`.
    pub(crate) blocks: wgpu::Buffer,
    pub(crate) records: wgpu::Buffer,
    /// Depths and names of the splats in view, twice.
    pub(crate) depth_pairs: [[wgpu::Buffer; 2]; 2],
    pub(crate) counts: wgpu::Buffer,
    pub(crate) sums: wgpu::Buffer,
    /// Tiles and names of the entries, twice.
    pub(crate) entry_pairs: [[wgpu::Buffer; 2]; 2],
    pub(crate) histogram: wgpu::Buffer,
    pub(crate) totals: wgpu::Buffer,
    pub(crate) tile_offsets: wgpu::Buffer,
    pub(crate) rgb: wgpu::Buffer,
    pub(crate) alpha: wgpu::Buffer,
    pub(crate) depths: wgpu::Buffer,
    pub(crate) normal: wgpu::Buffer,
    /// Optical depth of what falls and its light, whole numbers, `[H, W, 4]`.
    pub(crate) falling: wgpu::Buffer,
    /// [`crate::Frame::particles`].
    pub(crate) apart: wgpu::Buffer,
}

/// The size of a frame.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Extent {
    pub(crate) slots: usize,
    pub(crate) blocks: u32,
    pub(crate) capacity: Capacity,
    pub(crate) tiles: u32,
    pub(crate) pixels: u64,
    /// Pictures of depths.
    pub(crate) planes: u64,
    pub(crate) normal: bool,
    pub(crate) particles: ParticleBlend,
}

impl Extent {
    /// Returns the larger extent of two frames that follow each other.
    pub(crate) fn max(self, other: Self) -> Self {
        Self {
            slots: self.slots.max(other.slots),
            blocks: self.blocks.max(other.blocks),
            capacity: other.capacity,
            tiles: self.tiles.max(other.tiles),
            pixels: self.pixels.max(other.pixels),
            planes: self.planes.max(other.planes),
            normal: self.normal | other.normal,
            particles: self.particles.max(other.particles),
        }
    }
}

/// The buffers that are kept from frame to frame.
#[derive(Default)]
pub(crate) struct Memory {
    kept: [GrowingBuffer; 24],
    /// Each of these holds numbers for one pass, or for one set of one pass.
    attributes: BufferPool,
    air: BufferPool,
    drops: BufferPool,
    backgrounds: BufferPool,
    pub(crate) staging: GrowingBuffer,
}

/// Buffers of one kind, handed out one after the other.
#[derive(Default)]
struct BufferPool {
    buffers: Vec<GrowingBuffer>,
    used: usize,
}

impl BufferPool {
    fn write(&mut self, gpu: &Gpu, what: &'static str, numbers: &[f32]) -> Result<wgpu::Buffer, GpuError> {
        if self.used == self.buffers.len() {
            self.buffers.push(GrowingBuffer::default());
        }
        self.used += 1;
        self.buffers[self.used - 1].write(gpu, what, numbers, WRITTEN)
    }
}

impl Memory {
    /// Starts with the first buffers again, when nothing reads what they hold any more.
    pub(crate) fn start_batch(&mut self) {
        for buffers in [&mut self.attributes, &mut self.air, &mut self.drops, &mut self.backgrounds] {
            buffers.used = 0;
        }
    }

    /// Uploads the attributes of the splats of one set.
    pub(crate) fn attributes(&mut self, gpu: &Gpu, numbers: &[f32]) -> Result<wgpu::Buffer, GpuError> {
        self.attributes.write(gpu, "attributes of splats", numbers)
    }

    /// Uploads the parameters of the air.
    pub(crate) fn air(&mut self, gpu: &Gpu, parameters: &[f32]) -> Result<wgpu::Buffer, GpuError> {
        self.air.write(gpu, "the air", parameters)
    }

    /// Uploads particles.
    pub(crate) fn drops(&mut self, gpu: &Gpu, drops: &[f32]) -> Result<wgpu::Buffer, GpuError> {
        self.drops.write(gpu, "particles", drops)
    }

    /// Uploads a background.
    pub(crate) fn background(&mut self, gpu: &Gpu, numbers: &[f32]) -> Result<wgpu::Buffer, GpuError> {
        self.backgrounds.write(gpu, "the background", numbers)
    }

    /// Room for a frame of this extent.
    pub(crate) fn room(&mut self, gpu: &Gpu, extent: &Extent) -> Result<Room, GpuError> {
        let mut kept = self.kept.iter_mut();
        let mut fit = |what: &'static str, bytes: u64, usage: BufferUsages| match kept.next() {
            Some(growing) => growing.fit(gpu, what, bytes, usage),
            None => gpu.buffer(what, bytes, usage),
        };
        let Capacity { visible, entries } = extent.capacity;
        let (visible, entries) = (u64::from(visible), u64::from(entries));
        let sort_blocks = visible.max(entries).div_ceil(u64::from(SORT_BLOCK));
        let picture = |there: bool, channels: u64| if there { 4 * channels * extent.pixels } else { 0 };
        Ok(Room {
            uniforms: fit(
                "structures",
                SLOT * extent.slots as u64,
                BufferUsages::UNIFORM | BufferUsages::COPY_DST,
            )?,
            counters: fit("counters", 4 * COUNTER_WORDS, READ_BACK | BufferUsages::COPY_DST)?,
            dispatches: fit("dispatch sizes", 4 * DISPATCH_WORDS, READ_BACK | BufferUsages::INDIRECT)?,
            blocks: fit(
                "blocks of splats",
                4 * u64::from(BLOCK_WORDS) * u64::from(extent.blocks),
                READ_BACK,
            )?,
            records: fit("the splats in view", 64 * visible, READ_BACK)?,
            depth_pairs: [
                [fit("depths", 4 * visible, READ_BACK)?, fit("the order by depth", 4 * visible, READ_BACK)?],
                [fit("depths", 4 * visible, READ_BACK)?, fit("the order by depth", 4 * visible, READ_BACK)?],
            ],
            counts: fit("tiles of splats", 4 * visible, READ_BACK | BufferUsages::COPY_DST)?,
            sums: fit("sums", 4 * visible.div_ceil(u64::from(WORKGROUP)), READ_BACK)?,
            entry_pairs: [
                [fit("tile lists", 4 * entries, READ_BACK)?, fit("tile lists", 4 * entries, READ_BACK)?],
                [fit("tile lists", 4 * entries, READ_BACK)?, fit("tile lists", 4 * entries, READ_BACK)?],
            ],
            histogram: fit("counts of digits", 4 * u64::from(DIGITS) * sort_blocks, READ_BACK)?,
            totals: fit("totals of digits", 4 * u64::from(DIGITS), READ_BACK)?,
            tile_offsets: fit("offsets of tile lists", 4 * (u64::from(extent.tiles) + 1), READ_BACK)?,
            rgb: fit("the picture", picture(true, 3), READ_BACK)?,
            alpha: fit("the picture's coverage", picture(true, 1), READ_BACK)?,
            depths: fit(
                "the picture's depths",
                picture(true, extent.planes),
                READ_BACK | BufferUsages::COPY_DST,
            )?,
            normal: fit("the picture's normals", picture(extent.normal, 3), READ_BACK)?,
            falling: fit(
                "what falls in the picture",
                picture(extent.particles != ParticleBlend::None, 4),
                WRITTEN,
            )?,
            apart: fit(
                "the picture of what falls",
                picture(extent.particles >= ParticleBlend::Separate, 4),
                READ_BACK,
            )?,
        })
    }
}
