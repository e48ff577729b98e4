//! Traffic: cars, vans and people, each built where it is at one time.

use super::builder::{Builder, Frame, faces};
use crate::hash::Dice;
use crate::paint::{Material, PaintId};
use glam::{DVec2, DVec3};

/// Distance between cars that come the other way, m.
const ONCOMING_SPACING_M: f64 = 19.0;
/// Speed of the traffic, m/s.
const TRAFFIC_SPEED_M_S: f64 = 8.0;
/// Speed of people, m/s.
const WALKING_SPEED_M_S: f64 = 1.3;
/// Distance between people on a pavement, m.
const PEOPLE_SPACING_M: f64 = 9.0;

/// The traffic around a car at `at` on a road along y, `time` seconds after the first photo: a van
/// ahead, cars the other way, people on both sides and one who crosses.
pub(crate) fn traffic(b: &mut Builder, at: DVec2, time: f64, ground: &dyn Fn(DVec2) -> DVec3, seed: u64) {
    let paints = Paints::new(b);
    let on = |x: f64, y: f64, ahead: f64| Frame::facing(ground(DVec2::new(x, y)), DVec3::Y * ahead);
    // The van falls back and pulls away.
    let gap = 10.5 + 4.5 * (0.9 * time + seed as f64).sin();
    van(b, &on(at.x, at.y + gap, 1.0), &paints);
    let passed = (at.y + TRAFFIC_SPEED_M_S * time) / ONCOMING_SPACING_M;
    for index in passed.floor() as i64 - 1..passed.floor() as i64 + 5 {
        let mut dice = Dice::new(seed, 60_000 + index.unsigned_abs() * 2 + u64::from(index < 0));
        let y = index as f64 * ONCOMING_SPACING_M - TRAFFIC_SPEED_M_S * time + dice.range(-3.0, 3.0);
        if y > at.y + 1.0 && y < at.y + 70.0 {
            car(b, &on(-at.x, y, -1.0), &paints, dice.unit());
        }
    }
    for (side, x) in [(0u64, 4.0), (1, -4.1)] {
        let ahead = if side == 0 { 1.0 } else { -1.0 };
        let offset = ahead * WALKING_SPEED_M_S * time;
        let first = ((at.y - offset) / PEOPLE_SPACING_M).floor() as i64;
        for index in first..first + 5 {
            let mut dice =
                Dice::new(seed, 70_000 + index.unsigned_abs() * 4 + u64::from(index < 0) * 2 + side);
            let y = index as f64 * PEOPLE_SPACING_M + offset + dice.range(-3.0, 3.0);
            if y > at.y + 1.5 {
                person(b, &on(x + dice.range(-0.5, 0.5), y, ahead), &paints, time + dice.unit(), &mut dice);
            }
        }
    }
    // Somebody crosses the road ahead of the van, over and over.
    let phase = (time / 6.0 + 0.3).fract();
    let mut dice = Dice::new(seed, 80_000);
    let (x, y) = (-5.0 + 10.0 * phase, at.y + 5.2 + 0.5 * (time * 2.0).sin());
    let walker = Frame::facing(ground(DVec2::new(x, y)), DVec3::X);
    person(b, &walker, &paints, time, &mut dice);
}

struct Paints {
    bodies: [PaintId; 5],
    glass: PaintId,
    tyre: PaintId,
    rim: PaintId,
    light: PaintId,
    red: PaintId,
    skin: PaintId,
    hair: PaintId,
    clothes: [PaintId; 6],
}

impl Paints {
    fn new(b: &mut Builder) -> Self {
        let metal = |b: &mut Builder, color: u32| b.paint(Material::Metal, color, color);
        Self {
            bodies: [0xB8BABD, 0x1F2E4A, 0x8E2620, 0x2E3033, 0xD9D8D2].map(|color| metal(b, color)),
            // Dark panes without a room behind them.
            glass: b.paint(Material::Glass, 0x0A0C0E, 0x0A0C0E),
            tyre: metal(b, 0x1C1C1C),
            rim: metal(b, 0x9A9DA0),
            light: metal(b, 0xE8E6DA),
            red: metal(b, 0x8C1A16),
            skin: metal(b, 0xC89A7C),
            hair: metal(b, 0x3A2A1E),
            clothes: [0x2C3E66, 0x7A2F33, 0x3C4A3A, 0x242428, 0xB9A27C, 0x8892A0]
                .map(|color| metal(b, color)),
        }
    }
}

/// Two wheels on an axle across the frame at `(y, radius)`.
fn wheels(b: &mut Builder, at: &Frame, half: f64, y: f64, radius: f64, p: &Paints) {
    for side in [-1.0, 1.0] {
        let (inner, outer) = (at.at(side * (half - 0.2), y, radius), at.at(side * half, y, radius));
        b.stump(inner, outer, [radius, radius], p.tyre);
        b.disc(outer, at.right * side, radius, p.tyre);
        b.disc(outer + at.right * (side * 0.004), at.right * side, 0.62 * radius, p.rim);
    }
}

/// A car whose front looks along the frame's `back`, its middle at the origin.
fn car(b: &mut Builder, at: &Frame, p: &Paints, pick: f64) {
    let body = p.bodies[(pick * p.bodies.len() as f64) as usize % p.bodies.len()];
    let (half, length) = (0.88, 2.1);
    b.block(at, [-half, -length, 0.25], [half, length, 0.80], body, faces::ALL);
    // The cabin narrows upwards: four panes and a roof.
    let (low, high) = (0.80, 1.45);
    let corner = |x: f64, y: f64, z: f64| at.at(x, y, z);
    let (foot, head) = ([-1.7, 1.0], [-1.15, 0.25]);
    let (wide, narrow) = (half - 0.04, half - 0.18);
    let roof = [corner(-narrow, head[0], high), corner(narrow, head[0], high)];
    b.quad(roof[0], roof[1] - roof[0], at.along(0.0, head[1] - head[0], 0.0), body);
    for (y, top, sign) in [(foot[0], head[0], 1.0), (foot[1], head[1], -1.0)] {
        let (a, c) = (corner(-sign * wide, y, low), corner(sign * wide, y, low));
        let rise = corner(-sign * narrow, top, high) - a;
        b.quad(a, c - a, rise, p.glass);
    }
    for side in [-1.0, 1.0] {
        let (a, c) = (corner(side * wide, foot[0], low), corner(side * wide, foot[1], low));
        let rise = corner(side * narrow, head[0], high) - a;
        let (u, v) = if side > 0.0 { (c - a, rise) } else { (rise, c - a) };
        b.quad(a, u, v, p.glass);
        b.stump(corner(side * wide, foot[1], low), corner(side * narrow, head[1], high), [0.035, 0.03], body);
        b.stump(corner(side * wide, foot[0], low), corner(side * narrow, head[0], high), [0.05, 0.04], body);
        let (sill, eave) = (corner(side * (wide - 0.02), -0.35, low), corner(side * narrow, -0.4, high));
        b.stump(sill, eave, [0.04, 0.04], body);
        b.ball(corner(side * 0.62, length - 0.02, 0.62), DVec3::new(0.16, 0.08, 0.09), p.light);
        b.ball(corner(side * 0.66, -length + 0.01, 0.66), DVec3::new(0.13, 0.06, 0.08), p.red);
    }
    for y in [-1.3, 1.3] {
        wheels(b, at, half, y, 0.32, p);
    }
}

/// A delivery van.
fn van(b: &mut Builder, at: &Frame, p: &Paints) {
    let (half, white) = (0.98, p.bodies[4]);
    b.block(at, [-half, -2.6, 0.35], [half, 1.6, 2.35], white, faces::ALL);
    b.block(at, [-half + 0.03, 1.6, 0.35], [half - 0.03, 2.6, 1.15], white, faces::ALL);
    let (a, wide) = (at.at(half - 0.05, 2.5, 1.15), at.along(-2.0 * half + 0.1, 0.0, 0.0));
    b.quad(a, wide, at.along(0.0, -0.9, 1.1), p.glass);
    for x in [-0.55, 0.55] {
        b.block(at, [x - 0.36, -2.62, 1.45], [x + 0.36, -2.6, 2.0], p.glass, faces::ALL);
        let lamp = x.signum() * 0.84;
        b.block(at, [lamp - 0.08, -2.63, 0.9], [lamp + 0.08, -2.6, 1.25], p.red, faces::ALL);
    }
    b.block(at, [-0.26, -2.63, 0.62], [0.26, -2.6, 0.74], p.light, faces::ALL);
    for y in [-1.6, 1.7] {
        wheels(b, at, half, y, 0.36, p);
    }
}

/// Somebody who walks along the frame's `back`; `time` moves arms and legs.
fn person(b: &mut Builder, at: &Frame, p: &Paints, time: f64, dice: &mut Dice) {
    let tall = dice.range(0.92, 1.06);
    let mut cloth = || p.clothes[(dice.unit() * p.clothes.len() as f64) as usize % p.clothes.len()];
    let (coat, trousers) = (cloth(), cloth());
    let swing = 0.32 * (std::f64::consts::TAU * time * 0.95).sin();
    let point = |x: f64, y: f64, z: f64| at.at(x, y, z * tall);
    for (side, swing) in [(-1.0, swing), (1.0, -swing)] {
        let (hip, knee) = (point(side * 0.09, 0.0, 0.88), point(side * 0.10, 0.55 * swing + 0.04, 0.48));
        let foot = point(side * 0.10, swing, 0.07);
        b.stump(hip, knee, [0.085, 0.065], trousers);
        b.stump(knee, foot, [0.065, 0.05], trousers);
        b.ball(foot + at.back * 0.06 - DVec3::Z * 0.02, DVec3::new(0.10, 0.10, 0.05), p.hair);
        let (shoulder, elbow) = (point(side * 0.19, 0.0, 1.40), point(side * 0.25, -0.35 * swing, 1.12));
        let hand = point(side * 0.24, -0.8 * swing + 0.05, 0.88);
        b.stump(shoulder, elbow, [0.06, 0.05], coat);
        b.stump(elbow, hand, [0.05, 0.035], coat);
        b.ball(hand, DVec3::splat(0.045), p.skin);
    }
    b.ball(point(0.0, 0.0, 1.16), DVec3::new(0.20, 0.20, 0.34 * tall), coat);
    b.ball(point(0.0, 0.0, 0.92), DVec3::new(0.17, 0.17, 0.16), trousers);
    b.stump(point(0.0, 0.0, 1.40), point(0.0, 0.01, 1.54), [0.06, 0.05], p.skin);
    b.ball(point(0.0, 0.02, 1.63), DVec3::new(0.085, 0.095, 0.115), p.skin);
    b.ball(point(0.0, -0.015, 1.67), DVec3::new(0.09, 0.095, 0.09), p.hair);
}
