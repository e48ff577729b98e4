//! Cover of the ground where it changes along lines that no surface follows: paths through
//! lawns, worn verges, leaf litter under trees.
//!
//! The ground itself is a mesh. Its paint is a function of the position, so paths have edges finer
//! than the mesh, and the material that a ray meets is exactly that of the texture it sees.

use crate::hash::{noise2, octaves2, smoothstep};
use crate::paint::{Material, Paint, PaintId, rgb};
use glam::DVec2;

/// Width of the cells in which the pieces of paths are looked up, m.
const CELL_SIZE_M: f64 = 2.0;
/// Largest shift of an edge by noise, m.
const MAX_EDGE_SHIFT_M: f64 = 0.12;

/// A band along a line.
#[derive(Clone, Debug)]
pub(crate) struct Strip {
    /// The points of its middle line.
    pub(crate) line: Vec<DVec2>,
    /// Half its width, m.
    pub(crate) half: f64,
    pub(crate) paint: PaintId,
    /// Width of worn ground beside it, m.
    pub(crate) verge: f64,
}

/// An ellipse along the axes with a ragged edge.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bed {
    pub(crate) center: DVec2,
    pub(crate) radii: DVec2,
    pub(crate) paint: PaintId,
    /// Largest deviation of the edge from the ellipse, as a share of the radii.
    pub(crate) ragged: f64,
}

/// The cover of a mesh of ground.
#[derive(Clone, Debug, Default)]
pub(crate) struct GroundCover {
    /// Paints of the lawn that is covered and of its worn parts.
    lawn: Option<(PaintId, PaintId)>,
    strips: Vec<Strip>,
    beds: Vec<Bed>,
    /// A lawn that is mown in stripes: its middle and radius.
    mown: (DVec2, f64),
    low: DVec2,
    columns: usize,
    /// Strip and first point of the pieces that come near to each cell.
    cells: Vec<Vec<(u16, u16)>>,
}

impl GroundCover {
    /// The cover of surfaces of paint `lawn` between two corners; of several strips the first
    /// counts, and beds only where there is no strip.
    pub(crate) fn new(
        low: DVec2,
        high: DVec2,
        lawn: (PaintId, PaintId),
        strips: Vec<Strip>,
        beds: Vec<Bed>,
        mown: (DVec2, f64),
    ) -> Self {
        let size = ((high - low) / CELL_SIZE_M).ceil();
        let (columns, rows) = (size.x as usize, size.y as usize);
        let mut cells = vec![Vec::new(); columns * rows];
        for (index, cell) in cells.iter_mut().enumerate() {
            let middle = low
                + DVec2::new((index % columns) as f64 + 0.5, (index / columns) as f64 + 0.5) * CELL_SIZE_M;
            for (which, strip) in strips.iter().enumerate() {
                let reach = strip.half
                    + strip.verge
                    + MAX_EDGE_SHIFT_M
                    + CELL_SIZE_M * std::f64::consts::FRAC_1_SQRT_2;
                for (at, piece) in strip.line.windows(2).enumerate() {
                    if distance(middle, piece[0], piece[1]) < reach {
                        cell.push((which as u16, at as u16));
                    }
                }
            }
        }
        Self { lawn: Some(lawn), strips, beds, mown, low, columns, cells }
    }

    /// Returns true if surfaces of this paint are covered.
    pub(crate) fn covers(&self, paint: PaintId) -> bool {
        self.lawn.is_some_and(|(lawn, _)| lawn == paint)
    }

    /// The paint at a point of the ground, its colours varied as they vary over tens of metres.
    pub(crate) fn paint_at(&self, p: DVec2, paints: &[Paint]) -> Paint {
        let paint = |id: PaintId| paints[usize::from(id)];
        let Some((lawn, worn)) = self.lawn else { return paints[0] };
        let ragged = 0.6 * noise2(p / 0.31, 71) + 0.4 * noise2(p / 0.11, 72);
        let (mut verge, mut nearest) = (None, f64::INFINITY);
        for &(which, at) in self.cell(p) {
            let strip = &self.strips[usize::from(which)];
            let at = usize::from(at);
            // Asphalt is cut straight; gravel spreads.
            let stray =
                if paint(strip.paint).material == Material::Asphalt { 0.02 } else { MAX_EDGE_SHIFT_M };
            let off = distance(p, strip.line[at], strip.line[at + 1]) - strip.half + stray * ragged;
            if off < nearest {
                nearest = off;
                verge = Some(strip);
            }
        }
        if let Some(strip) = verge {
            if nearest <= 0.0 {
                return aged(paint(strip.paint), p);
            }
            // The lawn beside a path is worn in patches, the more the nearer.
            if nearest < strip.verge && 0.5 + 0.7 * noise2(p / 0.27, 73) > nearest / strip.verge {
                return aged(paint(worn), p);
            }
        }
        for bed in &self.beds {
            let reach = ((p - bed.center) / bed.radii).length();
            let edge = 1.0 + bed.ragged * (noise2(p / 2.7, 74) + 0.5 * noise2(p / 0.5, 75));
            if reach < edge {
                return aged(paint(bed.paint), p);
            }
        }
        self.grown(paint(lawn), p)
    }

    /// A lawn: dry and lush parts, clover, mowing stripes on its mown part.
    fn grown(&self, lawn: Paint, p: DVec2) -> Paint {
        let broad = octaves2(p, 16.0, 3, 0.5, 81);
        let dry = smoothstep(0.05, 0.55, octaves2(p + 40.0, 9.0, 4, 0.3, 82));
        let clover = smoothstep(0.22, 0.40, octaves2(p, 2.4, 3, 0.2, 83));
        let (center, radius) = self.mown;
        let mown = smoothstep(radius + 0.6, radius - 0.6, (p - center).length());
        // Rollers lay the grass down one way and back: bands of half a metre, soft-edged.
        let stripe = (0.5 * std::f64::consts::TAU * (p.x + 0.3 * p.y) / 0.95).sin();
        let tone = 1.0 + 0.22 * broad + 0.10 * mown * (stripe * 3.0).clamp(-1.0, 1.0);
        let straw = rgb(0x9C9460);
        let green = rgb(0x52703A);
        let vary = |color: glam::DVec3| {
            color.lerp(straw, 0.55 * dry * (1.0 - 0.7 * mown)).lerp(green, 0.45 * clover * (1.0 - mown))
                * tone
        };
        Paint { color: vary(lawn.color), accent: vary(lawn.accent), ..lawn }
    }

    fn cell(&self, p: DVec2) -> &[(u16, u16)] {
        let at = ((p - self.low) / CELL_SIZE_M).floor();
        if self.columns == 0 || at.x < 0.0 || at.y < 0.0 || at.x as usize >= self.columns {
            return &[];
        }
        self.cells.get(at.y as usize * self.columns + at.x as usize).map_or(&[], Vec::as_slice)
    }
}

/// A paint that is lighter and darker here and there.
fn aged(paint: Paint, p: DVec2) -> Paint {
    let tone = 1.0 + 0.13 * octaves2(p, 7.0, 4, 0.3, 91);
    Paint { color: paint.color * tone, accent: paint.accent * tone, ..paint }
}

/// The distance of a point from a piece of a line, m.
fn distance(p: DVec2, from: DVec2, to: DVec2) -> f64 {
    let along = to - from;
    let share = ((p - from).dot(along) / along.length_squared().max(1e-12)).clamp(0.0, 1.0);
    p.distance(from + along * share)
}

/// A smooth line through points: Catmull and Rom's spline, `steps` pieces between two points.
pub(crate) fn smooth_line(points: &[DVec2], steps: u32) -> Vec<DVec2> {
    let at = |index: isize| points[index.clamp(0, points.len() as isize - 1) as usize];
    let mut line = Vec::new();
    for index in 0..points.len().saturating_sub(1) as isize {
        let (a, b, c, d) = (at(index - 1), at(index), at(index + 1), at(index + 2));
        for step in 0..steps {
            let t = f64::from(step) / f64::from(steps);
            let (t2, t3) = (t * t, t * t * t);
            line.push(
                0.5 * (b * 2.0
                    + (c - a) * t
                    + (a * 2.0 - b * 5.0 + c * 4.0 - d) * t2
                    + (b * 3.0 - a - c * 3.0 + d) * t3),
            );
        }
    }
    line.extend(points.last());
    line
}

/// The point at `share` (0-1) of a line's length, and the direction there.
pub(crate) fn along(line: &[DVec2], share: f64) -> (DVec2, DVec2) {
    let length: f64 = line.windows(2).map(|pair| pair[0].distance(pair[1])).sum();
    let mut left = share.clamp(0.0, 1.0) * length;
    for pair in line.windows(2) {
        let piece = pair[0].distance(pair[1]);
        if left <= piece {
            return (
                pair[0].lerp(pair[1], left / piece.max(1e-12)),
                (pair[1] - pair[0]).normalize_or(DVec2::Y),
            );
        }
        left -= piece;
    }
    let end = line.last().copied().unwrap_or(DVec2::ZERO);
    let before = line.len().checked_sub(2).map_or(end - DVec2::Y, |index| line[index]);
    (end, (end - before).normalize_or(DVec2::Y))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_go_through_their_points_and_are_walked_by_length() {
        let points = [DVec2::ZERO, DVec2::new(4.0, 0.0), DVec2::new(4.0, 4.0)];
        let line = smooth_line(&points, 8);
        assert!(points.iter().all(|point| line.iter().any(|at| at.distance(*point) < 1e-12)));
        let straight = [DVec2::ZERO, DVec2::new(3.0, 0.0), DVec2::new(3.0, 1.0)];
        assert_eq!(along(&straight, 0.5), (DVec2::new(2.0, 0.0), DVec2::X));
        assert_eq!(along(&straight, 1.0), (DVec2::new(3.0, 1.0), DVec2::Y));
        assert!((distance(DVec2::new(1.0, 2.0), DVec2::ZERO, DVec2::X * 3.0) - 2.0).abs() < 1e-12);
    }
}
