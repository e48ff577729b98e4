//! Rays by packets: each splat finds the packets whose cones it touches, each packet walks its
//! splats with all its rays side by side.

use super::packets::{CHILDREN, Cone, Cones, PACKET, Packets, RayGroup};
use super::{LEAST_HIT, RayHits, RayOutputs, Rays, THINNEST, WHOLE};
use crate::cpu::model::morton_order;
use crate::dispatch;
use crate::simd::{Lanes, SimdPath, exp2};
use crate::stages::project::{LOG2_MIN_ALPHA, SQRT_HALF_LOG2E};
use crate::stages::rasterize::{MAX_ALPHA, MIN_TRANSMITTANCE};
use crate::stages::sort;
use fearless_simd::{Select, SimdBase, SimdFloat, SimdMask, f32x8};
use glam::Vec3;
use rayon::prelude::*;
use wm_scene::splats::shortest_axis;
use wm_scene::{Splats, quat, sh};

/// Splats that are culled at a time, a multiple of [`CLUSTER`].
const BLOCK: usize = 4096;
/// Splats that are culled as one.
const CLUSTER: usize = 64;
/// Slack of the test of a splat against a cone, of its distance.
pub(super) const SLACK: f32 = 4e-6;
/// Transmittance from which on a splat may be the hit: half of the least coverage of a hit is
/// reached.
pub(super) const SOONEST: f32 = 1.0 - 0.5 * LEAST_HIT;
/// Splats that may be the hit that are kept a ray.
pub(super) const HITS: usize = 16;
/// Packets whose lists are gathered as one.
const BUNDLE: usize = 16;
/// Levels of a tree of eight children that hold any number of packets.
const DEEPEST: usize = 12;

/// One splat for rays.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(64))]
pub(super) struct RayRecord {
    pub(super) mean: [f32; 3],
    pub(super) log2_opacity: f32,
    /// Rows of `M`, times sqrt(log2(e) / 2), so that `|a x b|^2 / |b|^2` is a power of two. The
    /// first is along the normal.
    pub(super) rows: [[f32; 3]; 3],
    /// Distance from the mean beyond which alpha is below 1/255.
    pub(super) reach: f32,
    /// The splat.
    pub(super) index: u32,
    /// The value that the caller gave it.
    pub(super) value: f32,
}

impl RayRecord {
    /// Of a splat, with a value of 0; `None` if no ray can meet it.
    pub(super) fn of(splats: &Splats, index: usize) -> Option<Self> {
        let opacity = splats.opacity(index);
        if opacity < 1.0 / 255.0 || !splats.is_sound(index) {
            return None;
        }
        let scales = splats.scales(index);
        let longest = scales.into_iter().fold(0.0, f64::max);
        let axes = quat::to_matrix(splats.quats[index].map(f64::from));
        // A row is a column of R over its standard deviation. Their order is free, so the normal's
        // comes first.
        let short = shortest_axis(splats.log_scales[index]);
        let rows = [short, (short + 1) % 3, (short + 2) % 3].map(|k| {
            let scale = f64::from(SQRT_HALF_LOG2E) / scales[k].max(THINNEST * longest);
            [0, 1, 2].map(|j| (axes[j][k] * scale) as f32)
        });
        let reach = (2.0 * (255.0 * opacity).ln()).max(0.0).sqrt() * longest * 1.0001;
        Some(Self {
            mean: splats.means[index],
            log2_opacity: opacity.log2() as f32,
            rows,
            reach: reach as f32,
            index: index as u32,
            value: 0.0,
        })
    }

    /// The normal, of length 1, on the side that `away` from the mean points to.
    #[inline(always)]
    fn normal(&self, away: &[f32; 3]) -> [f32; 3] {
        let [x, y, z] = self.rows[0];
        let length = (x * x + y * y + z * z).sqrt();
        let is_behind = x * away[0] + y * away[1] + z * away[2] < 0.0;
        let scale = if is_behind { -1.0 / length } else { 1.0 / length };
        [x * scale, y * scale, z * scale]
    }
}

/// Splats that rays can meet.
#[derive(Debug)]
pub struct RaySplats<'a> {
    splats: &'a Splats,
    /// In Morton order: what is near in space is near in memory.
    records: Vec<RayRecord>,
    /// Spheres about [`CLUSTER`] records each.
    clusters: Vec<Sphere>,
}

/// A sphere, world axes, scene units.
#[derive(Clone, Copy, Debug)]
struct Sphere {
    center: Vec3,
    radius: f32,
}

impl Sphere {
    /// About all that some records reach.
    fn about(records: &[RayRecord]) -> Self {
        let mean = |record: &RayRecord| Vec3::from_array(record.mean);
        let start = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        let (low, high) =
            records.iter().fold(start, |(low, high), it| (low.min(mean(it)), high.max(mean(it))));
        let center = 0.5 * (low + high);
        let reach = |record: &RayRecord| mean(record).distance(center) + record.reach;
        Self { center, radius: 1.0001 * records.iter().map(reach).fold(0.0, f32::max) }
    }
}

impl<'a> RaySplats<'a> {
    /// The splats for which `is_met` returns true, such as those that are no sky.
    #[must_use]
    pub fn new(splats: &'a Splats, is_met: impl Fn(usize) -> bool + Sync) -> Self {
        let record = |index: &u32| {
            let index = *index as usize;
            is_met(index).then(|| RayRecord::of(splats, index)).flatten()
        };
        let records: Vec<RayRecord> = morton_order(&splats.means).par_iter().filter_map(record).collect();
        let clusters = records.par_chunks(CLUSTER).map(Sphere::about).collect();
        Self { splats, records, clusters }
    }

    /// Gives every splat a value, such as a reflectance, for [`RayOutputs::value`].
    #[must_use]
    pub fn with_values(mut self, value: impl Fn(usize) -> f32 + Sync) -> Self {
        self.records.par_iter_mut().for_each(|record| record.value = value(record.index as usize));
        self
    }

    /// Traces rays on the threads of the current pool. Equal for any number of them.
    ///
    /// # Panics
    /// If there are fewer origins than directions.
    #[must_use]
    pub fn trace(&self, rays: &Rays, asked: RayOutputs, path: SimdPath) -> RayHits {
        let mut hits = RayHits::none(rays.len(), asked);
        let packets = Packets::new(rays);
        for group in &packets.groups {
            let pairs = self.pairs(group, path);
            let colors = if asked.color { self.colors(group, &pairs) } else { Vec::new() };
            let bundles: Vec<Vec<PacketHits>> = (0..group.packets.len().div_ceil(BUNDLE))
                .into_par_iter()
                .map_init(Scratch::default, |scratch, bundle| {
                    let packets_of = bundle * BUNDLE..group.packets.len().min((bundle + 1) * BUNDLE);
                    scratch.gather(&pairs, (&self.records, &colors), bundle, packets_of.len());
                    let Scratch { records, colors, keys, starts, sorting } = scratch;
                    let features = Features { colors: &*colors, asked };
                    let walked = packets_of.enumerate().map(|(at, packet)| {
                        let own = packets.rays(group.packets.start + packet);
                        let mut walk = Walk::new(rays, own, group);
                        let keys = &mut keys[starts[at]..starts[at + 1]];
                        sort::cpu::sort(keys, sorting);
                        dispatch!(path, simd => blend(simd, &mut walk, records, keys, &features));
                        walk.met(own.len(), asked)
                    });
                    walked.collect()
                })
                .collect();
            for (at, met) in bundles.into_iter().flatten().enumerate() {
                met.put(packets.rays(group.packets.start + at), asked, &mut hits);
            }
        }
        hits
    }

    /// The records that touch each packet of a group, by blocks of records.
    fn pairs(&self, group: &RayGroup, path: SimdPath) -> Vec<BlockPairs> {
        let bundles = group.packets.len().div_ceil(BUNDLE);
        let of_block = |scratch: &mut Vec<(u32, u64)>, (block, records): (usize, &[RayRecord])| {
            scratch.clear();
            // Eight children are one vector of the narrow path.
            let clusters = &self.clusters[block * BLOCK / CLUSTER..];
            dispatch!(path.narrow(), simd => cull(simd, (records, clusters), block * BLOCK, group, scratch));
            BlockPairs::new(scratch, bundles)
        };
        self.records.par_chunks(BLOCK).enumerate().map_init(Vec::new, of_block).collect()
    }

    /// Colours of the records that any packet has, seen from the middle of a group.
    fn colors(&self, group: &RayGroup, pairs: &[BlockPairs]) -> Vec<[f32; 3]> {
        let center = Vec3::from_array(group.center);
        let of_block = |(records, pairs): (&[RayRecord], &BlockPairs)| {
            let mut is_listed = [false; BLOCK];
            for (_, key) in &pairs.pairs {
                is_listed[record_of(*key) % BLOCK] = true;
            }
            let color = |(record, is_listed): (&RayRecord, bool)| {
                if !is_listed {
                    return [0.0; 3];
                }
                let way = (Vec3::from_array(record.mean) - center).as_dvec3().normalize_or_zero();
                let color = sh::color(self.splats.sh_of(record.index as usize), way.to_array());
                color.map(|v| v as f32)
            };
            records.iter().zip(is_listed).map(color).collect::<Vec<_>>()
        };
        self.records.par_chunks(BLOCK).zip(pairs).flat_map_iter(of_block).collect()
    }
}

/// The place of a key's record.
#[inline(always)]
fn record_of(key: u64) -> usize {
    key as u32 as usize
}

/// Pairs of a packet and the key of a record, of one block of records.
struct BlockPairs {
    /// By bundles of packets.
    pairs: Vec<(u32, u64)>,
    /// First pair of each bundle, and the end.
    starts: Vec<u32>,
}

impl BlockPairs {
    /// Puts pairs in the order of their bundles; those of one keep theirs.
    fn new(found: &[(u32, u64)], bundles: usize) -> Self {
        let mut starts = vec![0u32; bundles + 1];
        for (packet, _) in found {
            starts[*packet as usize / BUNDLE + 1] += 1;
        }
        for bundle in 0..bundles {
            starts[bundle + 1] += starts[bundle];
        }
        let mut next = starts.clone();
        let mut pairs = vec![(0, 0); found.len()];
        for pair in found {
            let at = &mut next[pair.0 as usize / BUNDLE];
            pairs[*at as usize] = *pair;
            *at += 1;
        }
        Self { pairs, starts }
    }

    fn bundle(&self, bundle: usize) -> &[(u32, u64)] {
        &self.pairs[self.starts[bundle] as usize..self.starts[bundle + 1] as usize]
    }
}

/// Lists of one bundle of packets.
#[derive(Default)]
struct Scratch {
    /// The records of the bundle: copied, so that those of a packet come from the cache and not
    /// from all over the memory.
    records: Vec<RayRecord>,
    /// Their colours; empty unless asked.
    colors: Vec<[f32; 3]>,
    /// Keys by packets, by distance from the middle once they are sorted. Their records are those
    /// of the bundle.
    keys: Vec<u64>,
    /// First key of each packet, and the end.
    starts: Vec<usize>,
    sorting: Vec<u64>,
}

impl Scratch {
    /// Gathers the records and the keys of a bundle of so many packets.
    fn gather(
        &mut self,
        blocks: &[BlockPairs],
        (records, colors): (&[RayRecord], &[[f32; 3]]),
        bundle: usize,
        packets: usize,
    ) {
        let own = || blocks.iter().flat_map(|block| block.bundle(bundle));
        let mut next = [0usize; BUNDLE + 1];
        for (packet, _) in own() {
            next[*packet as usize % BUNDLE + 1] += 1;
        }
        for packet in 0..BUNDLE {
            next[packet + 1] += next[packet];
        }
        self.starts.clear();
        self.starts.extend_from_slice(&next[..=packets]);
        self.keys.resize(next[BUNDLE], 0);
        self.records.clear();
        self.colors.clear();
        let mut last = usize::MAX;
        for (packet, key) in own() {
            // Pairs of one record are side by side.
            let record = record_of(*key);
            if record != last {
                self.records.push(records[record]);
                self.colors.extend(colors.get(record));
                last = record;
            }
            let at = &mut next[*packet as usize % BUNDLE];
            self.keys[*at] = *key >> 32 << 32 | (self.records.len() - 1) as u64;
            *at += 1;
        }
    }
}

/// The features that are blended.
#[derive(Clone, Copy)]
struct Features<'a> {
    /// Colours of the bundle's records; empty unless asked.
    colors: &'a [[f32; 3]],
    asked: RayOutputs,
}

/// Finds the packets of a group that each record touches. Both slices are cut from the same place.
#[inline(always)]
fn cull<S: Lanes>(
    simd: S,
    (records, clusters): (&[RayRecord], &[Sphere]),
    first: usize,
    group: &RayGroup,
    found: &mut Vec<(u32, u64)>,
) {
    let center = Vec3::from_array(group.center);
    // The records of a cluster begin at the nodes that all of it may touch, two levels above the
    // packets.
    let floor = usize::from(group.levels.len() > 1);
    let mut shared = Vec::new();
    for (at, record) in records.iter().enumerate() {
        if at % CLUSTER == 0 {
            let cluster = &clusters[at / CLUSTER];
            nodes_at(
                simd,
                group,
                floor,
                (cluster.center - center, cluster.radius + group.radius),
                &mut shared,
            );
        }
        if shared.is_empty() {
            continue;
        }
        let way = Vec3::from_array(record.mean) - center;
        let reach = record.reach + group.radius;
        let key = (u64::from(way.length().to_bits()) << 32) | (first + at) as u64;
        let Some(cap) = Cap::of(way, reach) else {
            // The middle lies in the splat: it may be met in any direction.
            found.extend((0..group.packets.len() as u32).map(|packet| (packet, key)));
            continue;
        };
        for node in &shared {
            if floor == 0 {
                push_packets(simd, &cap, group, *node, key, found);
                continue;
            }
            let mut touched = cap.touches(simd, &group.levels[1][*node as usize]);
            while touched != 0 {
                let node = *node * CHILDREN as u32 + touched.trailing_zeros();
                touched &= touched - 1;
                push_packets(simd, &cap, group, node, key, found);
            }
        }
    }
}

/// Appends the packets of one of the lowest nodes that a cap touches.
#[inline(always)]
fn push_packets<S: Lanes>(
    simd: S,
    cap: &Cap,
    group: &RayGroup,
    node: u32,
    key: u64,
    found: &mut Vec<(u32, u64)>,
) {
    let mut touched = cap.touches(simd, &group.levels[0][node as usize]);
    while touched != 0 {
        found.push((node * CHILDREN as u32 + touched.trailing_zeros(), key));
        touched &= touched - 1;
    }
}

/// Lists the nodes of a level of a group's tree that a sphere, given by its middle and its radius,
/// may touch.
#[inline(always)]
fn nodes_at<S: Lanes>(
    simd: S,
    group: &RayGroup,
    floor: usize,
    (way, reach): (Vec3, f32),
    nodes: &mut Vec<u32>,
) {
    nodes.clear();
    let Some(cap) = Cap::of(way, reach) else {
        nodes.extend(0..group.levels[floor].len() as u32);
        return;
    };
    let top = group.levels.len() - 1;
    let mut stack = [(0usize, 0u32); DEEPEST * CHILDREN];
    stack[0] = (top, 0);
    let mut depth = 1;
    while depth > 0 {
        depth -= 1;
        let (level, node) = stack[depth];
        if level == floor {
            nodes.push(node);
            continue;
        }
        let mut touched = cap.touches(simd, &group.levels[level][node as usize]);
        while touched != 0 {
            stack[depth] = (level - 1, node * CHILDREN as u32 + touched.trailing_zeros());
            touched &= touched - 1;
            depth += 1;
        }
    }
}

/// The directions in which a sphere is seen from the middle of a group.
struct Cap {
    /// To the middle of the sphere.
    way: Vec3,
    /// Length of a tangent to it.
    tangent: f32,
    reach: f32,
    slack: f32,
}

impl Cap {
    /// `None` where the sphere holds the middle of the group.
    #[inline(always)]
    fn of(way: Vec3, reach: f32) -> Option<Self> {
        let distance = way.length();
        let tangent = ((distance + reach) * (distance - reach)).sqrt();
        (distance > reach).then_some(Self { way, tangent, reach, slack: SLACK * distance })
    }

    /// The children of a node whose cones it touches: a bit each.
    #[inline(always)]
    fn touches<S: Lanes>(&self, simd: S, cones: &Cones) -> u32 {
        let [x, y, z] = &cones.axis;
        let dot = f32x8::from_slice(simd, x) * self.way.x
            + f32x8::from_slice(simd, y) * self.way.y
            + f32x8::from_slice(simd, z) * self.way.z
            + self.slack;
        let least = f32x8::from_slice(simd, &cones.cos) * self.tangent
            - f32x8::from_slice(simd, &cones.sin) * self.reach;
        dot.simd_ge(least).to_bitmask() as u32
    }
}

/// The rays of one packet on their way.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
struct Walk {
    direction: [[f32; PACKET]; 3],
    /// Of each origin from the middle of the group.
    offset: [[f32; PACKET]; 3],
    /// 0 where blending has stopped.
    transmittance: [f32; PACKET],
    coverage: [f32; PACKET],
    color: [[f32; PACKET]; 3],
    normal: [[f32; PACKET]; 3],
    value: [f32; PACKET],
    /// The splats at which a ray may be hit, in order: those that bring its transmittance below
    /// [`SOONEST`] until it is at [`LEAST_HIT`] or below.
    hits: [[Hit; HITS]; PACKET],
    /// Their number; above [`HITS`] some are missing.
    hit_count: [u32; PACKET],
    center: [f32; 3],
    /// The greatest distance of an origin from the center.
    radius: f32,
}

/// The results of one packet: of each ray, and empty what was not asked for.
struct PacketHits {
    /// Coverage, distance and splat.
    hits: Vec<(f32, f32, u32)>,
    color: Vec<[f32; 3]>,
    normal: Vec<[f32; 3]>,
    value: Vec<f32>,
}

impl PacketHits {
    /// Puts the results where the rays have theirs.
    fn put(&self, rays: &[u32], asked: RayOutputs, hits: &mut RayHits) {
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
    fn new(rays: &Rays, own: &[u32], group: &RayGroup) -> Self {
        let zero = [0.0; PACKET];
        let mut walk = Self {
            direction: [zero; 3],
            offset: [zero; 3],
            transmittance: zero,
            coverage: zero,
            color: [zero; 3],
            normal: [zero; 3],
            value: zero,
            hits: [[Hit::default(); HITS]; PACKET],
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
        // What pads the last packet goes the way of its last ray, without any light.
        for k in 0..3 {
            let last = walk.direction[k][own.len() - 1];
            walk.direction[k][own.len()..].fill(last);
        }
        walk
    }

    /// The results of the first `count` rays.
    fn met(&self, count: usize, asked: RayOutputs) -> PacketHits {
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
        if coverage < LEAST_HIT {
            return None;
        }
        let half = if coverage < WHOLE { 0.5 * coverage } else { LEAST_HIT };
        let kept = &self.hits[lane][..(self.hit_count[lane] as usize).min(HITS)];
        // More than are kept are faint ones close to each other: the last that is kept stands for
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

/// The vectors of a packet that each of some splats may touch: a bit a vector.
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
        let slack = squared.sqrt() * SLACK;
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
fn blend<S: Lanes>(simd: S, walk: &mut Walk, records: &[RayRecord], keys: &[u64], features: &Features<'_>) {
    let zero = simd.set(0.0);
    let vectors = PACKET / S::N;
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
            let ends = after.simd_le(simd.set(MIN_TRANSMITTANCE)) & is_met;
            let weight = ends.select(zero, alpha * before);
            let after = ends.select(zero, after);
            let may_hit = before.simd_gt(simd.set(LEAST_HIT)) & after.simd_le(simd.set(SOONEST)) & is_met;
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
                    walk.hits[first + lane][(count as usize).min(HITS - 1)] = hit;
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
