//! The derivative of projection, sixteen splats at a time.

use crate::differentiable::{Channels, ForwardConfig};
use crate::hooks::{GROUP, ShadeGroup};
use crate::simd::Lanes;
use crate::stages::project::activate::Activated;
use crate::stages::project::cpu::{GroupGeometry, facing, factor, geometry, ray, shortest};
use crate::stages::project::{DILATION, MIN_COMPENSATION, ProjectCamera};
use crate::stages::rasterize_backward::GradientSlot;
use fearless_simd::{Select, SimdBase, SimdFloat};
use std::f32::consts::LN_2;
use wm_scene::Rasterization;

/// The gradients of sixteen splats, one array a number.
#[derive(Clone, Debug, Default)]
#[repr(C, align(64))]
pub(crate) struct SplatGradients {
    /// By the mean.
    pub(crate) mean: [[f32; GROUP]; 3],
    /// By the stored quaternion.
    pub(crate) quat: [[f32; GROUP]; 4],
    /// By the logarithms of the scales.
    pub(crate) log_scale: [[f32; GROUP]; 3],
    /// By the logit of the opacity.
    pub(crate) logit_opacity: [f32; GROUP],
    /// By the centre in the picture, px.
    pub(crate) mean2d: [[f32; GROUP]; 2],
    /// Sums of the absolute values of the pixels' derivatives by the centre.
    pub(crate) absgrad: [[f32; GROUP]; 2],
    /// Three standard deviations along the longest axis, px.
    pub(crate) radius: [f32; GROUP],
}

/// The rays from the camera to sixteen splats, without their colours.
#[inline(always)]
pub(crate) fn rays<S: Lanes>(simd: S, activated: &Activated, camera: &ProjectCamera, out: &mut ShadeGroup) {
    for first in (0..GROUP).step_by(S::N) {
        let mut offset = [simd.set(0.0); 3];
        for k in 0..3 {
            offset[k] = simd.load(&activated.group.mean[k][first..]) - camera.center[k];
        }
        let (direction, distance) = ray(simd, &offset);
        distance.store_slice(&mut out.distance[first..first + S::N]);
        for k in 0..3 {
            direction[k].store_slice(&mut out.direction[k][first..first + S::N]);
        }
    }
}

/// `sums` are the numbers of a [`GradientSlot`], one array each; `by_direction` comes from shading.
#[inline(always)]
pub(crate) fn project_backward_group<S: Lanes>(
    simd: S,
    activated: &Activated,
    camera: &ProjectCamera,
    config: &ForwardConfig,
    sums: &[[f32; GROUP]; GradientSlot::LEN],
    by_direction: &[[f32; GROUP]; 3],
    out: &mut SplatGradients,
) {
    let zero = simd.set(0.0);
    for first in (0..GROUP).step_by(S::N) {
        let lanes = first..first + S::N;
        let mut sum = [zero; GradientSlot::LEN];
        for k in 0..GradientSlot::LEN {
            sum[k] = simd.load(&sums[k][first..]);
        }
        let geometry = geometry(simd, &activated.group, first, camera);
        let [ux, vx, vy] = factor(simd, &geometry);
        let shape = Shape::new(simd, &geometry, ux, vx, vy, &sum, config.rasterization);

        // Through the picture.
        let by_x = ux.mul_add(sum[GradientSlot::SU], vx * sum[GradientSlot::SV]) * (2.0 * LN_2);
        let by_y = vy * sum[GradientSlot::SV] * (2.0 * LN_2);
        by_x.store_slice(&mut out.mean2d[0][lanes.clone()]);
        by_y.store_slice(&mut out.mean2d[1][lanes.clone()]);
        (sum[GradientSlot::ABS_X] * (2.0 * LN_2)).store_slice(&mut out.absgrad[0][lanes.clone()]);
        (vy * sum[GradientSlot::ABS_Y] * (2.0 * LN_2)).store_slice(&mut out.absgrad[1][lanes.clone()]);
        let transparency = simd.load(&activated.transparency[first..]);
        (sum[GradientSlot::S] * transparency).store_slice(&mut out.logit_opacity[lanes.clone()]);
        let [xx, xy, yy] = geometry.cov;
        let half = (xx - yy) * 0.5;
        let largest = (xx + yy).mul_add(simd.set(0.5), half.mul_add(half, xy * xy).sqrt());
        (largest.sqrt() * 3.0).store_slice(&mut out.radius[lanes.clone()]);

        // Scales and turn.
        let scales = geometry.scales;
        let mut by_scale = [zero; 3];
        let mut turn = [zero; 3];
        for j in 0..3 {
            by_scale[j] = scales[j] * scales[j] * shape.pair(simd, &geometry, j, j);
            by_scale[j].store_slice(&mut out.log_scale[j][lanes.clone()]);
            let (k, l) = ((j + 1) % 3, (j + 2) % 3);
            let squares = (scales[k] - scales[l]) * (scales[k] + scales[l]);
            turn[j] = squares * shape.pair(simd, &geometry, k, l);
        }
        if config.channels.has_normal() {
            let by_normal = [
                sum[GradientSlot::FEATURES + 4],
                sum[GradientSlot::FEATURES + 5],
                sum[GradientSlot::FEATURES + 6],
            ];
            add_normal(simd, &geometry, &by_normal, &mut turn);
        }
        store_quat(simd, activated, first, &turn, out);

        // The mean, in the camera's axes.
        let GroupGeometry { inverse_z, tangents, held, .. } = geometry;
        let mut by_view = [zero; 3];
        by_view[2] = -((by_scale[0] + by_scale[1] + by_scale[2]) * inverse_z);
        if let Some(k) = config.channels.depth() {
            by_view[2] += sum[GradientSlot::FEATURES + k];
        }
        let by_m = shape.by_m(simd, &geometry);
        for (k, by_center) in [by_x, by_y].into_iter().enumerate() {
            let along = inverse_z * camera.focal[k];
            by_view[k] = by_center * along;
            by_view[2] = (-by_view[k]).mul_add(tangents[k], by_view[2]);
            let mut by_tangent = zero;
            for j in 0..3 {
                let axis = &geometry.columns[j];
                let forward = &camera.rotation[2];
                let ahead = axis[0].mul_add(
                    simd.set(forward[0]),
                    axis[1].mul_add(simd.set(forward[1]), axis[2] * forward[2]),
                );
                by_tangent = by_m[k][j].mul_add(scales[j] * ahead, by_tangent);
            }
            let free = held[k].simd_eq(tangents[k]);
            let by_tangent = free.select(-(by_tangent * along * inverse_z), zero);
            by_view[k] += by_tangent;
            by_view[2] = (-by_tangent).mul_add(tangents[k], by_view[2]);
        }
        let (direction, distance) = ray(simd, &geometry.offset);
        let mut by = [zero; 3];
        for k in 0..3 {
            by[k] = simd.load(&by_direction[k][first..]);
        }
        let radial = direction[0].mul_add(by[0], direction[1].mul_add(by[1], direction[2] * by[2]));
        let inverse = simd.set(1.0) / distance;
        for k in 0..3 {
            let mut by_mean = (-radial).mul_add(direction[k], by[k]) * inverse;
            for axis in 0..3 {
                by_mean = by_view[axis].mul_add(simd.set(camera.rotation[axis][k]), by_mean);
            }
            by_mean.store_slice(&mut out.mean[k][lanes.clone()]);
        }
    }
}

/// The derivative of the loss by the shape of the 2D Gaussian.
struct Shape<S: Lanes> {
    /// ux, vx, vy.
    factor: [S::F; 3],
    /// `P` times the columns of M without their scales.
    whitened: [[S::F; 3]; 2],
    /// suu, suv, svv times 4 ln^2 2.
    moments: [S::F; 3],
    /// Twice the derivatives of the loss by sharp and by the trace of M M^T, where antialiased.
    extra: Option<[S::F; 2]>,
    /// Minors of M without scales (first index) and M (second).
    minors: [[S::F; 3]; 3],
}

impl<S: Lanes> Shape<S> {
    #[inline(always)]
    fn new(
        simd: S,
        geometry: &GroupGeometry<S>,
        ux: S::F,
        vx: S::F,
        vy: S::F,
        sum: &[S::F; GradientSlot::LEN],
        rasterization: Rasterization,
    ) -> Self {
        let zero = simd.set(0.0);
        let GroupGeometry { unscaled: [a_x, a_y], m: [m_x, m_y], cov: [cov_xx, ..], sharp, det, .. } =
            *geometry;
        let over = vy / cov_xx;
        let mut minors = [[zero; 3]; 3];
        let mut whitened = [[zero; 3]; 2];
        for j in 0..3 {
            let mut across = a_y[j] * DILATION;
            for k in 0..3 {
                // An axis and itself: 0 but for rounding.
                if k != j {
                    minors[j][k] = a_x[j].mul_sub(m_y[k], a_y[j] * m_x[k]);
                    across = (-m_x[k]).mul_add(minors[j][k], across);
                }
            }
            whitened[0][j] = ux * a_x[j];
            whitened[1][j] = over * across;
        }
        let scale = 4.0 * LN_2 * LN_2;
        let moments =
            [sum[GradientSlot::SUU] * scale, sum[GradientSlot::SUV] * scale, sum[GradientSlot::SVV] * scale];
        let mut extra = None;
        if rasterization == Rasterization::Antialiased {
            let free = (sharp / det).simd_gt(simd.set(MIN_COMPENSATION * MIN_COMPENSATION));
            let s = free.select(sum[GradientSlot::S], zero);
            // 1 / sharp - 1 / det without their difference.
            let by_sharp = s * ((det - sharp) / (sharp * det));
            extra = Some([free.select(by_sharp, zero), -(s * DILATION / det)]);
        }
        Self { factor: [ux, vx, vy], whitened, moments, extra, minors }
    }

    /// `Q_ij / (s_i s_j)`.
    #[inline(always)]
    fn pair(&self, _: S, geometry: &GroupGeometry<S>, i: usize, j: usize) -> S::F {
        let [w_u, w_v] = &self.whitened;
        let [suu, suv, svv] = self.moments;
        let pulled_u = suu.mul_add(w_u[j], suv * w_v[j]);
        let pulled_v = suv.mul_add(w_u[j], svv * w_v[j]);
        let mut pair = w_u[i].mul_add(pulled_u, w_v[i] * pulled_v);
        if let Some([by_sharp, by_trace]) = self.extra {
            let (a, b) = (&self.minors[i], &self.minors[j]);
            let across = a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]));
            let [x, y] = &geometry.unscaled;
            pair = by_sharp.mul_add(across, pair);
            pair = by_trace.mul_add(x[i].mul_add(x[j], y[i] * y[j]), pair);
        }
        pair
    }

    /// dL/dM, row by row.
    #[inline(always)]
    fn by_m(&self, simd: S, geometry: &GroupGeometry<S>) -> [[S::F; 3]; 2] {
        let [w_u, w_v] = &self.whitened;
        let [suu, suv, svv] = self.moments;
        let [ux, vx, vy] = self.factor;
        let [m_x, m_y] = &geometry.m;
        let mut by = [[simd.set(0.0); 3]; 2];
        for j in 0..3 {
            let scale = geometry.scales[j];
            let pulled_u = suu.mul_add(w_u[j], suv * w_v[j]) * scale;
            let pulled_v = suv.mul_add(w_u[j], svv * w_v[j]) * scale;
            by[0][j] = ux.mul_add(pulled_u, vx * pulled_v);
            by[1][j] = vy * pulled_v;
            if let Some([by_sharp, by_trace]) = self.extra {
                let minors = &self.minors[j];
                let along_y = minors[0].mul_add(m_y[0], minors[1].mul_add(m_y[1], minors[2] * m_y[2]));
                let along_x = minors[0].mul_add(m_x[0], minors[1].mul_add(m_x[1], minors[2] * m_x[2]));
                by[0][j] += (by_sharp * along_y * scale) + by_trace * m_x[j];
                by[1][j] += by_trace.mul_add(m_y[j], -(by_sharp * along_x * scale));
            }
        }
        by
    }
}

/// Adds what the normal pulls to the turn about the splat's own axes.
#[inline(always)]
fn add_normal<S: Lanes>(simd: S, geometry: &GroupGeometry<S>, by_normal: &[S::F; 3], turn: &mut [S::F; 3]) {
    let (zero, one) = (simd.set(0.0), simd.set(1.0));
    let c = &geometry.columns;
    let mut normal = [zero; 3];
    let mut local = [zero; 3];
    for k in 0..3 {
        normal[k] = shortest::<S>(&geometry.scales, [c[0][k], c[1][k], c[2][k]]);
    }
    let sign = facing(simd, &normal, &geometry.offset);
    for j in 0..3 {
        let along = c[j][0].mul_add(by_normal[0], c[j][1].mul_add(by_normal[1], c[j][2] * by_normal[2]));
        local[j] = along * sign;
    }
    // e_m x local, m the shortest axis.
    let mut is = [zero; 3];
    is[0] = shortest::<S>(&geometry.scales, [one, zero, zero]);
    is[1] = shortest::<S>(&geometry.scales, [zero, one, zero]);
    is[2] = shortest::<S>(&geometry.scales, [zero, zero, one]);
    for j in 0..3 {
        let (k, l) = ((j + 1) % 3, (j + 2) % 3);
        turn[j] += is[k].mul_sub(local[l], is[l] * local[k]);
    }
}

/// Turns about the splat's own axes to the stored quaternion.
#[inline(always)]
fn store_quat<S: Lanes>(
    simd: S,
    activated: &Activated,
    first: usize,
    turn: &[S::F; 3],
    out: &mut SplatGradients,
) {
    let quat = &activated.group.quat;
    let (w, x) = (simd.load(&quat[0][first..]), simd.load(&quat[1][first..]));
    let (y, z) = (simd.load(&quat[2][first..]), simd.load(&quat[3][first..]));
    let twice = simd.load(&activated.inverse_length[first..]) * 2.0;
    let [a, b, c] = *turn;
    let by = [
        -(x.mul_add(a, y.mul_add(b, z * c))),
        w.mul_add(a, y.mul_sub(c, z * b)),
        z.mul_add(a, w.mul_sub(b, x * c)),
        x.mul_add(b, w.mul_sub(c, y * a)),
    ];
    for k in 0..4 {
        (by[k] * twice).store_slice(&mut out.quat[k][first..first + S::N]);
    }
}

const _: () = assert!(GradientSlot::FEATURES + Channels::ColorDepthNormal.count() == GradientSlot::LEN);
