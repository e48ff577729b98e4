//! Paints that many things share.

use super::builder::Builder;
use super::facade::Finish;
use crate::paint::{Material, PaintId};

/// Declares a set of paints: a name, its material, colour and accent a line.
macro_rules! paints {
    ($(#[$meta:meta])* $set:ident { $($(#[$doc:meta])* $name:ident: $material:ident, $color:literal, $accent:literal;)* }) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug)]
        pub(super) struct $set {
            $($(#[$doc])* pub(crate) $name: PaintId,)*
        }

        impl $set {
            pub(super) fn new(b: &mut Builder) -> Self {
                Self { $($name: b.paint(Material::$material, $color, $accent),)* }
            }
        }
    };
}
pub(super) use paints;

paints! {
    /// Paints that many things share.
    Palette {
        asphalt: Asphalt, 0x6F6E6C, 0x77726A;
        setts: Cobbles, 0x8A857D, 0x4A463F;
        slabs: Paving, 0xA39D92, 0x5E594F;
        stone: Stone, 0xB4AFA4, 0x8C877C;
        plinth: Stone, 0x8E8A82, 0x6C6860;
        grass: Grass, 0x65784A, 0x878C55;
        soil: Soil, 0x5A4636, 0x3C2F25;
        gravel: Gravel, 0xB5A88F, 0x7C7160;
        white: Timber, 0xE9E6DD, 0xC8C4B8;
        glass: Glass, 0xE6E0D2, 0x202428;
        brick: Brick, 0x99604B, 0xB3A898;
        brown_brick: Brick, 0x967055, 0xB6AC9A;
        clay: Tiles, 0x8E6452, 0x7D7A52;
        brown_tiles: Tiles, 0x785C4E, 0x6E6C50;
        slate: Slates, 0x626A73, 0x8A8E7C;
        iron: Metal, 0x2C3231, 0x2C3231;
        zinc: Metal, 0x8E9598, 0x8E9598;
        green_metal: Metal, 0x2F4A3C, 0x2F4A3C;
        lantern: Metal, 0xEDE7D6, 0xEDE7D6;
        terracotta: Stone, 0xB0704E, 0x8C573C;
        pole: Bark, 0x6D6154, 0x6D6154;
        deck: Timber, 0x94826C, 0x7A6A57;
        oak: Timber, 0x7A5A3E, 0x5F4530;
        bark: Bark, 0x6B5D4E, 0x66703F;
        birch: Birch, 0xDAD5CA, 0x2E2A27;
        linden: Leaf, 0x5C7838, 0x8E9242;
        birch_leaf: Leaf, 0x7E8F40, 0xBFA346;
        rowan: Leaf, 0x577440, 0xA08444;
        berries: Petal, 0xB8482A, 0xC8602F;
        hedge: Leaf, 0x4C6634, 0x6A7A40;
        core: Leaf, 0x1C2712, 0x1C2712;
        ivy: Leaf, 0x47682F, 0x9C4A2C;
        blade: Blade, 0x66853A, 0x9A9A4E;
        flowers: Petal, 0xC83A52, 0xE8B8C4;
        fallen: Leaf, 0xA67C34, 0x8A4F26;
        apples: Petal, 0xA83A2C, 0xC08A3A;
        pears: Petal, 0x98A446, 0xB8B060;
        cast_iron: Metal, 0x5C5A57, 0x5C5A57;
        slot: Metal, 0x1A1A1A, 0x1A1A1A;
        tyre: Metal, 0x252424, 0x252424;
        sign_red: Metal, 0xA5302B, 0xA5302B;
        sign_blue: Metal, 0x2C4F8C, 0x2C4F8C;
    }
}

impl Palette {
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
