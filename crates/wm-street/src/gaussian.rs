//! One cell of the sampling as a Gaussian: its extent, its colour.

use super::hash::{bits, unit};
use super::light::RayRotation;
use super::light_map::Budget;
use super::sampling::{Cell, Patch, SplatSampling};
use super::shape::{Outline, Shape, Spot, around};
use super::{display_of, sky};
use glam::{DMat3, DQuat, DVec2, DVec3};
use std::f64::consts::TAU;
use wm_scene::splats::Splat;
use wm_scene::{Group, quat, splats};

/// Standard deviation of a splat, cells.
const SPLAT_SIGMA_CELLS: f64 = 0.66;
/// Sharpening: the share by which a cell's colour is pushed away from its surroundings.
const SHARPENING_SHARE: f64 = 0.55;
/// Radius of the sky, m.
const SKY_RADIUS_M: f64 = 1000.0;
/// The sky's lower edge, as the sine of its angle: 6 degrees below the horizon.
const SKY_EDGE_SINE: f64 = -0.1045;
/// Largest share of rays to the inside of things with which a point is kept.
const MAX_BURIED_SHARE: f64 = 0.75;

/// The centre of a cell with its size in surface coordinates and its keys.
struct CellCenter {
    spot: Spot,
    center: DVec2,
    step: DVec2,
    turn: RayRotation,
    key: u64,
}

impl SplatSampling<'_> {
    /// The Gaussian of cell `cell` of a patch; `None` if it is outside the outline or buried.
    pub(super) fn surface_splat(&self, patch: &Patch, cell: usize) -> Option<Splat> {
        let shape = &self.place.primitives[patch.which as usize].shape;
        let (low, size) = (patch.low.map(f64::from), patch.size.map(f64::from));
        let step = DVec2::new(size[0] / f64::from(patch.nu), size[1] / f64::from(patch.nv));
        let (column, row) = (cell % patch.nu as usize, cell / patch.nu as usize);
        let key = bits(bits(self.place.seed, patch.which.into()), (patch.first + cell) as u64);
        // Every other row is shifted; a little jitter breaks up what regularity is left.
        let shift = if patch.nu < 3 { 0.0 } else { 0.5 * (row % 2) as f64 - 0.25 };
        let jitter = |salt| 0.16 * (unit(key, salt) - 0.5) * f64::from(u8::from(patch.kind == Cell::Disc));
        let center = DVec2::new(low[0], low[1])
            + step * DVec2::new(column as f64 + 0.5 + shift + jitter(1), row as f64 + 0.5 + jitter(2));
        let spot = shape.spot(center.x, center.y)?;
        if spot.point.z < self.place.sights.lowest {
            return None;
        }
        let viewer = self.place.sights.audience.viewer(spot.point);
        let (axes, sigmas, spot) = match patch.kind {
            Cell::Disc => disc(&spot, step, patch, shape.room(center.x, center.y)),
            Cell::Leaf => leaf(shape, &spot)?,
            Cell::Rod => rod(shape, &spot, center.y, step.y, viewer)?,
            Cell::Ball => ball(shape, viewer)?,
        };
        let mut direction = (spot.point - viewer).normalize_or(-spot.normal);
        // What is solid is seen from its outside, from wherever that may be.
        if spot.normal.dot(direction) > 0.0 && !self.place.material(patch.which as usize).is_sheet() {
            direction = -spot.normal;
        }
        let turn = RayRotation::of_cell(column, row, u64::from(patch.which));
        let cell = CellCenter { spot, center, step, turn, key };
        let radiance = self.radiance(patch, &cell, direction)?;
        let inner = matches!(patch.kind, Cell::Rod | Cell::Ball);
        let mean = if inner { spot.point - spot.normal * sigmas[0] } else { spot.point };
        let opacity = match patch.kind {
            Cell::Disc => 0.98,
            Cell::Leaf | Cell::Ball => 0.93,
            // Renderers draw nothing finer than a pixel: what is finer is made paler instead.
            Cell::Rod => 0.95 * (sigmas[0] / (0.0007 * spot.point.distance(viewer))).clamp(0.2, 1.0),
        };
        let turn = DQuat::from_mat3(&axes);
        Some(Splat {
            mean: mean.as_vec3().to_array(),
            quat: [turn.w, turn.x, turn.y, turn.z].map(|v| v as f32),
            log_scale: sigmas.map(|sigma| sigma.max(1e-5).ln() as f32),
            logit_opacity: splats::logit(opacity) as f32,
            rgb: display_of(radiance.to_array()).map(|v| v as f32),
            group: Group::Scene,
        })
    }

    /// Mean radiance over a cell, sharpened against its surroundings by what the Gaussian will
    /// blur; `None` if it is buried in something.
    fn radiance(&self, patch: &Patch, cell: &CellCenter, direction: DVec3) -> Option<DVec3> {
        let (which, scene) = (patch.which as usize, self.place);
        let shape = &scene.primitives[which].shape;
        let CellCenter { spot, center, step, turn, .. } = *cell;
        if patch.kind != Cell::Disc {
            let light = scene.incident(which, &spot, direction, turn, Budget { sun: 2, sky: 7 });
            let skin = scene.skin(which, &spot, center, 0.02);
            return Some(scene.reflect(which, &spot, direction, &light, &skin));
        }
        let mut light = scene.incident(which, &spot, direction, turn, Budget { sun: 1, sky: 18 });
        if light.buried > MAX_BURIED_SHARE {
            return None;
        }
        let width = (spot.along_a.length() * step.x).min(spot.along_b.length() * step.y) * 0.45;
        let sunny = light.facing.dot(sky::sun()) > 0.0;
        let mut mean = |offsets: &[(f64, f64); 4], salt: u64| {
            let (mut sum, mut found) = (DVec3::ZERO, 0.0);
            for (sample, (x, y)) in offsets.iter().enumerate() {
                let jitter = |axis: u64| 0.4 * (unit(cell.key, salt + 2 * sample as u64 + axis) - 0.5);
                let at = center + DVec2::new(x + jitter(0), y + jitter(1)) * step;
                let Some(here) = shape.spot(at.x, at.y) else { continue };
                if sunny {
                    light.sun = scene.sun_at(here.point, light.facing);
                }
                sum += scene.reflect(which, &here, direction, &light, &scene.skin(which, &here, at, width));
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
        Some((inner + (inner - ring / found) * SHARPENING_SHARE).max(inner * 0.4))
    }

    /// Splat `index` of the sky: a spiral over the sphere from the lower edge up.
    pub(super) fn sky_splat(&self, index: usize) -> Splat {
        let count = self.sky as f64;
        let z = SKY_EDGE_SINE + (1.0 - SKY_EDGE_SINE) * (index as f64 + 0.5) / count;
        let r = (1.0 - z * z).sqrt();
        let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
        let (sin, cos) = (golden * index as f64).rem_euclid(TAU).sin_cos();
        let direction = DVec3::new(r * cos, r * sin, z);
        let spacing = (TAU * (1.0 - SKY_EDGE_SINE) / count).sqrt();
        let (x, y) = around(direction);
        let mut radiance = DVec3::ZERO;
        for (dx, dy) in [(-0.3, -0.15), (0.15, -0.3), (0.3, 0.15), (-0.15, 0.3)] {
            radiance += self.place.sky_in((direction + (x * dx + y * dy) * spacing).normalize()) * 0.25;
        }
        // Wide enough that the gaps between neighbours stay below one step of 8 bits.
        let sigma = (0.95 * spacing * SKY_RADIUS_M).ln() as f32;
        Splat {
            mean: (direction * SKY_RADIUS_M).as_vec3().to_array(),
            quat: quat::from_z_to((-direction).to_array()).map(|v| v as f32),
            log_scale: [sigma, sigma, sigma - 10f32.ln()],
            logit_opacity: splats::logit(0.98) as f32,
            rgb: display_of(radiance.to_array()).map(|v| v as f32),
            group: Group::Sky,
        }
    }
}

/// Axes, standard deviations and spot of a disc over one cell; `room` is what is left to the edges.
fn disc(spot: &Spot, step: DVec2, patch: &Patch, room: (f64, f64)) -> (DMat3, [f64; 3], Spot) {
    let x = spot.along_a.normalize_or(DVec3::X);
    let y = spot.normal.cross(x);
    let (lu, lv) = (spot.along_a.length(), spot.along_b.dot(y).abs());
    // A lone cell has no neighbours to reach to.
    let sigma = |count: u32, length: f64, step: f64, room: f64| {
        let wide = [0.40, 0.54, SPLAT_SIGMA_CELLS][count.min(3) as usize - 1] * step;
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
    let (x, y) = around(normal);
    let seen = Spot { point: center + normal * radii.min_element(), normal, along_a: x, along_b: y };
    Some((DMat3::IDENTITY, (radii * 0.62).to_array(), seen))
}
