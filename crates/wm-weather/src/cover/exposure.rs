//! The share of the fall that each node gets, by its direction and by the wind along the ground.
//!
//! # The fall
//! The fall that reaches a node, as a share of what falls on open level ground: the mean over
//! several directions about that of the fall of whether anything is in the way ([`Shelter`]), since
//! flakes do not all come the same way, the less the more the wind blows; and more where a slope
//! faces the wind: `1 - grad h . v`, with v the slope of the fall.
//!
//! # The wind
//! From a threshold on the wind takes snow up and carries it along the ground. A carried amount
//! goes over the nodes with the wind: it takes more from crests and windward slopes, and leaves
//! more in lee slopes and in the shadow of edges, behind which the air is still for some four times
//! their height (15 degrees, as in Werner's model of dunes, 1995). On a plain it leaves what it
//! takes.

use super::airflow::Airflow;
use super::ground::{GroundGrid, SLIDING_SLOPES};
use crate::level::{from_level, level_axes, to_level};
use crate::optics::Site;
use crate::shelter::{FloaterMap, FloaterRule, Occluders, Shelter, ShelterOptions};
use crate::threads::map;

/// Spread of flakes about their mean direction, as a slope: in still air, and for each 1 of slope
/// by wind.
const FLAKE_SPREAD_SLOPES: [f64; 2] = [0.22, 0.3];
/// Directions on a circle about the mean one: for the narrowest cells, which show soft edges, and
/// for others.
const CIRCLE_DIRECTION_COUNTS: [usize; 2] = [6, 4];
/// Width of the cells in which obstacles are looked for, in those of the grid, on all rings but the
/// innermost.
const OBSTACLE_CELL_RATIO: f64 = 2.0;
/// Height above a node from which obstacles are looked for, m.
const OBSTACLE_HEIGHT_M: f64 = 0.06;
/// Largest deposit on a slope that faces the wind, as a share of that on level ground.
const MAX_DEPOSIT: f32 = 2.5;
/// Lengths over which the wind lets go of what it carries: in the open, and out of the wind.
const WIND_RELEASE_LENGTHS_M: [f32; 2] = [5.0, 1.5];
/// Tangent of the angle below which it is out of the wind behind an edge.
const LEE_SLOPE: f32 = 0.268;
/// Depth below that line at which a node is out of the wind, m.
const LEE_DEPTH_M: f32 = 0.04;
/// Share of what the wind carries that stays at the foot of what stands in its way.
const WINDWARD_FOOT_SHARE: f32 = 0.1;
/// Most that the wind gathers, as a share of the fall.
const MAX_DRIFT_SHARE: f32 = 4.0;

/// The directions in which flakes fall, world axes: on the innermost ground, or on one about it.
fn falls(site: &Site, airflow: &Airflow, is_outer: bool) -> Vec<[f64; 3]> {
    let axes = level_axes(site.up);
    let [a, b] = airflow.slope;
    let count = CIRCLE_DIRECTION_COUNTS[usize::from(is_outer)];
    // Of equal variance as a normal spread.
    let reach = (FLAKE_SPREAD_SLOPES[0] + FLAKE_SPREAD_SLOPES[1] * a.hypot(b))
        * (2.0 * (count + 1) as f64 / count as f64).sqrt();
    let circle = (0..count).map(|k| {
        let (sin, cos) = (std::f64::consts::TAU * (k as f64 + 0.5) / count as f64).sin_cos();
        [a + reach * cos, b + reach * sin]
    });
    circle.chain([[a, b]]).map(|way| from_level(&axes, [way[0], way[1], -1.0])).collect()
}

/// The maps of the directions in which flakes fall on each ground, from the inside out, by
/// `occluders` with the options of each and by what floats over it.
pub(super) fn maps(
    occluders: &Occluders,
    rings: &[(ShelterOptions, FloaterMap)],
    site: &Site,
    airflow: &Airflow,
) -> Vec<Vec<Shelter>> {
    let mut standing: Vec<Occluders> = Vec::new();
    for (options, floaters) in rings {
        let options = ShelterOptions { floaters: FloaterRule::Stop, ..*options };
        // The mean over directions is soft: far off its edges need no narrow cells, and no narrow
        // occluders.
        let next = match standing.last() {
            None => occluders.without(floaters).mapped(&options),
            Some(inner) => inner.without(floaters).mapped(&options).softened(OBSTACLE_CELL_RATIO),
        };
        standing.push(next);
    }
    let ways = |ring: usize| falls(site, airflow, ring > 0);
    let jobs: Vec<(usize, [f64; 3])> =
        (0..rings.len()).flat_map(|ring| ways(ring).into_iter().map(move |fall| (ring, fall))).collect();
    // Side by side, since parts of each are serial.
    let made = map(jobs.len(), |job| standing[jobs[job].0].shelter(jobs[job].1));
    let mut made = made.into_iter();
    (0..rings.len()).map(|ring| made.by_ref().take(ways(ring).len()).collect()).collect()
}

impl GroundGrid {
    /// Finds the share of the fall that each node gets, by the maps of the directions in which
    /// flakes fall.
    pub(super) fn find_shares(&mut self, maps: &[Shelter], site: &Site, airflow: &Airflow) {
        let nodes = self.len();
        let grid = self.places.axes();
        let points: Vec<[f32; 3]> = map(nodes, |node| {
            self.places
                .point(self.middle(node), f64::from(self.height[node]) + OBSTACLE_HEIGHT_M)
                .map(|v| v as f32)
        });
        let maps: Vec<(&Shelter, [f32; 3])> =
            maps.iter().map(|map| (map, to_level(&grid, map.fall()).map(|v| v as f32))).collect();
        let each = 1.0 / maps.len() as f32;
        let reached = map(nodes, |node| {
            let (mut open, mut share) = (0.0, 0.0);
            for (shelter, wind) in &maps {
                if shelter.is_exposed(points[node]) {
                    let facing = 1.0 - self.slope[node][0] * wind[0] - self.slope[node][1] * wind[1];
                    open += each;
                    share += each * facing.clamp(0.0, MAX_DEPOSIT);
                }
            }
            (open, share)
        });
        (self.open, self.share) = reached.into_iter().unzip();
        for node in 0..nodes {
            let stays = self.share[node] * self.kept(node);
            self.count_loss(node, self.share[node] - stays);
            self.share[node] = stays;
        }
        let (axes, [a, b]) = (level_axes(site.up), airflow.slope);
        let along = to_level(&grid, from_level(&axes, [a, b, 0.0]));
        if airflow.moved > 0.0 && a.hypot(b) > 1e-6 {
            self.drift_snow([along[0], along[1]].map(|v| v as f32), airflow.moved as f32);
        }
        self.soften();
        for node in 0..nodes {
            if self.is_elsewhere(node) {
                self.share[node] = 0.0;
            }
        }
    }

    /// Returns the share of the fall on a node that stays there at first by its slope, 0-1.
    fn kept(&self, node: usize) -> f32 {
        let [a, b] = self.slope[node];
        ((SLIDING_SLOPES[1] - a.hypot(b)) / (SLIDING_SLOPES[1] - SLIDING_SLOPES[0])).clamp(0.0, 1.0)
    }

    /// Softens the edges of what is sheltered, over the nodes beside each other.
    fn soften(&mut self) {
        for _ in 0..2 {
            self.share = map(self.len(), |node| {
                if self.is_steep(node) {
                    return self.share[node];
                }
                let of = |other| (!self.is_steep(other)).then(|| [self.share[other]]);
                let [share] = self.mean_about(node, of);
                share
            });
        }
    }

    /// Carries snow along the ground with the wind, which blows along `wind` (columns, rows).
    fn drift_snow(&mut self, wind: [f32; 2], moved: f32) {
        let main = usize::from(wind[1].abs() > wind[0].abs());
        let length = wind[0].hypot(wind[1]);
        let unit = wind.map(|v| v / length);
        let (step, aside) = (unit[main].signum() as i64, unit[1 - main] / unit[main].abs());
        let way = |off: i64| if main == 0 { [step, off] } else { [off, step] };
        let gale = WindField {
            ways: [(way(0), 1.0 - aside.abs()), (way(aside.signum() as i64), aside.abs())],
            unit,
            moved,
            fallen_by: LEE_SLOPE * self.cell / unit[main].abs(),
            lets_go: WIND_RELEASE_LENGTHS_M.map(|length| 1.0 - (-self.cell / length).exp()),
        };
        let mut carried = vec![0.0f32; self.len()];
        let mut line = vec![f32::NEG_INFINITY; self.len()];
        let [lines, across] = [self.size[main], self.size[1 - main]];
        for k in 0..lines {
            let k = if step > 0 { k } else { lines - 1 - k };
            for other in 0..across {
                let cell = if main == 0 { other * self.size[0] + k } else { k * self.size[0] + other };
                for node in self.nodes_of(cell) {
                    self.deposit_or_pass_on(node, &gale, &mut carried, &mut line);
                }
            }
        }
    }

    /// Deposits what the wind brings to each node, or passes it on: `carried` is on its way to each
    /// node, and below `line` (m) the air is still.
    fn deposit_or_pass_on(&mut self, node: usize, gale: &WindField, carried: &mut [f32], line: &mut [f32]) {
        let [column, row] = self.place(node);
        let (height, is_still) = (self.height[node], line[node] > self.height[node] + LEE_DEPTH_M);
        // From beyond the grid comes what a plain would give.
        let plain = gale.moved / gale.lets_go[0];
        for ([x, y], share) in gale.ways {
            let source = self.cell_of(column - x, row - y);
            if source.is_none_or(|cell| self.nodes_of(cell).is_empty()) && self.open[node] > 0.0 {
                carried[node] += share * plain;
                self.count_loss(node, -share * plain);
            }
        }
        let mut on_its_way = carried[node];
        if !self.is_steep(node) {
            let takes = if is_still {
                0.0
            } else {
                // Windward slopes lose, lee slopes gain.
                let rise = self.slope[node][0] * gale.unit[0] + self.slope[node][1] * gale.unit[1];
                gale.moved * self.share[node] * (1.0 + 1.5 * rise).clamp(0.2, 1.6)
            };
            let leaves = on_its_way * gale.lets_go[usize::from(is_still)];
            let leaves = leaves.min((MAX_DRIFT_SHARE - self.share[node]).max(0.0) + takes);
            let takes = takes.min(self.share[node]);
            self.share[node] += leaves - takes;
            on_its_way += takes - leaves;
        }
        let top = if is_still { line[node] } else { height } - gale.fallen_by;
        for ([x, y], share) in gale.ways {
            let goes = share * on_its_way;
            let nodes = self.cell_of(column + x, row + y).map(|cell| self.nodes_of(cell));
            let Some(upper) = nodes.clone().and_then(|mut nodes| nodes.next()) else {
                self.count_loss(node, goes);
                continue;
            };
            let level = self.level_with(node, column + x, row + y, self.edge);
            let is_lower = |to: &usize| self.height[*to] < height && self.open[*to] > 0.0;
            let on = level.or_else(|| nodes?.find(is_lower));
            // Where something stands in the way some stays, and most goes over it.
            let stays = if on.is_none() && !self.is_steep(node) { WINDWARD_FOOT_SHARE * goes } else { 0.0 };
            self.share[node] += stays;
            let to = on.unwrap_or(upper);
            carried[to] += goes - stays;
            line[to] = line[to].max(top);
        }
    }

    /// Counts what does not stay where it falls, or is carried off the grid, as a share of the fall
    /// on a cell.
    fn count_loss(&mut self, node: usize, amount: f32) {
        if !self.is_elsewhere(node) {
            self.shed += f64::from(amount);
        }
    }
}

/// The wind over the grid, line by line.
struct WindField {
    /// Steps to the next line straight on and a cell aside, each with its share, so that the mean
    /// goes with the wind.
    ways: [([i64; 2], f32); 2],
    /// Direction along columns and rows, length 1.
    unit: [f32; 2],
    /// Share of what falls that it carries.
    moved: f32,
    /// Drop, m, from one line of cells to the next of the line below which the air is still.
    fallen_by: f32,
    /// Share that it lets go of in a cell, in the open and out of the wind.
    lets_go: [f32; 2],
}
