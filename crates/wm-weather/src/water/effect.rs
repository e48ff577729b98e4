//! Lays the mirrored picture and the water over what is drawn.

use super::WATER_INDEX;
use super::body::WaterBody;
use super::foam::Foam;
use super::fresnel::fresnel_of;
use super::map::WaterMap;
use super::mirror::{Extent, MirrorView, MirroredPicture, Seen};
use super::motion::WaterMotion;
use super::rills::Slope;
use super::surface::{FILM, NODES, WaterSurface};
use super::tile::Kept;
use crate::linear_picture::{decode, encode};
use fearless_simd::{Select, SimdBase, SimdFloat, SimdMask};
use rayon::prelude::*;
use std::f32::consts::LOG2_E;
use wm_render::hooks::{AirGroup, GROUP, Medium, PixelEffect, ShadeGroup};
use wm_render::pixel_effects::apply_pixel_effects;
use wm_render::simd::{Lanes, SimdPath, exp2, log2, srgb_decode, srgb_encode};
use wm_render::{FRONT, Frame, PictureEffect, dispatch};
use wm_scene::Camera;

/// Transmittance to the surface below which it is not seen.
const HIDDEN: f32 = 1.0 / 512.0;
/// Looks into a rough surface: standard deviations of the slope and their weights, normal
/// distributions; and the width of each look over the standard deviation of the lobe's height.
struct Looks(&'static [(f32, f32)], f32);

impl Looks {
    /// Look `k`; behind the last one looks that count nothing.
    #[inline(always)]
    fn look(&self, k: usize) -> (f32, f32) {
        if k < self.0.len() { self.0[k] } else { (0.0, 0.0) }
    }
}

const ONE: Looks = Looks(&[(0.0, 1.0)], 0.0);
const FEW: Looks = Looks(&[(0.0, 0.62), (-1.62, 0.19), (1.62, 0.19)], 1.4);
const MANY: Looks = Looks(&[(0.0, 0.399), (-1.0, 0.242), (1.0, 0.242), (-2.0, 0.058), (2.0, 0.058)], 0.9);
/// Those of a film, which is looked into at few pixels: close enough that lamps are streaks and no
/// blots.
const CLOSE: Looks = Looks(
    &[
        (0.0, 0.233),
        (-0.58, 0.197),
        (0.58, 0.197),
        (-1.16, 0.119),
        (1.16, 0.119),
        (-1.74, 0.051),
        (1.74, 0.051),
        (-2.32, 0.0165),
        (2.32, 0.0165),
    ],
    0.5,
);
/// Height of a lobe, standard deviations in px of the mirrored picture, below which one look is
/// enough.
const SHARP: f32 = 0.35;
/// The same from which a few looks are too far apart.
const TALL: f32 = 5.0;
/// Slopes away from the eye, of the tangent of the view's elevation, from which crests hide what is
/// behind them.
const HIDING: f32 = 0.7;
/// Share of the light behind the surface that may be missing where the water's own light is left
/// out.
const THIN: f32 = 1.0 / 256.0;
/// Width of a look, px, over the standard deviation of the lobe across the view that it must have:
/// a piece of a mirrored picture is a box and what is mixed between its pixels.
const WIDE: f32 = 2.45;
/// Height over a flood from which on water is not the flood's, m.
const ABOVE: f32 = 0.01;
/// Width over which the depth of what a lobe shows is averaged, of the lobe's height: far less than
/// the lobe, whose lower end shows what stands before the water.
const BLENDED: f32 = 1.0;
/// Least distance to what a rough surface mirrors, of that to the surface: nearer things are mixed
/// with what is beside them.
const BESIDE: f32 = 0.03;
/// Reciprocal of the view z, over that of the water, from which on things are nearer than the water
/// and not mirrored in it.
const NEARER: f32 = 1.1;
/// One over how free of its ground water is that counts as free.
const FREE: f32 = 4.0;
/// Farthest that a mirrored point is from the water, m: beyond it nothing moves when the eye does.
const FAR: f32 = 1e5;

/// Water as a picture pass: its picture is drawn with [`wm_render::DrawPass::surface`], its only
/// input is the mirrored one.
pub struct WaterEffect<'a> {
    /// The water of the place.
    pub map: &'a WaterMap,
    /// The water that the picture shows.
    pub surface: &'a WaterSurface,
    /// The mirrored eye.
    pub mirror: &'a MirrorView,
    /// Its waves.
    pub motion: &'a WaterMotion,
    /// Its clearness and its own light.
    pub body: WaterBody,
    /// The brightest light that it mirrors, linear
    /// ([`PreparedWeather::brightest`](crate::PreparedWeather::brightest)).
    pub white: f32,
    /// The camera of the picture.
    pub camera: &'a Camera,
    /// The air before it.
    pub medium: Option<&'a dyn Medium>,
    /// The effects on finished pixels, in order.
    pub effects: &'a [&'a dyn PixelEffect],
}

/// Water in sixteen pixels, one array a number.
struct Water {
    /// Share of light that is reflected.
    reflected: [f32; GROUP],
    /// That light, linear.
    mirrored: [[f32; GROUP]; 3],
    /// Share of the light behind that comes through.
    left: [f32; GROUP],
    /// Foam, where there may be some.
    foam: Option<FoamPixels>,
}

/// Foam in sixteen pixels, and the numbers that it follows from.
struct FoamPixels {
    /// Depth of a flood, m; infinite for other water.
    depth: [f32; GROUP],
    /// Square of the slope, both axes together, and its variance along one axis that the pixel is
    /// too wide to show.
    slopes: [[f32; GROUP]; 2],
    /// Share that foam covers.
    share: [f32; GROUP],
}

impl FoamPixels {
    const NONE: Self = Self { depth: [f32::INFINITY; GROUP], slopes: [[0.0; GROUP]; 2], share: [0.0; GROUP] };
}

impl Water {
    fn new(may_foam: bool) -> Self {
        let foam = if may_foam { Some(FoamPixels::NONE) } else { None };
        Self { reflected: [0.0; GROUP], mirrored: [[0.0; GROUP]; 3], left: [1.0; GROUP], foam }
    }
}

/// Sixteen pixels of a row that are looked into.
struct Pixels {
    /// Middles of their columns, and of their row, px.
    x: [f32; GROUP],
    y: f32,
    /// View z of the water, NaN where there is none.
    z: [f32; GROUP],
    /// Slopes that do not move.
    still: [f32; GROUP],
    /// One over the distance to what they mirror, 1/m; NaN where that is not known.
    reach: [f32; GROUP],
}

/// Numbers that are looked up at nodes every [`NODES`] pixels, and interpolated between them.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Looked {
    /// The share of light that films reflect, and that light, linear RGB: too blurred to differ
    /// between nodes.
    Films,
    /// One over the distance from rough water to what it mirrors, 1/m. Slopes and light are found
    /// at each pixel.
    Reach,
}

impl Looked {
    /// Numbers a node.
    const fn parts(self) -> usize {
        match self {
            Self::Films => 4,
            Self::Reach => 1,
        }
    }

    /// Returns true of water with these slopes that do not move.
    #[inline(always)]
    fn holds(self, still: f32) -> bool {
        (still > FILM) == (self == Self::Films)
    }
}

/// Numbers at nodes of the picture; NaN where the water is not of the kind.
struct LookNodes {
    of: Looked,
    /// Nodes in a row, a multiple of [`GROUP`].
    columns: usize,
    /// One row of nodes after the other, each with its numbers of one kind after the other.
    nodes: Vec<f32>,
}

impl LookNodes {
    /// Looks into the water of this kind in a picture.
    fn new(scene: &Scene<'_>, path: SimdPath, of: Looked) -> Self {
        let size = (scene.of.camera.width as usize, scene.of.camera.height as usize);
        let columns = (size.0.next_multiple_of(GROUP) / NODES + 1).next_multiple_of(GROUP);
        let row_length = of.parts() * columns;
        let mut nodes = vec![f32::NAN; row_length * (size.1.div_ceil(NODES) + 1)];
        nodes.par_chunks_mut(row_length).enumerate().for_each(|(row, nodes)| {
            let y = (row * NODES).min(size.1 - 1);
            if scene.of.surface.rows.contains(&(y as u32)) {
                dispatch!(path, s => scene.look_at_nodes(s, (of, y), nodes));
            }
        });
        Self { of, columns, nodes }
    }

    /// Number `part` at sixteen pixels from pixel (`x`, `y`) on; NaN where not all nodes about them
    /// are known.
    #[inline(always)]
    fn at(&self, (x, y): (usize, usize), part: usize) -> [f32; GROUP] {
        let (column, row) = (x / NODES, y / NODES);
        let down = (y % NODES) as f32 / NODES as f32;
        let of_row =
            |row: usize| &self.nodes[(self.of.parts() * row + part) * self.columns + column..][..COUNT];
        const COUNT: usize = GROUP / NODES + 1;
        let (upper, lower) = (of_row(row), of_row(row + 1));
        let mut nodes = [0.0f32; COUNT];
        for i in 0..COUNT {
            nodes[i] = upper[i] + (lower[i] - upper[i]) * down;
        }
        let mut found = [0.0f32; GROUP];
        for i in 0..GROUP {
            let (left, right) = (nodes[i / NODES], nodes[i / NODES + 1]);
            found[i] = left + (right - left) * ((i % NODES) as f32 / NODES as f32);
        }
        found
    }

    /// Writes what sixteen pixels of films mirror, from pixel `at` on, where the nodes about them
    /// are known, and takes these pixels from those that are looked into.
    #[inline(always)]
    fn write(&self, at: (usize, usize), pixels: &mut Pixels, water: &mut Water) {
        let reflected = self.at(at, 0);
        let mut known = [false; GROUP];
        let mut is_any = false;
        for i in 0..GROUP {
            known[i] = !reflected[i].is_nan() & self.of.holds(pixels.still[i]) & !pixels.z[i].is_nan();
            is_any |= known[i];
        }
        if !is_any {
            return;
        }
        let light = [self.at(at, 1), self.at(at, 2), self.at(at, 3)];
        for i in 0..GROUP {
            water.reflected[i] = if known[i] { reflected[i] } else { water.reflected[i] };
            for k in 0..3 {
                water.mirrored[k][i] = if known[i] { light[k][i] } else { water.mirrored[k][i] };
            }
            pixels.z[i] = if known[i] { f32::NAN } else { pixels.z[i] };
        }
    }
}

const _: () = assert!(GROUP.is_multiple_of(NODES), "pixels between two nodes are of one group");

impl PictureEffect for WaterEffect<'_> {
    fn apply(&self, path: SimdPath, picture: &mut Frame, inputs: &[&Frame]) {
        let mirrored = MirroredPicture::new(path, inputs[0], self.white);
        let scene = Scene::new(self, &mirrored);
        let has_films = !self.surface.roughness.is_empty();
        let films = has_films.then(|| LookNodes::new(&scene, path, Looked::Films));
        let is_rough = self.motion.is_rough() && !self.surface.is_film();
        let reach = is_rough.then(|| LookNodes::new(&scene, path, Looked::Reach));
        let width = picture.width as usize;
        let Frame { rgb, front, depth, alpha, particles, .. } = picture;
        let (depth, alpha): (&[f32], &[f32]) = (depth, alpha);
        let rows = rgb.par_chunks_mut(3 * width).zip(front.par_chunks_mut(FRONT * width));
        rows.enumerate().for_each(|(y, (line, front))| {
            let own = y * width..(y + 1) * width;
            let is_wet = self.surface.rows.contains(&(y as u32));
            if !is_wet {
                clear(front);
            } else {
                let mut row =
                    Row { y, surface: &self.surface.depth[own.clone()], front, alpha: &alpha[own.clone()] };
                dispatch!(path, s => scene.lay(s, path, (films.as_ref(), reach.as_ref()), &mut row, line));
            }
            if !particles.is_empty() {
                lay_particles(path, line, &particles[4 * own.start..4 * own.end]);
            }
        });
        apply_pixel_effects(path, self.effects, width, rgb, alpha, depth);
    }
}

/// One row of the picture that is drawn.
struct Row<'a> {
    y: usize,
    surface: &'a [f32],
    /// The first sum of each pixel becomes the share of light that is reflected.
    front: &'a mut [f32],
    alpha: &'a [f32],
}

/// Numbers that all pixels share: metres along level axes from the eye, heights from the mirror's
/// plane.
struct Scene<'a> {
    of: &'a WaterEffect<'a>,
    mirrored: &'a MirroredPicture,
    /// A ray through picture point (x, y), at view z 1: `axes[0] x + axes[1] y + axes[2]`, m along
    /// level axes.
    axes: [[f32; 3]; 3],
    /// Place of the eye along the two level axes, m.
    eye: [f64; 2],
    /// Height of the eye over the mirror's plane, m.
    height: f32,
    /// Rows of the mirrored view's rotation, level axes.
    view: [[f32; 3]; 3],
    focal: [f32; 2],
    principal: [f32; 2],
    metres: f32,
    /// Level axes in world axes.
    level: [[f32; 3]; 3],
    /// Angle of a pixel, logarithm to base 2.
    pixel: f32,
    /// The eye's place on the tiles of the waves.
    phases: Vec<[f32; 2]>,
}

impl<'a> Scene<'a> {
    fn new(of: &'a WaterEffect<'a>, mirrored: &'a MirroredPicture) -> Self {
        let map = of.map;
        let to_level = |v: glam::DVec3| map.axes.map(|axis| glam::DVec3::from_array(axis).dot(v));
        let camera = of.camera;
        let world_from_camera = camera.rotation().transpose();
        let (right, down) = (world_from_camera.x_axis / camera.fx, world_from_camera.y_axis / camera.fy);
        let corner = world_from_camera.z_axis - right * camera.cx - down * camera.cy;
        let metres = map.metres_per_unit;
        let single = |v: [f64; 3]| v.map(|v| v as f32);
        let eye = to_level(camera.center()).map(|v| v * metres);
        let view = of.mirror.camera;
        let rotation = view.rotation();
        Self {
            of,
            mirrored,
            axes: [right, down, corner].map(|axis| single(to_level(axis).map(|v| v * metres))),
            height: (eye[2] - of.surface.level) as f32,
            view: [0, 1, 2].map(|k| single(to_level(rotation.row(k)))),
            focal: [view.fx as f32, view.fy as f32],
            principal: [view.cx as f32, view.cy as f32],
            metres: metres as f32,
            level: map.axes.map(single),
            pixel: camera.widest_pixel().log2() as f32,
            eye: [eye[0], eye[1]],
            phases: of.motion.phases([eye[0], eye[1]]),
        }
    }

    /// Lays water over one row of pixels, sixteen at a time.
    #[inline(always)]
    fn lay<S: Lanes>(
        &self,
        simd: S,
        path: SimdPath,
        (films, reach): (Option<&LookNodes>, Option<&LookNodes>),
        row: &mut Row<'_>,
        line: &mut [f32],
    ) {
        let width = row.surface.len();
        let surface = self.of.surface;
        let mut air = [AirGroup::default()];
        let foam = self.of.motion.foam().filter(|_| self.of.map.plane().is_some());
        for first in (0..width).step_by(GROUP) {
            let count = GROUP.min(width - first);
            let z: [f32; GROUP] = padded(&row.surface[first..first + count], f32::NAN);
            let line = &mut line[3 * first..3 * (first + count)];
            let front = &mut row.front[FRONT * first..FRONT * (first + count)];
            let mut is_wet = false;
            for z in &z {
                is_wet |= !z.is_nan();
            }
            if !is_wet {
                clear(front);
                continue;
            }
            let drawn: [[f32; GROUP]; 3] = columns::<3, { 3 * GROUP }>(line);
            let mut before = [[0.0; GROUP]; FRONT];
            for (before, front) in before.iter_mut().zip(front.chunks_exact(count)) {
                *before = padded(front, 0.0);
            }
            let alpha: [f32; GROUP] = padded(&row.alpha[first..first + count], 0.0);
            let at = row.y * width + first..row.y * width + first + count;
            let still = match surface.roughness.is_empty() {
                true => [0.0; GROUP],
                false => padded(&surface.roughness[at.clone()], 0.0),
            };
            let cover = match surface.cover.is_empty() {
                true => [1.0; GROUP],
                false => padded(&surface.cover[at], 0.0),
            };
            let mut behind = Behind::new();
            for start in (0..GROUP).step_by(S::N) {
                behind.find(simd, start, (&drawn, &before), (&alpha, &z));
            }
            let mut wet = 0;
            for i in 0..GROUP {
                wet |= u32::from(!behind.z[i].is_nan()) << i;
            }
            if wet == 0 {
                clear(front);
                continue;
            }
            let mut water = Water::new(foam.is_some());
            let mut pixels = Pixels {
                x: [0.0; GROUP],
                y: row.y as f32 + 0.5,
                z: behind.z,
                still,
                reach: reach.map_or([f32::NAN; GROUP], |nodes| nodes.at((first, row.y), 0)),
            };
            for (i, x) in pixels.x.iter_mut().enumerate() {
                *x = (first + i) as f32 + 0.5;
            }
            let mut rays = ShadeGroup::default();
            if self.of.map.plane().is_some() {
                for start in (0..GROUP).step_by(S::N) {
                    self.through_flood(simd, start, (&pixels, &behind), (&mut water, &mut rays));
                }
            }
            if let Some(films) = films {
                films.write((first, row.y), &mut pixels, &mut water);
            }
            for start in (0..GROUP).step_by(S::N) {
                self.look(simd, start, &pixels, &mut water);
            }
            if let (Some(foam), Some(pixels)) = (foam, &mut water.foam) {
                for start in (0..GROUP).step_by(S::N) {
                    find_foam(simd, start, foam, pixels);
                }
            }
            // Puddles, streams and films have no light of their own.
            let mut is_deep = false;
            for i in 0..GROUP {
                is_deep |= wet >> i & 1 == 1 && water.left[i] < 1.0 - THIN;
            }
            if let Some(foam) = &water.foam {
                for share in &foam.share {
                    is_deep |= *share > THIN;
                }
            }
            if let Some(medium) = self.of.medium.filter(|_| is_deep) {
                let origin = self.of.camera.center().to_array().map(|v| v as f32);
                medium.evaluate(path, origin, std::slice::from_ref(&rays), &mut air);
            }
            if !is_deep {
                water.left = [1.0; GROUP];
                water.foam = None;
            }
            let mut shown = drawn;
            for start in (0..GROUP).step_by(S::N) {
                self.mix(simd, start, (&behind, &water), (&before, &cover, &air[0]), &mut shown);
            }
            for (i, pixel) in line.as_chunks_mut::<3>().0.iter_mut().enumerate() {
                *pixel = [shown[0][i], shown[1][i], shown[2][i]];
            }
            let mut reflected = [0.0; GROUP];
            for i in 0..GROUP {
                let is_wet = wet >> i & 1 == 1;
                reflected[i] = if is_wet { behind.open[i] * cover[i] * water.reflected[i] } else { 0.0 };
            }
            if let Some(foam) = &water.foam {
                for i in 0..GROUP {
                    reflected[i] *= 1.0 - foam.share[i];
                }
            }
            front[..count].copy_from_slice(&reflected[..count]);
        }
    }

    /// Lays water over what is behind it, and what is before it over both; some of sixteen pixels.
    #[inline(always)]
    fn mix<S: Lanes>(
        &self,
        simd: S,
        start: usize,
        (behind, water): (&Behind, &Water),
        (before, cover, air): (&[[f32; GROUP]; FRONT], &[f32; GROUP], &AirGroup),
        shown: &mut [[f32; GROUP]; 3],
    ) {
        let z = simd.load(&behind.z[start..]);
        let is_wet = z.simd_eq(z);
        let mut light = [simd.set(0.0); 3];
        for k in 0..3 {
            light[k] = simd.load(&behind.light[k][start..]);
        }
        let mut light = srgb_decode(simd, light);
        let (left, cover) = (simd.load(&water.left[start..]), simd.load(&cover[start..]));
        let kept = simd.set(1.0) - simd.load(&water.reflected[start..]);
        for k in 0..3 {
            let through = simd.load(&air.transmittance[k][start..]);
            let airlight = simd.load(&air.airlight[k][start..]);
            let own = simd.set(self.of.body.glow[k]).mul_add(through, airlight);
            let below = left.mul_add(light[k] - own, own);
            let wet = kept.mul_add(below, simd.load(&water.mirrored[k][start..]));
            let wet = match &water.foam {
                Some(foam) => {
                    let white = simd.set(self.of.body.foam[k]).mul_add(through, airlight);
                    simd.load(&foam.share[start..]).mul_add(white - wet, wet)
                }
                None => wet,
            };
            light[k] = cover.mul_add(wet - light[k], light[k]).max(simd.set(0.0));
        }
        let light = srgb_encode(simd, light);
        let open = simd.load(&behind.open[start..]);
        for k in 0..3 {
            let whole = open.mul_add(light[k], simd.load(&before[k][start..]));
            let own = simd.load(&shown[k][start..]);
            is_wet.select(whole, own).store_slice(&mut shown[k][start..start + S::N]);
        }
    }

    /// The light that comes through the water of a flood, and the rays to it, for the air: of as
    /// many of sixteen pixels as there are lanes from `start` on.
    #[inline(always)]
    fn through_flood<S: Lanes>(
        &self,
        simd: S,
        start: usize,
        (pixels, behind): (&Pixels, &Behind),
        (water, rays): (&mut Water, &mut ShadeGroup),
    ) {
        let (zero, one) = (simd.set(0.0), simd.set(1.0));
        let z = simd.load(&behind.z[start..]);
        let is_wet = z.simd_eq(z);
        if !is_wet.any_true() {
            return;
        }
        let z = is_wet.select(z, one);
        let (toward, long) = self.toward(simd, simd.load(&pixels.x[start..]), pixels.y);
        let own = start..start + S::N;
        (z * long * (1.0 / self.metres)).store_slice(&mut rays.distance[own.clone()]);
        for k in 0..3 {
            let mut way = toward[0] * self.level[0][k];
            for axis in 1..3 {
                way = toward[axis].mul_add(simd.set(self.level[axis][k]), way);
            }
            way.store_slice(&mut rays.direction[k][own.clone()]);
        }
        // Depth of the flood under the ray, and the way in it after the ray is bent. Other water is
        // rain, and clear: it is shallow, and how deep splats lie under it says nothing.
        let sine = (-toward[2]).max(simd.set(1e-4));
        let bottom = simd.load(&behind.bottom[start..]);
        let deep = ((bottom - z) * long * sine).max(zero);
        let bent = ((sine.mul_add(sine, simd.set(-1.0))) * (1.0 / (WATER_INDEX * WATER_INDEX)) + 1.0).sqrt();
        let (beam, daylight) = (-self.of.body.beam * LOG2_E, -self.of.body.daylight * LOG2_E);
        let left = deep * (simd.set(beam) / bent + daylight);
        let left = exp2(simd, [left.max(simd.set(-126.0))])[0] * simd.load(&behind.filled[start..]);
        let height = (z * long).mul_add(toward[2], simd.set(self.height));
        let is_flood = is_wet & height.simd_le(simd.set(ABOVE));
        is_flood.select(left, one).store_slice(&mut water.left[own.clone()]);
        if let Some(foam) = &mut water.foam {
            is_flood.select(deep, simd.set(f32::INFINITY)).store_slice(&mut foam.depth[own]);
        }
    }

    /// Directions through picture points of a row, metres along level axes, of length 1; and the
    /// lengths that they have at view z 1, m.
    #[inline(always)]
    fn toward<S: Lanes>(&self, simd: S, x: S::F, y: f32) -> ([S::F; 3], S::F) {
        let mut toward = [simd.set(0.0); 3];
        for k in 0..3 {
            toward[k] = x.mul_add(simd.set(self.axes[0][k]), simd.set(self.axes[1][k] * y + self.axes[2][k]));
        }
        let long = dot::<S>(&toward, &toward).sqrt();
        for toward in &mut toward {
            *toward /= long;
        }
        (toward, long)
    }

    /// Looks into the water of one kind at the nodes of a row.
    #[inline(always)]
    fn look_at_nodes<S: Lanes>(&self, simd: S, (of, y): (Looked, usize), nodes: &mut [f32]) {
        let WaterSurface { depth, roughness, .. } = self.of.surface;
        let width = self.of.camera.width as usize;
        let columns = nodes.len() / of.parts();
        for first in (0..width.div_ceil(NODES) + 1).step_by(GROUP) {
            let mut pixels = Pixels {
                x: [0.5; GROUP],
                y: y as f32 + 0.5,
                z: [f32::NAN; GROUP],
                still: [0.0; GROUP],
                reach: [f32::NAN; GROUP],
            };
            for i in 0..GROUP {
                let x = ((first + i) * NODES).min(width - 1);
                let at = y * width + x;
                let still = roughness.get(at).copied().unwrap_or(0.0);
                if of.holds(still) {
                    (pixels.x[i], pixels.z[i], pixels.still[i]) = (x as f32 + 0.5, depth[at], still);
                }
            }
            let mut water = Water::new(false);
            for start in (0..GROUP).step_by(S::N) {
                match of {
                    Looked::Films => self.look(simd, start, &pixels, &mut water),
                    Looked::Reach => self.find_reach(simd, start, &mut pixels),
                }
            }
            let [red, green, blue] = &water.mirrored;
            let light = [&water.reflected, red, green, blue];
            let parts = if of == Looked::Reach { &[&pixels.reach][..] } else { &light };
            for (part, row) in parts.iter().zip(nodes.chunks_mut(columns)) {
                for i in 0..GROUP {
                    row[first + i] = if pixels.z[i].is_nan() { f32::NAN } else { part[i] };
                }
            }
        }
    }

    /// Finds how far away is what pixels mirror.
    #[inline(always)]
    fn find_reach<S: Lanes>(&self, simd: S, start: usize, pixels: &mut Pixels) {
        let z = simd.load(&pixels.z[start..]);
        let is_wet = z.simd_eq(z);
        if is_wet.any_true() {
            let point = Point::new(self, simd, (simd.load(&pixels.x[start..]), pixels.y), z);
            let still = simd.load(&pixels.still[start..]);
            let slopes = self.slopes(simd, &point, still, (NODES.ilog2() as f32, is_wet.to_bitmask() as u32));
            let facet = Facet::new(self, simd, point, (slopes, still));
            let far = self.reach(simd, &facet, point.distance, is_wet);
            (simd.set(1.0) / far).store_slice(&mut pixels.reach[start..start + S::N]);
        }
    }

    /// Slopes of the surface and their variance, with those of the streams on slopes, at the wanted
    /// lanes of points from the eye, m.
    #[inline(always)]
    fn with_rills<S: Lanes>(
        &self,
        simd: S,
        hit: &[S::F; 3],
        log_width: S::F,
        wanted: u32,
        slopes: &[S::F; 3],
    ) -> [S::F; 3] {
        let (x, y) = (Kept::of(simd, hit[0]), Kept::of(simd, hit[1]));
        let width = Kept::of(simd, exp2(simd, [log_width])[0]);
        let (mut east, mut north) = (Kept::of(simd, slopes[0]), Kept::of(simd, slopes[1]));
        let mut variance = Kept::of(simd, slopes[2]);
        let mut todo = wanted;
        while todo != 0 {
            let i = (todo.trailing_zeros() & 15) as usize;
            todo &= todo - 1;
            let place = [self.eye[0] + f64::from(x.0[i]), self.eye[1] + f64::from(y.0[i])];
            let mut slope = Slope { mean: [east.0[i], north.0[i]], variance: variance.0[i] };
            self.of.motion.add_rills(place, width.0[i], &mut slope);
            (east.0[i], north.0[i], variance.0[i]) = (slope.mean[0], slope.mean[1], slope.variance);
        }
        [simd.load(&east.0), simd.load(&north.0), simd.load(&variance.0)]
    }

    /// The slopes of the water at points that have a bit in `wanted`, along the two level axes, and
    /// their variance along one axis in a piece of the picture of such a side, px, logarithm to
    /// base 2. `still` are slopes that do not move.
    #[inline(always)]
    fn slopes<S: Lanes>(
        &self,
        simd: S,
        point: &Point<S>,
        still: S::F,
        (log_side, wanted): (f32, u32),
    ) -> [S::F; 3] {
        // A film between the grains of the ground has no waves.
        let free = (simd.set(1.0) - still * (1.0 / FILM)).max(simd.set(0.0));
        let waves = wanted & free.simd_gt(simd.set(0.0)).to_bitmask() as u32;
        if waves == 0 {
            return [simd.set(0.0); 3];
        }
        // What a pixel sees of the surface is longer than wide; between both is what waves must be
        // wider than.
        let [far, flat] = log2(simd, [point.distance, point.sine]);
        let width = flat.mul_add(simd.set(-0.75), far + (self.pixel + log_side));
        let [x, y, _] = point.hit;
        let mut slopes = self.of.motion.at(simd, ([x, y], &self.phases), width, waves);
        if self.of.motion.has_rills() {
            slopes = self.with_rills(simd, &point.hit, width, waves, &slopes);
        }
        [slopes[0] * free, slopes[1] * free, slopes[2] * free * free]
    }

    /// Looks into the water at those of sixteen pixels that have any, as many of them as there are
    /// lanes from `start` on.
    #[inline(always)]
    fn look<S: Lanes>(&self, simd: S, start: usize, pixels: &Pixels, water: &mut Water) {
        let (zero, one) = (simd.set(0.0), simd.set(1.0));
        let z = simd.load(&pixels.z[start..]);
        let is_wet = z.simd_eq(z);
        let wanted = is_wet.to_bitmask() as u32;
        if wanted == 0 {
            return;
        }
        let still = simd.load(&pixels.still[start..]);
        let point = Point::new(self, simd, (simd.load(&pixels.x[start..]), pixels.y), z);
        let slopes = self.slopes(simd, &point, still, (0.0, wanted));
        if let Some(foam) = &mut water.foam {
            let square = slopes[0].mul_add(slopes[0], slopes[1] * slopes[1]);
            square.store_slice(&mut foam.slopes[0][start..start + S::N]);
            slopes[2].store_slice(&mut foam.slopes[1][start..start + S::N]);
        }
        let facet = Facet::new(self, simd, point, (slopes, still));
        let free = (one - still * (1.0 / FILM)).max(zero);
        let known = simd.load(&pixels.reach[start..]);
        let is_known = known.simd_eq(known);
        let mut far = one / known;
        if !(is_known | !is_wet).all_true() {
            far = is_known.select(far, self.reach(simd, &facet, point.distance, is_wet & !is_known));
        }
        let Facet { from, tilt, first, rough } = facet;
        // A lobe as it is seen in the mirrored picture: two slopes tall, and as much narrower as a
        // facet is met at less of an angle. Of what stands at the water it is a point.
        let tall = self.lobe::<S>(rough, far, point.distance);
        let wide = tall * WIDE;
        let (is_sharp, is_low) = (tall.simd_lt(simd.set(SHARP)), tall.simd_lt(simd.set(TALL)));
        let kinds = Kinds::<S> { is_sharp, is_low, free: (free * FREE).min(one) };
        let is_near_film = kinds.free.simd_lt(one);
        let apart = kinds.pick(simd, [ONE.1, FEW.1, CLOSE.1, MANY.1]);
        let tallest = is_wet.select(tall, zero);
        let count = match () {
            () if tallest.simd_lt(simd.set(SHARP)).all_true() => ONE.0.len(),
            () if tallest.simd_lt(simd.set(TALL)).all_true() => FEW.0.len(),
            () if (is_wet & is_near_film).any_true() => CLOSE.0.len(),
            () => MANY.0.len(),
        };
        let mut middle = from;
        for k in 0..3 {
            middle[k] = far.mul_add(first.0[k], from[k]);
        }
        let (middle, _) = self.project(simd, &middle);
        let slant = self.slant(simd, middle);
        let extent = |cosine: S::F| {
            let along = is_sharp.select(one, apart * tall);
            Extent { wide: is_sharp.select(one, (wide * cosine.max(zero)).max(along * slant)), tall: along }
        };
        let mut fineness = self.mirrored.fineness(simd, extent(first.1));
        let (mut sum, mut seen) = (zero, zero);
        let mut light = [[0.0; 4]; GROUP];
        let is_close = count == CLOSE.0.len();
        let mut looks = [(middle, zero); MANY.0.len()];
        for k in 0..count {
            let look = [ONE.look(k), FEW.look(k), CLOSE.look(k), MANY.look(k)];
            let sigma = kinds.pick(simd, [look[0].0, look[1].0, look[2].0, look[3].0]);
            let weight = kinds.pick(simd, [look[0].1, look[1].1, look[2].1, look[3].1]);
            let (way, cosine) = if k == 0 { first } else { tilt.reflect(simd, sigma * rough) };
            // Slopes that look away from the eye are not seen.
            let weight = weight * cosine.max(point.sine * 0.02);
            let part = weight * fresnel_of(simd, cosine.max(zero));
            let mut at = middle;
            if k > 0 {
                let mut mirrored = from;
                for k in 0..3 {
                    mirrored[k] = far.mul_add(way[k], from[k]);
                }
                (at, _) = self.project(simd, &mirrored);
            }
            sum += weight;
            seen += part;
            if is_close {
                // Facets that are met at less of an angle throw light farther aside: of films,
                // whose looks are close, that is wider than they are apart.
                if k > 0 {
                    fineness = self.mirrored.fineness(simd, extent(cosine));
                }
                let wanted = (is_wet & part.simd_gt(zero)).to_bitmask() as u32;
                self.mirrored.add(simd, at, &fineness, (part, wanted), &mut light);
            } else {
                looks[k] = (at, part);
            }
        }
        if !is_close {
            let lanes = Seen { wanted, nearest: simd.set(NEARER) / z };
            self.mirrored.add_all(simd, &looks[..count], &fineness, lanes, &mut light);
        }
        let scale = one / sum;
        // Others may be films that are known already.
        let reflected = is_wet.select(seen * scale, simd.load(&water.reflected[start..]));
        reflected.store_slice(&mut water.reflected[start..start + S::N]);
        let scale = Kept::of(simd, scale);
        let mut todo = wanted;
        while todo != 0 {
            let i = (todo.trailing_zeros() & 15) as usize;
            todo &= todo - 1;
            for k in 0..3 {
                water.mirrored[k][start + i] = light[i][k] * scale.0[i];
            }
        }
    }

    /// Height of the lobe of a rough surface in the mirrored picture, standard deviation in px, of
    /// what is so far from water at a distance, m.
    #[inline(always)]
    fn lobe<S: Lanes>(&self, rough: S::F, far: S::F, distance: S::F) -> S::F {
        rough * (2.0 * self.focal[1]) * far / (far + distance)
    }

    /// Distances along reflected rays from points of the water to what is mirrored, m, found in the
    /// depth of the mirrored picture in two steps. On a rough surface it is the mean, in the
    /// reciprocal, over the middle of the lobe: the depth of one point would jump at the
    /// silhouettes of what is mirrored, and with it the size of the lobe.
    #[inline(always)]
    fn reach<S: Lanes>(&self, simd: S, facet: &Facet<S>, distance: S::F, is_wet: S::M) -> S::F {
        let Facet { from, first: (way, cosine), rough, .. } = facet;
        let (cosine, rough) = (*cosine, *rough);
        let farthest = simd.set(FAR);
        let mut far = farthest;
        let mut going = is_wet;
        for step in 0..2 {
            if step > 0 {
                // What was lost stays so.
                going &= far.simd_lt(farthest);
            }
            let wanted = going.to_bitmask() as u32;
            if wanted == 0 {
                break;
            }
            let mut point = *from;
            for k in 0..3 {
                point[k] = far.mul_add(way[k], from[k]);
            }
            let (at, z) = self.project(simd, &point);
            let tall = self.lobe::<S>(rough, far, distance);
            let is_sharp = tall.simd_lt(simd.set(SHARP));
            let sharp = wanted & is_sharp.to_bitmask() as u32;
            let mut inverse = self.mirrored.inverse_depth(simd, at, sharp);
            if sharp != wanted {
                let tall = tall * BLENDED;
                let narrow = cosine.max(self.slant(simd, at)).min(simd.set(1.0));
                let fineness = self.mirrored.fineness(simd, Extent { wide: tall * narrow, tall });
                inverse += self.mirrored.mean_inverse_depth(simd, at, &fineness, wanted & !sharp);
            }
            let inverse = inverse * (1.0 / self.metres);
            let is_met = z.simd_gt(simd.set(0.0)) & inverse.simd_ge(simd.set(1.0 / FAR));
            // The same ray through the eye, up to that depth.
            let scale = simd.set(1.0) / (inverse.max(simd.set(0.1 / FAR)) * z);
            let mut there = point;
            for k in 0..3 {
                there[k] = point[k].mul_add(scale, -from[k]);
            }
            let nearest = is_sharp.select(simd.set(0.01), (distance * BESIDE).max(simd.set(0.01)));
            let met = dot::<S>(&there, way).max(nearest).min(farthest);
            far = going.select(is_met.select(met, farthest), far);
        }
        far
    }

    /// Returns the share of its length, 0-1, by which an upright line leans to the side at points
    /// of the mirrored picture. Lobes lie along upright lines.
    #[inline(always)]
    fn slant<S: Lanes>(&self, simd: S, at: [S::F; 2]) -> S::F {
        let mut lean = at;
        for k in 0..2 {
            // The change of a picture point when its point rises, times its view z.
            let from_middle = at[k] - simd.set(self.principal[k]);
            lean[k] =
                from_middle.mul_add(simd.set(-self.view[2][2]), simd.set(self.focal[k] * self.view[k][2]));
        }
        let length = lean[0].mul_add(lean[0], lean[1] * lean[1]).sqrt().max(simd.set(1e-3));
        lean[0].max(-lean[0]) / length
    }

    /// Picture points of the mirrored view and view z in metres, of points from the mirrored eye.
    #[inline(always)]
    fn project<S: Lanes>(&self, simd: S, point: &[S::F; 3]) -> ([S::F; 2], S::F) {
        let mut view = *point;
        for (own, row) in view.iter_mut().zip(&self.view) {
            *own = point[0] * row[0];
            for k in 1..3 {
                *own = point[k].mul_add(simd.set(row[k]), *own);
            }
        }
        let [x, y, z] = view;
        let inverse = simd.set(1.0) / z.max(simd.set(1e-6));
        let at = [
            (x * inverse).mul_add(simd.set(self.focal[0]), simd.set(self.principal[0])),
            (y * inverse).mul_add(simd.set(self.focal[1]), simd.set(self.principal[1])),
        ];
        (at, z)
    }
}

/// Points of the water that are seen.
#[derive(Clone, Copy)]
struct Point<S: Lanes> {
    /// Directions to them, level axes, of length 1.
    toward: [S::F; 3],
    /// Their places from the eye, level axes, m.
    hit: [S::F; 3],
    /// Their distances, m.
    distance: S::F,
    /// Sines of the angles between the views and the level.
    sine: S::F,
}

impl<S: Lanes> Point<S> {
    /// The points through picture points of a row, at view z `z`, scene units; harmless numbers
    /// where that is NaN.
    #[inline(always)]
    fn new(scene: &Scene<'_>, simd: S, (x, y): (S::F, f32), z: S::F) -> Self {
        let z = z.simd_eq(z).select(z, simd.set(1.0));
        let (toward, long) = scene.toward(simd, x, y);
        let distance = z * long;
        let mut hit = toward;
        for k in 0..3 {
            hit[k] = toward[k] * distance;
        }
        Self { toward, hit, distance, sine: (-toward[2]).max(simd.set(1e-4)) }
    }
}

/// Pieces of the surface that pixels see.
struct Facet<S: Lanes> {
    /// Their places from the mirrored eye, level axes, m.
    from: [S::F; 3],
    tilt: Tilt<S>,
    /// The directions that their mean slopes reflect, and the cosines between them and the normals.
    first: ([S::F; 3], S::F),
    /// Standard deviations of their slopes along one axis.
    rough: S::F,
}

impl<S: Lanes> Facet<S> {
    /// Pieces about points with mean slopes along the two level axes, their variance, and slopes
    /// that do not move.
    #[inline(always)]
    fn new(scene: &Scene<'_>, simd: S, point: Point<S>, (slopes, still): ([S::F; 3], S::F)) -> Self {
        let [east, north, variance] = slopes;
        let Point { toward, hit, sine, .. } = point;
        let level = toward[0].mul_add(toward[0], toward[1] * toward[1]).sqrt().max(simd.set(1e-6));
        let along = [toward[0] / level, toward[1] / level];
        // Along the view and across it; what looks too far away is behind a crest.
        let ahead = east.mul_add(along[0], north * along[1]);
        let beside = north.mul_add(along[0], -(east * along[1]));
        let tilt = Tilt { toward, along, ahead, beside, least: sine / level * -HIDING };
        // The mirrored eye is that much below the plane, and the hit about in it.
        let from = [hit[0], hit[1], hit[2] + 2.0 * scene.height];
        let first = tilt.reflect(simd, simd.set(0.0));
        Self { from, tilt, first, rough: still.mul_add(still, variance).sqrt() }
    }
}

/// Views of water, and its mean slope.
struct Tilt<S: Lanes> {
    toward: [S::F; 3],
    /// The level direction of the view.
    along: [S::F; 2],
    /// The slope along it and across it.
    ahead: S::F,
    beside: S::F,
    /// The least slope along it that is seen.
    least: S::F,
}

impl<S: Lanes> Tilt<S> {
    /// Directions reflected by slopes that are so much more along the view, above the horizon, and
    /// the cosines between them and the normal.
    #[inline(always)]
    fn reflect(&self, simd: S, more: S::F) -> ([S::F; 3], S::F) {
        let Self { toward, along, beside, .. } = self;
        let ahead = (self.ahead + more).max(self.least);
        let slope =
            [ahead.mul_add(along[0], -(*beside * along[1])), ahead.mul_add(along[1], *beside * along[0])];
        let one = simd.set(1.0);
        let scale = one / slope[0].mul_add(slope[0], slope[1].mul_add(slope[1], one)).sqrt();
        let normal = [-slope[0] * scale, -slope[1] * scale, scale];
        let cosine = -dot::<S>(toward, &normal);
        let mut way = *toward;
        for k in 0..3 {
            way[k] = (cosine * 2.0).mul_add(normal[k], toward[k]);
        }
        // A second reflection sends up what the first sends down.
        way[2] = way[2].max(-way[2]).max(simd.set(1e-4));
        (way, cosine)
    }
}

/// Lanes by the looks that they need: the first mask that is set counts. Where none is, [`CLOSE`]
/// of films goes over into [`MANY`] of free water, so that films end without an edge.
struct Kinds<S: Lanes> {
    is_sharp: S::M,
    is_low: S::M,
    free: S::F,
}

impl<S: Lanes> Kinds<S> {
    /// A number of [`ONE`], [`FEW`], [`CLOSE`] or [`MANY`].
    #[inline(always)]
    fn pick(&self, simd: S, [one, few, close, many]: [f32; 4]) -> S::F {
        let many = self.free.mul_add(simd.set(many - close), simd.set(close));
        self.is_sharp.select(simd.set(one), self.is_low.select(simd.set(few), many))
    }
}

#[inline(always)]
fn dot<S: Lanes>(a: &[S::F; 3], b: &[S::F; 3]) -> S::F {
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]))
}

/// Sixteen pixels without what is before the water.
struct Behind {
    /// View z of the water, NaN where none is seen, and of where the ray ends without it.
    z: [f32; GROUP],
    bottom: [f32; GROUP],
    /// Share of light that gets past what is before the water.
    open: [f32; GROUP],
    /// Share of what is behind that splats fill.
    filled: [f32; GROUP],
    /// Display-referred colour of what is behind.
    light: [[f32; GROUP]; 3],
}

impl Behind {
    fn new() -> Self {
        let zero = [0.0; GROUP];
        Self { z: [f32::NAN; GROUP], bottom: zero, open: zero, filled: zero, light: [zero; 3] }
    }

    /// Finds it for as many pixels as there are lanes from `start` on.
    #[inline(always)]
    fn find<S: Lanes>(
        &mut self,
        simd: S,
        start: usize,
        (drawn, before): (&[[f32; GROUP]; 3], &[[f32; GROUP]; FRONT]),
        (alpha, z): (&[f32; GROUP], &[f32; GROUP]),
    ) {
        let own = start..start + S::N;
        let (zero, one) = (simd.set(0.0), simd.set(1.0));
        let (near, z) = (simd.load(&before[4][start..]), simd.load(&z[start..]));
        let open = one - near;
        open.store_slice(&mut self.open[own.clone()]);
        let is_seen = open.simd_ge(simd.set(HIDDEN));
        is_seen.select(z, simd.set(f32::NAN)).store_slice(&mut self.z[own.clone()]);
        let scale = one / open.max(simd.set(HIDDEN));
        for k in 0..3 {
            let light = (simd.load(&drawn[k][start..]) - simd.load(&before[k][start..])) * scale;
            light.max(zero).store_slice(&mut self.light[k][own.clone()]);
        }
        let behind = simd.load(&alpha[start..]) - near;
        (behind * scale).max(zero).min(one).store_slice(&mut self.filled[own.clone()]);
        // Thin splats say little of how deep the bottom is.
        let bottom = (behind / simd.load(&before[3][start..]).max(simd.set(1e-9))).max(z);
        let is_solid = behind.simd_gt(open * 1e-3);
        is_solid.select(bottom, z).store_slice(&mut self.bottom[own]);
    }
}

/// Notes that nothing is reflected in groups of pixels of a row.
#[inline(always)]
fn clear(front: &mut [f32]) {
    for group in front.chunks_mut(FRONT * GROUP) {
        let count = group.len() / FRONT;
        group[..count].fill(0.0);
    }
}

/// Finds the foam on the water of a flood; as many of sixteen pixels as there are lanes from
/// `start` on.
#[inline(always)]
fn find_foam<S: Lanes>(simd: S, start: usize, foam: &Foam, pixels: &mut FoamPixels) {
    let depth = simd.load(&pixels.depth[start..]);
    let is_flood = depth.simd_lt(simd.set(f32::INFINITY));
    if is_flood.any_true() {
        let [square, unseen] = [0, 1].map(|k| simd.load(&pixels.slopes[k][start..]));
        let share = foam.share(simd, depth, square, unseen);
        is_flood.select(share, simd.set(0.0)).store_slice(&mut pixels.share[start..start + S::N]);
    }
}

/// The first of so many numbers, and `rest` where there are fewer.
#[inline(always)]
fn padded<const N: usize>(values: &[f32], rest: f32) -> [f32; N] {
    if let Some(whole) = values.first_chunk::<N>() {
        return *whole;
    }
    let mut all = [rest; N];
    all[..values.len()].copy_from_slice(values);
    all
}

/// One array a number of up to sixteen pixels of `N` numbers, `ALL` for sixteen.
#[inline(always)]
fn columns<const N: usize, const ALL: usize>(pixels: &[f32]) -> [[f32; GROUP]; N] {
    let mut columns = [[0.0; GROUP]; N];
    if let Some(pixels) = pixels.first_chunk::<ALL>() {
        for i in 0..GROUP {
            for k in 0..N {
                columns[k][i] = pixels[N * i + k];
            }
        }
        return columns;
    }
    for (i, pixel) in pixels.as_chunks::<N>().0.iter().enumerate() {
        for k in 0..N {
            columns[k][i] = pixel[k];
        }
    }
    columns
}

/// Lays particles over a row: they are light and coverage, in linear light.
fn lay_particles(path: SimdPath, line: &mut [f32], particles: &[f32]) {
    let (pixels, _) = line.as_chunks_mut::<3>();
    let (falls, _) = particles.as_chunks::<4>();
    for (pixels, falls) in pixels.chunks_mut(GROUP).zip(falls.chunks(GROUP)) {
        if falls.iter().all(|fall| fall[3] == 0.0) {
            continue;
        }
        let mut light = [[0.0f32; GROUP]; 3];
        for (i, pixel) in pixels.iter().enumerate() {
            (0..3).for_each(|k| light[k][i] = pixel[k].max(0.0));
        }
        dispatch!(path, s => decode(s, &mut light));
        for (i, fall) in falls.iter().enumerate() {
            (0..3).for_each(|k| light[k][i] = light[k][i] * (1.0 - fall[3]) + fall[k]);
        }
        dispatch!(path, s => encode(s, &mut light));
        for (i, (pixel, fall)) in pixels.iter_mut().zip(falls).enumerate() {
            if fall[3] > 0.0 {
                *pixel = [light[0][i], light[1][i], light[2][i]];
            }
        }
    }
}
