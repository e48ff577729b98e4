//! The reference of rays: every splat against every ray in f64, by the contract of
//! [`crate::stages::rays`].

use crate::stages::rasterize::{MAX_ALPHA, MIN_TRANSMITTANCE};
use crate::stages::rays::{MIN_HIT_COVERAGE, MIN_RELATIVE_SCALE, STOPPED_COVERAGE};
use glam::{DMat3, DVec3};
use wm_scene::{Splats, quat, sh};

/// The result of one ray.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct ReferenceHit {
    /// Sum of weights.
    pub(crate) coverage: f64,
    /// Distance and splat of the hit.
    pub(crate) hit: Option<(f64, usize)>,
    /// Colour times coverage.
    pub(crate) color: [f64; 3],
    /// Normal times coverage.
    pub(crate) normal: [f64; 3],
    /// The splats that are met and their weights, in order.
    pub(crate) weights: Vec<(usize, f64)>,
    /// Most that the sums of a correct f32 back end are off: by cuts that rounding may decide.
    pub(crate) slack: f64,
    /// The least that the sum of weights is away from half of the coverage between two splats.
    /// Where it is next to nothing, either of the two may be hit.
    pub(crate) margin: f64,
}

/// One splat that a ray meets.
struct MetSplat {
    splat: usize,
    order: f64,
    distance: f64,
    alpha: f64,
    is_sure: bool,
}

/// Traces one ray through the splats for which `is_met` returns true. `center` is the middle of the
/// origins of its group.
pub(crate) fn trace(
    splats: &Splats,
    is_met: impl Fn(usize) -> bool,
    origin: DVec3,
    direction: DVec3,
    center: DVec3,
) -> ReferenceHit {
    let mut met: Vec<MetSplat> = Vec::new();
    for splat in (0..splats.len()).filter(|splat| is_met(*splat) && splats.is_sound(*splat)) {
        let mean = DVec3::from_array(splats.means[splat].map(f64::from));
        let scales = splats.scales(splat);
        let longest = scales.into_iter().fold(0.0, f64::max);
        let axes = DMat3::from_cols_array_2d(&quat::to_matrix(splats.quats[splat].map(f64::from)));
        // Given row by row, so the columns are those of the transpose.
        let whitened = |v: DVec3| {
            let turned = axes * v;
            DVec3::from_array([0, 1, 2].map(|k| turned[k] / scales[k].max(MIN_RELATIVE_SCALE * longest)))
        };
        let (a, b) = (whitened(origin - mean), whitened(direction));
        let distance = -a.dot(b) / b.length_squared();
        let alpha = splats.opacity(splat) * (-0.5 * a.cross(b).length_squared() / b.length_squared()).exp();
        let cut = 1.0 / 255.0;
        if distance <= 0.0 || alpha < cut * 0.998 {
            continue;
        }
        let is_sure = alpha > cut * 1.002;
        let alpha = if alpha < cut { 0.0 } else { alpha.min(f64::from(MAX_ALPHA)) };
        met.push(MetSplat { splat, order: (mean - center).length(), distance, alpha, is_sure });
    }
    met.sort_by(|a, b| a.order.total_cmp(&b.order).then(a.splat.cmp(&b.splat)));
    let mut found = ReferenceHit { margin: f64::INFINITY, ..ReferenceHit::default() };
    let mut transmittance = 1.0;
    let mut sums = Vec::new();
    for MetSplat { splat, distance, alpha, is_sure, .. } in met {
        let after = transmittance * (1.0 - alpha);
        let end = f64::from(MIN_TRANSMITTANCE);
        if !is_sure {
            found.slack += transmittance / 255.0;
        }
        if (after / end - 1.0).abs() < 0.02 {
            found.slack += transmittance;
        }
        if after <= end {
            break;
        }
        let weight = transmittance * alpha;
        let way = (DVec3::from_array(splats.means[splat].map(f64::from)) - center).normalize_or_zero();
        let color = sh::color(splats.sh_of(splat), way.to_array());
        let normal = DVec3::from_array(splats.normal(splat));
        let normal = if normal.dot(way) > 0.0 { -normal } else { normal };
        for k in 0..3 {
            found.color[k] += weight * color[k];
            found.normal[k] += weight * normal[k];
        }
        found.coverage += weight;
        found.weights.push((splat, weight));
        transmittance = after;
        sums.push((found.coverage, distance, splat));
    }
    let half = if found.coverage < f64::from(STOPPED_COVERAGE) { 0.5 * found.coverage } else { 0.5 };
    found.margin = sums.iter().map(|(sum, ..)| (sum - half).abs()).fold(f64::INFINITY, f64::min);
    // A coverage next to a limit may be on either side of it.
    for limit in [MIN_HIT_COVERAGE, STOPPED_COVERAGE] {
        if (found.coverage - f64::from(limit)).abs() < 1e-3 + found.slack {
            found.margin = 0.0;
        }
    }
    if found.coverage >= f64::from(MIN_HIT_COVERAGE) {
        found.hit =
            sums.into_iter().find(|(sum, ..)| *sum >= half).map(|(_, distance, splat)| (distance, splat));
    }
    found
}
