//! The first sweep: clusters of splats to records and windows of tiles.

use super::model::{CpuModel, SplatGroup};
use crate::attributes::{Attribute, AttributeBlock, SplatAttributes};
use crate::budget::FrameBudget;
use crate::config::MedianDepth;
use crate::dispatch;
use crate::frame::splat_name;
use crate::hooks::{GROUP, Medium, ShadeGroup, SkySplats};
use crate::plan::{DrawPass, Shading};
use crate::renderer::Stats;
use crate::simd::{Lanes, SimdPath};
use crate::sizes::{CLUSTER, GROUPS_PER_CLUSTER};
use crate::stages::intersect::TileGrid;
use crate::stages::intersect::cpu::{Pairs, PatchBox};
use crate::stages::project::cpu::{ClusterCull, ProjectedGroup, project_group};
use crate::stages::project::{ProjectCamera, Record};
use crate::stages::shade::cpu::{fade_group, relight_group, shade_group, through_air};
use rayon::prelude::*;
use std::ops::Range;
use web_time::Instant;
use wm_scene::Rasterization;

/// A run of clusters of one set and the records that it may fill.
pub(crate) struct Unit<'a> {
    model: &'a CpuModel,
    attributes: Option<&'a dyn SplatAttributes>,
    clusters: Range<usize>,
    /// The first record of the part among those of the frame.
    first_record: u32,
    records: &'a mut [Record],
}

impl<'a> Unit<'a> {
    /// Splits the sets into about `wanted` runs of equal size; no run crosses sets.
    pub(crate) fn split(
        sets: &[(&'a CpuModel, Option<&'a dyn SplatAttributes>)],
        wanted: usize,
        mut records: &'a mut [Record],
    ) -> Vec<Self> {
        let clusters: usize = sets.iter().map(|(model, _)| model.clusters.len()).sum();
        let size = clusters.div_ceil(wanted).max(1);
        let mut units = Vec::new();
        let mut first_record = 0;
        for (model, attributes) in sets {
            for first in (0..model.clusters.len()).step_by(size) {
                let clusters = first..(first + size).min(model.clusters.len());
                let (own, rest) = records.split_at_mut(clusters.len() * CLUSTER);
                records = rest;
                let count = own.len() as u32;
                units.push(Self { model, attributes: *attributes, clusters, first_record, records: own });
                first_record += count;
            }
        }
        units
    }
}

/// The results of the first sweep for one unit; kept from frame to frame for its memory.
#[derive(Debug, Default)]
pub(crate) struct Part {
    /// The pairs of tiles and splats.
    pub(crate) pairs: Pairs,
    /// The number of the first pair among those of the frame, where pairs are numbered.
    pub(crate) first_pair: usize,
    /// The first record.
    pub(crate) first_record: usize,
    /// Counts and times.
    pub(crate) stats: Stats,
}

impl Part {
    /// Clears the results of an earlier unit.
    pub(crate) fn begin(&mut self, grid: TileGrid, first_record: u32) {
        self.pairs.clear(grid);
        (self.first_record, self.stats) = (first_record as usize, Stats::default());
    }

    /// Returns the number of records.
    pub(crate) fn visible(&self) -> usize {
        self.stats.visible as usize
    }
}

/// Fills the tile lists with the splats of all parts by `fill`; returns the seconds it took, summed
/// over the threads.
pub(crate) fn scatter(parts: &mut [Part], fill: impl Fn(&mut Part) + Sync) -> f64 {
    let timed = |part: &mut Part| {
        let begun = Instant::now();
        fill(part);
        begun.elapsed().as_secs_f64()
    };
    parts.par_iter_mut().map(timed).sum()
}

/// The inputs that all units of one frame share.
pub(crate) struct Front<'a> {
    path: SimdPath,
    camera: &'a ProjectCamera,
    cull: ClusterCull,
    rasterization: Rasterization,
    medium: Option<&'a dyn Medium>,
    shading: Shading,
    sky_splats: SkySplats,
    grid: TileGrid,
    /// The plane below which nothing is drawn ([`DrawPass::cut`]): its normal, and its height above
    /// the camera.
    cut: Option<[f32; 4]>,
    /// Normal of the surface that splits the blend, if the pass has one ([`DrawPass::surface`]).
    split: Option<[f32; 3]>,
    median: MedianDepth,
    /// The memory of the pairs of all units.
    budget: &'a FrameBudget,
}

impl<'a> Front<'a> {
    /// The sweep of one frame.
    pub(crate) fn new(
        path: SimdPath,
        camera: &'a ProjectCamera,
        pass: &DrawPass<'a>,
        grid: TileGrid,
        budget: &'a FrameBudget,
    ) -> Self {
        Self {
            budget,
            path,
            camera,
            cull: ClusterCull::new(camera),
            rasterization: pass.config.rasterization,
            medium: pass.hooks.medium,
            shading: pass.shading,
            sky_splats: pass.hooks.sky_splats(),
            grid,
            median: pass.config.outputs.median_depth,
            split: pass.surface.map(|surface| surface.normal.map(|v| v as f32)),
            cut: pass.cut.map(|plane| plane.seen_from(pass.camera.center().to_array())),
        }
    }

    /// Runs one unit.
    pub(crate) fn run(&self, unit: Unit<'_>, part: &mut Part) {
        let Unit { model, attributes, clusters, first_record, records } = unit;
        part.begin(self.grid, first_record);
        let mut scratch = Box::<ClusterScratch>::default();
        let mut used = 0;
        let fading = attributes.filter(|attributes| attributes.changes_visibility());
        let light =
            attributes.filter(|attributes| attributes.changes_light() && self.shading == Shading::Color);
        for cluster in clusters {
            if self.cull.culls(&model.clusters[cluster]) {
                continue;
            }
            let begun = Instant::now();
            let source = &model.source[cluster * CLUSTER..(cluster + 1) * CLUSTER];
            if let Some(attributes) = fading {
                scratch.attributes.read_visibility(attributes, source);
            }
            let groups = dispatch!(self.path, s => self.project_cluster(s, model, fading.is_some(), cluster, &mut scratch));
            let projected = Instant::now();
            if let Some(light) = light.filter(|_| groups > 0) {
                let mut seen = [0; CLUSTER];
                for (group, to) in seen.chunks_exact_mut(GROUP).take(groups).enumerate() {
                    let from = &source[scratch.names[group] * GROUP..][..GROUP];
                    let mask = scratch.projected[group].mask;
                    // Lanes out of view repeat one in view: their own gains are not needed, and
                    // fetching them would cost memory traffic.
                    let first = from[(mask.trailing_zeros() & 15) as usize];
                    for lane in 0..GROUP {
                        to[lane] = if mask >> lane & 1 == 1 { from[lane] } else { first };
                    }
                }
                scratch.attributes.read_light(light, &seen[..groups * GROUP]);
                let own = &model.groups[cluster * GROUPS_PER_CLUSTER..];
                dispatch!(self.path, s => scratch.relight(s, own, groups));
            }
            if groups > 0 {
                let shade = &mut scratch.shade[..groups];
                through_air(self.path, self.medium, self.shading, self.camera.center, shade);
            }
            let seen = Instant::now();
            let visible = dispatch!(self.path, s => scratch.write_records(s, groups, cluster, self.split.is_some(), &mut records[used..]));
            let own = &records[used..used + visible];
            let first = first_record + used as u32;
            let before = part.pairs.len();
            dispatch!(self.path, s => part.pairs.extend(s, own, &scratch.boxes, first, self.grid));
            if !self.budget.take(Pairs::PAIR_BYTES * (part.pairs.len() - before)) {
                break;
            }
            if self.median == MedianDepth::Splat {
                // The keys hold the depth now, and blending reads it for the median alone.
                for record in &mut records[used..used + visible] {
                    record.depth = splat_name(model.source[record.index as usize]);
                }
            }
            used += visible;
            part.stats.project += (projected - begun).as_secs_f64();
            part.stats.medium += (seen - projected).as_secs_f64();
            part.stats.intersect += seen.elapsed().as_secs_f64();
        }
        part.stats.visible = used as u64;
    }

    /// Projects and shades the groups of a cluster that have splats in view, and returns their
    /// number.
    #[inline(always)]
    fn project_cluster<S: Lanes>(
        &self,
        simd: S,
        model: &CpuModel,
        has_attributes: bool,
        cluster: usize,
        scratch: &mut ClusterScratch,
    ) -> usize {
        let rows = model.sh_rows();
        let mut used = 0;
        for i in 0..GROUPS_PER_CLUSTER {
            let index = cluster * GROUPS_PER_CLUSTER + i;
            let group = &model.groups[index];
            let factors = has_attributes.then(|| scratch.attributes.group(i, Attribute::Visibility));
            let (out, shade) = (&mut scratch.projected[used], &mut scratch.shade[used]);
            project_group(simd, group, self.camera, self.rasterization, factors, self.split, out, shade);
            let sky = model.sky[index];
            if self.sky_splats == SkySplats::LeftOut {
                out.mask &= !u32::from(sky);
            }
            if let Some(plane) = self.cut {
                out.mask &= above(plane, shade);
            }
            if out.mask == 0 {
                continue;
            }
            shade_group(simd, group, &model.sh_rest[index * rows..(index + 1) * rows], shade);
            if sky != 0 {
                for lane in (0..GROUP).filter(|lane| sky >> lane & 1 == 1) {
                    shade.distance[lane] = f32::INFINITY;
                }
            }
            scratch.names[used] = i;
            used += 1;
        }
        used
    }
}

/// Returns a bit for each splat of a group that lies above a plane.
#[inline(always)]
fn above(plane: [f32; 4], group: &ShadeGroup) -> u32 {
    let [x, y, z, height] = plane;
    let mut mask = 0;
    for lane in 0..GROUP {
        let [dx, dy, dz] = [0, 1, 2].map(|k| group.direction[k][lane] * group.distance[lane]);
        mask |= u32::from(x * dx + y * dy + z * dz >= height) << lane;
    }
    mask
}

/// Working memory of one unit: the groups of one cluster that have splats in view.
pub(crate) struct ClusterScratch {
    pub(crate) projected: [ProjectedGroup; GROUPS_PER_CLUSTER],
    pub(crate) shade: [ShadeGroup; GROUPS_PER_CLUSTER],
    /// Position of each group in its cluster.
    pub(crate) names: [usize; GROUPS_PER_CLUSTER],
    attributes: AttributeBlock,
    pub(crate) boxes: [PatchBox; CLUSTER],
}

impl Default for ClusterScratch {
    fn default() -> Self {
        Self {
            projected: std::array::from_fn(|_| ProjectedGroup::default()),
            shade: [ShadeGroup::default(); GROUPS_PER_CLUSTER],
            names: [0; GROUPS_PER_CLUSTER],
            attributes: AttributeBlock::default(),
            boxes: [PatchBox::default(); CLUSTER],
        }
    }
}

impl ClusterScratch {
    /// Changes the light on the splats of the groups in view by their gains, which are in the same
    /// order; `cluster` are the groups of their cluster.
    #[inline(always)]
    fn relight<S: Lanes>(&mut self, simd: S, cluster: &[SplatGroup], groups: usize) {
        for (group, shade) in self.shade[..groups].iter_mut().enumerate() {
            let fade = self.attributes.group(group, Attribute::Fade);
            if fade.iter().any(|fade| *fade != 0.0) {
                fade_group(simd, &cluster[self.names[group]], fade, shade);
            }
            let gains = Attribute::GAINS.map(|gain| self.attributes.group(group, gain));
            relight_group(simd, gains, shade);
        }
    }

    /// Writes the records and boxes of the splats in view, and returns their number.
    #[inline(always)]
    pub(crate) fn write_records<S: Lanes>(
        &mut self,
        simd: S,
        groups: usize,
        cluster: usize,
        is_split: bool,
        records: &mut [Record],
    ) -> usize {
        let mut used = 0;
        for i in 0..groups {
            let (from, shade) = (&self.projected[i], &self.shade[i]);
            let first = ((cluster * GROUPS_PER_CLUSTER + self.names[i]) * GROUP) as u32;
            let rows = Record::transposed(simd, from, shade, first);
            let mut mask = from.mask;
            while mask != 0 {
                // The mask proves the lane in bounds.
                let lane = (mask.trailing_zeros() & 15) as usize;
                mask &= mask - 1;
                records[used] = rows[lane];
                if is_split {
                    records[used].index = from.slopes[lane];
                }
                self.boxes[used & (CLUSTER - 1)] = PatchBox {
                    columns: from.columns.map(|ends| ends[lane] as u16),
                    rows: from.rows.map(|ends| ends[lane] as u16),
                };
                used += 1;
            }
        }
        used
    }
}
