//! The ground under a point: local, where [`super::ground`] has one height for the scene.

use super::linear::{horizontals, quantile};
use super::sample::point;
use super::sky::SkyRegion;
use crate::{Splats, quat};
use glam::{DMat3, DVec3};
use std::f64::consts::{LN_2, TAU};

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
/// Distances from the plane beyond which a splat is none of the ground, m, from one fit to the next.
const THICKNESS: [f64; 5] = [0.3, 0.2, 0.12, 0.08, 0.08];
/// Steepest ground that is followed, height over way.
const STEEPEST: f64 = 0.4;
/// Lowest and highest place of the visible ground over the plane of the level splats, m.
const SEEN: [f64; 2] = [-0.3, 0.4];
/// Cells along the radius of a round in each of which the visible ground is looked for.
const CELLS: f64 = 8.0;

/// The splats of a scene in which the ground under a point is found.
#[derive(Clone, Debug, Default)]
pub struct NearGround {
    axes: DMat3,
    /// The level splats: distances along both level axes and height along up, scene units, and area, square units.
    points: Vec<[f32; 4]>,
    /// All splats, as in `points`, but with the area that each covers as seen from above.
    covers: Vec<[f32; 4]>,
}

impl NearGround {
    /// Gathers what is level in a scene with this up.
    #[must_use]
    pub fn of(splats: &Splats, up: DVec3) -> Self {
        let sky = SkyRegion::of(splats);
        let (x, y) = horizontals(up);
        let axes = DMat3::from_cols(x, y, up).transpose();
        let placed = |at: DVec3, area: f64| {
            let [x, y, height] = (axes * at).to_array().map(|v| v as f32);
            [x, y, height, area as f32]
        };
        let (mut points, mut covers) = (Vec::new(), Vec::new());
        for index in (0..splats.len()).filter(|index| splats.is_sound(*index) && !sky.holds(splats, *index)) {
            if let Some(point) = point(splats, index).filter(|point| point.normal.dot(up).abs() > LEVEL) {
                points.push(placed(point.at, point.area));
            }
            let at = DVec3::from_array(splats.means[index].map(f64::from));
            covers.push(placed(at, cover_from_above(splats, index, axes)));
        }
        Self { axes, points, covers }
    }

    /// Height along up, scene units, of the ground straight under a point of the scene: of the plane that fits the lowest large level
    /// surface around, moved to where that is seen from above: large splats lie below what a capture shows of its ground.
    /// `None` where there is none within 20 m.
    #[must_use]
    pub fn height_under(&self, eye: DVec3, metres_per_unit: f64) -> Option<f64> {
        let [x, y, top] = (self.axes * eye).to_array();
        ROUNDS.iter().find_map(|metres| {
            let near = |all: &[[f32; 4]]| -> Vec<[f64; 4]> {
                let away = |[px, py, height, area]: [f64; 4]| {
                    let [px, py, height] = [px - x, py - y, height - top].map(|v| v * metres_per_unit);
                    [px, py, height, area * metres_per_unit * metres_per_unit]
                };
                let placed = all.iter().map(|point| away(point.map(f64::from)));
                placed.filter(|[px, py, height, _]| px.hypot(*py) < *metres && *height < -EYE).collect()
            };
            let plane = plane_of(&near(&self.points))?;
            let height = plane[0] + seen_over(plane, &near(&self.covers), *metres);
            Some(top + height / metres_per_unit)
        })
    }
}

/// Returns the area that a splat covers as seen from above, square units: the integral of its opacity over the level plane. `axes` are
/// the two level axes and up, in rows.
fn cover_from_above(splats: &Splats, index: usize, axes: DMat3) -> f64 {
    let turn = quat::to_matrix(splats.quats[index].map(f64::from));
    let scales = splats.log_scales[index].map(|scale| f64::from(scale).exp());
    // The splat's axes in those of the plane, each as long as its standard deviation.
    let along = |k: usize| axes * DVec3::from_array(turn.map(|row| row[k])) * scales[k];
    let spread = [0, 1, 2].map(along);
    let sum = |a: usize, b: usize| spread.iter().map(|axis| axis[a] * axis[b]).sum::<f64>();
    TAU * splats.opacity(index) * (sum(0, 0) * sum(1, 1) - sum(0, 1).powi(2)).max(0.0).sqrt()
}

/// Returns the height of the visible ground over a plane, m. In each cell of a grid the ground is seen where the splats
/// `[x, y, height, area]` above have stopped half of the light from above; the median over the cells is returned, and 0 if so much is
/// stopped in none.
fn seen_over(plane: [f64; 3], covers: &[[f64; 4]], radius: f64) -> f64 {
    let cell = radius / CELLS;
    let mut near: Vec<([i32; 2], f64, f64)> = covers
        .iter()
        .map(|[x, y, height, area]| {
            let over = height - plane[0] - plane[1] * x - plane[2] * y;
            ([x, y].map(|v| (v / cell).floor() as i32), over, *area)
        })
        .filter(|(_, over, _)| (SEEN[0]..SEEN[1]).contains(over))
        .collect();
    near.sort_by(|a, b| a.0.cmp(&b.0).then(b.1.total_cmp(&a.1)));
    let half = LN_2 * cell * cell;
    let mut heights: Vec<f64> = near
        .chunk_by(|a, b| a.0 == b.0)
        .filter_map(|cell| {
            let mut stopped = 0.0;
            cell.iter().find_map(|(_, over, area)| {
                stopped += area;
                (stopped >= half).then_some(*over)
            })
        })
        .collect();
    if heights.is_empty() { 0.0 } else { quantile(&mut heights, 0.5) }
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
    // Height and slopes along both axes.
    let mut plane = [low + (first as f64 + 1.0) * LAYER, 0.0, 0.0];
    for thickness in THICKNESS {
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
        let is_sound = used >= LEAST && fit.is_finite() && fit.y.hypot(fit.z) < STEEPEST;
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

    #[test]
    fn a_scene_has_ground_under_its_middle() {
        let splats = synthetic::table(1).build();
        let ground = NearGround::of(&splats, DVec3::Z);
        assert!(ground.height_under(DVec3::new(0.0, 0.0, 2.0), 1.0).is_some());
        assert_eq!(ground.height_under(DVec3::new(900.0, 0.0, 2.0), 1.0), None);
    }
}
