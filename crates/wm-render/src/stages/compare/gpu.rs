//! Compares pictures with a photo and its priors on a GPU, which keeps both.

use super::{Compared, Comparison, PixelPrior, Term, WORKGROUP_COUNT};
use crate::differentiable::Channels;
use crate::gpu::Gpu;
use crate::gpu::buffers::{BufferPool, READ_BACK};
use crate::gpu::device::WRITTEN;
use crate::gpu::error::GpuError;
use crate::gpu::recorder::{Bindings, Groups, Recorder, Stage, with_buffers, with_numbered};
use crate::gpu::source::{Program, WORKGROUP, switches};
use crate::gpu::uniforms::{self, Uniform};
use std::collections::HashMap;
use wgpu::{BindingResource, BufferBinding, BufferSize};

/// Structures of a comparison: one per channel of colour, and that of geometry.
pub(crate) const STRUCTURE_COUNT: usize = 4;
/// Most bytes of photos and their priors that stay on the GPU.
const KEPT_BYTES: u64 = 1 << 30;

/// The structure of a comparison, and the photo.
const PHOTO: &str = include_str!("photo.wgsl");
/// The first text of programs that compare geometry.
const GEOMETRY: &str = include_str!("geometry.wgsl");
/// Sums over a workgroup.
const SUMS: &str = include_str!("sums.wgsl");
const WINDOWS: &str = include_str!("windows.wgsl");
const BELIEFS: &str = include_str!("beliefs.wgsl");
const GRID: &str = include_str!("grid.wgsl");
const MOMENTS: &str = include_str!("moments.wgsl");
const PATCH: &str = include_str!("patch.wgsl");

/// Compares one channel with a photo.
pub(crate) const SIMILARITY: Program =
    Program::new("similarity", &[PHOTO, WINDOWS, include_str!("similarity.wgsl")]);
/// The derivative of that.
pub(crate) const SIMILARITY_BACKWARD: Program =
    Program::new("similarity_backward", &[PHOTO, WINDOWS, include_str!("similarity_backward.wgsl")]);
/// Adds up the derivatives of the colour terms and takes them back through the exposure.
pub(crate) const COLORS_BACKWARD: Program =
    Program::new("colors_backward", &[PHOTO, SUMS, include_str!("colors_backward.wgsl")]);
/// Mean and spread of inverse depths.
pub(crate) const GRID_MOMENTS: Program =
    Program::new("grid_moments", &[GEOMETRY, BELIEFS, GRID, MOMENTS, include_str!("grid_moments.wgsl")]);
/// Mean and spread of inverse depths of patches, and the distance of patches from the priors.
pub(crate) const PATCHES: Program =
    Program::new("patches", &[GEOMETRY, BELIEFS, GRID, MOMENTS, PATCH, SUMS, include_str!("patches.wgsl")]);
/// Adds up the patches.
pub(crate) const PATCH_TOTALS: Program =
    Program::new("patch_totals", &[GEOMETRY, SUMS, include_str!("patch_totals.wgsl")]);
/// The derivative of that.
pub(crate) const PATCHES_BACKWARD: Program = Program::new(
    "patches_backward",
    &[GEOMETRY, BELIEFS, GRID, PATCH, SUMS, include_str!("patches_backward.wgsl")],
);
/// The sum of inverse depths.
pub(crate) const INVERSE_DEPTHS: Program =
    Program::new("inverse_depths", &[GEOMETRY, SUMS, include_str!("inverse_depths.wgsl")]);
/// Differences of inverse depths of neighbours.
pub(crate) const SMOOTH_BACKWARD: Program =
    Program::new("smooth_backward", &[GEOMETRY, SUMS, include_str!("smooth_backward.wgsl")]);

/// Depth, normals and coverage against the priors of each pixel.
pub(crate) fn pixels_program(channels: Channels) -> Program {
    let texts = &[GEOMETRY, BELIEFS, SUMS, include_str!("pixels_backward.wgsl")];
    Program::new("pixels_backward", texts).with(switches(channels))
}

/// Sums that are read back: one set per workgroup, from `first` on.
#[derive(Clone, Copy)]
struct Sums {
    /// Numbers a workgroup.
    each: usize,
    groups: usize,
    /// The first, in numbers; a multiple of 64, as far apart as bindings may have to begin.
    first: usize,
}

impl Sums {
    /// Sums of `colors_backward.wgsl`.
    const COLORS: Self = Self { each: 16, groups: WORKGROUP_COUNT as usize, first: 0 };
    /// Sums of `pixels_backward.wgsl`.
    const PIXELS: Self = Self::COLORS.then(4, WORKGROUP_COUNT as usize);
    /// Sums of `smooth_backward.wgsl`.
    const SMOOTH: Self = Self::PIXELS.then(4, WORKGROUP_COUNT as usize);
    /// Sums of `patch_totals.wgsl`.
    const PATCHES: Self = Self::SMOOTH.then(4, 1);
    /// Numbers of all.
    const ALL: usize = Self::PATCHES.first + Self::PATCHES.each;

    const fn then(self, each: usize, groups: usize) -> Self {
        Self { each, groups, first: (self.first + self.each * self.groups).next_multiple_of(64) }
    }

    /// Added up, in order.
    fn of<const N: usize>(self, totals: &[f32]) -> [f64; N] {
        let mut sums = [0.0; N];
        for group in totals[self.first..][..self.each * self.groups].chunks_exact(self.each) {
            sums.iter_mut().zip(group).for_each(|(sum, value)| *sum += f64::from(*value));
        }
        sums
    }

    /// Their place in the buffer of all.
    fn within(self, totals: &wgpu::Buffer) -> BindingResource<'_> {
        BindingResource::Buffer(BufferBinding {
            buffer: totals,
            offset: 4 * self.first as u64,
            size: BufferSize::new(4 * (self.each * self.groups) as u64),
        })
    }
}

/// Photos of earlier comparisons, and working memory.
#[derive(Default)]
pub(crate) struct Comparer {
    photos: HashMap<(usize, u32, u32), Photo>,
    /// Counts comparisons.
    clock: u64,
    kept: BufferPool,
}

/// A photo on the device.
struct Photo {
    colors: wgpu::Buffer,
    beliefs: Option<wgpu::Buffer>,
    /// The sum of the mask.
    counted: f64,
    used: u64,
}

impl Photo {
    fn bytes(&self) -> u64 {
        self.colors.size() + self.beliefs.as_ref().map_or(0, wgpu::Buffer::size)
    }
}

/// Room for one comparison.
pub(crate) struct Room {
    photo: wgpu::Buffer,
    beliefs: Option<wgpu::Buffer>,
    counted: f64,
    slopes: wgpu::Buffer,
    sums: wgpu::Buffer,
    /// Sums of inverse depths, one row per workgroup.
    groups: wgpu::Buffer,
    patches: wgpu::Buffer,
    /// The room for the totals that [`Room::compared`] reads.
    pub(crate) totals: wgpu::Buffer,
    pixels: u32,
    tiles: u32,
    patch_count: u32,
    has_patches: bool,
    is_smooth: bool,
}

/// Pictures to compare, and where derivatives by them go.
#[derive(Clone, Copy)]
pub(crate) struct Pictures<'a> {
    pub(crate) channels: Channels,
    pub(crate) rgb: &'a wgpu::Buffer,
    pub(crate) alpha: &'a wgpu::Buffer,
    pub(crate) depths: &'a wgpu::Buffer,
    pub(crate) normal: &'a wgpu::Buffer,
    /// See `upstream.wgsl`.
    pub(crate) upstream: &'a wgpu::Buffer,
}

/// Returns the number of columns of patches and of patches of a grid.
fn cut(comparison: &Comparison<'_>) -> (u32, u32) {
    let side = comparison.patches.side.max(1);
    let [columns, rows] = comparison
        .believed
        .map_or([0; 2], |believed| [believed.grid.0, believed.grid.1].map(|pixels| pixels.div_ceil(side)));
    (columns, columns * rows)
}

impl Comparer {
    /// Room for a picture of `size` in `tiles` tiles, with the photo in it.
    pub(crate) fn room(
        &mut self,
        gpu: &Gpu,
        comparison: &Comparison<'_>,
        size: (u32, u32),
        tiles: u32,
    ) -> Result<Room, GpuError> {
        self.clock += 1;
        let (photo, beliefs, counted) = self.photo(gpu, comparison, size.0, size.1)?;
        let pixels = size.0 * size.1;
        let has_patches = beliefs.is_some() && comparison.weight(Term::Patches) != 0.0;
        let patch_count = if has_patches { cut(comparison).1 } else { 0 };
        let bytes = 12 * u64::from(pixels);
        self.kept.restart();
        let mut fit = |what, bytes, usage| self.kept.fit(gpu, what, bytes, usage);
        Ok(Room {
            photo,
            beliefs,
            counted,
            slopes: fit("slopes of similarity", bytes, WRITTEN)?,
            sums: fit("sums of similarity", 12 * u64::from(tiles), WRITTEN)?,
            groups: fit("sums of depth", 32 * u64::from(WORKGROUP_COUNT), WRITTEN)?,
            patches: fit("sums of patches", 48 * u64::from(patch_count), WRITTEN)?,
            totals: fit("sums of a picture", 4 * Sums::ALL as u64, READ_BACK)?,
            pixels,
            tiles,
            patch_count,
            has_patches,
            is_smooth: comparison.weight(Term::Smooth) != 0.0,
        })
    }

    /// Returns the photo on the device, its priors, and the sum of its mask.
    fn photo(
        &mut self,
        gpu: &Gpu,
        comparison: &Comparison<'_>,
        width: u32,
        height: u32,
    ) -> Result<(wgpu::Buffer, Option<wgpu::Buffer>, f64), GpuError> {
        let pixels = u64::from(width) * u64::from(height);
        let name = (comparison.photo, width, height);
        if !self.photos.contains_key(&name) {
            let bytes = 8 * pixels;
            gpu.check_binding("a photo", bytes)?;
            self.make_room(bytes);
            let colors = gpu.buffer("a photo", bytes, WRITTEN)?;
            gpu.write(&colors, 0, bytemuck::cast_slice(&packed(comparison)));
            let sum = |mask: &[f32]| mask.iter().map(|share| f64::from(*share)).sum();
            let counted = comparison.mask.map_or(pixels as f64, sum);
            self.photos.insert(name, Photo { colors, beliefs: None, counted, used: self.clock });
        }
        let missing = self.photos.get(&name).is_some_and(|photo| photo.beliefs.is_none());
        if let Some(believed) = comparison.believed.filter(|_| missing) {
            let bytes = 12 * pixels;
            gpu.check_binding("what is believed of a photo", bytes)?;
            let kept = self.photos.remove(&name);
            self.make_room(bytes + kept.as_ref().map_or(0, Photo::bytes));
            let beliefs = gpu.buffer("what is believed of a photo", bytes, WRITTEN)?;
            gpu.write(&beliefs, 0, bytemuck::cast_slice(&packed_beliefs(&(believed.pixels)())));
            self.photos.extend(kept.map(|photo| (name, Photo { beliefs: Some(beliefs), ..photo })));
        }
        let photo = self.photos.get_mut(&name).expect("it was put there");
        photo.used = self.clock;
        let beliefs = photo.beliefs.clone().filter(|_| comparison.believed.is_some());
        Ok((photo.colors.clone(), beliefs, photo.counted))
    }

    /// Drops the least recently used photos until there is room for `bytes` bytes.
    fn make_room(&mut self, bytes: u64) {
        while self.photos.values().map(Photo::bytes).sum::<u64>() + bytes > KEPT_BYTES {
            let Some(oldest) = self.photos.iter().min_by_key(|(_, photo)| photo.used) else { break };
            let name = *oldest.0;
            self.photos.remove(&name);
        }
    }
}

/// Colour and mask as 16-bit fractions, `[H, W]`.
fn packed(comparison: &Comparison<'_>) -> Vec<[u16; 4]> {
    let fraction = |value: f32| (value.clamp(0.0, 1.0) * 65_535.0).round() as u16;
    let pixels = comparison.rgb.as_chunks::<3>().0.iter().enumerate();
    let share = |at: usize| comparison.mask.map_or(1.0, |mask| mask[at]);
    pixels.map(|(at, rgb)| [rgb[0], rgb[1], rgb[2], share(at)].map(fraction)).collect()
}

/// Packs priors in the form that `beliefs.wgsl` reads.
fn packed_beliefs(beliefs: &[PixelPrior]) -> Vec<[u32; 3]> {
    let fraction = |value: f32| u32::from((value.clamp(-1.0, 1.0) * 32_767.0).round() as i16 as u16);
    let pair = |low: f32, high: f32| fraction(low) | fraction(high) << 16;
    let of = |PixelPrior { disparity, normal: [x, y, z], coverage }: &PixelPrior| {
        [disparity.to_bits(), pair(*x, *y), pair(*z, *coverage)]
    };
    beliefs.iter().map(of).collect()
}

impl Room {
    /// The structures of a comparison.
    pub(crate) fn structures(&self, comparison: &Comparison<'_>) -> [Uniform; STRUCTURE_COUNT] {
        let color = |channel| uniforms::comparison(comparison, self.pixels, self.counted, channel);
        [color(0), color(1), color(2), uniforms::geometry(comparison, self.pixels, cut(comparison))]
    }

    /// Compares pictures, with structures that begin at `slot`, and writes all derivatives by them.
    pub(crate) fn record<'a>(&'a self, recorder: &mut Recorder<'a>, slot: usize, pictures: Pictures<'a>) {
        if self.beliefs.is_none() {
            // No program writes these.
            let first = 12 * u64::from(self.pixels);
            let bytes = 20 * u64::from(self.pixels);
            recorder.encoder().clear_buffer(pictures.upstream, first, Some(bytes));
        }
        recorder.begin(Stage::Compare);
        if pictures.channels.has_color() {
            self.record_colors(recorder, slot, pictures);
        }
        self.record_geometry(recorder, slot + 3, pictures);
    }

    fn record_colors<'a>(&'a self, recorder: &mut Recorder<'a>, slot: usize, pictures: Pictures<'a>) {
        let Pictures { rgb, upstream, .. } = pictures;
        let (view, structures) =
            (recorder.view(), std::array::from_fn::<_, 3, _>(|channel| recorder.uniform(slot + channel)));
        let tiles = Groups::Direct(self.tiles);
        let shared = |channel: usize| {
            let first = vec![(0, view.clone()), (1, structures[channel].clone())];
            with_buffers(first, [rgb, &self.photo])
        };
        for channel in 0..3 {
            let bindings = with_numbered(shared(channel), [(4, &self.slopes), (5, &self.sums)]);
            recorder.dispatch(SIMILARITY, tiles, bindings);
            let bindings = with_numbered(shared(channel), [(4, &self.slopes), (6, upstream)]);
            recorder.dispatch(SIMILARITY_BACKWARD, tiles, bindings);
        }
        let mut bindings = with_numbered(shared(0), [(5, &self.sums), (6, upstream)]);
        bindings.push((7, Sums::COLORS.within(&self.totals)));
        recorder.dispatch(COLORS_BACKWARD, Groups::Direct(WORKGROUP_COUNT), bindings);
    }

    fn record_geometry<'a>(&'a self, recorder: &mut Recorder<'a>, slot: usize, pictures: Pictures<'a>) {
        let Pictures { channels, alpha, depths, normal, upstream, .. } = pictures;
        let (view, structure) = (recorder.view(), recorder.uniform(slot));
        let seen = || with_buffers(vec![(0, view.clone()), (1, structure.clone())], [alpha, depths]);
        let summed =
            |bindings: Bindings<'a>, sums: Sums| [bindings, vec![(7, sums.within(&self.totals))]].concat();
        let all = Groups::Direct(WORKGROUP_COUNT);
        let (groups, patches) = (&self.groups, &self.patches);
        if let Some(beliefs) = &self.beliefs {
            let bindings = with_buffers(seen(), [normal, beliefs, upstream]);
            recorder.dispatch(pixels_program(channels), all, summed(bindings, Sums::PIXELS));
            if self.has_patches {
                let each = Groups::Direct(self.patch_count);
                recorder.dispatch(GRID_MOMENTS, all, with_numbered(seen(), [(5, beliefs), (7, groups)]));
                let bindings = with_numbered(seen(), [(4, groups), (5, beliefs), (7, patches)]);
                recorder.dispatch(PATCHES, each, bindings);
                let bindings = with_numbered(vec![(1, structure.clone())], [(4, patches)]);
                recorder.dispatch(PATCH_TOTALS, Groups::Direct(1), summed(bindings, Sums::PATCHES));
                let bindings = with_buffers(seen(), [patches, beliefs, upstream]);
                recorder.dispatch(PATCHES_BACKWARD, each, summed(bindings, Sums::PATCHES));
            }
        }
        if self.is_smooth {
            let bindings = with_numbered(vec![(0, view.clone())], [(2, alpha), (3, depths), (7, groups)]);
            recorder.dispatch(INVERSE_DEPTHS, all, bindings);
            let bindings = with_buffers(seen(), [groups, &self.photo, upstream]);
            recorder.dispatch(SMOOTH_BACKWARD, all, summed(bindings, Sums::SMOOTH));
        }
    }

    /// Room for what comes back.
    pub(crate) fn totals() -> Vec<f32> {
        vec![0.0; Sums::ALL]
    }

    /// The result of a comparison, from the totals that came back.
    pub(crate) fn compared(&self, comparison: &Comparison<'_>, totals: &[f32]) -> Compared {
        let mut found = Compared::default();
        let mut set = |term: Term, value: f64| {
            if comparison.weight(term) != 0.0 {
                found.values[term as usize] = value;
            }
        };
        let [off, similarity, _, _, by_exposure @ ..] = Sums::COLORS.of::<16>(totals);
        set(Term::L1, off / (3.0 * self.counted.max(1.0)));
        set(Term::Dssim, 1.0 - similarity / (3.0 * f64::from(self.pixels)));
        let [depth, normal, coverage] = Sums::PIXELS.of(totals);
        let over = comparison.believed.map_or(1.0, |b| f64::from(b.grid.0) * f64::from(b.grid.1));
        set(Term::Depth, depth / over);
        set(Term::Normal, normal / over);
        set(Term::Coverage, coverage / f64::from(self.pixels));
        let [squares, count, own_squares, own_count] = Sums::PATCHES.of(totals);
        let own = f64::from(comparison.patches.local) * own_squares / own_count.max(1.0);
        set(Term::Patches, squares / count.max(1.0) + own);
        let [smooth] = Sums::SMOOTH.of(totals);
        set(Term::Smooth, smooth);
        found.by_exposure = by_exposure;
        found
    }
}

const _: () = assert!(WORKGROUP == 256, "a thread per pixel of a tile");
