//! Street furniture: lamps, benches, bins, tubs, poles with wires, hanging signs.

use super::builder::{Builder, Frame, faces};
use super::palette::Palette;
use crate::paint::{Label, PaintId};
use glam::DVec3;
use wm_scene::Lamp;

/// Luminous flux (lm) and width of the beam (degrees) of a lantern.
const LANTERN_FLUX_AND_BEAM: (f64, f64) = (3_500.0, 140.0);

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
    b.lamps.push(Lamp {
        aim: Some([0.0, 0.0, -1.0]),
        beam: LANTERN_FLUX_AND_BEAM.1,
        lumens: LANTERN_FLUX_AND_BEAM.0,
        radius: 0.14,
        ..Lamp::new(head.at(0.0, 0.0, -0.28).to_array())
    });
}

/// A bench, seen from its front at y = 0.
pub(super) fn bench(b: &mut Builder, frame: &Frame, p: &Palette) {
    let long = 1.7;
    for slat in 0..4 {
        let y = 0.03 + 0.115 * f64::from(slat);
        b.block(frame, [0.0, y, 0.43], [long, y + 0.095, 0.465], p.oak, faces::ALL);
    }
    for slat in 0..3 {
        let (z, y) = (0.56 + 0.125 * f64::from(slat), 0.50 + 0.035 * f64::from(slat));
        let (u, v) = (frame.along(long, 0.0, 0.0), frame.along(0.0, 0.028, 0.10));
        b.quad(frame.at(0.0, y, z), u, v, p.oak);
        b.quad(frame.at(long, y + 0.03, z), -u, v, p.oak);
        b.quad(frame.at(0.0, y, z) + v, u, frame.along(0.0, 0.03, 0.0), p.oak);
    }
    for x in [0.12, long - 0.17] {
        b.block(frame, [x, 0.06, 0.0], [x + 0.05, 0.11, 0.43], p.iron, faces::STANDING);
        b.block(frame, [x, 0.44, 0.0], [x + 0.05, 0.49, 0.50], p.iron, faces::STANDING);
        b.block(frame, [x, 0.06, 0.39], [x + 0.05, 0.49, 0.43], p.iron, faces::ALL);
        b.stump(frame.at(x + 0.025, 0.47, 0.48), frame.at(x + 0.025, 0.60, 0.95), [0.024, 0.02], p.iron);
        b.block(frame, [x - 0.01, 0.02, 0.63], [x + 0.06, 0.50, 0.66], p.oak, faces::ALL);
        b.block(frame, [x + 0.01, 0.05, 0.46], [x + 0.04, 0.09, 0.63], p.iron, faces::STANDING);
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
    let rim = foot + DVec3::Z * (high - 0.07);
    b.stump(rim, foot + DVec3::Z * high, [radius + 0.02, radius + 0.025], p.terracotta);
    b.labelled(Label::Object, |b| b.disc(foot + DVec3::Z * (high - 0.03), DVec3::Z, radius, p.soil));
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
    board: PaintId,
    rim: PaintId,
    iron: PaintId,
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
