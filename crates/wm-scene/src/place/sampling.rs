//! The place as Gaussians.
//!
//! Surfaces are cut into patches, and each patch into a staggered grid of cells. A cell becomes a flat
//! Gaussian on the surface with standard deviations of [`SPREAD`] cells: neighbours then close the
//! surface, and the picture stays sharp. Cells are of about equal size as seen from the walk along
//! the street: they grow with the distance, with the slant they are seen at, and on faces turned
//! away. A leaf is one Gaussian; thin stems are rods. The sky is a shell of Gaussians far away.
//!
//! Splat `index` is a function of the place's seed, the detail and `index` alone.

use super::hash::{bits, unit};
use super::light::{Budget, Turn};
use super::shape::{Outline, Shape, Spot};
use super::{Place, display_of};
use crate::splats::Splat;
use crate::{Group, Splats, quat, splats};
use glam::{DMat3, DQuat, DVec2, DVec3};
use std::f64::consts::TAU;
use std::ops::Range;

/// Size of a cell per metre of distance, at detail 1.
const ANGLE: f64 = 0.0064;
/// The finest cell at detail 1, m.
const FINEST: f64 = 0.03;
/// Standard deviation of a splat, cells.
const SPREAD: f64 = 0.66;
/// How much a cell's colour is pushed away from that around it.
const SHARPEN: f64 = 0.55;
/// Where the walk along the street begins and ends, and its height, m.
const WALK: (f64, f64, f64) = (-2.0, 36.0, 1.6);
/// Splats of the sky at detail 1.
const SKY: f64 = 32_000.0;
/// Radius of the sky, m.
const SKY_RADIUS: f64 = 1000.0;
/// The sky's lower edge, as the sine of its angle: 6 degrees below the horizon.
const SKY_EDGE: f64 = -0.1045;
/// Points that see more than this of the inside of things are dropped.
const BURIED: f64 = 0.45;

/// A rectangle of a primitive's surface, cut into `nu` x `nv` cells.
#[derive(Clone, Copy, Debug)]
struct Patch {
    place: u32,
    kind: Cell,
    low: [f32; 2],
    size: [f32; 2],
    nu: u32,
    nv: u32,
    first: usize,
    /// A Gaussian's distance from the primitive's edges is at least this many standard deviations.
    reserve: f32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Cell {
    /// A disc on the surface.
    Disc,
    /// A whole leaf.
    Leaf,
    /// A piece of a stem too thin for discs.
    Rod,
    /// A whole small ball.
    Ball,
}

/// The splats of a place at one detail.
#[derive(Clone, Debug)]
pub struct Sampling<'a> {
    place: &'a Place,
    patches: Vec<Patch>,
    surface: usize,
    sky: usize,
}

impl Place {
    /// Plans the splats; `detail` 1 is the default, 2 halves the spacing (4 times the splats).
    ///
    /// # Panics
    /// If `detail` is not between 0.05 and 10.
    #[must_use]
    pub fn sampling(&self, detail: f64) -> Sampling<'_> {
        assert!((0.05..=10.0).contains(&detail), "detail {detail} is not between 0.05 and 10");
        let mut sampling = Sampling { place: self, patches: Vec::new(), surface: 0, sky: 0 };
        for place in 0..self.primitives.len() {
            sampling.cover(place, [0.0; 2], [1.0; 2], detail);
        }
        sampling.sky = (SKY * detail.min(1.5).powi(2)).ceil() as usize;
        sampling
    }
}

impl Sampling<'_> {
    /// Number of indices; some of them give no splat.
    #[must_use]
    pub fn len(&self) -> usize {
        self.surface + self.sky
    }

    /// Whether there is no index at all.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Splat `index` of [`Self::len`]; `None` where the cell is hidden for good or outside the shape.
    #[must_use]
    pub fn splat(&self, index: usize) -> Option<Splat> {
        if index >= self.surface {
            return (index < self.len()).then(|| self.sky_splat(index - self.surface));
        }
        let patch = &self.patches[self.patches.partition_point(|patch| patch.first <= index) - 1];
        self.surface_splat(patch, index - patch.first)
    }

    /// The splats of `range` (cut off at [`Self::len`]), SH degree 0.
    #[must_use]
    pub fn splats_in(&self, range: Range<usize>) -> Splats {
        let range = range.start..range.end.min(self.len());
        let mut splats = Splats::with_capacity(range.len(), 0);
        for splat in range.filter_map(|index| self.splat(index)) {
            splats.push(&splat);
        }
        splats
    }

    /// Adds patches for the part of a primitive from `low` over `size`, halving what is large.
    fn cover(&mut self, place: usize, low: [f64; 2], size: [f64; 2], detail: f64) {
        let primitive = &self.place.primitives[place];
        let material = self.place.material(place);
        let spot = primitive.shape.spot_anywhere(low[0] + 0.5 * size[0], low[1] + 0.5 * size[1]);
        let mut patch = Patch {
            place: place as u32,
            kind: Cell::Disc,
            low: low.map(|v| v as f32),
            size: size.map(|v| v as f32),
            nu: 1,
            nv: 1,
            first: self.surface,
            reserve: 0.0,
        };
        let gap = Gap::at(&spot, matches!(primitive.shape, Shape::Flat { .. }), detail);
        match primitive.shape {
            Shape::Flat { u, v, .. } if material.is_foliage() && u.length().max(v.length()) < 4.0 => {
                patch.kind = Cell::Leaf;
            }
            Shape::Stump { from, to, radii } if TAU * radii[0].max(radii[1]) < 4.0 * gap.size => {
                // Twigs finer than a tenth of a cell are lost among the leaves.
                if material.is_bark() && radii[0] < 0.05 * gap.size {
                    return;
                }
                patch.kind = Cell::Rod;
                patch.nv = (from.distance(to) / (1.3 * gap.size).max(2.0 * radii[0])).ceil().max(1.0) as u32;
            }
            Shape::Ellipsoid { radii, .. } if radii.max_element() < 0.8 * gap.size => patch.kind = Cell::Ball,
            _ => {
                let grain = material.grain();
                let (lu, lv) = (spot.along_a.length() * size[0], spot.along_b.length() * size[1]);
                let (gu, gv) = (gap.along(spot.along_a) * grain, gap.along(spot.along_b) * grain);
                let longest = lu.max(lv);
                if longest > (0.3 * gap.distance).max(1.6) && longest > 4.0 * gu.min(gv) {
                    let half = if lu > lv { [0.5 * size[0], size[1]] } else { [size[0], 0.5 * size[1]] };
                    self.cover(place, low, half, detail);
                    let next = [low[0] + size[0] - half[0], low[1] + size[1] - half[1]];
                    return self.cover(place, next, half, detail);
                }
                // Slivers much finer than a cell: their neighbours cover them.
                if lu.min(lv) < 0.16 * gu.min(gv) && gap.distance > 4.0 {
                    return;
                }
                // Bars look the same all along, and much is never seen from the street.
                let bar = if gap.least < 1.0 && lu.min(lv) < 0.9 * gu.min(gv) { 2.4 } else { 1.0 };
                let unseen = lu * lv > 4.0 * gu * gv && !self.place.is_seen(&patch);
                let far = if unseen { 2.4 } else { bar };
                // Coarse cells behind an edge would show around it; grounds go on in their neighbours.
                patch.reserve = if unseen || gap.away {
                    1.7
                } else if spot.normal.z > 0.9 {
                    0.0
                } else {
                    0.9
                };
                let cells = |length: f64, gap: f64| (length / (gap * far)).round().max(1.0) as u32;
                (patch.nu, patch.nv) = (cells(lu, gu), cells(lv, gv));
            }
        }
        self.surface += patch.nu as usize * patch.nv as usize;
        self.patches.push(patch);
    }

    fn surface_splat(&self, patch: &Patch, cell: usize) -> Option<Splat> {
        let place = patch.place as usize;
        let shape = &self.place.primitives[place].shape;
        let (low, size) = (patch.low.map(f64::from), patch.size.map(f64::from));
        let step = DVec2::new(size[0] / f64::from(patch.nu), size[1] / f64::from(patch.nv));
        let (column, row) = (cell % patch.nu as usize, cell / patch.nu as usize);
        let key = bits(bits(self.place.seed, patch.place.into()), (patch.first + cell) as u64);
        // Every other row is shifted; a little jitter breaks up what regularity is left.
        let shift = if patch.nu < 3 { 0.0 } else { 0.5 * (row % 2) as f64 - 0.25 };
        let jitter = |salt| 0.16 * (unit(key, salt) - 0.5) * f64::from(u8::from(patch.kind == Cell::Disc));
        let center = DVec2::new(low[0], low[1])
            + step * DVec2::new(column as f64 + 0.5 + shift + jitter(1), row as f64 + 0.5 + jitter(2));
        let spot = shape.spot(center.x, center.y)?;
        if spot.point.z < -0.002 {
            return None;
        }
        let viewer = viewer(spot.point);
        let (axes, sigmas, spot) = match patch.kind {
            Cell::Disc => disc(&spot, step, patch, shape.room(center.x, center.y)),
            Cell::Leaf => leaf(shape, &spot)?,
            Cell::Rod => rod(shape, &spot, center.y, step.y, viewer)?,
            Cell::Ball => ball(shape, viewer)?,
        };
        let direction = (spot.point - viewer).normalize_or(-spot.normal);
        let turn = Turn::of_cell(column, row, u64::from(patch.place));
        let cell = At { spot, center, step, turn, key };
        let radiance = self.radiance(patch, &cell, direction)?;
        let inner = matches!(patch.kind, Cell::Rod | Cell::Ball);
        let mean = if inner { spot.point - spot.normal * sigmas[0] } else { spot.point };
        let opacity = match patch.kind {
            Cell::Disc => 0.98,
            Cell::Leaf | Cell::Ball => 0.93,
            // Renderers draw nothing finer than a pixel: what is finer is made paler instead.
            Cell::Rod => 0.95 * (sigmas[0] / (0.0007 * spot.point.distance(viewer))).clamp(0.2, 1.0),
        };
        Some(Splat {
            mean: mean.as_vec3().to_array(),
            quat: {
                let q = DQuat::from_mat3(&axes);
                [q.w, q.x, q.y, q.z].map(|v| v as f32)
            },
            log_scale: sigmas.map(|sigma| sigma.max(1e-5).ln() as f32),
            logit_opacity: splats::logit(opacity) as f32,
            rgb: display_of(radiance.to_array()).map(|v| v as f32),
            group: Group::Scene,
        })
    }

    /// Mean radiance over a cell, sharpened against its surroundings by what the Gaussian will blur;
    /// `None` if it is buried in something.
    fn radiance(&self, patch: &Patch, cell: &At, direction: DVec3) -> Option<DVec3> {
        let (place, scene) = (patch.place as usize, self.place);
        let shape = &scene.primitives[place].shape;
        let At { spot, center, step, turn, .. } = *cell;
        if patch.kind != Cell::Disc {
            let light = scene.incident(place, &spot, direction, turn, Budget { sun: 2, sky: 7 });
            let skin = scene.skin(place, &spot, center, 0.02);
            return Some(scene.reflect(place, &spot, direction, &light, &skin));
        }
        let mut light = scene.incident(place, &spot, direction, turn, Budget { sun: 1, sky: 14 });
        if light.buried > BURIED {
            return None;
        }
        let width = (spot.along_a.length() * step.x).min(spot.along_b.length() * step.y) * 0.45;
        let sunny = light.facing.dot(super::sky::sun()) > 0.0;
        let mut mean = |offsets: &[(f64, f64); 4], salt: u64| {
            let (mut sum, mut found) = (DVec3::ZERO, 0.0);
            for (sample, (x, y)) in offsets.iter().enumerate() {
                let jitter = |axis: u64| 0.4 * (unit(cell.key, salt + 2 * sample as u64 + axis) - 0.5);
                let at = center + DVec2::new(x + jitter(0), y + jitter(1)) * step;
                let Some(here) = shape.spot(at.x, at.y) else { continue };
                if sunny {
                    light.sun = scene.sun_at(here.point, light.facing);
                }
                sum += scene.reflect(place, &here, direction, &light, &scene.skin(place, &here, at, width));
                found += 1.0;
            }
            (sum, found)
        };
        let (sum, found) = mean(&[(-0.27, -0.27), (0.27, -0.27), (-0.27, 0.27), (0.27, 0.27)], 10);
        if found == 0.0 {
            return None;
        }
        let inner = sum / found;
        let (ring, found) = mean(&[(-1.0, -0.35), (0.35, -1.0), (1.0, 0.35), (-0.35, 1.0)], 30);
        if found < 4.0 {
            return Some(inner);
        }
        Some((inner + (inner - ring / found) * SHARPEN).max(inner * 0.4))
    }

    fn sky_splat(&self, index: usize) -> Splat {
        let count = self.sky as f64;
        let z = SKY_EDGE + (1.0 - SKY_EDGE) * (index as f64 + 0.5) / count;
        let r = (1.0 - z * z).sqrt();
        let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
        let (sin, cos) = (golden * index as f64).rem_euclid(TAU).sin_cos();
        let direction = DVec3::new(r * cos, r * sin, z);
        let spacing = (TAU * (1.0 - SKY_EDGE) / count).sqrt();
        let (x, y) = super::shape::around(direction);
        let mut radiance = DVec3::ZERO;
        for (dx, dy) in [(-0.3, -0.15), (0.15, -0.3), (0.3, 0.15), (-0.15, 0.3)] {
            radiance += self.place.sky_in((direction + (x * dx + y * dy) * spacing).normalize()) * 0.25;
        }
        let sigma = (0.70 * spacing * SKY_RADIUS).ln() as f32;
        Splat {
            mean: (direction * SKY_RADIUS).as_vec3().to_array(),
            quat: quat::from_z_to((-direction).to_array()).map(|v| v as f32),
            log_scale: [sigma, sigma, sigma - 10f32.ln()],
            logit_opacity: splats::logit(0.98) as f32,
            rgb: display_of(radiance.to_array()).map(|v| v as f32),
            group: Group::Sky,
        }
    }
}

impl Place {
    /// Whether any part of a patch is seen from the walk.
    fn is_seen(&self, patch: &Patch) -> bool {
        let shape = &self.primitives[patch.place as usize].shape;
        let (low, size) = (patch.low.map(f64::from), patch.size.map(f64::from));
        for (a, b) in [(0.5, 0.5), (0.15, 0.2), (0.85, 0.15), (0.2, 0.85), (0.8, 0.8)] {
            let Some(spot) = shape.spot(low[0] + a * size[0], low[1] + b * size[1]) else { continue };
            let from = spot.point + spot.normal * 0.01;
            for step in 0..9 {
                let side = if step % 2 == 0 { 0.8 } else { -0.8 };
                let eye = DVec3::new(side, WALK.0 + (WALK.1 - WALK.0) * f64::from(step) / 8.0, WALK.2);
                let away = eye - from;
                if away.dot(spot.normal) > 0.0 && !self.blocked(from, away.normalize(), away.length()) {
                    return true;
                }
            }
        }
        false
    }
}

/// A cell's middle: where it is, its size in surface coordinates and its keys.
struct At {
    spot: Spot,
    center: DVec2,
    step: DVec2,
    turn: Turn,
    key: u64,
}

/// How far apart splats may be at a spot.
struct Gap {
    /// Cell size across the view, m.
    size: f64,
    /// How far the spot is from where it is looked at, m.
    distance: f64,
    /// From the viewer to the spot, length 1.
    direction: DVec3,
    /// Least foreshortening that is made use of.
    least: f64,
    /// Whether the whole walk lies behind the surface.
    away: bool,
}

impl Gap {
    /// `flat` surfaces are seen under one angle; round ones under all.
    fn at(spot: &Spot, flat: bool, detail: f64) -> Self {
        let eye = viewer(spot.point);
        let away = spot.point - eye;
        let distance = away.length().max(2.5);
        let mut size = ANGLE * distance;
        let ends = [DVec3::new(0.0, WALK.0, WALK.2), DVec3::new(0.0, WALK.1, WALK.2)];
        let away_from_all = flat && ends.iter().all(|end| spot.normal.dot(*end - spot.point) < 0.0);
        if away_from_all {
            size *= 1.8;
        }
        if spot.point.y < WALK.0 - 4.0 {
            size *= 1.7;
        }
        let least = if !flat {
            1.0
        } else if distance > 120.0 {
            0.05
        } else {
            0.42
        };
        Self {
            size: size.max(FINEST) / detail,
            distance,
            direction: away / away.length().max(1e-9),
            least,
            away: away_from_all,
        }
    }

    /// Cell size along a tangent: longer where it is seen slanted.
    fn along(&self, tangent: DVec3) -> f64 {
        let seen = tangent.normalize_or_zero().reject_from(self.direction).length();
        self.size / seen.clamp(self.least, 1.0).powf(0.85)
    }
}

/// From where on the walk a point is seen nearest within a picture that looks ahead.
fn viewer(point: DVec3) -> DVec3 {
    let aside = point.x.hypot(point.z - WALK.2);
    DVec3::new(0.0, (point.y - 1.25 * aside).clamp(WALK.0, WALK.1), WALK.2)
}

/// Axes, standard deviations and spot of a disc over one cell; `room` is what is left to the edges.
fn disc(spot: &Spot, step: DVec2, patch: &Patch, room: (f64, f64)) -> (DMat3, [f64; 3], Spot) {
    let x = spot.along_a.normalize_or(DVec3::X);
    let y = spot.normal.cross(x);
    let (lu, lv) = (spot.along_a.length(), spot.along_b.dot(y).abs());
    // A lone cell has no neighbours to reach to.
    let sigma = |count: u32, length: f64, step: f64, room: f64| {
        let wide = [0.40, 0.54, SPREAD][count.min(3) as usize - 1] * step;
        let most = room / f64::from(patch.reserve).max(1e-3);
        length * wide.min(most.max(0.25 * step))
    };
    let sigmas = [sigma(patch.nu, lu, step.x, room.0), sigma(patch.nv, lv, step.y, room.1)];
    let thin = 0.1 * (lu * step.x).min(lv * step.y);
    (DMat3::from_cols(x, y, spot.normal), [sigmas[0], sigmas[1], thin], *spot)
}

/// A leaf's own extent; lens shapes hold less than discs.
fn leaf(shape: &Shape, spot: &Spot) -> Option<(DMat3, [f64; 3], Spot)> {
    let Shape::Flat { outline, .. } = shape else { return None };
    let share = if *outline == Outline::Leaf { (0.30, 0.27) } else { (0.34, 0.34) };
    let x = spot.along_a.normalize_or(DVec3::X);
    let y = spot.normal.cross(x);
    let (long, wide) = (spot.along_a.length(), spot.along_b.dot(y).abs());
    let sigmas = [share.0 * long, share.1 * wide, 0.04 * wide];
    Some((DMat3::from_cols(x, y, spot.normal), sigmas, *spot))
}

/// A rod along a stump, lit on the side of the viewer.
fn rod(shape: &Shape, spot: &Spot, b: f64, step: f64, viewer: DVec3) -> Option<(DMat3, [f64; 3], Spot)> {
    let Shape::Stump { from, to, radii } = *shape else { return None };
    let axis = to - from;
    let z = axis.normalize();
    let middle = from + axis * b;
    let radius = radii[0] + (radii[1] - radii[0]) * b;
    let x = (viewer - middle).reject_from(z).try_normalize()?;
    let y = z.cross(x);
    let seen = Spot { point: middle + x * radius, normal: x, ..*spot };
    let sigmas = [0.62 * radius, 0.62 * radius, 0.5 * axis.length() * step];
    Some((DMat3::from_cols(x, y, z), sigmas, seen))
}

/// A small ball, lit on the side of the viewer.
fn ball(shape: &Shape, viewer: DVec3) -> Option<(DMat3, [f64; 3], Spot)> {
    let Shape::Ellipsoid { center, radii } = *shape else { return None };
    let normal = (viewer - center).try_normalize()?;
    let (x, y) = super::shape::around(normal);
    let seen = Spot { point: center + normal * radii.min_element(), normal, along_a: x, along_b: y };
    Some((DMat3::IDENTITY, (radii * 0.62).to_array(), seen))
}

#[cfg(test)]
mod stats {
    use super::*;
    #[test]
    fn stats() {
        let t = std::time::Instant::now();
        let place = Place::street();
        println!("built {:?}, {} primitives, {:?}", t.elapsed(), place.primitives.len(), place.light.size());
        let s = place.sampling(1.0);
        let mut by = std::collections::BTreeMap::new();
        for p in &s.patches {
            let m = place.material(p.place as usize);
            let spot = place.primitives[p.place as usize]
                .shape
                .spot_anywhere(f64::from(p.low[0] + 0.5 * p.size[0]), f64::from(p.low[1] + 0.5 * p.size[1]));
            let y = spot.point.y;
            let zone = if spot.point.length() > 150.0 {
                "far"
            } else if y < -6.0 {
                "behind"
            } else if y < 60.0 {
                "near"
            } else {
                "mid"
            };
            let ends = [DVec3::new(0.0, WALK.0, WALK.2), DVec3::new(0.0, WALK.1, WALK.2)];
            let away = ends.iter().all(|end| spot.normal.dot(*end - spot.point) < 0.0);
            let e =
                by.entry((format!("{m:?}"), zone, away && p.kind == Cell::Disc)).or_insert((0usize, 0usize));
            e.0 += 1;
            e.1 += (p.nu * p.nv) as usize;
        }
        let mut v: Vec<_> = by.into_iter().collect();
        v.sort_by_key(|(_, c)| std::cmp::Reverse(c.1));
        for (k, c) in v.iter().take(45) {
            println!("{:?} patches {} cells {}", k, c.0, c.1);
        }
        println!("total {}", s.len());
    }
}
