//! The surfaces that snow can lie on, over a level grid.
//!
//! Layers of a level grid ([`HeightLayers`]): the first surface from above, and those below it. A
//! *node* is a surface in a cell. Its slope is that of a plane through the nodes about it which no
//! edge parts from it. A node whose neighbours are partly far above and partly far below is a piece
//! of a wall and holds nothing; one whose neighbours are all below is the top of something narrow.

mod shape;

use super::airflow::Airflow;
use crate::fused_surfaces::FusedSurfaces;
use crate::optics::Site;
use crate::shelter::{FloaterMap, HeightLayers, Occluders, Shelter, ShelterOptions};
use crate::threads::map;
use crate::wetness::{lower_share, relief};
use serde::{Deserialize, Serialize};
use wm_scene::{Group, Splats};

/// Width of the cells of [`FarFloor`], m, and the most of them.
const FAR_CELL: f64 = 0.4;
const FAR_CELLS: usize = 350_000;
/// Height above and below it within which a surface belongs to it, m.
const ON_FLOOR: f32 = 0.15;
/// Surfaces below each other that are looked for, and how far apart they are at least, m and cells:
/// more than an edge.
const MAX_LAYER_COUNT: usize = 3;
const MIN_LAYER_GAP_M: f64 = 0.525;
const MIN_LAYER_GAP_CELLS: f64 = 1.8;
/// Height from which a step to the side is an edge and no slope, m, but so many cells at least.
const EDGE_HEIGHT_M: f32 = 0.35;
const EDGE_HEIGHT_CELLS: f32 = 1.2;
/// Roughness of splats that is taken off, m, but so many cells at least.
const ROUGHNESS_M: f32 = 0.1;
const ROUGHNESS_CELLS: f32 = 0.4;
/// Slopes over which less and less stays at once, as tangents: 50 and 60 degrees.
pub(super) const SLIDING_SLOPES: [f32; 2] = [1.19, 1.73];
const MAX_LEVEL_SLOPE: f32 = 0.4;
/// Slope that a piece of a wall counts with.
const WALL_SLOPE: [f32; 2] = [2.0 * SLIDING_SLOPES[1], 0.0];
/// Half the width of the field that a slope is taken from.
const FIELD_RADIUS_CELLS: i64 = 2;
/// Rounds in which slopes are smoothed with their neighbours.
const SMOOTHING_ROUND_COUNT: usize = 8;
/// Share of a field that must belong to a surface; to one whose splats stand upright, whose normals
/// have a smaller cosine to up; and to one whose splats do not.
const SURFACE_FIELD_SHARE: f32 = 0.3;
const LEDGE_FIELD_SHARE: f32 = 0.7;
const CROWN_FIELD_SHARE: f32 = 0.1;
const UPRIGHT_COSINE: f32 = 0.4;
/// Largest area of a lump on a wall, m^2, but so many cells at least; and the share of it beside
/// which something stands higher.
const LEDGE_AREA: f32 = 1.0;
const LEDGE_CELLS: f32 = 6.0;
const LEDGE_BELOW: f32 = 0.5;
/// Cosine of the normal below which only the underside has been seen: the top is not known.
const UNDERSIDE_COSINE: f32 = -0.25;
/// Cosine of the normal below which a surface that a camera saw is too steep: 60 degrees.
const STEEP_SEEN: f32 = 0.5;
/// Least cosine between up and the normal of a surface that no camera saw, and the share of a field
/// that must belong to it.
const LEVEL_UNSEEN: f32 = 0.7;
const UNSEEN_FIELD_SHARE: f32 = 0.9;
/// Distance, cells, and directions in which higher surfaces are looked for.
const LEDGE_DISTANCES_CELLS: [i64; 4] = [1, 2, 4, 8];
const WAYS_ROUND: [[i64; 2]; 8] = [[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1]];
/// Distance to which a plain goes on about each of its nodes, m, but one cell at least.
const PLAIN_REACH_M: f32 = 0.5;
/// Distances and the drop by which crowns stand over what is about them, m, and of the directions
/// of [`WAYS_ROUND`] in which they do the number from which a surface is that of leaves, with the
/// cosine between up and the normals of its splats below which it is.
const ABOUT_CROWN: [f32; 4] = [0.5, 1.0, 2.0, 3.0];
const CROWN_STANDS: f32 = 0.5;
const CROWN_RINGS: [(usize, f32); 2] = [(3, 0.6), (5, 0.85)];
/// Least standard deviation of the cosine between up and the normals of leaves. It is 0.29 where
/// they point everywhere; on both sides of a roof the cosine is the same.
const LEAVES_SPREAD: f32 = 0.15;
/// Deepest that lies on leaves, m, and the shares of them that hold nothing and that hold all: snow
/// lies on crowns in clumps.
const ON_LEAVES: f32 = 0.08;
const CLUMP_SHARES: [f32; 2] = [0.25, 0.45];
/// Mean flatness of splats from which that counts: 0 for balls to 1.
const MIN_FLATNESS: f32 = 0.3;
/// Distance from a surface within which splats belong to it, m, but so many cells at least.
const SURFACE_THICKNESS_M: f32 = 0.12;
const OWN_CELLS: f32 = 0.3;
/// The four ways from a cell.
pub(super) const NEIGHBOUR_STEPS: [[i64; 2]; 4] = [[1, 0], [0, 1], [-1, 0], [0, -1]];
/// Splats that one thread takes at once.
const CHUNK_SPLAT_COUNT: usize = 1 << 12;
/// No node.
const NO_NODE: u32 = u32::MAX;

/// Nodes, cell by cell in rows, the uppermost of a cell first.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct GroundGrid {
    pub(crate) places: HeightLayers,
    /// Columns and rows.
    pub(crate) size: [usize; 2],
    /// Width of a cell, m.
    pub(crate) cell: f32,
    /// Height from which a step to the side is an edge and no slope, m.
    pub(super) edge: f32,
    /// The first node of each cell, and behind the last cell their number.
    start: Vec<u32>,
    cells: Vec<u32>,
    /// m.
    pub(crate) height: Vec<f32>,
    /// The plane through each node: its slope along columns and rows.
    pub(crate) slope: Vec<[f32; 2]>,
    /// Share of the fall that reaches it and stays at first, 0 and more.
    pub(crate) share: Vec<f32>,
    /// Share of the sky that it sees, 0-1.
    pub(crate) open: Vec<f32>,
    /// Light, 0 in the shade to 1 in the open.
    pub(crate) shade: Vec<f32>,
    /// Mean cosine of the splats' normals with up; NaN where none is known.
    pub(super) facing: Vec<f32>,
    /// True if that is known from a camera, and if any node's is.
    is_seen: Vec<bool>,
    is_scan: bool,
    /// Amount that does not stay since the ground is too steep, or that is blown off the grid: a
    /// share of the fall on one cell.
    pub(crate) shed: f64,
    /// Nodes along [`NEIGHBOUR_STEPS`] on which the node's surface goes on.
    beside: Vec<[u32; 4]>,
    /// The next nodes of the surface along [`NEIGHBOUR_STEPS`], or the nodes on which lands what
    /// falls over its edge.
    next: Vec<[u32; 4]>,
    /// True for nodes that an inner ground covers too.
    is_inner: Vec<bool>,
    /// True for nodes about which nothing stands higher and nothing drops off.
    is_plain: Vec<bool>,
    /// Share of what leaves of crowns can hold that they do hold, 0-1; NaN where there are none.
    clumps: Vec<f32>,
}

/// Level surfaces of a whole scene, on a coarse grid.
pub(crate) struct FarFloor {
    places: HeightLayers,
    /// m; not a number where there is none.
    floor: Vec<f32>,
}

impl FarFloor {
    /// Finds the level surfaces of a scene.
    pub(crate) fn new(scan: &FusedSurfaces<'_>, site: &Site) -> Self {
        let options = ShelterOptions { cell: FAR_CELL, most_cells: FAR_CELLS, ..ShelterOptions::default() };
        let occluders = Occluders::of(&scan.splats, site, &options);
        let (grid, _) = GroundGrid::new(scan, &occluders, None);
        Self { places: grid.places.heightless(), floor: grid.floor().0 }
    }

    /// Returns true if a point (world, scene units) lies in the level surface of its cell, as rough
    /// as that is captured.
    pub(crate) fn holds(&self, point: [f64; 3]) -> bool {
        self.height(point).is_some_and(|above| above.abs() < ON_FLOOR)
    }

    /// Returns the height of a point (world, scene units) above the level surface in its cell, m.
    fn height(&self, point: [f64; 3]) -> Option<f32> {
        let (place, height) = self.places.locate(point);
        let floor = self.floor[self.places.cell_at(place)?];
        floor.is_finite().then_some(height as f32 - floor)
    }
}

impl GroundGrid {
    /// Returns true if its parts fit each other and a scene of `splats` splats.
    pub(super) fn is_consistent(&self, splats: usize) -> bool {
        let nodes = self.height.len();
        let Some(cells) = self.size[0].checked_mul(self.size[1]) else { return false };
        let is_node = |other: &u32| *other == NO_NODE || (*other as usize) < nodes;
        let lengths = [
            self.cells.len(),
            self.slope.len(),
            self.share.len(),
            self.open.len(),
            self.shade.len(),
            self.facing.len(),
            self.clumps.len(),
        ];
        let flags = [
            self.is_seen.len(),
            self.is_inner.len(),
            self.is_plain.len(),
            self.beside.len(),
            self.next.len(),
        ];
        let numbers = [&self.height, &self.share, &self.open, &self.shade];
        self.places.is_consistent(splats)
            && self.start.len() == cells + 1
            && self.start.is_sorted()
            && self.start.last().is_some_and(|last| *last as usize == nodes)
            && lengths.into_iter().chain(flags).all(|length| length == nodes)
            && self.cells.iter().all(|cell| (*cell as usize) < cells)
            && [&self.beside, &self.next].iter().all(|ways| ways.as_flattened().iter().all(is_node))
            && numbers.into_iter().flatten().chain(self.slope.as_flattened()).all(|number| number.is_finite())
            && self.cell > 0.0
            && [self.cell, self.edge, self.shed as f32].into_iter().all(f32::is_finite)
    }

    /// The surfaces of a scene, without what reaches them. What lies on an `inner` ground is that
    /// one's. Returns what floats over it too.
    pub(crate) fn new(
        scan: &FusedSurfaces<'_>,
        occluders: &Occluders,
        inner: Option<&Self>,
    ) -> (Self, FloaterMap) {
        let (places, floaters) = occluders.layers(MAX_LAYER_COUNT, MIN_LAYER_GAP_M, MIN_LAYER_GAP_CELLS);
        let edge = EDGE_HEIGHT_M.max(EDGE_HEIGHT_CELLS * places.cell() as f32);
        let size = places.size();
        let (mut start, mut cells, mut height, mut of) = (vec![0], Vec::new(), Vec::new(), Vec::new());
        for cell in 0..size[0] * size[1] {
            let surfaces = places.heights.iter().zip(&places.splats);
            let surfaces = surfaces.map(|(heights, splats)| (heights[cell], splats[cell]));
            for (surface, splat) in surfaces.filter(|(surface, _)| surface.is_finite()) {
                cells.push(cell as u32);
                height.push(surface);
                of.push(splat as usize);
            }
            start.push(cells.len() as u32);
        }
        let nodes = height.len();
        let mut ground = Self {
            size,
            cell: places.cell() as f32,
            edge,
            start,
            cells,
            height,
            slope: vec![[0.0; 2]; nodes],
            share: Vec::new(),
            open: Vec::new(),
            shade: Vec::new(),
            facing: Vec::new(),
            is_seen: of.iter().map(|splat| *splat < scan.oriented).collect(),
            is_scan: scan.oriented > 0,
            shed: 0.0,
            beside: Vec::new(),
            next: Vec::new(),
            is_inner: Vec::new(),
            is_plain: Vec::new(),
            clumps: Vec::new(),
            places,
        };
        // The whole cell: of one that reaches over the end of the inner ground the rest would be
        // bare.
        let is_inner = |node: usize| {
            let corner = |k: i64| {
                let [column, row] = ground.place(node);
                ground.places.point([(column + k % 2) as f64, (row + k / 2) as f64], 0.0)
            };
            let holds = |inner: &Self, k| inner.places.cell_at(inner.places.locate(corner(k)).0).is_some();
            inner.is_some_and(|inner| (0..4).all(|k| holds(inner, k)))
        };
        ground.is_inner = map(nodes, is_inner);
        ground.height = map(nodes, |node| ground.smooth(node));
        ground.beside = map(nodes, |node| {
            let [column, row] = ground.place(node);
            NEIGHBOUR_STEPS.map(|[x, y]| number(ground.level_with(node, column + x, row + y, edge)))
        });
        let (facing, spread) = ground.find_facing(scan, &of);
        ground.facing = facing;
        ground.slope = map(nodes, |node| ground.fit(node));
        for _ in 0..SMOOTHING_ROUND_COUNT {
            ground.slope = map(nodes, |node| match ground.slope[node] {
                WALL_SLOPE => WALL_SLOPE,
                _ => ground.mean_about(node, |other| Some(ground.slope[other])),
            });
        }
        if ground.is_scan {
            ground.clear_ledges();
        }
        ground.is_plain = map(nodes, |node| ground.lies_in_a_plain(node));
        ground.clumps = map(nodes, |node| ground.clump(node, spread[node]));
        (ground, floaters)
    }

    /// Finds what falls on each node, and what becomes of it by the wind, by slopes and in the
    /// shade.
    pub(super) fn expose(
        &mut self,
        scan: &FusedSurfaces<'_>,
        maps: &[Shelter],
        site: &Site,
        airflow: &Airflow,
    ) {
        self.find_shares(maps, site, airflow);
        self.next = map(self.len(), |node| {
            std::array::from_fn(|way| {
                number(self.beside(node)[way].or_else(|| self.below(node, way, self.height[node])))
            })
        });
        self.find_shades(&scan.splats);
    }

    /// The lowest level surface of each cell that cameras see (any, where no photos were given) and
    /// its top, m; not a number where there is none.
    pub(crate) fn floor(&self) -> (Vec<f32>, Vec<f32>) {
        let cells = self.size[0] * self.size[1];
        // Without photos normals say little.
        let is_floor = |node: &usize| match self.is_scan {
            true => self.is_seen[*node] && self.is_level(*node),
            false => self.slope[*node][0].hypot(self.slope[*node][1]) < MAX_LEVEL_SLOPE,
        };
        let height = |node: Option<usize>| node.map_or(f32::NAN, |node| self.height[node]);
        let floor = (0..cells).map(|cell| height(self.nodes_of(cell).rev().find(is_floor)));
        let top = (0..cells).map(|cell| height(self.nodes_of(cell).next()));
        (floor.collect(), top.collect())
    }

    /// Lets nothing lie on nodes at such places (world, scene units): it is shed.
    pub(super) fn keep_bare(&mut self, is_bare: impl Fn([f64; 3]) -> bool + Sync) {
        let bare = map(self.len(), |node| is_bare(self.point(node)));
        for node in (0..self.len()).filter(|node| bare[*node]) {
            if !self.is_elsewhere(node) {
                self.shed += f64::from(self.share[node]);
            }
            self.share[node] = 0.0;
        }
    }

    /// Number of nodes.
    pub(crate) fn len(&self) -> usize {
        self.height.len()
    }

    /// The nodes of a cell, the uppermost first.
    pub(super) fn nodes_of(&self, cell: usize) -> std::ops::Range<usize> {
        self.start[cell] as usize..self.start[cell + 1] as usize
    }

    /// The mean of a node's value and of those beside it; not a number where none of them has one.
    pub(super) fn mean_about<const N: usize>(
        &self,
        node: usize,
        value: impl Fn(usize) -> Option<[f32; N]>,
    ) -> [f32; N] {
        let near = self.beside(node).into_iter().flatten();
        let (mut sum, mut count) = ([0.0; N], 0.0);
        for value in [node].into_iter().chain(near).filter_map(value) {
            count += 1.0;
            sum.iter_mut().zip(value).for_each(|(sum, value)| *sum += value);
        }
        sum.map(|sum| sum / count)
    }

    /// The cell of a column and a row.
    pub(super) fn cell_of(&self, column: i64, row: i64) -> Option<usize> {
        let [columns, rows] = self.size.map(|v| v as i64);
        let is_in = column >= 0 && row >= 0 && column < columns && row < rows;
        is_in.then(|| (row * columns + column) as usize)
    }

    /// Column and row of a node.
    pub(super) fn place(&self, node: usize) -> [i64; 2] {
        let cell = self.cells[node] as usize;
        [(cell % self.size[0]) as i64, (cell / self.size[0]) as i64]
    }

    /// The middle of a node's cell in columns and rows.
    pub(super) fn middle(&self, node: usize) -> [f64; 2] {
        self.places.middle(self.cells[node] as usize)
    }

    /// The middle of a node, world, scene units.
    pub(super) fn point(&self, node: usize) -> [f64; 3] {
        self.places.point(self.middle(node), f64::from(self.height[node]))
    }

    /// Height of a node's surface at a place (columns, rows) in its cell, m.
    pub(super) fn height_at(&self, node: usize, point: [f64; 2]) -> f32 {
        let [x, y] = point;
        let ([column, row], [a, b]) = (self.place(node), self.slope[node]);
        if self.is_steep(node) {
            return self.height[node];
        }
        let off = [x - column as f64 - 0.5, y - row as f64 - 0.5].map(|v| v as f32 * self.cell);
        self.height[node] + a * off[0] + b * off[1]
    }

    /// The nodes beside it along [`NEIGHBOUR_STEPS`] on its surface: those that no edge parts from
    /// it.
    pub(super) fn beside(&self, node: usize) -> [Option<usize>; 4] {
        self.beside[node].map(|other| (other != NO_NODE).then_some(other as usize))
    }

    /// The neighbours of a node on its own surface; where that ends, the node below.
    pub(super) fn next(&self, node: usize) -> [Option<usize>; 4] {
        self.next[node].map(|other| (other != NO_NODE).then_some(other as usize))
    }

    /// The uppermost node of the next cell that is open to the sky and lies below a height, m.
    pub(super) fn below(&self, node: usize, way: usize, height: f32) -> Option<usize> {
        let ([column, row], [x, y]) = (self.place(node), NEIGHBOUR_STEPS[way]);
        let is_below = |to: &usize| self.height[*to] < height && self.open[*to] > 0.0;
        self.nodes_of(self.cell_of(column + x, row + y)?).find(is_below)
    }

    /// The node of a cell that is nearest in height to another, within `step` m.
    pub(super) fn level_with(&self, node: usize, column: i64, row: i64, step: f32) -> Option<usize> {
        let height = self.height[node];
        let off = |other: &usize| (self.height[*other] - height).abs();
        let nodes = self.nodes_of(self.cell_of(column, row)?);
        nodes.filter(|other| off(other) < step).min_by(|a, b| off(a).total_cmp(&off(b)))
    }

    /// Returns true if nothing can lie there.
    pub(super) fn is_steep(&self, node: usize) -> bool {
        let [a, b] = self.slope[node];
        a.hypot(b) > SLIDING_SLOPES[1]
    }

    /// Returns true if it is level, and faces up as far as is known.
    pub(super) fn is_level(&self, node: usize) -> bool {
        let [a, b] = self.slope[node];
        a.hypot(b) < MAX_LEVEL_SLOPE && (self.facing[node].is_nan() || self.facing[node] > UPRIGHT_COSINE)
    }

    /// Returns true if about it there is one surface alone, as far as something can stand on it or
    /// be its edge.
    pub(super) fn is_plain(&self, node: usize) -> bool {
        self.is_plain[node]
    }

    /// Returns true if it is a plain that cameras see, and none of them sees anything below it.
    pub(super) fn is_solid(&self, node: usize) -> bool {
        let end = self.nodes_of(self.cells[node] as usize).end;
        self.is_seen[node] && self.is_plain(node) && !self.is_seen[node + 1..end].contains(&true)
    }
}

/// A node that there may be, as it is kept.
fn number(node: Option<usize>) -> u32 {
    node.map_or(NO_NODE, |node| node as u32)
}
