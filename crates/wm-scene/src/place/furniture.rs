//! Street furniture: lamps, fences, walls, benches, bins, signs, wires, the porch.

use super::builder::{Builder, Frame, faces};
use super::facade::Opening;
use super::growth;
use super::hash::Dice;
use super::paint::PaintId;
use super::street::Palette;
use glam::DVec3;

/// A lamp with a lantern on a short arm; it faces along the frame's `back`.
pub(super) fn lamp(b: &mut Builder, frame: &Frame, p: &Palette) {
    let iron = p.iron;
    b.post(frame.at(0.0, 0.0, 0.0), 0.10, [0.17, 0.16], iron);
    b.post(frame.at(0.0, 0.0, 0.10), 0.75, [0.11, 0.085], iron);
    b.ball(frame.at(0.0, 0.0, 0.87), DVec3::new(0.10, 0.10, 0.05), iron);
    b.post(frame.at(0.0, 0.0, 0.85), 3.25, [0.058, 0.042], iron);
    b.ball(frame.at(0.0, 0.0, 4.1), DVec3::splat(0.075), iron);
    // A swan's neck out over the road.
    let mut last = frame.at(0.0, 0.0, 4.1);
    for step in 1..=8 {
        let angle = f64::from(step) / 8.0 * 200f64.to_radians();
        let next = frame.at(0.0, 0.36 * (1.0 - angle.cos()), 4.1 + 0.42 * angle.sin().max(-0.3) + 0.15);
        b.stump(last, next, [0.028, 0.026], iron);
        last = next;
    }
    let head = Frame { origin: last, ..*frame };
    b.stump(head.at(0.0, 0.0, -0.02), head.at(0.0, 0.0, -0.14), [0.06, 0.24], iron);
    b.stump(head.at(0.0, 0.0, -0.14), head.at(0.0, 0.0, -0.18), [0.24, 0.235], iron);
    b.stump(head.at(0.0, 0.0, -0.18), head.at(0.0, 0.0, -0.34), [0.17, 0.11], p.lantern);
    b.disc(head.at(0.0, 0.0, -0.34), -DVec3::Z, 0.11, p.lantern);
}

/// A picket fence along x from 0 to `length`, with a gap for a gate.
pub(super) fn pickets(b: &mut Builder, frame: &Frame, length: f64, gate: Option<(f64, f64)>, paint: PaintId) {
    let open = |x: f64| gate.is_some_and(|(from, to)| x > from && x < to);
    let count = (length / 0.135) as usize;
    for index in 0..count {
        let x = 0.135 * index as f64;
        if open(x + 0.04) {
            continue;
        }
        let high = 0.86 + 0.02 * ((index * 7) % 5) as f64 * 0.4;
        b.block(
            frame,
            [x, -0.022, 0.06],
            [x + 0.075, 0.0, high],
            paint,
            faces::ALL & !faces::BOTTOM & !faces::TOP,
        );
        let peak = frame.along(0.0375, 0.0, 0.06);
        b.triangle(frame.at(x, -0.022, high), frame.along(0.075, 0.0, 0.0), peak, paint);
        b.triangle(
            frame.at(x + 0.075, 0.0, high),
            frame.along(-0.075, 0.0, 0.0),
            frame.along(-0.0375, 0.0, 0.06),
            paint,
        );
    }
    let spans = gate.map_or(vec![(0.0, length)], |(from, to)| vec![(0.0, from), (to, length)]);
    for (from, to) in spans {
        for z in [0.25, 0.66] {
            b.block(frame, [from, 0.0, z], [to, 0.035, z + 0.08], paint, faces::ALL & !faces::FRONT);
        }
        for x in [from, to - 0.1] {
            post_with_cap(b, &frame.moved(x, -0.03, 0.0), 1.02, paint);
        }
    }
}

fn post_with_cap(b: &mut Builder, at: &Frame, high: f64, paint: PaintId) {
    b.block(at, [0.0, 0.0, 0.0], [0.10, 0.10, high], paint, faces::STANDING & !faces::TOP);
    b.block(at, [-0.015, -0.015, high], [0.115, 0.115, high + 0.03], paint, faces::ALL);
    b.ball(at.at(0.05, 0.05, high + 0.06), DVec3::splat(0.045), paint);
}

/// A low wall with a coping along x from 0 to `length`.
pub(super) fn low_wall(
    b: &mut Builder,
    frame: &Frame,
    length: f64,
    high: f64,
    (body, coping): (PaintId, PaintId),
) {
    b.block(frame, [0.0, 0.0, 0.0], [length, 0.24, high], body, faces::STANDING & !faces::TOP);
    b.block(frame, [-0.03, -0.035, high], [length + 0.03, 0.275, high + 0.07], coping, faces::ALL);
}

/// Square pillars with caps at both ends of a gap.
pub(super) fn pillar(b: &mut Builder, frame: &Frame, high: f64, (body, cap): (PaintId, PaintId)) {
    b.block(frame, [-0.19, -0.07, 0.0], [0.19, 0.31, high], body, faces::STANDING & !faces::TOP);
    b.block(frame, [-0.24, -0.12, high], [0.24, 0.36, high + 0.08], cap, faces::ALL);
    b.ball(frame.at(0.0, 0.12, high + 0.20), DVec3::splat(0.14), cap);
}

/// Iron railings along x from 0 to `length`.
pub(super) fn railings(b: &mut Builder, frame: &Frame, length: f64, foot: f64, high: f64, paint: PaintId) {
    let count = (length / 0.15) as usize;
    for index in 0..=count {
        let x = length * index as f64 / count as f64;
        b.stump(frame.at(x, 0.0, foot), frame.at(x, 0.0, high), [0.011, 0.011], paint);
        b.stump(frame.at(x, 0.0, high), frame.at(x, 0.0, high + 0.09), [0.02, 0.003], paint);
    }
    for z in [foot + 0.12, high - 0.12] {
        b.block(frame, [0.0, -0.018, z], [length, 0.018, z + 0.022], paint, faces::ALL);
    }
}

/// A bench, seen from its front at y = 0.
pub(super) fn bench(b: &mut Builder, frame: &Frame, (wood, iron): (PaintId, PaintId)) {
    let long = 1.7;
    for slat in 0..4 {
        let y = 0.03 + 0.115 * f64::from(slat);
        b.block(frame, [0.0, y, 0.43], [long, y + 0.095, 0.465], wood, faces::ALL);
    }
    for slat in 0..3 {
        let (z, y) = (0.56 + 0.125 * f64::from(slat), 0.50 + 0.035 * f64::from(slat));
        let (u, v) = (frame.along(long, 0.0, 0.0), frame.along(0.0, 0.028, 0.10));
        b.quad(frame.at(0.0, y, z), u, v, wood);
        b.quad(frame.at(long, y + 0.03, z), -u, v, wood);
        b.quad(frame.at(0.0, y, z) + v, u, frame.along(0.0, 0.03, 0.0), wood);
    }
    for x in [0.12, long - 0.17] {
        b.block(frame, [x, 0.06, 0.0], [x + 0.05, 0.11, 0.43], iron, faces::STANDING);
        b.block(frame, [x, 0.44, 0.0], [x + 0.05, 0.49, 0.50], iron, faces::STANDING);
        b.block(frame, [x, 0.06, 0.39], [x + 0.05, 0.49, 0.43], iron, faces::ALL);
        b.stump(frame.at(x + 0.025, 0.47, 0.48), frame.at(x + 0.025, 0.60, 0.95), [0.024, 0.02], iron);
        b.block(frame, [x - 0.01, 0.02, 0.63], [x + 0.06, 0.50, 0.66], wood, faces::ALL);
        b.block(frame, [x + 0.01, 0.05, 0.46], [x + 0.04, 0.09, 0.63], iron, faces::STANDING);
    }
}

/// A litter bin on a foot.
pub(super) fn bin(b: &mut Builder, foot: DVec3, p: &Palette) {
    let up = DVec3::Z;
    b.stump(foot, foot + up * 0.10, [0.16, 0.16], p.iron);
    b.stump(foot + up * 0.10, foot + up * 0.80, [0.21, 0.24], p.green_metal);
    b.stump(foot + up * 0.80, foot + up * 0.84, [0.255, 0.255], p.iron);
    b.disc(foot + up * 0.72, up, 0.235, p.iron);
    for z in [0.22, 0.66] {
        b.stump(foot + up * z, foot + up * (z + 0.035), [0.232 + 0.02 * z, 0.233 + 0.02 * z], p.iron);
    }
}

/// A tub with a round shrub or flowers in it; gives the height of its soil.
pub(super) fn tub(b: &mut Builder, foot: DVec3, radius: f64, p: &Palette) -> f64 {
    let high = 1.5 * radius;
    b.stump(foot, foot + DVec3::Z * high, [0.75 * radius, radius], p.terracotta);
    b.stump(
        foot + DVec3::Z * (high - 0.07),
        foot + DVec3::Z * high,
        [radius + 0.02, radius + 0.025],
        p.terracotta,
    );
    b.disc(foot + DVec3::Z * (high - 0.03), DVec3::Z, radius, p.soil);
    high
}

/// A wooden pole for wires, and the points where they are fixed.
pub(super) fn pole(b: &mut Builder, foot: DVec3, p: &Palette) -> [DVec3; 3] {
    b.post(foot, 7.6, [0.13, 0.09], p.pole);
    let arm = Frame::facing(foot + DVec3::Z * 7.1, DVec3::Y);
    b.block(&arm, [-0.75, -0.16, -0.05], [0.75, -0.08, 0.06], p.pole, faces::ALL);
    [-0.65, 0.15, 0.65].map(|x| {
        let at = arm.at(x, -0.12, 0.06);
        b.stump(at, at + DVec3::Z * 0.10, [0.035, 0.025], p.lantern);
        at + DVec3::Z * 0.10
    })
}

/// A wire that sags by `sag` m between two points.
pub(super) fn wire(b: &mut Builder, from: DVec3, to: DVec3, sag: f64, paint: PaintId) {
    let steps = 10;
    let point = |step: i32| {
        let t = f64::from(step) / f64::from(steps);
        from.lerp(to, t) - DVec3::Z * (4.0 * sag * t * (1.0 - t))
    };
    for step in 0..steps {
        b.stump(point(step), point(step + 1), [0.006, 0.006], paint);
    }
}

/// A sign that hangs from a bracket on a wall; in the wall's frame at `(x, z)`.
pub(super) fn hanging_sign(
    b: &mut Builder,
    frame: &Frame,
    x: f64,
    z: f64,
    (board, rim, iron): (PaintId, PaintId, PaintId),
) {
    let at = frame.moved(x, 0.0, z);
    b.block(&at, [-0.02, -1.0, 0.0], [0.02, 0.0, 0.04], iron, faces::FIXED);
    b.stump(at.at(0.0, -0.02, -0.45), at.at(0.0, -0.62, 0.0), [0.014, 0.014], iron);
    for y in [-0.92, -0.28] {
        b.stump(at.at(0.0, y, 0.0), at.at(0.0, y, -0.10), [0.009, 0.009], iron);
    }
    b.block(&at, [-0.025, -0.98, -0.78], [0.025, -0.22, -0.10], rim, faces::ALL);
    b.block(&at, [-0.032, -0.93, -0.73], [0.032, -0.27, -0.15], board, faces::LEFT | faces::RIGHT);
    for side in [-1.0, 1.0] {
        b.disc(at.at(side * 0.036, -0.60, -0.44), at.right * side, 0.17, rim);
    }
}

/// A cover in the carriageway: a rim, a plate and its ribs.
pub(super) fn manhole(b: &mut Builder, at: DVec3, p: &Palette) {
    b.disc(at + DVec3::Z * 0.003, DVec3::Z, 0.36, p.cast_iron);
    b.disc(at + DVec3::Z * 0.006, DVec3::Z, 0.31, p.iron);
    b.disc(at + DVec3::Z * 0.009, DVec3::Z, 0.295, p.cast_iron);
    let frame = Frame::facing(at + DVec3::Z * 0.009, DVec3::Y);
    for row in -2i32..=2 {
        let (y, half) = (0.1 * f64::from(row), if row.abs() == 2 { 0.18 } else { 0.26 });
        b.block(&frame, [-half, y - 0.02, 0.0], [half, y + 0.02, 0.006], p.iron, faces::TOP);
    }
}

/// A grate in the gutter, 0.30 by 0.45 m from the frame's origin.
pub(super) fn drain(b: &mut Builder, frame: &Frame, p: &Palette) {
    b.block(frame, [0.0, 0.0, 0.0], [0.30, 0.45, 0.004], p.cast_iron, faces::TOP);
    for slot in 0..6 {
        let y = 0.045 + 0.066 * f64::from(slot);
        b.block(frame, [0.04, y, 0.004], [0.26, y + 0.032, 0.007], p.slot, faces::TOP);
    }
}

/// Two crates on one another, the upper one tilted and full of fruit.
pub(super) fn crates(b: &mut Builder, frame: &Frame, (wood, fruit): (PaintId, PaintId), seed: u64) {
    let mut dice = Dice::new(b.seed, seed);
    let slatted = |b: &mut Builder, at: &Frame| {
        let (w, d) = (0.58, 0.40);
        for z in [0.02, 0.12, 0.22] {
            b.block(at, [0.0, 0.0, z], [w, 0.018, z + 0.075], wood, faces::ALL);
            b.block(at, [0.0, d - 0.018, z], [w, d, z + 0.075], wood, faces::ALL);
            b.block(at, [0.0, 0.018, z], [0.018, d - 0.018, z + 0.075], wood, faces::ALL);
            b.block(at, [w - 0.018, 0.018, z], [w, d - 0.018, z + 0.075], wood, faces::ALL);
        }
        b.quad(at.at(0.0, 0.0, 0.16), at.along(w, 0.0, 0.0), at.along(0.0, d, 0.0), wood);
    };
    slatted(b, frame);
    let upper = frame.moved(dice.range(-0.02, 0.02), 0.0, 0.30);
    slatted(b, &upper);
    for row in 0..4 {
        for column in 0..6 {
            let at = upper.at(
                0.06 + 0.092 * f64::from(column) + dice.range(-0.012, 0.012),
                0.06 + 0.092 * f64::from(row) + dice.range(-0.012, 0.012),
                0.25 + 0.035 * dice.unit(),
            );
            b.ball(at, DVec3::splat(dice.range(0.040, 0.048)), fruit);
        }
    }
}

/// A sandwich board: two leaning panels in frames.
pub(super) fn board(b: &mut Builder, frame: &Frame, (wood, slate): (PaintId, PaintId)) {
    let (w, h, lean) = (0.60, 1.02, 0.24);
    for half in
        [*frame, Frame { origin: frame.at(w, 2.0 * lean, 0.0), right: -frame.right, back: -frame.back }]
    {
        let (u, v) = (half.along(w, 0.0, 0.0), half.along(0.0, lean, h));
        let out = u.cross(v).normalize() * 0.012;
        b.quad(half.at(0.0, 0.0, 0.0), u, v, wood);
        b.quad(half.at(0.0, 0.0, 0.0) + out + u * 0.09 + v * 0.14, u * 0.82, v * 0.78, slate);
    }
    for (from, run) in [(0.0, -1.0), (w, 1.0)] {
        let side = frame.along(0.0, 2.0 * lean, 0.0);
        let (u, v) = (side, frame.along(0.0, lean, h));
        let (corner, _) = (frame.at(from + 0.002 * run, 0.0, 0.0), run);
        if run < 0.0 { b.triangle(corner, v, u, wood) } else { b.triangle(corner, u, v, wood) }
    }
}

/// A television aerial on a mast.
pub(super) fn aerial(b: &mut Builder, foot: DVec3, metal: PaintId) {
    b.stump(foot, foot + DVec3::Z * 2.1, [0.018, 0.015], metal);
    let arm = Frame::facing(foot + DVec3::Z * 1.95, DVec3::new(0.6, 0.8, 0.0));
    b.stump(arm.at(0.0, -0.55, 0.0), arm.at(0.0, 0.45, 0.0), [0.010, 0.010], metal);
    for rod in 0..7 {
        let y = -0.52 + 0.15 * f64::from(rod);
        let half = 0.20 + 0.035 * f64::from(rod);
        b.stump(arm.at(-half, y, 0.0), arm.at(half, y, 0.0), [0.006, 0.006], metal);
    }
}

/// A bicycle that leans back against what stands at y = 0.35; its front wheel is on the right.
pub(super) fn bicycle(b: &mut Builder, frame: &Frame, paint: PaintId, p: &Palette) {
    // It leans by one in six.
    let at = |x: f64, z: f64, y: f64| frame.at(x, 0.16 * z + y, z);
    let (rear, front, radius) = ((0.0, 0.345), (1.04, 0.345), 0.335);
    for (x, z) in [rear, front] {
        let rim = |step: i32, r: f64| {
            let (sin, cos) = (f64::from(step) / 24.0 * std::f64::consts::TAU).sin_cos();
            at(x + r * cos, z + r * sin, 0.0)
        };
        for step in 0..24 {
            b.stump(rim(step, radius), rim(step + 1, radius), [0.017, 0.017], p.tyre);
            b.stump(rim(step, radius - 0.025), rim(step + 1, radius - 0.025), [0.008, 0.008], p.zinc);
            if step % 2 == 0 {
                b.stump(at(x, z, 0.02), rim(step, radius - 0.02), [0.0015, 0.0015], p.zinc);
            }
            // Mudguards over the upper rear part of each wheel.
            if (4..14).contains(&step) {
                b.stump(rim(step, radius + 0.04), rim(step + 1, radius + 0.04), [0.018, 0.018], paint);
            }
        }
        b.stump(at(x, z, -0.06), at(x, z, 0.06), [0.022, 0.022], p.zinc);
    }
    let (crank, seat, head) = ((0.44, 0.30), (0.30, 0.80), (0.87, 0.82));
    let mut tube = |from: (f64, f64), to: (f64, f64), r: f64, y: (f64, f64)| {
        b.stump(at(from.0, from.1, y.0), at(to.0, to.1, y.1), [r, r], paint);
    };
    tube(crank, seat, 0.016, (0.0, 0.0));
    tube(crank, (0.885, 0.72), 0.018, (0.0, 0.0));
    tube((0.32, 0.74), head, 0.016, (0.0, 0.0));
    tube((0.89, 0.68), (0.855, 0.88), 0.019, (0.0, 0.0));
    for side in [-0.05, 0.05] {
        tube(rear, crank, 0.010, (side, 0.5 * side));
        tube(rear, (0.31, 0.77), 0.009, (side, 0.3 * side));
        tube(front, (0.885, 0.70), 0.012, (side, 0.6 * side));
    }
    b.stump(at(0.30, 0.78, 0.0), at(0.275, 0.93, 0.0), [0.013, 0.013], p.zinc);
    b.ball(at(0.25, 0.955, 0.0), DVec3::new(0.12, 0.12, 0.035), p.tyre);
    b.stump(at(0.855, 0.88, 0.0), at(0.845, 1.0, 0.0), [0.013, 0.013], p.zinc);
    let (left, right) = (at(0.76, 1.02, -0.29), at(0.76, 1.02, 0.26));
    for grip in [left, right] {
        let inner = at(0.845, 1.0, 0.0).lerp(grip, 0.55);
        b.stump(at(0.845, 1.0, 0.0), inner, [0.012, 0.012], p.zinc);
        b.stump(inner, grip, [0.015, 0.017], p.tyre);
    }
    b.ball(at(0.93, 0.93, 0.0), DVec3::splat(0.05), p.zinc);
    b.stump(at(0.44, 0.30, -0.06), at(0.52, 0.16, -0.07), [0.009, 0.009], p.zinc);
    b.stump(at(0.44, 0.30, 0.06), at(0.36, 0.44, 0.07), [0.009, 0.009], p.zinc);
    // A carrier over the rear wheel.
    for side in [-0.06, 0.06] {
        b.stump(at(-0.24, 0.74, side), at(0.27, 0.74, side), [0.006, 0.006], p.zinc);
        b.stump(at(-0.18, 0.74, side), at(0.0, 0.35, side), [0.005, 0.005], p.zinc);
    }
}

/// A box of flowers under a window.
pub(super) fn window_box(b: &mut Builder, frame: &Frame, opening: &Opening, p: &Palette, seed: u64) {
    let (x0, x1, z) = (opening.x + 0.04, opening.x + opening.width - 0.04, opening.z - 0.02);
    b.block(frame, [x0, -0.26, z - 0.02], [x1, -0.08, z + 0.14], p.oak, faces::ALL);
    let bed = frame.moved(x0, -0.30, z + 0.06);
    growth::flowers(b, &bed, [x1 - x0, 0.24, 0.26], 210, (p.hedge, p.flowers), seed);
}

/// A round sign on a post: blue with a red rim and bar. It faces the frame's front.
pub(super) fn sign(b: &mut Builder, frame: &Frame, p: &Palette) {
    b.post(frame.at(0.0, 0.0, 0.0), 2.55, [0.03, 0.03], p.zinc);
    for (y, radius, paint) in [(-0.036, 0.30, p.sign_red), (-0.039, 0.245, p.sign_blue)] {
        b.disc(frame.at(0.0, y, 2.25), -frame.back, radius, paint);
    }
    b.disc(frame.at(0.0, -0.033, 2.25), frame.back, 0.30, p.zinc);
    let (long, wide) = (frame.along(0.35, 0.0, -0.35), frame.along(0.035, 0.0, 0.035));
    b.quad(frame.at(-0.175, -0.042, 2.425) - wide * 0.5, long, wide, p.sign_red);
}

/// The part of the porch that its roof shelters, in its frame: from and to along x, depth, m.
#[derive(Clone, Copy, Debug)]
pub(super) struct Porch {
    pub from: f64,
    pub to: f64,
    pub depth: f64,
    /// Height of its floor, m.
    pub floor: f64,
}

impl Porch {
    /// A lean-to on posts before a wall whose frame this is.
    pub(super) fn build(&self, b: &mut Builder, frame: &Frame, roof: PaintId, p: &Palette) {
        let (x0, x1, d, floor) = (self.from, self.to, self.depth, self.floor);
        b.block(
            frame,
            [x0, -d, 0.0],
            [x1, 0.0, floor - 0.04],
            p.plinth,
            faces::FRONT | faces::LEFT | faces::RIGHT,
        );
        b.block(frame, [x0 - 0.05, -d - 0.05, floor - 0.04], [x1 + 0.05, -0.0, floor], p.deck, faces::FIXED);
        let (low, high) = (floor + 2.25, floor + 3.05);
        let middle = 0.5 * (x0 + x1);
        let posts = [x0 + 0.10, middle - 0.85, middle + 0.85, x1 - 0.10];
        for x in posts {
            let at = frame.moved(x, -d + 0.12, floor);
            b.block(&at, [-0.07, -0.07, 0.0], [0.07, 0.07, low - floor], p.white, faces::STANDING);
            b.block(&at, [-0.10, -0.10, 0.0], [0.10, 0.10, 0.14], p.white, faces::STANDING);
            b.block(
                &at,
                [-0.095, -0.095, low - floor - 0.12],
                [0.095, 0.095, low - floor],
                p.white,
                faces::ALL,
            );
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
        self.lean_to(b, frame, (low + 0.17, high), roof, p);
        // Steps between the two middle posts.
        let steps = [(0.30, floor - 0.16), (0.60, floor - 0.31)];
        for (reach, top) in steps {
            b.block(
                frame,
                [middle - 0.75, -d - reach - 0.05, 0.0],
                [middle + 0.75, -d, top.max(0.05)],
                p.stone,
                faces::STANDING,
            );
        }
        let bulb = frame.at(middle + 0.5, -0.55 * d, low + 0.12);
        b.stump(bulb + DVec3::Z * 0.5, bulb + DVec3::Z * 0.12, [0.008, 0.008], p.iron);
        b.stump(bulb + DVec3::Z * 0.12, bulb, [0.04, 0.13], p.iron);
        b.ball(bulb - DVec3::Z * 0.01, DVec3::splat(0.055), p.lantern);
    }

    fn railing(&self, b: &mut Builder, frame: &Frame, posts: &[f64; 4], p: &Palette) {
        let (y, z) = (-self.depth + 0.12, self.floor);
        for (from, to) in [(posts[0] + 0.07, posts[1] - 0.07), (posts[2] + 0.07, posts[3] - 0.07)] {
            b.block(frame, [from, y - 0.04, z + 0.84], [to, y + 0.04, z + 0.90], p.white, faces::ALL);
            b.block(frame, [from, y - 0.025, z + 0.12], [to, y + 0.025, z + 0.16], p.white, faces::ALL);
            let count = ((to - from) / 0.13) as usize;
            for index in 0..count {
                let x = from + (to - from) * (index as f64 + 0.5) / count as f64;
                b.block(
                    frame,
                    [x - 0.016, y - 0.016, z + 0.16],
                    [x + 0.016, y + 0.016, z + 0.84],
                    p.white,
                    15,
                );
            }
        }
        for x in [self.from + 0.10, self.to - 0.10] {
            b.block(frame, [x - 0.04, y + 0.07, z + 0.84], [x + 0.04, 0.0, z + 0.90], p.white, faces::ALL);
            b.block(frame, [x - 0.025, y + 0.07, z + 0.12], [x + 0.025, 0.0, z + 0.16], p.white, faces::ALL);
            let count = ((-y - 0.07) / 0.13) as usize;
            for index in 0..count {
                let at = y + 0.07 + (-y - 0.07) * (index as f64 + 0.5) / count as f64;
                b.block(
                    frame,
                    [x - 0.016, at - 0.016, z + 0.16],
                    [x + 0.016, at + 0.016, z + 0.84],
                    p.white,
                    15,
                );
            }
        }
    }

    fn lean_to(&self, b: &mut Builder, frame: &Frame, (low, high): (f64, f64), roof: PaintId, p: &Palette) {
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
