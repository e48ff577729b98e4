//! The built-in street: a scene that needs no download, and photos of it with exact ground truth.
//!
//! A village street about 150 m long runs along +y between houses, gardens and trees, with fields, a
//! church and hills beyond, so that fog has depth to act on. It is analytic geometry with procedural
//! textures and baked light. [`SplatSampling`] turns it into Gaussians; [`Street::photo`] ray-casts
//! pictures of it with exact depth, normals, materials and sky. Units are metres, z is up and the
//! carriageway lies at z = 0.
//!
//! The street depends on its seed alone, never on the order of calls or the number of threads.
//!
//! - [`Street`]: the street itself; [`Street::cast`] and [`Street::sky`] give linear radiance along a ray.
//! - [`SplatSampling`]: its splats, any range of them.
//! - [`Viewpoint`]: a good position to look from; [`Street::dolly`] is a walk.
//! - [`PhotoPixel`]: one pixel of a photo, with its ground truth.
//! - [`dataset`]: photos, cameras and points as a COLMAP data set, with the ground truth beside them.
//!
//! ```
//! use wm_street::Street;
//!
//! let street = Street::builtin();
//! let camera = Street::views()[0].camera((300, 200))?;
//! let pixel = street.photo(&camera, 150, 190, 1);
//! assert!(pixel.depth > 1.0 && !pixel.is_sky);
//! let splats = street.sampling(0.5).splats_in(0..1000);
//! assert!(splats.len() <= 1000);
//! # Ok::<(), wm_scene::CameraError>(())
//! ```

mod build;
mod bvh;
pub mod dataset;
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
pub use photo::PhotoPixel;
pub use sampling::SplatSampling;
pub use tone::{display_of, exposed};
pub use views::Viewpoint;

use build::{Builder, Primitive};
use bvh::Bvh;
use glam::{DVec2, DVec3};
use light::{Budget, LightMap};
use paint::Paint;
use shape::Crossing;
use wm_scene::Metadata;

/// Rays that [`Street::cast`] spends on the light of a point.
const CAST: Budget = Budget { sun: 2, sky: 12 };
/// The same where several rays make a pixel: they share the work, and the mean is as smooth.
const SHARED: Budget = Budget { sun: 1, sky: 3 };
/// Footprint of a cast ray per metre of its length: a pixel of a picture about 1000 px high.
const FOOTPRINT: f64 = 0.0012;

/// A street with everything in it.
#[derive(Clone, Debug)]
pub struct Street {
    seed: u64,
    /// In the order of the tree.
    primitives: Vec<Primitive>,
    paints: Vec<Paint>,
    tree: Bvh,
    light: LightMap,
}

/// A surface that a ray meets, without light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceHit {
    /// Distance along the ray, m.
    pub t: f64,
    /// Normal of the geometry on the side that the ray comes from, length 1.
    pub normal: DVec3,
    /// The material of the surface.
    pub material: Material,
}

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
    /// Linear radiance towards the ray's origin; see [`display_of`].
    pub radiance: [f64; 3],
}

impl Street {
    /// The street of `seed`: trees, textures and clouds differ, the plan is the same.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        let mut builder = Builder::new(seed);
        build::build(&mut builder);
        Self::of(builder)
    }

    /// The street as the project's pictures show it.
    #[must_use]
    pub fn builtin() -> Self {
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
    pub fn cast(&self, origin: DVec3, direction: DVec3) -> Option<LitHit> {
        self.cast_with(origin, direction, CAST)
    }

    /// The first surface along a ray without its light: what depth and normals need, and quicker.
    #[must_use]
    pub fn first(&self, origin: DVec3, direction: DVec3) -> Option<SurfaceHit> {
        let direction = direction.try_normalize()?;
        let (which, crossing) = self.nearest(origin, direction, f64::INFINITY)?;
        let outward = self.primitives[which].shape.spot_anywhere(crossing.a, crossing.b).normal;
        let normal = if outward.dot(direction) > 0.0 { -outward } else { outward };
        Some(SurfaceHit { t: crossing.t, normal, material: self.material(which) })
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

    /// The facts that weather needs: metres, up, ground at 0, the light of the horizon.
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

    fn cast_with(&self, origin: DVec3, direction: DVec3, budget: Budget) -> Option<LitHit> {
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
    ) -> LitHit {
        let point = origin + direction * crossing.t;
        let unit = DVec2::new(crossing.a, crossing.b);
        let spot = shape::Spot { point, ..self.primitives[which].shape.spot_anywhere(unit.x, unit.y) };
        let normal = if spot.normal.dot(direction) > 0.0 { -spot.normal } else { spot.normal };
        let slant = normal.dot(direction).abs().max(0.1);
        let width = (FOOTPRINT * crossing.t / slant.sqrt()).max(1e-3);
        let radiance = self.shade(which, &spot, (unit, direction), width, budget).to_array();
        LitHit { t: crossing.t, point, normal, material: self.material(which), radiance }
    }
}

#[cfg(test)]
mod tests;
