//! Small buildings of a park: an open pavilion and a shed.

use super::builder::{Builder, Frame, faces};
use super::palette::Palette;
use super::roof::Roof;
use crate::paint::PaintId;

/// A roof on posts above a floor of slabs, 6 by 4.4 m; in its frame x and y run from 0.
pub(super) fn pavilion(b: &mut Builder, at: &Frame, p: &Palette) {
    let (long, deep, high) = (6.0, 4.4, 2.5);
    b.block(at, [-0.4, -0.4, -0.4], [long + 0.4, deep + 0.4, 0.12], p.slabs, faces::STANDING);
    for x in [0.2, 0.5 * long, long - 0.2] {
        for y in [0.2, deep - 0.2] {
            let post = at.moved(x, y, 0.12);
            b.block(&post, [-0.08, -0.08, 0.0], [0.08, 0.08, high - 0.12], p.oak, faces::STANDING);
            b.block(&post, [-0.13, -0.13, 0.0], [0.13, 0.13, 0.12], p.stone, faces::STANDING);
            for side in [-1.0, 1.0] {
                let (foot, head) = (post.at(0.0, 0.0, 1.6), post.at(side * 0.55, 0.0, high - 0.14));
                b.stump(foot, head, [0.04, 0.04], p.oak);
            }
        }
    }
    for y in [0.12, deep - 0.28] {
        b.block(at, [-0.2, y, high], [long + 0.2, y + 0.16, high + 0.18], p.oak, faces::ALL);
    }
    for x in [0.12, 0.5 * long - 0.08, long - 0.28] {
        b.block(at, [x, 0.0, high], [x + 0.16, deep, high + 0.14], p.oak, faces::ALL);
    }
    let roof = Roof {
        length: long,
        span: deep,
        eaves: high + 0.18,
        pitch: 32.0,
        overhang: 0.55,
        verge: 0.5,
        paint: p.clay,
        trim: p.oak,
    };
    roof.build(b, at);
    roof.gables(b, at, p.oak);
}

/// A boarded shed with a door and a slate roof, 4 by 3 m.
pub(super) fn shed(b: &mut Builder, at: &Frame, boards: PaintId, p: &Palette) {
    let (long, deep, high) = (4.0, 3.0, 2.2);
    b.block(at, [-0.06, -0.06, -0.4], [long + 0.06, deep + 0.06, 0.15], p.plinth, faces::STANDING);
    b.block(at, [0.0, 0.0, 0.15], [long, deep, high], boards, faces::STANDING & !faces::TOP);
    b.block(at, [0.6, -0.04, 0.15], [1.5, 0.0, 2.05], p.green_metal, faces::FIXED);
    b.block(at, [0.52, -0.05, 0.15], [0.6, 0.0, 2.13], p.white, faces::FIXED);
    b.block(at, [1.5, -0.05, 0.15], [1.58, 0.0, 2.13], p.white, faces::FIXED);
    b.block(at, [2.3, -0.05, 1.0], [3.3, 0.0, 1.8], p.white, faces::FIXED);
    b.upright(at, [2.37, -0.055, 1.07], 0.86, 0.66, p.glass);
    let roof = Roof {
        length: long,
        span: deep,
        eaves: high,
        pitch: 38.0,
        overhang: 0.3,
        verge: 0.25,
        paint: p.slate,
        trim: p.white,
    };
    roof.build(b, at);
    roof.gables(b, at, boards);
}
