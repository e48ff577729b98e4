//! Small structures for the GPU, laid out as WGSL does; a test holds them against the WGSL.

use super::source::TILE_SIDE;
use crate::config::MedianDepth;
use crate::differentiable::{DepthAlpha, DrawnSplats, ForwardConfig, Opacity};
use crate::even_air::EvenAir;
use crate::gradients::Learn;
use crate::hooks::{SkySplats, SplatAttributes};
use crate::plan::{CutPlane, DrawPass};
use crate::stages::compare::{Comparison, Term};
use crate::stages::optimize::{BETA1, BETA2, Noise, Step};
use crate::stages::project::ProjectCamera;
use crate::stages::rays::packets::{CHILDREN, RayGroup};
use std::f32::consts::LOG2_E;
use std::ops::Range;
use wm_base::random::SEED_FACTOR;
use wm_scene::splats::logit;
use wm_scene::{Camera, Rasterization};

/// Bytes from one structure to the next: the largest alignment that an adapter may ask for.
pub(crate) const UNIFORM_SLOT_BYTES: u64 = 256;

/// The words of a WGSL structure, with the names and places of its fields.
#[derive(Clone, Debug, Default)]
pub(crate) struct Uniform {
    /// The words of the structure.
    pub(crate) words: Vec<u32>,
    /// Name and byte offset of each field.
    pub(crate) fields: Vec<(&'static str, u32)>,
}

impl Uniform {
    fn whole(mut self, name: &'static str, value: u32) -> Self {
        self.fields.push((name, 4 * self.words.len() as u32));
        self.words.push(value);
        self
    }

    fn real(self, name: &'static str, value: f32) -> Self {
        self.whole(name, value.to_bits())
    }

    /// Replaces the number in a field.
    fn replaced(mut self, name: &'static str, value: u32) -> Self {
        for (_, offset) in self.fields.iter().filter(|(field, _)| *field == name) {
            self.words[*offset as usize / 4] = value;
        }
        self
    }

    /// A vector: those of two numbers begin at multiples of 8 bytes, longer ones of 16.
    fn vector<const N: usize>(mut self, name: &'static str, values: [f32; N]) -> Self {
        let align = if N == 2 { 2 } else { 4 };
        self.words.resize(self.words.len().next_multiple_of(align), 0);
        self.fields.push((name, 4 * self.words.len() as u32));
        self.words.extend(values.map(f32::to_bits));
        self
    }
}

/// The numbers of items that the GPU has room for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Capacity {
    /// Splats in view.
    pub(crate) visible: u32,
    /// Entries of tile lists.
    pub(crate) entries: u32,
}

/// Bytes of the largest array over each.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ItemBytes {
    /// Splats in view.
    pub(crate) visible: u64,
    /// Entries of tile lists.
    pub(crate) entries: u64,
}

impl ItemBytes {
    /// Sizes for a frame: records and entries, bytes.
    pub(crate) const FRAME: Self = Self { visible: 64, entries: 4 };
}

impl Capacity {
    /// Most of both that arrays of `most_binding` bytes hold.
    fn limit(most_binding: u64, each: ItemBytes) -> Self {
        let of = |bytes: u64| u32::try_from(most_binding / bytes).unwrap_or(u32::MAX);
        Self { visible: of(each.visible), entries: of(each.entries) }
    }

    /// A first guess for `total` splats: half of them in view, two tiles each.
    pub(crate) fn start(&mut self, total: usize, most_binding: u64, each: ItemBytes) {
        let (total, limit) = (u32::try_from(total).unwrap_or(u32::MAX), Self::limit(most_binding, each));
        self.visible = self.visible.max((total / 2).max(4096).min(limit.visible));
        self.entries = self.entries.max(total.max(65_536).min(limit.entries));
    }

    /// Grows to what a frame needed, and a quarter more where that fits; whether it had to. Entries
    /// are counted of the splats that had room, so both may have to grow one after the other.
    pub(crate) fn grow(&mut self, visible: u32, entries: u32, most_binding: u64, each: ItemBytes) -> bool {
        let (before, limit) = (*self, Self::limit(most_binding, each));
        let more = |has: u32, needs: u32, limit: u32| {
            if needs > has { needs.saturating_add(needs / 4).min(limit.max(needs)) } else { has }
        };
        self.visible = more(self.visible, visible, limit.visible);
        self.entries = more(self.entries, entries, limit.entries);
        *self != before
    }
}

/// A camera, and the settings of the projection.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ViewParameters<'a> {
    /// From where.
    pub(crate) camera: &'a Camera,
    /// The camera of the whole picture ([`DrawPass::whole`]).
    pub(crate) whole: Option<&'a Camera>,
    /// The drawing of splats smaller than a pixel.
    pub(crate) rasterization: Rasterization,
    /// The treatment of the scene's own sky.
    pub(crate) sky: SkySplats,
    /// The haze of the photos that are learnt from.
    pub(crate) air: Option<EvenAir>,
    /// The plane below which nothing is drawn ([`DrawPass::cut`]).
    pub(crate) cut: Option<CutPlane>,
    /// Normal of the surface that splits the blend, if the pass has one ([`DrawPass::surface`]).
    pub(crate) split: Option<[f32; 3]>,
    /// The median that is blended.
    pub(crate) median: MedianDepth,
}

impl<'a> ViewParameters<'a> {
    /// Collects the parameters of a draw pass.
    pub(crate) fn of(pass: &'a DrawPass<'_>) -> Self {
        let (rasterization, sky) = (pass.config.rasterization, pass.hooks.sky_splats());
        Self {
            camera: &pass.camera,
            whole: pass.whole.as_ref(),
            rasterization,
            sky,
            air: None,
            cut: pass.cut,
            median: pass.config.outputs.median_depth,
            split: pass.surface.map(|surface| surface.normal.map(|v| v as f32)),
        }
    }

    /// Collects the parameters of a step of training.
    pub(crate) fn of_training(camera: &'a Camera, config: &ForwardConfig) -> Self {
        let sky = match config.drawn {
            DrawnSplats::All => SkySplats::Kept,
            DrawnSplats::WithoutSky => SkySplats::LeftOut,
        };
        Self {
            camera,
            whole: None,
            rasterization: config.rasterization,
            sky,
            air: config.air,
            cut: None,
            split: None,
            median: MedianDepth::Off,
        }
    }

    /// Columns and rows of tiles.
    pub(crate) fn tiles(&self) -> (u32, u32) {
        (self.camera.width.div_ceil(TILE_SIDE), self.camera.height.div_ceil(TILE_SIDE))
    }

    /// Their number.
    pub(crate) fn tile_count(&self) -> u32 {
        let (columns, rows) = self.tiles();
        columns * rows
    }
}

/// `View` of `common.wgsl`; `blocks` are those of all sets, `drops` what falls.
pub(crate) fn view(sight: &ViewParameters<'_>, blocks: u32, drops: u32, capacity: Capacity) -> Uniform {
    let camera = ProjectCamera::new(sight.camera).part_of(sight.whole);
    let [rotation_x, rotation_y, rotation_z] = camera.rotation;
    Uniform::default()
        .vector("rotation_x", rotation_x)
        .real("near", camera.near)
        .vector("rotation_y", rotation_y)
        .whole("antialiased", u32::from(sight.rasterization == Rasterization::Antialiased))
        .vector("rotation_z", rotation_z)
        .whole("sky_left_out", u32::from(sight.sky == SkySplats::LeftOut))
        .vector("center", camera.center)
        .whole("tile_columns", sight.tiles().0)
        .vector("focal", camera.focal)
        .vector("principal", camera.principal)
        .vector("size", camera.size)
        .vector("low", camera.low)
        .vector("high", camera.high)
        .whole("width", sight.camera.width)
        .whole("height", sight.camera.height)
        .whole("tiles", sight.tile_count())
        .whole("blocks", blocks)
        .whole("visible_capacity", capacity.visible)
        .whole("entry_capacity", capacity.entries)
        .whole("drops", drops)
        .vector("airlight", sight.air.map_or([0.0; 3], |air| air.airlight))
        .real("extinction", sight.air.map_or(0.0, |air| air.extinction * LOG2_E))
        .vector("cut", sight.cut.map_or([0.0; 4], |cut| cut.seen_from(sight.camera.center().to_array())))
        .vector("split_normal", sight.split.unwrap_or_default())
        .whole("split", if sight.median == MedianDepth::Splat { 2 } else { sight.split.is_some().into() })
}

/// `View` of lists of something else than tiles, which no camera sees: their number, blocks of what
/// they list, and room.
pub(crate) fn view_of_lists(lists: u32, blocks: u32, capacity: Capacity) -> Uniform {
    let (fx, fy, cx, cy) = (1.0, 1.0, 0.5, 0.5);
    let camera = Camera { width: 1, height: 1, fx, fy, cx, cy, viewmat: glam::DMat4::IDENTITY, near: 0.1 };
    let sight = ViewParameters::of_training(&camera, &ForwardConfig::default());
    view(&sight, blocks, 0, capacity).replaced("tiles", lists)
}

/// Makes `RayTask` of `records.wgsl`: a range of packets of a group, and the number of records.
pub(crate) fn ray_task(group: &RayGroup, packets: &Range<u32>, records: u32, emits: bool) -> Uniform {
    let all = group.packets.len() as u32;
    let top = group.levels.len() as u32 - 1;
    let sizes = (0..top).scan(all, |size, _| Some(std::mem::replace(size, size.div_ceil(CHILDREN as u32))));
    Uniform::default()
        .vector("center", group.center)
        .real("radius", group.radius)
        .whole("packets", all)
        .whole("first", packets.start)
        .whole("end", packets.end)
        .whole("top", top)
        .whole("top_at", sizes.sum())
        .whole("records", records)
        .whole("emits", u32::from(emits))
}

/// `ColorPiece` of `features.wgsl`: the first of its records, their number, and numbers of each.
pub(crate) fn color_piece(first: u32, count: u32, stride: u32) -> Uniform {
    Uniform::default().whole("first", first).whole("count", count).whole("stride", stride)
}

/// A piece of a set, for [`chunk`].
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Piece {
    /// First block of the piece among those of all sets.
    pub(crate) first_block: u32,
    /// Blocks of 256 splats in the piece.
    pub(crate) blocks: u32,
    /// First splat of the piece among those of its set.
    pub(crate) first_splat: u32,
    /// Splats of the piece, padding included.
    pub(crate) splats: u32,
    /// Rows of the coefficients of colour a group.
    pub(crate) sh_rows: u32,
}

/// `Chunk` of `pieces.wgsl`: a piece, how many rows of its coefficients are in use, the attributes
/// of its splats, and where opacities come from.
pub(crate) fn chunk(
    piece: Piece,
    sh_used: u32,
    attributes: Option<&dyn SplatAttributes>,
    opacity: Opacity,
) -> Uniform {
    let fixed = match opacity {
        Opacity::Stored => None,
        Opacity::Fixed(value) => Some(value.max(1e-30).log2()),
    };
    Uniform::default()
        .whole("first_block", piece.first_block)
        .whole("blocks", piece.blocks)
        .whole("first_splat", piece.first_splat)
        .whole("splats", piece.splats)
        .whole("sh_rows", piece.sh_rows)
        .whole("sh_used", sh_used)
        .whole("has_attributes", u32::from(attributes.is_some()))
        .whole("changes_light", u32::from(attributes.is_some_and(SplatAttributes::changes_light)))
        .whole("fixed", u32::from(fixed.is_some()))
        .real("fixed_log2_opacity", fixed.unwrap_or(0.0))
}

/// `Training` of `training.wgsl`.
pub(crate) fn training(background: [f32; 3], depth_alpha: DepthAlpha) -> Uniform {
    Uniform::default()
        .vector("background", background)
        .whole("depth_detached", u32::from(depth_alpha == DepthAlpha::Detached))
}

/// `Comparison` of `photo.wgsl`, one per channel: `pixels` are those of the picture, `counted` what
/// they count together.
pub(crate) fn comparison(comparison: &Comparison<'_>, pixels: u32, counted: f64, channel: u32) -> Uniform {
    let row = |row: usize| [0, 1, 2, 3].map(|k| comparison.exposure[4 * row + k]);
    let [l1, dssim] = [Term::L1, Term::Dssim].map(|term| comparison.weight(term));
    Uniform::default()
        .vector("red", row(0))
        .vector("green", row(1))
        .vector("blue", row(2))
        .real("l1", (l1 / (3.0 * counted.max(1.0))) as f32)
        .real("dssim", (dssim / (3.0 * f64::from(pixels))) as f32)
        .whole("channel", channel)
}

/// `Geometry` of `geometry.wgsl`: `pixels` are those of the picture; columns and number of the
/// patches.
pub(crate) fn geometry(comparison: &Comparison<'_>, pixels: u32, patches: (u32, u32)) -> Uniform {
    let Comparison { believed, patches: plan, .. } = comparison;
    let (columns, rows) = believed.map_or((0, 0), |believed| believed.grid);
    let over = |term: Term, count: f64| (comparison.weight(term) / count.max(1.0)) as f32;
    let grid = f64::from(columns) * f64::from(rows);
    Uniform::default()
        .real("depth", over(Term::Depth, grid))
        .real("normal", over(Term::Normal, grid))
        .real("coverage", over(Term::Coverage, f64::from(pixels)))
        .real("patches", over(Term::Patches, 1.0))
        .real("smooth_depth", over(Term::Smooth, 1.0))
        .real("sigma", believed.map_or(0.0, |believed| believed.sigma))
        .real("local", plan.local)
        .real("margin", plan.margin)
        .whole("columns", columns)
        .whole("rows", rows)
        .whole("side", plan.side.max(1))
        .whole("patch_columns", patches.0)
        .whole("patch_count", patches.1)
}

/// `Pass` of `sort.wgsl`.
pub(crate) fn sort_pass(shift: u32, of_entries: bool, numbered: bool) -> Uniform {
    Uniform::default()
        .whole("shift", shift)
        .whole("of_entries", u32::from(of_entries))
        .whole("numbered", u32::from(numbered))
}

/// `Task` of `intersect.wgsl`.
pub(crate) fn intersect_task(emits: bool) -> Uniform {
    Uniform::default().whole("emits", u32::from(emits))
}

/// `Step` of `optimize.wgsl`, for `splats` splats.
pub(crate) fn optimize_step(step: &Step, splats: usize) -> Uniform {
    let Step { number, rates, terms, size } = step;
    let correction = |beta: f32| (1.0 - f64::from(beta).powf(f64::from(*number))) as f32;
    let each = |weight: f64| (weight / splats.max(1) as f64) as f32;
    Uniform::default()
        .real("rate_means", rates.means as f32)
        .real("rate_quats", rates.quats as f32)
        .real("rate_log_scales", rates.log_scales as f32)
        .real("rate_opacities", rates.logit_opacities as f32)
        .real("rate_dc", rates.sh_dc as f32)
        .real("rate_rest", rates.sh_rest as f32)
        .real("correction1", correction(BETA1))
        .real("correction2", correction(BETA2))
        .real("opacity", each(terms.opacity))
        .real("scale", each(terms.scale / 3.0))
        .real("flatness", each(terms.flatness))
        .whole("number", *number)
        .vector("half_size", [size.0 as f32 / 2.0, size.1 as f32 / 2.0])
}

/// `Learn` of `add.wgsl`.
pub(crate) fn learn(learn: Learn) -> Uniform {
    let share = |learns: bool| if learns { 1.0 } else { 0.0 };
    Uniform::default()
        .real("means", share(learn.means))
        .real("quats", share(learn.quats))
        .real("log_scales", share(learn.log_scales))
        .real("opacities", share(learn.logit_opacities))
        .real("sh", share(learn.sh))
}

/// `Noise` of `explore.wgsl`.
pub(crate) fn noise(noise: &Noise) -> Uniform {
    // What `wm_base::random::uniform` multiplies a seed with.
    let seed = noise.seed.wrapping_mul(SEED_FACTOR);
    Uniform::default()
        .whole("seed", seed as u32)
        .whole("seed_high", (seed >> 32) as u32)
        .real("size", noise.size as f32)
        .real("most", logit(noise.most) as f32)
}

/// Makes `Move` of `rearrange.wgsl`: moves splats `before` to splats `now`, `rows` rows each.
pub(crate) fn rearrangement(before: Range<u32>, now: Range<u32>, rows: u32, forgets: MomentReset) -> Uniform {
    let (row, period) = match forgets {
        MomentReset::Row(row, period) => (row, period),
        MomentReset::Nothing | MomentReset::Splats => (0, 0),
    };
    Uniform::default()
        .whole("first_before", before.start)
        .whole("count_before", before.end - before.start)
        .whole("first", now.start)
        .whole("count", now.end - now.start)
        .whole("rows", rows)
        .whole("forgets", u32::from(forgets != MomentReset::Nothing))
        .whole("forgotten_row", row)
        .whole("period", period)
}

/// The numbers that are set to 0 when rows are moved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum MomentReset {
    /// Nothing.
    Nothing,
    /// All rows of splats that forget.
    Splats,
    /// These and one row of all splats, in each so many.
    Row(u32, u32),
}

/// Structures as they lie in a buffer, one per slot.
pub(crate) fn bytes_of(uniforms: &[Uniform]) -> Vec<u8> {
    let mut bytes = vec![0; UNIFORM_SLOT_BYTES as usize * uniforms.len()];
    for (slot, uniform) in bytes.chunks_exact_mut(UNIFORM_SLOT_BYTES as usize).zip(uniforms) {
        let words: &[u8] = bytemuck::cast_slice(&uniform.words);
        slot[..words.len()].copy_from_slice(words);
    }
    bytes
}

#[cfg(test)]
mod tests;
