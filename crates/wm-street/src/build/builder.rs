//! The tools to build with: frames of reference, blocks, posts.

use crate::ground::GroundCover;
use crate::hash;
use crate::paint::{Label, Material, Paint, PaintId, rgb};
use crate::shape::{Outline, Shape};
use glam::DVec3;
use wm_scene::{Lamp, LitWindow};

/// One surface of the place.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Primitive {
    pub(crate) shape: Shape,
    pub(crate) paint: PaintId,
    /// For what differs between primitives of one paint.
    pub(crate) key: u64,
    /// The kind of thing that it is part of.
    pub(crate) label: Label,
}

/// Axes to build in: x to the right and y away as seen from in front, z up.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    pub(super) origin: DVec3,
    pub(super) right: DVec3,
    pub(super) back: DVec3,
}

impl Frame {
    /// The frame at `origin` of somebody who looks along `back` (level, length 1).
    pub(super) fn facing(origin: DVec3, back: DVec3) -> Self {
        Self { origin, right: back.cross(DVec3::Z), back }
    }

    /// World position of a local point.
    pub(super) fn at(&self, x: f64, y: f64, z: f64) -> DVec3 {
        self.origin + self.along(x, y, z)
    }

    /// World vector of a local one.
    pub(super) fn along(&self, x: f64, y: f64, z: f64) -> DVec3 {
        self.right * x + self.back * y + DVec3::Z * z
    }

    /// Returns the frame moved to a local point, m.
    pub(super) fn moved(&self, x: f64, y: f64, z: f64) -> Self {
        Self { origin: self.at(x, y, z), ..*self }
    }

    /// Returns the frame turned by 180 degrees about the vertical; its origin is a local point.
    pub(super) fn opposite(&self, x: f64, y: f64) -> Self {
        Self { origin: self.at(x, y, 0.0), right: -self.right, back: -self.back }
    }

    /// At a local point, turned left (seen from above) by `degrees`.
    pub(super) fn turned(&self, x: f64, y: f64, z: f64, degrees: f64) -> Self {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let back = self.back * cos - self.right * sin;
        Self::facing(self.at(x, y, z), back)
    }
}

/// The faces that a block has, as bits.
pub(super) mod faces {
    pub(crate) const LEFT: u8 = 1;
    pub(crate) const RIGHT: u8 = 2;
    pub(crate) const FRONT: u8 = 4;
    pub(crate) const BACK: u8 = 8;
    pub(crate) const BOTTOM: u8 = 16;
    pub(crate) const TOP: u8 = 32;
    pub(crate) const ALL: u8 = 63;
    /// For what stands on the ground.
    pub(crate) const STANDING: u8 = ALL & !BOTTOM;
    /// For what is fixed to a wall behind it.
    pub(crate) const FIXED: u8 = ALL & !BACK;
}

/// Collects primitives and paints.
#[derive(Debug)]
pub(crate) struct Builder {
    pub(crate) primitives: Vec<Primitive>,
    pub(crate) paints: Vec<Paint>,
    pub(crate) seed: u64,
    /// Cover of the ground where it changes along lines that no surface follows.
    pub(crate) cover: GroundCover,
    /// Lamps, and panes that are lit by night.
    pub(crate) lamps: Vec<Lamp>,
    pub(crate) windows: Vec<LitWindow>,
    /// Label of the primitives that are being added, plants aside; `None` for the label of each
    /// material.
    label: Option<Label>,
}

impl Builder {
    pub(crate) fn new(seed: u64) -> Self {
        Self {
            primitives: Vec::new(),
            paints: Vec::new(),
            seed,
            cover: GroundCover::default(),
            lamps: Vec::new(),
            windows: Vec::new(),
            label: None,
        }
    }

    /// Builds parts of one thing: all but its plants get `label`.
    pub(crate) fn labelled(&mut self, label: Label, build: impl FnOnce(&mut Self)) {
        let before = self.label.replace(label);
        build(self);
        self.label = before;
    }

    /// A paint of two sRGB colours.
    pub(super) fn paint(&mut self, material: Material, color: u32, accent: u32) -> PaintId {
        let id = self.paints.len();
        let seed = hash::bits(self.seed, 1000 + id as u64) as u32;
        self.paints.push(Paint { material, color: rgb(color), accent: rgb(accent), seed });
        id as PaintId
    }

    pub(super) fn add(&mut self, shape: Shape, paint: PaintId) {
        let key = hash::bits(self.seed ^ 0x5EED, self.primitives.len() as u64);
        let usual = self.paints[usize::from(paint)].material.label();
        let label = self.label.filter(|_| usual != Label::Plant).unwrap_or(usual);
        self.primitives.push(Primitive { shape, paint, key, label });
    }

    /// A parallelogram; its outside is where `u x v` points.
    pub(super) fn quad(&mut self, corner: DVec3, u: DVec3, v: DVec3, paint: PaintId) {
        self.add(Shape::Flat { corner, u, v, outline: Outline::Parallelogram }, paint);
    }

    /// Adds an upright rectangle along the front of a frame.
    pub(super) fn upright(
        &mut self,
        frame: &Frame,
        corner: [f64; 3],
        width: f64,
        height: f64,
        paint: PaintId,
    ) {
        let [x, y, z] = corner;
        self.quad(frame.at(x, y, z), frame.along(width, 0.0, 0.0), DVec3::Z * height, paint);
    }

    pub(super) fn triangle(&mut self, corner: DVec3, u: DVec3, v: DVec3, paint: PaintId) {
        self.add(Shape::Flat { corner, u, v, outline: Outline::Triangle }, paint);
    }

    /// A disc about `center`; `normal` is its outside.
    pub(super) fn disc(&mut self, center: DVec3, normal: DVec3, radius: f64, paint: PaintId) {
        let (x, y) = crate::shape::around(normal);
        let (u, v) = (x * (2.0 * radius), y * (2.0 * radius));
        self.add(Shape::Flat { corner: center - (u + v) * 0.5, u, v, outline: Outline::Ellipse }, paint);
    }

    pub(super) fn stump(&mut self, from: DVec3, to: DVec3, radii: [f64; 2], paint: PaintId) {
        self.add(Shape::Stump { from, to, radii }, paint);
    }

    /// An upright post with a cap on top.
    pub(super) fn post(&mut self, foot: DVec3, height: f64, radii: [f64; 2], paint: PaintId) {
        let top = foot + DVec3::Z * height;
        self.stump(foot, top, radii, paint);
        self.disc(top, DVec3::Z, radii[1], paint);
    }

    pub(super) fn ball(&mut self, center: DVec3, radii: DVec3, paint: PaintId) {
        self.add(Shape::Ellipsoid { center, radii }, paint);
    }

    /// A block between two corners of `frame`, with the chosen faces.
    pub(super) fn block(&mut self, frame: &Frame, low: [f64; 3], high: [f64; 3], paint: PaintId, which: u8) {
        let [x, y, z] = low;
        let (w, d, h) = (high[0] - x, high[1] - y, high[2] - z);
        let (right, back, up) = (frame.along(w, 0.0, 0.0), frame.along(0.0, d, 0.0), DVec3::Z * h);
        for (face, corner, u, v) in [
            (faces::FRONT, [x, y, z], right, up),
            (faces::BACK, [x + w, y + d, z], -right, up),
            (faces::LEFT, [x, y + d, z], -back, up),
            (faces::RIGHT, [x + w, y, z], back, up),
            (faces::TOP, [x, y, z + h], right, back),
            (faces::BOTTOM, [x, y + d, z], right, -back),
        ] {
            if which & face != 0 {
                self.quad(frame.at(corner[0], corner[1], corner[2]), u, v, paint);
            }
        }
    }
}
