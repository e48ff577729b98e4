//! The surfaces of a scene as the cameras of its photos see them.
//!
//! A trained scene looks right from where its photos were taken, and is rough or worse from anywhere else: a street of
//! wide splats seen at a slant has holes from above and junk below, facades have lumps, and haze floats where no
//! photo tells. What the cameras see is much better known. So what lies and what shelters is found on a scan: the
//! depth that each camera sees (with at least half of the light stopped), as small discs with normals, all cameras'
//! together.
//!
//! # How it is made
//! Each pixel gives a place and, but at edges, a normal from the places about it. Those of all cameras are averaged in
//! cubes as wide as pixels are apart there, nearer views counting more, and none from where they would be metres apart; what other cameras see through is
//! dropped (`photo_view.rs`); and the discs are levelled onto the surface through those about them (`level.rs`), since depth
//! is rough. The scene's own splats stay where no camera tells: those that none sees, and that not two see through.

mod floor;
mod level;
mod normals;
mod photo_view;
#[cfg(test)]
mod tests;

use crate::cover::surfel;
use crate::optics::Site;
use crate::threads::map;
pub use floor::FloorPlane;
use glam::{DVec3, I64Vec3};
pub use photo_view::PhotoView;
use photo_view::{Spot, Word};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use wm_scene::splats::Splat;
use wm_scene::{Group, Splats};

/// Width of the smallest cubes, m, and how often it may double.
const CUBE: f64 = 0.06;
const DOUBLED: u32 = 5;
/// Width of cubes in distances between pixels.
const PIXELS: f64 = 1.5;
/// Weight of a pixel without a normal.
const EDGE: f64 = 0.2;
/// The number of cameras that must see through a point for it to be dropped.
const CAMERAS: u32 = 2;
/// Standard deviations of a disc along the surface, and of a ball, in cubes; through a disc, in those; and opacity.
const WIDE: [f64; 2] = [0.6, 0.4];
const FLAT: f64 = 0.1;
const OPAQUE: f64 = 0.95;

/// The surfaces of a scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FusedSurfaces<'a> {
    /// They as splats.
    pub splats: Cow<'a, Splats>,
    /// The first so many are discs whose third axis looks to where they were seen from.
    pub oriented: usize,
    /// The replacement of each splat of the scene; empty where no views were given.
    pub stand_ins: Vec<StandIn>,
}

/// The replacement of a splat of the scene in its fused surfaces.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum StandIn {
    /// It is still there.
    Itself,
    /// Discs, or nothing since cameras see through it.
    Discs,
    /// The ground of a walk: it is what a training made of that.
    Floor,
}

impl<'a> FusedSurfaces<'a> {
    /// The splats themselves, for a scene without photos.
    #[must_use]
    pub fn from_splats(splats: &'a Splats) -> Self {
        Self { splats: Cow::Borrowed(splats), oriented: 0, stand_ins: Vec::new() }
    }

    /// Fuses the surfaces that the cameras see and keeps the splats that none sees. Equal for any number of threads.
    #[must_use]
    pub fn from_views(splats: &'a Splats, views: &[PhotoView], site: &Site, threads: usize) -> Self {
        if views.is_empty() {
            return Self::from_splats(splats);
        }
        let metres_per_unit = site.metres_per_unit;
        let witnesses = map(views.len(), threads, |index| views[index].witness());
        let hears = |point: DVec3| {
            let mut said = Said::default();
            witnesses.iter().for_each(|witness| said.add(witness.word(point, metres_per_unit)));
            said
        };
        let cube = CUBE / metres_per_unit;
        let mut discs = fuse(views, cube, threads);
        let carve = |discs: &mut Vec<Disc>| {
            let mut free = map(discs.len(), threads, |k| hears(discs[k].point).is_free()).into_iter();
            discs.retain(|_| !free.next().unwrap_or(false));
        };
        // Before they are levelled, since what is not there levels nothing; and what that has moved into the open.
        carve(&mut discs);
        level::level(&mut discs, metres_per_unit, threads);
        carve(&mut discs);
        let stand_ins = map(splats.len(), threads, |index| match splats.groups[index] {
            Group::Sky => StandIn::Itself,
            _ => hears(DVec3::from_array(splats.means[index].map(f64::from))).stand_in(),
        });
        let mut out = Splats::with_capacity(discs.len(), 0);
        let up = DVec3::from_array(site.up);
        for disc in &discs {
            let (wide, flat) = if disc.is_edge { (WIDE[1], 0.9) } else { (WIDE[0], FLAT) };
            let wide = wide * disc.size;
            let (at, scales) = (disc.point.to_array(), [wide, wide, flat * wide]);
            out.push(&Splat {
                group: Group::Scene,
                ..surfel(at, (disc.normal, up), scales, disc.rgb, OPAQUE)
            });
        }
        let left = (0..splats.len()).filter(|index| stand_ins[*index] == StandIn::Itself);
        let rest = splats.select(&left.collect::<Vec<_>>());
        out.append(&rest);
        Self { splats: Cow::Owned(out), oriented: discs.len(), stand_ins }
    }
}

/// The evidence of all cameras about a point: numbers of cameras.
#[derive(Clone, Copy, Debug, Default)]
struct Said {
    seen: u32,
    through: u32,
    /// Of those, to a floor.
    floor: u32,
}

impl Said {
    fn add(&mut self, word: Word) {
        let (count, floor) = match word {
            Word::Seen { floor } => (&mut self.seen, floor),
            Word::Through { floor } => (&mut self.through, floor),
            Word::Nothing => return,
        };
        *count += 1;
        self.floor += u32::from(floor);
    }

    /// Returns true if cameras see through the point.
    fn is_free(self) -> bool {
        self.through >= CAMERAS && self.through > self.seen
    }

    fn stand_in(self) -> StandIn {
        match self {
            _ if self.seen == 0 && !self.is_free() => StandIn::Itself,
            _ if 2 * self.floor > self.seen + self.through => StandIn::Floor,
            _ => StandIn::Discs,
        }
    }
}

/// Returns true if pixels of this width, m, are fused.
fn is_near(width: f64) -> bool {
    PIXELS * width <= CUBE * f64::from(1 << DOUBLED)
}

/// A piece of a surface.
#[derive(Clone, Copy, Debug)]
struct Disc {
    /// World, scene units.
    point: DVec3,
    /// To where it was seen from, length 1.
    normal: DVec3,
    /// Returns true if its normal is not known.
    is_edge: bool,
    /// Width of its cube, scene units.
    size: f64,
    /// Its weight: pixels of the smallest cube's width.
    weight: f64,
    rgb: [f32; 3],
}

/// The content of a cube: sums over pixels.
#[derive(Clone, Copy, Debug)]
struct Cube {
    doubled: u32,
    at: I64Vec3,
    weight: f64,
    /// From the cube's corner, scene units.
    place: DVec3,
    normal: DVec3,
    /// Weight of those with a normal.
    known: f64,
    rgb: [f64; 3],
}

impl Cube {
    /// Of one pixel.
    fn of(spot: &Spot, cube: f64) -> Option<Self> {
        let apart = PIXELS * spot.apart;
        let doubled = (apart / cube).log2().ceil().max(0.0) as u32;
        if doubled > DOUBLED {
            return None;
        }
        let size = cube * f64::from(1 << doubled);
        let at = (spot.point / size).floor();
        let weight = (cube / apart).powi(2).min(16.0) * if spot.normal.is_some() { 1.0 } else { EDGE };
        Some(Self {
            doubled,
            at: at.as_i64vec3(),
            weight,
            place: (spot.point - at * size) * weight,
            normal: spot.normal.unwrap_or(-spot.ray) * weight,
            known: if spot.normal.is_some() { weight } else { 0.0 },
            rgb: spot.rgb.map(|v| f64::from(v) * weight),
        })
    }

    fn key(&self) -> (u32, [i64; 3]) {
        (self.doubled, self.at.to_array())
    }

    fn add(&mut self, other: &Self) {
        self.weight += other.weight;
        self.place += other.place;
        self.normal += other.normal;
        self.known += other.known;
        self.rgb.iter_mut().zip(other.rgb).for_each(|(sum, value)| *sum += value);
    }

    fn disc(&self, cube: f64) -> Disc {
        let size = cube * f64::from(1 << self.doubled);
        Disc {
            point: self.at.as_dvec3() * size + self.place / self.weight,
            normal: self.normal.normalize_or(DVec3::Z),
            is_edge: self.known < 0.5 * self.weight || self.normal.length() < 0.5 * self.weight,
            size,
            weight: self.weight,
            rgb: self.rgb.map(|v| (v / self.weight) as f32),
        }
    }
}

/// Adds up what is in the same cubes.
fn merged(mut cubes: Vec<Cube>) -> Vec<Cube> {
    cubes.sort_by_key(Cube::key);
    let mut out: Vec<Cube> = Vec::new();
    for cube in cubes {
        match out.last_mut() {
            Some(last) if last.key() == cube.key() => last.add(&cube),
            _ => out.push(cube),
        }
    }
    out
}

/// Fuses the surfaces of all cameras in cubes; wide ones only where there are no narrow ones.
fn fuse(views: &[PhotoView], cube: f64, threads: usize) -> Vec<Disc> {
    let each = map(views.len(), threads, |index| {
        let mut cubes = Vec::new();
        views[index].each_spot(|spot| cubes.extend(Cube::of(&spot, cube)));
        merged(cubes)
    });
    let cubes = merged(each.concat());
    let mut finer: Vec<(u32, [i64; 3])> = Vec::new();
    for Cube { doubled, at, .. } in &cubes {
        finer.extend((1..=DOUBLED - doubled).map(|k| (doubled + k, at.to_array().map(|v| v >> k))));
    }
    finer.sort_unstable();
    finer.dedup();
    let is_finest = |cube: &&Cube| finer.binary_search(&cube.key()).is_err();
    cubes.iter().filter(is_finest).map(|it| it.disc(cube)).collect()
}
