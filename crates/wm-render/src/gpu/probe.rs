//! For tests: reads the GPU's buffers after a frame, and runs single stages.

use super::buffers::GrowingBuffer;
use super::device::Gpu;
use super::lists::listed;
use super::recorder::Recorder;
use super::renderer::GpuRenderer;
use super::source::{DIGITS, DISPATCH_ROW, SORT_BLOCK, WORKGROUP};
use super::uniforms::{Capacity, SLOT, ViewParameters, sort_pass};
use crate::frame::Frame;
use crate::plan::DrawPass;
use crate::renderer::RenderBackend;
use crate::stages::prefix_sum::gpu::{PrefixSumProgram, spine};
use crate::stages::project::Record;
use crate::stages::sort::gpu::{Sort, passes};
use wgpu::BufferUsages;

/// The results of the stages of one frame.
pub(crate) struct Probe {
    /// Records of the splats in view, in the order of the splats.
    pub(crate) records: Vec<Record>,
    /// For each tile, row by row, the records that touch it, front to back.
    pub(crate) lists: Vec<Vec<u32>>,
}

impl Probe {
    /// Renders `pass` and looks.
    pub(crate) fn of(renderer: &mut GpuRenderer, pass: &DrawPass<'_>) -> Self {
        let stats = renderer.render(pass, &mut Frame::default()).unwrap();
        let gpu = renderer.gpu().clone();
        let room = renderer.room().expect("a frame was drawn");
        let words = read(&gpu, &room.records);
        let numbers = words.as_chunks::<16>().0.iter().take(stats.visible as usize);
        let records = numbers.map(|words| Record::of(words.map(f32::from_bits))).collect();
        let offsets = read(&gpu, &room.tile_offsets);
        let tiles = ViewParameters::of(pass).tile_count();
        let names = read(&gpu, listed(room, tiles));
        let list = |ends: &[u32]| names[ends[0] as usize..ends[1] as usize].to_vec();
        Self { records, lists: offsets[..=tiles as usize].windows(2).map(list).collect() }
    }
}

/// All words of a buffer.
pub(crate) fn read(gpu: &Gpu, buffer: &wgpu::Buffer) -> Vec<u32> {
    let usage = BufferUsages::MAP_READ | BufferUsages::COPY_DST;
    let staging = GrowingBuffer::default().fit_unbound(gpu, "a look", buffer.size(), usage).unwrap();
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, buffer.size());
    gpu.queue.submit([encoder.finish()]);
    super::readback::wait(gpu, &staging, buffer.size()).unwrap();
    let view = staging.slice(..buffer.size()).get_mapped_range().unwrap();
    bytemuck::pod_collect_to_vec(&view)
}

/// Makes a buffer with the given words.
fn filled(gpu: &Gpu, words: &[u32], more: BufferUsages) -> wgpu::Buffer {
    let bytes: &[u8] = bytemuck::cast_slice(words);
    let usage = BufferUsages::COPY_DST | BufferUsages::COPY_SRC | more;
    let buffer = gpu.buffer("a test", bytes.len() as u64, usage).unwrap();
    gpu.queue.write_buffer(&buffer, 0, bytes);
    buffer
}

/// The prefix sums of counts, and their total; what would be sorted has that much room.
pub(crate) fn scanned(gpu: &Gpu, sums: &[u32], room: u32) -> (Vec<u32>, [u32; 2]) {
    let camera = crate::testing::camera(64, 48);
    let config = crate::renderer::RenderConfig::default();
    let pass = DrawPass::new(&[], &camera, &config);
    let view =
        super::uniforms::view(&ViewParameters::of(&pass), 0, 0, Capacity { visible: 0, entries: room });
    let mut slot = view.words;
    slot.resize(SLOT as usize / 4, 0);
    let uniforms = filled(gpu, &slot, BufferUsages::UNIFORM);
    let counters = filled(gpu, &[WORKGROUP * sums.len() as u32, 0, 0, 0, 0], BufferUsages::STORAGE);
    let dispatches = filled(gpu, &[0; 9], BufferUsages::STORAGE);
    let buffer = filled(gpu, sums, BufferUsages::STORAGE);
    let mut recorder = Recorder::new(gpu, &uniforms, None);
    recorder.begin(super::recorder::Stage::Intersect);
    spine(&mut recorder, PrefixSumProgram::Entries, &buffer, &counters, &dispatches);
    recorder.submit();
    gpu.check().unwrap();
    let counters = read(gpu, &counters);
    (read(gpu, &buffer)[..sums.len()].to_vec(), [counters[1], counters[3]])
}

/// Returns the pairs of `keys` and their indices, sorted by the lowest `bits` bits.
pub(crate) fn sorted(gpu: &Gpu, keys: &[u32], bits: u32) -> (Vec<u32>, Vec<u32>) {
    let buffer = |words: &[u32], more| filled(gpu, words, BufferUsages::STORAGE | more);
    let (count, none) = (keys.len() as u32, BufferUsages::empty());
    let blocks = count.div_ceil(SORT_BLOCK);
    let empty = vec![0; keys.len()];
    let pairs = [buffer(keys, none), buffer(&empty, none), buffer(&empty, none), buffer(&empty, none)];
    let dispatches =
        buffer(&[blocks.min(DISPATCH_ROW), blocks.div_ceil(DISPATCH_ROW), 1], BufferUsages::INDIRECT);
    let counters = buffer(&[count, 0, 0, 0, 0], none);
    let histogram = buffer(&vec![0; (DIGITS * blocks.max(1)) as usize], none);
    let totals = buffer(&[0; DIGITS as usize], none);
    let mut slots = vec![0u32; SLOT as usize];
    for (pass, slot) in slots.chunks_exact_mut(SLOT as usize / 4).enumerate() {
        let uniform = sort_pass(8 * pass as u32, false, pass == 0);
        slot[..uniform.words.len()].copy_from_slice(&uniform.words);
    }
    let uniforms = filled(gpu, bytemuck::cast_slice(&slots), BufferUsages::UNIFORM);
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
    recorder.submit();
    gpu.check().unwrap();
    let first = |buffer| read(gpu, buffer)[..count as usize].to_vec();
    (first(keys), first(values))
}
