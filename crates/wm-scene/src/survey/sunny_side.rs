//! The side from which a sun would light most of what a capture shows: for weathers that say how
//! high their sun stands and not where.
//!
//! Rays go from a few surfaces near the ground and the cameras towards suns all around, through
//! cells that hold as much surface as closes half of them.

use super::middle::strided;
use super::sample::{SurveyPoint, SurveySample};
use crate::SceneView;
use glam::DVec3;
use std::f64::consts::{PI, TAU};
use wm_base::linear::horizontals;

/// Elevations of the suns that are tried, degrees: low, afternoon and noon.
const ELEVATIONS_DEG: [f64; 3] = [8.0, 25.0, 45.0];
/// Azimuths that are tried.
const AZIMUTH_COUNT: usize = 24;
/// Cells per radius of the place.
const CELLS_PER_RADIUS: f64 = 28.0;
/// Cells along each side of the cube: a ray goes two radii from a surface, which is within some
/// radii of the middle.
const SIDE_CELLS: usize = 200;
/// Least surface in a cell that stops the sun, in areas of its side.
const CLOSED_SHARE: f64 = 0.5;
/// Largest height of sampled surfaces above the ground, radii of the place.
const MAX_HEIGHT_RADII: f64 = 0.12;
/// Largest distance of sampled surfaces from the middle of the cameras, radii of the place.
const MAX_DISTANCE_RADII: f64 = 0.7;
/// Most sampled surfaces.
const MAX_SURFACES: usize = 200;
/// Offset of the start of a ray from its surface, cells: a surface does not shade itself.
const CLEARANCE_CELLS: f64 = 1.8;
/// Least difference of the lit shares of the best and the worst side with which one is preferred.
const MIN_SHARE_DIFFERENCE: f64 = 0.03;

/// The directions from which suns of several elevations light most of a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SunnySide {
    /// For each of [`ELEVATIONS_DEG`]: the level direction towards the sun (world axes, length 1),
    /// and the share of the surface that it reaches, 0-1; `None` where no side is better than the
    /// others.
    sides: [Option<(DVec3, f64)>; 3],
}

impl SunnySide {
    /// No side is better than the others.
    pub const NONE: Self = Self { sides: [None; 3] };

    /// Finds the sunny side of a scene by sampled splats, up, the height of the ground along up
    /// (scene units), and the cameras of its photos.
    pub(super) fn of(sample: &SurveySample, up: DVec3, ground: f64, views: &[SceneView]) -> Self {
        let cell = sample.radius / CELLS_PER_RADIUS;
        if sample.points.is_empty() || !(cell.is_finite() && cell > 0.0) {
            return Self::NONE;
        }
        let centers: Vec<DVec3> = views.iter().map(|view| view.camera.center()).collect();
        let middle = match centers.len() {
            0 => sample.center,
            count => centers.iter().sum::<DVec3>() / count as f64,
        };
        let cells = Cells { first: middle - DVec3::splat(0.5 * SIDE_CELLS as f64 * cell), cell };
        // Each sampled splat stands for several, and covers pi times the product of its standard
        // deviations.
        let stands_for = PI * sample.stands_for as f64;
        let mut surface: Vec<(usize, f64)> = sample
            .points
            .iter()
            .filter_map(|p| Some((Cells::at(cells.place(p.at))?, p.area * stands_for)))
            .collect();
        surface.sort_by_key(|(index, _)| *index);
        let mut closed = vec![false; SIDE_CELLS * SIDE_CELLS * SIDE_CELLS];
        for cell_of in surface.chunk_by(|a, b| a.0 == b.0) {
            let area: f64 = cell_of.iter().map(|(_, area)| area).sum();
            closed[cell_of[0].0] = area > CLOSED_SHARE * cell * cell;
        }
        let stops = |place: DVec3| Cells::at(place).is_some_and(|index| closed[index]);
        let is_near = |point: &&SurveyPoint| {
            let height = point.at.dot(up) - ground;
            let across = (point.at - middle).reject_from(up).length();
            (-cell..MAX_HEIGHT_RADII * sample.radius).contains(&height)
                && across < MAX_DISTANCE_RADII * sample.radius
        };
        let near: Vec<&SurveyPoint> = sample.points.iter().filter(is_near).collect();
        let seen: Vec<&SurveyPoint> = strided(near.len(), MAX_SURFACES).map(|i| near[i]).collect();
        let whole: f64 = seen.iter().map(|point| point.area).sum();
        if whole <= 0.0 {
            return Self::NONE;
        }
        let (east, north) = horizontals(up);
        let level = |k: usize| {
            let (sin, cos) = (TAU * k as f64 / AZIMUTH_COUNT as f64).sin_cos();
            north * cos + east * sin
        };
        let steps = (2.0 * CELLS_PER_RADIUS) as u32;
        let lit = |towards: DVec3| {
            // A step is a cell.
            let sees = |point: &&&SurveyPoint| {
                let start = cells.place(point.at) + (towards + up) * CLEARANCE_CELLS;
                !(0..steps).any(|step| stops(start + towards * f64::from(step)))
            };
            seen.iter().filter(sees).map(|point| point.area).sum::<f64>() / whole
        };
        let sides = ELEVATIONS_DEG.map(|elevation| {
            let (sin, cos) = elevation.to_radians().sin_cos();
            let shares: Vec<f64> = (0..AZIMUTH_COUNT).map(|k| lit(level(k) * cos + up * sin)).collect();
            let [worst, best] = [f64::min, f64::max].map(|of| shares.iter().copied().fold(shares[0], of));
            let at = shares.iter().position(|share| *share == best)?;
            (best > worst + MIN_SHARE_DIFFERENCE).then(|| (level(at), best))
        });
        Self { sides }
    }

    /// Returns the level direction (world axes, length 1) towards a sun of an elevation, degrees,
    /// that lights most of the place, and the share of the surface near the ground that it lights,
    /// 0-1; `None` where no side is better than the others.
    #[must_use]
    pub fn towards(&self, elevation: f64) -> Option<(DVec3, f64)> {
        let away = |k: &usize| (ELEVATIONS_DEG[*k] - elevation).abs();
        (0..ELEVATIONS_DEG.len()).min_by(|a, b| away(a).total_cmp(&away(b))).and_then(|k| self.sides[k])
    }
}

/// A cube of cells, [`SIDE_CELLS`] along each side.
struct Cells {
    /// The corner from which cells are counted, scene units.
    first: DVec3,
    /// Width of a cell, scene units.
    cell: f64,
}

impl Cells {
    /// A point, in cells from the corner.
    fn place(&self, point: DVec3) -> DVec3 {
        (point - self.first) / self.cell
    }

    /// The index of the cell that holds a place, in cells; `None` outside.
    fn at(place: DVec3) -> Option<usize> {
        let is_in = place.min_element() >= 0.0 && place.max_element() < SIDE_CELLS as f64;
        is_in.then(|| ((place.z as usize * SIDE_CELLS) + place.y as usize) * SIDE_CELLS + place.x as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::super::Survey;
    use crate::synthetic::Builder;
    use crate::{Metadata, Scene};
    use glam::DVec3;

    /// A court of 24 m between walls of 20 m, open towards `open`: 0 for +x, a quarter turn for
    /// each more; 4 for none.
    fn court(open: usize) -> Survey {
        let mut place = Builder::new(5);
        place.block(DVec3::new(0.0, 0.0, -0.2), DVec3::new(24.0, 24.0, 0.2), 0.4, [0.5; 3]);
        let ways = [DVec3::X, DVec3::Y, DVec3::NEG_X, DVec3::NEG_Y];
        for way in ways.iter().enumerate().filter(|(k, _)| *k != open).map(|(_, way)| *way) {
            let size = DVec3::new(1.0, 1.0, 20.0) + DVec3::Z.cross(way).abs() * 25.0;
            place.block(way * 13.0, size, 0.4, [0.4; 3]);
        }
        let given = Metadata { up: Some(DVec3::Z), ..Metadata::default() };
        Survey::of(&Scene { splats: place.build(), ..Scene::default() }, &given)
    }

    #[test]
    fn a_court_is_lit_through_its_open_side() {
        for (open, side) in [DVec3::X, DVec3::Y, DVec3::NEG_X, DVec3::NEG_Y].into_iter().enumerate() {
            let found = court(open).sunny_side;
            let (towards, share) = found.towards(8.0).unwrap();
            assert!(towards.dot(side) > 0.75, "{open}: {towards}");
            assert!(share > 0.3, "{open}: {share}");
        }
        // Into a closed court a low sun shines through the holes of its walls at most.
        assert!(court(4).sunny_side.towards(8.0).is_none_or(|(_, share)| share < 0.2));
    }
}
