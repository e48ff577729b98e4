//! Averages what all cameras see in cubes: one disc for each.
//!
//! Depth is rough along the ray, so that views of one piece of ground lie above each other. Cubes
//! are upright and twice as tall as the narrowest are wide: what lies above each other within that
//! is one surface. The narrowest are half as wide as the field over which discs are levelled:
//! narrower ones would not be seen, and cost more.

use super::photo_view::{CUBE_WIDTH_PX, MAX_CUBE_DOUBLINGS, MIN_CUBE_WIDTH_M, PhotoView, Spot};
use crate::level::level_matrix;
use crate::point_grid::PlaceMap;
use crate::threads::map;
use glam::{DMat3, DVec3, IVec3};

/// Least height of cubes, as a power of two of the smallest width.
const MIN_HEIGHT_LOG2: u32 = 1;
/// Weight of a pixel without a normal.
const EDGE_PIXEL_WEIGHT: f64 = 0.2;
/// Parts of the cubes, each of which one thread takes together.
const PART_COUNT: usize = 8;
/// Share of a cube's weight from which narrower cubes inside it take its place.
const NARROWER_WEIGHT_SHARE: f64 = 0.5;

/// A piece of a surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Disc {
    /// Middle, world, scene units.
    pub(crate) point: DVec3,
    /// Normal to the side that it was seen from, length 1.
    pub(crate) normal: DVec3,
    /// True if its normal is not known.
    pub(crate) is_edge: bool,
    /// Width of its cube, scene units.
    pub(crate) size: f64,
    /// Weight: pixels of the smallest cube's width.
    pub(crate) weight: f64,
    pub(crate) rgb: [f32; 3],
}

/// A cube: how often its width is doubled, and its place among those of that width.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
struct Cube {
    doubled: u32,
    at: [i32; 3],
}

impl Cube {
    /// Powers of two of the smallest width: of its width and of its height.
    fn powers(doubled: u32) -> [u32; 2] {
        [doubled, doubled.max(MIN_HEIGHT_LOG2)]
    }

    /// The cube so many times doubled that contains it.
    fn wider(self, doubled: u32) -> Self {
        let [wide, tall] = [0, 1].map(|k| Self::powers(doubled)[k] - Self::powers(self.doubled)[k]);
        let [x, y, z] = self.at;
        Self { doubled, at: [x >> wide, y >> wide, z >> tall] }
    }
}

/// Sums over the pixels in a cube.
#[derive(Clone, Copy, Debug)]
struct Sums {
    weight: f64,
    /// Places from the cube's corner along the level axes, scene units.
    place: DVec3,
    normal: DVec3,
    /// Weight of those with a normal.
    known: f64,
    rgb: [f64; 3],
}

impl Sums {
    fn add(&mut self, other: &Self) {
        self.weight += other.weight;
        self.place += other.place;
        self.normal += other.normal;
        self.known += other.known;
        self.rgb.iter_mut().zip(other.rgb).for_each(|(sum, value)| *sum += value);
    }
}

/// The cubes of a place.
struct Grid {
    /// World to level axes.
    level: DMat3,
    /// Width of the smallest cubes, scene units.
    cube: f64,
}

impl Grid {
    fn size(&self, doubled: u32) -> DVec3 {
        let [wide, tall] = Cube::powers(doubled).map(|power| self.cube * f64::from(1 << power));
        DVec3::new(wide, wide, tall)
    }

    /// The cube of a pixel and what it adds; `None` where pixels are too far apart.
    fn of(&self, spot: &Spot) -> Option<(Cube, Sums)> {
        let apart = CUBE_WIDTH_PX * spot.apart;
        let doubled =
            (0..=MAX_CUBE_DOUBLINGS).find(|doubled| apart <= self.cube * f64::from(1 << doubled))?;
        let (size, place) = (self.size(doubled), self.level * spot.point);
        let at = (place / size).floor();
        let kind = if spot.normal.is_some() { 1.0 } else { EDGE_PIXEL_WEIGHT };
        let weight = (self.cube / apart).powi(2).min(16.0) * kind * spot.count;
        let sums = Sums {
            weight,
            place: (place - at * size) * weight,
            normal: spot.normal.unwrap_or(-spot.ray) * weight,
            known: if spot.normal.is_some() { weight } else { 0.0 },
            rgb: spot.rgb.map(|v| f64::from(v) * weight),
        };
        Some((Cube { doubled, at: at.as_ivec3().to_array() }, sums))
    }

    fn disc(&self, cube: Cube, sums: &Sums) -> Disc {
        let size = self.size(cube.doubled);
        let place = IVec3::from_array(cube.at).as_dvec3() * size + sums.place / sums.weight;
        Disc {
            point: self.level.transpose() * place,
            normal: sums.normal.normalize_or(self.level.row(2)),
            is_edge: sums.known < 0.5 * sums.weight || sums.normal.length() < 0.5 * sums.weight,
            size: size.x,
            weight: sums.weight,
            rgb: sums.rgb.map(|v| (v / sums.weight) as f32),
        }
    }
}

/// Sums by cube, in the order in which cubes were first met.
#[derive(Default)]
struct Cubes {
    all: Vec<(Cube, Sums)>,
    places: PlaceMap<Cube, u32>,
}

impl Cubes {
    fn add(&mut self, cube: Cube, sums: &Sums) {
        // Pixels side by side are mostly in one cube.
        if let Some((_, sum)) = self.all.last_mut().filter(|(last, _)| *last == cube) {
            return sum.add(sums);
        }
        match self.places.get(&cube) {
            Some(place) => self.all[*place as usize].1.add(sums),
            None => {
                self.places.insert(cube, self.all.len() as u32);
                self.all.push((cube, *sums));
            }
        }
    }
}

/// Fuses the surfaces of all cameras in cubes; wide ones only where there are no narrow ones.
pub(super) fn fuse(views: &[PhotoView], up: [f64; 3], metres_per_unit: f64) -> Vec<Disc> {
    let level = level_matrix(up);
    let grid = Grid { level, cube: MIN_CUBE_WIDTH_M / metres_per_unit };
    let each = map(views.len(), |index| {
        let mut cubes = Cubes::default();
        views[index].each_spot(grid.cube, |spot| {
            if let Some((cube, sums)) = grid.of(&spot) {
                cubes.add(cube, &sums);
            }
        });
        let mut parts = vec![Vec::new(); PART_COUNT];
        for (cube, sums) in cubes.all {
            parts[cube.at[0].rem_euclid(PART_COUNT as i32) as usize].push((cube, sums));
        }
        parts
    });
    let merged = map(PART_COUNT, |part| {
        let mut cubes = Cubes::default();
        each.iter().flat_map(|parts| &parts[part]).for_each(|(cube, sums)| cubes.add(*cube, sums));
        cubes.all
    });
    let mut cubes = merged.concat();
    cubes.sort_unstable_by_key(|(cube, _)| *cube);
    let mut narrower: PlaceMap<Cube, f64> = PlaceMap::default();
    for (cube, sums) in &cubes {
        for doubled in cube.doubled + 1..=MAX_CUBE_DOUBLINGS {
            *narrower.entry(cube.wider(doubled)).or_default() += sums.weight;
        }
    }
    let finest = cubes.iter().filter(|(cube, sums)| {
        narrower.get(cube).is_none_or(|weight| *weight < NARROWER_WEIGHT_SHARE * sums.weight)
    });
    finest.map(|(cube, sums)| grid.disc(*cube, sums)).collect()
}
