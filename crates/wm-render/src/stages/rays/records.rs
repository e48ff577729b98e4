//! The records of splats for rays, and spheres about them.

use super::MIN_RELATIVE_SCALE;
use crate::stages::project::SQRT_HALF_LOG2E;
use glam::Vec3;
use wm_scene::splats::shortest_axis;
use wm_scene::{Splats, quat};

/// Splats that are culled together.
pub(super) const SPLATS_PER_CLUSTER: usize = 64;
/// Tolerance of the test of a splat against a cone, relative to its distance.
pub(super) const CONE_TOLERANCE_SHARE: f32 = 4e-6;

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
    /// Makes the record of a splat, with a value of 0; `None` if no ray can meet it.
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
            let scale = f64::from(SQRT_HALF_LOG2E) / scales[k].max(MIN_RELATIVE_SCALE * longest);
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
    pub(super) fn normal(&self, away: &[f32; 3]) -> [f32; 3] {
        let [x, y, z] = self.rows[0];
        let length = (x * x + y * y + z * z).sqrt();
        let is_behind = x * away[0] + y * away[1] + z * away[2] < 0.0;
        let scale = if is_behind { -1.0 / length } else { 1.0 / length };
        [x * scale, y * scale, z * scale]
    }
}

/// A sphere, world axes, scene units.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sphere {
    pub(super) center: Vec3,
    pub(super) radius: f32,
}

impl Sphere {
    /// About all that some records reach.
    pub(super) fn about(records: &[RayRecord]) -> Self {
        let mean = |record: &RayRecord| Vec3::from_array(record.mean);
        let start = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        let (low, high) =
            records.iter().fold(start, |(low, high), it| (low.min(mean(it)), high.max(mean(it))));
        let center = 0.5 * (low + high);
        let reach = |record: &RayRecord| mean(record).distance(center) + record.reach;
        Self { center, radius: 1.0001 * records.iter().map(reach).fold(0.0, f32::max) }
    }
}

/// The place of a key's record.
#[inline(always)]
pub(super) fn record_of(key: u64) -> usize {
    key as u32 as usize
}
