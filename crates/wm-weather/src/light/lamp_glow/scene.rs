//! Light that the air scatters between a camera and its surfaces: sums along rays, and tables of
//! them.

use super::lamps_on::{LampsOn, MIN_LIGHT, MIN_RAY_DISTANCE_M};
use crate::light::lamp_shadows::DepthCube;
use crate::light::lamps::{LampKind, LampLight};
use crate::optics::{AirView, Atmosphere, SKY_DISTANCE_M, Site};
use crate::threads::map;
use fearless_simd::{SimdBase, SimdFloat, SimdMask};
use glam::Vec3;
use std::f32::consts::LOG2_E;
use std::f64::consts::PI;
use wm_render::dispatch;
use wm_render::hooks::{GROUP, PATCH};
use wm_render::simd::{Lanes, SimdPath, exp2, log2, powf, reciprocal};
use wm_scene::Camera;

/// Asymmetry of the phase function of fog.
pub(super) const FOG_ASYMMETRY: f32 = 0.85;
/// Share that goes on as if it were not scattered, and the asymmetry of the rest.
const FORWARD_SHARE: f32 = FOG_ASYMMETRY * FOG_ASYMMETRY;
const SCATTERED_ASYMMETRY: f32 = FOG_ASYMMETRY / (1.0 + FOG_ASYMMETRY);
/// Nodes along a ray: the eye, then from [`FIRST_NODE_M`] on, each [`NODE_DISTANCE_RATIO`] times as
/// far as the one before, the last for all that is farther.
pub(super) const RAY_NODE_COUNT: usize = 20;
pub(super) const FIRST_NODE_M: f32 = 0.75;
pub(super) const NODE_DISTANCE_RATIO: f32 = 1.5;
/// Distance of a patch from a lamp up to which it has a table of its own, patches, and the cells of
/// that along a side: one cell is 3 % off at three patches from a lamp, two cells are 2 % off at
/// two, and four at one.
pub(super) const NEAR_LAMP_TABLES: [(i64, usize); 2] = [(2, 4), (3, 2)];
const NEAR_PATCHES: i64 = NEAR_LAMP_TABLES[1].0;
/// Numbers of a column, for whole vectors.
pub(super) const COLUMN_LENGTH: usize = (3 * RAY_NODE_COUNT).next_multiple_of(GROUP);
/// Patches from corner to corner at which columns are summed up everywhere.
const MAX_CORNER_STEP: usize = 4;
/// Share of the most light by which the columns around a corner differ at most where what is linear
/// between them stands for it: within 1 % of light that falls off smoothly.
const MAX_COLUMN_DIFFERENCE: f32 = 0.3;
/// Columns that are summed up at once, and patches near a lamp.
const COLUMNS_AT_ONCE: usize = 64;
const PATCHES_AT_ONCE: usize = 8;
/// Share of the way from the end of an angle to its middle at which Gauss's node lies along the
/// chord: for a small angle, and how much more it is for a right one.
const GAUSS_NODE_SHARES: [f32; 2] = [0.422_65, 0.016_6];
/// Sine of half of an angle up to which its middle tells enough: within 0.5 %.
const MAX_NARROW_SINE: f32 = 0.15;

/// Light up to each node along a ray, linear RGB, `[RAY_NODE_COUNT, 3]` and zeros.
pub(super) type Column = [f32; COLUMN_LENGTH];

/// Distance of a node, m.
fn node_distance(node: usize) -> f32 {
    if node == 0 { 0.0 } else { FIRST_NODE_M * NODE_DISTANCE_RATIO.powi(node as i32 - 1) }
}

/// The inputs of the table.
pub(super) struct GlowScene<'a> {
    pub(super) lights: Vec<GlowLight<'a>>,
    pub(super) air: &'a Atmosphere,
    origin: [f32; 3],
    /// Rows of the rotation from view to world, and the factor from pixels.
    axes: [Vec3; 3],
    pub(super) focal: [f32; 2],
    pub(super) principal: [f32; 2],
    pub(super) metres_per_unit: f32,
}

/// A lamp as the table needs it.
#[derive(Clone, Copy)]
pub(super) struct GlowLight<'a> {
    pub(super) light: LampLight,
    pub(super) cube: Option<&'a DepthCube>,
    /// Place from the camera, m, world axes.
    pub(super) offset: Vec3,
    /// Extinction at the lamp, 1/m, by channel.
    extinction: [f32; 3],
    /// Intensity in display units: times pi, lux to display white.
    pub(super) intensity: [f32; 3],
}

impl<'a> GlowScene<'a> {
    pub(super) fn new(lamps: &LampsOn<'a>, camera: &Camera, air: &'a Atmosphere, site: &Site) -> Self {
        let metres_per_unit = site.metres_per_unit as f32;
        let origin = camera.center().as_vec3();
        let rotation = camera.rotation();
        let lights = lamps.lights.iter().filter_map(|(light, cube)| {
            let offset = (Vec3::from_array(light.at) - origin) * metres_per_unit;
            let extinction = air.extinction_at(light.at.map(f64::from)).map(|v| v as f32);
            let intensity = light.intensity.map(|v| v * PI as f32 * lamps.display);
            // The most that it adds a metre from it, where half of what is scattered goes towards
            // the eye.
            let kept = (-extinction[1] * (1.0 - FORWARD_SHARE) * offset.length()).exp();
            let most = intensity[1] * extinction[1] * (1.0 - FORWARD_SHARE) * 0.25 * kept;
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
    pub(super) fn table(&self, size: [usize; 2], path: SimdPath) -> Vec<Column> {
        let [columns, rows] = size;
        let mut table = vec![[0.0; COLUMN_LENGTH]; columns * rows];
        let sum_up = |table: &mut [Column], corners: &[usize]| {
            let found = map(corners.len().div_ceil(COLUMNS_AT_ONCE), |run| {
                let corners = &corners
                    [run * COLUMNS_AT_ONCE..(run * COLUMNS_AT_ONCE + COLUMNS_AT_ONCE).min(corners.len())];
                let place = |at: &usize| [at % columns, at / columns].map(|v| (v * PATCH) as f32);
                let places: Vec<[f32; 2]> = corners.iter().map(place).collect();
                let mut out = vec![[0.0; COLUMN_LENGTH]; corners.len()];
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
            (0..columns * rows).filter(|at| is_node(at, MAX_CORNER_STEP) || is_near[*at]).collect();
        sum_up(&mut table, &exact);
        let mut step = MAX_CORNER_STEP;
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
    pub(super) fn columns(
        &self,
        path: SimdPath,
        places: &[[f32; 2]],
        lights: &[GlowLight<'_>],
        out: &mut [Column],
    ) {
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
            let mut depth = [[simd.set(0.0); C]; RAY_NODE_COUNT];
            for (node, depth) in depth.iter_mut().enumerate().skip(1) {
                let (kept, _) = view.along(simd, simd.set(node_distance(node)), &direction);
                let mut least = [simd.set(0.0); C];
                for k in 0..C {
                    least[k] = kept[k].max(simd.set(1e-30));
                }
                let logs = log2(simd, least);
                for k in 0..C {
                    depth[k] = logs[k] * (FORWARD_SHARE - 1.0);
                }
            }
            let mut sums = [[simd.set(0.0); 3]; RAY_NODE_COUNT];
            for light in lights {
                self.add(simd, light, &directions, &direction, &depth, &mut sums);
            }
            let mut buffer = [0.0f32; GROUP];
            let mut total = [simd.set(0.0); 3];
            for node in 0..RAY_NODE_COUNT {
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
    pub(super) fn near_lamps(
        &self,
        table: &[Column],
        columns: usize,
        path: SimdPath,
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
                    let own =
                        NEAR_LAMP_TABLES.iter().find(|(reach, _)| apart <= *reach).map_or(1, |(_, own)| *own);
                    *cells = own.max(*cells);
                    lights.push(index);
                }
            }
        }
        // Several at once fill the vectors better.
        let runs: Vec<_> =
            work.chunk_by(|a, b| a.2 == b.2).flat_map(|same| same.chunks(PATCHES_AT_ONCE)).collect();
        let fine = map(runs.len(), |run| {
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
            let mut exact = vec![[0.0; COLUMN_LENGTH]; places.len()];
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
        depth: &[[S::F; C]; RAY_NODE_COUNT],
        sums: &mut [[S::F; 3]; RAY_NODE_COUNT],
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
        for node in 1..RAY_NODE_COUNT {
            let (from, to) = (node_distance(node - 1), node_distance(node));
            let after = unit(simd.set(to) - abreast);
            let middle = between(before, after);
            // Gauss's two nodes of the interval of angles, between its ends and its middle.
            let [a, m] = [before, middle];
            let half = [a[0] * m[1] - a[1] * m[0], a[0].mul_add(m[0], a[1] * m[1])];
            let towards =
                (one - half[1]).mul_add(simd.set(GAUSS_NODE_SHARES[1]), simd.set(GAUSS_NODE_SHARES[0]));
            let part =
                |end: [S::F; 2]| scaled([0, 1].map(|k: usize| (m[k] - end[k]).mul_add(towards, end[k])));
            let is_wide = half[0].simd_gt(simd.set(MAX_NARROW_SINE)).any_true();
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
                let denominator = sin.mul_add(
                    simd.set(2.0 * SCATTERED_ASYMMETRY),
                    simd.set(1.0 + SCATTERED_ASYMMETRY * SCATTERED_ASYMMETRY),
                );
                let phase = one_over(denominator * denominator.sqrt())
                    * ((1.0 - SCATTERED_ASYMMETRY * SCATTERED_ASYMMETRY) / (4.0 * PI as f32));
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
                    let there = simd.set(lamp.extinction[k] * (1.0 - FORWARD_SHARE) * LOG2_E);
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
    let mut mean = [0.0; COLUMN_LENGTH];
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
    for at in (0..COLUMN_LENGTH).step_by(S::N) {
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
