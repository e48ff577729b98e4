//! Lamps as a camera sees them: the lamps themselves, and their light in the air.
//!
//! Air of scattering `s` shows of a lamp of intensity `I`, at the distance `h` from a ray and
//! abreast of it at `t0`,
//!
//! `L = integral s I p(a) T(t) T(r) / r^2 dt = (1 / h) integral s I p(a) T(t) T(r) dphi`,
//! `t = t0 + h tan phi`,
//!
//! with `r` from the lamp, `a` the angle of deflection and `p` the phase function of Henyey and
//! Greenstein. The strong forward peak of fog is left in the beam (delta scaling): of `g = 0.85` a
//! share `f = g^2` is not scattered at all, and the rest with `g' = g / (1 + g)`; so light that was
//! scattered several times by small angles is still there. What lies in the shadow of something
//! shows no light.
//!
//! The sum is a table over the picture, one column of nodes along the ray at each corner of the
//! patches of pixels, linear between them. Every fourth corner is summed up; those between are too,
//! unless the light around them is nearly even. A lamp is a disc that is blurred by the pixel, with
//! all of its light.
//!
//! A column has twenty nodes, the eye first and then ever farther ones, and holds the light that
//! the air scatters once on the way to each, with the shadows of the lamps. Patches near a lamp
//! have finer tables.

mod lamps_on;
mod scene;

use super::lamps::{LampKind, LampLight, SeenLight};
use crate::optics::{Atmosphere, Site};
use fearless_simd::{SimdBase, SimdFloat, SimdMask};
pub use lamps_on::{LampsOn, ShadowedLight};
use scene::{COLUMN_LENGTH, Column, FIRST_NODE_M, GlowScene, NODE_DISTANCE_RATIO, RAY_NODE_COUNT};
use std::f64::consts::{PI, TAU};
use wm_render::dispatch;
use wm_render::hooks::{GROUP, Medium, PATCH, PATCH_PIXELS, PixelBatch, PixelEffect};
use wm_render::simd::{self, Lanes, SimdPath, log2_rough, reciprocal};
use wm_scene::Camera;

const LEAST_IN_ROW: f32 = 2e-5;
/// A surface that is nearer than a lamp by more than this hides it, m.
const HIDING_DISTANCE_M: f32 = 0.6;
/// Variance of the blur by a pixel, px^2.
const PIXEL_VARIANCE_PX2: f32 = 0.35;
/// Extent of a lamp's image.
const IMAGE_REACH_SIGMAS: f32 = 4.0;

/// The picture of lamps and of their light in the air, for one camera.
pub(crate) struct LampGlow {
    /// Light of each column's nodes, linear RGB, `[rows, columns]`; empty in clear air.
    pub(super) table: Vec<Column>,
    columns: usize,
    /// For each patch, the place in `fine` of its own table, if it is near a lamp.
    near: Vec<Option<u32>>,
    /// Tables of patches, `[side, side]` with the sides of [`scene::NEAR_LAMP_TABLES`], plus 1.
    fine: Vec<Vec<Column>>,
    heads: Vec<Head>,
    /// Focal lengths and principal point, which lead from pixels to rays of view z 1.
    focal: [f32; 2],
    principal: [f32; 2],
    metres_per_unit: f32,
}

type AddedLight = [[f32; PATCH_PIXELS]; 3];

/// A lamp in the picture.
#[derive(Clone, Copy, Debug)]
struct Head {
    /// px.
    at: [f32; 2],
    /// View z, scene units, of what hides it at most.
    hides: f32,
    /// -1 / (2 variance), 1/px^2, and reach, px.
    exponent: f32,
    reach: f32,
    /// Light in its middle, linear RGB.
    peak: [f32; 3],
}

impl LampGlow {
    /// Lamps seen by a camera through air. The table is the same for any number of threads.
    pub(crate) fn new(
        lamps: &LampsOn<'_>,
        camera: &Camera,
        air: &Atmosphere,
        site: &Site,
        path: SimdPath,
    ) -> Self {
        let (width, height) = (camera.width as usize, camera.height as usize);
        let [columns, rows] = [width, height].map(|side| side.div_ceil(PATCH) + 1);
        let scene = GlowScene::new(lamps, camera, air, site);
        let (mut table, mut near, mut fine) = (Vec::new(), Vec::new(), Vec::new());
        if !air.is_clear() && !scene.lights.is_empty() {
            table = scene.table([columns, rows], path);
            (near, fine) = scene.near_lamps(&table, columns, path);
        }
        let heads =
            lamps.lights.iter().filter_map(|(light, _)| Head::new(light, lamps.display, camera, air, site));
        Self {
            table,
            columns,
            near,
            fine,
            heads: heads.collect(),
            focal: [camera.fx as f32, camera.fy as f32],
            principal: [camera.cx as f32, camera.cy as f32],
            metres_per_unit: site.metres_per_unit as f32,
        }
    }

    /// Adds the light of the air before each pixel of a patch, and what else is `added`. Each kind
    /// of table has vectors of its own: one function of all of them takes the compiler minutes.
    fn add_glow(&self, path: SimdPath, pixels: &mut PixelBatch<'_>, added: Option<&AddedLight>) {
        let (column, row) = (pixels.x as usize / PATCH, pixels.y as usize / PATCH);
        match self.near[row * (self.columns - 1) + column].map(|at| &self.fine[at as usize]) {
            None => {
                let at = |x: usize, y: usize| &self.table[(row + y) * self.columns + column + x];
                dispatch!(path, s => self.add_between::<_, 2>(s, pixels, added, at));
            }
            Some(fine) if fine.len() == 9 => {
                let at = |x: usize, y: usize| &fine[3 * y + x];
                dispatch!(path, s => self.add_between::<_, 3>(s, pixels, added, at));
            }
            Some(fine) => {
                let at = |x: usize, y: usize| &fine[5 * y + x];
                dispatch!(path, s => self.add_between::<_, 5>(s, pixels, added, at));
            }
        }
    }

    /// [`Self::add_glow`] by a table of `E` times `E` columns, evenly spread from edge to edge of
    /// the patch.
    #[inline(always)]
    fn add_between<'a, S: Lanes, const E: usize>(
        &self,
        simd: S,
        pixels: &mut PixelBatch<'_>,
        added: Option<&AddedLight>,
        table: impl Fn(usize, usize) -> &'a Column,
    ) {
        const LAST_NODE_START: usize = 3 * (RAY_NODE_COUNT - 1);
        let mut places = [0.0; PATCH_PIXELS];
        let nodes = self.node_places(simd, pixels, &mut places);
        let part = 3 * nodes.start() / S::N * S::N..3 * (nodes.end() + 1);
        let rest = (LAST_NODE_START / S::N * S::N).max(part.end.next_multiple_of(S::N));
        let shares = const { shares_of_edges::<E>() };
        let side = PATCH / (E - 1);
        let mut edges = [[0.0f32; COLUMN_LENGTH]; E];
        for y in 0..PATCH {
            let down = (y % side) as f32 / side as f32 + 0.5 / side as f32;
            for (x, edge) in edges.iter_mut().enumerate() {
                let (above, below) = (table(x, y / side), table(x, y / side + 1));
                for at in part.clone().step_by(S::N).chain((rest..COLUMN_LENGTH).step_by(S::N)) {
                    let above = simd.load(&above[at..]);
                    let light = (simd.load(&below[at..]) - above).mul_add(simd.set(down), above);
                    light.store_slice(&mut edge[at..at + S::N]);
                }
            }
            for x in (0..PATCH).step_by(S::N) {
                let first = y * PATCH + x;
                let (alpha, place) = (simd.load(&pixels.alpha[first..]), simd.load(&places[first..]));
                let behind = simd.set(1.0) - alpha;
                let mut sums = [[behind; 3]; E];
                for e in 0..E {
                    for k in 0..3 {
                        sums[e][k] = behind * edges[e][LAST_NODE_START + k];
                    }
                }
                for node in nodes.clone() {
                    let apart = (place - node as f32).abs();
                    if !apart.simd_lt(simd.set(1.0)).any_true() {
                        continue;
                    }
                    let weight = alpha * (simd.set(1.0) - apart).max(simd.set(0.0));
                    for e in 0..E {
                        for k in 0..3 {
                            sums[e][k] = weight.mul_add(simd.set(edges[e][3 * node + k]), sums[e][k]);
                        }
                    }
                }
                let mut glow = [simd.set(0.0); 3];
                if let Some(added) = added {
                    for k in 0..3 {
                        glow[k] = simd.load(&added[k][first..]);
                    }
                }
                for e in 0..E {
                    let share = simd.load(&shares[e][x..]);
                    for k in 0..3 {
                        glow[k] = sums[e][k].mul_add(share, glow[k]);
                    }
                }
                if glow[0].max(glow[1]).max(glow[2]).simd_gt(simd.set(LEAST_IN_ROW)).any_true() {
                    add_light(simd, pixels.rgb, first, glow);
                }
            }
        }
    }

    /// Finds the distance of each pixel's surface on the scale of the nodes (2.5 is half way
    /// between the nodes 2 and 3), and returns the nodes that the patch needs.
    #[inline(always)]
    fn node_places<S: Lanes>(
        &self,
        simd: S,
        pixels: &PixelBatch<'_>,
        places: &mut [f32; PATCH_PIXELS],
    ) -> std::ops::RangeInclusive<usize> {
        let steps: [f32; GROUP] = std::array::from_fn(|lane| lane as f32 + 0.5);
        let (one, last) = (simd.set(1.0), simd.set((RAY_NODE_COUNT - 1) as f32));
        let scale = self.metres_per_unit / FIRST_NODE_M;
        let (mut least, mut most) = (last, simd.set(0.0));
        for first in (0..PATCH_PIXELS).step_by(S::N) {
            let (x, y) = (first % PATCH, first / PATCH);
            let left = pixels.x as f32 + x as f32 - self.principal[0];
            let u = (simd.load(&steps) + left) * self.focal[0].recip();
            let v = (pixels.y as f32 + y as f32 + 0.5 - self.principal[1]) / self.focal[1];
            let alpha = simd.load(&pixels.alpha[first..]);
            // Squares, in distances of the nearest node.
            let kept = reciprocal(simd, [alpha.max(simd.set(1e-6))])[0];
            let depth = simd.load(&pixels.depth_sum[first..]) * kept * scale;
            let squared = depth * depth * u.mul_add(u, simd.set(1.0 + v * v));
            let farther = log2_rough(simd, [squared.max(one)])[0] * (0.5 / NODE_DISTANCE_RATIO.log2());
            // Up to the nearest node it goes evenly.
            let mut nearer = one;
            if squared.simd_lt(one).any_true() {
                nearer = squared.min(one).sqrt();
            }
            let place = (farther + nearer).min(last);
            (least, most) = (least.min(place), most.max(place));
            place.store_slice(&mut places[first..first + S::N]);
        }
        let mut ends = [[0.0; GROUP]; 2];
        least.store_slice(&mut ends[0][..S::N]);
        most.store_slice(&mut ends[1][..S::N]);
        let least = ends[0][..S::N].iter().copied().fold(f32::INFINITY, f32::min);
        let most = ends[1][..S::N].iter().copied().fold(0.0, f32::max);
        least as usize..=(most.ceil() as usize).min(RAY_NODE_COUNT - 1)
    }

    /// Adds the lamps in a patch.
    fn add_heads(&self, pixels: &PixelBatch<'_>, added: &mut AddedLight) {
        let (left, top) = (pixels.x as f32, pixels.y as f32);
        for head in self.heads.iter().filter(|head| head.is_in(pixels)) {
            let [x, y] = head.at;
            for at in 0..PATCH_PIXELS {
                let [dx, dy] = [left + (at % PATCH) as f32 + 0.5 - x, top + (at / PATCH) as f32 + 0.5 - y];
                let alpha = pixels.alpha[at];
                let is_hidden = alpha > 0.0 && pixels.depth_sum[at] < head.hides * alpha;
                let seen = if is_hidden { 1.0 - alpha } else { 1.0 };
                let share = seen * ((dx * dx + dy * dy) * head.exponent).exp();
                (0..3).for_each(|k| added[k][at] += share * head.peak[k]);
            }
        }
    }

    /// Adds light to a patch.
    #[inline(always)]
    fn add_all<S: Lanes>(simd: S, pixels: &mut PixelBatch<'_>, added: &AddedLight) {
        for first in (0..PATCH_PIXELS).step_by(S::N) {
            let mut light = [simd.set(0.0); 3];
            for k in 0..3 {
                light[k] = simd.load(&added[k][first..]);
            }
            add_light(simd, pixels.rgb, first, light);
        }
    }
}

/// Adds linear light to as many pixels as a vector has lanes.
#[inline(always)]
fn add_light<S: Lanes>(simd: S, rgb: &mut AddedLight, first: usize, added: [S::F; 3]) {
    let mut light = added;
    for k in 0..3 {
        light[k] = simd.load(&rgb[k][first..]);
    }
    light = simd::srgb_decode_rough(simd, light);
    for k in 0..3 {
        light[k] += added[k];
    }
    let shown = simd::srgb_encode_rough(simd, light);
    for k in 0..3 {
        shown[k].store_slice(&mut rgb[k][first..first + S::N]);
    }
}

/// The share that each of `E` edges has in each pixel between them.
const fn shares_of_edges<const E: usize>() -> [[f32; PATCH]; E] {
    let mut shares = [[0.0; PATCH]; E];
    let side = PATCH / (E - 1);
    let mut x = 0;
    while x < PATCH {
        let share = (x % side) as f32 / side as f32 + 0.5 / side as f32;
        shares[x / side][x] = 1.0 - share;
        shares[x / side + 1][x] = share;
        x += 1;
    }
    shares
}

impl PixelEffect for LampGlow {
    fn apply(&self, path: SimdPath, pixels: &mut PixelBatch<'_>) {
        let mut added = [[0.0; PATCH_PIXELS]; 3];
        let has_heads = self.heads.iter().any(|head| head.is_in(pixels));
        if has_heads {
            self.add_heads(pixels, &mut added);
        }
        if !self.table.is_empty() {
            self.add_glow(path, pixels, has_heads.then_some(&added));
        } else if has_heads {
            dispatch!(path, s => Self::add_all(s, pixels, &added));
        }
    }
}

impl Head {
    /// Returns true if its picture reaches a patch.
    fn is_in(&self, pixels: &PixelBatch<'_>) -> bool {
        let within = |at: f32, first: u32| {
            (first as f32 - self.reach..(first as f32 + PATCH as f32) + self.reach).contains(&at)
        };
        within(self.at[0], pixels.x) && within(self.at[1], pixels.y)
    }

    /// The picture of a lamp; `None` of windows, which are surfaces, and of what is not in the
    /// picture.
    fn new(light: &LampLight, display: f32, camera: &Camera, air: &Atmosphere, site: &Site) -> Option<Self> {
        if light.kind != LampKind::Ball {
            return None;
        }
        let SeenLight { view, pixel, to_eye, length } = light.seen_by(camera, camera.near)?;
        let at = pixel.to_array();
        let pixels = camera.fx * camera.fy;
        let radius = f64::from(light.radius) / (view.z * site.metres_per_unit) * pixels.sqrt();
        let variance = 0.25 * radius * radius + f64::from(PIXEL_VARIANCE_PX2);
        let reach = f64::from(IMAGE_REACH_SIGMAS) * variance.sqrt();
        let size = [camera.width, camera.height].map(f64::from);
        if !(0..2).all(|k| at[k] > -reach && at[k] < size[k] + reach) {
            return None;
        }
        let towards = to_eye / length;
        let kept =
            air.evaluate_reference(camera.center().to_array(), (-towards).to_array(), length).transmittance;
        // The light that reaches the camera goes to the pixels of its picture; each holds this
        // solid angle, and a radiance of L is shown as pi L.
        let solid_angle = (view.z / length).powi(3) / pixels;
        let distance = length * site.metres_per_unit;
        let share = f64::from(light.share(towards.as_vec3())) / (distance * distance);
        let per_candela = PI * f64::from(display) * share / (solid_angle * TAU * variance);
        let peak = std::array::from_fn(|k| (f64::from(light.intensity[k]) * per_candela * kept[k]) as f32);
        Some(Self {
            at: at.map(|v| v as f32),
            hides: (view.z - f64::from(HIDING_DISTANCE_M + light.radius) / site.metres_per_unit) as f32,
            exponent: (-0.5 / variance) as f32,
            reach: reach as f32,
            peak,
        })
    }
}
