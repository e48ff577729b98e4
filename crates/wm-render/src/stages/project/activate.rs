//! Stored parameters to the form that projection takes, sixteen splats at a time: for training,
//! where they change with every step. Rendering activates a model once, in f64 (`cpu::model`).
//!
//! Tolerance: exponentials err by 5e-7 relative, so do scales and opacities.

use crate::cpu::model::{NEVER_DRAWN_LOG2_OPACITY, SplatGroup};
use crate::differentiable::Opacity;
use crate::hooks::GROUP;
use crate::simd::{Lanes, exp2, log2};
use fearless_simd::{Select, SimdBase, SimdFloat};
use std::f32::consts::LOG2_E;
use wm_scene::Splats;

/// Sixteen splats, activated, with what their derivative needs.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub(crate) struct Activated {
    /// `dc` is not filled.
    pub(crate) group: SplatGroup,
    /// 1 / length of the stored quaternions; 0 where there is none.
    pub(crate) inverse_length: [f32; GROUP],
    /// 1 - stored opacity.
    pub(crate) transparency: [f32; GROUP],
}

impl Default for Activated {
    fn default() -> Self {
        let zero = [0.0; GROUP];
        let group = SplatGroup {
            mean: [zero; 3],
            quat: [zero; 4],
            scale: [zero; 3],
            log2_opacity: [NEVER_DRAWN_LOG2_OPACITY; GROUP],
            dc: [zero; 3],
        };
        Self { group, inverse_length: zero, transparency: zero }
    }
}

/// Activates the splats `indices`; those from `count` on are never drawn.
#[inline(always)]
pub(crate) fn activate<S: Lanes>(
    simd: S,
    splats: &Splats,
    indices: &[u32; GROUP],
    count: usize,
    opacity: Opacity,
    out: &mut Activated,
) {
    let group = &mut out.group;
    for (lane, index) in indices.iter().enumerate() {
        let index = *index as usize;
        let (mean, quat, scale) = (splats.means[index], splats.quats[index], splats.log_scales[index]);
        for k in 0..3 {
            group.mean[k][lane] = mean[k];
            group.scale[k][lane] = scale[k];
        }
        for k in 0..4 {
            group.quat[k][lane] = quat[k];
        }
        group.log2_opacity[lane] = splats.logit_opacities[index];
    }
    let (zero, one) = (simd.set(0.0), simd.set(1.0));
    for first in (0..GROUP).step_by(S::N) {
        let lanes = first..first + S::N;
        let mut quat = [zero; 4];
        for k in 0..4 {
            quat[k] = simd.load(&group.quat[k][first..]);
        }
        let [w, x, y, z] = quat;
        let squared = w.mul_add(w, x.mul_add(x, y.mul_add(y, z * z)));
        // None is the identity, as everywhere.
        let sound = squared.simd_gt(simd.set(1e-30));
        let inverse = sound.select(one / squared.sqrt(), zero);
        for k in 0..4 {
            let unit = sound.select(quat[k] * inverse, if k == 0 { one } else { zero });
            unit.store_slice(&mut group.quat[k][lanes.clone()]);
        }
        inverse.store_slice(&mut out.inverse_length[lanes.clone()]);

        let logit = simd.load(&group.log2_opacity[first..]);
        let mut powers = [zero; 4];
        for k in 0..3 {
            powers[k] = simd.load(&group.scale[k][first..]) * LOG2_E;
        }
        powers[3] = logit * -LOG2_E;
        for k in 0..4 {
            powers[k] = powers[k].max(simd.set(-126.0)).min(simd.set(126.0));
        }
        let exponentials = exp2(simd, powers);
        for k in 0..3 {
            exponentials[k].store_slice(&mut group.scale[k][lanes.clone()]);
        }
        // 1 - o = t / (1 + t) with t = exp(-logit): nothing cancels at either end.
        let odds = exponentials[3];
        (odds / (one + odds)).store_slice(&mut out.transparency[lanes.clone()]);
        let log2_opacity = match opacity {
            Opacity::Stored => -log2(simd, [one + odds])[0],
            Opacity::Fixed(value) => log2(simd, [simd.set(value.max(1e-30))])[0],
        };
        log2_opacity.store_slice(&mut group.log2_opacity[lanes]);
    }
    group.log2_opacity[count.min(GROUP)..].fill(NEVER_DRAWN_LOG2_OPACITY);
}
