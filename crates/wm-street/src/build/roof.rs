//! Pitched roofs, gables, chimneys, dormers, gutters.

use super::builder::{Builder, Frame, faces};
use super::facade::{Filling, Finish, window};
use crate::paint::PaintId;
use glam::DVec3;

/// A roof of two slopes. In its frame the ridge runs along x from 0 to `length`, the slopes rise
/// over y from 0 to `span`; walls end at `eaves`, m.
#[derive(Clone, Copy, Debug)]
pub(super) struct Roof {
    pub(crate) length: f64,
    pub(crate) span: f64,
    pub(crate) eaves: f64,
    /// Degrees.
    pub(crate) pitch: f64,
    /// The overhang beyond the walls below the slopes, m.
    pub(crate) overhang: f64,
    /// The overhang beyond the gables, m.
    pub(crate) verge: f64,
    pub(crate) paint: PaintId,
    /// Boards along its edges.
    pub(crate) trim: PaintId,
}

/// Thickness of a roof, m.
const ROOF_THICKNESS_M: f64 = 0.13;

impl Roof {
    /// Height of the ridge above the frame's origin, m.
    fn ridge(&self) -> f64 {
        self.eaves + 0.5 * self.span * self.slope()
    }

    fn slope(&self) -> f64 {
        self.pitch.to_radians().tan()
    }

    /// Slopes, undersides, edge boards and ridge tiles.
    pub(super) fn build(&self, b: &mut Builder, frame: &Frame) {
        let across = self.length + 2.0 * self.verge;
        let run = 0.5 * self.span + self.overhang;
        let rise = run * self.slope();
        let lift = ROOF_THICKNESS_M / self.pitch.to_radians().cos();
        // The second slope is the first seen from behind.
        for half in [*frame, frame.opposite(self.length, self.span)] {
            let low = half.moved(-self.verge, -self.overhang, self.eaves - self.overhang * self.slope());
            let (u, v) = (half.along(across, 0.0, 0.0), half.along(0.0, run, rise));
            b.quad(low.at(0.0, 0.0, lift), u, v, self.paint);
            // Only what overhangs has an underside: the attic is never seen.
            let (eaves, verge) = (self.overhang / run, half.along(-self.verge, 0.0, 0.0));
            b.quad(low.at(across, 0.0, 0.0), -u, v * eaves, self.trim);
            for x in [self.verge, across] {
                b.quad(low.at(x, 0.0, 0.0) + v * eaves, verge, v * (1.0 - eaves), self.trim);
            }
            b.quad(low.at(0.0, -0.012, -0.05), u, DVec3::Z * (lift + 0.02), self.trim);
            // Boards up the gables, on both their faces.
            for (x, outward) in [(0.0, -1.0), (across, 1.0)] {
                let (foot, up, inner_up) =
                    (low.at(x, 0.0, -0.06), DVec3::Z * (lift + 0.075), DVec3::Z * 0.07);
                let inner = foot - half.along(outward * 0.035, 0.0, 0.0);
                if outward > 0.0 {
                    b.quad(foot + half.along(0.012, 0.0, 0.0), v, up, self.trim);
                    b.quad(inner, inner_up, v, self.trim);
                } else {
                    b.quad(foot - half.along(0.012, 0.0, 0.0), up, v, self.trim);
                    b.quad(inner, v, inner_up, self.trim);
                }
            }
        }
        let ridge = self.ridge() + lift - 0.045;
        let y = 0.5 * self.span;
        let (from, to) = (frame.at(-self.verge, y, ridge), frame.at(self.length + self.verge, y, ridge));
        b.stump(from, to, [0.10; 2], self.paint);
    }

    /// The triangle of wall under the slopes at x = 0; `finish.wall` on its outside.
    pub(super) fn gables(&self, b: &mut Builder, frame: &Frame, wall: PaintId) {
        let up = 0.5 * self.span * self.slope();
        let peak = |sign: f64| frame.along(0.0, sign * 0.5 * self.span, up);
        b.triangle(frame.at(0.0, self.span, self.eaves), frame.along(0.0, -self.span, 0.0), peak(-1.0), wall);
        b.triangle(frame.at(self.length, 0.0, self.eaves), frame.along(0.0, self.span, 0.0), peak(1.0), wall);
    }

    /// Gutter and downpipes along the front eaves.
    pub(super) fn gutter(&self, b: &mut Builder, frame: &Frame, metal: PaintId) {
        let z = self.eaves - self.overhang * self.slope() + 0.02;
        let y = -self.overhang - 0.06;
        let (from, to) = (frame.at(-self.verge, y, z), frame.at(self.length + self.verge, y, z));
        b.stump(from, to, [0.06; 2], metal);
        b.disc(from, -frame.right, 0.06, metal);
        b.disc(to, frame.right, 0.06, metal);
        let x = self.length - 0.18;
        let knee = frame.at(x, -0.07, z - 0.35);
        b.stump(frame.at(x, y, z - 0.02), knee, [0.04; 2], metal);
        b.stump(knee, frame.at(x, -0.07, 0.05), [0.04; 2], metal);
        for share in [0.12, 0.5, 0.88] {
            let at = frame.moved(x, -0.07, (z - 0.35) * share);
            b.stump(at.at(0.0, 0.0, -0.02), at.at(0.0, 0.0, 0.02), [0.05; 2], metal);
        }
    }

    /// A chimney on the ridge at `x`, with its pots.
    pub(super) fn chimney(
        &self,
        b: &mut Builder,
        frame: &Frame,
        x: f64,
        brick: PaintId,
        stone: PaintId,
        pot: PaintId,
    ) {
        let at = frame.moved(x, 0.5 * self.span, self.ridge());
        let (w, d) = (0.45, 0.30);
        b.block(&at, [-w, -d, -0.9], [w, d, 0.95], brick, faces::STANDING);
        b.block(&at, [-w - 0.05, -d - 0.05, 0.80], [w + 0.05, d + 0.05, 0.90], brick, faces::ALL);
        b.block(&at, [-w - 0.03, -d - 0.03, 0.95], [w + 0.03, d + 0.03, 1.02], stone, faces::ALL);
        for x in [-0.22, 0.22] {
            b.post(at.at(x, 0.0, 1.02), 0.32, [0.12, 0.10], pot);
        }
    }

    /// A dormer on the front slope about `x`.
    pub(super) fn dormer(&self, b: &mut Builder, frame: &Frame, x: f64, finish: &Finish) {
        let (half, high) = (0.75, 1.25);
        // Its face stands a little up the slope.
        let y = 0.55;
        let z = self.eaves + y * self.slope();
        let at = frame.moved(x - half, y, z);
        let depth = (high + 0.35) / self.slope() + 0.6;
        let sides = Frame { origin: at.at(0.0, 0.0, -0.3), ..at };
        let walls = faces::LEFT | faces::RIGHT;
        b.block(&sides, [0.0, 0.02, 0.0], [2.0 * half, depth, high + 0.3], finish.wall, walls);
        b.upright(&sides, [0.0; 3], 2.0 * half, high + 0.3, finish.wall);
        let pane = at.moved(0.22, -0.26, 0.15);
        b.block(&at, [0.16, -0.12, 0.09], [2.0 * half - 0.16, 0.0, high - 0.02], finish.frame, faces::FIXED);
        window(b, &pane, (2.0 * half - 0.44, high - 0.25), Filling::Casement, finish);
        let turned = Frame { origin: at.at(2.0 * half, 0.0, 0.0), right: at.back, back: -at.right };
        let roof = Roof {
            length: depth,
            span: 2.0 * half,
            eaves: high,
            pitch: 38.0,
            overhang: 0.16,
            verge: 0.14,
            paint: self.paint,
            trim: finish.frame,
        };
        roof.build(b, &turned);
        roof.gables(b, &turned, finish.wall);
    }
}
