//! The ground under a point: local, where [`super::ground`] has one height for the scene.

use super::linear::horizontals;
use super::sample::point;
use super::sky::SkyRegion;
use crate::Splats;
use glam::{DMat3, DVec3};

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

/// The level surfaces of a scene, for [`Self::height_under`].
#[derive(Clone, Debug, Default)]
pub struct NearGround {
    axes: DMat3,
    /// Distances along both level axes, height along up, scene units, and area of each.
    points: Vec<[f32; 4]>,
}

impl NearGround {
    /// Gathers what is level in a scene with this up.
    #[must_use]
    pub fn of(splats: &Splats, up: DVec3) -> Self {
        let sky = SkyRegion::of(splats);
        let (x, y) = horizontals(up);
        let axes = DMat3::from_cols(x, y, up).transpose();
        let points = (0..splats.len())
            .filter(|index| splats.is_sound(*index) && !sky.holds(splats, *index))
            .filter_map(|index| point(splats, index))
            .filter(|point| point.normal.dot(up).abs() > LEVEL)
            .map(|point| {
                let [x, y, height] = (axes * point.at).to_array().map(|v| v as f32);
                [x, y, height, point.area as f32]
            });
        Self { axes, points: points.collect() }
    }

    /// Height along up, scene units, of the ground straight under a point of the scene: of the plane that fits the lowest large level
    /// surface around. `None` where there is none within 20 m.
    #[must_use]
    pub fn height_under(&self, eye: DVec3, metres_per_unit: f64) -> Option<f64> {
        let [x, y, top] = (self.axes * eye).to_array();
        ROUNDS.iter().find_map(|metres| {
            let radius = metres / metres_per_unit;
            let near: Vec<[f64; 4]> = self
                .points
                .iter()
                .map(|point| point.map(f64::from))
                .map(|[px, py, height, area]| {
                    [px - x, py - y, height - top, area].map(|v| v * metres_per_unit)
                })
                .filter(|[px, py, height, _]| px.hypot(*py) < radius * metres_per_unit && *height < -EYE)
                .collect();
            height_of(&near).map(|height| top + height / metres_per_unit)
        })
    }
}

/// Height at the middle of the ground among points `[x, y, height, area]`, m.
fn height_of(points: &[[f64; 4]]) -> Option<f64> {
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
    Some(plane[0])
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
        let height = height_of(&points).unwrap();
        assert!((height + 1.7).abs() < 0.01, "{height}");
        assert_eq!(height_of(&points[..30]), None);
    }

    #[test]
    fn a_scene_has_ground_under_its_middle() {
        let splats = synthetic::table(1).build();
        let ground = NearGround::of(&splats, DVec3::Z);
        assert!(ground.height_under(DVec3::new(0.0, 0.0, 2.0), 1.0).is_some());
        assert_eq!(ground.height_under(DVec3::new(900.0, 0.0, 2.0), 1.0), None);
    }
}
