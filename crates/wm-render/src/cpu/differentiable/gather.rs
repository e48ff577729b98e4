//! The last sweep of training: slots to gradients, over the splats in view.

use super::front::put_sky_far;
use crate::cpu::front::Part;
use crate::differentiable::ForwardConfig;
use crate::dispatch;
use crate::gradients::{Gradients, Learn};
use crate::hooks::{GROUP, ShadeGroup};
use crate::simd::{Lanes, SimdPath, transpose};
use crate::stages::project::activate::{Activated, activate};
use crate::stages::project::{ProjectCamera, Record};
use crate::stages::project_backward::cpu::{SplatGradients, project_backward_group, rays as cast_rays};
use crate::stages::rasterize_backward::{GradientSlot, NO_SLOT};
use crate::stages::shade::cpu::{gather_rows, shade_group};
use crate::stages::shade_backward::cpu::{ShadeGradients, shade_backward_group};
use fearless_simd::SimdBase;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use wm_scene::{Splats, sh};

/// The inputs that all parts share.
pub(crate) struct Gather<'a> {
    pub(crate) path: SimdPath,
    pub(crate) splats: &'a Splats,
    pub(crate) camera: &'a ProjectCamera,
    pub(crate) config: &'a ForwardConfig,
    pub(crate) learn: Learn,
    pub(crate) records: &'a [Record],
    pub(crate) slots: &'a [GradientSlot],
    pub(crate) places: &'a [AtomicU32],
}

/// The rows of gradients of one part; arrays of parameters that do not learn are empty.
struct Rows<'a> {
    visible: &'a mut [u32],
    means: &'a mut [[f32; 3]],
    quats: &'a mut [[f32; 4]],
    log_scales: &'a mut [[f32; 3]],
    logit_opacities: &'a mut [f32],
    sh: &'a mut [f32],
    means2d: &'a mut [[f32; 2]],
    absgrads: &'a mut [[f32; 2]],
    weights: &'a mut [f32],
    radii: &'a mut [f32],
}

/// Splits the first `count` elements off `slice`; returns nothing if it is empty.
fn take<'a, T>(slice: &mut &'a mut [T], count: usize) -> &'a mut [T] {
    let all = std::mem::take(slice);
    let (own, rest) = all.split_at_mut(count.min(all.len()));
    *slice = rest;
    own
}

impl<'a> Rows<'a> {
    fn of(gradients: &'a mut Gradients) -> Self {
        Self {
            visible: &mut gradients.visible,
            means: &mut gradients.means,
            quats: &mut gradients.quats,
            log_scales: &mut gradients.log_scales,
            logit_opacities: &mut gradients.logit_opacities,
            sh: &mut gradients.sh,
            means2d: &mut gradients.means2d,
            absgrads: &mut gradients.absgrads,
            weights: &mut gradients.weights,
            radii: &mut gradients.radii,
        }
    }

    fn take(&mut self, count: usize, stride: usize) -> Self {
        Self {
            visible: take(&mut self.visible, count),
            means: take(&mut self.means, count),
            quats: take(&mut self.quats, count),
            log_scales: take(&mut self.log_scales, count),
            logit_opacities: take(&mut self.logit_opacities, count),
            sh: take(&mut self.sh, count * stride),
            means2d: take(&mut self.means2d, count),
            absgrads: take(&mut self.absgrads, count),
            weights: take(&mut self.weights, count),
            radii: take(&mut self.radii, count),
        }
    }
}

/// Adds up the slots of sixteen splats, whose `places` end at `ends`: one array per number of a
/// slot.
#[inline(always)]
fn sum_slots<S: Lanes>(
    simd: S,
    slots: &[GradientSlot],
    places: &[u32],
    ends: &[usize; GROUP],
    sums: &mut [[f32; GROUP]; GROUP],
) {
    let mut begin = 0;
    for (row, end) in sums.iter_mut().zip(ends) {
        let mut sum = [simd.set(0.0); 2];
        for place in &places[begin..*end] {
            let slot = &slots[*place as usize].0;
            for k in 0..GROUP / S::N {
                sum[k] += simd.load(&slot[k * S::N..]);
            }
        }
        for k in 0..GROUP / S::N {
            sum[k].store_slice(&mut row[k * S::N..(k + 1) * S::N]);
        }
        begin = *end;
    }
    transpose(simd, sums);
}

/// Working memory of one part.
#[derive(Default)]
struct Scratch {
    places: Vec<u32>,
    activated: Activated,
    splats: SplatGradients,
    shade: ShadeGradients,
    sh: Option<Box<[[f32; GROUP]; 48]>>,
    by_rgb: [[f32; GROUP]; 3],
    rays: ShadeGroup,
}

impl Gather<'_> {
    /// Fills `gradients`, whose sizes are set.
    pub(crate) fn run(&self, parts: &[Part], gradients: &mut Gradients) {
        let stride = gradients.sh_stride();
        let mut rest = Rows::of(gradients);
        let parts: Vec<(&Part, Rows<'_>)> =
            parts.iter().map(|part| (part, rest.take(part.visible(), stride))).collect();
        parts.into_par_iter().for_each(|(part, rows)| self.derive_part(part, rows, stride));
    }

    /// Derives the splats of one part. The kernels are entered one by one: in one piece they would
    /// take the compiler minutes.
    fn derive_part(&self, part: &Part, mut rows: Rows<'_>, stride: usize) {
        let mut scratch = Box::<Scratch>::default();
        let mut pairs = part.pairs.records().enumerate().peekable();
        for first in (0..part.visible()).step_by(GROUP) {
            let count = (part.visible() - first).min(GROUP);
            let first = part.first_record + first;
            let records = &self.records[first..first + count];
            let mut ends = [0; GROUP];
            scratch.places.clear();
            for (i, end) in ends.iter_mut().enumerate() {
                while let Some((pair, _)) = pairs.next_if(|(_, record)| *record == first + i) {
                    let place = self.places[part.first_pair + pair].load(Relaxed);
                    if place != NO_SLOT {
                        scratch.places.push(place);
                    }
                }
                *end = scratch.places.len();
            }
            let mut sums = [[0.0; GROUP]; GROUP];
            dispatch!(self.path, s => sum_slots(s, self.slots, &scratch.places, &ends, &mut sums));
            let indices: [u32; GROUP] = std::array::from_fn(|lane| records[lane.min(count - 1)].index);
            self.group(&indices, records, &sums, &mut scratch);
            let own = rows.take(count, stride);
            own.visible.copy_from_slice(&indices[..count]);
            self.write(&mut scratch, &sums, own, stride);
        }
    }

    /// Derives sixteen splats.
    fn group(
        &self,
        indices: &[u32; GROUP],
        records: &[Record],
        sums: &[[f32; GROUP]; GROUP],
        scratch: &mut Scratch,
    ) {
        let Scratch { activated, splats: out, shade, sh, by_rgb, rays, .. } = scratch;
        let (splats, config) = (self.splats, self.config);
        let (here, opacity) = (records.len(), config.opacity);
        dispatch!(self.path, s => activate(s, splats, indices, here, opacity, activated));
        let colored = self.config.channels.has_color();
        let turning = colored && self.learn.means && self.config.sh_degree > 0;
        if turning || self.learn.sh {
            for (lane, record) in records.iter().enumerate() {
                for k in 0..3 {
                    let lit = record.rgb[k] > 0.0;
                    by_rgb[k][lane] = if lit { sums[GradientSlot::FEATURES + k][lane] } else { 0.0 };
                }
            }
            let count = 3 * sh::coefficients(self.config.sh_degree);
            let rows = sh.get_or_insert_with(|| Box::new([[0.0; GROUP]; 48]));
            let stride = splats.sh_stride();
            dispatch!(self.path, s => gather_rows(s, &splats.sh, stride, count, indices, rows));
            dispatch!(self.path, s => cast_rays(s, activated, self.camera, rays));
            if let Some(air) = &config.air {
                put_sky_far(&splats.groups, indices, here, rays);
                let group = &mut activated.group;
                group.dc = [rows[0], rows[1], rows[2]];
                dispatch!(self.path, s => shade_group(s, group, &rows[3..count], rays));
                dispatch!(self.path, s => air.pull_back(s, rays, by_rgb));
            }
            dispatch!(self.path, s => shade_backward_group(s, &rows[..count], &rays.direction, by_rgb, shade));
        }
        let by_direction = if turning { shade.direction } else { [[0.0; GROUP]; 3] };
        dispatch!(self.path, s => project_backward_group(s, activated, self.camera, config, sums, &by_direction, out));
    }

    /// Writes sixteen splats' rows.
    fn write(&self, scratch: &mut Scratch, sums: &[[f32; GROUP]; GROUP], rows: Rows<'_>, stride: usize) {
        let from = &scratch.splats;
        write_rows(rows.means, &from.mean);
        write_rows(rows.quats, &from.quat);
        write_rows(rows.log_scales, &from.log_scale);
        write_rows(rows.means2d, &from.mean2d);
        write_rows(rows.absgrads, &from.absgrad);
        let opacities = rows.logit_opacities.len();
        rows.logit_opacities.copy_from_slice(&from.logit_opacity[..opacities]);
        rows.weights.copy_from_slice(&sums[GradientSlot::WEIGHT][..rows.visible.len()]);
        rows.radii.copy_from_slice(&from.radius[..rows.visible.len()]);
        if self.learn.sh {
            let parts = &mut scratch.shade.sh.as_chunks_mut::<GROUP>().0[..stride.div_ceil(GROUP)];
            for (part, block) in parts.iter_mut().enumerate() {
                dispatch!(self.path, s => transpose(s, block));
                for (values, row) in block.iter().zip(rows.sh.chunks_exact_mut(stride)) {
                    let row = &mut row[part * GROUP..];
                    if let Some(whole) = row.first_chunk_mut::<GROUP>() {
                        *whole = *values;
                    } else {
                        row.copy_from_slice(&values[..row.len()]);
                    }
                }
            }
        }
    }
}

/// Writes the first lanes of some values to as many rows.
fn write_rows<const N: usize>(rows: &mut [[f32; N]], values: &[[f32; GROUP]; N]) {
    for (lane, row) in rows.iter_mut().enumerate() {
        *row = values.each_ref().map(|values| values[lane]);
    }
}
