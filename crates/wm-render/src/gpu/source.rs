//! The programs of the GPU: WGSL texts put together, with the constants of the Rust code before them.

use crate::attributes::Attribute;
use crate::differentiable::Channels;
use crate::frame;
use crate::hooks::{GROUP, WgslSource};
use crate::plan::Shading;
use crate::renderer::{Geometry, MedianDepth};
use crate::stages::project::{self, gpu as splats};
use crate::stages::project_backward::gpu as gradients;
use crate::stages::rasterize_backward::Slot;
use crate::stages::{compare, optimize, particles, rasterize};
use std::borrow::Cow;
use std::fmt::Write as _;
use wm_scene::sh;

/// Threads of a workgroup in every stage.
pub const WORKGROUP: u32 = 256;
/// Workgroups in a row of a dispatch: below every adapter's limit, so that any number fits in rows.
pub const DISPATCH_ROW: u32 = 32_768;
/// Side of a tile, px: a thread a pixel.
pub const TILE_SIDE: u32 = 16;
/// Records that a tile holds at a time.
pub const BATCH: u32 = 64;
/// Tiles about a splat up to which one thread tests them.
pub const FEW_TILES: u32 = 32;
/// Fewest threads of a subgroup that is made use of.
pub const MIN_SUBGROUP: u32 = 4;
/// Values of a digit of the sort.
pub const DIGITS: u32 = 256;
/// Bits of one.
pub const DIGIT_BITS: u32 = 8;
/// Pairs that a thread of the sort moves.
pub const SORT_ROUNDS: u32 = 8;
/// Pairs of a workgroup of the sort.
pub const SORT_BLOCK: u32 = WORKGROUP * SORT_ROUNDS;
/// Words of a block of splats: a count, and a bit for each of its 256.
pub const BLOCK_WORDS: u32 = 1 + WORKGROUP / 32;
/// Words of the counters, see `Counters` in `common.wgsl`.
pub const COUNTER_WORDS: u64 = 5;
/// The first word of the sizes of a dispatch over the splats in view, among those that the GPU finds.
pub const VISIBLE_GROUPS: u32 = 0;
/// Of their sort.
pub const VISIBLE_SORT: u32 = 3;
/// Of the sort of the tile lists' entries.
pub const ENTRY_SORT: u32 = 6;
/// Words of all these.
pub const DISPATCH_WORDS: u64 = 9;
/// Distance of the sky, scene units: WGSL promises no infinity.
pub const FAR_AWAY: f32 = 1e30;

macro_rules! file {
    ($path:literal) => {
        include_str!(concat!("../", $path))
    };
}

/// A program of the GPU.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Program {
    /// Finds the splats in view.
    Cull(ParameterForm),
    /// Their records, with colours through the air.
    Project(ParameterForm, AirText),
    /// The air alone, whose text this is.
    Air(Cow<'static, str>),
    /// Prefix sums over the blocks of splats.
    SpineVisible,
    /// Prefix sums over the splats in view, 256 at a time.
    SpineEntries,
    /// Counts each digit in each block of pairs.
    SortCount,
    /// Prefix sums of that.
    SortScan,
    /// The pairs to their places.
    SortScatter,
    /// Counts or writes the entries of the tile lists.
    Intersect,
    /// Finds the start of each tile's list.
    Ranges,
    /// Blends colour, and what is asked for beside it.
    Rasterize(Geometry, MedianDepth),
    /// Puts the background behind.
    Composite(BackgroundForm, ParticleBlend),
    /// Adds up what falls.
    Fall,
    /// Blends what training asks for, and keeps the sums.
    BlendSums(Channels),
    /// The pictures of these sums.
    Finish(Channels),
    /// Derivatives by sums out of those by pictures.
    BySums(Channels),
    /// From pixels to what they pull on each splat of their tile.
    RasterizeBackward(Channels, Subgroups),
    /// Compares one channel with a photo.
    Similarity,
    /// The derivative of that.
    SimilarityBackward,
    /// That of all that is compared, added up and back through the exposure.
    ColorsBackward,
    /// Depth, normals and coverage against what is believed of each pixel.
    PixelsBackward(Channels),
    /// Mean and spread of inverse depths.
    GridMoments,
    /// The same of patches, and how far they are off.
    Patches,
    /// All of them together.
    PatchTotals,
    /// The derivative of that.
    PatchesBackward,
    /// The sum of inverse depths.
    InverseDepths,
    /// Differences of inverse depths of neighbours.
    SmoothBackward,
    /// The pulls of all tiles together.
    Gather,
    /// From there to gradients.
    ProjectBackward(Channels),
    /// Gradients of another render to those of a step.
    AddGradients,
    /// The splats along them.
    Optimize,
    /// Nearly transparent splats at random.
    Explore,
    /// Moves the optimiser's memory to where splats are now.
    Rearrange,
}

/// The use of subgroups.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Subgroups {
    /// Used if the adapter has subgroups of at least [`MIN_SUBGROUP`] threads.
    #[default]
    Used,
    /// Not even there.
    Unused,
}

/// The form of the parameters of splats.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ParameterForm {
    /// Made ready once, to be rendered often.
    Activated,
    /// As they are stored, and learn.
    Stored,
}

impl ParameterForm {
    fn text(self) -> &'static str {
        match self {
            Self::Activated => file!("stages/project/activated.wgsl"),
            Self::Stored => file!("stages/project/stored.wgsl"),
        }
    }
}

/// The effect of the air on the colour of a splat.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum AirText {
    /// The colour itself: clear air.
    Clear,
    /// The colour through the air of this text.
    Color(Cow<'static, str>),
    /// A share of 1: clear air.
    FullShare,
    /// The share of light that the air of this text lets through.
    Share(Cow<'static, str>),
}

impl AirText {
    /// The program's part for an air.
    #[must_use]
    pub fn new(shading: Shading, air: Option<&WgslSource>) -> Self {
        match (shading, air.map(|air| air.wgsl.clone())) {
            (Shading::Color, None) => Self::Clear,
            (Shading::Color, Some(text)) => Self::Color(text),
            (Shading::Transmittance, None) => Self::FullShare,
            (Shading::Transmittance, Some(text)) => Self::Share(text),
        }
    }
}

/// The form of the background behind the splats.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum BackgroundForm {
    /// One colour.
    Color,
    /// Colours mixed between so many nodes along a side of each patch.
    Nodes(u32),
    /// A picture.
    Picture,
}

impl BackgroundForm {
    /// Every kind.
    pub const ALL: [Self; 4] = [Self::Color, Self::Nodes(4), Self::Nodes(8), Self::Picture];
}

/// The pictures that particles are drawn into.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum ParticleBlend {
    /// There are none.
    #[default]
    None,
    /// Over the colour.
    InColor,
    /// Over the colour, and into a picture of their own.
    Separate,
}

/// The first text of all programs over splats.
const PIECES: &str = file!("stages/project/pieces.wgsl");
/// The first text of programs that compare geometry.
const GEOMETRY: &str = file!("stages/compare/geometry.wgsl");
/// Sums over a workgroup.
const SUMS: &str = file!("stages/compare/sums.wgsl");
/// Every share of light is 1.
const FULL_SHARE: &str = "fn through_air(direction: vec3<f32>, distance: f32, rgb: vec3<f32>) -> vec3<f32> { return vec3<f32>(1.0); }";
/// Clear air: colours stay as they are.
const CLEAR_AIR: &str =
    "fn through_air(direction: vec3<f32>, distance: f32, rgb: vec3<f32>) -> vec3<f32> { return rgb; }";
/// One colour behind everything.
const ONE_COLOR: &str =
    "fn behind(at: u32) -> vec3<f32> { return vec3<f32>(background[0], background[1], background[2]); }";
/// A picture behind it, `[H, W, 3]`.
const PICTURE: &str = "fn behind(at: u32) -> vec3<f32> {
    return vec3<f32>(background[3u * at], background[3u * at + 1u], background[3u * at + 2u]);
}";
/// No particles.
const NOTHING_FALLS: &str = "fn with_falling(at: u32, rgb: vec3<f32>) -> vec3<f32> { return rgb; }";

impl Program {
    /// Every one of them, but for the weather's air: with clear air.
    #[must_use]
    pub fn all() -> Vec<Self> {
        let mut all = vec![
            Self::Cull(ParameterForm::Activated),
            Self::Cull(ParameterForm::Stored),
            Self::Project(ParameterForm::Activated, AirText::Clear),
            Self::Project(ParameterForm::Activated, AirText::FullShare),
            Self::Project(ParameterForm::Stored, AirText::Clear),
            Self::Similarity,
            Self::SimilarityBackward,
            Self::ColorsBackward,
            Self::GridMoments,
            Self::Patches,
            Self::PatchTotals,
            Self::PatchesBackward,
            Self::InverseDepths,
            Self::SmoothBackward,
            Self::Gather,
            Self::AddGradients,
            Self::Optimize,
            Self::Explore,
            Self::Rearrange,
            Self::SpineVisible,
            Self::SpineEntries,
            Self::SortCount,
            Self::SortScan,
            Self::SortScatter,
            Self::Intersect,
            Self::Ranges,
            Self::Fall,
        ];
        for falls in [ParticleBlend::None, ParticleBlend::InColor, ParticleBlend::Separate] {
            all.extend(BackgroundForm::ALL.map(|behind| Self::Composite(behind, falls)));
        }
        for geometry in [Geometry::None, Geometry::Depth, Geometry::DepthNormal] {
            all.extend([MedianDepth::Off, MedianDepth::On].map(|median| Self::Rasterize(geometry, median)));
        }
        for channels in Channels::ALL {
            let of =
                [Self::BlendSums, Self::Finish, Self::PixelsBackward, Self::BySums, Self::ProjectBackward];
            all.extend(of.map(|program| program(channels)));
            let by = [Subgroups::Used, Subgroups::Unused];
            all.extend(by.map(|subgroups| Self::RasterizeBackward(channels, subgroups)));
        }
        all
    }

    /// Its entry point.
    #[must_use]
    pub fn entry(&self) -> &'static str {
        match self {
            Self::Cull(_) => "cull",
            Self::Project(..) => "project_visible",
            Self::Air(_) => "shade_groups",
            Self::SpineVisible => "spine_visible",
            Self::SpineEntries => "spine_entries",
            Self::SortCount => "count",
            Self::SortScan => "scan_digits",
            Self::SortScatter => "scatter",
            Self::Intersect => "intersect",
            Self::Ranges => "ranges",
            Self::Rasterize(..) | Self::BlendSums(_) => "rasterize",
            Self::Composite(..) => "composite",
            Self::Fall => "fall",
            Self::Finish(_) => "finish",
            Self::BySums(_) => "by_sums",
            Self::RasterizeBackward(..) => "rasterize_backward",
            Self::Similarity => "similarity",
            Self::SimilarityBackward => "similarity_backward",
            Self::ColorsBackward => "colors_backward",
            Self::PixelsBackward(_) => "pixels_backward",
            Self::GridMoments => "grid_moments",
            Self::Patches => "patches",
            Self::PatchTotals => "patch_totals",
            Self::PatchesBackward => "patches_backward",
            Self::InverseDepths => "inverse_depths",
            Self::SmoothBackward => "smooth_backward",
            Self::Gather => "gather",
            Self::ProjectBackward(_) => "project_backward",
            Self::AddGradients => "add_gradients",
            Self::Optimize => "optimize",
            Self::Explore => "explore",
            Self::Rearrange => "rearrange",
        }
    }

    /// Its text.
    #[must_use]
    pub fn text(&self) -> String {
        let mut text = constants();
        let mut add = |parts: &[&str]| {
            for part in parts {
                text.push_str(part);
                text.push('\n');
            }
        };
        add(&[file!("gpu/common.wgsl")]);
        match self {
            Self::Cull(form) => {
                add(&[PIECES, form.text(), file!("stages/project/geometry.wgsl")]);
                add(&[file!("stages/project/cull.wgsl")]);
            }
            Self::Project(form, air) => {
                add(&[PIECES, form.text(), file!("stages/project/geometry.wgsl")]);
                add(&[file!("stages/shade/shade.wgsl")]);
                add(&[file!("stages/project/project.wgsl")]);
                match air {
                    AirText::Clear => add(&[CLEAR_AIR]),
                    AirText::FullShare => add(&[FULL_SHARE]),
                    AirText::Color(air) => {
                        add(&[file!("gpu/color.wgsl"), file!("stages/shade/air.wgsl"), air]);
                        add(&[file!("stages/shade/color_through_air.wgsl")]);
                    }
                    AirText::Share(air) => {
                        add(&[file!("stages/shade/air.wgsl"), air]);
                        add(&[file!("stages/shade/share_through_air.wgsl")]);
                    }
                }
            }
            Self::Air(air) => {
                add(&[file!("gpu/color.wgsl"), file!("stages/shade/air.wgsl"), air]);
                add(&[file!("stages/shade/color_through_air.wgsl"), file!("stages/shade/groups.wgsl")]);
            }
            Self::SpineVisible | Self::SpineEntries => {
                add(&[file!("gpu/scan.wgsl"), file!("stages/scan/spine.wgsl")]);
            }
            Self::SortCount | Self::SortScan | Self::SortScatter => {
                add(&[file!("gpu/scan.wgsl"), file!("stages/sort/sort.wgsl")]);
            }
            Self::Intersect => add(&[file!("gpu/scan.wgsl"), file!("stages/intersect/intersect.wgsl")]),
            Self::Ranges => add(&[file!("stages/intersect/ranges.wgsl")]),
            Self::Rasterize(geometry, median) => {
                let channels = match geometry {
                    Geometry::None => Channels::Color,
                    Geometry::Depth => Channels::ColorDepth,
                    Geometry::DepthNormal => Channels::ColorDepthNormal,
                };
                let is_median = *median == MedianDepth::On;
                add(&[
                    &switches(channels),
                    &format!("const KEEPS_SUMS = false;\nconst MEDIAN = {is_median};"),
                ]);
                add(&[file!("stages/rasterize/records.wgsl"), file!("stages/rasterize/rasterize.wgsl")]);
            }
            Self::BlendSums(channels) => {
                add(&[&switches(*channels), "const KEEPS_SUMS = true;\nconst MEDIAN = false;"]);
                add(&[file!("stages/rasterize/pairs.wgsl"), file!("stages/rasterize/rasterize.wgsl")]);
            }
            Self::Composite(behind, falls) => {
                match behind {
                    BackgroundForm::Color => add(&[ONE_COLOR]),
                    BackgroundForm::Nodes(nodes) => {
                        add(&[&format!("const NODES = {nodes}u;"), file!("stages/composite/nodes.wgsl")]);
                    }
                    BackgroundForm::Picture => add(&[PICTURE]),
                }
                match falls {
                    ParticleBlend::None => add(&[NOTHING_FALLS]),
                    ParticleBlend::InColor | ParticleBlend::Separate => {
                        let is_apart = *falls == ParticleBlend::Separate;
                        add(&[&format!("const APART: bool = {is_apart};"), file!("gpu/color.wgsl")]);
                        add(&[file!("stages/particles/over.wgsl")]);
                    }
                }
                add(&[file!("stages/composite/composite.wgsl")]);
            }
            Self::Fall => add(&[file!("stages/particles/fall.wgsl")]),
            Self::Finish(channels) => {
                add(&[
                    &switches(*channels),
                    file!("gpu/training.wgsl"),
                    file!("stages/composite/finish.wgsl"),
                ]);
            }
            Self::BySums(channels) => {
                add(&[&switches(*channels), file!("gpu/training.wgsl")]);
                add(&[file!("stages/rasterize_backward/upstream.wgsl")]);
            }
            Self::RasterizeBackward(channels, subgroups) => {
                add(&[&switches(*channels), file!("stages/rasterize_backward/rasterize_backward.wgsl")]);
                add(&[match subgroups {
                    Subgroups::Used => file!("stages/rasterize_backward/subgroups.wgsl"),
                    Subgroups::Unused => file!("stages/rasterize_backward/shared.wgsl"),
                }]);
            }
            Self::Similarity => {
                add(&[file!("stages/compare/photo.wgsl"), file!("stages/compare/windows.wgsl")]);
                add(&[file!("stages/compare/similarity.wgsl")]);
            }
            Self::SimilarityBackward => {
                add(&[file!("stages/compare/photo.wgsl"), file!("stages/compare/windows.wgsl")]);
                add(&[file!("stages/compare/similarity_backward.wgsl")]);
            }
            Self::ColorsBackward => {
                add(&[file!("stages/compare/photo.wgsl"), SUMS]);
                add(&[file!("stages/compare/colors_backward.wgsl")]);
            }
            Self::PixelsBackward(channels) => {
                add(&[&switches(*channels), GEOMETRY, file!("stages/compare/beliefs.wgsl")]);
                add(&[SUMS, file!("stages/compare/pixels_backward.wgsl")]);
            }
            Self::GridMoments => {
                add(&[GEOMETRY, file!("stages/compare/beliefs.wgsl"), file!("stages/compare/grid.wgsl")]);
                add(&[file!("stages/compare/moments.wgsl"), file!("stages/compare/grid_moments.wgsl")]);
            }
            Self::Patches => {
                add(&[GEOMETRY, file!("stages/compare/beliefs.wgsl"), file!("stages/compare/grid.wgsl")]);
                add(&[file!("stages/compare/moments.wgsl"), file!("stages/compare/patch.wgsl")]);
                add(&[SUMS, file!("stages/compare/patches.wgsl")]);
            }
            Self::PatchTotals => add(&[GEOMETRY, SUMS, file!("stages/compare/patch_totals.wgsl")]),
            Self::PatchesBackward => {
                add(&[GEOMETRY, file!("stages/compare/beliefs.wgsl"), file!("stages/compare/grid.wgsl")]);
                add(&[file!("stages/compare/patch.wgsl"), SUMS]);
                add(&[file!("stages/compare/patches_backward.wgsl")]);
            }
            Self::InverseDepths => add(&[GEOMETRY, SUMS, file!("stages/compare/inverse_depths.wgsl")]),
            Self::SmoothBackward => add(&[GEOMETRY, SUMS, file!("stages/compare/smooth_backward.wgsl")]),
            Self::Gather => add(&[file!("stages/project_backward/gather.wgsl")]),
            Self::ProjectBackward(channels) => {
                add(&[&switches(*channels), PIECES, ParameterForm::Stored.text()]);
                add(&[file!("stages/project/geometry.wgsl")]);
                add(&[file!("stages/shade/shade.wgsl"), file!("stages/shade_backward/shade_backward.wgsl")]);
                add(&[file!("stages/project_backward/project_backward.wgsl")]);
            }
            Self::AddGradients => add(&[PIECES, file!("stages/optimize/add.wgsl")]),
            Self::Optimize => add(&[PIECES, file!("stages/optimize/optimize.wgsl")]),
            Self::Explore => add(&[PIECES, file!("stages/optimize/explore.wgsl")]),
            Self::Rearrange => add(&[file!("stages/optimize/rearrange.wgsl")]),
        }
        text
    }
}

/// The switches of the blended sums, as WGSL.
fn switches(channels: Channels) -> String {
    let (color, depth, normal) = (channels.has_color(), channels.depth().is_some(), channels.has_normal());
    format!("const COLOR = {color};\nconst DEPTH = {depth};\nconst NORMAL = {normal};")
}

/// The constants that Rust and WGSL share, as WGSL.
#[must_use]
pub fn constants() -> String {
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
        SPLAT_ROWS = splats::ROWS;
        ROW_MEAN = splats::ROW_MEAN;
        ROW_QUAT = splats::ROW_QUAT;
        ROW_SCALE = splats::ROW_SCALE;
        ROW_OPACITY = splats::ROW_OPACITY;
        ROW_DC = splats::ROW_DC;
        ROW_SKY = splats::ROW_SKY;
        SLOT_S = Slot::S;
        SLOT_SU = Slot::SU;
        SLOT_SV = Slot::SV;
        SLOT_SUU = Slot::SUU;
        SLOT_ABS_X = Slot::ABS_X;
        SLOT_ABS_Y = Slot::ABS_Y;
        SLOT_WEIGHT = Slot::WEIGHT;
        SLOT_FEATURES = Slot::FEATURES;
        WINDOW_RADIUS = compare::RADIUS;
        COMPARE_GROUPS = compare::gpu::GROUPS;
        PATCH_FEWEST = compare::FEWEST;
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
        LN_2 = std::f32::consts::LN_2;
        DILATION = project::DILATION;
        MIN_COMPENSATION = project::MIN_COMPENSATION;
        LOG2_MIN_ALPHA = project::LOG2_MIN_ALPHA;
        TEST_SLACK = project::TEST_SLACK;
        SQRT_HALF_LOG2E = project::SQRT_HALF_LOG2E;
        MAX_DET = project::MAX_DET;
        LOG2_MAX_ALPHA = rasterize::LOG2_MAX_ALPHA;
        MIN_TRANSMITTANCE = rasterize::MIN_TRANSMITTANCE;
        FRAME_MIN_ALPHA = frame::MIN_ALPHA;
        STEPS = particles::STEPS;
        LOG2E = std::f32::consts::LOG2_E;
        PI = std::f32::consts::PI;
        BETA1 = optimize::BETA1;
        BETA2 = optimize::BETA2;
        SIMILARITY_C1 = compare::C1;
        SIMILARITY_C2 = compare::C2;
        COVERED = compare::COVERED;
        EXACT = compare::EXACT;
        PATCH_FLOOR = compare::FLOOR;
        EDGE = compare::EDGE;
        ADAM_EPS = optimize::EPS;
        FLAT = optimize::FLAT;
        C0 = sh::C0;
        C1 = sh::C1;
    }
    for (column, attribute) in Attribute::ALL.iter().enumerate() {
        let _ = writeln!(text, "const {}: u32 = {column}u;", attribute.wgsl_name());
    }
    let window = compare::WINDOW.map(f64::from);
    for (name, values) in [("C2", &sh::C2[..]), ("C3", &sh::C3[..]), ("WINDOW", &window[..])] {
        let numbers: Vec<String> = values.iter().map(|v| format!("{v:e}")).collect();
        let (count, numbers) = (values.len(), numbers.join(", "));
        let _ = writeln!(text, "const {name} = array<f32, {count}>({numbers});");
    }
    text
}

#[cfg(test)]
mod tests;
