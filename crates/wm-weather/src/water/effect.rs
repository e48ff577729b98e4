//! Lays the mirrored picture and the water over what is drawn.

use super::body::WaterBody;
use super::fresnel::fresnel;
use super::map::WaterMap;
use super::mirror::{MirrorView, MirroredPicture};
use super::motion::WaterMotion;
use super::surface::{FILM, NODES, WaterSurface};
use super::tile::Slope;
use crate::linear_picture::{decode, encode};
use rayon::prelude::*;
use wm_render::hooks::{AirGroup, GROUP, Medium, PixelEffect, ShadeGroup};
use wm_render::pixel_effects::apply_pixel_effects;
use wm_render::simd::SimdPath;
use wm_render::{FRONT, Frame, PictureEffect, dispatch};
use wm_scene::Camera;

/// Transmittance to the surface below which it is not seen.
const HIDDEN: f32 = 1.0 / 512.0;
/// Looks into a rough surface: standard deviations of the slope and their weights, normal distributions; and the width of each look
/// over the standard deviation of the lobe's height.
struct Looks(&'static [(f32, f32)], f32);
const ONE: Looks = Looks(&[(0.0, 1.0)], 0.0);
const FEW: Looks = Looks(&[(0.0, 0.62), (-1.62, 0.19), (1.62, 0.19)], 1.4);
const MANY: Looks = Looks(&[(0.0, 0.399), (-1.0, 0.242), (1.0, 0.242), (-2.0, 0.058), (2.0, 0.058)], 0.9);
/// Those of a film, which is looked into at few pixels: close enough that lamps are streaks and no blots.
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
/// Height of a lobe, standard deviations in px of the mirrored picture, below which one look is enough.
const SHARP: f32 = 0.35;
/// The same from which a few looks are too far apart.
const TALL: f32 = 5.0;
/// Slopes away from the eye, of the tangent of the view's elevation, from which crests hide what is behind them.
const HIDING: f32 = 0.7;
/// Share of the light behind the surface that may be missing where the water's own light is left out.
const THIN: f32 = 1.0 / 256.0;
/// Width of a look, px, over the standard deviation of the lobe across the view that it must have: a piece of a mirrored picture is a box and what is
/// mixed between its pixels.
const WIDE: f32 = 2.45;
/// Farthest that a mirrored point is from the water, m: beyond it nothing moves when the eye does.
const FAR: f32 = 1e5;

/// Water as a picture pass: its picture is drawn with [`wm_render::DrawPass::surface`], its only input is the mirrored one.
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
    /// The camera of the picture.
    pub camera: &'a Camera,
    /// The air before it.
    pub medium: Option<&'a dyn Medium>,
    /// The effects on finished pixels, in order.
    pub effects: &'a [&'a dyn PixelEffect],
}

/// The light of sixteen pixels, and of the water in them.
struct Group {
    /// Pixels with water, a bit each.
    wet: u32,
    /// Light behind the surface without water, then with it; linear.
    light: [[f32; GROUP]; 3],
    mirrored: [[f32; GROUP]; 3],
    /// Share of light that is reflected.
    reflected: [f32; GROUP],
    /// Share of the light behind that comes through.
    left: [f32; GROUP],
    cover: [f32; GROUP],
    rays: ShadeGroup,
}

impl Group {
    fn dry() -> Self {
        let zero = [0.0; GROUP];
        Self {
            wet: 0,
            light: [zero; 3],
            mirrored: [zero; 3],
            reflected: zero,
            left: [1.0; GROUP],
            cover: [1.0; GROUP],
            rays: ShadeGroup::default(),
        }
    }
}

/// What a film mirrors at nodes every few pixels: too blurred to differ between them.
struct FilmNodes {
    columns: usize,
    /// The share of light that is reflected, NaN where there is no film; and that light, linear RGB.
    nodes: Vec<[f32; 4]>,
}

impl FilmNodes {
    /// Looks into the films of a picture; `None` if it shows none.
    fn of(scene: &Scene<'_>, path: SimdPath) -> Option<Self> {
        let WaterSurface { depth, roughness, rows, .. } = scene.of.surface;
        if roughness.is_empty() {
            return None;
        }
        let size = (scene.of.camera.width as usize, scene.of.camera.height as usize);
        let columns = size.0.div_ceil(NODES) + 1;
        let mut nodes = vec![[f32::NAN; 4]; columns * (size.1.div_ceil(NODES) + 1)];
        nodes.par_chunks_mut(columns).enumerate().for_each(|(row, nodes)| {
            let y = (row * NODES).min(size.1 - 1);
            if !rows.contains(&(y as u32)) {
                return;
            }
            dispatch!(path, _s => scene.film_row(y, (depth, roughness), nodes));
        });
        Some(Self { columns, nodes })
    }

    /// The light that four pixels of a row mirror, from pixel (`x`, `y`) on; `None` if not all nodes about them are on films.
    #[inline(always)]
    fn at(&self, x: usize, y: usize) -> Option<[[f32; 4]; NODES]> {
        let (column, row) = (x / NODES, y / NODES);
        let down = (y % NODES) as f32 / NODES as f32;
        let [upper, lower] = [row, row + 1].map(|row| &self.nodes[row * self.columns + column..][..2]);
        let [left, right]: [[f32; 4]; 2] = std::array::from_fn(|side| {
            std::array::from_fn(|k| upper[side][k] + down * (lower[side][k] - upper[side][k]))
        });
        let is_film = !(left[0] + right[0]).is_nan();
        is_film.then(|| {
            std::array::from_fn(|i| {
                let share = i as f32 / NODES as f32;
                std::array::from_fn(|k| left[k] + share * (right[k] - left[k]))
            })
        })
    }
}

const _: () = assert!(GROUP.is_multiple_of(NODES), "pixels between two nodes are of one group");

impl PictureEffect for WaterEffect<'_> {
    fn apply(&self, path: SimdPath, picture: &mut Frame, inputs: &[&Frame]) {
        let mirrored = MirroredPicture::new(path, inputs[0]);
        let scene = Scene::new(self, &mirrored);
        let films = FilmNodes::of(&scene, path);
        let width = picture.width as usize;
        let Frame { rgb, front, depth, alpha, particles, .. } = picture;
        let (depth, alpha): (&[f32], &[f32]) = (depth, alpha);
        let rows = rgb.par_chunks_mut(3 * width).zip(front.par_chunks_mut(FRONT * width));
        rows.enumerate().for_each(|(y, (line, front))| {
            let own = y * width..(y + 1) * width;
            let is_wet = self.surface.rows.contains(&(y as u32));
            if !is_wet {
                front.as_chunks_mut::<FRONT>().0.iter_mut().for_each(|front| front[0] = 0.0);
            } else {
                let mut row =
                    Row { y, surface: &self.surface.depth[own.clone()], front, alpha: &alpha[own.clone()] };
                scene.lay(path, films.as_ref(), &mut row, line);
            }
            if !particles.is_empty() {
                lay_particles(path, line, &particles[4 * own.start..4 * own.end]);
            }
        });
        apply_pixel_effects(path, self.effects, width, rgb, (alpha, depth));
    }
}

/// One row of the picture that is drawn.
struct Row<'a> {
    y: usize,
    surface: &'a [f32],
    /// Its first number of each pixel takes the share of light that is reflected.
    front: &'a mut [f32],
    alpha: &'a [f32],
}

/// Numbers that all pixels share: metres along level axes from the eye, heights from the mirror's plane.
struct Scene<'a> {
    of: &'a WaterEffect<'a>,
    mirrored: &'a MirroredPicture,
    /// The eye, m along level axes from the world's origin.
    eye: [f64; 3],
    /// A ray through picture point (x, y), at view z 1: `axes[0] x + axes[1] y + axes[2]`, m along level axes.
    axes: [[f32; 3]; 3],
    /// Height of the eye over the mirror's plane, m.
    height: f32,
    /// Rows of the mirrored view's rotation, level axes.
    view: [[f32; 3]; 3],
    focal: [f32; 2],
    principal: [f32; 2],
    metres: f32,
    /// Level axes in world axes.
    level: [[f32; 3]; 3],
    /// Angle of a pixel, and of one of the mirrored picture.
    pixel: f32,
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
            eye,
            axes: [right, down, corner].map(|axis| single(to_level(axis).map(|v| v * metres))),
            height: (eye[2] - of.surface.level) as f32,
            view: [0, 1, 2].map(|k| single(to_level(rotation.row(k)))),
            focal: [view.fx as f32, view.fy as f32],
            principal: [view.cx as f32, view.cy as f32],
            metres: metres as f32,
            level: map.axes.map(single),
            pixel: camera.widest_pixel() as f32,
        }
    }

    /// Lays water over one row of pixels, sixteen at a time.
    fn lay(&self, path: SimdPath, films: Option<&FilmNodes>, row: &mut Row<'_>, line: &mut [f32]) {
        let width = row.surface.len();
        let mut air = [AirGroup::default()];
        for first in (0..width).step_by(GROUP) {
            let count = GROUP.min(width - first);
            let Some(mut group) = dispatch!(path, _s => self.group(row, films, (first, count), line)) else {
                (first..first + count).for_each(|x| row.front[FRONT * x] = 0.0);
                continue;
            };
            dispatch!(path, s => decode(s, &mut group.light));
            // A film has no light of its own.
            let is_deep = group.left.iter().any(|left| *left < 1.0 - THIN);
            if let Some(medium) = self.of.medium.filter(|_| is_deep) {
                let origin = self.of.camera.center().to_array().map(|v| v as f32);
                medium.evaluate(path, origin, std::slice::from_ref(&group.rays), &mut air);
            }
            for k in 0..3 {
                let glow = self.of.body.glow[k];
                for i in 0..GROUP {
                    let own = glow * air[0].transmittance[k][i] + air[0].airlight[k][i];
                    let dry = group.light[k][i];
                    let left = if is_deep { group.left[i] } else { 1.0 };
                    let below = left * dry + (1.0 - left) * own;
                    let water = (1.0 - group.reflected[i]) * below + group.mirrored[k][i];
                    group.light[k][i] = (dry + group.cover[i] * (water - dry)).max(0.0);
                }
            }
            dispatch!(path, s => encode(s, &mut group.light));
            for i in 0..count {
                let before = &mut row.front[FRONT * (first + i)..FRONT * (first + i + 1)];
                let open = 1.0 - before[4];
                if group.wet >> i & 1 == 1 {
                    for k in 0..3 {
                        line[3 * (first + i) + k] = before[k] + open * group.light[k][i];
                    }
                    before[0] = open * group.cover[i] * group.reflected[i];
                } else {
                    before[0] = 0.0;
                }
            }
        }
    }

    /// Looks into the water at sixteen pixels; `None` if none of them shows water.
    #[inline(always)]
    fn group(
        &self,
        row: &Row<'_>,
        films: Option<&FilmNodes>,
        (first, count): (usize, usize),
        line: &[f32],
    ) -> Option<Group> {
        let surface = self.of.surface;
        let mut group = Group::dry();
        let mut filled = [1.0; GROUP];
        for start in (0..count).step_by(NODES) {
            let film = films.and_then(|films| films.at(first + start, row.y));
            for i in start..(start + NODES).min(count) {
                let x = first + i;
                let z = row.surface[x];
                let front = &row.front[FRONT * x..FRONT * (x + 1)];
                let open = 1.0 - front[4];
                if z.is_nan() || open < HIDDEN {
                    continue;
                }
                group.wet |= 1 << i;
                for k in 0..3 {
                    group.light[k][i] = ((line[3 * x + k] - front[k]) / open).max(0.0);
                }
                let behind = row.alpha[x] - front[4];
                filled[i] = (behind / open).clamp(0.0, 1.0);
                let at = row.y * row.surface.len() + x;
                match film {
                    Some(film) if surface.roughness[at] > FILM => {
                        group.cover[i] = surface.cover[at];
                        group.reflected[i] = film[i - start][0];
                        (0..3).for_each(|k| group.mirrored[k][i] = film[i - start][k + 1]);
                        if filled[i] < 1.0 - THIN {
                            self.look_along(&mut group, i, self.ray(x, row.y), z);
                        }
                    }
                    _ => {
                        // Thin splats say little of how deep the bottom is.
                        let bottom =
                            if behind > 1e-3 * open { (behind / front[3].max(1e-9)).max(z) } else { z };
                        self.look(&mut group, i, (x, row.y), (z, bottom), at);
                    }
                }
            }
        }
        group.left.iter_mut().zip(filled).for_each(|(left, filled)| *left *= filled);
        (group.wet != 0).then_some(group)
    }

    /// Looks into the films of a row at its nodes.
    #[inline(always)]
    fn film_row(&self, y: usize, (depth, roughness): (&[f32], &[f32]), nodes: &mut [[f32; 4]]) {
        let width = self.of.camera.width as usize;
        let mut group = Group::dry();
        for (column, node) in nodes.iter_mut().enumerate() {
            let x = (column * NODES).min(width - 1);
            let (at, i) = (y * width + x, column % GROUP);
            let z = depth[at];
            if !z.is_nan() && roughness[at] > FILM {
                self.look(&mut group, i, (x, y), (z, z), at);
                let [red, green, blue] = group.mirrored.each_ref().map(|channel| channel[i]);
                *node = [group.reflected[i], red, green, blue];
            }
        }
    }

    /// A ray through the middle of a pixel, at view z 1, and its length; m along level axes.
    #[inline(always)]
    fn ray(&self, x: usize, y: usize) -> ([f32; 3], f32) {
        let (px, py) = (x as f32 + 0.5, y as f32 + 0.5);
        let ray: [f32; 3] =
            std::array::from_fn(|k| self.axes[0][k] * px + self.axes[1][k] * py + self.axes[2][k]);
        (ray, length(ray))
    }

    /// Notes the ray to the water at view z `z` for the air; returns its direction.
    #[inline(always)]
    fn look_along(&self, group: &mut Group, i: usize, (ray, long): ([f32; 3], f32), z: f32) -> [f32; 3] {
        let toward = ray.map(|v| v / long);
        group.rays.distance[i] = z * long / self.metres;
        for k in 0..3 {
            group.rays.direction[k][i] = (0..3).map(|axis| self.level[axis][k] * toward[axis]).sum();
        }
        toward
    }

    /// Looks into the water at one pixel: `z` is where the ray meets it, `bottom` where it ends without water.
    #[inline(always)]
    fn look(&self, group: &mut Group, i: usize, (x, y): (usize, usize), (z, bottom): (f32, f32), at: usize) {
        let surface = self.of.surface;
        if !surface.cover.is_empty() {
            group.cover[i] = surface.cover[at];
        }
        let still = if surface.roughness.is_empty() { 0.0 } else { surface.roughness[at] };
        let (ray, long) = self.ray(x, y);
        let toward = self.look_along(group, i, (ray, long), z);
        let distance = z * long;
        let sine = (-toward[2]).max(1e-4);
        // What a pixel sees of the surface is longer than wide; between both is what waves must be wider than.
        let across = self.pixel * distance;
        let hit = ray.map(|v| v * z);
        let place = [self.eye[0] + f64::from(hit[0]), self.eye[1] + f64::from(hit[1])];
        // A film between the grains of the ground has no waves.
        let free = (1.0 - still / FILM).max(0.0);
        let slope = match free > 0.0 {
            true => self.of.motion.at(place[0], place[1], across / (sine.sqrt() * sine.sqrt().sqrt())),
            false => Slope { mean: [0.0; 2], variance: 0.0 },
        };
        let slope = Slope { mean: slope.mean.map(|v| v * free), variance: slope.variance * free * free };
        let rough = (slope.variance + still * still).sqrt();

        // Depth of the water under the ray, and the way in it after the ray is bent.
        let deep = ((bottom - z) * long * sine).max(0.0);
        let bent = (1.0 - (1.0 - sine * sine) / (super::WATER_INDEX * super::WATER_INDEX)).sqrt();
        group.left[i] = self.of.body.left(deep / bent, deep);

        let level = toward[0].hypot(toward[1]).max(1e-6);
        let along = [toward[0] / level, toward[1] / level];
        // The mirrored eye is that much below the plane, and the hit about in it.
        let from_mirror = [hit[0], hit[1], hit[2] + 2.0 * self.height];
        // Along the view and across it; what looks too far away is behind a crest.
        let aside = [-along[1], along[0]];
        let [ahead, beside] = [along, aside].map(|axis| slope.mean[0] * axis[0] + slope.mean[1] * axis[1]);
        let least = -HIDING * sine / level;
        let tilted = |more: f32| {
            let ahead = (ahead + more).max(least);
            [0, 1].map(|k| ahead * along[k] + beside * aside[k])
        };
        let start = reflect(toward, tilted(0.0));
        let far = self.reach(from_mirror, start.0, if free > 0.0 { 2 } else { 1 });
        // A lobe as it is seen in the mirrored picture: two slopes tall, and as much narrower as a facet is met at less of an angle. Of
        // what stands at the water it is a point.
        let share = far / (far + distance);
        let tall = 2.0 * rough * self.focal[1] * share;
        let wide = WIDE * tall;
        let Looks(looks, apart) = match tall {
            tall if tall < SHARP => ONE,
            tall if tall < TALL => FEW,
            _ if free == 0.0 => CLOSE,
            _ => MANY,
        };
        let is_sharp = looks.len() == 1;
        let (mut sum, mut seen, mut light) = (0.0, 0.0, [0.0; 3]);
        for (sigma, weight) in looks {
            let (way, cosine) = if is_sharp { start } else { reflect(toward, tilted(sigma * rough)) };
            // Slopes that look away from the eye are not seen.
            let weight = weight * cosine.max(0.02 * sine);
            let part = weight * fresnel(cosine.max(0.0));
            // Facets that are met at less of an angle throw light farther aside.
            let width = if is_sharp { 1.0 } else { (wide * cosine.max(0.0)).max(apart * tall) };
            let point: [f32; 3] = std::array::from_fn(|k| from_mirror[k] + far * way[k]);
            let (u, v, _) = self.project(point);
            let pixel = self.mirrored.at(u, v, width);
            sum += weight;
            seen += part;
            (0..3).for_each(|k| light[k] += part * pixel[k]);
        }
        group.reflected[i] = seen / sum;
        (0..3).for_each(|k| group.mirrored[k][i] = light[k] / sum);
    }

    /// Distance along a reflected ray from a point of the water to what is mirrored, m, found in the depth of the mirrored picture in
    /// some steps.
    #[inline(always)]
    fn reach(&self, from: [f32; 3], way: [f32; 3], steps: u32) -> f32 {
        let mut far = FAR;
        for _ in 0..steps {
            let (u, v, z) = self.project(std::array::from_fn(|k| from[k] + far * way[k]));
            let inverse = self.mirrored.at(u, v, 1.0)[3] / self.metres;
            if z <= 0.0 || inverse < 1.0 / FAR {
                return FAR;
            }
            // The same ray through the eye, up to that depth.
            let point: [f32; 3] = std::array::from_fn(|k| from[k] + far * way[k]);
            let scale = 1.0 / (inverse * z);
            let there: [f32; 3] = std::array::from_fn(|k| point[k] * scale - from[k]);
            far = (there[0] * way[0] + there[1] * way[1] + there[2] * way[2]).clamp(0.01, FAR);
        }
        far
    }

    /// Picture point of the mirrored view and view z in metres, of a point from the mirrored eye.
    #[inline(always)]
    fn project(&self, point: [f32; 3]) -> (f32, f32, f32) {
        let [x, y, z] = self.view.map(|row| row[0] * point[0] + row[1] * point[1] + row[2] * point[2]);
        let inverse = 1.0 / z.max(1e-6);
        (self.focal[0] * x * inverse + self.principal[0], self.focal[1] * y * inverse + self.principal[1], z)
    }
}

/// A direction reflected by a surface of these slopes, above the horizon, and the cosine between it and the normal.
#[inline(always)]
fn reflect(toward: [f32; 3], slope: [f32; 2]) -> ([f32; 3], f32) {
    let scale = 1.0 / (1.0 + slope[0] * slope[0] + slope[1] * slope[1]).sqrt();
    let normal = [-slope[0] * scale, -slope[1] * scale, scale];
    let cosine = -(toward[0] * normal[0] + toward[1] * normal[1] + toward[2] * normal[2]);
    let mut way: [f32; 3] = std::array::from_fn(|k| toward[k] + 2.0 * cosine * normal[k]);
    // A second reflection sends up what the first sends down.
    way[2] = way[2].abs().max(1e-4);
    (way, cosine)
}

#[inline(always)]
fn length(v: [f32; 3]) -> f32 {
    (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt()
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
