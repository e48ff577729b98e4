//! Paints that many things share.

use super::Builder;
use super::facade::Finish;
use crate::paint::{Material, PaintId};

/// Paints that many things share.
#[derive(Clone, Copy, Debug)]
pub(super) struct Palette {
    pub(crate) asphalt: PaintId,
    pub(crate) setts: PaintId,
    pub(crate) slabs: PaintId,
    pub(crate) stone: PaintId,
    pub(crate) plinth: PaintId,
    pub(crate) grass: PaintId,
    pub(crate) soil: PaintId,
    pub(crate) gravel: PaintId,
    pub(crate) white: PaintId,
    pub(crate) glass: PaintId,
    pub(crate) brick: PaintId,
    pub(crate) brown_brick: PaintId,
    pub(crate) clay: PaintId,
    pub(crate) brown_tiles: PaintId,
    pub(crate) slate: PaintId,
    pub(crate) iron: PaintId,
    pub(crate) zinc: PaintId,
    pub(crate) green_metal: PaintId,
    pub(crate) lantern: PaintId,
    pub(crate) terracotta: PaintId,
    pub(crate) pole: PaintId,
    pub(crate) deck: PaintId,
    pub(crate) oak: PaintId,
    pub(crate) bark: PaintId,
    pub(crate) birch: PaintId,
    pub(crate) linden: PaintId,
    pub(crate) birch_leaf: PaintId,
    pub(crate) rowan: PaintId,
    pub(crate) berries: PaintId,
    pub(crate) hedge: PaintId,
    pub(crate) core: PaintId,
    pub(crate) ivy: PaintId,
    pub(crate) blade: PaintId,
    pub(crate) flowers: PaintId,
    pub(crate) fallen: PaintId,
    pub(crate) apples: PaintId,
    pub(crate) pears: PaintId,
    pub(crate) cast_iron: PaintId,
    pub(crate) slot: PaintId,
    pub(crate) tyre: PaintId,
    pub(crate) sign_red: PaintId,
    pub(crate) sign_blue: PaintId,
}

impl Palette {
    pub(super) fn new(b: &mut Builder) -> Self {
        use Material as M;
        Self {
            asphalt: b.paint(M::Asphalt, 0x6F6E6C, 0x77726A),
            setts: b.paint(M::Cobbles, 0x8A857D, 0x4A463F),
            slabs: b.paint(M::Paving, 0xA39D92, 0x5E594F),
            stone: b.paint(M::Stone, 0xB4AFA4, 0x8C877C),
            plinth: b.paint(M::Stone, 0x8E8A82, 0x6C6860),
            grass: b.paint(M::Grass, 0x65784A, 0x878C55),
            soil: b.paint(M::Soil, 0x5A4636, 0x3C2F25),
            gravel: b.paint(M::Gravel, 0xB5A88F, 0x7C7160),
            white: b.paint(M::Timber, 0xE9E6DD, 0xC8C4B8),
            glass: b.paint(M::Glass, 0xE6E0D2, 0x202428),
            brick: b.paint(M::Brick, 0x99604B, 0xB3A898),
            brown_brick: b.paint(M::Brick, 0x967055, 0xB6AC9A),
            clay: b.paint(M::Tiles, 0x8E6452, 0x7D7A52),
            brown_tiles: b.paint(M::Tiles, 0x785C4E, 0x6E6C50),
            slate: b.paint(M::Slates, 0x626A73, 0x8A8E7C),
            iron: b.paint(M::Metal, 0x2C3231, 0x2C3231),
            zinc: b.paint(M::Metal, 0x8E9598, 0x8E9598),
            green_metal: b.paint(M::Metal, 0x2F4A3C, 0x2F4A3C),
            lantern: b.paint(M::Metal, 0xEDE7D6, 0xEDE7D6),
            terracotta: b.paint(M::Stone, 0xB0704E, 0x8C573C),
            pole: b.paint(M::Bark, 0x6D6154, 0x6D6154),
            deck: b.paint(M::Timber, 0x94826C, 0x7A6A57),
            oak: b.paint(M::Timber, 0x7A5A3E, 0x5F4530),
            bark: b.paint(M::Bark, 0x6B5D4E, 0x66703F),
            birch: b.paint(M::Birch, 0xDAD5CA, 0x2E2A27),
            linden: b.paint(M::Leaf, 0x5C7838, 0x8E9242),
            birch_leaf: b.paint(M::Leaf, 0x7E8F40, 0xBFA346),
            rowan: b.paint(M::Leaf, 0x577440, 0xA08444),
            berries: b.paint(M::Petal, 0xB8482A, 0xC8602F),
            hedge: b.paint(M::Leaf, 0x4C6634, 0x6A7A40),
            core: b.paint(M::Leaf, 0x1C2712, 0x1C2712),
            ivy: b.paint(M::Leaf, 0x47682F, 0x9C4A2C),
            blade: b.paint(M::Blade, 0x66853A, 0x9A9A4E),
            flowers: b.paint(M::Petal, 0xC83A52, 0xE8B8C4),
            fallen: b.paint(M::Leaf, 0xA67C34, 0x8A4F26),
            apples: b.paint(M::Petal, 0xA83A2C, 0xC08A3A),
            pears: b.paint(M::Petal, 0x98A446, 0xB8B060),
            cast_iron: b.paint(M::Metal, 0x5C5A57, 0x5C5A57),
            slot: b.paint(M::Metal, 0x1A1A1A, 0x1A1A1A),
            tyre: b.paint(M::Metal, 0x252424, 0x252424),
            sign_red: b.paint(M::Metal, 0xA5302B, 0xA5302B),
            sign_blue: b.paint(M::Metal, 0x2C4F8C, 0x2C4F8C),
        }
    }

    /// A house's finish with walls and door of the given paints.
    pub(super) fn finish(&self, wall: PaintId, door: PaintId) -> Finish {
        Finish {
            wall,
            plinth: self.plinth,
            stone: self.stone,
            frame: self.white,
            glass: self.glass,
            door,
            metal: self.zinc,
        }
    }
}
