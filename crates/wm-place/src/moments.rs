//! Several splats as one that has their moments.
//!
//! Mean, covariance and colours are those of all, weighted by worth; the opacity is such that what
//! they cover stays (moment matching, as in Kerbl et al. 2024, "A Hierarchical 3D Gaussian
//! Representation"). What several cover is counted once. Where an opaque splat would cover less, it
//! grows instead: else walls and roads get holes.

use glam::{DMat3, DQuat, DVec3};
use wm_base::jacobi::jacobi;
use wm_scene::splats::{logit, shortest_axis};
use wm_scene::{Splats, quat};

/// Maximum opacity of a merged splat, unless a part of it had more.
const MAX_MERGED_OPACITY: f64 = 0.99;
/// Maximum factor by which its area grows.
const MAX_AREA_GROWTH: f64 = 1.5;
/// Number of the most important splats whose overlaps are computed, pair by pair.
const OVERLAP_SPLATS: usize = 8;
/// Variance added along all axes in distances between splats, as a share of the sum of the
/// variances: splats are thinner than the surfaces they show are rough.
pub(crate) const ADDED_VARIANCE_SHARE: f64 = 0.01;

/// The area of a splat seen from its broad side, squared units, up to a constant factor.
pub(crate) fn cover(log_scale: [f32; 3]) -> f64 {
    let mut sorted = log_scale.map(f64::from);
    sorted.sort_by(f64::total_cmp);
    (sorted[1] + sorted[2]).exp()
}

/// The covariance of a splat in world axes, squared units.
pub(crate) fn covariance(splats: &Splats, index: usize) -> DMat3 {
    let rows = quat::to_matrix(splats.quats[index].map(f64::from));
    let rotation = DMat3::from_cols_array_2d(&rows).transpose();
    let scaled = rotation * DMat3::from_diagonal(DVec3::from_array(splats.scales(index)));
    scaled * scaled.transpose()
}

/// The squared distance of two splats, in standard deviations of both, softened.
pub(crate) fn apart(between: DVec3, both: DMat3) -> f64 {
    let trace = both.x_axis.x + both.y_axis.y + both.z_axis.z;
    let soft = both + DMat3::from_diagonal(DVec3::splat(ADDED_VARIANCE_SHARE * trace + 1e-18));
    between.dot(soft.inverse() * between)
}

/// The root of the sum of a covariance's principal minors: [`cover`] of a thin splat.
fn broad_area(covariance: DMat3) -> f64 {
    let [x, y, z] = covariance.to_cols_array_2d();
    (x[0] * y[1] - x[1] * y[0] + x[0] * z[2] - x[2] * z[0] + y[1] * z[2] - y[2] * z[1]).max(0.0).sqrt()
}

/// The outer product of a vector with itself.
pub(crate) fn outer(v: DVec3) -> DMat3 {
    DMat3::from_cols(v * v.x, v * v.y, v * v.z)
}

/// Writes splat `slot` of `out`: the splats `members`, the first of which is worth most, as one.
/// Nothing is written if they are worth nothing.
///
/// `out` has the SH degree of `splats`; `worth` has a value of 0 or more for each of `splats`.
pub(crate) fn put(out: &mut Splats, slot: usize, splats: &Splats, worth: &[f64], members: &[u32]) {
    let all = || members.iter().map(|index| *index as usize);
    let total: f64 = all().map(|i| worth[i]).sum();
    let Some(keeper) = all().next().filter(|_| total > 0.0) else { return };
    let share = |i: usize| worth[i] / total;
    let mean = |i: usize| DVec3::from_array(splats.means[i].map(f64::from));
    let center: DVec3 = all().map(|i| share(i) * mean(i)).sum();
    let mut moments = DMat3::ZERO;
    for i in all() {
        moments += (covariance(splats, i) + outer(mean(i) - center)) * share(i);
    }
    let (variances, vectors) = jacobi(moments.to_cols_array_2d());
    if !variances.iter().all(|v| v.is_finite()) {
        return;
    }
    let mut rotation = DMat3::from_cols_array_2d(&vectors);
    if rotation.determinant() < 0.0 {
        rotation.z_axis = -rotation.z_axis;
    }
    let turn = DQuat::from_mat3(&rotation);
    out.means[slot] = center.to_array().map(|v| v as f32);
    out.quats[slot] = [turn.w, turn.x, turn.y, turn.z].map(|v| v as f32);
    out.log_scales[slot] = variances.map(|v| (0.5 * v.max(1e-20).ln()) as f32);
    let covered = |i: usize| splats.opacity(i) * cover(splats.log_scales[i]);
    // One that is hidden more than the keeper covers less of what is seen.
    let density = |i: usize| worth[i] / covered(i).max(1e-30);
    let seen = |i: usize| (density(i) / density(keeper).max(1e-30)).min(1.0);
    let covers = |i: usize| if i == keeper { covered(i) } else { covered(i) * seen(i) };
    let mut together: f64 = all().map(covers).sum();
    for (position, a) in members.iter().take(OVERLAP_SPLATS).map(|i| *i as usize).enumerate() {
        for b in members[position + 1..].iter().take(OVERLAP_SPLATS).map(|i| *i as usize) {
            let both = covariance(splats, a) + covariance(splats, b);
            let overlap = (-0.5 * apart(mean(a) - mean(b), both)).exp() / broad_area(both).max(1e-30);
            together -= covers(a) * covers(b) * overlap;
        }
    }
    let together = together.max(covered(keeper));
    let scales = &mut out.log_scales[slot];
    let grown = (together / (MAX_MERGED_OPACITY * cover(*scales))).clamp(1.0, MAX_AREA_GROWTH);
    let shortest = shortest_axis(*scales);
    (0..3).filter(|axis| *axis != shortest).for_each(|axis| scales[axis] += 0.5 * grown.ln() as f32);
    let opacity = (together / cover(*scales)).min(splats.opacity(keeper).max(MAX_MERGED_OPACITY));
    out.logit_opacities[slot] = logit(opacity) as f32;
    let stride = splats.sh_stride();
    let sh = &mut out.sh[slot * stride..][..stride];
    sh.fill(0.0);
    for i in all() {
        sh.iter_mut().zip(splats.sh_of(i)).for_each(|(sum, v)| *sum += share(i) as f32 * v);
    }
}
