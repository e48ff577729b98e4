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

use super::lamp_shadows::DepthCube;
use super::lamps::{LampKind, LampLight};
use crate::optics::{AirView, Atmosphere, SKY_DISTANCE_M, Site};
use crate::threads::map;
use fearless_simd::{SimdBase, SimdFloat, SimdMask};
use glam::Vec3;
use std::f32::consts::LOG2_E;
use std::f64::consts::{PI, TAU};
use wm_render::dispatch;
use wm_render::hooks::{GROUP, Medium, PATCH, PATCH_PIXELS, PixelBatch, PixelEffect};
use wm_render::simd::{self, Lanes, SimdPath, exp2, log2, log2_rough, powf, reciprocal};
use wm_scene::Camera;

/// Asymmetry of the phase function of fog.
const FOG: f32 = 0.85;
/// Share that goes on as if it were not scattered, and the asymmetry of the rest.
const FORWARD: f32 = FOG * FOG;
const ASYMMETRY: f32 = FOG / (1.0 + FOG);
/// Nodes along a ray: the eye, then from [`FIRST_NODE_M`] on, each [`STEP`] times as far as the one
/// before, the last for all that is farther.
const NODES: usize = 20;
const FIRST_NODE_M: f32 = 0.75;
const STEP: f32 = 1.5;
/// Distance of a patch from a lamp up to which it has a table of its own, patches, and the cells of
/// that along a side: one cell is 3 % off at three patches from a lamp, two cells are 2 % off at
/// two, and four at one.
const FINE: [(i64, usize); 2] = [(2, 4), (3, 2)];
const NEAR_PATCHES: i64 = FINE[1].0;
/// Numbers of a column, for whole vectors.
const COLUMN: usize = (3 * NODES).next_multiple_of(GROUP);
/// Patches from corner to corner at which columns are summed up everywhere.
const WIDEST: usize = 4;
/// Share of the most light by which the columns around a corner differ at most where what is linear
/// between them stands for it: within 1 % of light that falls off smoothly.
const MAX_COLUMN_DIFFERENCE: f32 = 0.3;
/// Columns that are summed up at once, and patches near a lamp.
const COLUMNS_AT_ONCE: usize = 64;
const PATCHES_AT_ONCE: usize = 8;
/// Share of the way from the end of an angle to its middle at which Gauss's node lies along the
/// chord: for a small angle, and how much more it is for a right one.
const GAUSS: [f32; 2] = [0.422_65, 0.016_6];
/// Sine of half of an angle up to which its middle tells enough: within 0.5 %.
const NARROW: f32 = 0.15;
/// Least distance of a ray from a lamp, m.
const MIN_RAY_DISTANCE_M: f32 = 0.05;
/// Light that is left out, in units of display white: of a lamp, and of all of them in a row of
/// pixels, which changes black by a fifteenth of a step of 8 bits.
const MIN_LIGHT: f32 = 2e-4;
const LEAST_IN_ROW: f32 = 2e-5;
/// A surface that is nearer than a lamp by more than this hides it, m.
const HIDING_DISTANCE_M: f32 = 0.6;
/// Variance of the blur by a pixel, px^2.
const PIXEL: f32 = 0.35;
/// Standard deviations as far as a lamp's picture reaches.
const REACH: f32 = 4.0;

/// A light, and the surfaces that it sees first, if it casts shadows.
pub type ShadowedLight<'a> = (LampLight, Option<&'a DepthCube>);

/// The lamps of a place that shine in a frame.
#[derive(Clone, Copy, Debug)]
pub struct LampsOn<'a> {
    /// The lamps, with the shadows that they cast.
    pub lights: &'a [ShadowedLight<'a>],
    /// Display units of a lux: an irradiance of that brings a white surface to display white.
    pub display: f32,
}

impl LampsOn<'_> {
    /// Radiance of a small particle of albedo 1 at an offset from the eye at `center` (world axes,
    /// scene units), averaged over its face, linear RGB as it is displayed. `asymmetry` is that of
    /// Henyey and Greenstein's phase function.
    pub(crate) fn scattered(&self, center: Vec3, offset: Vec3, asymmetry: f32, metres_per_unit: f32) -> Vec3 {
        let mut sum = Vec3::ZERO;
        let to_eye = -offset.normalize_or_zero();
        for (light, cube) in self.lights {
            let from_lamp = center + offset - Vec3::from_array(light.at);
            let metres = from_lamp * metres_per_unit;
            let squared = metres
                .length_squared()
                .max(MIN_RAY_DISTANCE_M * MIN_RAY_DISTANCE_M + light.radius * light.radius);
            let intensity = Vec3::from_array(light.intensity) * (PI as f32 * self.display);
            // At most some three times an even spread, but for what is nearly in front of the lamp.
            if intensity.max_element() < MIN_LIGHT * squared {
                continue;
            }
            let direction = metres / squared.sqrt();
            let cos = direction.dot(to_eye);
            let denominator = 1.0 + asymmetry * asymmetry - 2.0 * asymmetry * cos;
            let phase = (1.0 - asymmetry * asymmetry) / (4.0 * PI as f32 * denominator * denominator.sqrt());
            let share = light.share(direction) * phase / squared;
            if share > 0.0 && cube.is_none_or(|cube| cube.is_open(from_lamp)) {
                sum += intensity * share;
            }
        }
        sum
    }
}

/// The picture of lamps and of their light in the air, for one camera.
pub(crate) struct LampGlow {
    /// Light of each column's nodes, linear RGB, `[rows, columns]`; empty in clear air.
    table: Vec<Column>,
    columns: usize,
    /// For each patch, the place in `fine` of its own table, if it is near a lamp.
    near: Vec<Option<u32>>,
    /// Tables of patches, `[side, side]` with the sides of [`FINE`], plus 1.
    fine: Vec<Vec<Column>>,
    heads: Vec<Head>,
    /// From pixels to the ray of view z 1.
    focal: [f32; 2],
    principal: [f32; 2],
    metres_per_unit: f32,
}

/// Light up to each node along a ray, linear RGB, `[NODES, 3]` and zeros.
type Column = [f32; COLUMN];
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

/// Distance of a node, m.
fn node_distance(node: usize) -> f32 {
    if node == 0 { 0.0 } else { FIRST_NODE_M * STEP.powi(node as i32 - 1) }
}

impl LampGlow {
    /// Lamps seen by a camera through air. The table is the same for any number of threads.
    pub(crate) fn new(
        lamps: &LampsOn<'_>,
        camera: &Camera,
        air: &Atmosphere,
        site: &Site,
        path: SimdPath,
        threads: usize,
    ) -> Self {
        let (width, height) = (camera.width as usize, camera.height as usize);
        let [columns, rows] = [width, height].map(|side| side.div_ceil(PATCH) + 1);
        let scene = GlowScene::new(lamps, camera, air, site);
        let (mut table, mut near, mut fine) = (Vec::new(), Vec::new(), Vec::new());
        if !air.is_clear() && !scene.lights.is_empty() {
            table = scene.table([columns, rows], path, threads);
            (near, fine) = scene.near_lamps(&table, columns, path, threads);
        }
        let heads =
            lamps.lights.iter().filter_map(|(light, _)| Head::of(light, lamps.display, camera, air, site));
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

    /// Leaves the lamps alone in the picture.
    #[cfg(test)]
    pub(super) fn clear_air_light(&mut self) {
        self.table.clear();
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
        const LAST: usize = 3 * (NODES - 1);
        let mut places = [0.0; PATCH_PIXELS];
        let nodes = self.node_places(simd, pixels, &mut places);
        let part = 3 * nodes.start() / S::N * S::N..3 * (nodes.end() + 1);
        let rest = (LAST / S::N * S::N).max(part.end.next_multiple_of(S::N));
        let shares = const { shares_of_edges::<E>() };
        let side = PATCH / (E - 1);
        let mut edges = [[0.0f32; COLUMN]; E];
        for y in 0..PATCH {
            let down = (y % side) as f32 / side as f32 + 0.5 / side as f32;
            for (x, edge) in edges.iter_mut().enumerate() {
                let (above, below) = (table(x, y / side), table(x, y / side + 1));
                for at in part.clone().step_by(S::N).chain((rest..COLUMN).step_by(S::N)) {
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
                        sums[e][k] = behind * edges[e][LAST + k];
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
        let (one, last) = (simd.set(1.0), simd.set((NODES - 1) as f32));
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
            let farther = log2_rough(simd, [squared.max(one)])[0] * (0.5 / STEP.log2());
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
        least as usize..=(most.ceil() as usize).min(NODES - 1)
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
    fn of(light: &LampLight, display: f32, camera: &Camera, air: &Atmosphere, site: &Site) -> Option<Self> {
        if light.kind != LampKind::Ball {
            return None;
        }
        let point = Vec3::from_array(light.at).as_dvec3();
        let view = camera.rotation() * (point - camera.center());
        if view.z <= camera.near {
            return None;
        }
        let at = [camera.fx * view.x / view.z + camera.cx, camera.fy * view.y / view.z + camera.cy];
        let pixels = camera.fx * camera.fy;
        let radius = f64::from(light.radius) / (view.z * site.metres_per_unit) * pixels.sqrt();
        let variance = 0.25 * radius * radius + f64::from(PIXEL);
        let reach = f64::from(REACH) * variance.sqrt();
        let size = [camera.width, camera.height].map(f64::from);
        if !(0..2).all(|k| at[k] > -reach && at[k] < size[k] + reach) {
            return None;
        }
        let length = view.length();
        let towards = (camera.center() - point) / length;
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

/// The inputs of the table.
struct GlowScene<'a> {
    lights: Vec<GlowLight<'a>>,
    air: &'a Atmosphere,
    origin: [f32; 3],
    /// Rows of the rotation from view to world, and the factor from pixels.
    axes: [Vec3; 3],
    focal: [f32; 2],
    principal: [f32; 2],
    metres_per_unit: f32,
}

/// A lamp as the table needs it.
#[derive(Clone, Copy)]
struct GlowLight<'a> {
    light: LampLight,
    cube: Option<&'a DepthCube>,
    /// From the camera, m, world axes.
    offset: Vec3,
    /// Extinction at the lamp, 1/m, by channel.
    extinction: [f32; 3],
    /// Intensity in display units: times pi, lux to display white.
    intensity: [f32; 3],
}

impl<'a> GlowScene<'a> {
    fn new(lamps: &LampsOn<'a>, camera: &Camera, air: &'a Atmosphere, site: &Site) -> Self {
        let metres_per_unit = site.metres_per_unit as f32;
        let origin = camera.center().as_vec3();
        let rotation = camera.rotation();
        let lights = lamps.lights.iter().filter_map(|(light, cube)| {
            let offset = (Vec3::from_array(light.at) - origin) * metres_per_unit;
            let extinction = air.extinction_at(light.at.map(f64::from)).map(|v| v as f32);
            let intensity = light.intensity.map(|v| v * PI as f32 * lamps.display);
            // The most that it adds a metre from it, where half of what is scattered goes towards
            // the eye.
            let kept = (-extinction[1] * (1.0 - FORWARD) * offset.length()).exp();
            let most = intensity[1] * extinction[1] * (1.0 - FORWARD) * 0.25 * kept;
            let is_seen = most > MIN_LIGHT;
            is_seen.then_some(GlowLight { light: *light, cube: *cube, offset, extinction, intensity })
        });
        Self {
            lights: lights.collect(),
            air,
            origin: origin.to_array(),
            axes: [0, 1, 2].map(|k| rotation.row(k).as_vec3()),
            focal: [camera.fx as f32, camera.fy as f32],
            principal: [camera.cx as f32, camera.cy as f32],
            metres_per_unit,
        }
    }

    /// The columns at the corners of patches, `[rows, columns]`.
    fn table(&self, size: [usize; 2], path: SimdPath, threads: usize) -> Vec<Column> {
        let [columns, rows] = size;
        let mut table = vec![[0.0; COLUMN]; columns * rows];
        let sum_up = |table: &mut [Column], corners: &[usize]| {
            let found = map(corners.len().div_ceil(COLUMNS_AT_ONCE), threads, |run| {
                let corners = &corners
                    [run * COLUMNS_AT_ONCE..(run * COLUMNS_AT_ONCE + COLUMNS_AT_ONCE).min(corners.len())];
                let place = |at: &usize| [at % columns, at / columns].map(|v| (v * PATCH) as f32);
                let places: Vec<[f32; 2]> = corners.iter().map(place).collect();
                let mut out = vec![[0.0; COLUMN]; corners.len()];
                self.columns(path, &places, &self.lights, &mut out);
                out
            });
            corners.iter().zip(found.into_iter().flatten()).for_each(|(at, column)| table[*at] = column);
        };
        // The last column and row belong to every grid.
        let is_in = |at: usize, count: usize, step: usize| at.is_multiple_of(step) || at + 1 == count;
        let is_node =
            |at: &usize, step: usize| is_in(at % columns, columns, step) && is_in(at / columns, rows, step);
        let is_near = self.corners_near_lamps([columns, rows]);
        let mut exact: Vec<usize> =
            (0..columns * rows).filter(|at| is_node(at, WIDEST) || is_near[*at]).collect();
        sum_up(&mut table, &exact);
        let mut step = WIDEST;
        while step > 1 {
            exact.clear();
            let between = |at: &usize| is_node(at, step / 2) && !is_node(at, step) && !is_near[*at];
            for at in (0..columns * rows).filter(between) {
                // The nodes on both sides, and the share of the second.
                let beside = |at: usize, count: usize| {
                    let low = if is_in(at, count, step) { at } else { at / step * step };
                    let high = if low == at { at } else { (low + step).min(count - 1) };
                    (low, high, (at - low) as f32 / (high - low).max(1) as f32)
                };
                let (left, right, across) = beside(at % columns, columns);
                let (top, bottom, down) = beside(at / columns, rows);
                let around = [[left, top], [right, top], [left, bottom], [right, bottom]];
                let around = around.map(|[x, y]| &table[y * columns + x]);
                match even_mean(around, [across, down]) {
                    Some(mean) => table[at] = mean,
                    None => exact.push(at),
                }
            }
            sum_up(&mut table, &exact);
            step /= 2;
        }
        table
    }

    /// Returns true for the corners of the patches that have tables of their own,
    /// `[rows, columns]`.
    fn corners_near_lamps(&self, size: [usize; 2]) -> Vec<bool> {
        let [columns, rows] = size;
        let mut is_near = vec![false; columns * rows];
        for [column, row] in self.lights.iter().filter_map(|light| self.patch_of(light)) {
            let within = |middle: i64, count: usize| {
                let [low, high] = [middle - NEAR_PATCHES, middle + NEAR_PATCHES + 2];
                low.clamp(0, count as i64) as usize..high.clamp(0, count as i64) as usize
            };
            for y in within(row, rows) {
                is_near[y * columns..][within(column, columns)].fill(true);
            }
        }
        is_near
    }

    /// Column and row of the patch that shows a lamp, in the picture or not; `None` for one behind
    /// the eye.
    fn patch_of(&self, light: &GlowLight<'_>) -> Option<[i64; 2]> {
        let z = light.offset.dot(self.axes[2]);
        (z > 0.1).then(|| {
            [0, 1].map(|k| {
                let at = light.offset.dot(self.axes[k]) / z * self.focal[k] + self.principal[k];
                (at / PATCH as f32).floor() as i64
            })
        })
    }

    /// The columns of rays through these places of the picture, px, by some of the lights. Never
    /// inlined: it takes the compiler a minute.
    #[inline(never)]
    fn columns(&self, path: SimdPath, places: &[[f32; 2]], lights: &[GlowLight<'_>], out: &mut [Column]) {
        let view = self.air.seen_from(self.origin);
        if view.is_grey() {
            dispatch!(path, s => self.columns_in::<_, 1>(s, &view, places, lights, out));
        } else {
            dispatch!(path, s => self.columns_in::<_, 3>(s, &view, places, lights, out));
        }
    }

    /// [`Self::columns`] in vectors, in air that has `C` extinctions: one for all channels, or one
    /// each.
    #[inline(always)]
    fn columns_in<S: Lanes, const C: usize>(
        &self,
        simd: S,
        view: &AirView<'_>,
        places: &[[f32; 2]],
        lights: &[GlowLight<'_>],
        out: &mut [Column],
    ) {
        for first in (0..out.len()).step_by(S::N) {
            let mut directions = [[0.0f32; GROUP]; 3];
            for lane in 0..S::N {
                let place = places[(first + lane).min(places.len() - 1)];
                let [x, y] = [0, 1].map(|k: usize| (place[k] - self.principal[k]) / self.focal[k]);
                let direction = (self.axes[0] * x + self.axes[1] * y + self.axes[2]).normalize();
                (0..3).for_each(|k| directions[k][lane] = direction[k]);
            }
            let mut direction = [simd.set(0.0); 3];
            for k in 0..3 {
                direction[k] = simd.load(&directions[k]);
            }
            // Optical depth to each node, of base 2, without what goes on forwards.
            let mut depth = [[simd.set(0.0); C]; NODES];
            for (node, depth) in depth.iter_mut().enumerate().skip(1) {
                let (kept, _) = view.along(simd, simd.set(node_distance(node)), &direction);
                let mut least = [simd.set(0.0); C];
                for k in 0..C {
                    least[k] = kept[k].max(simd.set(1e-30));
                }
                let logs = log2(simd, least);
                for k in 0..C {
                    depth[k] = logs[k] * (FORWARD - 1.0);
                }
            }
            let mut sums = [[simd.set(0.0); 3]; NODES];
            for light in lights {
                self.add(simd, light, &directions, &direction, &depth, &mut sums);
            }
            let mut buffer = [0.0f32; GROUP];
            let mut total = [simd.set(0.0); 3];
            for node in 0..NODES {
                for k in 0..3 {
                    total[k] += sums[node][k];
                    total[k].store_slice(&mut buffer[..S::N]);
                    for (column, value) in out[first..].iter_mut().zip(&buffer[..S::N]) {
                        column[3 * node + k] = *value;
                    }
                }
            }
        }
    }

    /// The tables of the patches near the picture of a lamp: for each patch its place among them,
    /// and they. `table` is that of the whole picture, `columns` wide.
    fn near_lamps(
        &self,
        table: &[Column],
        columns: usize,
        path: SimdPath,
        threads: usize,
    ) -> (Vec<Option<u32>>, Vec<Vec<Column>>) {
        let (across, down) = (columns - 1, table.len() / columns - 1);
        let mut near: Vec<Option<u32>> = vec![None; across * down];
        // Of each patch its place, its cells along a side, and the lamps that are near.
        let mut work: Vec<([usize; 2], usize, Vec<usize>)> = Vec::new();
        for (index, light) in self.lights.iter().enumerate() {
            let Some([column, row]) = self.patch_of(light) else { continue };
            let within = |middle: i64, count: usize| {
                let low = (middle - NEAR_PATCHES).clamp(0, count as i64) as usize;
                low..(middle + NEAR_PATCHES + 1).clamp(0, count as i64) as usize
            };
            for y in within(row, down) {
                for x in within(column, across) {
                    let place = near[y * across + x].get_or_insert_with(|| {
                        work.push(([x, y], 0, Vec::new()));
                        (work.len() - 1) as u32
                    });
                    let apart = (x as i64 - column).abs().max((y as i64 - row).abs());
                    let (_, cells, lights) = &mut work[*place as usize];
                    let own = FINE.iter().find(|(reach, _)| apart <= *reach).map_or(1, |(_, own)| *own);
                    *cells = own.max(*cells);
                    lights.push(index);
                }
            }
        }
        // Several at once fill the vectors better.
        let runs: Vec<_> =
            work.chunk_by(|a, b| a.2 == b.2).flat_map(|same| same.chunks(PATCHES_AT_ONCE)).collect();
        let fine = map(runs.len(), threads, |run| {
            let mut places: Vec<[f32; 2]> = Vec::new();
            for ([x, y], cells, _) in runs[run] {
                let (side, cell) = (cells + 1, (PATCH / cells) as f32);
                places.extend((0..side * side).map(|node| {
                    [(x, node % side), (y, node / side)]
                        .map(|(patch, node)| (patch * PATCH) as f32 + node as f32 * cell)
                }));
            }
            // Of the lamps that are near, exactly in place of what the corners say of them.
            let lights: Vec<GlowLight<'_>> = runs[run][0].2.iter().map(|light| self.lights[*light]).collect();
            let mut exact = vec![[0.0; COLUMN]; places.len()];
            self.columns(path, &places, &lights, &mut exact);
            let mut left = &exact[..];
            let tables = runs[run].iter().map(|([x, y], cells, _)| {
                let (own, others) = left.split_at((cells + 1) * (cells + 1));
                left = others;
                let mut fine = own.to_vec();
                let first = y * columns + x;
                let corners = [first, first + 1, first + columns, first + columns + 1].map(|at| &table[at]);
                dispatch!(path, s => add_others(s, &mut fine, corners, *cells));
                fine
            });
            tables.collect::<Vec<_>>()
        });
        let fine = fine.into_iter().flatten().collect();
        (near, fine)
    }

    /// Adds the light of a lamp that is scattered between each node and the one before.
    #[inline(always)]
    fn add<S: Lanes, const C: usize>(
        &self,
        simd: S,
        lamp: &GlowLight<'_>,
        directions: &[[f32; GROUP]; 3],
        direction: &[S::F; 3],
        depth: &[[S::F; C]; NODES],
        sums: &mut [[S::F; 3]; NODES],
    ) {
        let one = simd.set(1.0);
        let dot = |v: Vec3| {
            let [x, y, z] = *direction;
            x.mul_add(simd.set(v.x), y.mul_add(simd.set(v.y), z * v.z))
        };
        let abreast = dot(lamp.offset);
        let least = MIN_RAY_DISTANCE_M.max(lamp.light.radius);
        let squared =
            (simd.set(lamp.offset.length_squared()) - abreast * abreast).max(simd.set(least * least));
        let h = squared.sqrt();
        let axis = Vec3::from_array(lamp.light.axis);
        let (along_axis, axis_offset) = (dot(axis), axis.dot(lamp.offset));
        let one_over = |x: S::F| reciprocal(simd, [x])[0];
        let per_h = one_over(h);
        let unit = |s: S::F| {
            let per_r = one_over(s.mul_add(s, squared).sqrt());
            [h * per_r, s * per_r]
        };
        let scaled = |[x, y]: [S::F; 2]| {
            let per_length = one_over(x.mul_add(x, y * y).sqrt());
            [x * per_length, y * per_length]
        };
        let between = |a: [S::F; 2], b: [S::F; 2]| scaled([a[0] + b[0], a[1] + b[1]]);
        let mut before = unit(-abreast);
        for node in 1..NODES {
            let (from, to) = (node_distance(node - 1), node_distance(node));
            let after = unit(simd.set(to) - abreast);
            let middle = between(before, after);
            // Gauss's two nodes of the interval of angles, between its ends and its middle.
            let [a, m] = [before, middle];
            let half = [a[0] * m[1] - a[1] * m[0], a[0].mul_add(m[0], a[1] * m[1])];
            let towards = (one - half[1]).mul_add(simd.set(GAUSS[1]), simd.set(GAUSS[0]));
            let part =
                |end: [S::F; 2]| scaled([0, 1].map(|k: usize| (m[k] - end[k]).mul_add(towards, end[k])));
            let is_wide = half[0].simd_gt(simd.set(NARROW)).any_true();
            let (nodes, count) = if is_wide { ([part(before), part(after)], 2) } else { ([middle; 2], 1) };
            // Half of the angle, from its tangent's half: that stays finite.
            let angle = arc_tangent(simd, half[0] * one_over(one + half[1])) * (4.0 / count as f32);
            let open = self.open(simd, lamp, direction, abreast + h * middle[1] * one_over(middle[0]));
            let per_metre = 1.0 / (to - from);
            for [cos, sin] in nodes.into_iter().take(count) {
                let r = h * one_over(cos);
                let t = r.mul_add(sin, abreast);
                let share = ((t - simd.set(from)) * per_metre).max(simd.set(0.0)).min(one);
                // Henyey and Greenstein, deflected by the angle whose cosine is -sin.
                let denominator =
                    sin.mul_add(simd.set(2.0 * ASYMMETRY), simd.set(1.0 + ASYMMETRY * ASYMMETRY));
                let phase = one_over(denominator * denominator.sqrt())
                    * ((1.0 - ASYMMETRY * ASYMMETRY) / (4.0 * PI as f32));
                let mut light = phase * angle * open * per_h;
                if lamp.light.kind == LampKind::Headlamps {
                    light *= self.headlamps::<S>(simd, lamp, directions, t);
                } else if lamp.light.axis != [0.0; 3] {
                    let cos = ((t * along_axis - simd.set(axis_offset)) * cos * per_h).max(simd.set(0.0));
                    light *= match lamp.light.exponent {
                        1.0 => cos,
                        exponent => powf(simd, [cos.max(simd.set(1e-6))], exponent)[0],
                    };
                }
                let mut exponents = [simd.set(0.0); C];
                let mut scattering = [simd.set(0.0); C];
                for k in 0..C {
                    let (near, far) = (depth[node - 1][k], depth[node][k]);
                    let local = (far - near) * per_metre;
                    // On the way from the lamp, the mean of the air at both ends.
                    let there = simd.set(lamp.extinction[k] * (1.0 - FORWARD) * LOG2_E);
                    let way = (local + there) * 0.5 * r;
                    let depth = share.mul_add(far - near, near) + way;
                    exponents[k] = (-depth).max(simd.set(-126.0));
                    scattering[k] = local * (1.0 / LOG2_E);
                }
                let kept = exp2(simd, exponents);
                for k in 0..3 {
                    let scattered = light * scattering[k.min(C - 1)] * kept[k.min(C - 1)];
                    sums[node][k] = scattered.mul_add(simd.set(lamp.intensity[k]), sums[node][k]);
                }
            }
            before = after;
        }
    }

    /// The share of the intensity of headlamps at points at distances (m) along rays.
    #[inline(always)]
    fn headlamps<S: Lanes>(
        &self,
        simd: S,
        lamp: &GlowLight<'_>,
        directions: &[[f32; GROUP]; 3],
        metres: S::F,
    ) -> S::F {
        each_point(simd, directions, metres, |direction, metres| {
            lamp.light.share((direction * metres - lamp.offset).normalize_or_zero())
        })
    }

    /// The share of a lamp's light that reaches the points at distances (m) along rays.
    #[inline(always)]
    fn open<S: Lanes>(&self, simd: S, lamp: &GlowLight<'_>, direction: &[S::F; 3], metres: S::F) -> S::F {
        let Some(cube) = lamp.cube else { return simd.set(1.0) };
        let metres = metres.min(simd.set(SKY_DISTANCE_M as f32));
        let per_metre = self.metres_per_unit.recip();
        let mut offset = *direction;
        for k in 0..3 {
            offset[k] = direction[k].mul_add(metres, simd.set(-lamp.offset[k])) * per_metre;
        }
        cube.open_each(simd, &offset)
    }
}

/// A number for each of the points at distances (m) along rays, by the direction and the distance.
#[inline(always)]
fn each_point<S: Lanes>(
    simd: S,
    directions: &[[f32; GROUP]; 3],
    metres: S::F,
    value: impl Fn(Vec3, f32) -> f32,
) -> S::F {
    let (mut at, mut values) = ([0.0f32; GROUP], [0.0f32; GROUP]);
    metres.store_slice(&mut at[..S::N]);
    for lane in 0..S::N {
        let direction = Vec3::new(directions[0][lane], directions[1][lane], directions[2][lane]);
        values[lane] = value(direction, at[lane]);
    }
    simd.load(&values)
}

/// The column between four others, linear by the shares of the right ones and of the lower ones;
/// `None` if they differ too much for it.
fn even_mean(columns: [&Column; 4], position: [f32; 2]) -> Option<Column> {
    let [across, down] = position;
    let mut mean = [0.0; COLUMN];
    let mut uneven = f32::NEG_INFINITY;
    for (at, mean) in mean.iter_mut().enumerate() {
        let [a, b, c, d] = columns.map(|column| column[at]);
        let (least, most) = (a.min(b).min(c.min(d)), a.max(b).max(c.max(d)));
        uneven = uneven.max(most - least - MAX_COLUMN_DIFFERENCE * most.max(MIN_LIGHT));
        let [top, bottom] = [a + (b - a) * across, c + (d - c) * across];
        *mean = top + (bottom - top) * down;
    }
    (uneven <= 0.0).then_some(mean)
}

/// Adds to a table of near lamps alone, with so many cells along its side, the light of all others:
/// what the `corners` of the patch have of it, linear between them.
#[inline(always)]
fn add_others<S: Lanes>(simd: S, fine: &mut [Column], corners: [&Column; 4], cells: usize) {
    let last = fine.len() - 1;
    for at in (0..COLUMN).step_by(S::N) {
        let mut rest = [simd.set(0.0); 4];
        for (k, node) in [0, cells, last - cells, last].into_iter().enumerate() {
            rest[k] = simd.load(&corners[k][at..]) - simd.load(&fine[node][at..]);
        }
        let step = 1.0 / cells as f32;
        let [left, right] = [rest[0], rest[1]];
        let (fall, right_fall) = ((rest[2] - left) * step, (rest[3] - right) * step);
        for (node, column) in fine.iter_mut().enumerate() {
            let [u, v] = [node % (cells + 1), node / (cells + 1)].map(|at| at as f32);
            let (left, right) = (fall.mul_add(simd.set(v), left), right_fall.mul_add(simd.set(v), right));
            let others = ((right - left) * step).mul_add(simd.set(u), left);
            (simd.load(&column[at..]) + others).store_slice(&mut column[at..at + S::N]);
        }
    }
}

/// Arc tangent of 0 to 1, within 1e-5.
#[inline(always)]
fn arc_tangent<S: Lanes>(simd: S, x: S::F) -> S::F {
    let square = x * x;
    let mut sum = simd.set(0.020_835_1);
    for coefficient in [-0.085_133, 0.180_141, -0.330_299_5, 0.999_866] {
        sum = sum.mul_add(square, simd.set(coefficient));
    }
    sum * x
}
