//! The materials of surfaces.

use glam::DVec3;

/// The material of a surface, for weather and masks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Material {
    /// The carriageway.
    Asphalt,
    /// Small square setts: gutters, drives.
    Cobbles,
    /// Concrete slabs: pavements, paths.
    Paving,
    /// Cut stone: kerbs, sills, plinths, steps.
    Stone,
    /// Lawns and verges.
    Grass,
    /// Flower beds.
    Soil,
    /// Gravel.
    Gravel,
    /// Paths of crushed stone.
    Grit,
    /// Fields beyond the street.
    Field,
    /// Wooded hills, far trees.
    Wood,
    /// Rendered walls.
    Plaster,
    /// Brickwork.
    Brick,
    /// Horizontal boards.
    Boards,
    /// Painted wood: frames, doors, fences, beams.
    Timber,
    /// Clay roof tiles.
    Tiles,
    /// Slates.
    Slates,
    /// Window panes.
    Glass,
    /// Painted or bare metal.
    Metal,
    /// Striped cloth.
    Cloth,
    /// Trunks and branches.
    Bark,
    /// White bark of birches.
    Birch,
    /// Leaves of trees, hedges and climbers.
    Leaf,
    /// Blades of grass.
    Blade,
    /// Petals and berries.
    Petal,
    /// Still water.
    Water,
    /// Lawns of parks: clover, dry patches, blades.
    Meadow,
}

impl Material {
    /// Thin growth that light shines through and that is seen from both sides.
    #[must_use]
    pub fn is_foliage(self) -> bool {
        matches!(self, Self::Leaf | Self::Blade | Self::Petal | Self::Wood)
    }

    /// The label of a surface of this material where nothing says otherwise.
    pub(super) fn label(self) -> Label {
        match self {
            Self::Grass | Self::Meadow | Self::Soil | Self::Field => Label::Lawn,
            Self::Asphalt | Self::Cobbles | Self::Paving | Self::Gravel | Self::Grit => Label::Path,
            Self::Water => Label::Water,
            Self::Wood | Self::Bark | Self::Birch | Self::Leaf | Self::Blade | Self::Petal => Label::Plant,
            Self::Stone
            | Self::Plaster
            | Self::Brick
            | Self::Boards
            | Self::Tiles
            | Self::Slates
            | Self::Glass => Label::Building,
            Self::Timber | Self::Metal | Self::Cloth => Label::Object,
        }
    }

    /// Returns true if its primitives are sheets without an inside.
    pub(super) fn is_sheet(self) -> bool {
        self.is_foliage() || self == Self::Cloth
    }

    pub(super) fn is_bark(self) -> bool {
        matches!(self, Self::Bark | Self::Birch)
    }

    /// The largest distance between its splats, relative to the finest texture.
    pub(super) fn grain(self) -> f64 {
        match self {
            Self::Asphalt | Self::Field => 1.8,
            Self::Grass | Self::Meadow | Self::Soil => 1.45,
            Self::Plaster | Self::Glass => 1.45,
            Self::Slates | Self::Gravel | Self::Grit | Self::Paving => 1.2,
            Self::Tiles | Self::Brick => 1.1,
            _ => 1.0,
        }
    }
}

/// The kind of thing that a surface belongs to, for truth masks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Label {
    /// Ground with something growing on it: lawns, verges, flower beds, fields.
    Lawn,
    /// Ground that is walked or driven on.
    Path,
    /// Water.
    Water,
    /// Trees, bushes, hedges, flowers.
    Plant,
    /// Houses, walls, sheds.
    Building,
    /// Lamps, benches, fences, bicycles.
    Object,
    /// People and cars that pass.
    Mover,
}

impl Label {
    /// Every label; its place in the list is its number in files, counted from 1, with 0 for the
    /// sky.
    pub const ALL: [Self; 7] =
        [Self::Lawn, Self::Path, Self::Water, Self::Plant, Self::Building, Self::Object, Self::Mover];

    /// The name in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Lawn => "lawn",
            Self::Path => "path",
            Self::Water => "water",
            Self::Plant => "plant",
            Self::Building => "building",
            Self::Object => "object",
            Self::Mover => "mover",
        }
    }

    /// Returns true for what one can stand on.
    #[must_use]
    pub fn is_ground(self) -> bool {
        matches!(self, Self::Lawn | Self::Path)
    }
}

/// A material with its colours.
#[derive(Clone, Copy, Debug)]
pub(super) struct Paint {
    pub(crate) material: Material,
    /// Main colour, linear albedo.
    pub(crate) color: DVec3,
    /// The other colour: mortar, stripes, flowers, yellowed leaves; linear albedo.
    pub(crate) accent: DVec3,
    /// Key of the pattern.
    pub(crate) seed: u32,
}

/// The place of a paint in the list.
pub(super) type PaintId = u16;

/// Linear value of an sRGB-encoded one, 0-1.
fn linear_of(encoded: f64) -> f64 {
    if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

/// The linear colour of an sRGB `0xRRGGBB`.
pub(super) fn rgb(hex: u32) -> DVec3 {
    DVec3::new(f64::from(hex >> 16 & 255), f64::from(hex >> 8 & 255), f64::from(hex & 255))
        .map(|v| linear_of(v / 255.0))
}
