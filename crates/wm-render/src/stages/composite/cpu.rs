//! The last steps of one patch, in the first cache.

use super::background::{BackgroundScratch, BackgroundView};
use crate::frame::{FRONT_CHANNELS, MIN_ALPHA};
use crate::hooks::{GROUP, PATCH, PATCH_PIXELS, PixelBatch, PixelEffect};
use crate::simd::{Lanes, SimdPath};
use crate::stages::particles::cpu::Falling;
use crate::stages::rasterize::cpu::PatchSums;

/// One patch's pixels, row by row.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(crate) struct PatchPixels {
    rgb: [[f32; PATCH_PIXELS]; 3],
    alpha: [f32; PATCH_PIXELS],
    depth: [f32; PATCH_PIXELS],
    normal: [[f32; PATCH_PIXELS]; 3],
    median: [f32; PATCH_PIXELS],
    behind: [[f32; PATCH_PIXELS]; 3],
    falls: [[f32; PATCH_PIXELS]; 4],
    background: BackgroundScratch,
}

impl Default for PatchPixels {
    fn default() -> Self {
        let zero = [0.0; PATCH_PIXELS];
        Self {
            rgb: [zero; 3],
            alpha: zero,
            depth: zero,
            normal: [zero; 3],
            median: zero,
            behind: [zero; 3],
            falls: [zero; 4],
            background: BackgroundScratch::default(),
        }
    }
}

/// The rows of the arrays of a frame, in the order of
/// [`CHANNEL_COUNTS`](crate::frame::CHANNEL_COUNTS), that lie in one run of tiles:
/// `[rows][run width * channels]`, no rows of arrays that are not asked for.
pub(crate) type OutputRows<'a> = [Vec<&'a mut [f32]>; 7];

/// Brings block order into rows.
#[inline(always)]
fn to_rows<const LANES: usize>(from: &[f32; PATCH_PIXELS], to: &mut [f32; PATCH_PIXELS]) {
    let block_height = LANES / 4;
    for (run, pixels) in from.chunks_exact(4).enumerate() {
        let (block, row) = (run / block_height, run % block_height);
        let first = (block / 4 * block_height + row) * PATCH + block % 4 * 4;
        to[first..first + 4].copy_from_slice(pixels);
    }
}

/// The inputs that all patches of one frame share.
#[derive(Clone, Copy)]
pub(crate) struct Composite<'a> {
    /// The path that blended.
    pub(crate) path: SimdPath,
    /// The number of sums that it filled.
    pub(crate) features: usize,
    /// The background.
    pub(crate) background: &'a BackgroundView<'a>,
    /// The particles in front of it.
    pub(crate) falling: &'a Falling,
    /// In order.
    pub(crate) effects: &'a [&'a dyn PixelEffect],
}

/// Finishes patch `(patch_x, patch_y)`: background, effects, division, output. `offset` is the
/// patch's first column and row in the output rows, `LANES` the width of the path that blended.
///
/// Plain loops that the compiler makes vectors of. It makes slower ones with AVX-512 than with
/// AVX2, so the caller enters with the latter.
#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "few callers; a struct would only repeat the names")]
pub(crate) fn finish_patch<S: Lanes, const LANES: usize>(
    _: S,
    frame: &Composite<'_>,
    sums: &PatchSums,
    patch_x: usize,
    patch_y: usize,
    pixels: &mut PatchPixels,
    offset: (usize, usize),
    out: &mut OutputRows<'_>,
) {
    let Composite { path, features, background, falling, effects } = *frame;
    let [rgb, alpha, depth, median_depth, normal, particles, front] = out;
    to_rows::<LANES>(&sums.alpha, &mut pixels.alpha);
    background.fill(patch_x, patch_y, &mut pixels.background, &mut pixels.behind);
    for k in 0..3 {
        to_rows::<LANES>(&sums.features[k], &mut pixels.rgb[k]);
        for i in 0..PATCH_PIXELS {
            pixels.rgb[k][i] += (1.0 - pixels.alpha[i]) * pixels.behind[k][i];
        }
    }
    if features > 3 && !(depth.is_empty() && effects.is_empty()) {
        to_rows::<LANES>(&sums.features[3], &mut pixels.depth);
    }
    let behind = (&sums.alpha, &sums.features[3]);
    let falls = if particles.is_empty() {
        None
    } else {
        pixels.falls = [[0.0; PATCH_PIXELS]; 4];
        Some(&mut pixels.falls)
    };
    // What lies between comes before what falls.
    let drawn = (!front.is_empty()).then_some(pixels.rgb);
    falling.draw(path, patch_x, patch_y, &mut pixels.rgb, behind, falls);
    if let Some(drawn) = drawn {
        pixels.rgb = drawn;
    }
    interleave_four(&pixels.falls, offset.0, offset.1, particles);
    if !front.is_empty() {
        for (k, from) in sums.front.iter().enumerate() {
            let mut rows = [0.0; PATCH_PIXELS];
            to_rows::<LANES>(from, &mut rows);
            copy_part(&rows, offset.0, offset.1, k, front);
        }
    }
    for effect in effects {
        effect.apply(
            path,
            &mut PixelBatch {
                x: (patch_x * PATCH) as u32,
                y: (patch_y * PATCH) as u32,
                rgb: &mut pixels.rgb,
                alpha: &pixels.alpha,
                depth_sum: &pixels.depth,
            },
        );
    }
    interleave(&pixels.rgb, offset.0, offset.1, rgb);
    copy(&pixels.alpha, offset.0, offset.1, alpha);
    if !depth.is_empty() {
        for i in 0..PATCH_PIXELS {
            let covered = pixels.alpha[i] >= MIN_ALPHA;
            pixels.depth[i] = if covered { pixels.depth[i] / pixels.alpha[i] } else { 0.0 };
        }
        copy(&pixels.depth, offset.0, offset.1, depth);
    }
    if !normal.is_empty() {
        for k in 0..3 {
            to_rows::<LANES>(&sums.features[4 + k], &mut pixels.normal[k]);
        }
        for i in 0..PATCH_PIXELS {
            let [x, y, z] = [pixels.normal[0][i], pixels.normal[1][i], pixels.normal[2][i]];
            let squared = x * x + y * y + z * z;
            let covered = pixels.alpha[i] >= MIN_ALPHA && squared > 1e-20;
            let scale = if covered { 1.0 / squared.sqrt() } else { 0.0 };
            for k in 0..3 {
                pixels.normal[k][i] *= scale;
            }
        }
        interleave(&pixels.normal, offset.0, offset.1, normal);
    }
    if !median_depth.is_empty() {
        to_rows::<LANES>(&sums.median, &mut pixels.median);
        for i in 0..PATCH_PIXELS {
            pixels.median[i] = if pixels.alpha[i] >= 0.5 { pixels.median[i] } else { 0.0 };
        }
        copy(&pixels.median, offset.0, offset.1, median_depth);
    }
}

#[inline(always)]
fn copy(from: &[f32; PATCH_PIXELS], left: usize, top: usize, rows: &mut [&mut [f32]]) {
    for (row, pixels) in rows.iter_mut().skip(top).zip(from.as_chunks::<PATCH>().0) {
        write_line(&mut row[left..], pixels);
    }
}

/// Copies part `part` of [`crate::Frame::front`].
#[inline(always)]
fn copy_part(from: &[f32; PATCH_PIXELS], left: usize, top: usize, part: usize, rows: &mut [&mut [f32]]) {
    for (row, pixels) in rows.iter_mut().skip(top).zip(from.chunks_exact(PATCH)) {
        let row = &mut row[FRONT_CHANNELS * left..];
        let width = PATCH.min(row.len() / FRONT_CHANNELS);
        if width == PATCH {
            row[part * PATCH..][..PATCH].copy_from_slice(pixels);
        } else {
            row[part * width..][..width].copy_from_slice(&pixels[..width]);
        }
    }
}

const _: () = assert!(PATCH == GROUP, "a row of a patch is a group of the sums that a surface splits");

/// As [`interleave`], of four channels.
#[inline(always)]
fn interleave_four(from: &[[f32; PATCH_PIXELS]; 4], left: usize, top: usize, rows: &mut [&mut [f32]]) {
    for (y, row) in rows.iter_mut().skip(top).take(PATCH).enumerate() {
        let first = y * PATCH;
        let mut line = [0.0; 4 * PATCH];
        for (x, out) in line.as_chunks_mut::<16>().0.iter_mut().enumerate() {
            let at = first + 4 * x;
            let [r, g, b, a] =
                [&from[0][at..at + 4], &from[1][at..at + 4], &from[2][at..at + 4], &from[3][at..at + 4]];
            *out = [
                r[0], g[0], b[0], a[0], r[1], g[1], b[1], a[1], r[2], g[2], b[2], a[2], r[3], g[3], b[3],
                a[3],
            ];
        }
        write_line(&mut row[4 * left..], &line);
    }
}

#[inline(always)]
fn interleave(from: &[[f32; PATCH_PIXELS]; 3], left: usize, top: usize, rows: &mut [&mut [f32]]) {
    for (y, row) in rows.iter_mut().skip(top).take(PATCH).enumerate() {
        let first = y * PATCH;
        let mut line = [0.0; 3 * PATCH];
        // Four pixels at a time, written out, so that the compiler shuffles and does not scatter.
        for (x, out) in line.as_chunks_mut::<12>().0.iter_mut().enumerate() {
            let at = first + 4 * x;
            let [r, g, b] = [&from[0][at..at + 4], &from[1][at..at + 4], &from[2][at..at + 4]];
            *out = [r[0], g[0], b[0], r[1], g[1], b[1], r[2], g[2], b[2], r[3], g[3], b[3]];
        }
        write_line(&mut row[3 * left..], &line);
    }
}

/// Writes a line, as much of it as the row has room for.
#[inline(always)]
fn write_line<const N: usize>(row: &mut [f32], line: &[f32; N]) {
    if let Some(whole) = row.first_chunk_mut::<N>() {
        *whole = *line;
    } else {
        let width = row.len();
        row.copy_from_slice(&line[..width]);
    }
}
