//! The ground under a point: local, where [`super::ground`] has one height for the scene.

use super::linear::{horizontals, quantile};
use super::sample::point;
use super::sky::SkyRegion;
use crate::{Splats, quat};
use glam::{DMat3, DVec3};
use std::f32::consts::LN_2;
use std::f64::consts::{PI, TAU};

/// Radii of the round in which the ground under a point is looked for, the next where one has too little of it, m.
const ROUNDS: [f64; 4] = [2.5, 5.0, 10.0, 20.0];
/// Splats of the ground that tell its height.
const LEAST: usize = 40;
/// Least cosine between up and the normal of ground.
const LEVEL: f64 = 0.8;
/// Least height of an eye over the ground, m.
const EYE: f64 = 0.2;
/// Thickness of the layers in which surface is counted, m, and the share of the best layer's surface with which a lower one is the
/// ground.
const LAYER: f64 = 0.1;
const FAIR: f64 = 0.35;
/// Share of the round that level splats must cover: fewer are those of a table or a step.
const COVERED: f64 = 0.1;
/// Distances from the plane beyond which a splat is none of the ground, m, from one fit to the next.
const THICKNESS: [f64; 5] = [0.3, 0.2, 0.12, 0.08, 0.08];
/// The same for what is seen of rough ground.
const ROUGH: [f64; 5] = [0.8, 0.5, 0.3, 0.2, 0.15];
/// Cells of the grid in which rough ground must be seen, and the share of them that is lower than where the fit begins: what stands on it
/// is higher.
const LEAST_SEEN: usize = 24;
const LOWER: f64 = 0.35;
/// Steepest ground that is followed, height over way.
const STEEPEST: f64 = 0.4;
/// Lowest and highest place of the visible ground over the plane of the level splats, m.
const SEEN: [f64; 2] = [-0.3, 0.4];
/// Cells along the radius of a round in each of which the visible ground is looked for.
const CELLS: usize = 8;

/// The splats of a scene in which the ground under a point is found.
#[derive(Clone, Debug, Default)]
pub struct NearGround {
    axes: DMat3,
    /// The level splats: distances along both level axes and height along up, scene units, and area, square units.
    points: Vec<[f32; 4]>,
    /// All splats as seen from above.
    covers: Vec<Cover>,
}

/// A splat as seen from above: a level square.
#[derive(Clone, Copy, Debug)]
struct Cover {
    /// The middle: distances along both level axes and height along up.
    at: [f32; 3],
    /// Length of its sides.
    side: f32,
    opacity: f32,
}

impl NearGround {
    /// Gathers what is level in a scene with this up.
    #[must_use]
    pub fn of(splats: &Splats, up: DVec3) -> Self {
        let sky = SkyRegion::of(splats);
        let (x, y) = horizontals(up);
        let axes = DMat3::from_cols(x, y, up).transpose();
        let placed = |at: DVec3| (axes * at).to_array().map(|v| v as f32);
        let (mut points, mut covers) = (Vec::new(), Vec::new());
        for index in (0..splats.len()).filter(|index| splats.is_sound(*index) && !sky.holds(splats, *index)) {
            if let Some(point) = point(splats, index).filter(|point| point.normal.dot(up).abs() > LEVEL) {
                let [x, y, height] = placed(point.at);
                points.push([x, y, height, point.area as f32]);
            }
            covers.push(Cover {
                at: placed(DVec3::from_array(splats.means[index].map(f64::from))),
                side: side_from_above(splats, index, axes) as f32,
                opacity: splats.opacity(index) as f32,
            });
        }
        Self { axes, points, covers }
    }

    /// Height along up, scene units, of the ground straight under a point of the scene: of the plane that fits the lowest large level
    /// surface around, moved to where that is seen from above: large splats lie below what a capture shows of its ground. Where no plane
    /// fits level splats, one is fitted to what is seen from above.
    /// `None` where there is none within 20 m.
    #[must_use]
    pub fn height_under(&self, eye: DVec3, metres_per_unit: f64) -> Option<f64> {
        let [x, y, top] = (self.axes * eye).to_array();
        ROUNDS.iter().find_map(|metres| {
            let away = |[px, py, height]: [f32; 3]| {
                [f64::from(px) - x, f64::from(py) - y, f64::from(height) - top].map(|v| v * metres_per_unit)
            };
            let is_near = |[x, y, height]: [f64; 3]| x.hypot(y) < *metres && height < -EYE;
            let metric = |cover: &Cover| {
                let side = cover.side * metres_per_unit as f32;
                Cover { at: away(cover.at).map(|v| v as f32), side, ..*cover }
            };
            let covers: Vec<Cover> =
                self.covers.iter().filter(|cover| is_near(away(cover.at))).map(metric).collect();
            let level: Vec<[f64; 4]> = (self.points.iter())
                .map(|[x, y, height, area]| (away([*x, *y, *height]), f64::from(*area)))
                .filter(|(at, _)| is_near(*at))
                .map(|([x, y, height], area)| [x, y, height, area * metres_per_unit * metres_per_unit])
                .collect();
            let covered = TAU * level.iter().map(|point| point[3]).sum::<f64>();
            let is_level = covered > COVERED * PI * metres * metres;
            let plane = if is_level { plane_of(&level) } else { None };
            let height = match plane {
                Some(plane) => plane[0] + seen_over(plane, &covers, *metres),
                // Rough captures have no level splats: what is seen of the ground tells its height.
                None => seen_from(&covers, *metres)?,
            };
            Some(top + height / metres_per_unit)
        })
    }
}

/// Returns the side of the level square, units, that covers as much as a splat does as seen from above, with the splat's opacity: the
/// integral over the level plane is the same. `axes` are the two level axes and up, in rows.
fn side_from_above(splats: &Splats, index: usize, axes: DMat3) -> f64 {
    let turn = quat::to_matrix(splats.quats[index].map(f64::from));
    let scales = splats.log_scales[index].map(|scale| f64::from(scale).exp());
    // The splat's axes in those of the plane, each as long as its standard deviation.
    let along = |k: usize| axes * DVec3::from_array(turn.map(|row| row[k])) * scales[k];
    let spread = [0, 1, 2].map(along);
    let sum = |a: usize, b: usize| spread.iter().map(|axis| axis[a] * axis[b]).sum::<f64>();
    (TAU * (sum(0, 0) * sum(1, 1) - sum(0, 1).powi(2)).max(0.0).sqrt()).sqrt()
}

/// Returns the height of the visible ground over a plane, m. In each cell of a grid the ground is seen where the splats
/// above have stopped half of the light from above; the median over the cells is returned, and 0 if so much is stopped in none.
fn seen_over(plane: [f64; 3], covers: &[Cover], radius: f64) -> f64 {
    let [height, east, north] = plane.map(|v| v as f32);
    let over = |cover: &Cover| {
        let [x, y, own] = cover.at;
        Cover { at: [x, y, own - height - east * x - north * y], ..*cover }
    };
    let near = covers.iter().map(over).filter(|cover| (SEEN[0]..SEEN[1]).contains(&f64::from(cover.at[2])));
    let mut heights: Vec<f64> = seen(near, radius).iter().map(|seen| seen[2]).collect();
    if heights.is_empty() { 0.0 } else { quantile(&mut heights, 0.5) }
}

/// Returns where splats have stopped half of the light from above, in each cell of a grid within a radius, m, where they stop as much: the
/// middle of the cell, and the height.
fn seen(covers: impl Iterator<Item = Cover>, radius: f64) -> Vec<[f64; 3]> {
    let cell = (radius / CELLS as f64) as f32;
    let half = CELLS as i32;
    let mut covers: Vec<Cover> = covers.collect();
    covers.sort_by(|a, b| b.at[2].total_cmp(&a.at[2]));
    // The optical depth above each cell.
    let mut stopped = [[0.0f32; 2 * CELLS]; 2 * CELLS];
    let mut found = Vec::new();
    for Cover { at: [x, y, height], side, opacity } in covers {
        let edges = |middle: f32| [middle - 0.5 * side, middle + 0.5 * side].map(|edge| edge / cell);
        let range =
            |[low, high]: [f32; 2]| (low.floor() as i32).max(-half)..=(high.floor() as i32).min(half - 1);
        let shared = |[low, high]: [f32; 2], at: i32| high.min(at as f32 + 1.0) - low.max(at as f32);
        let (across, along) = (edges(x), edges(y));
        for column in range(across) {
            for row in range(along) {
                let above = &mut stopped[(column + half) as usize][(row + half) as usize];
                let before = *above;
                *above += opacity * shared(across, column) * shared(along, row);
                if before < LN_2 && *above >= LN_2 {
                    let middle = [column, row].map(|v| f64::from((v as f32 + 0.5) * cell));
                    found.push([middle[0], middle[1], f64::from(height)]);
                }
            }
        }
    }
    found
}

/// Returns the height in the middle, m, of the plane that fits most of the lower part of what is seen from above within a radius, m.
fn seen_from(covers: &[Cover], radius: f64) -> Option<f64> {
    let cells = seen(covers.iter().copied(), radius);
    if cells.len() < LEAST_SEEN {
        return None;
    }
    let mut heights: Vec<f64> = cells.iter().map(|cell| cell[2]).collect();
    let start = [quantile(&mut heights, LOWER), 0.0, 0.0];
    let points: Vec<[f64; 4]> = cells.iter().map(|[x, y, height]| [*x, *y, *height, 1.0]).collect();
    fitted(&points, start, ROUGH, LEAST_SEEN).map(|plane| plane[0])
}

/// Height in the middle of the ground among points `[x, y, height, area]`, m, and its slopes along both axes.
fn plane_of(points: &[[f64; 4]]) -> Option<[f64; 3]> {
    if points.len() < LEAST {
        return None;
    }
    let low = points.iter().map(|point| point[2]).fold(f64::INFINITY, f64::min);
    let layer = |height: f64| ((height - low) / LAYER).min(1e5) as usize;
    let count = points.iter().map(|point| layer(point[2])).max()? + 2;
    let mut layers = vec![0.0; count];
    for [.., height, area] in points {
        layers[layer(*height)] += area;
    }
    let two = |at: usize| layers[at] + layers.get(at + 1).unwrap_or(&0.0);
    let best = (0..count).map(two).fold(0.0, f64::max);
    let first = (0..count).find(|at| two(*at) >= FAIR * best)?;
    fitted(points, [low + (first as f64 + 1.0) * LAYER, 0.0, 0.0], THICKNESS, LEAST)
}

/// Fits a plane to points `[x, y, height, area]`, from a first one on: its height in the middle, m, and its slopes along both axes. Points
/// farther from it than `thickness`, m, count nothing, in one fit after the other; `least` must count.
fn fitted(points: &[[f64; 4]], start: [f64; 3], thickness: [f64; 5], least: usize) -> Option<[f64; 3]> {
    let mut plane = start;
    for thickness in thickness {
        let (mut known, mut sum, mut used) = (DMat3::ZERO, DVec3::ZERO, 0);
        for [x, y, height, area] in points {
            let off = (height - plane[0] - plane[1] * x - plane[2] * y) / thickness;
            if off.abs() < 1.0 {
                let weight = area * (1.0 - off * off).powi(2);
                let row = DVec3::new(1.0, *x, *y);
                known += super::linear::outer(row, weight);
                sum += row * (weight * height);
                used += 1;
            }
        }
        let fit = known.inverse() * sum;
        let is_sound = used >= least && fit.is_finite() && fit.y.hypot(fit.z) < STEEPEST;
        if !is_sound {
            return None;
        }
        plane = fit.to_array();
    }
    Some(plane)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic;

    /// A slope with a table on it, and something that floats below.
    #[test]
    fn the_ground_under_an_eye_is_that_of_the_slope_there() {
        let mut points = Vec::new();
        for i in 0..60 {
            for j in 0..60 {
                let [x, y] = [i, j].map(|v| f64::from(v) * 0.1 - 3.0);
                points.push([
                    x,
                    y,
                    -1.7 + 0.03 * x - 0.02 * y + 0.004 * f64::from((i * 7 + j * 3) % 5 - 2),
                    0.01,
                ]);
                if x.abs() < 0.6 && y.abs() < 0.6 {
                    points.push([x, y, -1.0, 0.01]);
                }
            }
        }
        points.extend((0..20).map(|i| [0.1 * f64::from(i), 0.0, -4.0, 0.002]));
        let height = plane_of(&points).unwrap()[0];
        assert!((height + 1.7).abs() < 0.01, "{height}");
        assert_eq!(plane_of(&points[..30]), None);
    }

    /// Paving as captures have it: small splats that are seen, any way up, and large level ones up to 0.3 m below them.
    #[test]
    fn the_ground_is_where_it_is_seen() {
        let mut place = synthetic::Builder::new(5);
        for (count, depth, size, is_level) in
            [(60_000, [0.0, 0.02], 0.06, false), (1500, [0.05, 0.3], 0.3, true)]
        {
            for _ in 0..count {
                let [x, y] = [0; 2].map(|_| place.draw(-4.0, 4.0));
                let at = DVec3::new(x, y, 0.03 * y - place.draw(depth[0], depth[1]));
                let normal = if is_level { DVec3::Z } else { place.anywhere() };
                place.fleck(at, normal, size, [0.4; 3]);
            }
        }
        let ground = NearGround::of(&place.build(), DVec3::Z);
        for [x, y] in [[0.0, 0.0], [1.0, -1.0]] {
            let height = ground.height_under(DVec3::new(x, y, 1.7), 1.0).unwrap();
            assert!((height - 0.03 * y).abs() < 0.03, "{height} at {y}");
        }
    }

    /// Rough ground: splats of all directions in a layer of 0.2 m, with a crate on it, and strays above.
    #[test]
    fn rough_ground_is_where_it_is_seen() {
        let mut place = synthetic::Builder::new(8);
        for _ in 0..9000 {
            let [x, y] = [0; 2].map(|_| place.draw(-4.0, 4.0));
            let at = DVec3::new(x, y, 0.04 * x - place.draw(0.0, 0.2));
            let normal = place.anywhere().with_z(0.0).normalize() + DVec3::Z * place.draw(-0.7, 0.7);
            place.fleck(at, normal, 0.25, [0.4; 3]);
        }
        place.block(DVec3::new(1.0, 1.0, 0.0), DVec3::splat(0.8), 0.1, [0.6; 3]);
        place.strays(DVec3::new(-4.0, -4.0, 0.2), DVec3::new(4.0, 4.0, 3.0), 200);
        let ground = NearGround::of(&place.build(), DVec3::Z);
        let height = ground.height_under(DVec3::new(0.0, 0.0, 1.7), 1.0).unwrap();
        assert!((-0.08..0.03).contains(&height), "{height}");
    }

    #[test]
    fn a_scene_has_ground_under_its_middle() {
        let splats = synthetic::table(1).build();
        let ground = NearGround::of(&splats, DVec3::Z);
        assert!(ground.height_under(DVec3::new(0.0, 0.0, 2.0), 1.0).is_some());
        assert_eq!(ground.height_under(DVec3::new(900.0, 0.0, 2.0), 1.0), None);
    }
}
