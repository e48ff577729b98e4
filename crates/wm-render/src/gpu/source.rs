//! The programs of the GPU: each stage puts its own together, and the constants of the Rust code
//! come before them.

use crate::attributes::Attribute;
use crate::differentiable::Channels;
use crate::even_air;
use crate::frame;
use crate::hooks::GROUP;
use crate::stages::project::{self, rows as splats};
use crate::stages::project_backward::rows as gradients;
use crate::stages::rasterize_backward::GradientSlot;
use crate::stages::{compare, optimize, particles, rasterize};
use std::borrow::Cow;
use std::fmt::Write as _;
use std::hash::{Hash, Hasher};
use wm_scene::sh;

/// Threads of a workgroup in every stage.
pub(crate) const WORKGROUP: u32 = 256;
/// Workgroups in a row of a dispatch: below every adapter's limit, so that any number fits in rows.
pub(crate) const DISPATCH_ROW: u32 = 32_768;
/// Side of a tile, px: a thread per pixel.
pub(crate) const TILE_SIDE: u32 = 16;
/// Records that a tile holds at a time.
pub(crate) const BATCH: u32 = 64;
/// Tiles about a splat up to which one thread tests them.
pub(crate) const FEW_TILES: u32 = 32;
/// Fewest threads of a subgroup that is made use of.
pub(crate) const MIN_SUBGROUP: u32 = 4;
/// Values of a digit of the sort.
pub(crate) const DIGITS: u32 = 256;
/// Bits of one.
pub(crate) const DIGIT_BITS: u32 = 8;
/// Pairs that a thread of the sort moves.
pub(crate) const SORT_ROUNDS: u32 = 8;
/// Pairs of a workgroup of the sort.
pub(crate) const SORT_BLOCK: u32 = WORKGROUP * SORT_ROUNDS;
/// Words of a block of splats: a count, and a bit for each of its 256.
pub(crate) const BLOCK_WORDS: u32 = 1 + WORKGROUP / 32;
/// Words of the counters, see `Counters` in `common.wgsl`.
pub(crate) const COUNTER_WORDS: u64 = 5;
/// The first word of the sizes of a dispatch over the splats in view, among those that the GPU
/// finds.
pub(crate) const VISIBLE_GROUPS: u32 = 0;
/// The first word of the sizes of the dispatch that sorts the splats in view.
pub(crate) const VISIBLE_SORT: u32 = 3;
/// The first word of the sizes of the dispatch that sorts the entries of the tile lists.
pub(crate) const ENTRY_SORT: u32 = 6;
/// Words of all these.
pub(crate) const DISPATCH_WORDS: u64 = 9;
/// Distance of the sky, scene units: WGSL promises no infinity.
pub(crate) const FAR_AWAY: f32 = 1e30;

/// A program of the GPU.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Program {
    /// The entry point.
    pub(crate) entry: &'static str,
    /// The texts behind the constants and `common.wgsl`.
    texts: &'static [&'static str],
    /// The texts of a variant: switches, the air.
    variant: Vec<Cow<'static, str>>,
}

impl Hash for Program {
    fn hash<H: Hasher>(&self, state: &mut H) {
        // A few programs share an entry point, and the texts are long.
        self.entry.hash(state);
    }
}

impl Program {
    pub(crate) const fn new(entry: &'static str, texts: &'static [&'static str]) -> Self {
        Self { entry, texts, variant: Vec::new() }
    }

    /// Adds a text that is made, or chosen.
    pub(crate) fn with(mut self, text: impl Into<Cow<'static, str>>) -> Self {
        self.variant.push(text.into());
        self
    }

    /// The whole text.
    pub(crate) fn text(&self) -> String {
        let mut text = constants();
        let variant = self.variant.iter().map(|part| &**part);
        for part in [COMMON].into_iter().chain(self.texts.iter().copied()).chain(variant) {
            text.push_str(part);
            text.push('\n');
        }
        text
    }
}

/// The structures that all programs share.
const COMMON: &str = include_str!("common.wgsl");
/// The display's encoding of light.
pub(crate) const COLOR: &str = include_str!("color.wgsl");
/// The structure of a step of training.
pub(crate) const TRAINING: &str = include_str!("training.wgsl");

/// The use of subgroups.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub(crate) enum Subgroups {
    /// Used if the adapter has subgroups of at least [`MIN_SUBGROUP`] threads.
    #[default]
    Used,
    /// Not even there.
    Unused,
}

/// The switches of the blended sums, as WGSL.
pub(crate) fn switches(channels: Channels) -> String {
    let (color, depth, normal) = (channels.has_color(), channels.depth().is_some(), channels.has_normal());
    format!("const COLOR = {color};\nconst DEPTH = {depth};\nconst NORMAL = {normal};")
}

/// The constants that Rust and WGSL share, as WGSL.
pub(crate) fn constants() -> String {
    let mut text = String::new();
    macro_rules! whole {
        ($($name:ident = $value:expr;)*) => {$(
            let _ = writeln!(text, "const {}: u32 = {}u;", stringify!($name), $value);
        )*};
    }
    macro_rules! real {
        ($($name:ident = $value:expr;)*) => {$(
            let _ = writeln!(text, "const {}: f32 = {:e};", stringify!($name), $value);
        )*};
    }
    whole! {
        WORKGROUP = WORKGROUP;
        DISPATCH_ROW = DISPATCH_ROW;
        GROUP = GROUP;
        BATCH = BATCH;
        FEW_TILES = FEW_TILES;
        MIN_SUBGROUP = MIN_SUBGROUP;
        DIGITS = DIGITS;
        SORT_ROUNDS = SORT_ROUNDS;
        SORT_BLOCK = SORT_BLOCK;
        BLOCK_WORDS = BLOCK_WORDS;
        VISIBLE_GROUPS = VISIBLE_GROUPS;
        VISIBLE_SORT = VISIBLE_SORT;
        ENTRY_SORT = ENTRY_SORT;
        ATTRIBUTE_COLUMNS = Attribute::COUNT;
        SPLAT_NAME = frame::SPLAT_NAME;
        SPLAT_ROWS = splats::ROWS;
        ROW_MEAN = splats::ROW_MEAN;
        ROW_QUAT = splats::ROW_QUAT;
        ROW_SCALE = splats::ROW_SCALE;
        ROW_OPACITY = splats::ROW_OPACITY;
        ROW_DC = splats::ROW_DC;
        ROW_SKY = splats::ROW_SKY;
        SLOT_S = GradientSlot::S;
        SLOT_SU = GradientSlot::SU;
        SLOT_SV = GradientSlot::SV;
        SLOT_SUU = GradientSlot::SUU;
        SLOT_ABS_X = GradientSlot::ABS_X;
        SLOT_ABS_Y = GradientSlot::ABS_Y;
        SLOT_WEIGHT = GradientSlot::WEIGHT;
        SLOT_FEATURES = GradientSlot::FEATURES;
        WINDOW_RADIUS = compare::WINDOW_RADIUS_PX;
        COMPARE_GROUPS = compare::WORKGROUP_COUNT;
        PATCH_FEWEST = compare::MIN_PATCH_PIXELS;
        GRADIENT_ROW = gradients::ROW;
        GRADIENT_MEAN = gradients::MEAN;
        GRADIENT_QUAT = gradients::QUAT;
        GRADIENT_SCALE = gradients::SCALE;
        GRADIENT_OPACITY = gradients::OPACITY;
        GRADIENT_MEAN2D = gradients::MEAN2D;
        GRADIENT_ABSGRAD = gradients::ABSGRAD;
        GRADIENT_WEIGHT = gradients::WEIGHT;
        GRADIENT_RADIUS = gradients::RADIUS;
        GRADIENT_INDEX = gradients::INDEX;
    }
    real! {
        TILE_SIDE = f64::from(TILE_SIDE);
        FAR_AWAY = FAR_AWAY;
        GREY = even_air::MIDDLE_GREY;
        LN_2 = std::f32::consts::LN_2;
        DILATION = project::DILATION;
        SLOPE_DILATION = project::SLOPE_DILATION;
        FLATTENING = project::FLATTENING;
        LIES = project::MAX_LYING_SHARE;
        STANDS = project::MIN_STANDING_SHARE;
        MIN_COMPENSATION = project::MIN_COMPENSATION;
        LOG2_MIN_ALPHA = project::LOG2_MIN_ALPHA;
        TEST_SLACK = project::TEST_SLACK;
        SQRT_HALF_LOG2E = project::SQRT_HALF_LOG2E;
        MAX_DET = project::MAX_DET;
        LOG2_MAX_ALPHA = rasterize::LOG2_MAX_ALPHA;
        MIN_TRANSMITTANCE = rasterize::MIN_TRANSMITTANCE;
        FRAME_MIN_ALPHA = frame::MIN_ALPHA;
        STEPS = particles::STEPS_PER_OPTICAL_DEPTH;
        LOG2E = std::f32::consts::LOG2_E;
        PI = std::f32::consts::PI;
        BETA1 = optimize::BETA1;
        BETA2 = optimize::BETA2;
        SIMILARITY_C1 = compare::C1;
        SIMILARITY_C2 = compare::C2;
        COVERED = compare::MIN_COVERAGE;
        SLACK = compare::COVERAGE_TOLERANCE;
        EXACT = compare::MIN_RELATIVE_SIGMA;
        PATCH_FLOOR = compare::DEVIATION_FLOOR;
        EDGE = compare::EDGE_CONTRAST;
        ADAM_EPS = optimize::EPS;
        FLAT = optimize::MAX_FLAT_RATIO;
        C0 = sh::C0;
        C1 = sh::C1;
    }
    for (column, attribute) in Attribute::ALL.iter().enumerate() {
        let _ = writeln!(text, "const {}: u32 = {column}u;", attribute.wgsl_name());
    }
    let window = compare::WINDOW_WEIGHTS.map(f64::from);
    for (name, values) in [("C2", &sh::C2[..]), ("C3", &sh::C3[..]), ("WINDOW", &window[..])] {
        let numbers: Vec<String> = values.iter().map(|v| format!("{v:e}")).collect();
        let (count, numbers) = (values.len(), numbers.join(", "));
        let _ = writeln!(text, "const {name} = array<f32, {count}>({numbers});");
    }
    text
}

#[cfg(test)]
mod tests;
