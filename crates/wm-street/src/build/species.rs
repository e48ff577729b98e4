//! The kinds of trees and bushes.

use super::palette::Palette;
use super::tree::Kind;
use crate::paint::PaintId;

/// A lime tree: broad, dense, of streets.
pub(super) fn linden(p: &Palette) -> Kind {
    Kind {
        height: 9.2,
        base: 2.5,
        radius: 3.3,
        widest: 0.38,
        trunk: 0.19,
        clusters: 150,
        leaves: 96,
        leaf: 0.135,
        droop: 0.12,
        bark: p.bark,
        foliage: p.linden,
        fruit: None,
    }
}

/// A birch: slender, with hanging twigs.
pub(super) fn birch(p: &Palette) -> Kind {
    Kind {
        height: 10.5,
        base: 2.6,
        radius: 2.3,
        widest: 0.30,
        trunk: 0.13,
        clusters: 95,
        leaves: 92,
        leaf: 0.105,
        droop: 0.75,
        bark: p.birch,
        foliage: p.birch_leaf,
        fruit: None,
    }
}

/// A rowan: small, with berries.
pub(super) fn rowan(p: &Palette) -> Kind {
    Kind {
        height: 5.2,
        base: 1.7,
        radius: 1.75,
        widest: 0.45,
        trunk: 0.085,
        clusters: 52,
        leaves: 84,
        leaf: 0.11,
        droop: 0.2,
        bark: p.bark,
        foliage: p.rowan,
        fruit: Some(p.berries),
    }
}

/// An oak in the open: as broad as it is high.
pub(super) fn oak(p: &Palette) -> Kind {
    Kind {
        height: 13.0,
        base: 2.8,
        radius: 5.6,
        widest: 0.42,
        trunk: 0.36,
        clusters: 130,
        leaves: 48,
        leaf: 0.27,
        droop: 0.1,
        bark: p.bark,
        foliage: p.hedge,
        fruit: None,
    }
}

/// A spruce: a cone of dark `needles`, down to the ground.
pub(super) fn spruce(p: &Palette, needles: PaintId) -> Kind {
    Kind {
        height: 13.5,
        base: 0.7,
        radius: 2.5,
        widest: 0.10,
        trunk: 0.20,
        clusters: 120,
        leaves: 42,
        leaf: 0.25,
        droop: 0.55,
        bark: p.bark,
        foliage: needles,
        fruit: None,
    }
}

/// A willow: a wide crown whose twigs hang towards the water.
pub(super) fn willow(p: &Palette) -> Kind {
    Kind {
        height: 8.5,
        base: 1.5,
        radius: 4.2,
        widest: 0.45,
        trunk: 0.30,
        clusters: 120,
        leaves: 48,
        leaf: 0.23,
        droop: 1.0,
        bark: p.bark,
        foliage: p.birch_leaf,
        fruit: None,
    }
}

/// A bush of a man's height, leaves down to the ground.
pub(super) fn bush(p: &Palette) -> Kind {
    Kind {
        height: 1.9,
        base: 0.15,
        radius: 1.3,
        widest: 0.4,
        trunk: 0.05,
        clusters: 34,
        leaves: 36,
        leaf: 0.15,
        droop: 0.15,
        bark: p.bark,
        foliage: p.hedge,
        fruit: None,
    }
}

/// Reduces a tree for a place that nobody comes near to: fewer and larger leaves.
pub(super) fn far(kind: Kind) -> Kind {
    Kind { clusters: kind.clusters / 2, leaves: 28, leaf: kind.leaf * 2.1, ..kind }
}
