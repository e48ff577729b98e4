//! The surroundings of the street: fields, hedgerows, a village with a church, wooded hills.

use super::builder::{Builder, Frame, faces};
use super::facade::{Filling, Finish};
use super::house::{Dress, House, Ridge};
use super::palette::Palette;
use super::roof::Roof;
use crate::hash::{Dice, noise2};
use crate::paint::{Label, Material, PaintId};
use crate::shape::{Outline, Shape};
use glam::{DVec2, DVec3};

/// Height of the fields, m.
pub(super) const FIELD_HEIGHT_M: f64 = 0.03;

/// A row of far trees: its ends, their number and mean height, m.
pub(super) type TreeRow = (DVec2, DVec2, u32, f64);

/// Builds all of it around a place that covers the rectangle from `low` to `high`; `near` are the
/// rows of trees at its borders.
pub(super) fn build(b: &mut Builder, p: &Palette, low: DVec2, high: DVec2, near: &[TreeRow]) {
    let field = b.paint(Material::Field, 0x7F8A55, 0x979E66);
    let wood = b.paint(Material::Wood, 0x4E5E46, 0x6E7A58);
    let far_leaf = b.paint(Material::Wood, 0x506338, 0x78844C);
    let white = b.paint(Material::Plaster, 0xE6E0D2, 0xCFC8B8);
    let ochre = b.paint(Material::Plaster, 0xD8BC8C, 0xB89860);
    let finishes = [p.finish(white, p.oak), p.finish(p.brick, p.oak), p.finish(ochre, p.oak)];
    // Fields around the street's own ground, each rectangle a primitive.
    for (x0, x1, y0, y1) in [
        (-700.0, 700.0, high.y, 760.0),
        (-700.0, 700.0, -420.0, low.y),
        (-700.0, low.x, low.y, high.y),
        (high.x, 700.0, low.y, high.y),
    ] {
        b.quad(DVec3::new(x0, y0, FIELD_HEIGHT_M), DVec3::X * (x1 - x0), DVec3::Y * (y1 - y0), field);
    }
    // The road goes on to the village.
    for (from, to) in [(high.y, 325.0), (-300.0, low.y)] {
        let corner = DVec3::new(-2.75, from, FIELD_HEIGHT_M + 0.02);
        b.quad(corner, DVec3::X * 5.5, DVec3::Y * (to - from), p.asphalt);
    }
    b.labelled(Label::Building, |b| {
        church(b, p, &finishes[0]);
        village(b, p, &finishes);
    });
    hedgerows(b, near, far_leaf);
    hills(b, wood);
}

fn church(b: &mut Builder, p: &Palette, finish: &Finish) {
    let stone = b.paint(Material::Stone, 0xBDB39E, 0x8C877C);
    let dark = b.paint(Material::Metal, 0x2A2C2E, 0x2A2C2E);
    let at = Frame::facing(DVec3::new(-7.5, 300.0, FIELD_HEIGHT_M), DVec3::Y);
    let (half, high) = (3.6, 24.0);
    b.block(&at, [-half, -half, 0.0], [half, half, high], stone, faces::STANDING);
    for z in [8.0, 16.0, 23.4] {
        b.block(&at, [-half - 0.15, -half - 0.15, z], [half + 0.15, half + 0.15, z + 0.5], stone, faces::ALL);
    }
    for turn in 0..4 {
        let side = at.turned(0.0, 0.0, 0.0, 90.0 * f64::from(turn));
        for x in [-1.5, 0.5] {
            b.block(&side, [x, -half - 0.05, 17.2], [x + 1.0, -half, 21.5], dark, faces::FIXED);
        }
        b.disc(side.at(0.0, -half - 0.08, 13.2), -side.back, 1.25, finish.frame);
        b.block(&side, [-0.35, -half - 0.05, 9.2], [0.35, -half, 11.2], dark, faces::FIXED);
        // One face of the spire.
        let e = half + 0.25;
        let apex = side.along(e, e, 17.0);
        b.triangle(side.at(-e, -e, high), side.along(2.0 * e, 0.0, 0.0), apex, p.slate);
    }
    let cross = at.at(0.0, 0.0, high + 16.8);
    b.stump(cross, cross + DVec3::Z * 2.2, [0.12, 0.08], p.iron);
    b.block(&Frame { origin: cross, ..at }, [-0.6, -0.06, 1.2], [0.6, 0.06, 1.4], p.iron, faces::ALL);
    // The nave behind the tower.
    let nave = Frame::facing(at.at(5.5, half, 0.0), -at.right);
    let roof = Roof {
        length: 22.0,
        span: 11.0,
        eaves: 8.0,
        pitch: 50.0,
        overhang: 0.5,
        verge: 0.4,
        paint: p.clay,
        trim: stone,
    };
    b.block(&nave, [0.0, 0.0, 0.0], [22.0, 11.0, 8.0], finish.wall, faces::STANDING & !faces::TOP);
    for bay in 0..5 {
        let x = 2.0 + 4.2 * f64::from(bay);
        b.block(&nave, [x, -0.06, 2.6], [x + 1.3, 0.0, 6.6], dark, faces::FIXED);
        b.block(&nave, [x, 11.0, 2.6], [x + 1.3, 11.06, 6.6], dark, faces::ALL & !faces::FRONT);
    }
    roof.build(b, &nave);
    roof.gables(b, &nave, finish.wall);
}

fn village(b: &mut Builder, p: &Palette, finishes: &[Finish; 3]) {
    let mut dice = Dice::new(b.seed, 900);
    let spots = [
        (-62.0, 252.0),
        (-44.0, 268.0),
        (-27.0, 246.0),
        (14.0, 262.0),
        (27.0, 244.0),
        (44.0, 266.0),
        (64.0, 250.0),
        (86.0, 272.0),
        (-88.0, 276.0),
        (16.0, 310.0),
        (-34.0, 322.0),
        (38.0, 330.0),
        (120.0, 330.0),
        (-130.0, 345.0),
        (-60.0, 180.0),
        (70.0, 175.0),
    ];
    for (index, (x, y)) in spots.into_iter().enumerate() {
        let house = House {
            width: dice.range(8.0, 12.0),
            depth: dice.range(7.5, 9.0),
            storeys: if dice.unit() < 0.4 { 1 } else { 2 },
            storey: 2.8,
            pitch: dice.range(42.0, 50.0),
            ridge: if dice.unit() < 0.55 { Ridge::Along } else { Ridge::Across },
            columns: 3,
            door: 1,
            shop: false,
            window: Filling::Casement,
            dress: Dress::Plain,
            dormers: 0,
            chimneys: vec![1.5],
            roof: [p.clay, p.brown_tiles, p.slate][index % 3],
            chimney: p.brick,
            finish: finishes[(index * 7 / 3) % 3],
        };
        let turn = dice.range(-22.0, 22.0);
        let at = Frame::facing(DVec3::new(x, y, FIELD_HEIGHT_M), DVec3::Y).turned(0.0, 0.0, 0.0, turn);
        house.build(b, &at);
    }
}

/// Rows and clumps of far trees: crowns of large round leaves.
fn hedgerows(b: &mut Builder, near: &[TreeRow], leaf: PaintId) {
    let mut dice = Dice::new(b.seed, 901);
    let rows: [TreeRow; 5] = [
        (DVec2::new(-160.0, 165.0), DVec2::new(-22.0, 182.0), 11, 5.5),
        (DVec2::new(20.0, 196.0), DVec2::new(170.0, 180.0), 12, 6.0),
        (DVec2::new(-120.0, 290.0), DVec2::new(-20.0, 296.0), 11, 9.0),
        (DVec2::new(10.0, 290.0), DVec2::new(140.0, 300.0), 13, 9.0),
        (DVec2::new(-260.0, 390.0), DVec2::new(240.0, 400.0), 34, 10.0),
    ];
    let far = rows.iter().map(|row| (row, 0.85));
    for (&(from, to, count, height), fine) in far.chain(near.iter().map(|row| (row, 2.0))) {
        for index in 0..count {
            let at = from.lerp(to, (f64::from(index) + 0.6 * dice.unit()) / f64::from(count));
            let off = DVec2::new(dice.bell(), dice.bell()) * 2.0;
            let high = height * dice.range(0.7, 1.3);
            far_tree(b, (at + off).extend(FIELD_HEIGHT_M), high, fine, leaf, &mut dice);
        }
    }
}

/// A crown of `height` m with leaves `fine` times smaller than on the farthest trees.
fn far_tree(b: &mut Builder, foot: DVec3, height: f64, fine: f64, leaf: PaintId, dice: &mut Dice) {
    let radius = height * dice.range(0.34, 0.45);
    let size = (height * 0.17).max(0.8) / fine;
    let middle = foot + DVec3::Z * (0.55 * height);
    let lumps: Vec<DVec3> = (0..7).map(|_| dice.direction() * 0.55).collect();
    for index in 0..(70.0 * fine.powf(1.7)) as usize {
        let lump = lumps[index % lumps.len()];
        let out = dice.direction();
        let way = lump + out * 0.55;
        let at = middle + DVec3::new(way.x * radius, way.y * radius, way.z * 0.48 * height);
        let normal = (out + DVec3::Z * 0.5 + dice.direction() * 0.4).normalize_or(DVec3::Z);
        let (x, y) = crate::shape::around(normal);
        let length = size * dice.range(0.7, 1.2);
        let (u, v) = (x * length, y * length * 0.8);
        let corner = at - (u + v) * 0.5;
        let lowest = corner.z.min((corner + u).z).min((corner + v).z).min((corner + u + v).z);
        if lowest > 0.05 {
            b.add(Shape::Flat { corner, u, v, outline: Outline::Ellipse }, leaf);
        }
    }
}

/// A ring of hills as a grid of triangles, higher ahead of the street than behind it.
fn hills(b: &mut Builder, wood: PaintId) {
    let (around, rows) = (72, 4);
    let point = |i: i32, j: i32| {
        let angle = std::f64::consts::TAU * f64::from(i.rem_euclid(around)) / f64::from(around);
        let (sin, cos) = angle.sin_cos();
        let out =
            430.0 + 110.0 * f64::from(j) + 30.0 * noise2(DVec2::new(sin * 3.0, cos * 3.0 + f64::from(j)), 5);
        let rise = [0.0, 0.42, 0.8, 1.0, 0.9][j as usize];
        let ahead = 0.55 + 0.45 * cos;
        let lumps = 0.62
            + 0.55 * noise2(DVec2::new(sin * 3.4 + 9.0, cos * 3.4), 8)
            + 0.16 * noise2(DVec2::new(sin * 13.0, cos * 13.0 + f64::from(j)), 9);
        DVec3::new(out * sin, 60.0 + out * cos, FIELD_HEIGHT_M - 0.02 + 78.0 * rise * lumps.max(0.12) * ahead)
    };
    for j in 0..rows {
        for i in 0..around {
            let (a, c, d, e) = (point(i, j), point(i + 1, j), point(i, j + 1), point(i + 1, j + 1));
            for (corner, one, two) in [(a, d, c), (e, c, d)] {
                let (u, v) = (one - corner, two - corner);
                let (u, v) = if u.cross(v).z > 0.0 { (u, v) } else { (v, u) };
                b.triangle(corner, u, v, wood);
            }
        }
    }
}
