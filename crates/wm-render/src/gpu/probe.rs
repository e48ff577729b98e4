//! For tests: what lies in the GPU's buffers after a frame, and stages by themselves.

use super::buffers::Growing;
use super::device::Gpu;
use super::recorder::Recorder;
use super::renderer::GpuRenderer;
use super::uniforms::{SLOT, sort_pass};
use crate::frame::Frame;
use crate::renderer::{Job, Renderer};
use crate::stages::project::Record;
use crate::stages::sort::gpu::{Sort, passes};
use wgpu::BufferUsages;

/// What the stages of one frame made.
pub struct Probe {
    /// Of the splats in view, in the order of the splats.
    pub records: Vec<Record>,
    /// For each tile, row by row, the records that touch it, front to back.
    pub lists: Vec<Vec<u32>>,
}

impl Probe {
    /// Renders `job` and looks.
    pub fn of(renderer: &mut GpuRenderer, job: &Job<'_>) -> Self {
        let stats = renderer.render(job, &mut Frame::default()).unwrap();
        let gpu = renderer.gpu().clone();
        let room = renderer.room().expect("a frame was drawn");
        let words = read(&gpu, &room.records);
        let numbers = words.as_chunks::<16>().0.iter().take(stats.visible as usize);
        let records = numbers.map(|words| Record::of(words.map(f32::from_bits))).collect();
        let offsets = read(&gpu, &room.tile_offsets);
        let (columns, rows) = super::uniforms::tiles(job);
        let tiles = (columns * rows) as usize;
        let passes = passes(u32::BITS - (columns * rows).leading_zeros()) as usize;
        let names = read(&gpu, &room.entry_pairs[passes % 2][1]);
        let list = |ends: &[u32]| names[ends[0] as usize..ends[1] as usize].to_vec();
        Self { records, lists: offsets[..=tiles].windows(2).map(list).collect() }
    }
}

/// All words of a buffer.
pub fn read(gpu: &Gpu, buffer: &wgpu::Buffer) -> Vec<u32> {
    let usage = BufferUsages::MAP_READ | BufferUsages::COPY_DST;
    let staging = Growing::default().fit_unbound(gpu, "a look", buffer.size(), usage).unwrap();
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, buffer.size());
    gpu.queue.submit([encoder.finish()]);
    super::readback::wait(gpu, &staging, buffer.size()).unwrap();
    let view = staging.slice(..buffer.size()).get_mapped_range().unwrap();
    bytemuck::pod_collect_to_vec(&view)
}

/// The pairs of `keys` and their indices, sorted by the lowest `bits` bits.
pub fn sorted(gpu: &Gpu, keys: &[u32], bits: u32) -> (Vec<u32>, Vec<u32>) {
    use super::source::{DIGITS, DISPATCH_ROW, SORT_BLOCK};
    let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
    let buffer = |words: &[u32], more: BufferUsages| {
        let bytes: &[u8] = bytemuck::cast_slice(words);
        let buffer = gpu.buffer("a test", bytes.len() as u64, usage | more).unwrap();
        gpu.queue.write_buffer(&buffer, 0, bytes);
        buffer
    };
    let (count, none) = (keys.len() as u32, BufferUsages::empty());
    let blocks = count.div_ceil(SORT_BLOCK);
    let empty = vec![0; keys.len()];
    let pairs = [buffer(keys, none), buffer(&empty, none), buffer(&empty, none), buffer(&empty, none)];
    let dispatches =
        buffer(&[blocks.min(DISPATCH_ROW), blocks.div_ceil(DISPATCH_ROW), 1], BufferUsages::INDIRECT);
    let counters = buffer(&[count, 0, 0, 0, 0], none);
    let histogram = buffer(&vec![0; (DIGITS * blocks.max(1)) as usize], none);
    let totals = buffer(&[0; DIGITS as usize], none);
    let mut slots = vec![0; 4 * SLOT as usize];
    for (pass, slot) in slots.chunks_exact_mut(SLOT as usize).enumerate() {
        let uniform = sort_pass(8 * pass as u32, false, pass == 0);
        slot[..4 * uniform.words.len()].copy_from_slice(bytemuck::cast_slice(&uniform.words));
    }
    let uniforms =
        gpu.buffer("a test", slots.len() as u64, BufferUsages::UNIFORM | BufferUsages::COPY_DST).unwrap();
    gpu.queue.write_buffer(&uniforms, 0, &slots);

    let mut recorder = Recorder::new(gpu, &uniforms, None);
    recorder.begin(super::recorder::Stage::Sort);
    let sort = Sort {
        pairs: [(&pairs[0], &pairs[1]), (&pairs[2], &pairs[3])],
        counters: &counters,
        dispatches: &dispatches,
        size: 0,
        histogram: &histogram,
        totals: &totals,
    };
    let (keys, values) = sort.record(&mut recorder, 0..passes(bits) as usize);
    gpu.queue.submit([recorder.finish()]);
    gpu.check().unwrap();
    let first = |buffer| read(gpu, buffer)[..count as usize].to_vec();
    (first(keys), first(values))
}
