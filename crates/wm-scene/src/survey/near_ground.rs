//! The ground under a point: local, where [`super::ground`] has one height for the scene.
//!
//! That ground is the plane of the lowest large level surface about the foot of the point.

use super::sample::point;
use super::sky::SkyRegion;
use crate::{Splats, quat};
use glam::{DMat3, DVec3};
use wm_base::linear::horizontals;
use wm_base::statistics::quantile;

/// Radii about a point in which its ground is searched, the next where one has too little of it, m.
const SEARCH_RADII_M: [f64; 4] = [2.5, 5.0, 10.0, 20.0];
/// Fewest splats that determine the height of the ground.
const MIN_SPLATS: usize = 40;
/// Least cosine between up and the normal of ground.
const MIN_LEVEL_COS: f64 = 0.8;
/// Least height of an eye over the ground, m.
const MIN_EYE_HEIGHT_M: f64 = 0.2;
/// Thickness of the layers in which surface is counted, m.
const LAYER_M: f64 = 0.1;
/// Least share of the best layer's surface with which a lower layer is the ground.
const MIN_FAIR_SHARE: f64 = 0.35;
/// Largest distances of ground splats from the plane, m, from one fit to the next.
const FIT_DISTANCES_M: [f64; 5] = [0.3, 0.2, 0.12, 0.08, 0.08];
/// Steepest ground that is followed, rise over run.
const MAX_SLOPE: f64 = 0.4;
/// Lowest and highest offset of the visible ground from the plane of the level splats, m.
const VISIBLE_HEIGHTS_M: [f64; 2] = [-0.3, 0.35];
/// Increase of the highest offset with the search radius.
const VISIBLE_SLOPE: f64 = 0.02;
/// Sampled places along a search radius at which the visible ground is determined.
const PLACES_PER_RADIUS: f64 = 8.0;
/// Radius about the point within which the ground is at the feet, m.
const FEET_RADIUS_M: f64 = 0.5;
/// Distance between sampled places there, m.
const FEET_STEP_M: f64 = 0.1;
/// Fewest sampled places that determine the ground at the feet.
const MIN_FEET_PLACES: usize = 30;
/// Largest offset of the ground at the feet from that of the whole disc, in search radii: a lawn is
/// that uneven, plants and kerbs are no ground.
const MAX_UNEVENNESS: f64 = 0.06;

/// The splats of a scene in which the ground under a point is found.
#[derive(Clone, Debug, Default)]
pub struct NearGround {
    axes: DMat3,
    /// The level splats: distances along both level axes and height along up, scene units, and
    /// area, square units.
    points: Vec<[f32; 4]>,
    /// All splats as seen from above.
    covers: Vec<Cover<f32>>,
}

/// A splat as seen from above.
#[derive(Clone, Copy, Debug)]
struct Cover<T> {
    /// Distances along both level axes and height along up.
    at: [T; 3],
    /// Variances along both axes, and the covariance between them.
    spread: [T; 3],
    /// Opacity, 0-1.
    opacity: T,
}

impl Cover<f32> {
    /// Returns it with lengths in metres, from a point.
    fn from(&self, point: [f64; 3], metres_per_unit: f64) -> Cover<f64> {
        Cover {
            at: std::array::from_fn(|k| (f64::from(self.at[k]) - point[k]) * metres_per_unit),
            spread: self.spread.map(|v| f64::from(v) * metres_per_unit * metres_per_unit),
            opacity: f64::from(self.opacity),
        }
    }
}

impl Cover<f64> {
    fn determinant(&self) -> f64 {
        let [xx, yy, xy] = self.spread;
        (xx * yy - xy * xy).max(0.0)
    }

    /// Returns true if it may stop light within a distance of a place.
    fn is_near(&self, place: [f64; 2], distance: f64) -> bool {
        let [xx, yy, _] = self.spread;
        let [x, y] = [0, 1].map(|k| place[k] - self.at[k]);
        let reach = distance + 3.0 * (xx + yy).sqrt();
        x * x + y * y < reach * reach
    }

    /// The share of the light from above that it stops at a place.
    fn stopped_at(&self, place: [f64; 2]) -> f64 {
        let [xx, yy, xy] = self.spread;
        let [x, y] = [0, 1].map(|k| place[k] - self.at[k]);
        let off = (yy * x * x - 2.0 * xy * x * y + xx * y * y) / self.determinant().max(1e-18);
        self.opacity * (-0.5 * off).exp()
    }
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
            if let Some(point) =
                point(splats, index).filter(|point| point.normal.dot(up).abs() > MIN_LEVEL_COS)
            {
                points.push(placed(point.at, point.area));
            }
            covers.push(cover_from_above(splats, index, axes));
        }
        Self { axes, points, covers }
    }

    /// Height along up, scene units, of the ground straight under a point of the scene: of the
    /// plane that fits the lowest large level surface around, moved to where that is seen from
    /// above: large splats lie below what a capture shows of its ground. `None` where there is none
    /// within 20 m.
    #[must_use]
    pub fn height_under(&self, eye: DVec3, metres_per_unit: f64) -> Option<f64> {
        let [x, y, top] = (self.axes * eye).to_array();
        SEARCH_RADII_M.iter().find_map(|metres| {
            let is_near = |[px, py, height]: [f64; 3]| px.hypot(py) < *metres && height < -MIN_EYE_HEIGHT_M;
            let away = |point: &[f32; 4]| {
                let [px, py, height, area] = point.map(f64::from);
                let [px, py, height] = [px - x, py - y, height - top].map(|v| v * metres_per_unit);
                [px, py, height, area * metres_per_unit * metres_per_unit]
            };
            let points = self.points.iter().map(away);
            let points: Vec<[f64; 4]> = points.filter(|[x, y, z, _]| is_near([*x, *y, *z])).collect();
            let plane = plane_of(&points)?;
            let covers = self.covers.iter().map(|cover| cover.from([x, y, top], metres_per_unit));
            let covers: Vec<Cover<f64>> = covers.filter(|cover| is_near(cover.at)).collect();
            let height = plane[0] + seen_over(plane, &covers, *metres);
            Some(top + height / metres_per_unit)
        })
    }
}

/// Returns a splat as seen from above, in scene units. `axes` are the two level axes and up, in
/// rows.
fn cover_from_above(splats: &Splats, index: usize, axes: DMat3) -> Cover<f32> {
    let turn = quat::to_matrix(splats.quats[index].map(f64::from));
    let scales = splats.log_scales[index].map(|scale| f64::from(scale).exp());
    // The splat's axes in those of the plane, each as long as its standard deviation.
    let along = |k: usize| axes * DVec3::from_array(turn.map(|row| row[k])) * scales[k];
    let spread = [0, 1, 2].map(along);
    let sum = |a: usize, b: usize| spread.iter().map(|axis| axis[a] * axis[b]).sum::<f64>() as f32;
    let at = axes * DVec3::from_array(splats.means[index].map(f64::from));
    Cover {
        at: at.to_array().map(|v| v as f32),
        spread: [sum(0, 0), sum(1, 1), sum(0, 1)],
        opacity: splats.opacity(index) as f32,
    }
}

/// Returns the height of the visible ground over a plane in its middle, m: the median at the feet
/// if there is enough of it and it agrees with the median of the whole round, else that one; 0 if
/// no ground is seen.
fn seen_over(plane: [f64; 3], covers: &[Cover<f64>], radius: f64) -> f64 {
    let heights = [VISIBLE_HEIGHTS_M[0], VISIBLE_HEIGHTS_M[1] + VISIBLE_SLOPE * radius];
    let whole = seen_at(plane, covers, heights, radius, radius / PLACES_PER_RADIUS);
    let feet = seen_at(plane, covers, heights, FEET_RADIUS_M, FEET_STEP_M);
    let [whole, feet] = [(whole, 1), (feet, MIN_FEET_PLACES)]
        .map(|(mut seen, least)| (seen.len() >= least).then(|| quantile(&mut seen, 0.5)));
    let whole = whole.unwrap_or(0.0);
    feet.filter(|feet| (feet - whole).abs() < MAX_UNEVENNESS * radius).unwrap_or(whole)
}

/// Returns the heights over a plane, between two of them, at which the ground is seen, m, at places
/// `step` apart within a distance of the middle, m: there the splats above have stopped half of the
/// light from above. Places where less is stopped have none.
fn seen_at(plane: [f64; 3], covers: &[Cover<f64>], heights: [f64; 2], distance: f64, step: f64) -> Vec<f64> {
    let mut near: Vec<(f64, &Cover<f64>)> = covers
        .iter()
        .filter(|cover| cover.is_near([0.0; 2], distance))
        .map(|cover| {
            let [x, y, height] = cover.at;
            (height - plane[0] - plane[1] * x - plane[2] * y, cover)
        })
        .filter(|(over, _)| (heights[0]..heights[1]).contains(over))
        .collect();
    near.sort_by(|a, b| b.0.total_cmp(&a.0));
    let seen = |place: &[f64; 2]| {
        let mut left = 1.0;
        let at_half = near.iter().filter(|(_, cover)| cover.is_near(*place, 0.0)).find(|(_, cover)| {
            left *= 1.0 - cover.stopped_at(*place);
            left <= 0.5
        });
        at_half.map(|(over, _)| *over)
    };
    let steps = (distance / step) as i32;
    let row = |i: i32| (-steps..=steps).map(move |j| [i, j].map(|k| step * f64::from(k)));
    let places: Vec<[f64; 2]> =
        (-steps..=steps).flat_map(row).filter(|[x, y]| x.hypot(*y) < distance).collect();
    places.iter().filter_map(seen).collect()
}

/// Height in the middle of the ground among points `[x, y, height, area]`, m, and its slopes along
/// both axes.
fn plane_of(points: &[[f64; 4]]) -> Option<[f64; 3]> {
    if points.len() < MIN_SPLATS {
        return None;
    }
    let low = points.iter().map(|point| point[2]).fold(f64::INFINITY, f64::min);
    let layer = |height: f64| ((height - low) / LAYER_M).min(1e5) as usize;
    let count = points.iter().map(|point| layer(point[2])).max()? + 2;
    let mut layers = vec![0.0; count];
    for [.., height, area] in points {
        layers[layer(*height)] += area;
    }
    let two = |at: usize| layers[at] + layers.get(at + 1).unwrap_or(&0.0);
    let best = (0..count).map(two).fold(0.0, f64::max);
    let first = (0..count).find(|at| two(*at) >= MIN_FAIR_SHARE * best)?;
    // Height and slopes along both axes.
    let mut plane = [low + (first as f64 + 1.0) * LAYER_M, 0.0, 0.0];
    for thickness in FIT_DISTANCES_M {
        let (mut known, mut sum, mut used) = (DMat3::ZERO, DVec3::ZERO, 0);
        for [x, y, height, area] in points {
            let off = (height - plane[0] - plane[1] * x - plane[2] * y) / thickness;
            if off.abs() < 1.0 {
                let weight = area * (1.0 - off * off).powi(2);
                let row = DVec3::new(1.0, *x, *y);
                known += wm_base::linear::outer(row, weight);
                sum += row * (weight * height);
                used += 1;
            }
        }
        let fit = known.inverse() * sum;
        let is_sound = used >= MIN_SPLATS && fit.is_finite() && fit.y.hypot(fit.z) < MAX_SLOPE;
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

    /// Paving as captures have it: small splats that are seen, any way up, and large level ones up
    /// to 0.3 m below them.
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

    /// A coarse capture: its splats are wider than the feet, and others lie below those that are
    /// seen.
    #[test]
    fn wide_splats_show_the_ground() {
        let mut place = synthetic::Builder::new(7);
        for (count, height, size) in [(700, 0.15, 0.5), (300, 0.0, 0.5)] {
            for _ in 0..count {
                let [x, y] = [0; 2].map(|_| place.draw(-4.0, 4.0));
                let at = DVec3::new(x, y, height + place.draw(-0.01, 0.01));
                place.fleck(at, DVec3::Z, size, [0.4; 3]);
            }
        }
        let ground = NearGround::of(&place.build(), DVec3::Z);
        let height = ground.height_under(DVec3::new(0.0, 0.0, 1.7), 1.0).unwrap();
        assert!((height - 0.15).abs() < 0.03, "{height}");
    }

    /// A coarser one: its few level splats lie half a metre below the ground that is seen, whose
    /// splats are tilted.
    #[test]
    fn tilted_splats_show_the_ground_far_over_level_ones() {
        let mut place = synthetic::Builder::new(8);
        for (count, height, normal) in [
            (90, 0.0, DVec3::Z),
            (9000, 0.55, DVec3::new(0.8, 0.0, 0.6)),
            (9000, 0.55, DVec3::new(-0.8, 0.0, 0.6)),
        ] {
            for _ in 0..count {
                let [x, y] = [0; 2].map(|_| place.draw(-18.0, 18.0));
                place.fleck(DVec3::new(x, y, height), normal, 0.3, [0.4; 3]);
            }
        }
        let ground = NearGround::of(&place.build(), DVec3::Z);
        let height = ground.height_under(DVec3::new(0.0, 0.0, 2.0), 1.0).unwrap();
        assert!((height - 0.55).abs() < 0.03, "{height}");
    }

    /// A lawn with a hollow of 8 cm: at the feet it is as deep as there, and a bush there is no
    /// ground.
    #[test]
    fn the_ground_at_the_feet_is_that_of_a_hollow() {
        let lawn = |x: f64, y: f64| -0.08 * (-(x * x + y * y) / 2.0).exp();
        let mut place = synthetic::Builder::new(6);
        for _ in 0..60_000 {
            let [x, y] = [0; 2].map(|_| place.draw(-4.0, 4.0));
            let normal = place.anywhere();
            place.fleck(DVec3::new(x, y, lawn(x, y)), normal, 0.06, [0.4; 3]);
        }
        place.surface(DVec3::new(-4.0, -4.0, -0.1), DVec3::X * 8.0, DVec3::Y * 8.0, 0.1, |_, _| [0.4; 3]);
        let height = |place: &synthetic::Builder| {
            let ground = NearGround::of(&place.clone().build(), DVec3::Z);
            ground.height_under(DVec3::new(0.0, 0.0, 1.7), 1.0).unwrap()
        };
        let bare = height(&place);
        assert!((bare - lawn(0.3, 0.3)).abs() < 0.025, "{bare}");
        place.leaves(DVec3::new(0.0, 0.0, 0.3), 0.7, 8000, [0.1, 0.4, 0.1]);
        assert!(height(&place) < 0.05, "{}", height(&place));
    }

    #[test]
    fn a_scene_has_ground_under_its_middle() {
        let splats = synthetic::table(1).build();
        let ground = NearGround::of(&splats, DVec3::Z);
        assert!(ground.height_under(DVec3::new(0.0, 0.0, 2.0), 1.0).is_some());
        assert_eq!(ground.height_under(DVec3::new(900.0, 0.0, 2.0), 1.0), None);
    }
}
