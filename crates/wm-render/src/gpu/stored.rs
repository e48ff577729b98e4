//! Splats in stored form on the GPU: as they learn, in their own order, in pieces that one binding holds.

use super::buffers::Growing;
use super::device::Gpu;
use super::error::GpuError;
use super::lists::CHUNKS;
use super::recorder::Recorder;
use super::source::WORKGROUP;
use super::uniforms::{self, Uniform};
use crate::differentiable::{Channels, ForwardConfig};
use crate::hooks::GROUP;
use crate::stages::project::gpu::{Piece, ROWS};
use rayon::prelude::*;
use wgpu::BufferUsages;
use wm_scene::{Group, Splats, sh};

/// Whole blocks of 256 splats, the last one padded.
struct Part {
    splats: wgpu::Buffer,
    sh_rest: wgpu::Buffer,
    piece: uniforms::Piece,
}

/// The splats of a training.
#[derive(Default)]
pub(crate) struct StoredModel {
    kept: Vec<[Growing; 2]>,
    parts: Vec<Part>,
}

impl StoredModel {
    /// Uploads `splats` in place of what was there.
    pub fn write(&mut self, gpu: &Gpu, splats: &Splats) -> Result<(), GpuError> {
        let sh_rows = splats.sh_stride() as u32 - 3;
        let block_bytes = u64::from(4 * WORKGROUP * ROWS.max(sh_rows));
        let most = (gpu.most_binding() / block_bytes).min(u64::from(u32::MAX / WORKGROUP)) as usize;
        if most == 0 {
            let (what, most) = ("256 splats", gpu.most_binding());
            return Err(GpuError::TooLarge { what, bytes: block_bytes, most });
        }
        let most = most * WORKGROUP as usize;
        let count = splats.len().div_ceil(most);
        // Let go of first, or what grows would be there twice.
        self.parts.clear();
        self.kept.resize_with(count, Default::default);
        for (first, kept) in (0..splats.len()).step_by(most).zip(&mut self.kept) {
            let indices = first..(first + most).min(splats.len());
            let blocks = (indices.len() as u32).div_ceil(WORKGROUP);
            let groups = blocks as usize * WORKGROUP as usize / GROUP;
            let write = |growing: &mut Growing, what: &'static str, rows: u32, fill: &Fill<'_>| {
                let mut numbers = vec![0.0f32; groups * rows as usize * GROUP];
                let each = numbers.par_chunks_mut((rows as usize * GROUP).max(1)).enumerate();
                each.for_each(|(group, numbers)| {
                    let first = indices.start + group * GROUP;
                    for (lane, index) in (first..indices.end).take(GROUP).enumerate() {
                        fill(index, &mut |row, value| numbers[row * GROUP + lane] = value);
                    }
                });
                growing.write(gpu, what, &numbers, BufferUsages::STORAGE | BufferUsages::COPY_DST)
            };
            let [geometry, rest] = kept;
            self.parts.push(Part {
                splats: write(geometry, "splats", ROWS, &|index, set| geometry_of(splats, index, set))?,
                sh_rest: write(rest, "coefficients of colour", sh_rows, &|index, set| {
                    let own = &splats.sh[index * splats.sh_stride()..(index + 1) * splats.sh_stride()];
                    own[3..].iter().enumerate().for_each(|(row, value)| set(row, *value));
                })?,
                piece: uniforms::Piece {
                    first_block: (first / WORKGROUP as usize) as u32,
                    blocks,
                    first_splat: first as u32,
                    splats: indices.len() as u32,
                    sh_rows,
                },
            });
            // What waits to be copied goes with the first submission: not all of a large scene at once.
            gpu.queue.submit([]);
        }
        Ok(())
    }

    /// Blocks of 256 splats in it.
    pub fn blocks(&self) -> u32 {
        self.parts.iter().map(|part| part.piece.blocks).sum()
    }

    /// The structures of its pieces.
    pub fn uniforms(&self, config: &ForwardConfig) -> Vec<Uniform> {
        // No colour, no coefficients.
        let degree = if config.channels == Channels::Depth { 0 } else { config.sh_degree };
        let used = 3 * sh::coefficients(degree) as u32 - 3;
        let uniform = |part: &Part| uniforms::training_chunk(part.piece, used, config.opacity);
        self.parts.iter().map(uniform).collect()
    }

    /// Its pieces, whose structures are in the slots from [`CHUNKS`] on.
    pub fn pieces<'a>(&'a self, recorder: &Recorder<'a>) -> Vec<Piece<'a>> {
        let piece = |(i, part): (usize, &'a Part)| Piece {
            uniform: recorder.uniform(CHUNKS + i),
            splats: &part.splats,
            sh_rest: &part.sh_rest,
            visibility: None,
            blocks: part.piece.blocks,
        };
        self.parts.iter().enumerate().map(piece).collect()
    }
}

/// Gives the numbers of a splat, row by row.
type Fill<'a> = dyn Fn(usize, &mut dyn FnMut(usize, f32)) + Sync + 'a;

/// The rows of `geometry.wgsl`.
fn geometry_of(splats: &Splats, index: usize, set: &mut dyn FnMut(usize, f32)) {
    let sh = index * splats.sh_stride();
    let rows = splats.means[index].iter().chain(&splats.quats[index]).chain(&splats.log_scales[index]);
    let rows = rows.chain([&splats.logit_opacities[index]]).chain(&splats.sh[sh..sh + 3]);
    let sky = f32::from(u8::from(splats.groups[index] == Group::Sky));
    rows.chain([&sky]).enumerate().for_each(|(row, value)| set(row, *value));
}
