//! The porch: a lean-to on posts that shelters its floor, with railing and steps.

use super::builder::{Builder, Frame, faces};
use super::palette::Palette;
use crate::paint::PaintId;
use glam::DVec3;

/// The part of the porch that its roof shelters, in its frame: from and to along x, depth, m.
#[derive(Clone, Copy, Debug)]
pub(super) struct Porch {
    pub(crate) from: f64,
    pub(crate) to: f64,
    pub(crate) depth: f64,
    /// Height of its floor, m.
    pub(crate) floor: f64,
}

impl Porch {
    /// Builds a lean-to on posts before the wall of a frame.
    pub(super) fn build(&self, b: &mut Builder, frame: &Frame, roof: PaintId, p: &Palette) {
        let (x0, x1, d, floor) = (self.from, self.to, self.depth, self.floor);
        let walls = faces::FRONT | faces::LEFT | faces::RIGHT;
        b.block(frame, [x0, -d, 0.0], [x1, 0.0, floor - 0.04], p.plinth, walls);
        b.block(frame, [x0 - 0.05, -d - 0.05, floor - 0.04], [x1 + 0.05, -0.0, floor], p.deck, faces::FIXED);
        let (low, high) = (floor + 2.25, floor + 3.05);
        let middle = 0.5 * (x0 + x1);
        let posts = [x0 + 0.10, middle - 0.85, middle + 0.85, x1 - 0.10];
        for x in posts {
            let at = frame.moved(x, -d + 0.12, floor);
            b.block(&at, [-0.07, -0.07, 0.0], [0.07, 0.07, low - floor], p.white, faces::STANDING);
            b.block(&at, [-0.10, -0.10, 0.0], [0.10, 0.10, 0.14], p.white, faces::STANDING);
            let top = low - floor;
            b.block(&at, [-0.095, -0.095, top - 0.12], [0.095, 0.095, top], p.white, faces::ALL);
            for side in [-1.0, 1.0] {
                let (foot, head) =
                    (at.at(side * 0.06, 0.0, 1.75), at.at(side * 0.46, 0.0, low - floor + 0.03));
                b.stump(foot, head, [0.035, 0.035], p.white);
            }
        }
        b.block(frame, [x0, -d + 0.03, low - 0.02], [x1, -d + 0.20, low + 0.17], p.white, faces::ALL);
        for x in [x0 + 0.03, x1 - 0.17] {
            b.block(frame, [x, -d + 0.2, low + 0.02], [x + 0.14, 0.0, low + 0.16], p.white, faces::ALL);
        }
        self.railing(b, frame, &posts, p);
        self.lean_to(b, frame, low + 0.17, high, roof, p);
        // Steps between the two middle posts.
        let steps = [(0.30, floor - 0.16), (0.60, floor - 0.31)];
        for (reach, top) in steps {
            let (low, high) = ([middle - 0.75, -d - reach - 0.05, 0.0], [middle + 0.75, -d, top.max(0.05)]);
            b.block(frame, low, high, p.stone, faces::STANDING);
        }
        let bulb = frame.at(middle + 0.5, -0.55 * d, low + 0.12);
        b.stump(bulb + DVec3::Z * 0.5, bulb + DVec3::Z * 0.12, [0.008, 0.008], p.iron);
        b.stump(bulb + DVec3::Z * 0.12, bulb, [0.04, 0.13], p.iron);
        b.ball(bulb - DVec3::Z * 0.01, DVec3::splat(0.055), p.lantern);
    }

    fn railing(&self, b: &mut Builder, frame: &Frame, posts: &[f64; 4], p: &Palette) {
        let (y, z) = (-self.depth + 0.12, self.floor);
        let sides = faces::LEFT | faces::RIGHT | faces::FRONT | faces::BACK;
        let baluster = |b: &mut Builder, x: f64, y: f64| {
            let (low, high) = ([x - 0.016, y - 0.016, z + 0.16], [x + 0.016, y + 0.016, z + 0.84]);
            b.block(frame, low, high, p.white, sides);
        };
        for (from, to) in [(posts[0] + 0.07, posts[1] - 0.07), (posts[2] + 0.07, posts[3] - 0.07)] {
            b.block(frame, [from, y - 0.04, z + 0.84], [to, y + 0.04, z + 0.90], p.white, faces::ALL);
            b.block(frame, [from, y - 0.025, z + 0.12], [to, y + 0.025, z + 0.16], p.white, faces::ALL);
            let count = ((to - from) / 0.13) as usize;
            for index in 0..count {
                let x = from + (to - from) * (index as f64 + 0.5) / count as f64;
                baluster(b, x, y);
            }
        }
        for x in [self.from + 0.10, self.to - 0.10] {
            b.block(frame, [x - 0.04, y + 0.07, z + 0.84], [x + 0.04, 0.0, z + 0.90], p.white, faces::ALL);
            b.block(frame, [x - 0.025, y + 0.07, z + 0.12], [x + 0.025, 0.0, z + 0.16], p.white, faces::ALL);
            let count = ((-y - 0.07) / 0.13) as usize;
            for index in 0..count {
                let at = y + 0.07 + (-y - 0.07) * (index as f64 + 0.5) / count as f64;
                baluster(b, x, at);
            }
        }
    }

    fn lean_to(&self, b: &mut Builder, frame: &Frame, low: f64, high: f64, roof: PaintId, p: &Palette) {
        let (over, d) = (0.32, self.depth);
        let slope = (high - low) / d;
        let (x0, x1) = (self.from - 0.25, self.to + 0.25);
        let foot = low - over * slope;
        let (u, v) = (frame.along(x1 - x0, 0.0, 0.0), frame.along(0.0, d + over, (d + over) * slope));
        b.quad(frame.at(x0, -d - over, foot + 0.12), u, v, roof);
        b.quad(frame.at(x1, -d - over, foot), -u, v, p.white);
        b.quad(frame.at(x0, -d - over - 0.01, foot - 0.03), u, DVec3::Z * 0.17, p.white);
        b.quad(frame.at(x0, -d - over, foot - 0.02), DVec3::Z * 0.15, v, p.white);
        b.quad(frame.at(x1, -d - over, foot - 0.02), v, DVec3::Z * 0.15, p.white);
        // Triangles between the side beams and the slope.
        for x in [self.from + 0.04, self.to - 0.04] {
            let up = frame.along(0.0, 0.0, high - low);
            b.triangle(frame.at(x, 0.0, low), frame.along(0.0, -d, 0.0), up, p.white);
        }
        let y = -d - over - 0.07;
        b.stump(frame.at(x0, y, foot + 0.08), frame.at(x1, y, foot + 0.08), [0.055; 2], p.iron);
    }
}
