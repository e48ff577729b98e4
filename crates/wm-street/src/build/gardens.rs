//! Front gardens, hedges and trees.

use super::builder::{Builder, Frame, faces};
use super::houses::PORCH;
use super::lots::{PAVEMENT_EDGE_M, PLOT_HEIGHT_M, left, right};
use super::palette::Palette;
use super::tree::tree;
use super::{fences as f, growth as g, species};
use crate::paint::PaintId;
use glam::{DVec2, DVec3};

/// Gardens, from the near to the far ones.
pub(super) fn build(b: &mut Builder, p: &Palette) {
    // A walled yard between the first two houses on the left.
    let at = left(10.2);
    f::low_wall(b, &at.moved(0.0, 0.1, 0.0), 3.9, 1.75, p.brick, p);
    g::climber(b, &at.moved(2.2, 0.1, 0.0), 0.0, (1.5, 2.0), p.ivy, 50);
    // The cottage's front garden.
    let at = left(14.2);
    f::low_wall(b, &at.moved(0.0, 0.06, 0.0), 3.1, 0.55, p.plinth, p);
    f::low_wall(b, &at.moved(4.5, 0.06, 0.0), 5.5, 0.55, p.plinth, p);
    for x in [3.1, 4.5] {
        f::pillar(b, &at.moved(x, 0.0, 0.0), 0.95, p.plinth, p);
    }
    path(b, &at, 3.2, 4.4, 0.0, 2.6, p.slabs);
    g::flowers(b, &at.moved(0.2, 0.5, 0.05), [2.8, 1.2, 0.40], 900, p, 51);
    g::flowers(b, &at.moved(4.9, 0.5, 0.05), [4.8, 0.9, 0.35], 1300, p, 52);
    g::climber(b, &at.moved(8.9, 2.6, 0.0), 0.0, (1.0, 3.2), p.ivy, 53);
    // Hedge and lawn before the porch house, a picket fence along the pavement.
    let at = left(46.0);
    f::pickets(b, &at.moved(-9.4, 0.12, 0.0), 19.6, Some((12.3, 13.6)), p.white);
    path(b, &at, 2.95, 4.15, 0.0, 6.2 - PORCH.depth - 0.6, p.slabs);
    g::flowers(b, &at.moved(0.5, 3.35, 0.02), [2.0, 0.5, 0.45], 420, p, 54);
    g::flowers(b, &at.moved(4.6, 3.35, 0.02), [2.0, 0.5, 0.45], 420, p, 55);
    let side = Frame::facing(at.at(10.0, 6.3, 0.0), at.right);
    g::hedge(b, &side, [6.0, 0.7, 1.25], 0.115, p, 56);
    // Right: a hedge in the sunny gap, railings before the white house.
    let at = right(37.6);
    g::hedge(b, &at.moved(0.2, 0.15, 0.0), [8.4, 0.75, 1.45], 0.115, p, 57);
    let at = right(50.0);
    f::low_wall(b, &at.moved(0.0, 0.05, 0.0), 6.2, 0.35, p.brick, p);
    f::railings(b, &at.moved(0.0, 0.17, 0.0), 6.2, 0.42, 1.05, p.iron);
    f::low_wall(b, &at.moved(7.6, 0.05, 0.0), 3.4, 0.35, p.brick, p);
    f::railings(b, &at.moved(7.6, 0.17, 0.0), 3.4, 0.42, 1.05, p.iron);
    path(b, &at, 6.3, 7.5, 0.0, 2.4, p.gravel);
    g::flowers(b, &at.moved(0.3, 0.5, 0.02), [5.6, 1.1, 0.45], 1000, p, 58);
    // Gaps farther on: walls and hedges, coarser.
    g::hedge(b, &left(57.2).moved(0.0, 0.1, 0.0), [3.6, 0.6, 1.5], 0.14, p, 59);
    f::low_wall(b, &left(83.6).moved(0.0, 0.1, 0.0), 3.3, 1.6, p.plinth, p);
    g::hedge(b, &right(71.4).moved(0.0, 0.2, 0.0), [7.8, 0.7, 1.5], 0.14, p, 60);
    f::low_wall(b, &right(18.9).moved(0.0, 0.1, 0.0), 3.1, 1.9, p.brown_brick, p);
    for (index, (x0, y0, x1, y1)) in [
        (-PAVEMENT_EDGE_M - 0.02, 37.0, -PAVEMENT_EDGE_M - 0.02, 46.0),
        (-PAVEMENT_EDGE_M - 0.02, 49.0, -PAVEMENT_EDGE_M - 0.02, 56.0),
        (PAVEMENT_EDGE_M + 0.05, 29.2, PAVEMENT_EDGE_M + 0.05, 37.2),
        (-PAVEMENT_EDGE_M + 0.0, 14.4, -PAVEMENT_EDGE_M + 0.0, 24.0),
        (-PAVEMENT_EDGE_M - 2.5, 38.0, -PAVEMENT_EDGE_M - 2.0, 56.0),
    ]
    .into_iter()
    .enumerate()
    {
        let (from, to) = (DVec3::new(x0, y0, PLOT_HEIGHT_M), DVec3::new(x1, y1, PLOT_HEIGHT_M));
        let wide = if index == 4 { 0.9 } else { 0.07 };
        g::tufts(b, from, to, wide, 26.0, 0.13, p.blade, 70 + index as u64);
    }
}

/// A path through a front garden, a little above the lawn.
fn path(b: &mut Builder, at: &Frame, x0: f64, x1: f64, y0: f64, y1: f64, paint: PaintId) {
    b.block(at, [x0, y0, -0.05], [x1, y1, 0.02], paint, faces::TOP | faces::LEFT | faces::RIGHT);
}

/// Trees along the street and behind the houses.
pub(super) fn trees(b: &mut Builder, p: &Palette) {
    let (linden, birch, rowan) = (species::linden(p), species::birch(p), species::rowan(p));
    let far = species::far;
    for (seed, (x, y, kind)) in [
        (-9.2, 40.6, linden),
        (-8.0, 12.2, birch),
        (-7.3, 51.2, rowan),
        (8.6, 33.2, birch),
        (10.6, 30.6, birch),
        (-6.75, 22.6, rowan),
        (6.5, 41.2, rowan),
        (8.9, 67.2, linden),
        (-8.6, 58.8, far(birch)),
        (-9.6, 85.3, far(linden)),
        (9.4, 83.0, far(birch)),
        (-19.5, 29.0, far(linden)),
        (17.5, 37.5, far(linden)),
        (-19.0, 13.0, far(linden)),
        (18.5, 17.5, far(linden)),
        (-8.5, 112.5, far(linden)),
        (8.0, 110.4, far(linden)),
    ]
    .into_iter()
    .enumerate()
    {
        tree(b, DVec3::new(x, y, PLOT_HEIGHT_M - 0.03), &kind, 200 + seed as u64);
    }
    for (low, high, z, count, seed) in [
        ([-3.0, 36.0], [-2.2, 46.0], 0.0, 260, 301),
        ([-5.2, 35.0], [-3.2, 46.0], PLOT_HEIGHT_M, 260, 302),
        ([2.1, 28.0], [3.0, 38.0], 0.0, 260, 303),
        ([3.2, 28.0], [5.2, 38.0], PLOT_HEIGHT_M, 260, 304),
        ([-5.2, 8.0], [-2.3, 16.0], 0.0, 120, 305),
        ([-11.5, 36.5], [-6.0, 45.0], PLOT_HEIGHT_M, 380, 306),
    ] {
        let [low, high] = [low, high].map(DVec2::from_array);
        g::fallen(b, low, high, |_| z, count, p.fallen, seed);
    }
}
