//! A place: its surfaces, what a ray meets, and the light there.

use crate::build::{Builder, Primitive};
use crate::bvh::Bvh;
use crate::exposed;
use crate::ground::GroundCover;
use crate::light_map::LightMap;
use crate::paint::{Label, Material, Paint};
use crate::shape::{Crossing, Shape};
use crate::sky::{self, Lighting};
use crate::views::{Audience, Viewpoint};
use glam::{DVec2, DVec3};
use wm_scene::{Gps, Lamp, LitWindow, Metadata};

/// Where a place is looked at from.
#[derive(Clone, Debug)]
pub(crate) struct Sights {
    pub(crate) views: Vec<Viewpoint>,
    /// A walk at eye level by the share of its time, 0-1.
    pub(crate) dolly: fn(&Place, f64) -> Viewpoint,
    /// The path that somebody with a camera walks.
    pub(crate) path: Vec<DVec2>,
    /// The lane that a car drives along, in a straight line.
    pub(crate) road: (DVec2, DVec2),
    /// Target of flights.
    pub(crate) middle: DVec3,
    /// Radius of a flight around that, m.
    pub(crate) orbit: f64,
    /// Viewers for whom splats are made.
    pub(crate) audience: Audience,
    /// Splats lower than this, m, are inside of the ground.
    pub(crate) lowest: f64,
    /// The place on Earth of its origin.
    pub(crate) home: Gps,
}

/// A place with everything in it.
#[derive(Clone, Debug)]
pub struct Place {
    name: &'static str,
    pub(crate) seed: u64,
    /// Static primitives in the order of `tree`, then moving ones in the order of `movers`.
    pub(crate) primitives: Vec<Primitive>,
    pub(crate) paints: Vec<Paint>,
    tree: Bvh,
    /// The number of primitives that stand still.
    fixed: usize,
    movers: Bvh,
    cover: GroundCover,
    lamps: Vec<Lamp>,
    windows: Vec<LitWindow>,
    pub(crate) lighting: Lighting,
    pub(crate) light: LightMap,
    pub(crate) sights: Sights,
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
    /// The kind of thing that it belongs to.
    pub label: Label,
}

impl Place {
    /// The place of a builder, whose light is still to be found.
    pub(crate) fn unlit(name: &'static str, builder: Builder, sights: Sights) -> Self {
        let Builder { primitives, paints, seed, cover, lamps, windows, .. } = builder;
        let (tree, order) = Bvh::build(primitives.iter().map(|primitive| primitive.shape));
        let primitives: Vec<Primitive> = order.into_iter().map(|index| primitives[index]).collect();
        let (movers, _) = Bvh::build(std::iter::empty());
        let (fixed, lighting, light) = (primitives.len(), Lighting::default(), LightMap::default());
        Self {
            name,
            seed,
            primitives,
            paints,
            tree,
            fixed,
            movers,
            cover,
            lamps,
            windows,
            lighting,
            light,
            sights,
        }
    }

    /// The place with things in it that move: `build` puts them where they are at one time.
    pub(crate) fn with_movers(&self, build: impl FnOnce(&mut Builder)) -> Self {
        let mut builder = Builder::new(self.seed);
        builder.paints.clone_from(&self.paints);
        builder.labelled(Label::Mover, build);
        let (movers, order) = Bvh::build(builder.primitives.iter().map(|primitive| primitive.shape));
        let mut place = self.clone();
        place.primitives.truncate(self.fixed);
        place.primitives.extend(order.into_iter().map(|index| builder.primitives[index]));
        Self { paints: builder.paints, movers, ..place }
    }

    /// The name: `street` or `park`.
    #[must_use]
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// Views that look good, the best first.
    #[must_use]
    pub fn views(&self) -> &[Viewpoint] {
        &self.sights.views
    }

    /// A walk through it at 1.6 m eye height; `time` runs from 0 to 1. See
    /// [`Street::dolly`](crate::Street::dolly).
    #[must_use]
    pub fn dolly(&self, time: f64) -> Viewpoint {
        (self.sights.dolly)(self, time.clamp(0.0, 1.0))
    }

    /// The first surface along a ray without its light: what depth and normals need, and quicker.
    #[must_use]
    pub fn first(&self, origin: DVec3, direction: DVec3) -> Option<SurfaceHit> {
        let direction = direction.try_normalize()?;
        let (which, crossing) = self.nearest(origin, direction, f64::INFINITY)?;
        let normal = self.facing(which, &crossing, direction);
        let (material, label) = self.matter(which, origin + direction * crossing.t);
        Some(SurfaceHit { t: crossing.t, normal, material, label })
    }

    /// Normal at a crossing of a primitive, on the side that a ray comes from.
    pub(crate) fn facing(&self, which: usize, crossing: &Crossing, direction: DVec3) -> DVec3 {
        let outward = self.primitives[which].shape.spot_anywhere(crossing.a, crossing.b).normal;
        if outward.dot(direction) > 0.0 { -outward } else { outward }
    }

    /// Height of the ground at a position, m: of what lies under trees and things, and of the
    /// surface of water.
    ///
    /// `None` beyond the fields that surround the place.
    #[must_use]
    pub fn ground_height(&self, x: f64, y: f64) -> Option<f64> {
        /// Most surfaces above each other: more than anywhere.
        const MAX_LAYERS: usize = 1000;
        let mut from = DVec3::new(x, y, 300.0);
        for _ in 0..MAX_LAYERS {
            let hit = self.first(from, -DVec3::Z)?;
            let point = from - DVec3::Z * hit.t;
            if hit.label.is_ground() || hit.label == Label::Water {
                return Some(point.z);
            }
            from = point - DVec3::Z * 1e-6;
        }
        None
    }

    /// The point at a height above the ground, m, or above 0 where there is none.
    pub(crate) fn above(&self, at: DVec2, height: f64) -> DVec3 {
        at.extend(self.ground_height(at.x, at.y).unwrap_or_default() + height)
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
        Metadata {
            metres_per_unit: Some(1.0),
            up: Some(DVec3::Z),
            ground: Some(0.0),
            airlight: Some(exposed(self.horizon().to_array())),
            lamps: Some(self.lamps.clone()),
            windows: Some(self.windows.clone()),
            provenance: Some(format!("weather-magician built-in {}, seed {}", self.name, self.seed)),
            ..Metadata::default()
        }
    }

    /// Mean linear radiance of the sky just above the horizon.
    pub(crate) fn horizon(&self) -> DVec3 {
        let mut mean = DVec3::ZERO;
        for step in 0..64 {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(step) / 64.0).sin_cos();
            mean += DVec3::from_array(self.sky(DVec3::new(cos, sin, 0.05))) / 64.0;
        }
        mean
    }

    pub(crate) fn sky_in(&self, direction: DVec3) -> DVec3 {
        self.lighting.radiance(direction, self.seed as u32)
    }

    /// The material of a primitive; covered ground has the material of its lawn.
    pub(crate) fn material(&self, which: usize) -> Material {
        self.paints[usize::from(self.primitives[which].paint)].material
    }

    /// The paint of a primitive at a point of it.
    pub(crate) fn paint(&self, which: usize, point: DVec3) -> Paint {
        let paint = self.primitives[which].paint;
        if self.cover.covers(paint) {
            return self.cover.paint_at(point.truncate(), &self.paints);
        }
        self.paints[usize::from(paint)]
    }

    /// The material and the label of a primitive at a point of it.
    pub(crate) fn matter(&self, which: usize, point: DVec3) -> (Material, Label) {
        let primitive = &self.primitives[which];
        let material = self.paint(which, point).material;
        let label = if self.cover.covers(primitive.paint) { material.label() } else { primitive.label };
        (material, label)
    }

    /// The nearest crossing before `high`, movers among them, and its primitive.
    pub(crate) fn nearest(&self, origin: DVec3, direction: DVec3, high: f64) -> Option<(usize, Crossing)> {
        let fixed = self.tree.nearest(|which| &self.primitives[which].shape, origin, direction, 1e-9, high);
        let high = fixed.map_or(high, |(_, crossing)| crossing.t);
        let moving = self.movers.nearest(|which| self.mover(which), origin, direction, 1e-9, high);
        moving.map(|(which, crossing)| (self.fixed + which, crossing)).or(fixed)
    }

    fn mover(&self, which: usize) -> &Shape {
        &self.primitives[self.fixed + which].shape
    }

    /// Returns true if anything stands in the way before `high`.
    pub(crate) fn blocked(&self, origin: DVec3, direction: DVec3, high: f64) -> bool {
        self.tree.any(|which| &self.primitives[which].shape, origin, direction, 1e-9, high)
            || self.movers.any(|which| self.mover(which), origin, direction, 1e-9, high)
    }
}
