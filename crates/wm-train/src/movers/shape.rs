//! Masks from verdicts: movers are pieces with an extent, not single pixels.

use super::consensus::PixelVerdict;
use super::view::{MoverView, counts};
use crate::pieces::{beside, pieces};

/// Difference of colour that is certainly no error.
const STRONG_DIFFERENCE: f32 = 0.12;
/// Least share of a photo's pixels in a mover, and the least share of these that differ strongly.
const MIN_AREA_SHARE: f64 = 0.003;
const MIN_STRONG_SHARE: f64 = 0.2;
/// Radius of the window in which differences must have one sign, px, and the least share that has
/// it.
const SAME_SIGN_WINDOW: (usize, f32) = (2, 0.8);
/// Fewest set pixels in the 3x3 window of a set pixel, before and after growing.
const MIN_SET_NEIGHBOURS: [usize; 2] = [5, 4];
/// Radius of the closing of gaps, px.
const CLOSED_GAP_PX: usize = 2;
/// Largest differences of colour over which a mover grows: to the next pixel, and to the seed.
const MAX_STEP_DIFFERENCE: f32 = 0.04;
const MAX_SEED_DIFFERENCE: f32 = 0.12;
/// Largest share of known stereo depth around a pixel into which a mover grows.
const MAX_KNOWN_SHARE: f32 = 0.01;
/// Largest hole that is filled, as a share of the movers.
const MAX_HOLE_SHARE: f64 = 0.5;
/// Width of the rim that is added, px.
const RIM_PX: usize = 1;

/// Returns the mask of a photo, `[H, W]`; empty if no mover is in it.
pub(crate) fn mask(verdicts: &[PixelVerdict], view: &MoverView) -> Vec<bool> {
    let (width, height) = view.size();
    let weak = one_way(verdicts, width);
    let strong = |pixel: usize| matches!(verdicts[pixel], PixelVerdict::Differs(off) if off.abs() >= STRONG_DIFFERENCE);
    // Gaps are closed before pieces are measured: texture would split a mover into small pieces.
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

/// Returns the differing pixels around which most differences have one sign: misregistered texture
/// has both signs.
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

/// Grows movers over pixels of their colour without a verdict: other photos rarely see the ground
/// below a car.
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

/// Fills holes in movers that are small beside them.
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

/// Returns the set pixels that have enough set neighbours.
fn supported(of: &[bool], width: usize, support: usize) -> Vec<bool> {
    let counts = counts(of, width, 1);
    of.iter().zip(counts).map(|(set, count)| *set && count >= support).collect()
}

/// Closes gaps between set pixels. Pixels outside of the photo count as set, since its border cuts
/// movers off.
fn closed(of: &[bool], width: usize) -> Vec<bool> {
    let unset: Vec<bool> = dilated(of, width, CLOSED_GAP_PX).into_iter().map(|set| !set).collect();
    dilated(&unset, width, CLOSED_GAP_PX).into_iter().map(|unset| !unset).collect()
}

fn dilated(of: &[bool], width: usize, radius: usize) -> Vec<bool> {
    counts(of, width, radius).into_iter().map(|count| count > 0).collect()
}
