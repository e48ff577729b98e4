//! Splats in stored form on the GPU: as they learn, in their own order, in pieces that one binding
//! holds, with what is remembered of them where they learn there.

mod rearranged;

use super::buffers::{GrowingBuffer, READ_BACK};
use super::device::Gpu;
use super::error::GpuError;
use super::readback::{Part as Back, copy};
use super::recorder::Recorder;
use super::source::WORKGROUP;
use super::uniforms::{self, Uniform};
use crate::differentiable::{Channels, ForwardConfig};
use crate::hooks::GROUP;
use crate::stages::optimize::gpu::Remembered;
use crate::stages::optimize::{DensifyStats, Learnt, LearntMut, Moments, Pair};
use crate::stages::project::gpu::Piece;
use crate::stages::project::rows::{ROW_DC, ROW_MEAN, ROW_OPACITY, ROW_QUAT, ROW_SCALE, ROW_SKY, ROWS};
use rayon::prelude::*;
use std::ops::Range;
use wgpu::BufferUsages;
use wm_scene::{Group, Splats, sh};

/// Numbers per splat of `known` in `optimize.wgsl`. Steps are exact in them: there are fewer than
/// 2^24.
const KNOWN_PER_SPLAT: usize = 4;
const USAGE: BufferUsages = READ_BACK.union(BufferUsages::COPY_DST);

/// Whole blocks of 256 splats, the last one padded.
pub(super) struct Part {
    splats: wgpu::Buffer,
    sh_rest: wgpu::Buffer,
    /// Moments of both, where they learn here.
    moments: Option<[wgpu::Buffer; 2]>,
    piece: uniforms::Piece,
}

/// The splats of a training.
#[derive(Default)]
pub(crate) struct StoredModel {
    kept: Vec<[GrowingBuffer; 4]>,
    kept_known: GrowingBuffer,
    pub(super) parts: Vec<Part>,
    known: Option<wgpu::Buffer>,
    len: usize,
    pub(crate) sh_degree: u8,
}

/// A field of the splats: an array with its stride, and the rows that the GPU keeps it in.
struct Field<A> {
    array: A,
    /// Numbers of a splat in the array; the field has `count` of them from `at` on.
    stride: usize,
    at: usize,
    count: usize,
    /// The first row.
    row: usize,
}

/// A set of arrays of parameters, or of something of their shape: means, quats, scales, opacities,
/// colours.
type Arrays<A> = [A; 5];

/// The rows of `geometry.wgsl`, but for the last.
fn geometry<A>(arrays: Arrays<A>, stride: usize) -> [Field<A>; 5] {
    let [means, quats, log_scales, logit_opacities, sh] = arrays;
    let field = |array, count, row: u32| Field { array, stride: count, at: 0, count, row: row as usize };
    [
        field(means, 3, ROW_MEAN),
        field(quats, 4, ROW_QUAT),
        field(log_scales, 3, ROW_SCALE),
        field(logit_opacities, 1, ROW_OPACITY),
        Field { stride, ..field(sh, 3, ROW_DC) },
    ]
}

/// The rows of `shade.wgsl`.
fn coefficients<A>(sh: A, stride: usize) -> [Field<A>; 1] {
    [Field { array: sh, stride, at: 3, count: stride - 3, row: 0 }]
}

/// Moves fields by `rows` rows, to those of the second moments.
fn behind<A, const N: usize>(mut fields: [Field<A>; N], rows: usize) -> [Field<A>; N] {
    fields.iter_mut().for_each(|field| field.row += rows);
    fields
}

fn arrays(splats: &Splats) -> Arrays<&[f32]> {
    let Splats { means, quats, log_scales, logit_opacities, sh, .. } = splats;
    [means.as_flattened(), quats.as_flattened(), log_scales.as_flattened(), logit_opacities, sh]
}

fn arrays_mut(splats: &mut Splats) -> Arrays<&mut [f32]> {
    let Splats { means, quats, log_scales, logit_opacities, sh, .. } = splats;
    [means.as_flattened_mut(), quats.as_flattened_mut(), log_scales.as_flattened_mut(), logit_opacities, sh]
}

/// First and second moments.
fn moment_arrays(moments: &Moments) -> [Arrays<&[f32]>; 2] {
    let Moments { means, quats, log_scales, logit_opacities, sh } = moments;
    let pairs = [means, quats, log_scales, logit_opacities, sh];
    [pairs.map(|pair| &*pair.first), pairs.map(|pair| &*pair.second)]
}

fn moment_arrays_mut(moments: &mut Moments) -> [Arrays<&mut [f32]>; 2] {
    let Moments { means, quats, log_scales, logit_opacities, sh } = moments;
    let [means, quats, log_scales, logit_opacities, sh] = [means, quats, log_scales, logit_opacities, sh]
        .map(|Pair { first, second }| [&mut **first, &mut **second]);
    let ([a, v], [b, w], [c, x], [d, y], [e, z]) = (means, quats, log_scales, logit_opacities, sh);
    [[a, b, c, d, e], [v, w, x, y, z]]
}

/// The splats `range`, by groups: `[groups][rows][16]`.
fn grouped(range: Range<usize>, rows: usize, fields: &[Field<&[f32]>]) -> Vec<f32> {
    let groups = range.len().div_ceil(WORKGROUP as usize) * WORKGROUP as usize / GROUP;
    let mut numbers = vec![0.0f32; groups * rows * GROUP];
    let each = numbers.par_chunks_mut((rows * GROUP).max(1)).enumerate();
    each.for_each(|(group, numbers)| {
        let first = range.start + group * GROUP;
        for Field { array, stride, at, count, row } in fields {
            for (lane, index) in (first..range.end).take(GROUP).enumerate() {
                let own = &array[index * stride + at..][..*count];
                own.iter().enumerate().for_each(|(k, value)| numbers[(row + k) * GROUP + lane] = *value);
            }
        }
    });
    numbers
}

/// Copies numbers by groups back into the arrays of splats.
fn ungroup(numbers: &[f32], range: Range<usize>, rows: usize, fields: &mut [Field<&mut [f32]>]) {
    for Field { array, stride, at, count, row } in fields {
        let own = &mut array[range.start * *stride..range.end * *stride];
        own.par_chunks_mut((*stride).max(1)).with_min_len(1024).enumerate().for_each(|(i, own)| {
            let first = (i / GROUP * rows + *row) * GROUP + i % GROUP;
            own[*at..][..*count]
                .iter_mut()
                .enumerate()
                .for_each(|(k, own)| *own = numbers[first + k * GROUP]);
        });
    }
}

/// Returns 1 for splats of the sky, else 0.
fn skies(splats: &Splats) -> Vec<f32> {
    splats.groups.iter().map(|group| f32::from(u8::from(*group == Group::Sky))).collect()
}

/// The rows of `geometry.wgsl` of the splats `range`, by groups.
fn shapes(splats: &Splats, sky: &[f32], range: Range<usize>) -> Vec<f32> {
    let mut fields = Vec::from(geometry(arrays(splats), splats.sh_stride()));
    fields.push(Field { array: sky, stride: 1, at: 0, count: 1, row: ROW_SKY as usize });
    grouped(range, ROWS as usize, &fields)
}

/// Most splats in a part, whose coefficients above degree 0 have `rest` rows.
fn most_in_part(gpu: &Gpu, rest: usize, learns: bool) -> Result<usize, GpuError> {
    // Of moments there are two.
    let largest = (ROWS as usize).max(rest) * if learns { 2 } else { 1 };
    let block_bytes = 4 * u64::from(WORKGROUP) * largest as u64;
    let most = (gpu.most_binding / block_bytes).min(u64::from(u32::MAX / WORKGROUP)) as usize;
    if most == 0 {
        let (what, most) = ("256 splats", gpu.most_binding);
        return Err(GpuError::TooLarge { what, bytes: block_bytes, most });
    }
    Ok(most * WORKGROUP as usize)
}

fn piece(range: Range<usize>, rest: usize) -> uniforms::Piece {
    uniforms::Piece {
        first_block: (range.start / WORKGROUP as usize) as u32,
        blocks: (range.len() as u32).div_ceil(WORKGROUP),
        first_splat: range.start as u32,
        splats: range.len() as u32,
        sh_rows: rest as u32,
    }
}

/// The splats `range` out of the rows of `geometry.wgsl`.
fn ungroup_shapes(numbers: &[f32], range: Range<usize>, splats: &mut Splats) {
    let stride = splats.sh_stride();
    ungroup(numbers, range.clone(), ROWS as usize, &mut geometry(arrays_mut(splats), stride));
    for (i, group) in splats.groups[range].iter_mut().enumerate() {
        let is_sky = numbers[(i / GROUP * ROWS as usize + ROW_SKY as usize) * GROUP + i % GROUP] > 0.5;
        *group = if is_sky { Group::Sky } else { Group::Scene };
    }
}

impl StoredModel {
    /// Number of splats.
    pub(crate) fn len(&self) -> usize {
        self.len
    }

    /// Returns true if they learn here.
    pub(crate) fn learns(&self) -> bool {
        self.known.is_some()
    }

    /// Uploads `splats` in place of what was there.
    pub(crate) fn write(&mut self, gpu: &Gpu, splats: &Splats) -> Result<(), GpuError> {
        self.known = None;
        self.write_parts(gpu, splats, None)
    }

    /// Uploads splats with what is known of them, to learn here.
    pub(crate) fn write_learnt(&mut self, gpu: &Gpu, learnt: Learnt<'_>) -> Result<(), GpuError> {
        self.known = None;
        self.write_parts(gpu, learnt.splats, Some(learnt.moments))?;
        self.write_known(gpu, learnt.pulls, learnt.seen)
    }

    fn write_known(&mut self, gpu: &Gpu, pulls: &DensifyStats, seen: &[u32]) -> Result<(), GpuError> {
        let of = |i: usize| [pulls.sums[i], pulls.counts[i], pulls.radii[i], seen[i] as f32];
        let known: Vec<f32> = (0..self.len).flat_map(of).collect();
        self.known = Some(self.kept_known.write(gpu, "what is known of splats", &known, USAGE)?);
        Ok(())
    }

    fn read_known(
        &self,
        gpu: &Gpu,
        staging: &mut GrowingBuffer,
        pulls: &mut DensifyStats,
        seen: &mut [u32],
    ) -> Result<(), GpuError> {
        let buffer = self.known.as_ref().expect("splats that learn on the GPU");
        let mut known = vec![0.0f32; KNOWN_PER_SPLAT * self.len];
        back(gpu, staging, &mut [(buffer, &mut known)])?;
        for (i, own) in known.as_chunks::<KNOWN_PER_SPLAT>().0.iter().enumerate() {
            (pulls.sums[i], pulls.counts[i], pulls.radii[i]) = (own[0], own[1], own[2]);
            seen[i] = own[3] as u32;
        }
        Ok(())
    }

    fn write_parts(&mut self, gpu: &Gpu, splats: &Splats, moments: Option<&Moments>) -> Result<(), GpuError> {
        let stride = splats.sh_stride();
        let rest = stride - 3;
        let most = most_in_part(gpu, rest, moments.is_some())?;
        // Let go of first, or what grows would be there twice.
        self.parts.clear();
        self.kept.resize_with(splats.len().div_ceil(most), Default::default);
        (self.len, self.sh_degree) = (splats.len(), splats.sh_degree);
        let sky = skies(splats);
        let all_rows = ROWS as usize;
        for (first, kept) in (0..splats.len()).step_by(most).zip(&mut self.kept) {
            let range = first..(first + most).min(splats.len());
            let [kept_splats, kept_rest, kept_moments, kept_rest_moments] = kept;
            let numbers = shapes(splats, &sky, range.clone());
            let of_colors = grouped(range.clone(), rest, &coefficients(&*splats.sh, stride));
            let moments = moments.map(|moments| {
                let pair = moment_arrays(moments);
                let [of_sh, of_sh_squares] = [pair[0][4], pair[1][4]];
                let [first, second] = pair.map(|arrays| geometry(arrays, stride));
                let mut fields = Vec::from(first);
                fields.extend(behind(second, all_rows));
                let mut of_colors = Vec::from(coefficients(of_sh, stride));
                of_colors.extend(behind(coefficients(of_sh_squares, stride), rest));
                [grouped(range.clone(), 2 * all_rows, &fields), grouped(range.clone(), 2 * rest, &of_colors)]
            });
            let what = "what is remembered of splats";
            self.parts.push(Part {
                splats: kept_splats.write(gpu, "splats", &numbers, USAGE)?,
                sh_rest: kept_rest.write(gpu, "coefficients of colour", &of_colors, USAGE)?,
                moments: match moments {
                    None => None,
                    Some([numbers, of_colors]) => Some([
                        kept_moments.write(gpu, what, &numbers, USAGE)?,
                        kept_rest_moments.write(gpu, what, &of_colors, USAGE)?,
                    ]),
                },
                piece: piece(range, rest),
            });
            // What waits to be copied goes with the first submission: not all of a large scene at
            // once.
            gpu.queue.submit([]);
        }
        Ok(())
    }

    /// Reads back what was learnt here. `staging` is for the way.
    ///
    /// # Panics
    /// If nothing learns here, or `learnt` is of other splats.
    pub(crate) fn read_learnt(
        &self,
        gpu: &Gpu,
        staging: &mut GrowingBuffer,
        learnt: LearntMut<'_>,
    ) -> Result<(), GpuError> {
        let LearntMut { splats, moments, pulls, seen } = learnt;
        assert_eq!((splats.len(), splats.sh_degree), (self.len, self.sh_degree), "the splats are others");
        let stride = splats.sh_stride();
        let rest = stride - 3;
        self.read_known(gpu, staging, pulls, seen)?;
        for part in &self.parts {
            let Some([part_moments, part_sh_moments]) = &part.moments else { continue };
            let padded = (part.piece.blocks * WORKGROUP) as usize;
            let zeros = |rows: usize| vec![0.0f32; padded * rows];
            let all_rows = ROWS as usize;
            let (mut numbers, mut of_colors) = (zeros(all_rows), zeros(rest));
            let (mut numbers_moments, mut of_colors_moments) = (zeros(2 * all_rows), zeros(2 * rest));
            back(
                gpu,
                staging,
                &mut [
                    (&part.splats, &mut numbers),
                    (&part.sh_rest, &mut of_colors),
                    (part_moments, &mut numbers_moments),
                    (part_sh_moments, &mut of_colors_moments),
                ],
            )?;
            let first = part.piece.first_splat as usize;
            let range = first..first + part.piece.splats as usize;
            ungroup_shapes(&numbers, range.clone(), splats);
            ungroup(&of_colors, range.clone(), rest, &mut coefficients(&mut *splats.sh, stride));
            for (place, of) in moment_arrays_mut(moments).into_iter().enumerate() {
                let [means, quats, log_scales, logit_opacities, sh] = of;
                let shown = [means, quats, log_scales, logit_opacities, &mut *sh];
                let mut fields = behind(geometry(shown, stride), place * all_rows);
                ungroup(&numbers_moments, range.clone(), 2 * all_rows, &mut fields);
                let mut fields = behind(coefficients(sh, stride), place * rest);
                ungroup(&of_colors_moments, range.clone(), 2 * rest, &mut fields);
            }
        }
        Ok(())
    }

    /// Blocks of 256 splats in it.
    pub(crate) fn blocks(&self) -> u32 {
        self.parts.iter().map(|part| part.piece.blocks).sum()
    }

    /// The structures of its pieces.
    pub(crate) fn uniforms(&self, config: &ForwardConfig) -> Vec<Uniform> {
        // No colour, no coefficients.
        let degree = if config.channels == Channels::Depth { 0 } else { config.sh_degree };
        let used = 3 * sh::coefficients(degree) as u32 - 3;
        let uniform = |part: &Part| uniforms::chunk(part.piece, used, None, config.opacity);
        self.parts.iter().map(uniform).collect()
    }

    /// Returns the pieces, whose structures are in the slots from `first` on.
    pub(crate) fn pieces<'a>(&'a self, recorder: &Recorder<'a>, first: usize) -> Vec<Piece<'a>> {
        let piece = |slot: usize, part: &'a Part| Piece {
            uniform: recorder.uniform(slot),
            splats: &part.splats,
            sh_rest: &part.sh_rest,
            attributes: None,
            blocks: part.piece.blocks,
        };
        (first..).zip(&self.parts).map(|(slot, part)| piece(slot, part)).collect()
    }

    /// The optimiser's memory of each of its pieces; none where they do not learn here.
    pub(crate) fn remembered(&self) -> Vec<Remembered<'_>> {
        let Some(known) = &self.known else { return Vec::new() };
        let moments = self.parts.iter().filter_map(|part| part.moments.as_ref());
        moments.map(|[moments, sh_moments]| Remembered { moments, sh_moments, known }).collect()
    }
}

/// Reads back the first numbers of buffers.
fn back(
    gpu: &Gpu,
    staging: &mut GrowingBuffer,
    parts: &mut [(&wgpu::Buffer, &mut Vec<f32>)],
) -> Result<(), GpuError> {
    // A buffer that is never bound stands for structures: nothing is dispatched.
    let recorder = Recorder::new(gpu, parts[0].0, None);
    let mut parts: Vec<Back<'_>> = parts
        .iter_mut()
        .map(|(buffer, numbers)| (*buffer, 0, bytemuck::cast_slice_mut(numbers.as_mut_slice())))
        .collect();
    copy(gpu, recorder, staging, &mut parts)
}
