//! Low growth: hedges, climbers, tufts of grass, flowers, fallen leaves.

use super::builder::{Builder, Frame, faces};
use super::palette::Palette;
use super::tree::card;
use crate::hash::{Dice, noise3};
use crate::paint::PaintId;
use crate::shape::{Outline, Shape};
use glam::{DVec2, DVec3};

/// A clipped hedge: a dark core under a skin of leaves. `size` is length, depth, height, m.
pub(super) fn hedge(b: &mut Builder, frame: &Frame, size: [f64; 3], leaf: f64, p: &Palette, seed: u64) {
    let [w, d, h] = size;
    let mut dice = Dice::new(b.seed, seed);
    let inset = 0.07;
    b.block(frame, [inset, inset, 0.0], [w - inset, d - inset, h - inset], p.core, faces::STANDING);
    let area = 2.0 * (w + d) * h + w * d;
    let count = (area * 1.15 / (leaf * leaf * 0.62 * 0.667)) as usize;
    for _ in 0..count {
        let mut pick = dice.unit() * area;
        let (x, y, z, out);
        if pick < w * d {
            (x, y, z, out) = (dice.unit() * w, dice.unit() * d, h, DVec3::Z);
        } else {
            pick -= w * d;
            let side = pick / h;
            let around = side % (2.0 * (w + d));
            z = dice.unit() * h;
            (x, y, out) = if around < w {
                (around, 0.0, -frame.back)
            } else if around < w + d {
                (w, around - w, frame.right)
            } else if around < 2.0 * w + d {
                (around - w - d, d, frame.back)
            } else {
                (0.0, around - 2.0 * w - d, -frame.right)
            };
        }
        let at = frame.at(x, y, z);
        let lump = 0.05 * noise3(at * 2.3, 17) + 0.03 * dice.bell();
        let way = (out * 0.6 + dice.direction() + DVec3::Z * 0.2).normalize_or(DVec3::Z);
        // Corners are rounded by the shears.
        let corner = 0.04 * f64::from(u8::from(z > h - 0.1)) + 0.01;
        card(b, at + out * (lump - corner), way, leaf * dice.range(0.7, 1.2), 0.62, p.hedge, &mut dice);
    }
}

/// Leaves of a climber on a wall, about `(x, z)` of `reach` (half width, height) in its frame.
pub(super) fn climber(
    b: &mut Builder,
    frame: &Frame,
    x: f64,
    reach: (f64, f64),
    foliage: PaintId,
    seed: u64,
) {
    let mut dice = Dice::new(b.seed, seed);
    let count = (reach.0 * reach.1 * 900.0) as usize;
    for _ in 0..count {
        let (dx, z) = (dice.range(-1.0, 1.0), dice.unit());
        let at = frame.at(x + dx * reach.0, -0.04, z * reach.1);
        // Thins out to the sides and the top, in tongues.
        let edge = dx * dx + 0.9 * z * z + 0.55 * noise3(at * 1.7, 23) + 0.25 * noise3(at * 5.0, 29);
        if edge > 0.75 {
            continue;
        }
        let way = (-frame.back * 0.35 - DVec3::Z * 0.9 + dice.direction() * 0.7).normalize_or(-DVec3::Z);
        let off = frame.back * (-0.05 - 0.10 * dice.unit() * (1.0 - edge).max(0.0));
        card(b, at + off, way, dice.range(0.08, 0.13), 0.8, foliage, &mut dice);
    }
}

/// Tufts of grass from `from` to `to`, `density` a metre, blades of about `height`.
#[allow(clippy::too_many_arguments, reason = "numbers of one strip of grass, from one call")]
pub(super) fn tufts(
    b: &mut Builder,
    from: DVec3,
    to: DVec3,
    spread: f64,
    density: f64,
    height: f64,
    paint: PaintId,
    seed: u64,
) {
    let mut dice = Dice::new(b.seed, seed);
    let side = (to - from).cross(DVec3::Z).normalize_or(DVec3::X);
    let count = ((to - from).length() * density) as usize;
    for _ in 0..count {
        let at = from.lerp(to, dice.unit()) + side * (dice.bell() * spread);
        if noise3(at * 0.9, 41) < -0.25 {
            continue;
        }
        tuft(b, at, 5, height, paint, &mut dice);
    }
}

/// A tuft of `blades` grass blades of about `height`.
pub(super) fn tuft(b: &mut Builder, at: DVec3, blades: u32, height: f64, paint: PaintId, dice: &mut Dice) {
    for _ in 0..blades {
        let lean = DVec3::new(dice.bell(), dice.bell(), 0.0) * 0.35;
        let up = (DVec3::Z + lean) * (height * dice.range(0.5, 1.3));
        let (sin, cos) = dice.range(0.0, std::f64::consts::TAU).sin_cos();
        let wide = DVec3::new(cos, sin, 0.0) * (0.012 + 0.10 * height).min(0.045);
        let foot = at + DVec3::new(dice.bell(), dice.bell(), 0.0) * 0.03;
        b.add(Shape::Flat { corner: foot - wide * 0.5, u: up, v: wide, outline: Outline::Leaf }, paint);
    }
}

/// Leaves and blossoms over a box: flower beds, window boxes, tubs.
pub(super) fn flowers(b: &mut Builder, frame: &Frame, size: [f64; 3], count: u32, p: &Palette, seed: u64) {
    let mut dice = Dice::new(b.seed, seed);
    for index in 0..count {
        let x = dice.unit();
        let at = frame.at(x * size[0], dice.unit() * size[1], dice.unit().sqrt() * size[2]);
        let way = (DVec3::Z * 0.5 + dice.direction() - frame.back * 0.3).normalize_or(DVec3::Z);
        if index % 3 == 0 && noise3(at * 4.0, 3) > -0.3 {
            for petal in 0..3 {
                let (sin, cos) = (2.1 * f64::from(petal) + x * 9.0).sin_cos();
                let tip = (DVec3::new(cos, sin, 0.5) + dice.direction() * 0.3).normalize();
                card(b, at + DVec3::Z * 0.03, tip, 0.055, 0.9, p.flowers, &mut dice);
            }
        } else {
            card(b, at, way, dice.range(0.06, 0.10), 0.55, p.hedge, &mut dice);
        }
    }
}

/// Leaves that lie in a rectangle on ground of the height `ground`, m.
pub(super) fn fallen(
    b: &mut Builder,
    low: DVec2,
    high: DVec2,
    ground: impl Fn(DVec2) -> f64,
    count: u32,
    paint: PaintId,
    seed: u64,
) {
    let mut dice = Dice::new(b.seed, seed);
    for _ in 0..count {
        let at = low + (high - low) * DVec2::new(dice.unit(), dice.unit());
        let at = at.extend(ground(at) + 0.008);
        if noise3(at * 0.6, 47) < 0.0 {
            continue;
        }
        let (sin, cos) = dice.range(0.0, std::f64::consts::TAU).sin_cos();
        let length = dice.range(0.05, 0.09);
        let u = DVec3::new(cos, sin, dice.range(0.0, 0.25)) * length;
        let v = DVec3::new(-sin, cos, dice.range(0.0, 0.2)) * (0.7 * length);
        b.add(Shape::Flat { corner: at - v * 0.2 + DVec3::Z * 0.004, u, v, outline: Outline::Leaf }, paint);
    }
}
