//! Rays by packets: each splat finds the packets whose cones it touches, each packet walks its
//! splats with all its rays side by side.

use super::cull::cull;
use super::packets::{Packets, RayGroup};
use super::records::{RayRecord, SPLATS_PER_CLUSTER, Sphere, record_of};
use super::walk::{Features, PacketHits, Walk, blend};
use super::{RayHits, RayOutputs, RayTracer, Rays};
use crate::cpu::model::morton_order;
use crate::dispatch;
use crate::simd::SimdPath;
use crate::stages::sort;
use glam::Vec3;
use rayon::prelude::*;
use wm_scene::{Splats, sh};

/// Splats that are culled at a time, a multiple of [`SPLATS_PER_CLUSTER`].
const SPLATS_PER_BLOCK: usize = 4096;
/// Packets whose lists are gathered together.
const PACKETS_PER_BUNDLE: usize = 16;

/// Splats that rays can meet.
#[derive(Debug)]
pub struct RaySplats<'a> {
    splats: &'a Splats,
    /// In Morton order: what is near in space is near in memory.
    records: Vec<RayRecord>,
    /// Spheres about [`SPLATS_PER_CLUSTER`] records each.
    clusters: Vec<Sphere>,
}

/// Equal results for any number of threads.
impl RayTracer for RaySplats<'_> {
    fn trace(&self, rays: &Rays, asked: RayOutputs, path: SimdPath) -> RayHits {
        let mut hits = RayHits::none(rays.len(), asked);
        let packets = Packets::new(rays);
        for group in &packets.groups {
            let pairs = self.pairs(group, path);
            let colors = if asked.color { self.colors(group, &pairs) } else { Vec::new() };
            let bundles: Vec<Vec<PacketHits>> = (0..group.packets.len().div_ceil(PACKETS_PER_BUNDLE))
                .into_par_iter()
                .map_init(Scratch::default, |scratch, bundle| {
                    let packets_of = bundle * PACKETS_PER_BUNDLE
                        ..group.packets.len().min((bundle + 1) * PACKETS_PER_BUNDLE);
                    scratch.gather(&pairs, &self.records, &colors, bundle, packets_of.len());
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
        let clusters = records.par_chunks(SPLATS_PER_CLUSTER).map(Sphere::about).collect();
        Self { splats, records, clusters }
    }

    /// Gives every splat a value, such as a reflectance, for [`RayOutputs::value`].
    #[must_use]
    pub fn with_values(mut self, value: impl Fn(usize) -> f32 + Sync) -> Self {
        self.records.par_iter_mut().for_each(|record| record.value = value(record.index as usize));
        self
    }

    /// The records that touch each packet of a group, by blocks of records.
    fn pairs(&self, group: &RayGroup, path: SimdPath) -> Vec<BlockPairs> {
        let bundles = group.packets.len().div_ceil(PACKETS_PER_BUNDLE);
        let of_block = |scratch: &mut Vec<(u32, u64)>, (block, records): (usize, &[RayRecord])| {
            scratch.clear();
            // Eight children are one vector of the narrow path.
            let first = block * SPLATS_PER_BLOCK;
            let clusters = &self.clusters[first / SPLATS_PER_CLUSTER..];
            dispatch!(path.narrow(), simd => cull(simd, records, clusters, first, group, scratch));
            BlockPairs::new(scratch, bundles)
        };
        self.records.par_chunks(SPLATS_PER_BLOCK).enumerate().map_init(Vec::new, of_block).collect()
    }

    /// Colours of the records that any packet has, seen from the middle of a group.
    fn colors(&self, group: &RayGroup, pairs: &[BlockPairs]) -> Vec<[f32; 3]> {
        let center = Vec3::from_array(group.center);
        let of_block = |records: &[RayRecord], pairs: &BlockPairs| {
            let mut is_listed = [false; SPLATS_PER_BLOCK];
            for (_, key) in &pairs.pairs {
                is_listed[record_of(*key) % SPLATS_PER_BLOCK] = true;
            }
            let color = |record: &RayRecord, is_listed: bool| {
                if !is_listed {
                    return [0.0; 3];
                }
                let way = (Vec3::from_array(record.mean) - center).as_dvec3().normalize_or_zero();
                let color = sh::color(self.splats.sh_of(record.index as usize), way.to_array());
                color.map(|v| v as f32)
            };
            let listed = records.iter().zip(is_listed);
            listed.map(|(record, is_listed)| color(record, is_listed)).collect::<Vec<_>>()
        };
        let blocks = self.records.par_chunks(SPLATS_PER_BLOCK).zip(pairs);
        blocks.flat_map_iter(|(records, pairs)| of_block(records, pairs)).collect()
    }
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
            starts[*packet as usize / PACKETS_PER_BUNDLE + 1] += 1;
        }
        for bundle in 0..bundles {
            starts[bundle + 1] += starts[bundle];
        }
        let mut next = starts.clone();
        let mut pairs = vec![(0, 0); found.len()];
        for pair in found {
            let at = &mut next[pair.0 as usize / PACKETS_PER_BUNDLE];
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
    /// Gathers the records and the keys of a bundle of `packets` packets.
    fn gather(
        &mut self,
        blocks: &[BlockPairs],
        records: &[RayRecord],
        colors: &[[f32; 3]],
        bundle: usize,
        packets: usize,
    ) {
        let own = || blocks.iter().flat_map(|block| block.bundle(bundle));
        let mut next = [0usize; PACKETS_PER_BUNDLE + 1];
        for (packet, _) in own() {
            next[*packet as usize % PACKETS_PER_BUNDLE + 1] += 1;
        }
        for packet in 0..PACKETS_PER_BUNDLE {
            next[packet + 1] += next[packet];
        }
        self.starts.clear();
        self.starts.extend_from_slice(&next[..=packets]);
        self.keys.resize(next[PACKETS_PER_BUNDLE], 0);
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
            let at = &mut next[*packet as usize % PACKETS_PER_BUNDLE];
            self.keys[*at] = *key >> 32 << 32 | (self.records.len() - 1) as u64;
            *at += 1;
        }
    }
}
