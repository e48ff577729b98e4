//! The plan: what stands where along the street.
//!
//! The carriageway runs along y with its middle at x = 0, from behind the first houses to the church.
//! From the middle outwards: asphalt, a gutter of setts, the kerb, the pavement, then plots. A plot's
//! frame has its origin on the pavement's outer edge, x to the right and y away from the street.

use super::builder::{Builder, Frame, faces};
use super::facade::{Filling, Finish};
use super::far;
use super::furniture as f;
use super::growth as g;
use super::house::{Dress, House, Ridge};
use super::paint::{Material, PaintId};
use super::tree::{Kind, tree};
use glam::DVec3;

/// Half the width of the asphalt, m.
const ROAD: f64 = 2.75;
/// From the middle to the face of the kerb, m.
const KERB: f64 = 3.05;
/// From the middle to the outer edge of the pavement, m.
const EDGE: f64 = 5.2;
/// Height of pavements and plots above the carriageway, m.
pub(super) const PLOT: f64 = 0.12;
/// The street's ends along y, m.
const ENDS: (f64, f64) = (-45.0, 135.0);

/// Paints that many things share.
#[derive(Clone, Copy, Debug)]
pub(super) struct Palette {
    pub asphalt: PaintId,
    pub setts: PaintId,
    pub slabs: PaintId,
    pub stone: PaintId,
    pub plinth: PaintId,
    pub grass: PaintId,
    pub soil: PaintId,
    pub gravel: PaintId,
    pub white: PaintId,
    pub glass: PaintId,
    pub brick: PaintId,
    pub brown_brick: PaintId,
    pub clay: PaintId,
    pub brown_tiles: PaintId,
    pub slate: PaintId,
    pub iron: PaintId,
    pub zinc: PaintId,
    pub green_metal: PaintId,
    pub lantern: PaintId,
    pub terracotta: PaintId,
    pub pole: PaintId,
    pub deck: PaintId,
    pub oak: PaintId,
    pub bark: PaintId,
    pub birch: PaintId,
    pub linden: PaintId,
    pub birch_leaf: PaintId,
    pub rowan: PaintId,
    pub berries: PaintId,
    pub hedge: PaintId,
    pub core: PaintId,
    pub ivy: PaintId,
    pub blade: PaintId,
    pub flowers: PaintId,
    pub fallen: PaintId,
    pub apples: PaintId,
    pub pears: PaintId,
    pub cast_iron: PaintId,
    pub slot: PaintId,
    pub tyre: PaintId,
    pub sign_red: PaintId,
    pub sign_blue: PaintId,
}

impl Palette {
    fn new(b: &mut Builder) -> Self {
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
    fn finish(&self, wall: PaintId, door: PaintId) -> Finish {
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

/// The frame of a plot that begins at `y` on the left (x < 0) of the street.
fn left(y: f64) -> Frame {
    Frame::facing(DVec3::new(-EDGE, y, PLOT), -DVec3::X)
}

/// The frame of a plot that ends at `y` on the right: its x runs towards smaller y.
fn right(y: f64) -> Frame {
    Frame::facing(DVec3::new(EDGE, y, PLOT), DVec3::X)
}

/// Builds the street.
pub(super) fn build(b: &mut Builder) {
    let p = Palette::new(b);
    ground(b, &p);
    houses(b, &p);
    gardens(b, &p);
    trees(b, &p);
    furniture(b, &p);
    far::build(b, &p, &houses_far);
}

fn ground(b: &mut Builder, p: &Palette) {
    let (y0, y1) = ENDS;
    let along = DVec3::Y * (y1 - y0);
    let strip = |b: &mut Builder, x0: f64, x1: f64, z: f64, paint: PaintId| {
        b.quad(DVec3::new(x0, y0, z), DVec3::X * (x1 - x0), along, paint);
    };
    strip(b, -ROAD, ROAD, 0.0, p.asphalt);
    for sign in [-1.0, 1.0] {
        let between = |from: f64, to: f64| if sign < 0.0 { (-to, -from) } else { (from, to) };
        let (x0, x1) = between(ROAD, KERB);
        strip(b, x0, x1, 0.0, p.setts);
        let (x0, x1) = between(KERB, KERB + 0.15);
        strip(b, x0, x1, PLOT, p.stone);
        let face = DVec3::new(sign * KERB, y0, 0.0);
        let (u, v) = if sign < 0.0 { (along, DVec3::Z * PLOT) } else { (DVec3::Z * PLOT, along) };
        b.quad(face, u, v, p.stone);
        // The slabs run on to the walls of houses that stand at the street.
        let (x0, x1) = between(KERB + 0.15, EDGE + 0.13);
        strip(b, x0, x1, PLOT, p.slabs);
        let (x0, x1) = between(EDGE + 0.13, 45.0);
        strip(b, x0, x1, PLOT, p.grass);
    }
}

fn houses(b: &mut Builder, p: &Palette) {
    use Material as M;
    let white = b.paint(M::Plaster, 0xEAE4D6, 0xCFC8B8);
    let ochre = b.paint(M::Plaster, 0xD8BE93, 0xB89860);
    let rose = b.paint(M::Plaster, 0xD0BAAC, 0xB48872);
    let blue = b.paint(M::Plaster, 0xB9C0C2, 0x8A969C);
    let sage = b.paint(M::Boards, 0xD2CFC2, 0x98A28C);
    let red_door = b.paint(M::Timber, 0x7E2A27, 0x7E2A27);
    let green = b.paint(M::Timber, 0x2F5646, 0x2F5646);
    let navy = b.paint(M::Timber, 0x2C4562, 0x2C4562);
    let oak = p.oak;
    let beam = b.paint(M::Timber, 0x4A3526, 0x4A3526);
    let awning = b.paint(M::Cloth, 0xE9E2D0, 0xB3473A);
    let base = House {
        width: 10.0,
        depth: 8.6,
        storeys: 2,
        storey: 2.75,
        pitch: 45.0,
        ridge: Ridge::Along,
        columns: 4,
        door: 1,
        shop: false,
        window: Filling::Casement,
        dress: Dress::Plain,
        dormers: 0,
        chimneys: vec![1.2],
        roof: p.clay,
        chimney: p.brick,
        finish: p.finish(white, green),
    };
    let back = |frame: Frame, setback: f64| frame.moved(0.0, setback, 0.0);

    // Left, from behind the camera to the far end.
    House {
        width: 11.0,
        chimneys: vec![9.6],
        roof: p.slate,
        finish: p.finish(p.brick, navy),
        ..base.clone()
    }
    .build(b, &back(left(-29.0), 0.15));
    House {
        width: 10.0,
        ridge: Ridge::Across,
        columns: 3,
        finish: p.finish(ochre, red_door),
        ..base.clone()
    }
    .build(b, &back(left(-14.0), 0.15));
    House {
        width: 11.0,
        columns: 4,
        door: 2,
        window: Filling::Sash,
        dress: Dress::Bands,
        roof: p.slate,
        chimneys: vec![1.0, 10.0],
        finish: p.finish(p.brick, navy),
        ..base.clone()
    }
    .build(b, &back(left(-1.0), 0.15));
    let cottage = House {
        width: 10.0,
        storeys: 1,
        storey: 2.8,
        pitch: 48.0,
        columns: 4,
        door: 1,
        dormers: 2,
        dress: Dress::Shutters(navy),
        finish: p.finish(ochre, navy),
        ..base.clone()
    };
    cottage.build(b, &back(left(14.2), 2.6));
    let timbered = House {
        width: 8.6,
        depth: 10.0,
        storeys: 2,
        storey: 2.6,
        pitch: 50.0,
        ridge: Ridge::Across,
        columns: 3,
        door: 2,
        dress: Dress::Beams(beam),
        roof: p.brown_tiles,
        chimneys: vec![6.5],
        finish: p.finish(white, oak),
        ..base.clone()
    };
    let at = back(left(27.2), 0.2);
    for (index, opening) in timbered.build(b, &at).iter().enumerate() {
        if opening.filling != Filling::Door {
            f::window_box(b, &at, opening, p, 600 + index as u64);
        }
    }
    let porch_house = House {
        width: 10.4,
        depth: 8.4,
        storeys: 2,
        storey: 2.75,
        pitch: 42.0,
        columns: 4,
        door: 1,
        window: Filling::Sash,
        roof: p.slate,
        chimneys: vec![9.0],
        finish: p.finish(sage, red_door),
        ..base.clone()
    };
    let at = porch_frame();
    porch_house.build(b, &at);
    PORCH.build(b, &at, p.slate, p);
    House {
        width: 9.0,
        ridge: Ridge::Across,
        columns: 3,
        door: 0,
        roof: p.clay,
        dress: Dress::Shutters(green),
        finish: p.finish(rose, green),
        ..base.clone()
    }
    .build(b, &back(left(61.0), 0.2));
    House {
        width: 11.0,
        dress: Dress::Bands,
        roof: p.brown_tiles,
        finish: p.finish(p.brown_brick, navy),
        ..base.clone()
    }
    .build(b, &back(left(72.5), 0.2));
    House { width: 9.5, storeys: 1, dormers: 2, finish: p.finish(white, red_door), ..base.clone() }
        .build(b, &back(left(87.0), 1.0));
    House { width: 10.5, ridge: Ridge::Across, roof: p.slate, finish: p.finish(blue, navy), ..base.clone() }
        .build(b, &back(left(100.0), 0.2));
    House { width: 12.0, columns: 5, roof: p.clay, finish: p.finish(p.brick, green), ..base.clone() }
        .build(b, &back(left(115.0), 0.2));

    // Right; `right(y)` begins at the larger y.
    House { width: 11.0, finish: p.finish(white, navy), ..base.clone() }.build(b, &back(right(-13.0), 0.15));
    House {
        width: 10.5,
        ridge: Ridge::Across,
        columns: 3,
        roof: p.brown_tiles,
        dress: Dress::Shutters(green),
        finish: p.finish(white, green),
        ..base.clone()
    }
    .build(b, &back(right(2.0), 0.15));
    let shop = House {
        width: 10.0,
        storey: 3.0,
        columns: 4,
        door: 0,
        shop: true,
        roof: p.slate,
        dress: Dress::Bands,
        chimneys: vec![0.9, 9.1],
        finish: p.finish(blue, green),
        ..base.clone()
    };
    let at = back(right(15.6), 0.15);
    let front = shop.build(b, &at);
    for opening in front.iter().filter(|o| o.filling == Filling::Shop) {
        let (x0, w, z) = (opening.x - 0.2, opening.width + 0.4, opening.z + opening.height - 0.02);
        let (u, v) = (at.along(w, 0.0, 0.0), at.along(0.0, 1.35, 0.55));
        b.quad(at.at(x0, -1.35, z - 0.55), u, v, awning);
        b.quad(at.at(x0, -1.35, z - 0.77), u, DVec3::Z * 0.22, awning);
        for x in [x0, x0 + w] {
            b.stump(at.at(x, -1.34, z - 0.55), at.at(x, 0.0, z - 0.15), [0.014, 0.014], p.iron);
        }
    }
    let sign = b.paint(M::Metal, 0x2F5646, 0x2F5646);
    let gold = b.paint(M::Metal, 0xC9A24A, 0xC9A24A);
    f::hanging_sign(b, &at, 9.7, 4.0, (sign, gold, p.iron));
    House {
        width: 9.4,
        depth: 10.0,
        ridge: Ridge::Across,
        pitch: 47.0,
        columns: 3,
        door: 1,
        window: Filling::Sash,
        roof: p.clay,
        dress: Dress::Bands,
        finish: p.finish(p.brown_brick, oak),
        ..base.clone()
    }
    .build(b, &back(right(28.6), 0.15));
    House {
        width: 11.0,
        columns: 4,
        door: 2,
        roof: p.clay,
        dress: Dress::Shutters(green),
        chimneys: vec![1.0, 10.0],
        finish: p.finish(white, green),
        ..base.clone()
    }
    .build(b, &back(right(50.0), 2.4));
    House {
        width: 10.0,
        roof: p.slate,
        window: Filling::Sash,
        finish: p.finish(p.brick, navy),
        ..base.clone()
    }
    .build(b, &back(right(63.5), 0.2));
    House {
        width: 9.0,
        ridge: Ridge::Across,
        columns: 3,
        roof: p.brown_tiles,
        finish: p.finish(ochre, oak),
        ..base.clone()
    }
    .build(b, &back(right(80.5), 0.2));
    House { width: 11.0, roof: p.clay, finish: p.finish(sage, red_door), ..base.clone() }
        .build(b, &back(right(94.5), 0.2));
    House {
        width: 10.0,
        ridge: Ridge::Across,
        columns: 3,
        roof: p.slate,
        finish: p.finish(rose, navy),
        ..base.clone()
    }
    .build(b, &back(right(108.5), 0.2));
    House {
        width: 12.0,
        storeys: 1,
        dormers: 3,
        columns: 5,
        roof: p.clay,
        finish: p.finish(white, green),
        ..base
    }
    .build(b, &back(right(125.0), 0.8));
}

/// The frame of the house with the porch.
fn porch_frame() -> Frame {
    left(46.0).moved(0.0, 6.2, 0.0)
}

const PORCH: f::Porch = f::Porch { from: 0.6, to: 6.4, depth: 2.3, floor: 0.34 };

/// The corners of the floor that the porch's roof shelters, world axes, m.
pub(super) fn porch() -> (DVec3, DVec3) {
    let frame = porch_frame();
    let (one, two) = (frame.at(PORCH.from, -PORCH.depth, PORCH.floor), frame.at(PORCH.to, 0.0, PORCH.floor));
    (one.min(two), one.max(two))
}

fn gardens(b: &mut Builder, p: &Palette) {
    let growth = (p.core, p.hedge);
    // A walled yard between the first two houses on the left.
    let at = left(10.2);
    f::low_wall(b, &at.moved(0.0, 0.1, 0.0), 3.9, 1.75, (p.brick, p.stone));
    g::climber(b, &at.moved(2.2, 0.1, 0.0), 0.0, (1.5, 2.0), p.ivy, 50);
    // The cottage's front garden.
    let at = left(14.2);
    f::low_wall(b, &at.moved(0.0, 0.06, 0.0), 3.1, 0.55, (p.plinth, p.stone));
    f::low_wall(b, &at.moved(4.5, 0.06, 0.0), 5.5, 0.55, (p.plinth, p.stone));
    for x in [3.1, 4.5] {
        f::pillar(b, &at.moved(x, 0.0, 0.0), 0.95, (p.plinth, p.stone));
    }
    path(b, &at, (3.2, 4.4), (0.0, 2.6), p.slabs);
    g::flowers(b, &at.moved(0.2, 0.5, 0.05), [2.8, 1.2, 0.40], 900, (p.hedge, p.flowers), 51);
    g::flowers(b, &at.moved(4.9, 0.5, 0.05), [4.8, 0.9, 0.35], 1300, (p.hedge, p.flowers), 52);
    g::climber(b, &at.moved(8.9, 2.6, 0.0), 0.0, (1.0, 3.2), p.ivy, 53);
    // Hedge and lawn before the porch house, a picket fence along the pavement.
    let at = left(46.0);
    f::pickets(b, &at.moved(-9.4, 0.12, 0.0), 19.6, Some((12.3, 13.6)), p.white);
    path(b, &at, (2.95, 4.15), (0.0, 6.2 - PORCH.depth - 0.6), p.slabs);
    g::flowers(b, &at.moved(0.5, 3.35, 0.02), [2.0, 0.5, 0.45], 420, (p.hedge, p.flowers), 54);
    g::flowers(b, &at.moved(4.6, 3.35, 0.02), [2.0, 0.5, 0.45], 420, (p.hedge, p.flowers), 55);
    let side = Frame::facing(at.at(10.0, 6.3, 0.0), at.right);
    g::hedge(b, &side, [6.0, 0.7, 1.25], 0.10, growth, 56);
    // Right: a hedge in the sunny gap, railings before the white house.
    let at = right(37.6);
    g::hedge(b, &at.moved(0.2, 0.15, 0.0), [8.4, 0.75, 1.45], 0.10, growth, 57);
    let at = right(50.0);
    f::low_wall(b, &at.moved(0.0, 0.05, 0.0), 6.2, 0.35, (p.brick, p.stone));
    f::railings(b, &at.moved(0.0, 0.17, 0.0), 6.2, 0.42, 1.05, p.iron);
    f::low_wall(b, &at.moved(7.6, 0.05, 0.0), 3.4, 0.35, (p.brick, p.stone));
    f::railings(b, &at.moved(7.6, 0.17, 0.0), 3.4, 0.42, 1.05, p.iron);
    path(b, &at, (6.3, 7.5), (0.0, 2.4), p.gravel);
    g::flowers(b, &at.moved(0.3, 0.5, 0.02), [5.6, 1.1, 0.45], 1000, (p.hedge, p.flowers), 58);
    // Gaps farther on: walls and hedges, coarser.
    g::hedge(b, &left(57.2).moved(0.0, 0.1, 0.0), [3.6, 0.6, 1.5], 0.14, growth, 59);
    f::low_wall(b, &left(83.6).moved(0.0, 0.1, 0.0), 3.3, 1.6, (p.plinth, p.stone));
    g::hedge(b, &right(71.4).moved(0.0, 0.2, 0.0), [7.8, 0.7, 1.5], 0.14, growth, 60);
    f::low_wall(b, &right(18.9).moved(0.0, 0.1, 0.0), 3.1, 1.9, (p.brown_brick, p.stone));
    for (index, (from, to)) in [
        (DVec3::new(-EDGE - 0.02, 37.0, PLOT), DVec3::new(-EDGE - 0.02, 46.0, PLOT)),
        (DVec3::new(-EDGE - 0.02, 49.0, PLOT), DVec3::new(-EDGE - 0.02, 56.0, PLOT)),
        (DVec3::new(EDGE + 0.05, 29.2, PLOT), DVec3::new(EDGE + 0.05, 37.2, PLOT)),
        (DVec3::new(-EDGE + 0.0, 14.4, PLOT), DVec3::new(-EDGE + 0.0, 24.0, PLOT)),
        (DVec3::new(-EDGE - 2.5, 38.0, PLOT), DVec3::new(-EDGE - 2.0, 56.0, PLOT)),
    ]
    .into_iter()
    .enumerate()
    {
        let wide = if index == 4 { 0.9 } else { 0.07 };
        g::tufts(b, (from, to), wide, (26.0, 0.13), p.blade, 70 + index as u64);
    }
}

/// A path through a front garden, a little above the lawn.
fn path(b: &mut Builder, at: &Frame, (x0, x1): (f64, f64), (y0, y1): (f64, f64), paint: PaintId) {
    b.block(at, [x0, y0, -0.05], [x1, y1, 0.02], paint, faces::TOP | faces::LEFT | faces::RIGHT);
}

fn trees(b: &mut Builder, p: &Palette) {
    let linden = Kind {
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
    };
    let birch = Kind {
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
    };
    let rowan = Kind {
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
    };
    let far =
        |kind: Kind| Kind { clusters: kind.clusters * 2 / 3, leaves: 24, leaf: kind.leaf * 2.3, ..kind };
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
        (-15.5, 34.0, far(linden)),
        (17.5, 37.5, far(linden)),
        (-19.0, 13.0, far(linden)),
        (18.5, 17.5, far(linden)),
        (-8.5, 112.5, far(linden)),
        (8.0, 110.4, far(linden)),
    ]
    .into_iter()
    .enumerate()
    {
        tree(b, DVec3::new(x, y, PLOT - 0.03), &kind, 200 + seed as u64);
    }
    let road = |y0: f64, y1: f64, x0: f64, x1: f64, z: f64| (DVec3::new(x0, y0, z), DVec3::new(x1, y1, z));
    g::fallen(b, road(36.0, 46.0, -3.0, -2.2, 0.0), 260, p.fallen, 301);
    g::fallen(b, road(35.0, 46.0, -5.2, -3.2, PLOT), 260, p.fallen, 302);
    g::fallen(b, road(28.0, 38.0, 2.1, 3.0, 0.0), 260, p.fallen, 303);
    g::fallen(b, road(28.0, 38.0, 3.2, 5.2, PLOT), 260, p.fallen, 304);
    g::fallen(b, road(8.0, 16.0, -5.2, -2.3, 0.0), 120, p.fallen, 305);
    g::fallen(b, road(36.5, 45.0, -11.5, -6.0, PLOT), 380, p.fallen, 306);
}

fn furniture(b: &mut Builder, p: &Palette) {
    for y in [-6.0, 21.0, 48.0, 75.0, 102.0] {
        let at = Frame::facing(DVec3::new(3.55, y, PLOT), -DVec3::X);
        f::lamp(b, &at, p);
    }
    for y in [7.5, 34.5, 61.5, 88.5] {
        let at = Frame::facing(DVec3::new(-3.55, y, PLOT), DVec3::X);
        f::lamp(b, &at, p);
    }
    // The bench stands under the lime tree and looks at the street.
    let at = Frame::facing(DVec3::new(-4.45, 38.6, PLOT), -DVec3::X);
    f::bench(b, &at, (p.oak, p.iron));
    f::bin(b, DVec3::new(-4.6, 37.9, PLOT), p);
    // One on the porch.
    let porch = porch_frame();
    f::bench(b, &porch.moved(4.4, -0.72, PORCH.floor), (p.oak, p.iron));
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
        g::flowers(b, &at, [2.0 * radius, 2.0 * radius, 0.34], 130, (p.hedge, p.flowers), 400 + index as u64);
    }
    // Before the shop: crates with fruit and a board.
    let shop = right(15.6);
    for (index, (x, fruit)) in [(5.2, p.apples), (5.9, p.pears), (6.6, p.apples)].into_iter().enumerate() {
        f::crates(b, &shop.moved(x, -0.45, 0.0), (p.oak, fruit), 500 + index as u64);
    }
    f::board(b, &shop.turned(3.6, -1.0, 0.0, 68.0), (p.oak, p.iron));
    for (x, y) in [(-0.9, 9.0), (1.1, 26.5), (-0.6, 47.0)] {
        f::manhole(b, DVec3::new(x, y, 0.0), p);
    }
    for y in [5.5, 18.0, 31.0, 46.0, 62.0] {
        f::drain(b, &Frame::facing(DVec3::new(2.72, y, 0.0), DVec3::Y), p);
        f::drain(b, &Frame::facing(DVec3::new(-3.03, y + 4.0, 0.0), DVec3::Y), p);
    }
    let red = b.paint(Material::Timber, 0x7A2E2A, 0x7A2E2A);
    f::bicycle(b, &left(27.2).moved(0.45, -0.22, 0.0), p.green_metal, p);
    f::bicycle(b, &right(28.6).moved(6.9, -0.27, 0.0), red, p);
    f::sign(b, &Frame::facing(DVec3::new(-3.6, 57.5, PLOT), DVec3::Y), p);
    f::aerial(b, left(14.2).at(1.4, 6.9, 7.9), p.zinc);
    f::aerial(b, right(28.6).at(4.7, 6.5, 10.9), p.zinc);
    let mut last: Option<[DVec3; 3]> = None;
    for y in [-32.0, 3.2, 30.0, 58.0, 86.0, 114.0, 142.0] {
        let tops = f::pole(b, DVec3::new(4.9, y, PLOT), p);
        if let Some(before) = last {
            for (from, to) in before.into_iter().zip(tops) {
                f::wire(b, from, to, 0.45, p.iron);
            }
        }
        last = Some(tops);
    }
}

fn houses_far(b: &mut Builder, p: &Palette) -> [Finish; 3] {
    let white = b.paint(Material::Plaster, 0xE6E0D2, 0xCFC8B8);
    let ochre = b.paint(Material::Plaster, 0xD8BC8C, 0xB89860);
    [p.finish(white, p.oak), p.finish(p.brick, p.oak), p.finish(ochre, p.oak)]
}
