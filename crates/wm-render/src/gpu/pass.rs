//! One draw pass on the GPU: its structures, its buffers, and its commands stage by stage.

use super::buffers::{Extent, Memory, ParticleBlend, Room, Source};
use super::device::Gpu;
use super::error::GpuError;
use super::hosted;
use super::lists::{self, Entries, FIRST_PIECE_SLOT};
use super::model::GpuModel;
use super::recorder::{Recorder, Stage};
use super::source::{BLOCK_WORDS, WORKGROUP};
use super::uniforms::{self, Capacity, Uniform, ViewParameters};
use crate::attributes::SplatAttributes;
use crate::config::{Geometry, MedianDepth};
use crate::cpu::{self, Features};
use crate::differentiable::Opacity;
use crate::error::RenderError;
use crate::frame::{Arrays, FRONT_CHANNELS, Frame, splat_name};
use crate::hooks::{ParticleView, WgslSource};
use crate::plan::DrawPass;
use crate::renderer::{Models, WEIGHT_UNITS};
use crate::simd::SimdPath;
use crate::stages::composite::background::BackgroundView;
use crate::stages::composite::gpu::{BackgroundForm, composite};
use crate::stages::particles::cpu::Falling;
use crate::stages::particles::gpu::fall;
use crate::stages::project::gpu::Piece;
use crate::stages::rasterize::gpu::{SURFACE_PLANE, frame_program, rasterize, weigh};

/// The name of backgrounds, for errors.
const BACKGROUND: &str = "the background";

/// A draw pass with its inputs in the GPU's memory.
pub(crate) struct GpuPass<'a> {
    pass: &'a DrawPass<'a>,
    /// The sets, each with the attributes of its splats.
    sets: Vec<(&'a GpuModel, wgpu::Buffer, Option<&'a dyn SplatAttributes>)>,
    features: Features,
    pub(crate) arrays: Arrays,
    air: Option<(WgslSource, wgpu::Buffer)>,
    backdrop: BackgroundView<'a>,
    background: (BackgroundForm, wgpu::Buffer),
    particles: ParticleBlend,
    /// The particles in view, and how many; `None` until [`Self::host`] has found them.
    drops: Option<(wgpu::Buffer, u32)>,
    /// The first slot of the pass among those of all passes that are submitted together.
    pub(crate) first_slot: usize,
}

impl<'a> GpuPass<'a> {
    /// Uploads the inputs of a pass that are known before it is drawn. `transient` has the models
    /// of its transient splats, one entry a set.
    pub(crate) fn new(
        gpu: &Gpu,
        memory: &mut Memory,
        path: SimdPath,
        models: &'a Models<GpuModel>,
        pass: &'a DrawPass<'a>,
        transient: &'a [Option<GpuModel>],
        first_slot: usize,
    ) -> Result<Self, RenderError> {
        let mut sets = Vec::with_capacity(pass.sets.len());
        for (view, own) in pass.sets.iter().zip(transient) {
            let model = models.drawn(view, own.as_ref())?;
            let numbers = || match view.attributes {
                Some(attributes) => hosted::attributes(attributes, &model.source),
                None => Vec::new(),
            };
            let revision = view.attributes.and_then(SplatAttributes::revision);
            let kept = match revision {
                Some(revision) => model.kept_attributes(gpu, revision, numbers)?,
                None => None,
            };
            let buffer = match kept {
                Some(buffer) => buffer,
                None => memory.attributes.write(gpu, "attributes of splats", &numbers())?,
            };
            sets.push((model, buffer, view.attributes));
        }
        let air = match pass.hooks.medium {
            None => None,
            Some(medium) => {
                let origin = pass.camera.center().to_array().map(|v| v as f32);
                let source = medium.wgsl(origin).ok_or(GpuError::Effect(medium.name()))?;
                let buffer = memory.air.write(gpu, "the air", &source.parameters)?;
                Some((source, buffer))
            }
        };
        let arrays = cpu::arrays(pass);
        let backdrop = BackgroundView::of(pass, path);
        let (width, height) = (pass.camera.width, pass.camera.height);
        let form = hosted::background_form(&backdrop);
        let numbers = match form {
            // The picture is painted later, while the GPU draws splats.
            BackgroundForm::Picture => Vec::new(),
            form => hosted::background(&backdrop, form, width, height),
        };
        let buffer = memory.backgrounds.write(gpu, BACKGROUND, &numbers)?;
        Ok(Self {
            pass,
            sets,
            features: Features::of(pass),
            arrays,
            air,
            backdrop,
            background: (form, buffer),
            particles: match (pass.particles().is_empty(), arrays.particles) {
                _ if pass.surface.is_some() && arrays.particles => ParticleBlend::Apart,
                _ if pass.surface.is_some() => ParticleBlend::None,
                (true, false) => ParticleBlend::None,
                (false, false) => ParticleBlend::InColor,
                (_, true) => ParticleBlend::Separate,
            },
            drops: None,
            first_slot,
        })
    }

    /// Replaces the model's indices of splats with those of the loaded set, if the pass renders
    /// splat indices instead of depths.
    pub(crate) fn name_splats(&self, frame: &mut Frame) {
        if self.pass.config.outputs.median_depth != MedianDepth::Splat {
            return;
        }
        let Some((model, ..)) = self.sets.first() else { return };
        for pixel in 0..frame.median_depth.len() {
            if let Some(&index) = frame.median_splat(pixel).and_then(|slot| model.source.get(slot as usize)) {
                frame.median_depth[pixel] = splat_name(index);
            }
        }
    }

    /// Splats in all sets.
    pub(crate) fn splats(&self) -> usize {
        self.sets.iter().map(|(model, ..)| model.source.len()).sum()
    }

    /// Returns true if the CPU gathers particles or paints a background for the pass, which takes
    /// about as long as the GPU takes for the splats.
    pub(crate) fn is_hosted(&self) -> bool {
        self.background.0 == BackgroundForm::Picture || !self.pass.particles().is_empty()
    }

    /// Gathers particles and paints the background on the CPU, and uploads them; returns the
    /// seconds that particles took.
    pub(crate) fn host(
        &mut self,
        gpu: &Gpu,
        memory: &mut Memory,
        path: SimdPath,
        falling: &mut Falling,
    ) -> Result<f64, RenderError> {
        let camera = &self.pass.camera;
        if self.background.0 == BackgroundForm::Picture {
            let (form, width, height) = (BackgroundForm::Picture, camera.width, camera.height);
            let picture = hosted::background(&self.backdrop, form, width, height);
            self.background.1 = memory.backgrounds.write(gpu, BACKGROUND, &picture)?;
        }
        if self.pass.particles().is_empty() {
            return Ok(0.0);
        }
        let seconds = falling.fill(path, self.pass.particles(), &ParticleView::new(camera))?;
        self.drops = Some((memory.drops.write(gpu, "particles", &falling.words())?, falling.len() as u32));
        Ok(seconds)
    }

    /// Particles in the picture.
    pub(crate) fn particles(&self) -> u32 {
        self.drops.as_ref().map_or(0, |(_, count)| *count)
    }

    /// Blocks of 256 splats in all sets.
    fn blocks(&self) -> u32 {
        self.sets.iter().map(|(model, ..)| model.blocks()).sum()
    }

    fn tiles(&self) -> u32 {
        ViewParameters::of(self.pass).tile_count()
    }

    fn pixels(&self) -> u32 {
        self.pass.camera.width * self.pass.camera.height
    }

    /// Returns the uniform structures of the pass in the order of their slots.
    pub(crate) fn uniforms(&self, capacity: Capacity) -> Vec<Uniform> {
        let parameters = ViewParameters::of(self.pass);
        let view = uniforms::view(&parameters, self.blocks(), self.particles(), capacity);
        let mut uniforms = lists::uniforms(view, Entries::Records);
        let mut first_block = 0;
        for (model, _, attributes) in &self.sets {
            for chunk in &model.chunks {
                let (blocks, first_splat) = (chunk.blocks, chunk.first_splat);
                // Padded with what is never drawn.
                let (splats, sh_rows) = (WORKGROUP * blocks, model.sh_rows);
                let piece = uniforms::Piece { first_block, blocks, first_splat, splats, sh_rows };
                uniforms.push(uniforms::chunk(piece, sh_rows, *attributes, Opacity::Stored));
                first_block += blocks;
            }
        }
        uniforms
    }

    /// Returns the number of [`Self::uniforms`].
    pub(crate) fn slots(&self) -> usize {
        FIRST_PIECE_SLOT + self.sets.iter().map(|(model, ..)| model.chunks.len()).sum::<usize>()
    }

    /// Returns the sizes of the buffers that the pass needs, without the slots.
    pub(crate) fn extent(&self, capacity: Capacity) -> Extent {
        let planes = match (self.pass.surface, self.arrays.median_depth) {
            (Some(_), _) => SURFACE_PLANE + 1 + FRONT_CHANNELS as u64,
            (None, true) => 2,
            (None, false) => u64::from(self.features.geometry != Geometry::None),
        };
        Extent {
            slots: 0,
            blocks: self.blocks(),
            capacity,
            tiles: self.tiles(),
            pixels: self.pixels().into(),
            planes,
            normal: self.arrays.normal,
            particles: self.particles,
        }
    }

    /// Uploads the surface to where blending reads it. No other pass that is submitted with this
    /// one may have one.
    pub(crate) fn upload_surface(&self, gpu: &Gpu, room: &Room) {
        let Some(surface) = self.pass.surface else { return };
        // Without a surface, everything is in front of it.
        let depths: Vec<f32> = surface.depth.iter().map(|z| if z.is_nan() { 0.0 } else { 1.0 / z }).collect();
        let at = SURFACE_PLANE * 4 * u64::from(self.pixels());
        gpu.write(&room.depths, at, bytemuck::cast_slice(&depths));
    }

    /// Records the commands up to the picture of the splats.
    pub(crate) fn record_splats(&self, recorder: &mut Recorder<'_>, room: &Room) {
        recorder.encoder().clear_buffer(&room.lists.counters, 0, None);
        let air = self.air.as_ref().map(|(source, parameters)| (source, parameters));
        let pieces = self.pieces(recorder);
        lists::front(recorder, room, &pieces, self.pass.shading, air);
        let listed = lists::lists(recorder, room, self.tiles(), Entries::Records);
        recorder.begin(Stage::Rasterize);
        let Features { geometry, median } = self.features;
        let program = frame_program(geometry, median, self.pass.surface.is_some());
        rasterize(recorder, self.tiles(), program, room, listed.1, &room.lists.counters);
    }

    /// Records the commands up to the weights of the records in view, which are in the room of
    /// their counts of tiles then.
    pub(crate) fn record_weights(&self, recorder: &mut Recorder<'_>, room: &Room) {
        recorder.encoder().clear_buffer(&room.lists.counters, 0, None);
        let pieces = self.pieces(recorder);
        lists::front(recorder, room, &pieces, self.pass.shading, None);
        let listed = lists::lists(recorder, room, self.tiles(), Entries::Records);
        // The lists are complete, and nothing reads the counts any more.
        recorder.encoder().clear_buffer(&room.lists.counts, 0, None);
        recorder.begin(Stage::Rasterize);
        weigh(recorder, self.tiles(), room, listed.1);
    }

    /// The weights of the splats, set after set and as they were loaded: `blocks` are those of the
    /// room with their masks, `units` the weights of those in view.
    pub(crate) fn weights_of(&self, blocks: &[u32], units: &[u32], weights: &mut Vec<f32>) {
        weights.clear();
        let mut blocks = blocks.chunks_exact(BLOCK_WORDS as usize);
        for (model, ..) in &self.sets {
            let first = weights.len();
            weights.resize(first + model.len, 0.0);
            for (block, own) in blocks.by_ref().take(model.blocks() as usize).enumerate() {
                let mut place = own[0] as usize;
                for (word, mask) in own[1..].iter().enumerate() {
                    for bit in (0..u32::BITS as usize).filter(|bit| mask >> bit & 1 == 1) {
                        let slot = block * WORKGROUP as usize + word * u32::BITS as usize + bit;
                        let splat = model.source[slot] as usize;
                        weights[first + splat] =
                            units.get(place).map_or(0.0, |units| *units as f32 / WEIGHT_UNITS);
                        place += 1;
                    }
                }
            }
        }
    }

    /// Records the commands that put the background behind the splats and the particles before
    /// them.
    pub(crate) fn record_composite(&self, recorder: &mut Recorder<'_>, room: &Room) {
        if self.particles != ParticleBlend::None {
            recorder.encoder().clear_buffer(&room.falling, 0, None);
        }
        recorder.begin(Stage::Fall);
        if let Some((drops, count)) = &self.drops {
            fall(recorder, drops, *count, room);
        }
        recorder.begin(Stage::Composite);
        let (form, background) = &self.background;
        composite(recorder, self.pixels(), *form, self.particles, room, background);
    }

    /// The pictures that come back, in the order of [`super::readback::ReadbackResults`], of no
    /// bytes where they are not wanted.
    pub(crate) fn pictures<'r>(&self, room: &'r Room) -> [Source<'r>; 7] {
        let plane = 4 * u64::from(self.pixels());
        let bytes = |wanted: bool, channels: u64| if wanted { channels * plane } else { 0 };
        let Arrays { depth, median_depth, normal, particles, front, .. } = self.arrays;
        [
            (&room.rgb, 0, bytes(true, 3)),
            (&room.alpha, 0, bytes(true, 1)),
            (&room.depths, 0, bytes(depth || self.hides_depth(), 1)),
            (&room.depths, plane, bytes(median_depth, 1)),
            (&room.normal, 0, bytes(normal, 3)),
            (&room.apart, 0, bytes(particles, 4)),
            (&room.depths, (SURFACE_PLANE + 1) * plane, bytes(front, FRONT_CHANNELS as u64)),
        ]
    }

    /// Returns true if effects on the CPU need a depth that the frame does not hold.
    pub(crate) fn hides_depth(&self) -> bool {
        !self.pass.hooks.pixels.is_empty() && !self.arrays.depth
    }

    /// The pieces of all sets.
    fn pieces<'r>(&'r self, recorder: &Recorder<'r>) -> Vec<Piece<'r>> {
        let mut pieces = Vec::new();
        for (model, attributes, _) in &self.sets {
            for chunk in &model.chunks {
                pieces.push(Piece {
                    uniform: recorder.uniform(FIRST_PIECE_SLOT + pieces.len()),
                    splats: &chunk.splats,
                    sh_rest: &chunk.sh_rest,
                    attributes: Some(attributes),
                    blocks: chunk.blocks,
                });
            }
        }
        pieces
    }
}
