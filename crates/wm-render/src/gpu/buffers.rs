//! The GPU's working memory: buffers that grow and are kept.

use super::device::{Gpu, WRITTEN};
use super::error::GpuError;
use super::source::{BLOCK_WORDS, COUNTER_WORDS, DIGITS, DISPATCH_WORDS, SORT_BLOCK, WORKGROUP};
use super::uniforms::{Capacity, UNIFORM_SLOT_BYTES, Uniform, bytes_of};
use wgpu::BufferUsages;

pub(crate) const READ_BACK: BufferUsages = BufferUsages::STORAGE.union(BufferUsages::COPY_SRC);
pub(crate) const STRUCTURES: BufferUsages = BufferUsages::UNIFORM.union(BufferUsages::COPY_DST);

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

    /// Returns the buffer with structures, one per slot.
    pub(crate) fn structures(&mut self, gpu: &Gpu, all: &[Uniform]) -> Result<wgpu::Buffer, GpuError> {
        let buffer =
            self.fit_unbound(gpu, "structures", UNIFORM_SLOT_BYTES * all.len() as u64, STRUCTURES)?;
        gpu.write(&buffer, 0, &bytes_of(all));
        Ok(buffer)
    }

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

/// The buffers by which splats find the lists that they are in: those of tiles, or of packets of
/// rays.
pub(crate) struct Lists {
    pub(crate) counters: wgpu::Buffer,
    pub(crate) dispatches: wgpu::Buffer,
    /// `Block` of `geometry.wgsl`.
    pub(crate) blocks: wgpu::Buffer,
    /// Depths and names of the splats in view, twice.
    pub(crate) depth_pairs: [[wgpu::Buffer; 2]; 2],
    pub(crate) counts: wgpu::Buffer,
    pub(crate) sums: wgpu::Buffer,
    /// Lists and names of the entries, twice.
    pub(crate) entry_pairs: [[wgpu::Buffer; 2]; 2],
    pub(crate) histogram: wgpu::Buffer,
    pub(crate) totals: wgpu::Buffer,
    pub(crate) offsets: wgpu::Buffer,
}

/// The names of some buffers of [`Lists`], for errors.
pub(crate) struct ListNames {
    /// The depths, one name for each half of the pairs.
    pub(crate) depths: [&'static str; 2],
    pub(crate) counts: &'static str,
    pub(crate) entries: &'static str,
    pub(crate) offsets: &'static str,
}

impl Lists {
    /// Makes room for `count` lists of splats in so many blocks.
    pub(crate) fn fit(
        gpu: &Gpu,
        kept: &mut BufferPool,
        names: &ListNames,
        blocks: u32,
        capacity: Capacity,
        count: u32,
    ) -> Result<Self, GpuError> {
        let (visible, entries) = (u64::from(capacity.visible), u64::from(capacity.entries));
        let (digits, block_words) = (u64::from(DIGITS), u64::from(BLOCK_WORDS) * u64::from(blocks));
        let sort_blocks = visible.max(entries).div_ceil(u64::from(SORT_BLOCK));
        let mut fit = |what: &'static str, words: u64, more| kept.fit(gpu, what, 4 * words, READ_BACK | more);
        let none = BufferUsages::empty();
        Ok(Self {
            counters: fit("counters", COUNTER_WORDS, BufferUsages::COPY_DST)?,
            dispatches: fit("dispatch sizes", DISPATCH_WORDS, BufferUsages::INDIRECT)?,
            blocks: fit("blocks of splats", block_words, none)?,
            depth_pairs: [
                [fit(names.depths[0], visible, none)?, fit(names.depths[1], visible, none)?],
                [fit(names.depths[0], visible, none)?, fit(names.depths[1], visible, none)?],
            ],
            counts: fit(names.counts, visible, BufferUsages::COPY_DST)?,
            sums: fit("sums", visible.div_ceil(u64::from(WORKGROUP)), none)?,
            entry_pairs: [
                [fit(names.entries, entries, none)?, fit(names.entries, entries, none)?],
                [fit(names.entries, entries, none)?, fit(names.entries, entries, none)?],
            ],
            histogram: fit("counts of digits", digits * sort_blocks, none)?,
            totals: fit("totals of digits", digits, none)?,
            offsets: fit(names.offsets, u64::from(count) + 1, none)?,
        })
    }
}

/// Room for a frame: handles to the kept buffers.
pub(crate) struct Room {
    /// Structures, one per slot.
    pub(crate) uniforms: wgpu::Buffer,
    pub(crate) records: wgpu::Buffer,
    pub(crate) lists: Lists,
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
    kept: BufferPool,
    /// Each of these holds numbers for one pass, or for one set of one pass.
    pub(crate) attributes: BufferPool,
    pub(crate) air: BufferPool,
    pub(crate) drops: BufferPool,
    pub(crate) backgrounds: BufferPool,
    pub(crate) staging: GrowingBuffer,
}

/// Buffers that are handed out one after the other, in the same order each time.
#[derive(Default)]
pub(crate) struct BufferPool {
    buffers: Vec<GrowingBuffer>,
    used: usize,
}

impl BufferPool {
    /// Starts with the first buffer again, when nothing reads what they hold any more.
    pub(crate) fn restart(&mut self) {
        self.used = 0;
    }

    fn next(&mut self) -> &mut GrowingBuffer {
        if self.used == self.buffers.len() {
            self.buffers.push(GrowingBuffer::default());
        }
        self.used += 1;
        &mut self.buffers[self.used - 1]
    }

    /// Returns the next buffer with at least `bytes` bytes.
    pub(crate) fn fit(
        &mut self,
        gpu: &Gpu,
        what: &'static str,
        bytes: u64,
        usage: BufferUsages,
    ) -> Result<wgpu::Buffer, GpuError> {
        self.next().fit(gpu, what, bytes, usage)
    }

    /// Returns the next buffer with `numbers` at its beginning.
    pub(crate) fn write(
        &mut self,
        gpu: &Gpu,
        what: &'static str,
        numbers: &[f32],
    ) -> Result<wgpu::Buffer, GpuError> {
        self.next().write(gpu, what, numbers, WRITTEN)
    }
}

impl Memory {
    /// Starts with the first buffers of numbers again.
    pub(crate) fn start_batch(&mut self) {
        for pool in [&mut self.attributes, &mut self.air, &mut self.drops, &mut self.backgrounds] {
            pool.restart();
        }
    }

    /// Room for a frame of this extent.
    pub(crate) fn room(&mut self, gpu: &Gpu, extent: &Extent) -> Result<Room, GpuError> {
        const NAMES: ListNames = ListNames {
            depths: ["depths", "the order by depth"],
            counts: "tiles of splats",
            entries: "tile lists",
            offsets: "offsets of tile lists",
        };
        let &Extent { slots, blocks, capacity, tiles, pixels, planes, normal, particles } = extent;
        let kept = &mut self.kept;
        kept.restart();
        let uniforms = kept.fit(gpu, "structures", UNIFORM_SLOT_BYTES * slots as u64, STRUCTURES)?;
        let records = kept.fit(gpu, "the splats in view", 64 * u64::from(capacity.visible), READ_BACK)?;
        let lists = Lists::fit(gpu, kept, &NAMES, blocks, capacity, tiles)?;
        let mut fit = |what, channels, usage| kept.fit(gpu, what, 4 * channels * pixels, usage);
        let falling = if particles == ParticleBlend::None { 0 } else { 4 };
        let apart = if particles >= ParticleBlend::Separate { 4 } else { 0 };
        Ok(Room {
            uniforms,
            records,
            lists,
            rgb: fit("the picture", 3, READ_BACK)?,
            alpha: fit("the picture's coverage", 1, READ_BACK)?,
            depths: fit("the picture's depths", planes, READ_BACK | BufferUsages::COPY_DST)?,
            normal: fit("the picture's normals", 3 * u64::from(normal), READ_BACK)?,
            falling: fit("what falls in the picture", falling, WRITTEN)?,
            apart: fit("the picture of what falls", apart, READ_BACK)?,
        })
    }
}

/// The pictures that particles are drawn into.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) enum ParticleBlend {
    /// There are none.
    #[default]
    None,
    /// Over the colour.
    InColor,
    /// Over the colour, and into a picture of their own.
    Separate,
    /// Into a picture of their own alone.
    Apart,
}

/// A part of a buffer: buffer, offset and size, bytes.
pub(crate) type Source<'a> = (&'a wgpu::Buffer, u64, u64);
