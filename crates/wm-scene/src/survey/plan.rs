//! The plumb direction by the plan of a place: seen along it, walls are lines.
//!
//! High walls tell it by where they are, far better than by the normals of their splats, which a
//! training leaves biased by a degree or two. Points of upright surfaces are moved to one height
//! along each direction that may be plumb. Where walls stand along it, their points meet in few
//! cells of a level grid, and the sum of the squares of what cells hold is the greatest.

use super::middle::strided;
use super::sample::SurveySample;
use glam::{DVec2, DVec3, Vec2};
use wm_base::linear::horizontals;
use wm_base::statistics::quantile;

/// Most points of upright surfaces that are used.
const MAX_POINTS: usize = 8000;
/// Largest cosine between the normal of an upright surface and up.
const MAX_UPRIGHT_COS: f64 = 0.35;
/// Share of the points, the nearest to the middle, that are used: strays would make the grid large.
const NEAR_SHARE: f64 = 0.9;
/// Tilts that are compared at first.
const ROUGH_GRID: Grid = Grid { degrees: 1.0, steps: 4, cells: 150.0 };
/// Tilts that are compared about the best of those.
const FINE_GRID: Grid = Grid { degrees: 0.4, steps: 3, cells: 250.0 };
/// Least ratio of the sharpness of the best direction to the median with which there are high
/// walls. Measured: 1.25 of tower blocks, 1.01 to 1.1 where there are low walls or none and the
/// best direction is chance.
const MIN_PEAK_RATIO: f64 = 1.15;

/// Finds the plumb direction within some 5 degrees of `up`; `None` where there are no high walls.
pub(super) fn plumb(sample: &SurveySample, up: DVec3) -> Option<DVec3> {
    let axes = horizontals(up);
    let upright: Vec<_> = sample
        .points
        .iter()
        .filter(|point| point.normal.dot(up).abs() < MAX_UPRIGHT_COS && point.area > 0.0)
        .collect();
    let mut distances: Vec<f64> = upright.iter().map(|point| point.at.distance(sample.center)).collect();
    let reach = quantile(&mut distances, NEAR_SHARE);
    let points: Vec<PlanPoint> = strided(upright.len(), MAX_POINTS)
        .map(|i| upright[i])
        .filter(|point| point.at.distance(sample.center) <= reach)
        .map(|point| {
            let off = point.at - sample.center;
            let place = DVec2::new(off.dot(axes.0), off.dot(axes.1));
            PlanPoint { place: place.as_vec2(), height: off.dot(up) as f32, weight: point.area as f32 }
        })
        .collect();
    let is_place = reach > 0.0 && points.len() > 100;
    if !is_place {
        return None;
    }
    let plan = Plan { points, reach };
    let rough = TiltComparison::new(&plan, DVec2::ZERO, ROUGH_GRID);
    if rough.best() < MIN_PEAK_RATIO * rough.median() {
        return None;
    }
    let middle = rough.place_of_best();
    let tilt = TiltComparison::new(&plan, middle, FINE_GRID).middle_of_peak();
    Some((up + axes.0 * tilt.x + axes.1 * tilt.y).normalize())
}

/// Tilts about a middle one: their distance, degrees, the steps to each side, and the cells across
/// the place at which they are compared.
#[derive(Clone, Copy)]
struct Grid {
    degrees: f64,
    steps: i32,
    cells: f64,
}

/// A point of an upright surface from the middle of a place, scene units.
struct PlanPoint {
    place: Vec2,
    height: f32,
    weight: f32,
}

/// Points of upright surfaces, and their distance from the middle, scene units.
struct Plan {
    points: Vec<PlanPoint>,
    reach: f64,
}

impl Plan {
    /// The sum of the squares of what the cells of a level grid hold, with `cells` across the
    /// place, of points that are moved to one height along a tilt, units a unit of height.
    fn sharpness(&self, tilt: DVec2, cells: f64) -> f64 {
        let scale = (0.5 * cells / self.reach) as f32;
        let tilt = tilt.as_vec2() * scale;
        // Tilts are small: the place is at most a fifth wider.
        let side = (1.2 * cells) as usize + 2;
        let (middle, last) = (0.5 * side as f32, (side - 1) as f32);
        let mut held = vec![0.0f32; side * side];
        // The sum grows with each share that a cell receives, so that cells need not be looked at
        // again.
        let mut sum = 0.0;
        for PlanPoint { place, height, weight } in &self.points {
            let at = *place * scale - tilt * *height + middle;
            let is_in = at.min_element() >= 0.0 && at.max_element() < last;
            if is_in {
                let [column, row] = [at.x as u32, at.y as u32];
                let [right, down] = [at.x - column as f32, at.y - row as f32];
                let lower = weight * down;
                let first = row as usize * side + column as usize;
                let mut grown = 0.0;
                for (start, weight) in [(first, weight - lower), (first + side, lower)] {
                    let [left, next] = &mut held[start..start + 2] else { continue };
                    let share = weight * right;
                    let other = weight - share;
                    grown += other * (2.0 * *left + other) + share * (2.0 * *next + share);
                    *left += other;
                    *next += share;
                }
                sum += f64::from(grown);
            }
        }
        sum
    }
}

/// The sharpness of a plan at tilts about a middle one.
struct TiltComparison {
    tilts: Vec<DVec2>,
    sharpness: Vec<f64>,
}

impl TiltComparison {
    /// Compares tilts about `middle`, units a unit of height.
    fn new(plan: &Plan, middle: DVec2, grid: Grid) -> Self {
        let Grid { degrees, steps, cells } = grid;
        let step = degrees.to_radians().tan();
        let row =
            |x: i32| (-steps..=steps).map(move |y| middle + DVec2::new(f64::from(x), f64::from(y)) * step);
        let tilts: Vec<DVec2> = (-steps..=steps).flat_map(row).collect();
        let sharpness = tilts.iter().map(|tilt| plan.sharpness(*tilt, cells)).collect();
        Self { tilts, sharpness }
    }

    fn best(&self) -> f64 {
        self.sharpness.iter().copied().fold(0.0, f64::max)
    }

    fn median(&self) -> f64 {
        quantile(&mut self.sharpness.clone(), 0.5)
    }

    fn place_of_best(&self) -> DVec2 {
        let best = self.best();
        self.tilts
            .iter()
            .zip(&self.sharpness)
            .find(|(_, own)| **own == best)
            .map_or(DVec2::ZERO, |(tilt, _)| *tilt)
    }

    /// The mean tilt of the upper half of the peak.
    fn middle_of_peak(&self) -> DVec2 {
        let from = 0.5 * (self.best() + self.median());
        let mut sum = (DVec2::ZERO, 0.0);
        for (tilt, own) in self.tilts.iter().zip(&self.sharpness) {
            let weight = (own - from).max(0.0);
            sum = (sum.0 + *tilt * weight, sum.1 + weight);
        }
        if sum.1 > 0.0 { sum.0 / sum.1 } else { self.place_of_best() }
    }
}
