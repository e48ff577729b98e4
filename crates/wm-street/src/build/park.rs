//! The plan of the park: what stands where.
//!
//! A road runs along y with its middle at x = 0. West of it are a hill and a wood, east of it a
//! pond and a level lawn; gravel paths lead around both. The mesh of the terrain is one lawn;
//! [`GroundCover`] lays the road, the paths, the litter of the wood and the mud of the shore over
//! it.

use super::builder::{Builder, Frame, faces};
use super::palette::Palette;
use super::terrain::{
    self, HILL_TOP, LAWN_CIRCLE, POND_ELLIPSE, TERRAIN_HALF_WIDTH_M, WATER_LEVEL_M, height,
};
use super::tree::{Kind, tree};
use super::{far, fences, furniture as f, growth as g, pavilion, props, species};
use crate::ground::{Bed, GroundCover, Strip, along, smooth_line};
use crate::hash::{Dice, noise2};
use crate::paint::{Label, Material, PaintId};
use glam::{DVec2, DVec3};

/// Half the width of the road, m.
const ROAD_HALF_WIDTH_M: f64 = 2.75;
/// Half the width of the paths, m.
const PATH_HALF_WIDTH_M: f64 = 1.1;
/// The path around the pond and the lawn, from the road and back to it.
const EAST_PATH: [[f64; 2]; 15] = [
    [2.0, -36.0],
    [12.0, -41.0],
    [28.0, -47.0],
    [45.0, -41.0],
    [52.0, -24.0],
    [47.0, -7.0],
    [53.0, 10.0],
    [52.0, 30.0],
    [38.0, 41.0],
    [20.0, 39.0],
    [11.0, 28.0],
    [10.0, 12.0],
    [17.0, 0.0],
    [12.0, -12.0],
    [2.0, -19.0],
];
/// The path around the hill.
const WEST_PATH: [[f64; 2]; 9] = [
    [-2.0, -24.0],
    [-13.0, -20.0],
    [-30.0, -11.0],
    [-48.0, -3.0],
    [-55.0, 15.0],
    [-49.0, 36.0],
    [-33.0, 46.0],
    [-15.0, 41.0],
    [-2.0, 33.0],
];
/// From the path around the hill to its top.
const HILL_PATH: [[f64; 2]; 5] = [[-30.0, -11.0], [-20.0, 3.0], [-22.0, 14.0], [-28.0, 22.0], [-31.5, 19.5]];
/// The middle of the wood and its radii, m.
const WOOD_ELLIPSE: (DVec2, DVec2) = (DVec2::new(-38.0, -42.0), DVec2::new(20.0, 15.0));

fn line(points: &[[f64; 2]]) -> Vec<DVec2> {
    let points: Vec<DVec2> = points.iter().copied().map(DVec2::from_array).collect();
    smooth_line(&points, 8)
}

/// The path that a walk through the park follows.
pub(crate) fn walk() -> Vec<DVec2> {
    line(&EAST_PATH[7..])
}

fn on_ground(p: DVec2) -> DVec3 {
    p.extend(height(p))
}

/// Builds the park.
pub(crate) fn build(b: &mut Builder) {
    let p = Palette::new(b);
    let lawn = b.paint(Material::Meadow, 0x5A6E3A, 0x7F8A4C);
    let worn = b.paint(Material::Soil, 0x85735A, 0x5E4E3C);
    let gravel = b.paint(Material::Grit, 0xC2B59B, 0x857A68);
    let litter = b.paint(Material::Soil, 0x6E5236, 0x4A3826);
    let mud = b.paint(Material::Soil, 0x564B3C, 0x3A332A);
    let water = b.paint(Material::Water, 0x2E3B2C, 0x2E3B2C);
    terrain::build(b, lawn, water);
    let strip = |line, half, paint, verge| Strip { line, half, paint, verge };
    let corner = DVec2::splat(TERRAIN_HALF_WIDTH_M);
    let road = vec![DVec2::new(0.0, -TERRAIN_HALF_WIDTH_M), DVec2::new(0.0, TERRAIN_HALF_WIDTH_M)];
    b.cover = GroundCover::new(
        -corner,
        corner,
        (lawn, worn),
        vec![
            strip(road, ROAD_HALF_WIDTH_M, p.asphalt, 0.25),
            strip(line(&EAST_PATH), PATH_HALF_WIDTH_M, gravel, 0.45),
            strip(line(&WEST_PATH), PATH_HALF_WIDTH_M, gravel, 0.45),
            strip(line(&HILL_PATH), 0.7, worn, 0.5),
        ],
        vec![
            Bed { center: WOOD_ELLIPSE.0, radii: WOOD_ELLIPSE.1, paint: litter, ragged: 0.16 },
            Bed { center: POND_ELLIPSE.0, radii: POND_ELLIPSE.1 * 1.06, paint: mud, ragged: 0.07 },
        ],
        (LAWN_CIRCLE.0, LAWN_CIRCLE.1 + 4.0),
    );
    kerbs(b, &p);
    b.labelled(Label::Building, |b| buildings(b, &p));
    furniture(b, &p);
    trees(b, &p);
    low_growth(b, &p);
    let rows = [
        (DVec2::new(-78.0, -76.0), DVec2::new(-76.0, 78.0), 17, 10.0),
        (DVec2::new(78.0, -76.0), DVec2::new(77.0, 78.0), 16, 9.0),
        (DVec2::new(-72.0, 80.0), DVec2::new(-10.0, 84.0), 9, 8.0),
        (DVec2::new(12.0, 84.0), DVec2::new(72.0, 79.0), 8, 9.5),
        (DVec2::new(-72.0, -80.0), DVec2::new(-9.0, -82.0), 9, 10.0),
        (DVec2::new(9.0, -83.0), DVec2::new(72.0, -79.0), 9, 8.0),
    ];
    far::build(b, &p, -corner, corner, &rows);
}

/// Kerbstones along the road, open where paths join it.
fn kerbs(b: &mut Builder, p: &Palette) {
    for (side, gaps) in [(1.0, [-36.0, -19.0]), (-1.0, [-24.0, 33.0])] {
        let mut from = -TERRAIN_HALF_WIDTH_M + 14.0;
        for to in gaps.map(|gap| gap - 1.6).into_iter().chain([TERRAIN_HALF_WIDTH_M - 14.0]) {
            let at = Frame::facing(DVec3::new(side * (ROAD_HALF_WIDTH_M + 0.02), from, -0.1), DVec3::Y);
            let (x0, x1) = if side > 0.0 { (0.0, 0.12) } else { (-0.12, 0.0) };
            b.labelled(Label::Path, |b| {
                b.block(&at, [x0, 0.0, 0.0], [x1, to - from, 0.16], p.stone, faces::STANDING);
            });
            from = to + 3.2;
        }
    }
}

fn buildings(b: &mut Builder, p: &Palette) {
    let at = |x: f64, y: f64| Frame::facing(on_ground(DVec2::new(x, y)), DVec3::Y);
    pavilion::pavilion(b, &at(18.5, -4.5).turned(0.0, 0.0, 0.0, -25.0), p);
    let boards = b.paint(Material::Boards, 0x7F8A78, 0x5F665A);
    pavilion::shed(b, &at(-17.5, -47.0).turned(0.0, 0.0, 0.0, 70.0), boards, p);
    // A low wall along the mown lawn, a longer one by the road.
    fences::low_wall(b, &at(19.0, -9.0 - 4.5), 16.0, 0.5, p.plinth, p);
    fences::low_wall(b, &Frame::facing(DVec3::new(-5.6, -8.0, -0.1), -DVec3::X), 14.0, 0.75, p.brick, p);
}

/// A frame beside a path at a share of its length, to its left (`side` -1) or right, that looks at
/// the path.
fn beside(path: &[DVec2], share: f64, side: f64, off: f64) -> Frame {
    let (point, ahead) = along(path, share);
    let right = DVec2::new(ahead.y, -ahead.x) * side;
    Frame::facing(on_ground(point + right * off), right.extend(0.0))
}

fn furniture(b: &mut Builder, p: &Palette) {
    let (east, west) = (line(&EAST_PATH), line(&WEST_PATH));
    for (share, side) in [(0.09, -1.0), (0.30, -1.0), (0.45, -1.0), (0.60, -1.0), (0.78, -1.0), (0.90, 1.0)] {
        f::bench(b, &beside(&east, share, side, 1.6).moved(-0.85, 0.0, 0.0), p);
    }
    for (share, side) in [(0.15, 1.0), (0.42, 1.0), (0.70, 1.0)] {
        f::bench(b, &beside(&west, share, side, 1.6).moved(-0.85, 0.0, 0.0), p);
    }
    for share in [0.04, 0.18, 0.37, 0.53, 0.68, 0.84, 0.97] {
        f::lamp(b, &beside(&east, share, 1.0, 1.7), p);
    }
    for share in [0.1, 0.34, 0.58, 0.85] {
        f::lamp(b, &beside(&west, share, -1.0, 1.7), p);
    }
    for share in [0.095, 0.455, 0.785] {
        f::bin(b, beside(&east, share, -1.0, 2.6).origin, p);
    }
    // The seat on the hill.
    f::bench(b, &Frame::facing(on_ground(HILL_TOP + DVec2::new(-0.8, 1.2)), DVec3::NEG_X), p);
    let red = b.paint(Material::Timber, 0x8A2F2A, 0x8A2F2A);
    let blue = b.paint(Material::Timber, 0x2B4C77, 0x2B4C77);
    let stand = Frame::facing(on_ground(DVec2::new(15.2, -7.6)), DVec3::new(0.4, 0.92, 0.0).normalize());
    for (index, paint) in [red, p.green_metal, blue].into_iter().enumerate() {
        props::bicycle(b, &stand.moved(0.15 * index as f64, -0.75 * index as f64, 0.0), paint, p);
    }
    // Railings by the water, boulders on the lawn.
    let rail = beside(&east, 0.735, -1.0, 1.5);
    fences::railings(b, &rail, 5.0, 0.05, 0.95, p.iron);
    let rock = b.paint(Material::Stone, 0x9A958A, 0x6E6A60);
    b.labelled(Label::Object, |b| boulders(b, rock));
    let fence = Frame::facing(DVec3::new(-45.0, 57.0, height(DVec2::new(-35.0, 57.0))), DVec3::Y);
    fences::pickets(b, &fence, 36.0, Some((17.0, 19.4)), p.white);
}

fn boulders(b: &mut Builder, rock: PaintId) {
    let mut dice = Dice::new(b.seed, 820);
    for (x, y, size) in [
        (38.0, -17.0, 0.75),
        (39.4, -16.2, 0.45),
        (37.3, -15.7, 0.3),
        (-20.0, 30.0, 0.9),
        (-18.9, 31.3, 0.5),
        (15.0, 17.5, 0.55),
        (14.6, 20.0, 0.4),
        (45.0, 27.5, 0.6),
    ] {
        let radii = DVec3::new(size, size * dice.range(0.7, 1.0), size * dice.range(0.55, 0.75));
        b.ball(on_ground(DVec2::new(x, y)) + DVec3::Z * (0.25 * size), radii, rock);
    }
}

fn trees(b: &mut Builder, p: &Palette) {
    let needles = b.paint(Material::Leaf, 0x35492F, 0x465A38);
    let oak_leaf = b.paint(Material::Leaf, 0x55702F, 0x7E8A3C);
    let copper = b.paint(Material::Leaf, 0x6A4038, 0x7C5240);
    let (linden, birch, rowan) = (species::linden(p), species::birch(p), species::rowan(p));
    let oak = Kind { foliage: oak_leaf, ..species::oak(p) };
    let beech = Kind { foliage: copper, height: 11.5, radius: 4.6, ..oak };
    let (spruce, willow) = (species::spruce(p, needles), species::willow(p));
    // Seen from a few metres away at least: fewer and larger leaves than in the street.
    let coarse = |kind: Kind| Kind { leaves: kind.leaves / 2, leaf: kind.leaf * 1.4, ..kind };
    let (birch, rowan, avenue) = (coarse(birch), coarse(rowan), Kind { clusters: 100, ..coarse(linden) });
    let mut seed = 1000;
    let mut plant = |b: &mut Builder, x: f64, y: f64, kind: &Kind| {
        seed += 1;
        // No two of a kind are equally high.
        let size = 0.82 + 0.36 * crate::hash::unit(b.seed, seed);
        let (height, radius, trunk) = (kind.height * size, kind.radius * size, kind.trunk * size);
        let kind = Kind { height, radius, trunk, ..*kind };
        tree(b, on_ground(DVec2::new(x, y)) - DVec3::Z * 0.04, &kind, seed);
    };
    for y in [-54.0, -44.0, -12.0, 2.0, 13.0, 24.0, 44.0, 55.0] {
        plant(b, 6.3, y + 0.6, &avenue);
    }
    for y in [-55.0, -43.0, -33.0, -14.0, 10.0, 21.0, 42.0, 54.0] {
        plant(b, -6.8, y, &avenue);
    }
    for (x, y, kind) in [
        (40.0, -34.0, &oak),
        (14.0, -27.0, &oak),
        (-21.0, -27.0, &beech),
        (-46.0, 14.0, &oak),
        (34.0, 50.0, &oak),
        (57.0, -10.0, &beech),
        (48.5, 33.5, &willow),
        (16.2, 30.5, &willow),
        (45.5, 5.5, &willow),
        (56.0, 22.0, &birch),
        (57.5, 25.5, &birch),
        (54.5, 45.0, &birch),
        (52.0, 47.5, &birch),
        (24.0, 46.0, &birch),
        (-14.0, 14.0, &birch),
        (-16.5, 11.5, &birch),
        (-24.0, 34.0, &rowan),
        (-40.0, 30.0, &rowan),
        (-11.0, 47.5, &rowan),
        (20.0, -54.0, &rowan),
        (30.0, -56.5, &spruce),
        (34.5, -55.0, &spruce),
        (38.0, -58.0, &spruce),
        (58.0, -36.0, &spruce),
        (56.0, -42.0, &spruce),
        (-58.0, 40.0, &spruce),
        (-55.5, 45.0, &spruce),
        (-60.0, 48.0, &spruce),
    ] {
        plant(b, x, y, kind);
    }
    // The wood: as dense as trees stand, of mixed kinds, fewer and larger leaves.
    let mut dice = Dice::new(b.seed, 821);
    let inner = [oak, beech, spruce, birch, oak].map(|kind| Kind {
        clusters: kind.clusters * 3 / 5,
        leaves: 40,
        leaf: kind.leaf.max(0.16) * 1.35,
        ..kind
    });
    let mut stands: Vec<DVec2> = Vec::new();
    for _ in 0..400 {
        let at = WOOD_ELLIPSE.0 + WOOD_ELLIPSE.1 * DVec2::new(dice.range(-1.0, 1.0), dice.range(-1.0, 1.0));
        let reach = ((at - WOOD_ELLIPSE.0) / WOOD_ELLIPSE.1).length();
        let is_free = stands.iter().all(|other| other.distance(at) > 5.2)
            && at.distance(DVec2::new(-17.0, -46.0)) > 5.0;
        if reach < 0.92 && is_free && stands.len() < 18 {
            stands.push(at);
        }
    }
    for (index, at) in stands.into_iter().enumerate() {
        plant(b, at.x, at.y, &inner[index % inner.len()]);
    }
    let bush = species::bush(p);
    for (x, y) in [
        (9.5, -30.0),
        (11.2, -31.5),
        (55.5, -27.0),
        (56.5, -29.3),
        (-9.5, -27.5),
        (-58.0, 3.0),
        (-58.5, 5.5),
        (-41.0, 44.0),
        (8.5, 35.0),
        (25.0, 3.0),
        (22.0, -9.5),
        (-12.5, 24.5),
        (-13.5, 26.5),
        (33.0, 34.5),
        (49.8, 20.0),
    ] {
        plant(b, x, y, &bush);
    }
}

/// Long grass, reeds, flower beds, fallen leaves.
fn low_growth(b: &mut Builder, p: &Palette) {
    let mut dice = Dice::new(b.seed, 822);
    let reed = b.paint(Material::Blade, 0x6E7F3E, 0xA39A5A);
    // Reeds stand in the water and at its edge, in stretches.
    for _ in 0..2600 {
        let (sin, cos) = dice.range(0.0, std::f64::consts::TAU).sin_cos();
        let at = POND_ELLIPSE.0 + POND_ELLIPSE.1 * DVec2::new(cos, sin) * dice.range(0.88, 1.1);
        let ground = height(at);
        if noise2(at / 5.0, 84) < 0.12 || !(WATER_LEVEL_M - 0.45..WATER_LEVEL_M + 0.12).contains(&ground) {
            continue;
        }
        g::tuft(b, at.extend(ground), 4, 1.15, reed, &mut dice);
    }
    // Long grass where no mower comes: by paths, trees and walls.
    for path in [line(&EAST_PATH), line(&WEST_PATH)] {
        for _ in 0..2400 {
            let (point, ahead) = along(&path, dice.unit());
            let side = if dice.unit() < 0.5 { -1.0 } else { 1.0 };
            let at =
                point + ahead.perp() * side * (PATH_HALF_WIDTH_M + 0.12 + 0.5 * dice.unit() * dice.unit());
            if noise2(at / 3.0, 85) > -0.1 && at.x.abs() > ROAD_HALF_WIDTH_M + 0.3 {
                g::tuft(b, on_ground(at), 4, 0.12, p.blade, &mut dice);
            }
        }
    }
    for _ in 0..2600 {
        let at = HILL_TOP + DVec2::new(dice.bell(), dice.bell()) * DVec2::new(10.0, 8.0);
        if noise2(at / 4.0, 86) > 0.15 {
            g::tuft(b, on_ground(at), 5, 0.24, p.blade, &mut dice);
        }
    }
    for (index, share) in [0.02, 0.5, 0.965].into_iter().enumerate() {
        let bed = beside(&line(&EAST_PATH), share, 1.0, 1.9);
        b.block(&bed, [-2.0, 0.0, -0.3], [2.0, 1.2, 0.06], p.soil, faces::STANDING);
        g::flowers(b, &bed.moved(-2.0, 0.0, 0.05), [4.0, 1.2, 0.45], 700, p, 830 + index as u64);
    }
    for (low, high, count, seed) in [
        (WOOD_ELLIPSE.0 - WOOD_ELLIPSE.1, WOOD_ELLIPSE.0 + WOOD_ELLIPSE.1, 4200, 840),
        (DVec2::new(33.0, -41.0), DVec2::new(47.0, -27.0), 500, 841),
        (DVec2::new(8.0, -34.0), DVec2::new(20.0, -20.0), 500, 842),
        (DVec2::new(-28.0, -34.0), DVec2::new(-14.0, -20.0), 500, 843),
        (DVec2::new(-6.5, -60.0), DVec2::new(-2.4, 60.0), 500, 844),
        (DVec2::new(2.4, -60.0), DVec2::new(6.5, 60.0), 500, 845),
    ] {
        g::fallen(b, low, high, height, count, p.fallen, seed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lawn_is_level_and_the_hill_is_not() {
        let (lawn, radius) = LAWN_CIRCLE;
        for step in 0..60 {
            let (sin, cos) = f64::from(step).sin_cos();
            assert!(height(lawn + DVec2::new(cos, sin) * radius * 0.98).abs() < 1e-9);
        }
        assert!((4.0..7.0).contains(&height(HILL_TOP)), "{}", height(HILL_TOP));
        assert!(height(POND_ELLIPSE.0) < WATER_LEVEL_M - 0.5);
        assert!((height(DVec2::new(TERRAIN_HALF_WIDTH_M, 20.0)) - far::FIELD_HEIGHT_M).abs() < 1e-9);
    }
}
