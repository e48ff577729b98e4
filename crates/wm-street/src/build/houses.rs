//! The houses along the street, one after the other.

use super::builder::{Builder, Frame};
use super::facade::Filling;
use super::house::{Dress, House, Ridge};
use super::lots::{left, right};
use super::palette::{Palette, paints};
use super::porch::Porch;
use super::{furniture, props};
use crate::paint::{Material, PaintId};
use glam::DVec3;

paints! {
    /// Paints of the walls, doors and cloths of the houses.
    HousePaints {
        white: Plaster, 0xEAE4D6, 0xCFC8B8;
        ochre: Plaster, 0xD8BE93, 0xB89860;
        rose: Plaster, 0xD0BAAC, 0xB48872;
        blue: Plaster, 0xB9C0C2, 0x8A969C;
        sage: Boards, 0xD2CFC2, 0x98A28C;
        red_door: Timber, 0x7E2A27, 0x7E2A27;
        green: Timber, 0x2F5646, 0x2F5646;
        navy: Timber, 0x2C4562, 0x2C4562;
        beam: Timber, 0x4A3526, 0x4A3526;
        awning: Cloth, 0xE9E2D0, 0xB3473A;
    }
}

/// Builds the houses from behind the camera to the far end, first on the left.
pub(super) fn build(b: &mut Builder, p: &Palette) {
    let paints = HousePaints::new(b);
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
        finish: p.finish(paints.white, paints.green),
    };
    let across = House { ridge: Ridge::Across, columns: 3, ..base.clone() };
    build_left(b, p, &paints, &base, &across);
    build_right(b, p, &paints, &base, &across);
}

/// Moves a frame away from the street by a setback, m.
fn back(frame: Frame, setback: f64) -> Frame {
    frame.moved(0.0, setback, 0.0)
}

fn build_left(b: &mut Builder, p: &Palette, paints: &HousePaints, base: &House, across: &House) {
    let &HousePaints { white, ochre, rose, blue, sage, red_door, green, navy, beam, .. } = paints;
    House {
        width: 11.0,
        chimneys: vec![9.6],
        roof: p.slate,
        finish: p.finish(p.brick, navy),
        ..base.clone()
    }
    .build(b, &back(left(-29.0), 0.15));
    House { finish: p.finish(ochre, red_door), ..across.clone() }.build(b, &back(left(-14.0), 0.15));
    House {
        width: 11.0,
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
        storeys: 1,
        storey: 2.8,
        pitch: 48.0,
        dormers: 2,
        dress: Dress::Shutters(navy),
        finish: p.finish(ochre, navy),
        ..base.clone()
    };
    cottage.build(b, &back(left(14.2), 2.6));
    let timbered = House {
        width: 8.6,
        depth: 10.0,
        storey: 2.6,
        pitch: 50.0,
        door: 2,
        dress: Dress::Beams(beam),
        roof: p.brown_tiles,
        chimneys: vec![6.5],
        finish: p.finish(white, p.oak),
        ..across.clone()
    };
    let at = back(left(27.2), 0.2);
    for (index, opening) in timbered.build(b, &at).iter().enumerate() {
        if opening.filling != Filling::Door {
            props::window_box(b, &at, opening, p, 600 + index as u64);
        }
    }
    let porch_house = House {
        width: 10.4,
        depth: 8.4,
        pitch: 42.0,
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
        door: 0,
        dress: Dress::Shutters(green),
        finish: p.finish(rose, green),
        ..across.clone()
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
    House { width: 12.0, columns: 5, finish: p.finish(p.brick, green), ..base.clone() }
        .build(b, &back(left(115.0), 0.2));
}

/// Builds the right side; `right(y)` begins at the larger y.
fn build_right(b: &mut Builder, p: &Palette, paints: &HousePaints, base: &House, across: &House) {
    let &HousePaints { white, ochre, rose, blue, sage, red_door, green, navy, awning, .. } = paints;
    House { width: 11.0, finish: p.finish(white, navy), ..base.clone() }.build(b, &back(right(-13.0), 0.15));
    House {
        width: 10.5,
        roof: p.brown_tiles,
        dress: Dress::Shutters(green),
        finish: p.finish(white, green),
        ..across.clone()
    }
    .build(b, &back(right(2.0), 0.15));
    let shop = House {
        storey: 3.0,
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
    let sign = b.paint(Material::Metal, 0x2F5646, 0x2F5646);
    let gold = b.paint(Material::Metal, 0xC9A24A, 0xC9A24A);
    furniture::hanging_sign(b, &at, 9.7, 4.0, sign, gold, p.iron);
    House {
        width: 9.4,
        depth: 10.0,
        pitch: 47.0,
        window: Filling::Sash,
        dress: Dress::Bands,
        finish: p.finish(p.brown_brick, p.oak),
        ..across.clone()
    }
    .build(b, &back(right(28.6), 0.15));
    House {
        width: 11.0,
        door: 2,
        dress: Dress::Shutters(green),
        chimneys: vec![1.0, 10.0],
        finish: p.finish(white, green),
        ..base.clone()
    }
    .build(b, &back(right(50.0), 2.4));
    House { roof: p.slate, window: Filling::Sash, finish: p.finish(p.brick, navy), ..base.clone() }
        .build(b, &back(right(63.5), 0.2));
    House { width: 9.0, roof: p.brown_tiles, finish: p.finish(ochre, p.oak), ..across.clone() }
        .build(b, &back(right(80.5), 0.2));
    House { width: 11.0, finish: p.finish(sage, red_door), ..base.clone() }.build(b, &back(right(94.5), 0.2));
    House { roof: p.slate, finish: p.finish(rose, navy), ..across.clone() }
        .build(b, &back(right(108.5), 0.2));
    House { width: 12.0, storeys: 1, dormers: 3, columns: 5, finish: p.finish(white, green), ..base.clone() }
        .build(b, &back(right(125.0), 0.8));
}

/// The frame of the house with the porch.
pub(super) fn porch_frame() -> Frame {
    left(46.0).moved(0.0, 6.2, 0.0)
}

pub(super) const PORCH: Porch = Porch { from: 0.6, to: 6.4, depth: 2.3, floor: 0.34 };

/// The corners of the floor that the porch's roof shelters, world axes, m.
pub(crate) fn porch() -> (DVec3, DVec3) {
    let frame = porch_frame();
    let (one, two) = (frame.at(PORCH.from, -PORCH.depth, PORCH.floor), frame.at(PORCH.to, 0.0, PORCH.floor));
    (one.min(two), one.max(two))
}
