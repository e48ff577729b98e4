//! What snow can lie on: surfaces over a level grid, how much of the fall each gets, and how light it is there.
//!
//! # Surfaces
//! Layers of a level grid ([`Layers`]): the first surface from above, and those below it. A *node* is a cell of one
//! layer. Its slope is that of a plane through the nodes about it which no edge parts from it. A node whose neighbours are
//! partly far above and partly far below is a piece of a wall and holds nothing; one whose neighbours are all below
//! is the top of something narrow.
//!
//! # The fall
//! What reaches a node, as a share of what falls on open level ground: the mean over several directions about that of the
//! fall of whether anything is in the way ([`Shelter`]), since flakes do not all come the same way; and more
//! where a slope faces the wind: `1 - grad h . v`, with v the slope of the fall.

use super::settle::EDGE;
use super::surfels::shades;
use crate::dome::{from_level, level_axes, to_level};
use crate::optics::Site;
use crate::shelter::{Layers, Occluders, Shelter};
use wm_scene::color::{luminance, srgb_decode};
use wm_scene::{Group, Splats, sh};

/// Surfaces below each other that are looked for, and how far apart they are at least, m.
const LAYERS: usize = 3;
const GAP: f64 = 0.5;
/// How far the directions of flakes spread about their mean, as a slope.
const SPREAD: f64 = 0.35;
/// Slopes over which less and less stays at once, as tangents: 50 and 60 degrees.
const STEEP: [f32; 2] = [1.19, 1.73];
/// The slope of a piece of a wall.
const WALL: [f32; 2] = [2.0 * STEEP[1], 0.0];
/// Half the width of the field that a slope is taken from, cells.
const FIELD: i64 = 2;
/// How often slopes are evened out with those beside them.
const ROUNDS: usize = 8;
/// Share of a field that must belong to a surface.
const SURFACE: f32 = 0.3;
/// How far above a node it is asked what is in the way, m.
const ABOVE: f64 = 0.06;
/// How far from a surface splats are still of it, m.
const OWN: f64 = 0.12;

/// Nodes, layer by layer, row by row.
#[derive(Clone, Debug)]
pub struct Ground {
    pub(super) places: Layers,
    /// Columns and rows.
    pub size: [usize; 2],
    /// Number of layers.
    pub layers: usize,
    /// Width of a cell, m.
    pub cell: f32,
    /// m; not finite where there is no surface.
    pub height: Vec<f32>,
    /// The plane through each node: its slope along columns and rows.
    pub slope: Vec<[f32; 2]>,
    /// Share of the fall that reaches it and stays at first, 0 and more.
    pub share: Vec<f32>,
    /// Share of the sky that it sees, 0-1.
    pub open: Vec<f32>,
    /// Luminance of the surface, linear; not a number where no splat tells.
    pub light: Vec<f32>,
    /// How lit it is, 0 in the shade to 1 in the open.
    pub shade: Vec<f32>,
    /// Cells that an inner ground has.
    is_inner: Vec<bool>,
}

impl Ground {
    /// Of a scene in a fall of `slope` (along and across [`level_axes`], a share of the fall speed). What lies on an
    /// `inner` ground is that one's.
    #[must_use]
    pub fn of(
        splats: &Splats,
        occluders: &Occluders,
        site: &Site,
        slope: [f64; 2],
        inner: Option<&Self>,
        threads: usize,
    ) -> Self {
        let places = occluders.layers(LAYERS, GAP, Some(threads));
        let size = places.size();
        let height: Vec<f32> = places.heights().concat();
        let nodes = height.len();
        let [columns, rows] = size;
        let is_inner = |cell: usize| {
            let place = [cell % columns, cell / columns].map(|v| v as f64 + 0.5);
            inner.is_some_and(|inner| {
                inner.places.cell_at(inner.places.locate(places.point(place, 0.0)).0).is_some()
            })
        };
        let is_inner: Vec<bool> = (0..columns * rows).map(is_inner).collect();
        let mut ground = Self {
            size,
            layers: LAYERS,
            cell: places.cell() as f32,
            height,
            slope: vec![[0.0; 2]; nodes],
            share: vec![0.0; nodes],
            open: vec![0.0; nodes],
            light: vec![f32::NAN; nodes],
            shade: Vec::new(),
            is_inner,
            places,
        };
        ground.smooth();
        ground.find_slopes();
        ground.smooth_slopes();
        ground.find_shares(occluders, site, slope, threads);
        ground.find_light(splats);
        ground.shade = shades(&ground);
        ground
    }

    fn cells(&self) -> usize {
        self.size[0] * self.size[1]
    }

    /// The nodes of a cell, the uppermost first.
    pub(super) fn nodes_of(&self, cell: usize) -> impl Iterator<Item = usize> + use<> {
        let cells = self.cells();
        (0..self.layers).map(move |layer| layer * cells + cell)
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

    /// The node of a layer at a place.
    pub(super) fn node(&self, layer: usize, column: i64, row: i64) -> Option<usize> {
        let [columns, rows] = self.size.map(|v| v as i64);
        let is_in = column >= 0 && row >= 0 && column < columns && row < rows;
        is_in.then(|| layer * self.cells() + (row * columns + column) as usize)
    }

    /// Column and row of a node.
    pub(super) fn place(&self, node: usize) -> [i64; 2] {
        let cell = node % self.cells();
        [(cell % self.size[0]) as i64, (cell / self.size[0]) as i64]
    }

    /// The four nodes beside it on its surface, whatever their layer: those that no edge parts from it.
    pub(super) fn beside(&self, node: usize) -> [Option<usize>; 4] {
        let [column, row] = self.place(node);
        [(1, 0), (0, 1), (-1, 0), (0, -1)].map(|(dx, dy)| self.level_with(node, column + dx, row + dy, EDGE))
    }

    /// The node of a cell that is nearest in height to another, within `step` m.
    pub(super) fn level_with(&self, node: usize, column: i64, row: i64, step: f32) -> Option<usize> {
        let height = self.height[node];
        let off = |other: &usize| (self.height[*other] - height).abs();
        (0..self.layers)
            .filter_map(|layer| self.node(layer, column, row))
            .filter(|other| off(other) < step)
            .min_by(|a, b| off(a).total_cmp(&off(b)))
    }

    /// Whether nothing can lie there.
    pub(super) fn is_steep(&self, node: usize) -> bool {
        let [a, b] = self.slope[node];
        a.hypot(b) > STEEP[1]
    }

    /// Whether an inner ground has it.
    pub(super) fn is_elsewhere(&self, node: usize) -> bool {
        self.is_inner[node % self.cells()]
    }

    /// Takes the roughness of splats off level surfaces: the median of each node and those beside it.
    fn smooth(&mut self) {
        let mut out = self.height.clone();
        for (node, smoothed) in out.iter_mut().enumerate() {
            if !self.height[node].is_finite() {
                continue;
            }
            let [column, row] = self.place(node);
            let mut near = [0.0; 9];
            let mut count = 0;
            for k in 0..9 {
                if let Some(other) = self.level_with(node, column + k % 3 - 1, row + k / 3 - 1, 0.1) {
                    near[count] = self.height[other];
                    count += 1;
                }
            }
            near[..count].sort_by(f32::total_cmp);
            *smoothed = near[count / 2];
        }
        self.height = out;
    }

    /// How much of what falls on a node stays there at first by its slope, 0-1.
    fn kept(&self, node: usize) -> f32 {
        let [a, b] = self.slope[node];
        ((STEEP[1] - a.hypot(b)) / (STEEP[1] - STEEP[0])).clamp(0.0, 1.0)
    }

    /// Takes the roughness of splats off the slopes.
    fn smooth_slopes(&mut self) {
        for _ in 0..ROUNDS {
            let mut out = self.slope.clone();
            for (node, slope) in out.iter_mut().enumerate() {
                if self.height[node].is_finite() && self.slope[node] != WALL {
                    *slope = self.mean_about(node, |other| Some(self.slope[other]));
                }
            }
            self.slope = out;
        }
    }

    /// Fits planes.
    fn find_slopes(&mut self) {
        for node in 0..self.height.len() {
            if !self.height[node].is_finite() {
                continue;
            }
            let [column, row] = self.place(node);
            let (mut count, mut lower, mut higher) = (0.0f32, 0, 0);
            let mut sums = [0.0f32; 5];
            let mut moments = [0.0f32; 3];
            for dy in -FIELD..=FIELD {
                for dx in -FIELD..=FIELD {
                    let Some(upper) = self.node(0, column + dx, row + dy) else { continue };
                    let Some(other) = self.level_with(node, column + dx, row + dy, EDGE) else {
                        let is_lower = self.height[upper] < self.height[node];
                        lower += u32::from(is_lower);
                        higher += u32::from(!is_lower);
                        continue;
                    };
                    let (x, y, h) = (dx as f32, dy as f32, self.height[other] - self.height[node]);
                    count += 1.0;
                    for (sum, value) in sums.iter_mut().zip([x, y, h, x * h, y * h]) {
                        *sum += value;
                    }
                    for (sum, value) in moments.iter_mut().zip([x * x, x * y, y * y]) {
                        *sum += value;
                    }
                }
            }
            let [x, y, h, xh, yh] = sums.map(|sum| sum / count);
            let [xx, xy, yy] =
                [moments[0] / count - x * x, moments[1] / count - x * y, moments[2] / count - y * y];
            let (xh, yh) = (xh - x * h, yh - y * h);
            let det = xx * yy - xy * xy;
            let slope = if det > 0.05 {
                [(xh * yy - yh * xy) / det, (yh * xx - xh * xy) / det].map(|v| v / self.cell)
            } else {
                [0.0; 2]
            };
            self.slope[node] = slope;
            let field = ((2 * FIELD + 1) * (2 * FIELD + 1)) as f32;
            // A piece of a wall has what is above beside it and what is below.
            let is_wall = count < SURFACE * field && higher > 0 && lower > 0;
            if is_wall {
                self.slope[node] = WALL;
            }
        }
    }

    fn find_shares(&mut self, occluders: &Occluders, site: &Site, slope: [f64; 2], threads: usize) {
        let axes = level_axes(site.up);
        let off = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]];
        let grid = self.places.axes();
        for [a, b] in off {
            let way = [slope[0] + SPREAD * a, slope[1] + SPREAD * b];
            let fall = from_level(&axes, [way[0], way[1], -1.0]);
            let shelter: Shelter = occluders.shelter(fall, Some(threads));
            let wind = to_level(&grid, fall).map(|v| v as f32);
            for node in 0..self.height.len() {
                if !self.height[node].is_finite() {
                    continue;
                }
                let [column, row] = self.place(node).map(|v| v as f64 + 0.5);
                let point = self.places.point([column, row], f64::from(self.height[node]) + ABOVE);
                if !shelter.is_exposed(point.map(|v| v as f32)) {
                    continue;
                }
                let facing = 1.0 - self.slope[node][0] * wind[0] - self.slope[node][1] * wind[1];
                let each = 1.0 / off.len() as f32;
                self.open[node] += each;
                self.share[node] += each * self.kept(node) * facing.clamp(0.0, 2.5);
            }
        }
        self.blur_shares();
        for node in 0..self.height.len() {
            if self.is_elsewhere(node) {
                self.share[node] = 0.0;
            }
        }
    }

    /// Softens the edges of what is sheltered, over the nodes beside each other.
    fn blur_shares(&mut self) {
        for _ in 0..2 {
            let mut out = self.share.clone();
            for (node, share) in out.iter_mut().enumerate() {
                if !self.height[node].is_finite() || self.is_steep(node) {
                    continue;
                }
                let of = |other| (!self.is_steep(other)).then(|| [self.share[other]]);
                [*share] = self.mean_about(node, of);
            }
            self.share = out;
        }
    }

    /// The luminance of the splats that make up each surface.
    fn find_light(&mut self, splats: &Splats) {
        let mut sums = vec![[0.0f32; 2]; self.height.len()];
        for index in 0..splats.len() {
            if splats.groups[index] == Group::Sky || !splats.is_sound(index) {
                continue;
            }
            let (place, height) = self.places.locate(splats.means[index].map(f64::from));
            let Some(cell) = self.places.cell_at(place) else { continue };
            let near = |node: &usize| (f64::from(self.height[*node]) - height).abs() < OWN;
            let Some(node) = self.nodes_of(cell).find(near) else { continue };
            let rgb = sh::color(&splats.sh_of(index)[..3], [0.0, 0.0, 1.0]).map(|v| srgb_decode(v.max(0.0)));
            let weight = splats.opacity(index) as f32;
            sums[node][0] += weight * luminance(rgb) as f32;
            sums[node][1] += weight;
        }
        for (light, [sum, weight]) in self.light.iter_mut().zip(sums) {
            *light = sum / weight;
        }
    }
}
