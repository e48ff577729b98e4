//! The GPU's form of splats: the CPU's groups of sixteen, in pieces that fit one binding.

use super::device::Gpu;
use super::error::GpuError;
use crate::attributes::Revision;
use crate::cpu::model::{CpuModel, SplatGroup};
use crate::error::RenderError;
use crate::hooks::GROUP;
use crate::sizes::{CLUSTER, GROUPS_PER_CLUSTER};
use crate::stages::project::rows::ROWS;
use std::sync::{Mutex, PoisonError};
use wm_scene::Splats;

/// Whole blocks of 256 splats.
pub(crate) struct Chunk {
    /// See `geometry.wgsl`.
    pub(crate) splats: wgpu::Buffer,
    /// See `shade.wgsl`.
    pub(crate) sh_rest: wgpu::Buffer,
    /// First splat of the piece in the set.
    pub(crate) first_splat: u32,
    /// Number of blocks.
    pub(crate) blocks: u32,
}

/// A loaded set of splats.
pub(crate) struct GpuModel {
    /// The pieces of the set, in order.
    pub(crate) chunks: Vec<Chunk>,
    /// Index in the loaded [`Splats`] of each splat, padded with 0 to whole blocks.
    pub(crate) source: Vec<u32>,
    /// Number of splats, without padding.
    pub(crate) len: usize,
    /// Rows of `sh_rest` a group.
    pub(crate) sh_rows: u32,
    kept: Mutex<KeptAttributes>,
}

/// Attributes of the splats of a set that stay from frame to frame.
#[derive(Default)]
struct KeptAttributes {
    /// The revision that was requested last.
    last: Option<Revision>,
    uploaded: Option<(Revision, wgpu::Buffer)>,
}

impl GpuModel {
    /// Activates, checks, orders and uploads `splats`.
    ///
    /// # Errors
    /// [`RenderError`] as of [`CpuModel::new`], or if the GPU has no room.
    pub(crate) fn new(gpu: &Gpu, splats: &Splats) -> Result<Self, RenderError> {
        let model = CpuModel::new(splats)?;
        let sh_rows = model.sh_rows();
        let block_bytes = (4 * CLUSTER * ROWS.max(sh_rows as u32) as usize) as u64;
        let most = (gpu.most_binding / block_bytes).min(u64::from(u32::MAX)) as usize;
        if most == 0 {
            let (what, most) = ("256 splats", gpu.most_binding);
            return Err(GpuError::TooLarge { what, bytes: block_bytes, most }.into());
        }
        let blocks = model.clusters.len();
        let mut chunks = Vec::new();
        for first in (0..blocks).step_by(most) {
            let count = most.min(blocks - first);
            let groups = first * GROUPS_PER_CLUSTER..(first + count) * GROUPS_PER_CLUSTER;
            let rest = groups.start * sh_rows..groups.end * sh_rows;
            chunks.push(Chunk {
                splats: gpu.upload("splats", bytemuck::cast_slice(&rows(&model, groups)))?,
                sh_rest: gpu.upload("coefficients of colour", bytemuck::cast_slice(&model.sh_rest[rest]))?,
                first_splat: (first * CLUSTER) as u32,
                blocks: count as u32,
            });
            // What waits to be copied goes with the first submission: not all of a large scene at
            // once.
            gpu.queue.submit([]);
        }
        gpu.check()?;
        Ok(Self {
            chunks,
            len: model.len,
            source: model.source,
            sh_rows: sh_rows as u32,
            kept: Mutex::default(),
        })
    }

    /// The buffer of attributes of this revision, if it has been asked for before: a light that
    /// changes in each frame takes no memory of its own. `numbers` makes them.
    pub(crate) fn kept_attributes(
        &self,
        gpu: &Gpu,
        revision: Revision,
        numbers: impl FnOnce() -> Vec<f32>,
    ) -> Result<Option<wgpu::Buffer>, GpuError> {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((own, buffer)) = &kept.uploaded
            && *own == revision
        {
            return Ok(Some(buffer.clone()));
        }
        if kept.last.replace(revision) != Some(revision) {
            return Ok(None);
        }
        // A buffer of its own: the last one may still be read by passes that are about to be
        // submitted.
        let buffer = gpu.upload("attributes of splats", bytemuck::cast_slice(&numbers()))?;
        kept.uploaded = Some((revision, buffer.clone()));
        Ok(Some(buffer))
    }

    /// Returns the number of blocks of 256 splats.
    pub(crate) fn blocks(&self) -> u32 {
        (self.source.len() / CLUSTER) as u32
    }
}

/// Returns the numbers of `groups` in the order of `geometry.wgsl`.
fn rows(model: &CpuModel, groups: std::ops::Range<usize>) -> Vec<f32> {
    let mut rows = Vec::with_capacity(groups.len() * ROWS as usize * GROUP);
    for index in groups {
        let SplatGroup { mean, quat, scale, log2_opacity, dc } = &model.groups[index];
        let sky = model.sky[index];
        for numbers in mean.iter().chain(quat).chain(scale).chain([log2_opacity]).chain(dc) {
            rows.extend_from_slice(numbers);
        }
        rows.extend((0..GROUP).map(|lane| f32::from(sky >> lane & 1)));
    }
    rows
}
