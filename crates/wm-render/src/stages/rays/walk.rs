//! Blending along rays: a packet walks its splats with all its rays side by side.

use super::packets::{Cone, PACKET, RayGroup};
use super::records::{CONE_TOLERANCE_SHARE, RayRecord, record_of};
use super::{MIN_HIT_COVERAGE, RayHits, RayOutputs, Rays, STOPPED_COVERAGE};
use crate::simd::{Lanes, exp2};
use crate::stages::project::LOG2_MIN_ALPHA;
use crate::stages::rasterize::{MAX_ALPHA, MIN_TRANSMITTANCE};
use fearless_simd::{Select, SimdBase, SimdFloat, SimdMask};
use glam::Vec3;

/// Transmittance at or below which a splat may be the hit: half of the least coverage of a hit is
/// reached.
pub(super) const MAX_HIT_TRANSMITTANCE: f32 = 1.0 - 0.5 * MIN_HIT_COVERAGE;
/// Candidates for the hit that are kept per ray.
pub(super) const HITS_PER_RAY: usize = 16;

/// The features that are blended.
#[derive(Clone, Copy)]
pub(super) struct Features<'a> {
    /// Colours of the bundle's records; empty unless asked.
    pub(super) colors: &'a [[f32; 3]],
    pub(super) asked: RayOutputs,
}

/// The state of the rays of one packet.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(super) struct Walk {
    direction: [[f32; PACKET]; 3],
    /// Position of each origin relative to the centre of the group, scene units.
    offset: [[f32; PACKET]; 3],
    /// 0 where blending has stopped.
    transmittance: [f32; PACKET],
    coverage: [f32; PACKET],
    color: [[f32; PACKET]; 3],
    normal: [[f32; PACKET]; 3],
    value: [f32; PACKET],
    /// The splats at which a ray may be hit, in order: those that bring its transmittance below
    /// [`MAX_HIT_TRANSMITTANCE`] until it is at [`MIN_HIT_COVERAGE`] or below.
    hits: [[Hit; HITS_PER_RAY]; PACKET],
    /// Their number; above [`HITS_PER_RAY`] some are missing.
    hit_count: [u32; PACKET],
    center: [f32; 3],
    /// The greatest distance of an origin from the center.
    radius: f32,
}

/// The results of one packet: of each ray, and empty what was not asked for.
pub(super) struct PacketHits {
    /// Coverage, distance and splat.
    hits: Vec<(f32, f32, u32)>,
    color: Vec<[f32; 3]>,
    normal: Vec<[f32; 3]>,
    value: Vec<f32>,
}

impl PacketHits {
    /// Puts the results where the rays have theirs.
    pub(super) fn put(&self, rays: &[u32], asked: RayOutputs, hits: &mut RayHits) {
        for (lane, ray) in rays.iter().map(|ray| *ray as usize).enumerate() {
            (hits.coverage[ray], hits.distance[ray], hits.splat[ray]) = self.hits[lane];
            if asked.color {
                hits.color[ray] = self.color[lane];
            }
            if asked.normal {
                hits.normal[ray] = self.normal[lane];
            }
            if asked.value {
                hits.value[ray] = self.value[lane];
            }
        }
    }
}

/// A splat on a ray.
#[derive(Clone, Copy, Debug, Default)]
struct Hit {
    /// Transmittance behind it.
    after: f32,
    distance: f32,
    splat: u32,
}

impl Walk {
    pub(super) fn new(rays: &Rays, own: &[u32], group: &RayGroup) -> Self {
        let zero = [0.0; PACKET];
        let mut walk = Self {
            direction: [zero; 3],
            offset: [zero; 3],
            transmittance: zero,
            coverage: zero,
            color: [zero; 3],
            normal: [zero; 3],
            value: zero,
            hits: [[Hit::default(); HITS_PER_RAY]; PACKET],
            hit_count: [0; PACKET],
            center: group.center,
            radius: group.radius,
        };
        for (lane, ray) in own.iter().enumerate() {
            let ray = *ray as usize;
            walk.transmittance[lane] = 1.0;
            for k in 0..3 {
                walk.direction[k][lane] = rays.directions[ray][k];
                walk.offset[k][lane] = rays.origins[ray][k] - group.center[k];
            }
        }
        // Lanes that pad the last packet repeat its last ray, with a transmittance of 0.
        for k in 0..3 {
            let last = walk.direction[k][own.len() - 1];
            walk.direction[k][own.len()..].fill(last);
        }
        walk
    }

    /// The results of the first `count` rays.
    pub(super) fn met(&self, count: usize, asked: RayOutputs) -> PacketHits {
        let hit = |lane: usize| {
            let (distance, splat) = self.hit(lane).unwrap_or((f32::INFINITY, u32::MAX));
            (self.coverage[lane], distance, splat)
        };
        let vectors = |of: &[[f32; PACKET]; 3], is_asked: bool| -> Vec<[f32; 3]> {
            let count = if is_asked { count } else { 0 };
            (0..count).map(|lane| [of[0][lane], of[1][lane], of[2][lane]]).collect()
        };
        PacketHits {
            hits: (0..count).map(hit).collect(),
            color: vectors(&self.color, asked.color),
            normal: vectors(&self.normal, asked.normal),
            value: if asked.value { self.value[..count].to_vec() } else { Vec::new() },
        }
    }

    /// The hit of a ray: its distance and splat.
    fn hit(&self, lane: usize) -> Option<(f32, u32)> {
        let coverage = self.coverage[lane];
        if coverage < MIN_HIT_COVERAGE {
            return None;
        }
        let half = if coverage < STOPPED_COVERAGE { 0.5 * coverage } else { MIN_HIT_COVERAGE };
        let kept = &self.hits[lane][..(self.hit_count[lane] as usize).min(HITS_PER_RAY)];
        // More candidates than are kept are faint and close to each other: the last one stands for
        // them.
        let hit = kept.iter().find(|hit| hit.after <= 1.0 - half).or(kept.last());
        hit.map(|hit| (hit.distance, hit.splat))
    }
}

/// The vectors at lanes from `first` on.
#[inline(always)]
fn at_lanes<S: Lanes>(simd: S, of: &[[f32; PACKET]; 3], first: usize) -> [S::F; 3] {
    [simd.load(&of[0][first..]), simd.load(&of[1][first..]), simd.load(&of[2][first..])]
}

/// Adds a feature to the sums of one vector.
#[inline(always)]
fn add<S: Lanes>(simd: S, sums: &mut [f32], weight: S::F, feature: f32) {
    let sum = simd.load(sums);
    weight.mul_add(simd.set(feature), sum).store_slice(sums);
}

/// The product of a row of a matrix and vectors.
#[inline(always)]
fn dot<S: Lanes>(simd: S, vectors: &[S::F; 3], row: &[f32; 3]) -> S::F {
    vectors[0].mul_add(simd.set(row[0]), vectors[1].mul_add(simd.set(row[1]), vectors[2] * row[2]))
}

/// The vectors of a packet that each of some splats may touch: a bit per vector.
#[inline(always)]
fn vectors_touched<S: Lanes>(
    simd: S,
    records: &[RayRecord],
    keys: &[u64],
    walk: &Walk,
    cones: &[[f32; 5]],
    touched: &mut [u8; 16],
) {
    let mut way = [[0.0f32; 16]; 3];
    let mut reach = [0.0f32; 16];
    for (at, key) in keys.iter().enumerate() {
        let record = &records[record_of(*key)];
        for k in 0..3 {
            way[k][at] = record.mean[k] - walk.center[k];
        }
        reach[at] = record.reach + walk.radius;
    }
    *touched = [0; 16];
    for first in (0..keys.len()).step_by(S::N) {
        let x = simd.load(&way[0][first..]);
        let y = simd.load(&way[1][first..]);
        let z = simd.load(&way[2][first..]);
        let reach = simd.load(&reach[first..]);
        let squared = x.mul_add(x, y.mul_add(y, z * z));
        let left = squared - reach * reach;
        let is_inside = left.simd_le(simd.set(0.0));
        let along = left.max(simd.set(0.0)).sqrt();
        let slack = squared.sqrt() * CONE_TOLERANCE_SHARE;
        for (vector, [axis_x, axis_y, axis_z, cos, sin]) in cones.iter().enumerate() {
            let dot = x.mul_add(
                simd.set(*axis_x),
                y.mul_add(simd.set(*axis_y), z.mul_add(simd.set(*axis_z), slack)),
            );
            let is_touched = dot.simd_ge(along * *cos - reach * *sin) | is_inside;
            let bits = is_touched.to_bitmask() as u32;
            for lane in 0..S::N {
                touched[first + lane] |= ((bits >> lane & 1) as u8) << vector;
            }
        }
    }
}

/// Blends the records of `keys` over the rays of a packet.
#[inline(always)]
pub(super) fn blend<S: Lanes>(
    simd: S,
    walk: &mut Walk,
    records: &[RayRecord],
    keys: &[u64],
    features: &Features<'_>,
) {
    let zero = simd.set(0.0);
    let vectors = PACKET / S::N;
    // A bit for each vector of rays that still lets light through, and the cone about its rays:
    // most splats touch few vectors of a packet.
    let mut live: u8 = 0;
    let mut cones = [[0.0; 5]; PACKET / 8];
    for vector in 0..vectors {
        let transmittance = simd.load(&walk.transmittance[vector * S::N..]);
        live |= u8::from(transmittance.simd_gt(zero).any_true()) << vector;
        let [x, y, z] = &walk.direction;
        let lanes = vector * S::N..(vector + 1) * S::N;
        let cone = Cone::about(lanes.map(|lane| Vec3::new(x[lane], y[lane], z[lane])));
        let ([x, y, z], (cos, sin)) = (cone.axis.as_vec3().to_array(), cone.cos_sin());
        cones[vector] = [x, y, z, cos, sin];
    }
    let mut touched = [0u8; 16];
    for (at, key) in keys.iter().enumerate() {
        if live == 0 {
            break;
        }
        if at % 16 == 0 {
            let some = &keys[at..keys.len().min(at + 16)];
            vectors_touched(simd, records, some, walk, &cones[..vectors], &mut touched);
        }
        let mut todo = live & touched[at % 16];
        if todo == 0 {
            continue;
        }
        let at = record_of(*key);
        let record = &records[at];
        let rows = &record.rows;
        let mut away = [0.0; 3];
        for k in 0..3 {
            away[k] = walk.center[k] - record.mean[k];
        }
        let mut middle = [0.0; 3];
        for k in 0..3 {
            middle[k] = rows[k][0] * away[0] + rows[k][1] * away[1] + rows[k][2] * away[2];
        }
        let most = record.log2_opacity - LOG2_MIN_ALPHA;
        let mut normal = None;
        while todo != 0 {
            let vector = todo.trailing_zeros() as usize;
            todo &= todo - 1;
            let first = vector * S::N;
            let lanes = first..first + S::N;
            let direction = at_lanes(simd, &walk.direction, first);
            let (mut a, mut b) = ([zero; 3], [zero; 3]);
            for k in 0..3 {
                a[k] = simd.set(middle[k]);
                b[k] = dot(simd, &direction, &rows[k]);
            }
            if walk.radius > 0.0 {
                let offset = at_lanes(simd, &walk.offset, first);
                for k in 0..3 {
                    a[k] += dot(simd, &offset, &rows[k]);
                }
            }
            // `|a x b|^2 / |b|^2` is the squared distance of the ray from the mean, in the units in
            // which alpha is a power of two; `-a . b / |b|^2` is the distance along the ray.
            let x = a[1] * b[2] - a[2] * b[1];
            let y = a[2] * b[0] - a[0] * b[2];
            let z = a[0] * b[1] - a[1] * b[0];
            let across = x.mul_add(x, y.mul_add(y, z * z));
            let square = b[0].mul_add(b[0], b[1].mul_add(b[1], b[2] * b[2]));
            let along = a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]));
            let before = simd.load(&walk.transmittance[lanes.clone()]);
            let is_met = across.simd_le(square * most) & along.simd_lt(zero) & before.simd_gt(zero);
            if !is_met.any_true() {
                continue;
            }
            let power = (simd.set(record.log2_opacity) - across / square).max(simd.set(LOG2_MIN_ALPHA - 1.0));
            let [alpha] = exp2(simd, [power.min(zero)]);
            let alpha = is_met.select(alpha.min(simd.set(MAX_ALPHA)), zero);
            let after = before * (simd.set(1.0) - alpha);
            // A ray that falls to the threshold stops before this splat, as in `rasterize`.
            let ends = after.simd_le(simd.set(MIN_TRANSMITTANCE)) & is_met;
            let weight = ends.select(zero, alpha * before);
            let after = ends.select(zero, after);
            let may_hit = before.simd_gt(simd.set(MIN_HIT_COVERAGE))
                & after.simd_le(simd.set(MAX_HIT_TRANSMITTANCE))
                & is_met;
            // The coverage is known only at the end, so candidates for the hit are kept.
            if may_hit.any_true() {
                let mut far = [0.0; 16];
                let mut behind = [0.0; 16];
                (zero - along / square).store_slice(&mut far[..S::N]);
                after.store_slice(&mut behind[..S::N]);
                let mut which = may_hit.to_bitmask() as u32;
                while which != 0 {
                    let lane = which.trailing_zeros() as usize;
                    which &= which - 1;
                    let count = walk.hit_count[first + lane];
                    walk.hit_count[first + lane] = count + 1;
                    let hit = Hit { after: behind[lane], distance: far[lane], splat: record.index };
                    walk.hits[first + lane][(count as usize).min(HITS_PER_RAY - 1)] = hit;
                }
            }
            let sum = simd.load(&walk.coverage[lanes.clone()]) + weight;
            sum.store_slice(&mut walk.coverage[lanes.clone()]);
            if features.asked.color {
                for k in 0..3 {
                    add(simd, &mut walk.color[k][lanes.clone()], weight, features.colors[at][k]);
                }
            }
            if features.asked.normal {
                let normal = match normal {
                    Some(normal) => normal,
                    None => *normal.insert(record.normal(&away)),
                };
                for k in 0..3 {
                    add(simd, &mut walk.normal[k][lanes.clone()], weight, normal[k]);
                }
            }
            if features.asked.value {
                add(simd, &mut walk.value[lanes.clone()], weight, record.value);
            }
            after.store_slice(&mut walk.transmittance[lanes]);
            if !after.simd_gt(zero).any_true() {
                live &= !(1 << vector);
            }
        }
    }
}
