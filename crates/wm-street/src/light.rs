//! Light: the sun with soft shadows, light gathered from the sky and from what it shines on.
//!
//! A surface of albedo `rho` and irradiance `E` sends out `rho E / pi`; all surfaces are matt but
//! panes, which mirror by Schlick's formula. The sun is a disc three times as wide as the real one.
//! Sky light is a cosine-weighted average over stratified directions turned by a hash of the
//! position. A gathered ray that hits something takes that surface's light from a coarse map made
//! once (sun and sky a cell): so sunny walls and ground brighten the shade across the street.

use super::build::Builder;
use super::hash::{key_of, unit};
use super::light_map::{Budget, LightMap};
use super::paint::{Label, Material};
use super::place::{Place, Sights};
use super::shape::{Crossing, Shape, Spot, around};
use super::sky::{self, Lighting};
use super::texture::{self, Site};
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// Rays that [`Place::cast`] spends on the light of a point.
pub(crate) const CAST_BUDGET: Budget = Budget { sun: 2, sky: 12 };
/// Rays on the light of a point where several rays make a pixel: the mean is as smooth.
pub(crate) const SHARED_BUDGET: Budget = Budget { sun: 1, sky: 3 };
/// Footprint of a cast ray per metre of length: a pixel of a picture about 1000 px high.
const RAY_FOOTPRINT: f64 = 0.0012;
/// Half the sun's apparent width, radians.
const SUN_RADIUS_RAD: f64 = 0.014;
/// The distance from their surface at which rays start, m.
const RAY_OFFSET_M: f64 = 1.5e-3;
/// Irradiance of leaves and small things, which have no cells in the map.
const IRRADIANCE_WITHOUT_CELLS: DVec3 = DVec3::new(1.55, 1.60, 1.60);
/// Distance below which a surface covers a point as if it were inside, m.
const COVERED_DISTANCE_M: f64 = 0.018;
/// Least area of a primitive with cells, m^2: little light comes off smaller ones.
const MIN_CELL_AREA_M2: f64 = 0.25;
/// Light that gathered rays bring from surfaces while the map is being made: albedo 0.3 of this.
const SUNNY_IRRADIANCE_GUESS: DVec3 = DVec3::new(2.0, 1.95, 1.85);

/// Both under an overcast sky: half of its level irradiance.
const OVERCAST_IRRADIANCE_GUESS: DVec3 = DVec3::new(2.11, 2.16, 2.25);

/// A surface that a ray meets, with its light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LitHit {
    /// Distance along the ray, m.
    pub t: f64,
    /// The point, world axes, m.
    pub point: DVec3,
    /// Normal of the geometry on the side that the ray comes from, length 1.
    pub normal: DVec3,
    /// The material of the surface.
    pub material: Material,
    /// The kind of thing that it belongs to.
    pub label: Label,
    /// Linear radiance towards the ray's origin; see [`crate::tone::display_of`].
    pub radiance: [f64; 3],
}

/// Rotation and shift of a point's set of rays against its neighbours', both 0-1.
#[derive(Clone, Copy, Debug)]
pub(super) struct RayRotation {
    angle: f64,
    shift: f64,
}

impl RayRotation {
    /// Hashes the position: neighbours differ at random.
    fn at(point: DVec3) -> Self {
        let key = key_of(point);
        Self { angle: unit(key, 3), shift: unit(key, 4) }
    }

    /// By the place in a grid: neighbours differ as much as can be, so that their mean is as good
    /// as many more rays (steps from the plastic number's powers).
    pub(super) fn of_cell(column: usize, row: usize, key: u64) -> Self {
        let (x, y) = (column as f64, row as f64);
        Self {
            angle: (unit(key, 3) + 0.754_877_67 * x + 0.569_840_29 * y).fract(),
            shift: (unit(key, 4) + 0.819_172_51 * x + 0.671_043_61 * y).fract(),
        }
    }
}

impl LightMap {
    /// Makes the map of `scene`, whose own map is still empty.
    pub(super) fn of(scene: &Place) -> Self {
        let mut grids = Vec::with_capacity(scene.primitives.len());
        // Each cell with its primitive, column and row.
        let mut cells: Vec<(usize, u16, u16)> = Vec::new();
        for (which, primitive) in scene.primitives.iter().enumerate() {
            let first = cells.len() as u32;
            let foliage = scene.paints[usize::from(primitive.paint)].material.is_foliage();
            if foliage || primitive.shape.area() < MIN_CELL_AREA_M2 {
                grids.push((first, 0, 0));
                continue;
            }
            let (nu, nv) = grid_of(&primitive.shape);
            grids.push((first, nu, nv));
            cells.extend((0..nv).flat_map(|row| (0..nu).map(move |column| (which, column, row))));
        }
        let lit = cells.into_par_iter().map(|(which, column, row)| {
            let (_, nu, nv) = grids[which];
            let (a, b) = (f64::from(column) / f64::from(nu), f64::from(row) / f64::from(nv));
            let size = DVec2::new(1.0 / f64::from(nu), 1.0 / f64::from(nv));
            scene.cell_light(&scene.primitives[which].shape, DVec2::new(a, b), size)
        });
        let cells = lit.collect();
        Self { grids, cells }
    }
}

/// Cells of about a metre, more than that where it would take too many.
fn grid_of(shape: &Shape) -> (u16, u16) {
    match shape {
        Shape::Flat { u, v, .. } => {
            let size = (u.length() * v.length() / 1500.0).sqrt().max(1.0);
            (((u.length() / size).ceil() as u16).max(1), ((v.length() / size).ceil() as u16).max(1))
        }
        Shape::Stump { .. } => (4, 1),
        Shape::Ellipsoid { .. } => (4, 3),
    }
}

impl Place {
    pub(crate) fn of(name: &'static str, builder: Builder, sights: Sights) -> Self {
        Self::unlit(name, builder, sights).in_light(Lighting::default())
    }

    /// Returns the place in other light.
    #[must_use]
    pub fn in_light(mut self, lighting: Lighting) -> Self {
        (self.lighting, self.light) = (lighting, LightMap::default());
        self.light = LightMap::of(&self);
        self
    }

    /// The first surface along a ray, with its light; `None` where the ray ends in the sky.
    ///
    /// `direction` need not have length 1; `t` is in metres all the same.
    #[must_use]
    pub fn cast(&self, origin: DVec3, direction: DVec3) -> Option<LitHit> {
        self.cast_with(origin, direction, CAST_BUDGET)
    }

    pub(crate) fn cast_with(&self, origin: DVec3, direction: DVec3, budget: Budget) -> Option<LitHit> {
        let direction = direction.try_normalize()?;
        let (which, crossing) = self.nearest(origin, direction, f64::INFINITY)?;
        Some(self.hit(which, &crossing, origin, direction, budget, RAY_FOOTPRINT))
    }

    /// The reflectance of the nearest surface along a ray, linear RGB, 0-1; `None` of the sky.
    #[must_use]
    pub fn reflectance(&self, origin: DVec3, direction: DVec3) -> Option<[f64; 3]> {
        let (which, crossing) = self.nearest(origin, direction, f64::INFINITY)?;
        let unit = DVec2::new(crossing.a, crossing.b);
        let point = origin + direction * crossing.t;
        let spot = Spot { point, ..self.primitives[which].shape.spot_anywhere(unit.x, unit.y) };
        Some(self.skin(which, &spot, unit, (RAY_FOOTPRINT * crossing.t).max(1e-3)).albedo.to_array())
    }

    /// The light of a crossing; `footprint` is the width of the ray per metre of its length.
    pub(crate) fn hit(
        &self,
        which: usize,
        crossing: &Crossing,
        origin: DVec3,
        direction: DVec3,
        budget: Budget,
        footprint: f64,
    ) -> LitHit {
        let point = origin + direction * crossing.t;
        let unit = DVec2::new(crossing.a, crossing.b);
        let spot = Spot { point, ..self.primitives[which].shape.spot_anywhere(unit.x, unit.y) };
        let normal = if spot.normal.dot(direction) > 0.0 { -spot.normal } else { spot.normal };
        let slant = normal.dot(direction).abs().max(0.1);
        let width = (footprint * crossing.t / slant.sqrt()).max(1e-3);
        let radiance = self.shade(which, &spot, unit, direction, width, budget).to_array();
        let (material, label) = self.matter(which, point);
        LitHit { t: crossing.t, point, normal, material, label, radiance }
    }

    fn first_guess(&self) -> DVec3 {
        match self.lighting {
            Lighting::Sunny => SUNNY_IRRADIANCE_GUESS,
            Lighting::Overcast => OVERCAST_IRRADIANCE_GUESS,
        }
    }

    fn off_the_map(&self) -> DVec3 {
        match self.lighting {
            Lighting::Sunny => IRRADIANCE_WITHOUT_CELLS,
            Lighting::Overcast => OVERCAST_IRRADIANCE_GUESS,
        }
    }

    /// Mean irradiance of the cell at `corner` with `size`, both in surface coordinates.
    fn cell_light(&self, shape: &Shape, corner: DVec2, size: DVec2) -> [f32; 3] {
        let (mut sun, mut found) = (DVec3::ZERO, 0.0);
        let mut sky = DVec3::ZERO;
        for (x, y) in [(0.25, 0.3), (0.7, 0.2), (0.35, 0.75), (0.8, 0.7)] {
            let Some(spot) = shape.spot(corner.x + x * size.x, corner.y + y * size.y) else { continue };
            let turn = RayRotation::at(spot.point);
            found += 1.0;
            let cosine = spot.normal.dot(sky::sun()).max(0.0);
            if cosine > 0.0 {
                sun += self.lighting.sun() * (cosine * self.sun_share(spot.point, spot.normal, turn, 1));
            }
            if found == 2.0 || shape.spot(corner.x + 0.7 * size.x, corner.y + 0.2 * size.y).is_none() {
                sky = self.gather(spot.point, spot.normal, turn, 9).irradiance;
            }
        }
        let total = if found > 0.0 { sun / found + sky } else { self.first_guess() };
        total.as_vec3().to_array()
    }

    /// The share of the sun's disc that is seen from `point`, by `rays` rays.
    fn sun_share(&self, point: DVec3, normal: DVec3, turn: RayRotation, rays: u32) -> f64 {
        let toward = sky::sun();
        let (x, y) = around(toward);
        let origin = point + normal * (RAY_OFFSET_M * normal.dot(toward).signum());
        let mut seen = 0.0;
        for ray in 0..rays {
            let radius = SUN_RADIUS_RAD * ((f64::from(ray) + turn.shift) / f64::from(rays)).sqrt();
            let (sin, cos) = (TAU * (turn.angle + 0.618_034 * f64::from(ray))).sin_cos();
            let direction = (toward + (x * cos + y * sin) * radius).normalize();
            if !self.blocked(origin, direction, f64::INFINITY) {
                seen += 1.0;
            }
        }
        seen / f64::from(rays)
    }

    /// Returns 1 if one ray to a random point of the sun's disc is free, else 0.
    pub(super) fn sun_at(&self, point: DVec3, normal: DVec3) -> f64 {
        self.sun_share(point, normal, RayRotation::at(point), 1)
    }

    /// Light from all sides but the sun, gathered by `rays` rays over the side of `normal`.
    fn gather(&self, point: DVec3, normal: DVec3, turn: RayRotation, rays: u32) -> GatheredLight {
        let (x, y) = around(normal);
        let origin = point + normal * RAY_OFFSET_M;
        let mut gathered = GatheredLight { irradiance: DVec3::ZERO, buried: 0.0 };
        let share = 1.0 / f64::from(rays);
        for ray in 0..rays {
            let square = (f64::from(ray) + turn.shift) * share;
            let (sin, cos) = (TAU * (turn.angle + 0.618_034 * f64::from(ray))).sin_cos();
            let r = square.sqrt();
            let direction = x * (r * cos) + y * (r * sin) + normal * (1.0 - square).sqrt();
            match self.bounce(origin, direction) {
                Some(radiance) => gathered.irradiance += radiance * (PI * share),
                None => gathered.buried += share,
            }
        }
        gathered
    }

    /// Radiance that comes in along a ray, coarsely; `None` from the inside of something solid or
    /// right under it.
    fn bounce(&self, origin: DVec3, direction: DVec3) -> Option<DVec3> {
        let Some((which, crossing)) = self.nearest(origin, direction, f64::INFINITY) else {
            return Some(self.lighting.smooth(direction));
        };
        let primitive = &self.primitives[which];
        let paint = &self.paints[usize::from(primitive.paint)];
        let outward = primitive.shape.spot_anywhere(crossing.a, crossing.b).normal;
        let inside = outward.dot(direction) > 0.0 || crossing.t < COVERED_DISTANCE_M;
        if inside && !paint.material.is_sheet() {
            return None;
        }
        if self.light.grids.is_empty() {
            return Some(self.first_guess() * (0.3 / PI));
        }
        let light = self.light.at(which, crossing.a, crossing.b).unwrap_or_else(|| self.off_the_map());
        Some(texture::mean(paint) * light / PI)
    }

    /// Linear radiance that primitive `which` sends from `spot` against `direction`.
    ///
    /// `width` is the footprint, m; `unit` the surface coordinates of the spot.
    pub(super) fn shade(
        &self,
        which: usize,
        spot: &Spot,
        unit_at: DVec2,
        direction: DVec3,
        width: f64,
        budget: Budget,
    ) -> DVec3 {
        let (light, skin) = (
            self.incident(which, spot, direction, RayRotation::at(spot.point), budget),
            self.skin(which, spot, unit_at, width),
        );
        self.reflect(which, spot, direction, &light, &skin)
    }

    /// The light that arrives at a spot, seen along `direction`.
    pub(super) fn incident(
        &self,
        which: usize,
        spot: &Spot,
        direction: DVec3,
        turn: RayRotation,
        budget: Budget,
    ) -> Incident {
        let material = self.material(which);
        let facing = if spot.normal.dot(direction) > 0.0 { -spot.normal } else { spot.normal };
        let sun = if material.is_foliage() || facing.dot(sky::sun()) > 0.0 {
            self.sun_share(spot.point, facing, turn, budget.sun)
        } else {
            0.0
        };
        // Leaves shine through, so light from above counts on both their sides.
        let toward = if material.is_foliage() { (facing + DVec3::Z * 0.7).normalize() } else { facing };
        let gathered = self.gather(spot.point, toward, turn, budget.sky);
        Incident { facing, sun, sky: gathered.irradiance, buried: gathered.buried }
    }

    /// The texture at a spot.
    pub(super) fn skin(&self, which: usize, spot: &Spot, unit: DVec2, width: f64) -> texture::Skin {
        let primitive = &self.primitives[which];
        let paint = self.paint(which, spot.point);
        let local = match primitive.shape {
            Shape::Stump { .. } => DVec2::new(unit.x * spot.along_a.length(), unit.y * spot.along_b.length()),
            _ => {
                let (across, up) = tangents(spot.normal);
                DVec2::new(spot.point.dot(across), spot.point.dot(up))
            }
        };
        let at = Site { point: spot.point, local, unit, width, key: primitive.key };
        texture::skin(&paint, &at)
    }

    /// The radiance of a spot of the given texture under its light.
    pub(super) fn reflect(
        &self,
        which: usize,
        spot: &Spot,
        direction: DVec3,
        light: &Incident,
        skin: &texture::Skin,
    ) -> DVec3 {
        let (material, facing, sun) = (self.material(which), light.facing, sky::sun());
        if material.is_foliage() {
            let cosine = facing.dot(sun);
            // Light through a leaf is weaker and more yellow than light off it.
            let through = DVec3::new(0.80, 0.85, 0.35) * (-cosine).max(0.0);
            let direct = self.lighting.sun() * (light.sun * 0.95) * (DVec3::splat(cosine.max(0.0)) + through);
            return skin.albedo * (direct + light.sky * 1.1) / PI;
        }
        let (across, up) = tangents(spot.normal);
        let bumped = (facing - across * skin.slope.x - up * skin.slope.y).normalize();
        let cosine = bumped.dot(sun).max(0.0) * f64::from(u8::from(facing.dot(sun) > 0.0));
        // Relief also turns a face to or from the brighter upper half of the surroundings.
        let tilt = 1.0 + 0.5 * (bumped.z - facing.z);
        let matt = skin.albedo * (self.lighting.sun() * (cosine * light.sun) + light.sky * tilt) / PI;
        // A pane is a plane and has two faces; water has ripples.
        let (mirror, least) = match material {
            Material::Glass => (facing, 0.07),
            Material::Water => (bumped, 0.02),
            _ => return matt,
        };
        let mut mirrored = direction - mirror * (2.0 * direction.dot(mirror));
        if material == Material::Water {
            // No ripple is so steep that it mirrors what is below.
            mirrored.z = mirrored.z.max(0.02);
            mirrored = mirrored.normalize();
        }
        let cosine = -direction.dot(mirror);
        let share = least + (1.0 - least) * (1.0 - cosine.clamp(0.0, 1.0)).powi(5);
        let seen = match self.nearest(spot.point + facing * RAY_OFFSET_M, mirrored, f64::INFINITY) {
            None => self.sky_in(mirrored),
            Some(_) => self.bounce(spot.point + facing * RAY_OFFSET_M, mirrored).unwrap_or(DVec3::ZERO),
        };
        matt * (1.0 - share) + seen * share
    }
}

/// The light that [`Place::gather`] found.
pub(super) struct GatheredLight {
    /// Irradiance without the sun.
    irradiance: DVec3,
    /// The share of rays that met the inside of something: a buried point has a large one.
    buried: f64,
}

/// The light at a spot.
pub(super) struct Incident {
    /// The normal on the side that is seen.
    pub(crate) facing: DVec3,
    /// The share of the sun that is seen.
    pub(crate) sun: f64,
    /// Irradiance from all else.
    sky: DVec3,
    /// The share of rays that are buried, as [`GatheredLight::buried`].
    pub(crate) buried: f64,
}

/// Unit vectors across and up a surface of the given normal; x and y on level ground.
fn tangents(normal: DVec3) -> (DVec3, DVec3) {
    if normal.z.abs() > 0.98 {
        return (DVec3::X, DVec3::Y);
    }
    let across = DVec3::new(-normal.y, normal.x, 0.0).normalize();
    (across, normal.cross(across))
}
