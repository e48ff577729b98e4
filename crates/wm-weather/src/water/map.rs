//! A map of the water of a place: heights of its surface.

use super::rills::Rills;
use crate::dome::{level_axes, to_level};
use crate::optics::Site;
use std::sync::Arc;

/// Water on level nodes, in rows along the first level axis.
///
/// Lengths are metres along [`level_axes`] from the world's origin; heights are metres along up from there.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WaterGrid {
    /// The first node.
    pub origin: [f64; 2],
    /// Distance of nodes.
    pub step: f64,
    /// Nodes along the first axis.
    pub width: usize,
    /// Nodes along the second axis.
    pub height: usize,
    /// Height of the surface at each node, also where it hides nothing; NaN where there is none.
    pub level: Vec<f32>,
    /// Share of the ground that the water hides at each node, 0-1: soft edges.
    pub cover: Vec<f32>,
    /// Slopes of the surface that do not move, such as those of a film on rough ground, rms along one axis.
    pub roughness: Vec<f32>,
    /// Streams on slopes.
    pub rills: Option<Rills>,
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
pub struct WaterSample {
    /// Height of the surface along up from the world's origin, m.
    pub level: f64,
    /// Share of the ground that it hides, 0-1.
    pub cover: f32,
    /// Slopes that do not move, rms along one axis.
    pub roughness: f32,
}

impl WaterMap {
    /// Water everywhere, `level` metres above the site's ground.
    #[must_use]
    pub fn flood(level: f64, site: &Site) -> Self {
        let height = site.ground * site.metres_per_unit + level;
        Self { plane: Some(height), ..Self::of_grid(None, site) }
    }

    /// Water on the nodes of a grid.
    #[must_use]
    pub fn of_grid(grid: Option<Arc<WaterGrid>>, site: &Site) -> Self {
        Self { axes: level_axes(site.up), metres_per_unit: site.metres_per_unit, plane: None, grid }
    }

    /// The same with the water of a grid where that stands higher.
    #[must_use]
    pub fn with_grid(self, grid: Option<Arc<WaterGrid>>) -> Self {
        Self { grid, ..self }
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
    #[must_use]
    pub fn is_endless(&self) -> bool {
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
        let nodes = self.grid.iter().flat_map(|grid| grid.level.iter().zip(&grid.cover));
        let levels = nodes.filter(|(level, cover)| !level.is_nan() && **cover > 0.0);
        let all = levels.map(|(level, _)| f64::from(*level)).chain(self.plane);
        all.fold(None, |found: Option<[f64; 2]>, level| {
            Some(found.map_or([level; 2], |[low, high]| [low.min(level), high.max(level)]))
        })
    }

    /// About the height below the eye that half of the water is above, m; `None` without any. With an endless surface it is that.
    #[must_use]
    pub fn typical_height(&self, eye: f64) -> Option<f64> {
        if self.plane.is_some() {
            return self.plane;
        }
        let nodes = self.grid.iter().flat_map(|grid| grid.level.iter().zip(&grid.cover));
        let mut levels: Vec<f32> = nodes
            .step_by(16)
            .filter(|(level, cover)| f64::from(**level) < eye && **cover > 0.0)
            .map(|(level, _)| *level)
            .collect();
        let middle = levels.len() / 2;
        (!levels.is_empty()).then(|| f64::from(*levels.select_nth_unstable_by(middle, f32::total_cmp).1))
    }

    /// The water at a place, metres along the level axes; `None` where none is known. It may hide nothing.
    #[must_use]
    pub fn at(&self, x: f64, y: f64) -> Option<WaterSample> {
        let everywhere = self.plane.map(|level| WaterSample { level, cover: 1.0, roughness: 0.0 });
        let own = self.grid.as_ref().and_then(|grid| grid.at(x, y));
        match (everywhere, own) {
            (Some(plane), Some(own)) if own.level > plane.level && own.cover > 0.0 => Some(own),
            (Some(plane), _) => Some(plane),
            (None, own) => own,
        }
    }
}

impl WaterGrid {
    fn at(&self, x: f64, y: f64) -> Option<WaterSample> {
        let (u, v) = ((x - self.origin[0]) / self.step, (y - self.origin[1]) / self.step);
        if !(u >= 0.0 && v >= 0.0 && u < (self.width - 1) as f64 && v < (self.height - 1) as f64) {
            return None;
        }
        let (column, row) = (u as usize, v as usize);
        let (right, down) = (u - column as f64, v - row as f64);
        let (mut level, mut cover, mut roughness, mut wet) = (0.0, 0.0, 0.0, 0.0);
        for (dy, fy) in [(0, 1.0 - down), (1, down)] {
            for (dx, fx) in [(0, 1.0 - right), (1, right)] {
                let node = (row + dy) * self.width + column + dx;
                let weight = fx * fy;
                if !self.level[node].is_nan() {
                    level += weight * f64::from(self.level[node]);
                    roughness += weight * f64::from(self.roughness[node]);
                    cover += weight * f64::from(self.cover[node]);
                    wet += weight;
                }
            }
        }
        (wet > 0.0).then(|| WaterSample {
            level: level / wet,
            cover: cover as f32,
            roughness: (roughness / wet) as f32,
        })
    }
}
