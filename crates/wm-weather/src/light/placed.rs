//! Surfaces that are placed on a captured scene: lying snow and dust, and targets of instruments.
//!
//! Each sees of sun and sky what the nearest splat of the scene sees; its normal is its own, the shortest axis of its
//! splat, turned up.

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

/// The splats of a scene by place, to find what is near.
#[derive(Clone, Debug)]
pub struct NearSplats {
    /// One splat of each cell that has any: the one nearest to its middle.
    cells: PlaceMap<IVec3, u32>,
    width: f32,
}

impl NearSplats {
    /// Of a scene without its sky.
    #[must_use]
    pub fn new(points: &[[f32; 3]], capture: &CaptureLight, site: &Site) -> Self {
        let width = (CELL / site.metres_per_unit) as f32;
        let cell = |point: Vec3| (point / width).floor().as_ivec3();
        let off = |point: Vec3| (point / width - cell(point).as_vec3() - 0.5).length_squared();
        let mut cells: PlaceMap<IVec3, u32> = PlaceMap::default();
        for (index, point) in points.iter().enumerate().filter(|(index, _)| !capture.is_sky(*index)) {
            let point = Vec3::from_array(*point);
            let known = cells.entry(cell(point)).or_insert(index as u32);
            if off(point) < off(Vec3::from_array(points[*known as usize])) {
                *known = index as u32;
            }
        }
        Self { cells, width }
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
        Self { points, normals, beside }
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
        match self.beside[index] {
            Some(beside) => capture.surface_beside(beside as usize, normal, up, shadows),
            None => capture.surface_in_the_open(normal, up, shadows),
        }
    }
}
