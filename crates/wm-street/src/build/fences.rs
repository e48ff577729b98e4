//! Fences, low walls, pillars, railings.

use super::builder::{Builder, Frame, faces};
use super::palette::Palette;
use crate::paint::PaintId;
use glam::DVec3;

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
        b.block(frame, [x, -0.022, 0.06], [x + 0.075, 0.0, high], paint, faces::STANDING & !faces::TOP);
        for (corner, sign) in [(frame.at(x, -0.022, high), 1.0), (frame.at(x + 0.075, 0.0, high), -1.0)] {
            let peak = frame.along(sign * 0.0375, 0.0, 0.06);
            b.triangle(corner, frame.along(sign * 0.075, 0.0, 0.0), peak, paint);
        }
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
pub(super) fn low_wall(b: &mut Builder, frame: &Frame, length: f64, high: f64, body: PaintId, p: &Palette) {
    b.block(frame, [0.0, 0.0, 0.0], [length, 0.24, high], body, faces::STANDING & !faces::TOP);
    b.block(frame, [-0.03, -0.035, high], [length + 0.03, 0.275, high + 0.07], p.stone, faces::ALL);
}

/// Square pillars with caps at both ends of a gap.
pub(super) fn pillar(b: &mut Builder, frame: &Frame, high: f64, body: PaintId, p: &Palette) {
    b.block(frame, [-0.19, -0.07, 0.0], [0.19, 0.31, high], body, faces::STANDING & !faces::TOP);
    b.block(frame, [-0.24, -0.12, high], [0.24, 0.36, high + 0.08], p.stone, faces::ALL);
    b.ball(frame.at(0.0, 0.12, high + 0.20), DVec3::splat(0.14), p.stone);
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
