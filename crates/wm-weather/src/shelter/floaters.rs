//! Lone pieces of the map high above all that is around them: floaters of the reconstruction.
//!
//! A piece is a set of cells, each within two cells and one metre of height of another. It is a
//! floater where
//! - nothing near it is higher, and everything near it is lower by the gap, at least a metre;
//! - it is small: narrower (as the side of a square of its area) than a fifth of the gap, kept to
//!   0.5-2 m;
//! - it is less than a fiftieth of all cells that stop anything.
//!
//! If it is a lamp on its post or a lone leaf and no fault, little is lost: narrow things keep
//! little dry. Its cells are opened again, from half the gap below it, and find what stands there.

use super::grid::Grid;
use crate::threads::map;

/// The number of rounds in which floaters are removed: there may be some below others.
pub(super) const REMOVAL_ROUND_COUNT: usize = 2;
/// Cells within which cells are of one piece.
const PIECE_REACH_CELLS: usize = 2;
/// Difference of height within which cells are of one piece.
const MAX_PIECE_STEP_M: f64 = 1.0;
/// Widest floater, in gaps, and between which widths, m.
const MAX_FLOATER_WIDTH_GAPS: f64 = 0.2;
const MAX_FLOATER_WIDTH_LIMITS_M: [f64; 2] = [0.5, 2.0];
/// Largest share of a floater in all cells that stop anything.
const MAX_FLOATER_SHARE: f64 = 0.02;

/// Rows in which pieces are found on their own, before those that meet at their borders are joined.
const BAND_ROW_COUNT: usize = 64;

/// The statistics of a piece.
#[derive(Clone, Copy)]
struct Piece {
    cells: u32,
    /// Height above all of its surroundings, scene units; 0 if something is above.
    gap: f32,
    deepest: f32,
}

/// Opens the cells of floaters again, with the distance below which they look on; whether there are
/// any.
pub(super) fn reopen(stops: &mut [f32], clear: &mut [f32], grid: &Grid, metres_per_unit: f64) -> bool {
    let step = (MAX_PIECE_STEP_M / metres_per_unit) as f32;
    let firsts = find_pieces(stops, grid, step);
    let mut counts = vec![0u32; stops.len()];
    let mut covered = 0;
    for (first, _) in firsts.iter().zip(stops.iter()).filter(|(_, stop)| stop.is_finite()) {
        counts[*first as usize] += 1;
        covered += 1;
    }
    // Most cells are in pieces that are too large whatever is near them: only the others are looked
    // at.
    let cell = grid.cell * metres_per_unit;
    let is_small = |cells: u32| {
        f64::from(cells).sqrt() * cell < MAX_FLOATER_WIDTH_LIMITS_M[1]
            && f64::from(cells) < MAX_FLOATER_SHARE * f64::from(covered)
    };
    let mut pieces = Vec::new();
    // The number of a small piece, from 1; 0 of others.
    let mut numbers = counts;
    for number in numbers.iter_mut().filter(|count| **count > 0) {
        let cells = std::mem::take(number);
        if is_small(cells) {
            pieces.push(Piece { cells, gap: f32::INFINITY, deepest: f32::NEG_INFINITY });
            *number = pieces.len() as u32;
        }
    }
    let number = |index: usize| numbers[firsts[index] as usize] as usize;
    let gaps = map(grid.rows.div_ceil(BAND_ROW_COUNT), |band| {
        let mut gaps = Vec::new();
        pairs(stops, grid, [band * BAND_ROW_COUNT, band * BAND_ROW_COUNT + BAND_ROW_COUNT], |a, b, off| {
            // Infinity minus itself is no number, and no edge of a piece.
            if off > step {
                let [a, b] = [a, b].map(|cell| cell as usize);
                let (upper, lower) = if stops[a] < stops[b] { (a, b) } else { (b, a) };
                let ends = [(number(upper), off), (number(lower), 0.0)];
                gaps.extend(ends.into_iter().filter(|(number, _)| *number > 0));
            }
        });
        gaps
    });
    for (number, gap) in gaps.into_iter().flatten() {
        let piece: &mut Piece = &mut pieces[number - 1];
        piece.gap = piece.gap.min(gap);
    }
    for (index, stop) in stops.iter().enumerate().filter(|(_, stop)| stop.is_finite()) {
        if let Some(piece) = number(index).checked_sub(1).map(|at| &mut pieces[at]) {
            piece.deepest = piece.deepest.max(*stop);
        }
    }
    let is_floater = |piece: &Piece| {
        let gap = f64::from(piece.gap) * metres_per_unit;
        f64::from(piece.cells).sqrt() * cell
            < (MAX_FLOATER_WIDTH_GAPS * gap)
                .clamp(MAX_FLOATER_WIDTH_LIMITS_M[0], MAX_FLOATER_WIDTH_LIMITS_M[1])
            && gap > 0.0
    };
    let mut is_any = false;
    for index in 0..stops.len() {
        if !stops[index].is_finite() {
            continue;
        }
        if let Some(piece) = number(index).checked_sub(1).map(|at| pieces[at]).filter(is_floater) {
            let below = if piece.gap.is_finite() { 0.5 * piece.gap } else { step };
            (stops[index], clear[index], is_any) = (piece.deepest + below, 1.0, true);
        }
    }
    // The cast fills in all that is clear: cells without a surface are to stay so.
    if is_any {
        for (stop, left) in stops.iter().zip(clear) {
            *left = if stop.is_infinite() { 0.0 } else { *left };
        }
    }
    is_any
}

/// Returns the first cell of the piece that each cell is in.
fn find_pieces(stops: &[f32], grid: &Grid, step: f32) -> Vec<u32> {
    let Grid { columns, rows, .. } = *grid;
    let band_rows = |band: usize| [band * BAND_ROW_COUNT, rows.min(band * BAND_ROW_COUNT + BAND_ROW_COUNT)];
    let bands = map(rows.div_ceil(BAND_ROW_COUNT), |band| {
        let [first, end] = band_rows(band);
        let start = (first * columns) as u32;
        let mut parents: Vec<u32> = (0..((end - first) * columns) as u32).collect();
        let inside = &stops[first * columns..end * columns];
        pairs(inside, &Grid { rows: end - first, ..*grid }, [0, end - first], |a, b, off| {
            // Most are joined already.
            if off <= step && parents[a as usize] != parents[b as usize] {
                join(&mut parents, a, b);
            }
        });
        parents.iter_mut().for_each(|parent| *parent += start);
        parents
    });
    let mut firsts = bands.concat();
    for border in (BAND_ROW_COUNT..rows).step_by(BAND_ROW_COUNT) {
        pairs(stops, grid, [border.saturating_sub(PIECE_REACH_CELLS), border], |a, b, off| {
            let is_across = b as usize >= border * columns;
            if is_across && off <= step && firsts[a as usize] != firsts[b as usize] {
                join(&mut firsts, a, b);
            }
        });
    }
    // A parent is never behind its cell.
    for cell in 0..firsts.len() {
        firsts[cell] = firsts[firsts[cell] as usize];
    }
    firsts
}

/// Calls `visit` once with each pair of cells within the reach whose upper one is in these rows,
/// and how far apart they are along the fall.
fn pairs(stops: &[f32], grid: &Grid, span: [usize; 2], mut visit: impl FnMut(u32, u32, f32)) {
    let [first, end] = span;
    let (columns, rows) = (grid.columns, grid.rows);
    for row in first..end.min(rows) {
        for below in 0..=PIECE_REACH_CELLS.min(rows - 1 - row) {
            let right = PIECE_REACH_CELLS.min(columns - 1) as isize;
            for aside in if below == 0 { 1 } else { -right }..=right {
                let (left, count) = ((-aside).max(0) as usize, columns - aside.unsigned_abs());
                let a = row * columns + left;
                let b = ((row + below) * columns + left).wrapping_add_signed(aside);
                let heights = stops[a..a + count].iter().zip(&stops[b..b + count]);
                for ((a, b), (one, other)) in (a as u32..).zip(b as u32..).zip(heights) {
                    visit(a, b, (one - other).abs());
                }
            }
        }
    }
}

/// The first cell of the piece that a cell is in, so far.
fn root(parents: &mut [u32], mut cell: u32) -> u32 {
    while parents[cell as usize] != cell {
        let above = parents[parents[cell as usize] as usize];
        parents[cell as usize] = above;
        cell = above;
    }
    cell
}

fn join(parents: &mut [u32], a: u32, b: u32) {
    let (a, b) = (root(parents, a), root(parents, b));
    // The smaller index wins: the pieces are the same in whatever order cells are joined.
    parents[a.max(b) as usize] = a.min(b);
}
