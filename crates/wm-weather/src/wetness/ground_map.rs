//! The ground that water stands on: a level grid of smoothed heights, and its depressions.
//!
//! The geometry of a capture has noise of 1 to 3 cm, more than puddles are deep. So the ground is
//! smoothed over half a metre, only depressions that survive count, and none of them where the
//! ground slopes. Their edges come from `relief.rs`.

use super::basins::{Basins, EdgeRule, NO_BASIN, neighbours};
use super::eaves::{Eave, eaves};
use super::plane_fit::{Plane, PlaneFit};
use super::relief::{self, relief};
use crate::cover::ground::GroundGrid;
use crate::fused_surfaces::FusedSurfaces;
use crate::open_water::OpenWater;
use crate::optics::Site;
use crate::shelter::{HeightLayers, Occluders, ShelterOptions};
use crate::threads::map;
use serde::{Deserialize, Serialize};

/// Width of a cell, m, the most of them, and how far from the photos the grid goes, m.
const CELL_WIDTH_M: f64 = 0.1;
const MOST_CELLS: usize = 700_000;
const PATH_REACH_M: f64 = 32.0;
/// Step from a cell to the next at which the ground ends, as a slope, and at least, m.
const MAX_STEP_SLOPE: f32 = 0.5;
const MIN_STEP_M: f32 = 0.05;
/// Standard deviation of the smoothing, m, and the share of the ground about a cell from which a
/// gap counts as ground.
const SMOOTHING_SIGMA_M: f32 = 0.25;
const MIN_GAP_GROUND_SHARE: f32 = 0.3;
/// Height of something that stands on the ground.
const MIN_OBJECT_HEIGHT_M: f32 = 0.12;
/// Least area of a ground, m^2; the share of its edge beside which it drops off that makes it the
/// top of something, and by how much, m.
const MIN_GROUND_AREA_M2: f64 = 6.0;
const MIN_DROPPING_EDGE_SHARE: f32 = 0.3;
const DROP_HEIGHT_M: f32 = 0.2;
/// Least depth and area of a puddle, m and m^2; the depth from which it is a hole of the capture;
/// and the steepest ground that holds one.
const MIN_PUDDLE_DEPTH_M: f32 = 0.006;
const MIN_PUDDLE_AREA_M2: f64 = 0.12;
const MAX_PUDDLE_DEPTH_M: f32 = 0.25;
const MAX_PUDDLE_SLOPE: f32 = 0.035;
/// Distance to the end of what the capture shows over which water fades, m, and to the border of
/// the grid.
const END_FADE_DISTANCE_M: f32 = 0.6;
const BORDER_FADE_DISTANCE_M: f32 = 8.0;
/// Slope of the ground as a whole up to which it is an error of an estimated up.
const MAX_TILT_SLOPE: f64 = 0.06;
/// Height above or below the ground up to which a splat shows it, m.
pub(super) const ON_GROUND: f32 = 0.15;
/// Depth below the ground to which splats are seen through it, m.
const SEEN_DEPTH_M: f32 = 3.0;
/// Blue and red over green of lawns, green or dry, and of soil: all of the ground up to the first,
/// none from the second on. Measured lawns have 0.5 to 0.6 and 0.9 to 1.15, paving of stone 0.85
/// and more of blue, bricks 1.5 and more of red.
const MATTE_BLUE: [f32; 2] = [0.63, 0.75];
const MATTE_RED: [f32; 2] = [1.35, 1.5];
/// Distance over which that slope is taken, m.
const SLOPE_OVER: f64 = 1.5;

/// The ground of a place and its depressions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GroundMap {
    pub(crate) places: HeightLayers,
    /// Slope of the ground as a whole along columns and rows, that is an error of up, m a cell.
    tilt: [f64; 2],
    /// Smoothed heights above it, m, `[rows, columns]`; not a number where there is no ground.
    pub(crate) ground: Vec<f32>,
    /// Heights with the relief.
    pub(crate) rough: Vec<f32>,
    /// The depressions.
    pub(crate) basins: Basins,
    /// Heights of open water, m; not a number where there is none.
    pub(crate) open: Vec<f32>,
    /// Eaves of roofs over it.
    pub(crate) eaves: Vec<Eave>,
    /// Share of what is about each cell that the capture shows, 0-1: 0 where that ends, 1 where it
    /// goes on.
    pub(crate) seen: Vec<f32>,
    /// Share of each cell that is lawn or soil, 0-1.
    pub(crate) matte: Vec<f32>,
}

impl GroundMap {
    /// Returns true if its parts fit each other and a scene of `splats` splats.
    pub(super) fn is_consistent(&self, splats: usize) -> bool {
        let Some(cells) = self.places.size()[0].checked_mul(self.places.size()[1]) else { return false };
        let lengths =
            [self.ground.len(), self.rough.len(), self.open.len(), self.seen.len(), self.matte.len()];
        let eaves = self
            .eaves
            .iter()
            .flat_map(|eave| [eave.place[0], eave.place[1], eave.drop, eave.ground, eave.area]);
        self.places.is_consistent(splats)
            && self.tilt.into_iter().all(f64::is_finite)
            && lengths.into_iter().all(|length| length == cells)
            && self.seen.iter().chain(&self.matte).copied().chain(eaves).all(f32::is_finite)
            && self.basins.is_consistent(cells)
    }

    /// Finds the ground of a scene about a `path` (world, scene units), without its open water.
    /// Where up is estimated, `is_up_known` is false, and ground that slopes a little as a whole is
    /// taken for level.
    pub(crate) fn new(
        scan: &FusedSurfaces<'_>,
        water: &OpenWater,
        path: [[f64; 3]; 2],
        is_up_known: bool,
        site: &Site,
    ) -> Self {
        let options = ShelterOptions {
            cell: CELL_WIDTH_M,
            most_cells: MOST_CELLS,
            focus: Some((path, PATH_REACH_M)),
            margin: 0.1,
            ..ShelterOptions::default()
        };
        let occluders = Occluders::of(&scan.splats, site, &options);
        let (grid, _) = GroundGrid::new(scan, &occluders, None);
        let (mut floor, mut top) = grid.floor();
        let places = grid.places.heightless();
        // A scene of which nothing is near the path has no cell.
        let columns = places.size()[0].max(1);
        let cell = places.cell() as f32;
        let mut open = vec![f32::NAN; floor.len()];
        for (at, (height, open)) in floor.iter_mut().zip(&mut open).enumerate() {
            let middle = places.middle(at);
            if height.is_finite() {
                if !water.covers(places.point(middle, f64::from(*height))) {
                    continue;
                }
                *height = f32::NAN;
            }
            *open = water.above(places.point(middle, 0.0)).map_or(f32::NAN, |above| above as f32);
        }
        keep_grounds(&mut floor, &top, columns, cell);
        let tilt = if is_up_known { [0.0; 2] } else { tilt_of(&floor, columns, f64::from(cell)) };
        for heights in [&mut floor, &mut top, &mut open] {
            for (at, height) in heights.iter_mut().enumerate() {
                *height -= tilted(tilt, places.middle(at)) as f32;
            }
        }
        let ground = smoothed(&floor, &top, columns, cell);
        let bumps = map(ground.len(), |at| {
            let [x, y] = places.middle(at).map(|v| v * f64::from(cell));
            relief(x, y) as f32
        });
        let beyond = |at: usize| {
            let lowest = neighbours(at, columns, ground.len()).map(|next| ground[next]);
            let lowest = lowest.filter(|height| height.is_finite()).fold(f32::INFINITY, f32::min);
            if top[at] > lowest + MIN_OBJECT_HEIGHT_M { EdgeRule::Wall } else { EdgeRule::Outlet }
        };
        let slope = |cells: &[u32]| mean_slope(&ground, cells, columns, cell);
        let counts = |cells: &[u32], depth: f32| {
            (MIN_PUDDLE_DEPTH_M..MAX_PUDDLE_DEPTH_M).contains(&depth)
                && cells.len() as f64 * f64::from(cell * cell) > MIN_PUDDLE_AREA_M2
                && slope(cells) < MAX_PUDDLE_SLOPE
        };
        let basins = Basins::find(&ground, &bumps, columns, f64::from(cell), beyond, counts);
        let rough = ground.iter().zip(&bumps).map(|(height, bump)| height + bump).collect();
        let seen = seen_about(&top, columns, cell);
        let eaves = eaves(&top, &ground, columns, cell);
        let matte = vec![0.0; ground.len()];
        Self { places, tilt, ground, rough, basins, open, eaves, seen, matte }
    }

    /// The height of open water over a cell, or of the `ground` there if there is none, m.
    pub(crate) fn surface(&self, at: usize, ground: f32) -> f32 {
        let open = self.open[at];
        if open.is_finite() { open } else { ground }
    }

    /// The point (world, scene units) at a place in columns and rows from the first corner, and a
    /// height above the tilt, m.
    pub(crate) fn point(&self, place: [f64; 2], height: f64) -> [f64; 3] {
        self.places.point(place, height + tilted(self.tilt, place))
    }

    /// Columns and rows of a point (world, scene units) from the first corner, and its height above
    /// the tilt, m.
    pub(crate) fn locate(&self, point: [f64; 3]) -> ([f64; 2], f64) {
        let (place, height) = self.places.locate(point);
        (place, height - tilted(self.tilt, place))
    }

    /// The share of the ground that is lower than a point (world, scene units), by the unevenness
    /// that no photo shows, 0-1.
    pub(super) fn lower_share(&self, point: [f64; 3]) -> f32 {
        let ([x, y], _) = self.locate(point);
        relief::lower_share(relief(x * self.places.cell(), y * self.places.cell()))
    }

    /// Finds which cells are lawn or soil, by the mean reflectance of points (world, scene units)
    /// that lie on the ground, each with its weight.
    pub(super) fn find_matte(&mut self, points: impl Iterator<Item = ([f32; 3], f32, [f32; 3])>) {
        let [columns, _] = self.places.size();
        let mut sums = vec![[0.0f32; 3]; self.ground.len()];
        for (point, weight, albedo) in points {
            let (place, height) = self.locate(point.map(f64::from));
            let cell = self.places.cell_at(place);
            if let Some(at) = cell.filter(|at| (height as f32 - self.ground[*at]).abs() < ON_GROUND) {
                (0..3).for_each(|k| sums[at][k] += weight * albedo[k]);
            }
        }
        let of_cell = |at: usize| {
            let mut mean = sums[at];
            for near in neighbours(at, columns, sums.len()) {
                (0..3).for_each(|k| mean[k] += sums[near][k]);
            }
            matte_share(mean)
        };
        self.matte = (0..sums.len()).map(of_cell).collect();
    }

    /// Depth of a point (world, scene units) below the ground, m; 0 above it, where there is none,
    /// and deeper than [`SEEN_DEPTH_M`]. What a rough capture has below its ground shows through
    /// it, and gets the rain that the ground gets.
    pub(super) fn depth_below(&self, point: [f32; 3]) -> f32 {
        let (place, height) = self.locate(point.map(f64::from));
        let depth = self.places.cell_at(place).map(|at| self.ground[at] - height as f32);
        depth.filter(|depth| (0.0..SEEN_DEPTH_M).contains(depth)).unwrap_or(0.0)
    }

    /// The middle of a cell at the height of its ground (world, scene units); `None` where there is
    /// none.
    #[must_use]
    pub fn middle(&self, cell: usize) -> Option<[f64; 3]> {
        let height = self.ground[cell];
        height.is_finite().then(|| self.point(self.places.middle(cell), f64::from(height)))
    }

    /// The height of the tilt at the middle of a cell, m.
    pub(crate) fn tilt_at(&self, cell: usize) -> f32 {
        tilted(self.tilt, self.places.middle(cell)) as f32
    }

    /// The basin at a place (columns, rows), and the height of the ground there with its relief, m;
    /// `None` where there is none.
    pub(super) fn basin_at(&self, point: [f64; 2]) -> Option<(u32, f32)> {
        let [x, y] = point;
        let [columns, rows] = self.places.size();
        let [i, j] = [x - 0.5, y - 0.5].map(f64::floor);
        let is_in = i >= 0.0 && j >= 0.0 && i + 1.0 < columns as f64 && j + 1.0 < rows as f64;
        if !is_in {
            return None;
        }
        let first = j as usize * columns + i as usize;
        let corners = [first, first + 1, first + columns, first + columns + 1];
        let basin = corners.map(|at| self.basins.of[at]).into_iter().find(|basin| *basin != NO_BASIN)?;
        let [u, v] = [x - 0.5 - i, y - 0.5 - j].map(|t| t as f32);
        let weights = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v];
        let (mut sum, mut weight) = (0.0, 0.0);
        for (at, share) in corners.into_iter().zip(weights) {
            if self.ground[at].is_finite() {
                sum += share * self.ground[at];
                weight += share;
            }
        }
        let bump = relief(x * self.places.cell(), y * self.places.cell()) as f32;
        (weight > 0.0).then(|| (basin, sum / weight + bump))
    }
}

/// The share of ground of this colour, linear RGB of any brightness, that counts as lawn or soil:
/// they have little blue, but less red than bricks.
fn matte_share(rgb: [f32; 3]) -> f32 {
    let [red, green, blue] = rgb;
    let fall = |value: f32, [full, none]: [f32; 2]| ((none - value) / (none - full)).clamp(0.0, 1.0);
    if green > 0.0 { fall(blue / green, MATTE_BLUE) * fall(red / green, MATTE_RED) } else { 0.0 }
}

/// The height of a tilt at a place in columns and rows, m.
fn tilted(tilt: [f64; 2], place: [f64; 2]) -> f64 {
    tilt[0] * place[0] + tilt[1] * place[1]
}

/// The slope of the plane that most of the ground lies in, m a cell; 0 where that is too steep for
/// an error of up.
fn tilt_of(floor: &[f32], columns: usize, cell: f64) -> [f64; 2] {
    let (mut tilt, mut off) = ([0.0; 2], 0.0);
    for trim in [f64::INFINITY, 0.4, 0.2, 0.15, 0.15] {
        let mut fit = PlaneFit::default();
        for at in (0..floor.len()).step_by(3).filter(|at| floor[*at].is_finite()) {
            let (place, z) = ([at % columns, at / columns].map(|v| v as f64 + 0.5), f64::from(floor[at]));
            if (z - tilted(tilt, place) - off).abs() <= trim {
                fit.add(place, z);
            }
        }
        let Some(Plane { slopes, mean: [x, y, z], .. }) = fit.plane(100.0, 1e-6) else { return [0.0; 2] };
        tilt = slopes;
        off = z - tilted(tilt, [x, y]);
    }
    if tilt[0].hypot(tilt[1]) < MAX_TILT_SLOPE * cell { tilt } else { [0.0; 2] }
}

/// Leaves connected level ground alone: what is small, or drops off along its edge, is the top of
/// something.
fn keep_grounds(floor: &mut [f32], top: &[f32], columns: usize, cell: f32) {
    let step = MIN_STEP_M.max(MAX_STEP_SLOPE * cell);
    let mut is_seen = vec![false; floor.len()];
    for first in 0..floor.len() {
        if is_seen[first] || floor[first].is_nan() {
            continue;
        }
        let (mut cells, mut at) = (vec![first], 0);
        let (mut edge, mut drops) = (0.0f32, 0.0f32);
        is_seen[first] = true;
        while let Some(current) = cells.get(at).copied() {
            at += 1;
            for next in neighbours(current, columns, floor.len()) {
                if floor[next].is_finite() && (floor[next] - floor[current]).abs() < step {
                    if !is_seen[next] {
                        is_seen[next] = true;
                        cells.push(next);
                    }
                } else if top[next].is_finite() {
                    edge += 1.0;
                    drops += if top[next] < floor[current] - DROP_HEIGHT_M { 1.0 } else { 0.0 };
                }
            }
        }
        let area = cells.len() as f64 * f64::from(cell * cell);
        if area < MIN_GROUND_AREA_M2 || drops > MIN_DROPPING_EDGE_SHARE * edge {
            cells.iter().for_each(|at| floor[*at] = f32::NAN);
        }
    }
}

/// The ground smoothed, with its gaps closed where nothing stands in them.
fn smoothed(floor: &[f32], top: &[f32], columns: usize, cell: f32) -> Vec<f32> {
    let rows = floor.len() / columns;
    let reach = (2.0 * SMOOTHING_SIGMA_M / cell).ceil() as i64;
    let weights: Vec<f32> =
        (-reach..=reach).map(|k| (-0.5 * (k as f32 * cell / SMOOTHING_SIGMA_M).powi(2)).exp()).collect();
    let all: f32 = weights.iter().sum();
    // Heights and weights along rows, then along columns.
    let mixed = |place: usize, count: usize, value: &dyn Fn(usize) -> [f32; 2]| {
        let (mut sum, mut weight) = (0.0, 0.0);
        for (k, share) in weights.iter().enumerate() {
            let other = place as i64 + k as i64 - reach;
            if other >= 0 && other < count as i64 {
                let [height, part] = value(other as usize);
                sum += share * height;
                weight += share * part;
            }
        }
        [sum, weight]
    };
    let known = |height: f32| if height.is_finite() { [height, 1.0] } else { [0.0; 2] };
    let first = map(floor.len(), |at| {
        let (x, y) = (at % columns, at / columns);
        mixed(x, columns, &|x| known(floor[y * columns + x]))
    });
    map(floor.len(), |at| {
        let (x, y) = (at % columns, at / columns);
        let [sum, weight] = mixed(y, rows, &|y| first[y * columns + x]);
        let height = sum / weight;
        let is_gap = floor[at].is_nan();
        let stands = top[at] > height + MIN_OBJECT_HEIGHT_M;
        if weight <= 0.0 || is_gap && (stands || weight < MIN_GAP_GROUND_SHARE * all * all) {
            f32::NAN
        } else {
            height
        }
    })
}

/// The share of known cells about each cell, from 0 at a half of them to 1 at all; less towards the
/// border of the grid.
fn seen_about(top: &[f32], columns: usize, cell: f32) -> Vec<f32> {
    let rows = top.len() / columns;
    let reach = (END_FADE_DISTANCE_M / cell).ceil() as usize;
    let about = |i: usize, count: usize| i.saturating_sub(reach)..(i + reach + 1).min(count);
    let along: Vec<u32> = (0..top.len())
        .map(|at| {
            let (x, y) = (at % columns, at / columns);
            about(x, columns).filter(|x| top[y * columns + x].is_finite()).count() as u32
        })
        .collect();
    let all = (2 * reach + 1).pow(2) as f32;
    // A grid that is smaller ends with the scene.
    let is_cut = |count: usize| count as f32 * cell > 1.9 * PATH_REACH_M as f32;
    let inside = |i: usize, count: usize| {
        if is_cut(count) {
            (i.min(count - 1 - i) as f32 * cell / BORDER_FADE_DISTANCE_M).min(1.0)
        } else {
            1.0
        }
    };
    let share = |at: usize| {
        let (x, y) = (at % columns, at / columns);
        let known: u32 = about(y, rows).map(|y| along[y * columns + x]).sum();
        let inward = inside(x, columns).min(inside(y, rows));
        let inward = inward * inward * (3.0 - 2.0 * inward);
        (2.0 * known as f32 / all - 1.0).clamp(0.0, 1.0) * inward
    };
    (0..top.len()).map(share).collect()
}

/// The slope of the plane through the ground about some cells, farther than their own depression.
fn mean_slope(ground: &[f32], cells: &[u32], columns: usize, cell: f32) -> f32 {
    let margin = (SLOPE_OVER / f64::from(cell)).ceil() as usize;
    let rows = ground.len() / columns;
    let xs = cells.iter().map(|at| *at as usize % columns);
    let ys = cells.iter().map(|at| *at as usize / columns);
    let span = |values: &mut dyn Iterator<Item = usize>, most: usize| {
        let (mut low, mut high) = (usize::MAX, 0);
        values.for_each(|v| (low, high) = (low.min(v), high.max(v)));
        low.saturating_sub(margin)..(high + margin + 1).min(most)
    };
    let (xs, ys) = (span(&mut xs.into_iter(), columns), span(&mut ys.into_iter(), rows));
    let mut fit = PlaneFit::default();
    for y in ys.step_by(2) {
        for x in xs.clone().step_by(2) {
            let height = f64::from(ground[y * columns + x]);
            if height.is_finite() {
                fit.add([x, y].map(|v| v as f64 * f64::from(cell)), height);
            }
        }
    }
    fit.plane(3.0, 1e-9).map_or(f32::INFINITY, |plane| plane.slopes[0].hypot(plane.slopes[1]) as f32)
}
