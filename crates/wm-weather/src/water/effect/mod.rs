//! Lays the mirrored picture and the water over what is drawn.

mod behind;
mod nodes;
mod reflection;
mod scene;

pub use scene::WaterEffect;

use super::foam::Foam;
use super::fresnel::WATER_INDEX;
use super::mirror::MirroredPicture;
use behind::{Behind, clear, columns, lay_particles, padded};
use fearless_simd::{Select, SimdBase, SimdFloat, SimdMask};
use nodes::{NodeKind, ReflectionNodes};
use rayon::prelude::*;
use scene::{FoamPixels, Pixels, Scene, Water};
use std::f32::consts::LOG2_E;
use wm_render::hooks::{AirGroup, GROUP, ShadeGroup};
use wm_render::pixel_effects::apply_pixel_effects;
use wm_render::simd::{Lanes, SimdPath, exp2, srgb_decode, srgb_encode};
use wm_render::{FRONT_CHANNELS, Frame, PictureEffect, dispatch};

/// Share of the light from behind that may be lost before the water's own light is added.
const MAX_UNLIT_SHARE: f32 = 1.0 / 256.0;
/// Height above a flood, m, from which water does not belong to it.
const MIN_HEIGHT_ABOVE_FLOOD_M: f32 = 0.01;

impl PictureEffect for WaterEffect<'_> {
    fn apply(&self, path: SimdPath, picture: &mut Frame, inputs: &[&Frame]) {
        let mirrored = MirroredPicture::new(path, inputs[0], self.white);
        let scene = Scene::new(self, &mirrored);
        let has_films = !self.surface.roughness.is_empty();
        let films = has_films.then(|| ReflectionNodes::new(&scene, path, NodeKind::Films));
        let is_rough = self.motion.is_rough && !self.surface.is_film();
        let reach = is_rough.then(|| ReflectionNodes::new(&scene, path, NodeKind::Reach));
        let width = picture.width as usize;
        let Frame { rgb, front, depth, alpha, particles, .. } = picture;
        let (depth, alpha): (&[f32], &[f32]) = (depth, alpha);
        let rows = rgb.par_chunks_mut(3 * width).zip(front.par_chunks_mut(FRONT_CHANNELS * width));
        rows.enumerate().for_each(|(y, (line, front))| {
            let own = y * width..(y + 1) * width;
            let is_wet = self.surface.rows.contains(&(y as u32));
            if !is_wet {
                clear(front);
            } else {
                let mut row =
                    Row { y, surface: &self.surface.depth[own.clone()], front, alpha: &alpha[own.clone()] };
                dispatch!(path, s => scene.lay(s, path, films.as_ref(), reach.as_ref(), &mut row, line));
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

impl Scene<'_> {
    /// Lays water over one row of pixels, sixteen at a time.
    #[inline(always)]
    fn lay<S: Lanes>(
        &self,
        simd: S,
        path: SimdPath,
        films: Option<&ReflectionNodes>,
        reach: Option<&ReflectionNodes>,
        row: &mut Row<'_>,
        line: &mut [f32],
    ) {
        let width = row.surface.len();
        let surface = self.of.surface;
        let mut air = [AirGroup::default()];
        let foam = self.of.motion.foam.as_ref().filter(|_| self.of.map.plane().is_some());
        for first in (0..width).step_by(GROUP) {
            let count = GROUP.min(width - first);
            let z: [f32; GROUP] = padded(&row.surface[first..first + count], f32::NAN);
            let line = &mut line[3 * first..3 * (first + count)];
            let front = &mut row.front[FRONT_CHANNELS * first..FRONT_CHANNELS * (first + count)];
            let mut is_wet = false;
            for z in &z {
                is_wet |= !z.is_nan();
            }
            if !is_wet {
                clear(front);
                continue;
            }
            let drawn: [[f32; GROUP]; 3] = columns::<3, { 3 * GROUP }>(line);
            let mut before = [[0.0; GROUP]; FRONT_CHANNELS];
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
                behind.find(simd, start, &drawn, &before, &alpha, &z);
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
                reach: reach.map_or([f32::NAN; GROUP], |nodes| nodes.at(first, row.y, 0)),
            };
            for (i, x) in pixels.x.iter_mut().enumerate() {
                *x = (first + i) as f32 + 0.5;
            }
            let mut rays = ShadeGroup::default();
            if self.of.map.plane().is_some() {
                for start in (0..GROUP).step_by(S::N) {
                    self.through_flood(simd, start, &pixels, &behind, &mut water, &mut rays);
                }
            }
            if let Some(films) = films {
                films.write(first, row.y, &mut pixels, &mut water);
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
                is_deep |= wet >> i & 1 == 1 && water.left[i] < 1.0 - MAX_UNLIT_SHARE;
            }
            if let Some(foam) = &water.foam {
                for share in &foam.share {
                    is_deep |= *share > MAX_UNLIT_SHARE;
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
                self.mix(simd, start, &behind, &water, &before, &cover, &air[0], &mut shown);
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
    #[allow(clippy::too_many_arguments, reason = "the layers of one group of pixels")]
    fn mix<S: Lanes>(
        &self,
        simd: S,
        start: usize,
        behind: &Behind,
        water: &Water,
        before: &[[f32; GROUP]; FRONT_CHANNELS],
        cover: &[f32; GROUP],
        air: &AirGroup,
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
        pixels: &Pixels,
        behind: &Behind,
        water: &mut Water,
        rays: &mut ShadeGroup,
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
        let is_flood = is_wet & height.simd_le(simd.set(MIN_HEIGHT_ABOVE_FLOOD_M));
        is_flood.select(left, one).store_slice(&mut water.left[own.clone()]);
        if let Some(foam) = &mut water.foam {
            is_flood.select(deep, simd.set(f32::INFINITY)).store_slice(&mut foam.depth[own]);
        }
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
