//! Masks from verdicts: movers are pieces with an extent, not single pixels.

use super::consensus::PixelVerdict;
use super::view::MoverView;
use crate::pieces::{beside, pieces};

/// Difference of colour that is no error.
const STRONG_DIFFERENCE: f32 = 0.12;
/// Least pixels of a mover that differ, as a share of the photo, and of those the share that
/// differs strongly.
const MIN_AREA_SHARE: f64 = 0.003;
const MIN_STRONG_SHARE: f64 = 0.2;
/// Radius of the square about a pixel in which differences have one direction, px, and the share of
/// them that has.
const SAME_SIGN_WINDOW: (usize, f32) = (2, 0.8);
/// Pixels in the square about one that must be set with it, before and after it grows.
const MIN_SET_NEIGHBOURS: [usize; 2] = [5, 4];
/// Radius of the gaps that are closed, px.
const CLOSED_GAP_PX: usize = 2;
/// Largest differences of colour along which a mover grows: to the next pixel, and to that where it
/// began.
const MAX_STEP_DIFFERENCE: f32 = 0.04;
const MAX_SEED_DIFFERENCE: f32 = 0.12;
/// Share of the pixels around one that stereo may know where a mover grows.
const MAX_KNOWN_SHARE: f32 = 0.01;
/// Largest hole that is filled, as a share of the movers.
const MAX_HOLE_SHARE: f64 = 0.5;
/// Width of the rim that is added, px.
const RIM_PX: usize = 1;

/// The mask of a photo, `[H, W]`; empty if no mover is in it.
#[must_use]
pub(crate) fn mask(verdicts: &[PixelVerdict], view: &MoverView) -> Vec<bool> {
    let (width, height) = view.size();
    let weak = one_way(verdicts, width);
    let strong = |pixel: usize| matches!(verdicts[pixel], PixelVerdict::Differs(off) if off.abs() >= STRONG_DIFFERENCE);
    // Gaps close before pieces are counted, or texture would tear a mover into crumbs.
    let mut moves = closed(&supported(&weak, width, MIN_SET_NEIGHBOURS[0]), width);
    let least = MIN_AREA_SHARE * (width * height) as f64;
    for piece in pieces(moves.clone(), width, |_, _| true) {
        let differs = piece.iter().filter(|pixel| weak[**pixel]).count() as f64;
        let much = piece.iter().filter(|pixel| strong(**pixel)).count() as f64;
        if differs < least || much < MIN_STRONG_SHARE * differs {
            piece.iter().for_each(|pixel| moves[*pixel] = false);
        }
    }
    if !moves.contains(&true) {
        return Vec::new();
    }
    grow(&mut moves, verdicts, view);
    let mut moves = closed(&supported(&moves, width, MIN_SET_NEIGHBOURS[1]), width);
    fill_holes(&mut moves, width);
    dilated(&moves, width, RIM_PX)
}

/// The pixels that differ, and about which most do in one direction: misplaced texture is brighter
/// here and darker there.
fn one_way(verdicts: &[PixelVerdict], width: usize) -> Vec<bool> {
    let (radius, least) = SAME_SIGN_WINDOW;
    let height = verdicts.len() / width;
    let near = |at: usize, count: usize| at.saturating_sub(radius)..(at + radius + 1).min(count);
    let off = |pixel: usize| match verdicts[pixel] {
        PixelVerdict::Differs(off) => off,
        _ => 0.0,
    };
    let differs = |pixel: usize| {
        let (mut sum, mut all) = (0.0f32, 0.0f32);
        for y in near(pixel / width, height) {
            for x in near(pixel % width, width) {
                let off = off(y * width + x);
                (sum, all) = (sum + off, all + off.abs());
            }
        }
        off(pixel) != 0.0 && sum.abs() >= least * all
    };
    (0..verdicts.len()).map(differs).collect()
}

/// Grows movers over pixels of their colour about which nothing is known: others rarely see the
/// ground below a car.
fn grow(moves: &mut [bool], verdicts: &[PixelVerdict], view: &MoverView) {
    let (width, colors) = (view.size().0, &view.scales[0].mean);
    let apart = |a: usize, b: usize| {
        let [r, g, b] = [0, 1, 2].map(|c| (colors[a][c] - colors[b][c]).abs());
        r.max(g).max(b)
    };
    let mut queue: Vec<(usize, usize)> =
        (0..moves.len()).filter(|pixel| moves[*pixel]).map(|pixel| (pixel, pixel)).collect();
    let mut next = 0;
    while next < queue.len() {
        let (pixel, start) = queue[next];
        next += 1;
        for other in beside(pixel, width, moves.len()) {
            let is_free = !moves[other]
                && verdicts[other] != PixelVerdict::Still
                && view.around[other] <= MAX_KNOWN_SHARE;
            if is_free
                && apart(pixel, other) <= MAX_STEP_DIFFERENCE
                && apart(start, other) <= MAX_SEED_DIFFERENCE
            {
                moves[other] = true;
                queue.push((other, start));
            }
        }
    }
}

/// Fills what movers surround, if it is small beside them.
fn fill_holes(moves: &mut [bool], width: usize) {
    let most = MAX_HOLE_SHARE * moves.iter().filter(|moves| **moves).count() as f64;
    let rest: Vec<bool> = moves.iter().map(|moves| !moves).collect();
    for hole in pieces(rest.clone(), width, |_, _| true) {
        let is_on_border = |pixel: &usize| beside(*pixel, width, rest.len()).count() < 4;
        if (hole.len() as f64) < most && !hole.iter().any(is_on_border) {
            hole.iter().for_each(|pixel| moves[*pixel] = true);
        }
    }
}

/// The pixels that are set with enough of those about them.
fn supported(of: &[bool], width: usize, support: usize) -> Vec<bool> {
    let counts = counts(of, width, 1);
    of.iter().zip(counts).map(|(set, count)| *set && count >= support).collect()
}

/// Sets what lies between pixels that are set. Outside of the photo counts as set: its border cuts
/// movers off.
fn closed(of: &[bool], width: usize) -> Vec<bool> {
    let unset: Vec<bool> = dilated(of, width, CLOSED_GAP_PX).into_iter().map(|set| !set).collect();
    dilated(&unset, width, CLOSED_GAP_PX).into_iter().map(|unset| !unset).collect()
}

fn dilated(of: &[bool], width: usize, radius: usize) -> Vec<bool> {
    counts(of, width, radius).into_iter().map(|count| count > 0).collect()
}

/// The share of the pixels that are set in the square of `radius` about each.
#[must_use]
pub(crate) fn shares(of: &[bool], width: usize, radius: usize) -> Vec<f32> {
    let height = of.len() / width;
    let side = |at: usize, count: usize| (at + radius + 1).min(count) - at.saturating_sub(radius);
    let area = |pixel: usize| side(pixel % width, width) * side(pixel / width, height);
    counts(of, width, radius)
        .into_iter()
        .enumerate()
        .map(|(i, count)| count as f32 / area(i) as f32)
        .collect()
}

/// The number of pixels that are set in the square of `radius` about each; outside of the photo
/// none are.
fn counts(of: &[bool], width: usize, radius: usize) -> Vec<usize> {
    let height = of.len() / width;
    let near = |at: usize, count: usize| at.saturating_sub(radius)..(at + radius + 1).min(count);
    let in_row = |pixel: usize| {
        let row = &of[pixel / width * width..][..width];
        row[near(pixel % width, width)].iter().filter(|set| **set).count()
    };
    let rows: Vec<usize> = (0..of.len()).map(in_row).collect();
    let in_all = |pixel: usize| near(pixel / width, height).map(|y| rows[y * width + pixel % width]).sum();
    (0..of.len()).map(in_all).collect()
}
