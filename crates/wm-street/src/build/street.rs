//! The plan of the street: what stands where.
//!
//! The carriageway runs along y with its middle at x = 0, from behind the first houses to the
//! church. From the middle outwards: asphalt, a gutter of setts, the kerb, the pavement, then
//! plots. A plot's frame has its origin on the pavement's outer edge, x to the right and y away
//! from the street.

use super::builder::{Builder, Frame};
use super::houses::{PORCH, porch_frame};
use super::lots::{PAVEMENT_EDGE_M, PLOT_HEIGHT_M, left, right};
use super::palette::Palette;
use super::{far, furniture as f, gardens, growth as g, houses, props};
use crate::paint::{Label, Material, PaintId};
use glam::{DVec2, DVec3};

/// Half the width of the asphalt, m.
const ROAD_HALF_WIDTH_M: f64 = 2.75;
/// From the middle to the face of the kerb, m.
const KERB_DISTANCE_M: f64 = 3.05;
/// The street's ends along y, m.
const STREET_ENDS_M: (f64, f64) = (-45.0, 135.0);

/// Builds the street.
pub(crate) fn build(b: &mut Builder) {
    let p = Palette::new(b);
    ground(b, &p);
    b.labelled(Label::Building, |b| houses::build(b, &p));
    gardens::build(b, &p);
    gardens::trees(b, &p);
    furniture(b, &p);
    let (low, high) = (DVec2::new(-45.0, STREET_ENDS_M.0), DVec2::new(45.0, STREET_ENDS_M.1));
    let rows = [
        (DVec2::new(-40.0, -20.0), DVec2::new(-42.0, 130.0), 12, 8.0),
        (DVec2::new(42.0, -20.0), DVec2::new(40.0, 130.0), 12, 8.0),
        (DVec2::new(-30.0, -70.0), DVec2::new(30.0, -66.0), 9, 9.0),
    ];
    far::build(b, &p, low, high, &rows);
}

fn ground(b: &mut Builder, p: &Palette) {
    let (y0, y1) = STREET_ENDS_M;
    let along = DVec3::Y * (y1 - y0);
    let strip = |b: &mut Builder, x0: f64, x1: f64, z: f64, paint: PaintId| {
        b.quad(DVec3::new(x0, y0, z), DVec3::X * (x1 - x0), along, paint);
    };
    strip(b, -ROAD_HALF_WIDTH_M, ROAD_HALF_WIDTH_M, 0.0, p.asphalt);
    for sign in [-1.0, 1.0] {
        let between = |from: f64, to: f64| if sign < 0.0 { (-to, -from) } else { (from, to) };
        let (x0, x1) = between(ROAD_HALF_WIDTH_M, KERB_DISTANCE_M);
        strip(b, x0, x1, 0.0, p.setts);
        let (x0, x1) = between(KERB_DISTANCE_M, KERB_DISTANCE_M + 0.15);
        b.labelled(Label::Path, |b| strip(b, x0, x1, PLOT_HEIGHT_M, p.stone));
        let face = DVec3::new(sign * KERB_DISTANCE_M, y0, 0.0);
        let (u, v) =
            if sign < 0.0 { (along, DVec3::Z * PLOT_HEIGHT_M) } else { (DVec3::Z * PLOT_HEIGHT_M, along) };
        b.labelled(Label::Path, |b| b.quad(face, u, v, p.stone));
        // The slabs run on to the walls of houses that stand at the street.
        let (x0, x1) = between(KERB_DISTANCE_M + 0.15, PAVEMENT_EDGE_M + 0.13);
        strip(b, x0, x1, PLOT_HEIGHT_M, p.slabs);
        let (x0, x1) = between(PAVEMENT_EDGE_M + 0.13, 45.0);
        strip(b, x0, x1, PLOT_HEIGHT_M, p.grass);
    }
}

fn furniture(b: &mut Builder, p: &Palette) {
    for y in [-6.0, 21.0, 48.0, 75.0, 102.0] {
        let at = Frame::facing(DVec3::new(3.55, y, PLOT_HEIGHT_M), -DVec3::X);
        f::lamp(b, &at, p);
    }
    for y in [25.2, 53.0, 80.0, 107.0] {
        let at = Frame::facing(DVec3::new(-3.55, y, PLOT_HEIGHT_M), DVec3::X);
        f::lamp(b, &at, p);
    }
    // The bench stands under the lime tree and looks at the street.
    let at = Frame::facing(DVec3::new(-4.45, 38.6, PLOT_HEIGHT_M), -DVec3::X);
    f::bench(b, &at, p);
    f::bin(b, DVec3::new(-4.6, 37.9, PLOT_HEIGHT_M), p);
    // One on the porch.
    let porch = porch_frame();
    f::bench(b, &porch.moved(4.4, -0.72, PORCH.floor), p);
    for (index, (foot, radius)) in [
        (left(-1.0).at(5.9, -0.15, 0.0), 0.20),
        (left(-1.0).at(8.2, -0.15, 0.0), 0.20),
        (right(15.6).at(2.6, -0.25, 0.0), 0.22),
        (right(15.6).at(9.2, -0.25, 0.0), 0.22),
        (porch.at(2.6, -2.75, 0.0), 0.24),
        (porch.at(4.45, -2.75, 0.0), 0.24),
    ]
    .into_iter()
    .enumerate()
    {
        let high = f::tub(b, foot, radius, p);
        let at = Frame::facing(foot + DVec3::new(-radius, -radius, high), DVec3::Y);
        g::flowers(b, &at, [2.0 * radius, 2.0 * radius, 0.34], 130, p, 400 + index as u64);
    }
    // Before the shop: crates with fruit and a board.
    let shop = right(15.6);
    for (index, (x, fruit)) in [(5.2, p.apples), (5.9, p.pears), (6.6, p.apples)].into_iter().enumerate() {
        props::crates(b, &shop.moved(x, -0.45, 0.0), p.oak, fruit, 500 + index as u64);
    }
    props::board(b, &shop.turned(3.6, -1.0, 0.0, 68.0), p);
    for (x, y) in [(-0.9, 9.0), (1.1, 26.5), (-0.6, 47.0)] {
        props::manhole(b, DVec3::new(x, y, 0.0), p);
    }
    for y in [5.5, 18.0, 31.0, 46.0, 62.0] {
        props::drain(b, &Frame::facing(DVec3::new(2.72, y, 0.0), DVec3::Y), p);
        props::drain(b, &Frame::facing(DVec3::new(-3.03, y + 4.0, 0.0), DVec3::Y), p);
    }
    let red = b.paint(Material::Timber, 0x7A2E2A, 0x7A2E2A);
    props::bicycle(b, &left(27.2).moved(0.45, -0.22, 0.0), p.green_metal, p);
    props::bicycle(b, &right(28.6).moved(6.9, -0.27, 0.0), red, p);
    props::sign(b, &Frame::facing(DVec3::new(-3.6, 57.5, PLOT_HEIGHT_M), DVec3::Y), p);
    props::aerial(b, left(14.2).at(1.4, 6.9, 7.9), p.zinc);
    props::aerial(b, right(28.6).at(4.7, 6.5, 10.9), p.zinc);
    let mut last: Option<[DVec3; 3]> = None;
    for y in [-32.0, 3.2, 30.0, 58.0, 86.0, 114.0, 142.0] {
        let tops = f::pole(b, DVec3::new(4.9, y, PLOT_HEIGHT_M), p);
        if let Some(before) = last {
            for (from, to) in before.into_iter().zip(tops) {
                f::wire(b, from, to, 0.45, p.iron);
            }
        }
        last = Some(tops);
    }
}
