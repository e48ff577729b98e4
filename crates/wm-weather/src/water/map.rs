//! A map of the water of a place: heights of its surface.

use super::rills::{Nodes, Rills};
use crate::level::{level_axes, to_level};
use crate::optics::Site;
use std::sync::Arc;

/// Water on level nodes, in rows along the first level axis.
///
/// Lengths are metres along [`level_axes`] from the world's origin; heights are metres along up
/// from there.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WaterGrid {
    /// The first node.
    origin: [f64; 2],
    /// Distance of nodes.
    step: f64,
    /// Nodes along the first axis, and along the second.
    size: [usize; 2],
    /// The numbers of [`WaterNode`]; the level is not a number where there is no water. Nodes
    /// beside others go on from them, without water, so that its edges are soft.
    nodes: Vec<[f32; 4]>,
    /// Levels that hide something, lowest and highest.
    heights: Option<[f64; 2]>,
    /// Some of the levels, sorted.
    levels: Vec<f32>,
    /// Streams on slopes.
    pub(super) rills: Option<Rills>,
}

/// Water at a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct WaterNode {
    /// Height of the surface, also where it hides nothing; NaN where there is none.
    pub(crate) level: f32,
    /// Depth of water that stands, m; below 0 by as much as the ground is above its level. Between
    /// nodes it is interpolated, so that the edge of a puddle is the curve where its level meets
    /// the ground.
    pub(crate) depth: f32,
    /// Share of the ground that a film or a stream hides, 0-1.
    pub(crate) film: f32,
    /// Slopes of the surface that do not move, such as those of a film on rough ground, rms along
    /// one axis, where no water stands.
    pub(crate) roughness: f32,
}

impl WaterNode {
    /// Share of the ground that the water hides, 0-1.
    pub(crate) fn cover(&self) -> f32 {
        cover_of(self.depth, self.film)[0]
    }
}

/// Depth of standing water from which it hides the texture of its bottom, m.
pub(super) const HIDING_DEPTH_M: f32 = 0.004;
/// Depth at nodes on dry ground that no puddle is beside.
pub(super) const DRY_DEPTH_M: f32 = -HIDING_DEPTH_M;

/// The share of the ground that water hides, and that under standing water alone, 0-1, by its
/// depth, m, and the share under films.
#[inline(always)]
fn cover_of(depth: f32, film: f32) -> [f32; 2] {
    let stands = (depth * (1.0 / HIDING_DEPTH_M)).clamp(0.0, 1.0);
    let stands = stands * stands * (3.0 - 2.0 * stands);
    [stands.max(film), stands]
}

/// The water of a place: on level nodes, and beyond them everywhere at one level.
#[derive(Clone, Debug, PartialEq)]
pub struct WaterMap {
    /// Level axes and up.
    pub(super) axes: [[f64; 3]; 3],
    /// Metres a scene unit.
    pub(super) metres_per_unit: f64,
    /// Height of the endless level surface, if there is one.
    plane: Option<f64>,
    /// Puddles and films.
    grid: Option<Arc<WaterGrid>>,
}

/// Water at a place of a map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct WaterSample {
    /// Height of the surface along up from the world's origin, m.
    pub(crate) level: f64,
    /// Share of the ground that it hides, 0-1.
    pub(crate) cover: f32,
    /// Slopes that do not move, rms along one axis.
    pub(crate) roughness: f32,
}

impl WaterMap {
    /// Water on the nodes of a grid, and everywhere `flood` metres over the ground of the site,
    /// each where it stands higher.
    pub(crate) fn new(flood: Option<f64>, grid: Option<Arc<WaterGrid>>, site: &Site) -> Self {
        let plane = flood.map(|level| site.ground * site.metres_per_unit + level);
        Self { axes: level_axes(site.up), metres_per_unit: site.metres_per_unit, plane, grid }
    }

    /// Puddles and films, if there are any.
    #[must_use]
    pub fn grid(&self) -> Option<&Arc<WaterGrid>> {
        self.grid.as_ref()
    }

    /// Height of the endless level surface, if there is one.
    #[must_use]
    pub fn plane(&self) -> Option<f64> {
        self.plane
    }

    /// Returns true if there is nothing but the endless level surface.
    pub(crate) fn is_endless(&self) -> bool {
        self.plane.is_some() && self.grid.is_none()
    }

    /// Height of a world point along up from the world's origin, m.
    #[must_use]
    pub fn height_of(&self, point: [f64; 3]) -> f64 {
        to_level(&self.axes, point)[2] * self.metres_per_unit
    }

    /// The heights of all water, lowest and highest, m; `None` where none stands.
    #[must_use]
    pub fn heights(&self) -> Option<[f64; 2]> {
        let all = self.grid.iter().filter_map(|grid| grid.heights).chain(self.plane.map(|level| [level; 2]));
        all.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
    }

    /// About the height below the eye that half of the water is above, m; `None` without any. With
    /// an endless surface it is that.
    pub(crate) fn typical_height(&self, eye: f64) -> Option<f64> {
        if self.plane.is_some() {
            return self.plane;
        }
        let levels = &self.grid.as_ref()?.levels;
        let below = levels.partition_point(|level| f64::from(*level) < eye);
        levels[..below].get(below / 2).map(|level| f64::from(*level))
    }
}

/// One level in so many nodes is kept to find the median.
const LEVEL_STRIDE: usize = 16;

impl WaterGrid {
    /// Hides the water where something lies on it: `hidden` is the share of the water at a node
    /// that is not seen, 0-1.
    #[must_use]
    pub fn hidden_by(self, hidden: impl Fn(usize) -> f32) -> Self {
        let nodes = (0..self.nodes.len()).map(|i| {
            let [level, depth, film, roughness] = self.nodes[i];
            let node = WaterNode { level, depth, film, roughness };
            if level.is_nan() || node.cover() <= 0.0 {
                return node;
            }
            let seen = 1.0 - hidden(i);
            if seen >= 1.0 {
                return node;
            }
            WaterNode { depth: depth.min(seen * HIDING_DEPTH_M), film: film * seen, ..node }
        });
        Self { rills: self.rills.clone(), ..Self::new(self.origin, self.step, self.size, nodes) }
    }

    /// Returns the streams, and the nodes that they are on.
    pub(super) fn rills(&self) -> Option<(&Rills, Nodes)> {
        Some((self.rills.as_ref()?, (self.origin, self.step, self.size)))
    }

    /// Water on nodes in rows along the first level axis, of which `size` are along the two axes,
    /// `step` metres from each other and from the first one at `origin`, metres.
    pub(crate) fn new(
        origin: [f64; 2],
        step: f64,
        size: [usize; 2],
        nodes: impl Iterator<Item = WaterNode>,
    ) -> Self {
        let mut grid = Self { origin, step, size, ..Self::default() };
        grid.nodes.reserve_exact(size[0] * size[1]);
        for (i, node) in nodes.enumerate() {
            let WaterNode { level, depth, film, roughness } = node;
            grid.nodes.push([level, depth, film, roughness]);
            if !level.is_nan() && node.cover() > 0.0 {
                let own = f64::from(level);
                let [low, high] = grid.heights.unwrap_or([own; 2]);
                grid.heights = Some([low.min(own), high.max(own)]);
                if i % LEVEL_STRIDE == 0 {
                    grid.levels.push(level);
                }
            }
        }
        grid.levels.sort_unstable_by(f32::total_cmp);
        grid.go_on();
        grid
    }

    /// Lets nodes without water go on from those beside them.
    fn go_on(&mut self) {
        let [width, height] = self.size;
        let mut more = Vec::new();
        for y in 0..height {
            for x in 0..width {
                if !self.nodes[y * width + x][0].is_nan() {
                    continue;
                }
                let (mut sum, mut count) = ([0.0; 2], 0.0);
                for row in y.saturating_sub(1)..(y + 2).min(height) {
                    for column in x.saturating_sub(1)..(x + 2).min(width) {
                        let [level, .., roughness] = self.nodes[row * width + column];
                        if !level.is_nan() {
                            sum = [sum[0] + level, sum[1] + roughness];
                            count += 1.0;
                        }
                    }
                }
                if count > 0.0 {
                    more.push((y * width + x, [sum[0] / count, DRY_DEPTH_M, 0.0, sum[1] / count]));
                }
            }
        }
        more.into_iter().for_each(|(at, node)| self.nodes[at] = node);
    }

    /// A place in steps from the first node, metres along the level axes.
    pub(super) fn steps(&self, x: f64, y: f64) -> [f64; 2] {
        [(x - self.origin[0]) / self.step, (y - self.origin[1]) / self.step]
    }

    /// The water at a place in steps from the first node.
    #[inline(always)]
    pub(super) fn between(&self, u: f32, v: f32) -> Option<WaterSample> {
        let [width, height] = self.size;
        if !(u >= 0.0 && v >= 0.0 && u < (width - 1) as f32 && v < (height - 1) as f32) {
            return None;
        }
        let (column, row) = (u as usize, v as usize);
        let (right, down) = (u - column as f32, v - row as f32);
        let above = &self.nodes[row * width + column..][..2];
        let below = &self.nodes[(row + 1) * width + column..][..2];
        // Loops and no closures: these are looked up for each pixel.
        let mut sum = [0.0; 4];
        for k in 0..4 {
            let upper = above[0][k] * (1.0 - right) + above[1][k] * right;
            let lower = below[0][k] * (1.0 - right) + below[1][k] * right;
            sum[k] = upper * (1.0 - down) + lower * down;
        }
        let [level, depth, film, roughness] = sum;
        if level.is_nan() {
            return None;
        }
        let [cover, stands] = cover_of(depth, film);
        Some(WaterSample { level: f64::from(level), cover, roughness: roughness * (1.0 - stands) })
    }
}

/// Water as it is looked up from one eye, in single precision.
pub(super) struct WaterView<'a> {
    grid: Option<&'a WaterGrid>,
    plane: Option<f64>,
    /// The eye in steps from the grid's first node, and steps per metre.
    eye: [f32; 2],
    steps: f32,
}

impl<'a> WaterView<'a> {
    /// The water for an eye, metres along the level axes.
    pub(crate) fn new(map: &'a WaterMap, eye: [f64; 2]) -> Self {
        let grid = map.grid.as_deref();
        let place = grid.map_or([0.0; 2], |grid| grid.steps(eye[0], eye[1]).map(|v| v as f32));
        let steps = grid.map_or(0.0, |grid| (1.0 / grid.step) as f32);
        Self { grid, plane: map.plane, eye: place, steps }
    }

    /// The water at a place, metres along the level axes from the eye; `None` where none is known.
    #[inline(always)]
    pub(crate) fn at(&self, x: f32, y: f32) -> Option<WaterSample> {
        let (u, v) = (x * self.steps + self.eye[0], y * self.steps + self.eye[1]);
        let own = self.grid.and_then(|grid| grid.between(u, v));
        if self.plane.is_none() { own } else { higher(self.plane, own) }
    }

    /// Steps of the grid in a distance along one axis, m; 0 without a grid.
    #[inline(always)]
    pub(crate) fn steps_in(&self, distance: f32) -> f32 {
        distance * self.steps
    }
}

/// The higher of an endless surface and a grid's water.
#[inline(always)]
pub(super) fn higher(plane: Option<f64>, own: Option<WaterSample>) -> Option<WaterSample> {
    let everywhere = plane.map(|level| WaterSample { level, cover: 1.0, roughness: 0.0 });
    match (everywhere, own) {
        (Some(plane), Some(own)) if own.level > plane.level && own.cover > 0.0 => Some(own),
        (Some(plane), _) => Some(plane),
        (None, own) => own,
    }
}
