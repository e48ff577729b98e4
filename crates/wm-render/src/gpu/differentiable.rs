//! The GPU back end of training: stored parameters to pictures, and from a loss's derivative by
//! these to gradients.
//!
//! | pass | stage | programs |
//! |---|---|---|
//! | project to intersect | as of a frame, from stored parameters | entries are pairs of splat and tile |
//! | rasterize | [`rasterize`](crate::stages::rasterize) | sums, which are kept |
//! | composite | [`composite`](crate::stages::composite) | pictures of the sums |
//! | back | [`rasterize_backward`](crate::stages::rasterize_backward) | by sums, by tiles: a slot a pair |
//! | gather | [`project_backward`](crate::stages::project_backward) | slots of a splat, in the order of its tiles |
//! | project back | the same, [`shade_backward`](crate::stages::shade_backward) | a thread per splat in view |
//!
//! No number is added by atomics, so gradients are the same, bit by bit, each time on one adapter.

use super::buffers::{BufferPool, Extent, GrowingBuffer, Memory, ParticleBlend, READ_BACK, Room};
use super::device::{Gpu, WRITTEN};
use super::error::GpuError;
use super::lists::{self, Entries, FIRST_PIECE_SLOT};
use super::readback::{Part, copy};
use super::recorder::{Clock, Recorder, Stage, Ticks};
use super::source::COUNTER_WORDS;
use super::stored::StoredModel;
use super::uniforms::{self, Capacity, ItemBytes, UNIFORM_SLOT_BYTES, ViewParameters, bytes_of};
use crate::config::CpuConfig;
use crate::cpu;
use crate::differentiable::{
    Channels, DepthAlpha, Differentiable, ForwardConfig, Resident, StepClock, Upstream,
};
use crate::error::RenderError;
use crate::frame::Frame;
use crate::gradients::{Gradients, Learn};
use crate::plan::Shading;
use crate::renderer::Stats;
use crate::simd::SimdPath;
use crate::stages::compare::gpu::{self as compare, Comparer, Pictures};
use crate::stages::compare::{Compared, Comparison};
use crate::stages::composite::gpu::finish;
use crate::stages::optimize::gpu::Rows;
use crate::stages::project_backward::gpu::{gather, project_backward};
use crate::stages::project_backward::rows;
use crate::stages::rasterize::gpu::{rasterize, sums_program};
use crate::stages::rasterize_backward::GradientSlot;
use crate::stages::rasterize_backward::gpu::{by_sums, rasterize_backward};
use std::sync::Arc;
use web_time::Instant;
use wm_scene::{Camera, Splats, sh};

/// Words of a slot.
const SLOT_WORDS: u64 = GradientSlot::LEN as u64;

/// The GPU back end of training. It keeps its working memory from step to step.
pub struct GpuDifferentiable {
    pub(super) gpu: Arc<Gpu>,
    /// Threads of the CPU's share of a step.
    path: SimdPath,
    pub(super) pool: Arc<rayon::ThreadPool>,
    pub(super) model: StoredModel,
    pub(super) memory: Memory,
    kept: BufferPool,
    pub(super) capacity: Capacity,
    comparer: Comparer,
    pub(super) clock: Option<Clock>,
    ticks: Ticks,
    pub(super) last: Option<View>,
    /// Rows of a step, for splats that stay on the GPU.
    pub(super) rows: StepRows,
}

/// The destination of the pictures of a forward pass.
pub(super) enum ForwardTarget<'a> {
    /// They come back.
    Read(&'a mut Frame),
    /// Pictures are compared on the GPU.
    Compared(&'a Comparison<'a>),
}

/// The last forward pass and its results on the GPU.
pub(super) struct View {
    pub(crate) camera: Camera,
    pub(crate) config: ForwardConfig,
    visible: u32,
    pub(crate) room: Room,
    own: OwnRoom,
    /// True if the derivative of the loss is on the GPU already.
    compared: bool,
}

/// The buffers of training beside the room of a frame.
struct OwnRoom {
    /// The record of each pair of splat and tile.
    names: wgpu::Buffer,
    rgb: wgpu::Buffer,
    depths: wgpu::Buffer,
    normal: wgpu::Buffer,
    /// See `upstream.wgsl`.
    upstream: wgpu::Buffer,
    states: wgpu::Buffer,
    slots: wgpu::Buffer,
    pulls: wgpu::Buffer,
    /// See `project_backward.wgsl`.
    gradients: wgpu::Buffer,
    by_sh: wgpu::Buffer,
}

/// Bytes of a splat in view and of an entry in the largest array over each.
fn item_bytes(config: &ForwardConfig) -> ItemBytes {
    let coefficients = 3 * sh::coefficients(config.sh_degree) as u64;
    let numbers = [SLOT_WORDS, u64::from(rows::ROW), coefficients];
    ItemBytes { visible: 4 * numbers.into_iter().fold(0, u64::max), entries: 4 * SLOT_WORDS }
}

impl GpuDifferentiable {
    /// Makes a back end on `gpu`; `host` has the settings of the CPU's share.
    ///
    /// # Errors
    /// [`RenderError`] if the processor lacks the SIMD path or threads cannot be started.
    pub fn new(gpu: Arc<Gpu>, host: CpuConfig) -> Result<Self, RenderError> {
        let (path, pool) = cpu::start(host)?;
        let clock = Clock::new(&gpu)?;
        Ok(Self {
            gpu,
            path,
            pool,
            model: StoredModel::default(),
            memory: Memory::default(),
            kept: BufferPool::default(),
            capacity: Capacity::default(),
            comparer: Comparer::default(),
            clock,
            ticks: Clock::ticks(),
            last: None,
            rows: StepRows::default(),
        })
    }

    /// The times of the last step by the GPU's clock: of backward passes and moves those before the
    /// last forward pass.
    pub(super) fn step_clock(&self) -> Option<StepClock> {
        let seconds = |stage| self.clock.as_ref().map_or(0.0, |clock| clock.seconds(&self.ticks, stage));
        let lists = [Stage::Project, Stage::Sort, Stage::Intersect];
        self.clock.as_ref().map(|_| StepClock {
            lists: lists.into_iter().map(seconds).sum(),
            rasterize: seconds(Stage::Rasterize) + seconds(Stage::Composite),
            compare: seconds(Stage::Compare),
            rasterize_backward: seconds(Stage::RasterizeBackward),
            project_backward: seconds(Stage::ProjectBackward),
            optimize: seconds(Stage::Optimize) + seconds(Stage::Explore),
        })
    }

    /// Reads back the derivative that the last comparison left: by colour `[H, W, 3]`, coverage
    /// `[H, W]`, depth `[H, W]` and normal `[H, W, 3]`, one after another. Steps have no need of
    /// it; tests look at it.
    ///
    /// # Errors
    /// [`RenderError`] if the device fails.
    ///
    /// # Panics
    /// If nothing was compared since splats were loaded.
    #[cfg(any(test, feature = "testing"))]
    pub fn upstream(&mut self) -> Result<Vec<f32>, RenderError> {
        let view = self.last.as_ref().filter(|view| view.compared).expect("a comparison");
        let mut found = vec![0.0f32; 8 * view.camera.width as usize * view.camera.height as usize];
        let recorder = Recorder::new(&self.gpu, &view.room.uniforms, None);
        let mut parts = [(&view.own.upstream, 0, bytemuck::cast_slice_mut(&mut found))];
        copy(&self.gpu, recorder, &mut self.memory.staging, &mut parts)?;
        Ok(found)
    }

    /// Forgets the last forward pass.
    pub(super) fn forget(&mut self) {
        self.last = None;
    }

    fn own_room(&mut self, camera: &Camera, config: &ForwardConfig) -> Result<OwnRoom, GpuError> {
        let (gpu, Capacity { visible, entries }) = (&self.gpu, self.capacity);
        let (visible, entries) = (u64::from(visible), u64::from(entries));
        let pixels = u64::from(camera.width) * u64::from(camera.height);
        let channels = config.channels;
        let picture = |there: bool, numbers: u64| if there { 4 * numbers * pixels } else { 0 };
        self.kept.restart();
        let mut fit = |what, bytes, usage| self.kept.fit(gpu, what, bytes, usage);
        let coefficients = 3 * sh::coefficients(config.sh_degree) as u64;
        Ok(OwnRoom {
            names: fit("tile lists", 4 * entries, READ_BACK)?,
            rgb: fit("the picture", picture(channels.has_color(), 3), READ_BACK)?,
            depths: fit("the picture's depths", picture(channels.depth().is_some(), 1), READ_BACK)?,
            normal: fit("the picture's normals", picture(channels.has_normal(), 3), READ_BACK)?,
            upstream: fit("the loss's derivative", picture(true, 8), READ_BACK | WRITTEN)?,
            states: fit("the loss's derivative", picture(true, 8), READ_BACK)?,
            slots: fit("what pixels pull", 4 * SLOT_WORDS * entries, READ_BACK)?,
            pulls: fit("what pixels pull on splats", 4 * SLOT_WORDS * visible, READ_BACK)?,
            gradients: fit("gradients", 4 * u64::from(rows::ROW) * visible, READ_BACK)?,
            by_sh: fit("gradients of colours", 4 * coefficients * visible, READ_BACK)?,
        })
    }

    /// Renders, and reads pictures back or compares them.
    pub(super) fn forward_on_pool(
        &mut self,
        camera: &Camera,
        config: &ForwardConfig,
        mut seen: ForwardTarget<'_>,
    ) -> Result<(Stats, Compared), RenderError> {
        let started = Instant::now();
        let gpu = Arc::clone(&self.gpu);
        self.forget();
        gpu.check()?;
        let (each, most) = (item_bytes(config), gpu.most_binding);
        self.capacity.start(self.model.len(), most, each);
        let sight = ViewParameters::of_training(camera, config);
        let channels = config.channels;
        let size = (camera.width, camera.height);
        loop {
            let pieces = self.model.uniforms(config);
            let compare = match &seen {
                ForwardTarget::Read(_) => None,
                ForwardTarget::Compared(wanted) => {
                    Some((*wanted, self.comparer.room(&gpu, wanted, size, sight.tile_count())?))
                }
            };
            let compare_slot = FIRST_PIECE_SLOT + pieces.len() + 2;
            let extent = Extent {
                // Two more follow, `Training` and `Learn`, and those of a comparison.
                slots: compare_slot + compare::STRUCTURE_COUNT,
                blocks: self.model.blocks(),
                capacity: self.capacity,
                tiles: sight.tile_count(),
                pixels: u64::from(size.0) * u64::from(size.1),
                planes: u64::from(channels.depth().is_some()),
                normal: channels.has_normal(),
                particles: ParticleBlend::None,
            };
            let room = self.memory.room(&gpu, &extent)?;
            let own = self.own_room(camera, config)?;
            let view = uniforms::view(&sight, self.model.blocks(), 0, self.capacity);
            let mut structures = lists::uniforms(view, Entries::Pairs(&own.names));
            structures.extend(pieces);
            structures.push(uniforms::training(config.background, DepthAlpha::Learns));
            structures.push(uniforms::learn(Learn::NONE));
            if let Some((wanted, room)) = &compare {
                structures.extend(room.structures(wanted));
            }
            gpu.write(&room.uniforms, 0, &bytes_of(&structures));

            let mut recorder =
                record_forward(&gpu, self.clock.as_ref(), &self.model, &room, &own, &sight, config);
            let mut counters = [0u32; COUNTER_WORDS as usize];
            let mut totals = compare::Room::totals();
            let mut parts: Vec<Part<'_>> =
                vec![(&room.lists.counters, 0, bytemuck::cast_slice_mut(&mut counters))];
            if let Some(clock) = &self.clock {
                parts.push((&clock.times, 0, bytemuck::cast_slice_mut(&mut self.ticks)));
            }
            if let ForwardTarget::Read(frame) = &mut seen {
                parts.extend::<[Part<'_>; 4]>([
                    (&own.rgb, 0, bytemuck::cast_slice_mut(&mut frame.rgb)),
                    (&room.alpha, 0, bytemuck::cast_slice_mut(&mut frame.alpha)),
                    (&own.depths, 0, bytemuck::cast_slice_mut(&mut frame.depth)),
                    (&own.normal, 0, bytemuck::cast_slice_mut(&mut frame.normal)),
                ]);
            }
            if let Some((_, compare)) = &compare {
                compare.record(&mut recorder, compare_slot, own.pictures(channels, &room));
                parts.push((&compare.totals, 0, bytemuck::cast_slice_mut(&mut totals)));
            }
            copy(&gpu, recorder, &mut self.memory.staging, &mut parts)?;
            let [_, _, visible, entries, _] = counters;
            if !self.capacity.grow(visible, entries, most, each) {
                let (camera, config) = (*camera, *config);
                let compared = compare.map(|(wanted, room)| room.compared(wanted, &totals));
                let is_compared = compared.is_some();
                self.last = Some(View { camera, config, visible, room, own, compared: is_compared });
                let stats = Stats {
                    visible: visible.into(),
                    intersections: entries.into(),
                    wall: started.elapsed().as_secs_f64(),
                    ..Stats::default()
                };
                return Ok((stats, compared.unwrap_or_default()));
            }
        }
    }

    fn backward_on_pool(
        &mut self,
        upstream: &Upstream<'_>,
        learn: Learn,
        gradients: &mut Gradients,
    ) -> Result<(), RenderError> {
        let Some(view) = &self.last else { unreachable!("a backward pass follows a forward pass") };
        self.gpu.check()?;
        let View { config, visible, own, .. } = view;
        let recorder =
            view.record_backward(&self.gpu, None, &self.model, upstream, &own.gradients, &own.by_sh);
        gradients.resize(*visible as usize, learn, config.sh_degree);
        let mut found = vec![0.0f32; *visible as usize * rows::ROW as usize];
        let mut parts: [Part<'_>; 2] = [
            (&own.gradients, 0, bytemuck::cast_slice_mut(&mut found)),
            (&own.by_sh, 0, bytemuck::cast_slice_mut(&mut gradients.sh)),
        ];
        copy(&self.gpu, recorder, &mut self.memory.staging, &mut parts)?;
        for (row, numbers) in found.as_chunks::<{ rows::ROW as usize }>().0.iter().enumerate() {
            write_row(gradients, row, numbers);
        }
        Ok(())
    }
}

impl OwnRoom {
    /// The pictures to compare.
    fn pictures<'a>(&'a self, channels: Channels, room: &'a Room) -> Pictures<'a> {
        let Self { rgb, depths, normal, upstream, .. } = self;
        Pictures { channels, rgb, alpha: &room.alpha, depths, normal, upstream }
    }
}

impl View {
    /// Bytes of rows of gradients, and of those of colours.
    pub(crate) fn row_bytes(&self, capacity: Capacity) -> (u64, u64) {
        let coefficients = 3 * sh::coefficients(self.config.sh_degree) as u64;
        let visible = 4 * u64::from(capacity.visible);
        (u64::from(rows::ROW) * visible, coefficients * visible)
    }

    /// The rows of gradients that go with it.
    pub(crate) fn rows(&self) -> Rows<'_> {
        Rows { gradients: &self.own.gradients, by_sh: &self.own.by_sh, blocks: &self.room.lists.blocks }
    }

    /// Records the commands of a backward pass, which writes rows of gradients to `gradients` and
    /// `of_colors`; nothing is read back.
    pub(crate) fn record_backward<'a>(
        &'a self,
        gpu: &'a Gpu,
        clock: Option<&'a Clock>,
        model: &'a StoredModel,
        upstream: &Upstream<'_>,
        gradients: &'a wgpu::Buffer,
        of_colors: &'a wgpu::Buffer,
    ) -> Recorder<'a> {
        let Self { camera, config, room, own, compared, .. } = self;
        let channels = config.channels;
        let sight = ViewParameters::of_training(camera, config);
        let (pixels, tiles) = (camera.width * camera.height, sight.tile_count());
        let mut recorder = Recorder::new(gpu, &room.uniforms, clock);
        let pieces = model.pieces(&recorder, FIRST_PIECE_SLOT);
        let slot = FIRST_PIECE_SLOT + pieces.len();
        let training = uniforms::training(config.background, upstream.depth_alpha);
        gpu.write(&room.uniforms, UNIFORM_SLOT_BYTES * slot as u64, &bytes_of(&[training]));
        let mut at = 0;
        for (array, numbers) in
            [(upstream.rgb, 3), (upstream.alpha, 1), (upstream.depth, 1), (upstream.normal, 3)]
        {
            let bytes = 4 * numbers * u64::from(pixels);
            if !array.is_empty() {
                assert!(!compared, "pictures were compared on the device");
                gpu.write(&own.upstream, at, bytemuck::cast_slice(array));
            } else if !compared {
                recorder.encoder().clear_buffer(&own.upstream, at, Some(bytes));
            }
            at += bytes;
        }
        recorder.begin(Stage::RasterizeBackward);
        let training = recorder.uniform(slot);
        by_sums(&mut recorder, pixels, channels, training, room, &own.upstream, &own.states);
        let OwnRoom { names, states, slots, pulls, .. } = own;
        let pairs = lists::listed(room, tiles);
        rasterize_backward(&mut recorder, tiles, channels, room, pairs, names, states, slots);
        recorder.begin(Stage::ProjectBackward);
        gather(&mut recorder, &room.lists, lists::order(room), slots, pulls);
        let rows = Rows { gradients, by_sh: of_colors, blocks: &room.lists.blocks };
        pieces.iter().for_each(|piece| project_backward(&mut recorder, piece, channels, room, pulls, rows));
        recorder
    }
}

/// Records the commands of a forward pass; nothing is read back.
fn record_forward<'a>(
    gpu: &'a Gpu,
    clock: Option<&'a Clock>,
    model: &'a StoredModel,
    room: &'a Room,
    own: &'a OwnRoom,
    sight: &ViewParameters<'_>,
    config: &ForwardConfig,
) -> Recorder<'a> {
    let mut recorder = Recorder::new(gpu, &room.uniforms, clock);
    recorder.encoder().clear_buffer(&room.lists.counters, 0, None);
    let pieces = model.pieces(&recorder, FIRST_PIECE_SLOT);
    lists::front(&mut recorder, room, &pieces, Shading::Color, None);
    let tiles = sight.tile_count();
    let (_, pairs) = lists::lists(&mut recorder, room, tiles, Entries::Pairs(&own.names));
    recorder.begin(Stage::Rasterize);
    rasterize(&mut recorder, tiles, sums_program(config.channels), room, pairs, &own.names);
    recorder.begin(Stage::Composite);
    let pixels = sight.camera.width * sight.camera.height;
    let training = recorder.uniform(FIRST_PIECE_SLOT + pieces.len());
    let pictures = [&own.rgb, &own.depths, &own.normal];
    finish(&mut recorder, pixels, config.channels, training, room, pictures);
    recorder
}

/// Returns `N` numbers of a row from `first` on.
fn numbers<const N: usize>(row: &[f32; rows::ROW as usize], first: u32) -> [f32; N] {
    std::array::from_fn(|k| row[first as usize + k])
}

/// Writes one row of gradients, for the parameters that learn.
fn write_row(to: &mut Gradients, row: usize, from: &[f32; rows::ROW as usize]) {
    fn set<T>(array: &mut [T], row: usize, value: T) {
        if let Some(place) = array.get_mut(row) {
            *place = value;
        }
    }
    to.visible[row] = from[rows::INDEX as usize].to_bits();
    set(&mut to.means, row, numbers(from, rows::MEAN));
    set(&mut to.quats, row, numbers(from, rows::QUAT));
    set(&mut to.log_scales, row, numbers(from, rows::SCALE));
    set(&mut to.logit_opacities, row, from[rows::OPACITY as usize]);
    to.means2d[row] = numbers(from, rows::MEAN2D);
    to.absgrads[row] = numbers(from, rows::ABSGRAD);
    to.weights[row] = from[rows::WEIGHT as usize];
    to.radii[row] = from[rows::RADIUS as usize];
}

impl Differentiable for GpuDifferentiable {
    fn describe(&self) -> String {
        self.gpu.describe()
    }

    fn path(&self) -> SimdPath {
        self.path
    }

    fn pool(&self) -> &Arc<rayon::ThreadPool> {
        &self.pool
    }

    fn forward(
        &mut self,
        splats: &Splats,
        camera: &Camera,
        config: &ForwardConfig,
        frame: &mut Frame,
    ) -> Result<Stats, RenderError> {
        config.check(splats, camera, frame)?;
        let (pool, gpu) = (Arc::clone(&self.pool), Arc::clone(&self.gpu));
        pool.install(|| {
            gpu.check()?;
            self.model.write(&gpu, splats)?;
            self.forward_on_pool(camera, config, ForwardTarget::Read(frame)).map(|(stats, _)| stats)
        })
    }

    fn backward(
        &mut self,
        splats: &Splats,
        upstream: &Upstream<'_>,
        learn: Learn,
        gradients: &mut Gradients,
    ) -> Result<(), RenderError> {
        let view = self.last.as_ref().expect("a backward pass follows a forward pass");
        assert_eq!(self.model.len(), splats.len(), "the splats are not those of the forward pass");
        upstream.check(view.camera.width as usize * view.camera.height as usize, view.config.channels);
        let learn = view.config.learns(learn);
        let pool = Arc::clone(&self.pool);
        pool.install(|| self.backward_on_pool(upstream, learn, gradients))
    }

    fn resident(&mut self) -> Option<&mut dyn Resident> {
        Some(self)
    }
}

/// The gradients of the step under way, beside which other renders are derived.
#[derive(Default)]
pub(crate) struct StepRows {
    pub(super) kept: [GrowingBuffer; 3],
    pub(super) uniforms: GrowingBuffer,
    pub(super) last: Option<Last>,
}

pub(super) struct Last {
    pub(super) config: ForwardConfig,
    pub(super) gradients: wgpu::Buffer,
    pub(super) by_sh: wgpu::Buffer,
    /// The splats that the step had in view.
    pub(super) blocks: wgpu::Buffer,
}

impl Last {
    pub(super) fn rows(&self) -> Rows<'_> {
        Rows { gradients: &self.gradients, by_sh: &self.by_sh, blocks: &self.blocks }
    }
}
