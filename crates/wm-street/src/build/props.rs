//! Small things that make a street lived in: covers, crates, a board, bicycles, window boxes.

use super::builder::{Builder, Frame, faces};
use super::facade::Opening;
use super::growth;
use super::palette::Palette;
use crate::hash::Dice;
use crate::paint::PaintId;
use glam::DVec3;

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
pub(super) fn crates(b: &mut Builder, frame: &Frame, wood: PaintId, fruit: PaintId, seed: u64) {
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
pub(super) fn board(b: &mut Builder, frame: &Frame, p: &Palette) {
    let (w, h, lean) = (0.60, 1.02, 0.24);
    for half in [*frame, frame.opposite(w, 2.0 * lean)] {
        let (u, v) = (half.along(w, 0.0, 0.0), half.along(0.0, lean, h));
        let out = u.cross(v).normalize() * 0.012;
        b.quad(half.at(0.0, 0.0, 0.0), u, v, p.oak);
        b.quad(half.at(w, 0.0, 0.0) - out, -u, v, p.oak);
        b.quad(half.at(0.0, 0.0, 0.0) + out + u * 0.09 + v * 0.14, u * 0.82, v * 0.78, p.iron);
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
    growth::flowers(b, &bed, [x1 - x0, 0.24, 0.26], 210, p, seed);
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
