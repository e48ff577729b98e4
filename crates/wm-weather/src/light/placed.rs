//! Surfaces that are placed on a captured scene: lying snow and dust, and targets of instruments.
//!
//! Each sees of the sun what the nearest splat of the scene sees, and of the sky what level ground about it sees in the mean: the ground
//! of rough captures has holes, and sheets that hide each other. Its normal is its own, the shortest axis of its splat, turned up.

use super::capture::CaptureLight;
use super::irradiance::SurfaceLight;
use super::sun_shadows::SunShadows;
use crate::fused_surfaces::places::PlaceMap;
use crate::optics::Site;
use crate::threads::map;
use glam::{IVec3, Vec3};
use wm_scene::splats::shortest_axis;
use wm_scene::{Splats, quat};

/// Width of the cells by which the nearest splat of the scene is found, m.
const CELL: f64 = 0.3;

/// Width of the blocks of level ground, m, and the reaches of their means, in blocks: the first that finds any counts.
const BLOCK: f64 = 0.6;
const REACHES: [i32; 3] = [1, 3, 6];
/// Least cosine between up and the normal of ground.
const LEVEL: f32 = 0.5;

/// The splats of a scene by place, to find what is near.
#[derive(Clone, Debug)]
pub struct NearSplats {
    /// One splat of each cell that has any: the one nearest to its middle.
    cells: PlaceMap<IVec3, u32>,
    width: f32,
    /// The shares of the sky's light that reach level ground.
    blocks: PlaceMap<IVec3, LevelBlock>,
    block: f32,
}

/// Level ground in a block: sums over its splats.
#[derive(Clone, Copy, Debug, Default)]
struct LevelBlock {
    count: f32,
    points: Vec3,
    open: [f32; 2],
}

impl NearSplats {
    /// Of a scene without its sky.
    #[must_use]
    pub fn new(points: &[[f32; 3]], capture: &CaptureLight, site: &Site) -> Self {
        let width = (CELL / site.metres_per_unit) as f32;
        let cell = |point: Vec3| (point / width).floor().as_ivec3();
        let off = |point: Vec3| (point / width - cell(point).as_vec3() - 0.5).length_squared();
        let mut cells: PlaceMap<IVec3, u32> = PlaceMap::default();
        let block = (BLOCK / site.metres_per_unit) as f32;
        let up = Vec3::from_array(site.up.map(|v| v as f32));
        let mut blocks: PlaceMap<IVec3, LevelBlock> = PlaceMap::default();
        for (index, point) in points.iter().enumerate().filter(|(index, _)| !capture.is_sky(*index)) {
            let point = Vec3::from_array(*point);
            let known = cells.entry(cell(point)).or_insert(index as u32);
            if off(point) < off(Vec3::from_array(points[*known as usize])) {
                *known = index as u32;
            }
            if capture.normal(index).dot(up) > LEVEL {
                let ground = blocks.entry((point / block).floor().as_ivec3()).or_default();
                ground.count += 1.0;
                ground.points += point;
                (0..2).for_each(|k| ground.open[k] += capture.open(index)[k]);
            }
        }
        Self { cells, width, blocks, block }
    }

    /// The mean shares of the sky's light that reach level ground near a point; `None` if there is none within some metres.
    fn level_open(&self, point: Vec3) -> Option<[f32; 2]> {
        let middle = (point / self.block).floor().as_ivec3();
        REACHES.into_iter().find_map(|reach| {
            let range = (reach as f32 + 0.5) * self.block;
            let (mut sums, mut weights) = ([0.0f32; 2], 0.0f32);
            for x in -reach..=reach {
                for y in -reach..=reach {
                    for z in -reach..=reach {
                        let Some(ground) = self.blocks.get(&(middle + IVec3::new(x, y, z))) else { continue };
                        let away = (ground.points / ground.count).distance_squared(point) / (range * range);
                        let weight = (1.0 - away).max(0.0).powi(2);
                        (0..2).for_each(|k| sums[k] += weight * ground.open[k] / ground.count);
                        weights += weight;
                    }
                }
            }
            (weights > 1e-3).then(|| sums.map(|sum| sum / weights))
        })
    }

    /// A splat near a point; `None` if there is none within two cells.
    fn near(&self, point: Vec3) -> Option<u32> {
        let middle = (point / self.width).floor().as_ivec3();
        let at = |x: i32, y: i32, z: i32| self.cells.get(&(middle + IVec3::new(x, y, z))).copied();
        for reach in 0..=2i32 {
            let shell = (-reach..=reach)
                .flat_map(|x| (-reach..=reach).flat_map(move |y| (-reach..=reach).map(move |z| (x, y, z))));
            let on = shell.filter(|(x, y, z)| x.abs().max(y.abs()).max(z.abs()) == reach);
            if let Some(found) = on.filter_map(|(x, y, z)| at(x, y, z)).next() {
                return Some(found);
            }
        }
        None
    }
}

/// Surfaces with their places and normals, and what is near them.
#[derive(Clone, Debug)]
pub struct PlacedSurfaces {
    points: Vec<[f32; 3]>,
    /// Length 1.
    normals: Vec<Vec3>,
    /// The splat of the scene that sees what the surface sees; `None` in the open.
    beside: Vec<Option<u32>>,
    /// The shares of the sky's light that reach level ground there; `None` if there is no such ground.
    open: Vec<Option<[f32; 2]>>,
}

impl PlacedSurfaces {
    /// The surfaces of splats that lie on a scene.
    #[must_use]
    pub fn of(splats: &Splats, near: &NearSplats, site: &Site, threads: usize) -> Self {
        let up = Vec3::from_array(site.up.map(|v| v as f32));
        let normals = map(splats.len(), threads, |index| {
            let rows = quat::to_matrix(splats.quats[index].map(f64::from));
            let axis = shortest_axis(splats.log_scales[index]);
            let normal = Vec3::from_array(rows.map(|row| row[axis] as f32));
            // The edge of snow looks to the side, whichever way its splat is turned.
            if normal.dot(up) < -1e-3 { -normal } else { normal }
        });
        let points = splats.means.clone();
        let beside = map(splats.len(), threads, |index| near.near(Vec3::from_array(points[index])));
        let open = map(splats.len(), threads, |index| near.level_open(Vec3::from_array(points[index])));
        Self { points, normals, beside, open }
    }

    /// The number of surfaces.
    #[must_use]
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Returns true if there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// The place of a surface, world axes, scene units.
    #[must_use]
    pub fn point(&self, index: usize) -> [f32; 3] {
        self.points[index]
    }

    /// The normal of a surface, length 1.
    #[must_use]
    pub fn normal(&self, index: usize) -> Vec3 {
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
        let surface = match self.beside[index] {
            Some(beside) => capture.surface_beside(beside as usize, normal, up, shadows),
            None => capture.surface_in_the_open(normal, up, shadows),
        };
        let is_level = normal.dot(Vec3::from_array(up.map(|v| v as f32))) > LEVEL;
        match self.open[index].filter(|_| is_level) {
            Some(open) => SurfaceLight { open: open.map(f64::from), ..surface },
            None => surface,
        }
    }
}
