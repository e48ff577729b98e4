//! The kinds of trees and bushes.

use super::palette::Palette;
use super::tree::Kind;
use crate::paint::PaintId;

/// A kind by its height, base, radius, share of the height at which it is widest, and trunk; its
/// clusters and leaves in each; the length of a leaf and the droop of twigs.
fn kind(
    sizes: [f64; 5],
    counts: [u32; 2],
    twigs: [f64; 2],
    bark: PaintId,
    foliage: PaintId,
    fruit: Option<PaintId>,
) -> Kind {
    let ([height, base, radius, widest, trunk], [clusters, leaves], [leaf, droop]) = (sizes, counts, twigs);
    Kind { height, base, radius, widest, trunk, clusters, leaves, leaf, droop, bark, foliage, fruit }
}

/// A lime tree: broad, dense, of streets.
pub(super) fn linden(p: &Palette) -> Kind {
    kind([9.2, 2.5, 3.3, 0.38, 0.19], [150, 96], [0.135, 0.12], p.bark, p.linden, None)
}

/// A birch: slender, with hanging twigs.
pub(super) fn birch(p: &Palette) -> Kind {
    kind([10.5, 2.6, 2.3, 0.30, 0.13], [95, 92], [0.105, 0.75], p.birch, p.birch_leaf, None)
}

/// A rowan: small, with berries.
pub(super) fn rowan(p: &Palette) -> Kind {
    kind([5.2, 1.7, 1.75, 0.45, 0.085], [52, 84], [0.11, 0.2], p.bark, p.rowan, Some(p.berries))
}

/// An oak in the open: as broad as it is high.
pub(super) fn oak(p: &Palette) -> Kind {
    kind([13.0, 2.8, 5.6, 0.42, 0.36], [130, 48], [0.27, 0.1], p.bark, p.hedge, None)
}

/// A spruce: a cone of dark `needles`, down to the ground.
pub(super) fn spruce(p: &Palette, needles: PaintId) -> Kind {
    kind([13.5, 0.7, 2.5, 0.10, 0.20], [120, 42], [0.25, 0.55], p.bark, needles, None)
}

/// A willow: a wide crown whose twigs hang towards the water.
pub(super) fn willow(p: &Palette) -> Kind {
    kind([8.5, 1.5, 4.2, 0.45, 0.30], [120, 48], [0.23, 1.0], p.bark, p.birch_leaf, None)
}

/// A bush of a man's height, leaves down to the ground.
pub(super) fn bush(p: &Palette) -> Kind {
    kind([1.9, 0.15, 1.3, 0.4, 0.05], [34, 36], [0.15, 0.15], p.bark, p.hedge, None)
}

/// Reduces a tree for a place that nobody comes near to: fewer and larger leaves.
pub(super) fn far(kind: Kind) -> Kind {
    Kind { clusters: kind.clusters / 2, leaves: 28, leaf: kind.leaf * 2.1, ..kind }
}
