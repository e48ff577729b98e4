//! Walls with openings: windows with reveals, frames and sills, doors, a shop front.

use super::builder::{Builder, Frame, faces};
use crate::hash::{key_of, unit};
use crate::paint::PaintId;
use glam::DVec3;
use wm_scene::LitWindow;

/// The depth of panes and doors behind the wall's face, m.
const REVEAL_DEPTH_M: f64 = 0.13;
/// Share of the windows that are lit by night.
const LIT_WINDOW_SHARE: f64 = 0.3;

/// Paints of a facade.
#[derive(Clone, Copy, Debug)]
pub(super) struct Finish {
    pub(crate) wall: PaintId,
    pub(crate) plinth: PaintId,
    pub(crate) stone: PaintId,
    pub(crate) frame: PaintId,
    pub(crate) glass: PaintId,
    pub(crate) door: PaintId,
    pub(crate) metal: PaintId,
}

/// The filling of an opening.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Filling {
    /// Two casements and a light above.
    Casement,
    /// Two sashes with three panes across.
    Sash,
    /// A panelled door with a light above.
    Door,
    /// A large pane over a panelled foot.
    Shop,
}

/// A rectangular hole in a wall; `x`, `z` of its lower left corner in the wall's frame, m.
#[derive(Clone, Copy, Debug)]
pub(super) struct Opening {
    pub(crate) x: f64,
    pub(crate) z: f64,
    pub(crate) width: f64,
    pub(crate) height: f64,
    pub(crate) filling: Filling,
}

/// The wall from the frame's origin to the right and up, with its openings filled.
pub(super) fn wall(b: &mut Builder, frame: &Frame, size: (f64, f64), openings: &[Opening], finish: &Finish) {
    let (width, height) = size;
    let mut cuts = vec![0.0, width];
    for opening in openings {
        cuts.extend([opening.x, opening.x + opening.width]);
    }
    cuts.sort_by(f64::total_cmp);
    for pair in cuts.windows(2) {
        let (x0, x1) = (pair[0], pair[1]);
        if x1 - x0 < 1e-9 {
            continue;
        }
        let middle = 0.5 * (x0 + x1);
        let mut over: Vec<&Opening> =
            openings.iter().filter(|o| o.x < middle && middle < o.x + o.width).collect();
        over.sort_by(|one, two| one.z.total_cmp(&two.z));
        let mut z = 0.0;
        for (low, high) in over.iter().map(|o| (o.z, o.z + o.height)).chain([(height, height)]) {
            if low - z > 1e-9 {
                b.upright(frame, [x0, 0.0, z], x1 - x0, low - z, finish.wall);
            }
            z = high;
        }
    }
    for opening in openings {
        reveal(b, frame, opening, finish);
        let at = frame.moved(opening.x, 0.0, opening.z);
        let (w, h) = (opening.width, opening.height);
        match opening.filling {
            Filling::Casement | Filling::Sash => window(b, &at, (w, h), opening.filling, finish),
            Filling::Door => door(b, &at, (w, h), finish),
            Filling::Shop => shop(b, &at, (w, h), finish),
        }
    }
}

/// The sides of a hole, down to where its filling sits.
fn reveal(b: &mut Builder, frame: &Frame, opening: &Opening, finish: &Finish) {
    let (x, z, w, h) = (opening.x, opening.z, opening.width, opening.height);
    let (right, back, up) =
        (frame.along(w, 0.0, 0.0), frame.along(0.0, REVEAL_DEPTH_M + 0.03, 0.0), DVec3::Z * h);
    b.quad(frame.at(x, 0.0, z), back, up, finish.wall);
    b.quad(frame.at(x + w, REVEAL_DEPTH_M + 0.03, z), -back, up, finish.wall);
    b.quad(frame.at(x, 0.0, z), right, back, finish.stone);
    b.quad(frame.at(x, REVEAL_DEPTH_M + 0.03, z + h), right, -back, finish.wall);
}

/// A bar of a frame in the plane of the filling.
fn bar(b: &mut Builder, at: &Frame, low: (f64, f64), high: (f64, f64), proud: f64, paint: PaintId) {
    let (front, back) = ([low.0, REVEAL_DEPTH_M - proud, low.1], [high.0, REVEAL_DEPTH_M, high.1]);
    b.block(at, front, back, paint, faces::FIXED);
}

/// Frame, bars, panes and sill; `at` is the lower left corner of the hole.
pub(super) fn window(b: &mut Builder, at: &Frame, size: (f64, f64), filling: Filling, finish: &Finish) {
    let (w, h) = size;
    b.upright(at, [0.0, REVEAL_DEPTH_M, 0.0], w, h, finish.glass);
    let paint = finish.frame;
    let edge = 0.06;
    bar(b, at, (0.0, 0.0), (edge, h), 0.05, paint);
    bar(b, at, (w - edge, 0.0), (w, h), 0.05, paint);
    bar(b, at, (edge, 0.0), (w - edge, edge), 0.05, paint);
    bar(b, at, (edge, h - edge), (w - edge, h), 0.05, paint);
    if filling == Filling::Sash {
        let rail = 0.52 * h;
        bar(b, at, (edge, rail - 0.025), (w - edge, rail + 0.025), 0.045, paint);
        for third in [1.0, 2.0] {
            let x = edge + (w - 2.0 * edge) * third / 3.0;
            bar(b, at, (x - 0.012, edge), (x + 0.012, h - edge), 0.03, paint);
        }
    } else {
        let light = 0.70 * h;
        bar(b, at, (0.5 * w - 0.045, edge), (0.5 * w + 0.045, h - edge), 0.045, paint);
        bar(b, at, (edge, light - 0.03), (0.5 * w - 0.045, light + 0.03), 0.045, paint);
        bar(b, at, (0.5 * w + 0.045, light - 0.03), (w - edge, light + 0.03), 0.045, paint);
    }
    b.block(at, [-0.06, -0.07, -0.06], [w + 0.06, 0.0, 0.0], finish.stone, faces::FIXED);
    light(b, at, w, h, edge);
}

/// Lights the room behind some windows by night.
fn light(b: &mut Builder, at: &Frame, w: f64, h: f64, edge: f64) {
    let key = key_of(at.origin);
    if unit(key, 0) > LIT_WINDOW_SHARE {
        return;
    }
    let (luminance, kelvin) =
        (LitWindow::default_luminance() * (0.4 + 1.2 * unit(key, 1)), 2_400.0 + 900.0 * unit(key, 2));
    b.windows.push(LitWindow {
        corner: at.at(edge, REVEAL_DEPTH_M - 0.005, edge).to_array(),
        across: at.along(w - 2.0 * edge, 0.0, 0.0).to_array(),
        upwards: [0.0, 0.0, h - 2.0 * edge],
        luminance,
        kelvin,
    });
}

/// Leaf with raised panels, frame, a light above and a handle.
fn door(b: &mut Builder, at: &Frame, size: (f64, f64), finish: &Finish) {
    let (w, h) = size;
    let leaf = 2.05f64.min(h - 0.1);
    let edge = 0.07;
    bar(b, at, (0.0, 0.0), (edge, h), 0.07, finish.frame);
    bar(b, at, (w - edge, 0.0), (w, h), 0.07, finish.frame);
    bar(b, at, (edge, leaf), (w - edge, leaf + 0.06), 0.07, finish.frame);
    bar(b, at, (edge, h - 0.06), (w - edge, h), 0.07, finish.frame);
    let inner = w - 2.0 * edge;
    b.upright(at, [edge, REVEAL_DEPTH_M, leaf], inner, h - leaf, finish.glass);
    b.upright(at, [edge, REVEAL_DEPTH_M, 0.0], inner, leaf, finish.door);
    for (z0, z1) in [(0.18, 0.80), (0.95, 1.88)] {
        for side in [0.0, 1.0] {
            let x0 = edge + inner * (0.10 + 0.44 * side);
            bar(b, at, (x0, z0), (x0 + 0.36 * inner, z1), 0.022, finish.door);
        }
    }
    b.ball(at.at(w - edge - 0.08, REVEAL_DEPTH_M - 0.05, 1.02), DVec3::splat(0.03), finish.metal);
}

/// A shop's large pane with a panelled foot and a sign board above.
fn shop(b: &mut Builder, at: &Frame, size: (f64, f64), finish: &Finish) {
    let (w, h) = size;
    let foot = 0.55;
    b.upright(at, [0.0, REVEAL_DEPTH_M, foot], w, h - foot, finish.glass);
    bar(b, at, (0.0, 0.0), (w, foot), 0.05, finish.door);
    for part in 0..3 {
        let x = w * (0.03 + 0.32 * f64::from(part));
        bar(b, at, (x, 0.1), (x + 0.30 * w, foot - 0.1), 0.07, finish.door);
    }
    for x in [0.0, w / 3.0 - 0.03, 2.0 * w / 3.0 - 0.03, w - 0.06] {
        bar(b, at, (x, foot), (x + 0.06, h), 0.06, finish.door);
    }
    bar(b, at, (0.0, h - 0.55), (w, h - 0.49), 0.05, finish.door);
    bar(b, at, (0.0, h - 0.06), (w, h), 0.06, finish.door);
    // The sign board stands proud of the wall.
    b.block(at, [-0.15, -0.08, h + 0.05], [w + 0.15, 0.0, h + 0.50], finish.door, faces::FIXED);
    b.block(at, [-0.20, -0.14, h + 0.50], [w + 0.20, 0.0, h + 0.57], finish.frame, faces::FIXED);
}

/// Two open shutters beside a window.
pub(super) fn shutters(b: &mut Builder, frame: &Frame, opening: &Opening, paint: PaintId) {
    let (w, h) = (0.5 * opening.width, opening.height);
    for x in [opening.x - w - 0.03, opening.x + opening.width + 0.03] {
        let at = frame.moved(x, 0.0, opening.z);
        b.block(&at, [0.0, -0.045, 0.0], [w, -0.005, h], paint, faces::FIXED);
        for (z0, z1) in [(0.07, 0.47 * h), (0.53 * h, h - 0.07)] {
            b.block(&at, [0.06, -0.058, z0], [w - 0.06, -0.045, z1], paint, faces::FIXED);
        }
    }
}
