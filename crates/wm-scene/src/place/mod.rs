//! The built-in place: a procedural street that needs no download.
//!
//! A village street of about 150 m runs along +y between houses, gardens and trees; fields, a church
//! and hills lie beyond, so that fog has depth to act on and haze shows. It is analytic geometry with
//! procedural textures and baked light, and serves twice: [`Sampling`] turns it into Gaussians, and
//! [`Place::photo`] into pictures with exact depth, normals, materials and sky, as a camera would
//! have taken them. Metres, z up, the carriageway at z = 0.
//!
//! Everything is a function of the seed alone; nothing depends on the order or the number of threads.
//!
//! - [`Place::cast`] and [`Place::sky`]: linear radiance along a ray; [`display_of`] makes it a colour.
//! - [`Place::sampling`]: the splats, any range of them.
//! - [`Place::views`], [`Place::dolly`]: where to look from.

mod build;
mod bvh;
mod gaussian;
mod hash;
mod light;
mod paint;
mod photo;
mod sampling;
mod shape;
mod sky;
mod texture;
mod tone;
mod views;

pub use paint::Material;
pub use photo::Pixel;
pub use sampling::Sampling;
pub use tone::{display_of, exposed};
pub use views::Viewpoint;

use crate::Metadata;
use build::{Builder, Primitive};
use bvh::Bvh;
use glam::{DVec2, DVec3};
use light::{Budget, LightMap};
use paint::Paint;
use shape::Crossing;

/// Rays that [`Place::cast`] spends on the light of a point.
const CAST: Budget = Budget { sun: 2, sky: 12 };
/// The same where several rays make a pixel: they share the work, and the mean is as smooth.
const SHARED: Budget = Budget { sun: 1, sky: 3 };
/// Footprint of a cast ray per metre of its length: a pixel of a picture about 1000 px high.
const FOOTPRINT: f64 = 0.0012;

/// A street with everything in it.
#[derive(Clone, Debug)]
pub struct Place {
    seed: u64,
    /// In the order of the tree.
    primitives: Vec<Primitive>,
    paints: Vec<Paint>,
    tree: Bvh,
    light: LightMap,
}

/// A surface that a ray meets, without light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Distance along the ray, m.
    pub t: f64,
    /// Normal of the geometry on the side that the ray comes from, length 1.
    pub normal: DVec3,
    /// What it is made of.
    pub material: Material,
}

/// What a ray meets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance along the ray, m.
    pub t: f64,
    /// Where, world axes, m.
    pub point: DVec3,
    /// Normal of the geometry on the side that the ray comes from, length 1.
    pub normal: DVec3,
    /// What it is made of.
    pub material: Material,
    /// Linear radiance towards the ray's origin; see [`display_of`].
    pub radiance: [f64; 3],
}

impl Place {
    /// The street of `seed`: trees, textures and clouds differ, the plan is the same.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        let mut builder = Builder::new(seed);
        build::build(&mut builder);
        Self::of(builder)
    }

    /// The street as the project's pictures show it.
    #[must_use]
    pub fn street() -> Self {
        Self::new(1)
    }

    fn of(builder: Builder) -> Self {
        let Builder { primitives, paints, seed } = builder;
        let (tree, order) = Bvh::build(primitives.iter().map(|primitive| primitive.shape));
        let primitives = order.into_iter().map(|index| primitives[index]).collect();
        let mut place = Self { seed, primitives, paints, tree, light: LightMap::default() };
        place.light = LightMap::of(&place);
        place
    }

    /// The first surface along a ray, with its light; `None` where the ray ends in the sky.
    ///
    /// `direction` need not have length 1; `t` is in metres all the same.
    #[must_use]
    pub fn cast(&self, origin: DVec3, direction: DVec3) -> Option<Hit> {
        self.cast_with(origin, direction, CAST)
    }

    /// The first surface along a ray without its light: what depth and normals need, and quicker.
    #[must_use]
    pub fn first(&self, origin: DVec3, direction: DVec3) -> Option<Surface> {
        let direction = direction.try_normalize()?;
        let (which, crossing) = self.nearest(origin, direction, f64::INFINITY)?;
        let outward = self.primitives[which].shape.spot_anywhere(crossing.a, crossing.b).normal;
        let normal = if outward.dot(direction) > 0.0 { -outward } else { outward };
        Some(Surface { t: crossing.t, normal, material: self.material(which) })
    }

    /// Linear radiance of the sky in a direction (any length but 0).
    #[must_use]
    pub fn sky(&self, direction: DVec3) -> [f64; 3] {
        self.sky_in(direction.normalize_or(DVec3::Z)).to_array()
    }

    /// Towards the sun, length 1.
    #[must_use]
    pub fn sun_direction() -> DVec3 {
        sky::sun()
    }

    /// What weather must know: metres, up, ground at 0, the light of the horizon.
    #[must_use]
    pub fn metadata(&self) -> Metadata {
        let mut airlight = DVec3::ZERO;
        for step in 0..64 {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(step) / 64.0).sin_cos();
            airlight += DVec3::from_array(self.sky(DVec3::new(cos, sin, 0.05))) / 64.0;
        }
        Metadata {
            metres_per_unit: Some(1.0),
            scale_source: None,
            up: Some(DVec3::Z),
            ground: Some(0.0),
            camera_height: None,
            airlight: Some(exposed(airlight.to_array())),
            rasterization: None,
            provenance: Some(format!("weather-magician built-in street, seed {}", self.seed)),
        }
    }

    fn sky_in(&self, direction: DVec3) -> DVec3 {
        sky::radiance(direction, self.seed as u32)
    }

    fn material(&self, which: usize) -> Material {
        self.paints[usize::from(self.primitives[which].paint)].material
    }

    fn nearest(&self, origin: DVec3, direction: DVec3, high: f64) -> Option<(usize, Crossing)> {
        self.tree.nearest(|which| &self.primitives[which].shape, (origin, direction), 1e-9, high)
    }

    fn blocked(&self, origin: DVec3, direction: DVec3, high: f64) -> bool {
        self.tree.any(|which| &self.primitives[which].shape, (origin, direction), 1e-9, high)
    }

    fn cast_with(&self, origin: DVec3, direction: DVec3, budget: Budget) -> Option<Hit> {
        let direction = direction.try_normalize()?;
        let (which, crossing) = self.nearest(origin, direction, f64::INFINITY)?;
        Some(self.hit(which, &crossing, (origin, direction), budget))
    }

    fn hit(
        &self,
        which: usize,
        crossing: &Crossing,
        (origin, direction): (DVec3, DVec3),
        budget: Budget,
    ) -> Hit {
        let point = origin + direction * crossing.t;
        let unit = DVec2::new(crossing.a, crossing.b);
        let spot = shape::Spot { point, ..self.primitives[which].shape.spot_anywhere(unit.x, unit.y) };
        let normal = if spot.normal.dot(direction) > 0.0 { -spot.normal } else { spot.normal };
        let slant = normal.dot(direction).abs().max(0.1);
        let width = (FOOTPRINT * crossing.t / slant.sqrt()).max(1e-3);
        let radiance = self.shade(which, &spot, (unit, direction), width, budget).to_array();
        Hit { t: crossing.t, point, normal, material: self.material(which), radiance }
    }
}

#[cfg(test)]
mod tests;
