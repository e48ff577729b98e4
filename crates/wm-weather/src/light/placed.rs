//! Surfaces that are placed on a captured scene: lying snow and dust, and targets of instruments.
//!
//! Each sees of the sun what the nearest splats of the scene see in the mean. Of the sky it sees
//! what level ground about it sees in the mean: the ground of rough captures has holes, and sheets
//! that hide each other. Its normal is its own, the shortest axis of its splat, turned up.

use super::capture::CaptureLight;
use super::irradiance::SurfaceLight;
use super::sun_shadows::SunShadows;
use crate::optics::Site;
use crate::point_grid::{PlaceMap, cubes_about};
use crate::threads::map;
use glam::{IVec3, Vec3};
use wm_scene::splats::shortest_axis;
use wm_scene::{Splats, quat};

/// Width of the cells by which the nearest splat of the scene is found.
const CELL_WIDTH_M: f64 = 0.3;
/// Most splats next to a surface that count, and the distance to them within which they count
/// alike, in cells.
const MOST_BESIDE: usize = 6;
const ALIKE_DISTANCE_CELLS: f32 = 0.5;

/// Widths of the blocks of level ground, m, and the weight of each in that of the width before:
/// wider ones tell where there are no narrow ones, and the open sky where there are none at all.
const BLOCK_WIDTHS_M: [f64; 4] = [0.6, 1.8, 5.4, 16.2];
const WIDER_BLOCK_WEIGHT: f32 = 0.03;
/// Least cosine between up and the normal of ground.
const MIN_GROUND_COSINE: f32 = 0.5;

/// The splats of a scene by place, to find what is near.
#[derive(Clone, Debug)]
pub struct NearSplats {
    /// One splat of each cell that has any: the one nearest to its middle.
    cells: PlaceMap<IVec3, (u32, Vec3)>,
    width: f32,
    /// The shares of the sky's light that reach level ground, by blocks of each width, scene units.
    blocks: [(f32, PlaceMap<IVec3, LevelBlock>); BLOCK_WIDTHS_M.len()],
}

/// Level ground in a block: sums over its splats.
#[derive(Clone, Copy, Debug, Default)]
struct LevelBlock {
    count: f32,
    points: Vec3,
    open: [f32; 2],
}

impl NearSplats {
    /// Indexes the splats of a scene without its sky.
    #[must_use]
    pub fn new(points: &[[f32; 3]], capture: &CaptureLight, site: &Site) -> Self {
        let width = (CELL_WIDTH_M / site.metres_per_unit) as f32;
        let cell = |point: Vec3| (point / width).floor().as_ivec3();
        let off = |point: Vec3| (point / width - cell(point).as_vec3() - 0.5).length_squared();
        let mut cells: PlaceMap<IVec3, (u32, Vec3)> = PlaceMap::default();
        let up = Vec3::from_array(site.up.map(|v| v as f32));
        let mut blocks =
            BLOCK_WIDTHS_M.map(|metres| ((metres / site.metres_per_unit) as f32, PlaceMap::default()));
        for (index, point) in points.iter().enumerate().filter(|(index, _)| !capture.is_sky(*index)) {
            let point = Vec3::from_array(*point);
            let known = cells.entry(cell(point)).or_insert((index as u32, point));
            if off(point) < off(known.1) {
                *known = (index as u32, point);
            }
            if capture.normal(index).dot(up) > MIN_GROUND_COSINE {
                for (width, blocks) in &mut blocks {
                    let ground: &mut LevelBlock =
                        blocks.entry((point / *width).floor().as_ivec3()).or_default();
                    ground.count += 1.0;
                    ground.points += point;
                    (0..2).for_each(|k| ground.open[k] += capture.open(index)[k]);
                }
            }
        }
        Self { cells, width, blocks }
    }

    /// The mean shares of the sky's light that reach level ground near a point.
    fn level_open(&self, point: Vec3) -> [f32; 2] {
        let (mut sums, mut weights, mut level) = ([0.0f32; 2], 0.0f32, 1.0f32);
        for (width, blocks) in &self.blocks {
            let middle = (point / width).floor().as_ivec3();
            for at in 0..27 {
                let Some(ground) = blocks.get(&(middle + IVec3::new(at % 3, at / 3 % 3, at / 9) - 1)) else {
                    continue;
                };
                let away = (ground.points / ground.count).distance_squared(point) / (1.5 * width).powi(2);
                let weight = level * (1.0 - away).max(0.0).powi(2);
                (0..2).for_each(|k| sums[k] += weight * ground.open[k] / ground.count);
                weights += weight;
            }
            level *= WIDER_BLOCK_WEIGHT;
        }
        // The open sky, of share 1.
        sums.map(|sum| (sum + level) / (weights + level))
    }

    /// The splats next to a point with their shares, whose sum is 1: those of the cells about it,
    /// or else the first within two cells; none in the open.
    fn near(&self, point: Vec3) -> NearShares {
        let middle = (point / self.width).floor().as_ivec3();
        let within = |reach: i32| cubes_about(middle, reach).filter_map(|cube| self.cells.get(&cube));
        let mut found: Vec<(f32, u32)> =
            within(1).map(|(index, place)| (place.distance_squared(point), *index)).collect();
        if found.is_empty() {
            found.extend(within(2).next().map(|(index, _)| (0.0, *index)));
        }
        found.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        found.truncate(MOST_BESIDE);
        let softness = (ALIKE_DISTANCE_CELLS * self.width).powi(2);
        let weight = |distance: f32| 1.0 / (distance + softness);
        let all: f32 = found.iter().map(|(distance, _)| weight(*distance)).sum();
        let mut beside = [(0, 0.0); MOST_BESIDE];
        for (slot, (distance, index)) in beside.iter_mut().zip(&found) {
            *slot = (*index, weight(*distance) / all);
        }
        beside
    }
}

/// Splats next to a place with their shares, the greatest first; those of share 0 are none.
type NearShares = [(u32, f32); MOST_BESIDE];

/// Surfaces with their places and normals, and what is near them.
#[derive(Clone, Debug)]
pub struct PlacedSurfaces {
    points: Vec<[f32; 3]>,
    /// Length 1.
    normals: Vec<Vec3>,
    /// The splats of the scene that see what the surface sees.
    beside: Vec<NearShares>,
    /// The shares of the sky's light that reach level ground there.
    open: Vec<[f32; 2]>,
}

impl PlacedSurfaces {
    /// The surfaces of splats that lie on a scene.
    #[must_use]
    pub fn of(splats: &Splats, near: &NearSplats, site: &Site) -> Self {
        let up = Vec3::from_array(site.up.map(|v| v as f32));
        let normals = map(splats.len(), |index| {
            let rows = quat::to_matrix(splats.quats[index].map(f64::from));
            let axis = shortest_axis(splats.log_scales[index]);
            let normal = Vec3::from_array(rows.map(|row| row[axis] as f32));
            // The edge of snow looks to the side, whichever way its splat is turned.
            if normal.dot(up) < -1e-3 { -normal } else { normal }
        });
        let points = splats.means.clone();
        let beside = map(splats.len(), |index| near.near(Vec3::from_array(points[index])));
        let open = map(splats.len(), |index| near.level_open(Vec3::from_array(points[index])));
        Self { points, normals, beside, open }
    }

    /// The number of surfaces.
    pub(crate) fn len(&self) -> usize {
        self.points.len()
    }

    /// The place of a surface, world axes, scene units.
    pub(crate) fn point(&self, index: usize) -> [f32; 3] {
        self.points[index]
    }

    /// The normal of a surface, length 1.
    pub(crate) fn normal(&self, index: usize) -> Vec3 {
        self.normals[index]
    }

    /// The geometry of the light on a surface.
    pub(super) fn surface(
        &self,
        index: usize,
        capture: &CaptureLight,
        up: [f64; 3],
        shadows: Option<&SunShadows>,
    ) -> SurfaceLight {
        let normal = self.normals[index];
        let beside = &self.beside[index];
        let of_splat = |splat: u32| capture.surface_beside(splat as usize, normal, up, shadows);
        let surface = if beside[0].1 > 0.0 {
            let parts = beside.iter().filter(|(_, share)| *share > 0.0);
            let sun =
                parts.map(|(splat, share)| f64::from(*share) * of_splat(*splat).sun.clamp(0.0, 1.0)).sum();
            SurfaceLight { sun, ..of_splat(beside[0].0) }
        } else {
            capture.surface_in_the_open(normal, up, shadows)
        };
        let is_level = normal.dot(Vec3::from_array(up.map(|v| v as f32))) > MIN_GROUND_COSINE;
        if is_level { SurfaceLight { open: self.open[index].map(f64::from), ..surface } } else { surface }
    }
}
