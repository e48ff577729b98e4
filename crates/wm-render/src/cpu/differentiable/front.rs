//! The first sweep of training: stored parameters to records and windows of tiles.

use crate::cpu::front::{ClusterScratch, Part};
use crate::cpu::model::Cluster;
use crate::differentiable::{DrawnSplats, ForwardConfig};
use crate::dispatch;
use crate::hooks::{GROUP, Medium, ShadeGroup};
use crate::simd::{Lanes, SimdPath};
use crate::sizes::{CLUSTER, GROUPS_PER_CLUSTER};
use crate::stages::intersect::TileGrid;
use crate::stages::project::activate::{Activated, activate};
use crate::stages::project::cpu::{ClusterCull, project_group};
use crate::stages::project::{ProjectCamera, Record};
use crate::stages::shade::cpu::{gather_rows, shade_group};
use fearless_simd::SimdBase;
use std::ops::Range;
use web_time::Instant;
use wm_scene::{Group, Splats, sh};

/// A run of splats and the records that it may fill.
pub(crate) struct Unit<'a> {
    splats: Range<usize>,
    first_record: u32,
    records: &'a mut [Record],
}

impl<'a> Unit<'a> {
    /// Cuts `count` splats in about `wanted` runs of whole clusters.
    pub(crate) fn split(count: usize, wanted: usize, records: &'a mut Vec<Record>) -> Vec<Self> {
        if records.len() < count {
            records.resize(count, Record::default());
        }
        let size = count.div_ceil(CLUSTER).div_ceil(wanted).max(1) * CLUSTER;
        let unit = |first: usize, records: &'a mut [Record]| Self {
            splats: first..first + records.len(),
            first_record: first as u32,
            records,
        };
        let units = (0..).step_by(size).zip(records[..count].chunks_mut(size));
        units.map(|(first, records)| unit(first, records)).collect()
    }
}

/// The inputs that all units of one forward pass share.
pub(crate) struct Front<'a> {
    path: SimdPath,
    splats: &'a Splats,
    camera: &'a ProjectCamera,
    cull: ClusterCull,
    config: &'a ForwardConfig,
    grid: TileGrid,
}

/// Working memory of one unit.
struct Scratch {
    cluster: ClusterScratch,
    activated: Activated,
    sh: [[f32; GROUP]; 48],
}

impl<'a> Front<'a> {
    /// The sweep of one forward pass.
    pub(crate) fn new(
        path: SimdPath,
        splats: &'a Splats,
        camera: &'a ProjectCamera,
        config: &'a ForwardConfig,
        grid: TileGrid,
    ) -> Self {
        Self { path, splats, camera, cull: ClusterCull::new(camera), config, grid }
    }

    /// Runs one unit.
    pub(crate) fn run(&self, unit: Unit<'_>, part: &mut Part) {
        let Unit { splats, first_record, records } = unit;
        part.begin(self.grid, first_record);
        let (cluster, activated) = (ClusterScratch::default(), Activated::default());
        let mut scratch = Box::new(Scratch { cluster, activated, sh: [[0.0; GROUP]; 48] });
        let mut used = 0;
        for first in splats.clone().step_by(CLUSTER) {
            let own = first..(first + CLUSTER).min(splats.end);
            let begun = Instant::now();
            let bound = dispatch!(self.path, s => bound(s, self.splats, own.clone()));
            if self.cull.culls(&bound) {
                part.stats.project += begun.elapsed().as_secs_f64();
                continue;
            }
            let groups = self.project_cluster(own, &mut scratch);
            let cluster = first / CLUSTER;
            let visible = dispatch!(self.path, s => scratch.cluster.write_records(s, groups, cluster, false, &mut records[used..]));
            let projected = Instant::now();
            let own = &records[used..used + visible];
            let first = first_record + used as u32;
            dispatch!(self.path, s => part.pairs.extend(s, own, &scratch.cluster.boxes, first, self.grid));
            used += visible;
            part.stats.project += (projected - begun).as_secs_f64();
            part.stats.intersect += projected.elapsed().as_secs_f64();
        }
        part.stats.visible = used as u64;
    }

    /// Projects and shades the groups of a cluster that have splats in view, and returns their
    /// number.
    fn project_cluster(&self, range: Range<usize>, scratch: &mut Scratch) -> usize {
        let (splats, camera, mode) = (self.splats, self.camera, self.config.rasterization);
        let (stride, opacity) = (splats.sh_stride(), self.config.opacity);
        let Scratch { cluster, activated, sh: rows } = scratch;
        let count = 3 * sh::coefficients(self.config.sh_degree);
        let mut used = 0;
        for i in 0..GROUPS_PER_CLUSTER {
            let first = range.start + i * GROUP;
            if first >= range.end {
                break;
            }
            let indices = std::array::from_fn(|lane| (first + lane).min(range.end - 1) as u32);
            let here = (range.end - first).min(GROUP);
            dispatch!(self.path, s => activate(s, splats, &indices, here, opacity, activated));
            let (out, shade) = (&mut cluster.projected[used], &mut cluster.shade[used]);
            let group = &mut activated.group;
            dispatch!(self.path, s => project_group(s, group, camera, mode, None, None, out, shade));
            if self.config.drawn == DrawnSplats::WithoutSky {
                let groups = &splats.groups[first..first + here];
                for (lane, _) in groups.iter().enumerate().filter(|(_, group)| **group == Group::Sky) {
                    out.mask &= !(1 << lane);
                }
            }
            if out.mask == 0 {
                continue;
            }
            if self.config.channels.has_color() {
                dispatch!(self.path, s => gather_rows(s, &splats.sh, stride, count, &indices, rows));
                group.dc = [rows[0], rows[1], rows[2]];
                dispatch!(self.path, s => shade_group(s, group, &rows[3..count], shade));
                if let Some(air) = &self.config.air {
                    put_sky_far(&splats.groups, &indices, here, shade);
                    air.shade(self.path, camera.center, std::slice::from_mut(shade));
                }
            } else {
                // The only picture is depth: the first sum that is blended stands in the place of
                // red.
                shade.rgb[0] = out.depth;
            }
            cluster.names[used] = i;
            used += 1;
        }
        used
    }
}

/// Moves the splats of the sky among the first `count` of a group to infinity, where the air leaves
/// them alone.
pub(crate) fn put_sky_far(groups: &[Group], indices: &[u32; GROUP], count: usize, shade: &mut ShadeGroup) {
    for lane in (0..count).filter(|lane| groups[indices[*lane] as usize] == Group::Sky) {
        shade.distance[lane] = f32::INFINITY;
    }
}

/// The box and size of a cluster, as its parameters are now.
#[inline(always)]
fn bound<S: Lanes>(simd: S, splats: &Splats, range: Range<usize>) -> Cluster {
    let means = splats.means[range.clone()].as_flattened();
    let log_scales = splats.log_scales[range].as_flattened();
    // Sixteen splats are 48 numbers, whole vectors of either width; numbers of one axis stay apart.
    const NUMBERS_PER_GROUP: usize = 3 * GROUP;
    let mut low = [simd.set(f32::INFINITY); 6];
    let mut high = [simd.set(f32::NEG_INFINITY); 6];
    let mut largest = low[0].max(high[0]) * -1.0;
    let (chunks, rest) = means.as_chunks::<NUMBERS_PER_GROUP>();
    let (scale_chunks, scale_rest) = log_scales.as_chunks::<NUMBERS_PER_GROUP>();
    for (chunk, scales) in chunks.iter().zip(scale_chunks) {
        for k in 0..NUMBERS_PER_GROUP / S::N {
            let values = simd.load(&chunk[k * S::N..]);
            low[k] = low[k].min(values);
            high[k] = high[k].max(values);
            largest = largest.max(simd.load(&scales[k * S::N..]));
        }
    }
    let (mut least, mut most) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for k in 0..NUMBERS_PER_GROUP / S::N {
        let (mut from, mut to) = ([0.0; GROUP], [0.0; GROUP]);
        low[k].store_slice(&mut from[..S::N]);
        high[k].store_slice(&mut to[..S::N]);
        for lane in 0..S::N {
            let axis = (k * S::N + lane) % 3;
            least[axis] = least[axis].min(from[lane]);
            most[axis] = most[axis].max(to[lane]);
        }
    }
    let mut scales = [f32::NEG_INFINITY; GROUP];
    largest.store_slice(&mut scales[..S::N]);
    for (i, value) in rest.iter().enumerate() {
        least[i % 3] = least[i % 3].min(*value);
        most[i % 3] = most[i % 3].max(*value);
    }
    let max_log_scale = scales.iter().chain(scale_rest).copied().fold(f32::NEG_INFINITY, f32::max);
    Cluster {
        center: std::array::from_fn(|k| 0.5 * (least[k] + most[k])),
        half: std::array::from_fn(|k| 0.5 * (most[k] - least[k])),
        max_scale: max_log_scale.exp(),
    }
}
