//! For tests: reads the GPU's buffers after a frame, and runs single stages.

use super::buffers::{BufferPool, GrowingBuffer, ListNames, Lists};
use super::device::Gpu;
use super::lists::listed;
use super::readback::copy;
use super::recorder::{Recorder, Stage};
use super::source::{DISPATCH_ROW, SORT_BLOCK, WORKGROUP};
use super::uniforms::{Capacity, Uniform, ViewParameters, bytes_of, sort_pass, view};
use crate::config::RenderConfig;
use crate::frame::Frame;
use crate::plan::{DrawPass, SetView};
use crate::renderer::RenderBackend;
use crate::stages::prefix_sum::gpu::{SPINE_ENTRIES, spine};
use crate::stages::project::Record;
use crate::stages::sort::gpu::{passes, sort};
use crate::testing::gpu_renderer;
use wgpu::BufferUsages;
use wm_scene::{Camera, Splats};

/// The results of the stages of one frame.
pub(crate) struct Probe {
    /// Records of the splats in view, in the order of the splats.
    pub(crate) records: Vec<Record>,
    /// For each tile, row by row, the records that touch it, front to back.
    pub(crate) lists: Vec<Vec<u32>>,
}

impl Probe {
    /// Renders splats and reads back the results of the stages.
    pub(crate) fn of(splats: &Splats, camera: &Camera, config: &RenderConfig) -> Self {
        let mut renderer = gpu_renderer();
        let pass = DrawPass::new(&[SetView::transient(splats)], camera, config);
        let stats = renderer.render(&pass, &mut Frame::default()).unwrap();
        let gpu = renderer.gpu.clone();
        let room = renderer.room().expect("a frame was drawn");
        let words = read(&gpu, &room.records);
        let numbers = words.as_chunks::<16>().0.iter().take(stats.visible as usize);
        let records = numbers.map(|words| Record::of(words.map(f32::from_bits))).collect();
        let offsets = read(&gpu, &room.lists.offsets);
        let tiles = ViewParameters::of(&pass).tile_count();
        let names = read(&gpu, listed(room, tiles));
        let list = |ends: &[u32]| names[ends[0] as usize..ends[1] as usize].to_vec();
        Self { records, lists: offsets[..=tiles as usize].windows(2).map(list).collect() }
    }
}

/// All words of a buffer.
pub(crate) fn read(gpu: &Gpu, buffer: &wgpu::Buffer) -> Vec<u32> {
    let mut words = vec![0; buffer.size() as usize / 4];
    let mut parts = [(buffer, 0, bytemuck::cast_slice_mut(&mut words[..]))];
    copy(gpu, Recorder::new(gpu, buffer, None), &mut GrowingBuffer::default(), &mut parts).unwrap();
    words
}

fn words(words: &[u32]) -> Vec<u8> {
    bytemuck::cast_slice(words).to_vec()
}

/// Makes a buffer with the given bytes.
fn filled(gpu: &Gpu, bytes: &[u8], more: BufferUsages) -> wgpu::Buffer {
    let usage = BufferUsages::COPY_DST | BufferUsages::COPY_SRC | more;
    let buffer = gpu.buffer("a test", bytes.len() as u64, usage).unwrap();
    gpu.queue.write_buffer(&buffer, 0, bytes);
    buffer
}

/// Room for lists of so many items.
fn lists(gpu: &Gpu, items: u32) -> Lists {
    const NAMES: ListNames =
        ListNames { depths: ["a test"; 2], counts: "a test", entries: "a test", offsets: "a test" };
    let capacity = Capacity { visible: items, entries: items };
    Lists::fit(gpu, &mut BufferPool::default(), &NAMES, 1, capacity, 1).unwrap()
}

/// The prefix sums of counts, and their total; what would be sorted has that much room.
pub(crate) fn scanned(gpu: &Gpu, sums: &[u32], room: u32) -> (Vec<u32>, [u32; 2]) {
    let camera = crate::testing::camera(64, 48);
    let config = RenderConfig::default();
    let pass = DrawPass::new(&[], &camera, &config);
    let view = view(&ViewParameters::of(&pass), 0, 0, Capacity { visible: 0, entries: room });
    let uniforms = filled(gpu, &bytes_of(&[view]), BufferUsages::UNIFORM);
    let counters = filled(gpu, &words(&[WORKGROUP * sums.len() as u32, 0, 0, 0, 0]), BufferUsages::STORAGE);
    let lists = Lists { counters, ..lists(gpu, 1) };
    let buffer = filled(gpu, &words(sums), BufferUsages::STORAGE);
    let mut recorder = Recorder::new(gpu, &uniforms, None);
    recorder.begin(Stage::Intersect);
    spine(&mut recorder, SPINE_ENTRIES, &lists, &buffer);
    recorder.submit();
    gpu.check().unwrap();
    let counters = read(gpu, &lists.counters);
    (read(gpu, &buffer)[..sums.len()].to_vec(), [counters[1], counters[3]])
}

/// Returns the pairs of `keys` and their indices, sorted by the lowest `bits` bits.
pub(crate) fn sorted(gpu: &Gpu, keys: &[u32], bits: u32) -> (Vec<u32>, Vec<u32>) {
    let count = keys.len() as u32;
    let blocks = count.div_ceil(SORT_BLOCK);
    let sizes = [blocks.min(DISPATCH_ROW), blocks.div_ceil(DISPATCH_ROW), 1];
    let lists = Lists {
        counters: filled(gpu, &words(&[count, 0, 0, 0, 0]), BufferUsages::STORAGE),
        dispatches: filled(gpu, &words(&sizes), BufferUsages::STORAGE | BufferUsages::INDIRECT),
        ..lists(gpu, count)
    };
    let from = filled(gpu, &words(keys), BufferUsages::STORAGE);
    let pairs = [[from, lists.depth_pairs[0][1].clone()], lists.depth_pairs[1].clone()];
    let passes = passes(bits);
    let structures: Vec<Uniform> = (0..passes).map(|pass| sort_pass(8 * pass, false, pass == 0)).collect();
    let uniforms = filled(gpu, &bytes_of(&structures), BufferUsages::UNIFORM);
    let mut recorder = Recorder::new(gpu, &uniforms, None);
    recorder.begin(Stage::Sort);
    let (keys, values) = sort(&mut recorder, &lists, &pairs, 0, 0..passes as usize);
    recorder.submit();
    gpu.check().unwrap();
    let first = |buffer| read(gpu, buffer)[..count as usize].to_vec();
    (first(keys), first(values))
}
