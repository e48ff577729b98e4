//! One splat of the reference of gradients: projection and shading, and their derivative.

use super::{Parameters, basis_slopes};
use crate::differentiable::{ForwardConfig, Opacity};
use crate::even_air::EvenAir;
use crate::stages::project::{DILATION, MAX_DET, MIN_COMPENSATION};
use glam::{DMat3, DVec3};
use std::f64::consts::{LN_2, LOG2_E};
use wm_scene::{Camera, Rasterization, quat, sh, splats::sigmoid};

/// The discrete decisions about a splat.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SplatDecisions {
    /// The values at which the Jacobian's X / z and Y / z are held, where they are.
    tangents: [Option<f64>; 2],
    /// True if the compensation of the antialiased mode is at its floor.
    floored: bool,
    /// The shortest axis, and its sign towards the camera.
    axis: usize,
    sign: f64,
    /// The colours that are above 0.
    lit: [bool; 3],
    /// The share of light that the air lets through: a constant to gradients.
    transmittance: f64,
}

/// Sums over pixels, what the blending pulls on one splat. See
/// [`rasterize_backward`](crate::stages::rasterize_backward).
#[derive(Clone, Debug, Default)]
pub(crate) struct SplatDerivatives {
    /// Sums of s, s u, s v, s u^2, s u v, s v^2.
    pub(crate) moments: [f64; 6],
    /// Sums of |s dq/dx| ln 2 and |s dq/dy| ln 2.
    pub(crate) absolute: [f64; 2],
    /// Sum of w.
    pub(crate) weight: f64,
    /// Sum of w times the derivative by the pixel's colour sum.
    pub(crate) rgb: [f64; 3],
    /// Likewise.
    pub(crate) depth: f64,
    /// Likewise.
    pub(crate) normal: [f64; 3],
}

/// One projected splat, with all that its derivative needs.
pub(crate) struct Splat {
    pub(crate) decisions: SplatDecisions,
    /// Colour seen through the air.
    pub(crate) rgb: [f64; 3],
    /// Their derivatives by the colours without the air.
    slopes: [f64; 3],
    offset: DVec3,
    view: DVec3,
    tangents: [f64; 2],
    axes: [DVec3; 3],
    scales: [f64; 3],
    /// J W R diag(s), and without the scales.
    m: [[f64; 2]; 3],
    unscaled: [[f64; 2]; 3],
    sharp: f64,
    det: f64,
    cov: [f64; 3],
    mean2d: [f64; 2],
    u_x: f64,
    v_x: f64,
    v_y: f64,
    log2_opacity: f64,
}

/// The z component of a cross product.
fn cross(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

fn dot(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

impl Splat {
    /// Projects and shades splat `i`; `None` where it is not drawn. Kept decisions are not taken
    /// anew.
    pub(crate) fn new(
        parameters: &Parameters,
        i: usize,
        camera: &Camera,
        config: &ForwardConfig,
        kept: Option<&SplatDecisions>,
    ) -> Option<Self> {
        let mean = DVec3::from_slice(&parameters.means[3 * i..]);
        let rotation = camera.rotation();
        let offset = mean - camera.center();
        let view = rotation * offset;
        if kept.is_none() && view.z <= camera.near {
            return None;
        }
        let size = [f64::from(camera.width), f64::from(camera.height)];
        let (focal, principal) = ([camera.fx, camera.fy], [camera.cx, camera.cy]);
        let held = [0, 1].map(|k| {
            if let Some(kept) = kept {
                return kept.tangents[k];
            }
            let margin = 0.3 * 0.5 * size[k] / focal[k];
            let tangent = view[k] / view.z;
            let inside = tangent
                .clamp(-principal[k] / focal[k] - margin, (size[k] - principal[k]) / focal[k] + margin);
            (inside != tangent).then_some(inside)
        });
        let tangents = [0, 1].map(|k| held[k].unwrap_or(view[k] / view.z));
        let rows = [0, 1].map(|k| focal[k] / view.z * (rotation.row(k) - tangents[k] * rotation.row(2)));
        let q: [f64; 4] = std::array::from_fn(|k| parameters.quats[4 * i + k]);
        let matrix = DMat3::from_cols_array_2d(&quat::to_matrix(q)).transpose();
        let axes = [0, 1, 2].map(|k| matrix.col(k));
        let scales = [0, 1, 2].map(|k| parameters.log_scales[3 * i + k].exp());
        let unscaled = axes.map(|axis| [axis.dot(rows[0]), axis.dot(rows[1])]);
        let m = [0, 1, 2].map(|k| unscaled[k].map(|v| v * scales[k]));
        let sum = |f: &dyn Fn(usize) -> f64| f(0) + f(1) + f(2);
        let dilation = f64::from(DILATION);
        let cov = [
            sum(&|k| m[k][0] * m[k][0]) + dilation,
            sum(&|k| m[k][0] * m[k][1]),
            sum(&|k| m[k][1] * m[k][1]) + dilation,
        ];
        let sharp = sum(&|k| cross(m[k], m[(k + 1) % 3]).powi(2));
        let det = sharp + dilation * (cov[0] + cov[2] - dilation);
        let mut opacity = match config.opacity {
            Opacity::Stored => sigmoid(parameters.logit_opacities[i]),
            Opacity::Fixed(value) => f64::from(value),
        };
        let floor = f64::from(MIN_COMPENSATION).powi(2);
        let floored = kept.map_or(sharp / det <= floor, |kept| kept.floored);
        if config.rasterization == Rasterization::Antialiased {
            opacity *= if floored { floor.sqrt() } else { (sharp / det).sqrt() };
        }
        if kept.is_none() && (det >= f64::from(MAX_DET) || opacity < 1.0 / 255.0) {
            return None;
        }
        let shortest = || (1..3).fold(0, |best, k| if scales[k] < scales[best] { k } else { best });
        let axis = kept.map_or_else(shortest, |kept| kept.axis);
        let sign = kept.map_or_else(|| if axes[axis].dot(offset) > 0.0 { -1.0 } else { 1.0 }, |k| k.sign);
        let basis = sh::basis(offset.normalize().to_array());
        let stride = 3 * sh::coefficients(parameters.sh_degree);
        let mut rgb = [0.5; 3];
        for (k, weight) in basis.iter().enumerate().take(sh::coefficients(config.sh_degree)) {
            for c in 0..3 {
                rgb[c] += weight * parameters.sh[stride * i + 3 * k + c];
            }
        }
        let lit = kept.map_or(rgb.map(|v| v > 0.0), |kept| kept.lit);
        let through = |air: &EvenAir| air.transmittance(offset.length());
        let transmittance =
            kept.map_or_else(|| config.air.as_ref().map_or(1.0, through), |kept| kept.transmittance);
        let own = [0, 1, 2].map(|c| if lit[c] { rgb[c] } else { 0.0 });
        let line = config.air.as_ref().map_or([(1.0, 0.0); 3], |air| air.line(transmittance));
        let rgb = std::array::from_fn(|c| own[c] * line[c].0 + line[c].1);
        let slopes = line.map(|(factor, _)| factor);
        let k = (0.5 * LOG2_E).sqrt();
        let v_y = k * (cov[0] / det).sqrt();
        Some(Self {
            decisions: SplatDecisions { tangents: held, floored, axis, sign, lit, transmittance },
            rgb,
            slopes,
            offset,
            view,
            tangents,
            axes,
            scales,
            m,
            unscaled,
            sharp,
            det,
            cov,
            mean2d: [0, 1].map(|k| focal[k] * view[k] / view.z + principal[k]),
            u_x: k / cov[0].sqrt(),
            v_x: -v_y * cov[1] / cov[0],
            v_y,
            log2_opacity: opacity.log2(),
        })
    }

    /// View z.
    pub(crate) fn depth(&self) -> f64 {
        self.view.z
    }

    /// The shortest axis towards the camera, world axes.
    pub(crate) fn normal(&self) -> DVec3 {
        self.axes[self.decisions.axis] * self.decisions.sign
    }

    /// log2 of alpha before the clamp, u and v at a picture point.
    pub(crate) fn log2_alpha(&self, x: f64, y: f64) -> (f64, f64, f64) {
        let (dx, dy) = (x - self.mean2d[0], y - self.mean2d[1]);
        let (u, v) = (self.u_x * dx, self.v_x * dx + self.v_y * dy);
        (self.log2_opacity - u * u - v * v, u, v)
    }

    /// The derivative of log2 alpha by the centre.
    pub(crate) fn slope(&self, u: f64, v: f64) -> [f64; 2] {
        [2.0 * (self.u_x * u + self.v_x * v), 2.0 * self.v_y * v]
    }

    /// By the centre, px.
    pub(crate) fn mean2d_gradient(&self, pulls: &SplatDerivatives) -> [f64; 2] {
        self.slope(pulls.moments[1], pulls.moments[2]).map(|v| LN_2 * v)
    }

    /// Three standard deviations along the longest axis, px.
    pub(crate) fn radius(&self) -> f64 {
        let [xx, xy, yy] = self.cov;
        let largest = 0.5 * (xx + yy) + (0.25 * (xx - yy).powi(2) + xy * xy).sqrt();
        3.0 * largest.sqrt()
    }

    /// Writes the gradients by the stored parameters of splat `i`. The formulas are those of
    /// [`project_backward`](crate::stages::project_backward).
    pub(crate) fn gradients(
        &self,
        parameters: &Parameters,
        i: usize,
        camera: &Camera,
        config: &ForwardConfig,
        pulls: &SplatDerivatives,
        out: &mut Parameters,
    ) {
        let [s0, _, _, s_uu, s_uv, s_vv] = pulls.moments;
        if config.opacity == Opacity::Stored {
            out.logit_opacities[i] = s0 * (1.0 - sigmoid(parameters.logit_opacities[i]));
        }

        // The Gaussian's shape: W = P M with P = [[ux, 0], [vx, vy]], and C W with C from the
        // moments.
        let dilation = f64::from(DILATION);
        let whitened = |column: [f64; 2]| {
            let across = (0..3).map(|j| self.m[j][0] * cross(self.m[j], column)).sum::<f64>();
            [self.u_x * column[0], self.v_y * (across + dilation * column[1]) / self.cov[0]]
        };
        let scale = 4.0 * LN_2 * LN_2;
        let pulled = |w: [f64; 2]| [scale * (s_uu * w[0] + s_uv * w[1]), scale * (s_uv * w[0] + s_vv * w[1])];
        // What the antialiased mode adds: s0 / 2 by the logarithm of sharp / det.
        let (mut by_sharp, mut by_trace) = (0.0, 0.0);
        if config.rasterization == Rasterization::Antialiased && !self.decisions.floored {
            by_sharp = 0.5 * s0 * (1.0 / self.sharp - 1.0 / self.det);
            by_trace = -0.5 * s0 * dilation / self.det;
        }
        // M_i . dL/dM_j, symmetric; without the scales.
        let pair = |i: usize, j: usize| {
            let (a, b) = (self.unscaled[i], self.unscaled[j]);
            let across = (0..3).map(|k| cross(a, self.m[k]) * cross(b, self.m[k])).sum::<f64>();
            dot(whitened(a), pulled(whitened(b))) + 2.0 * by_sharp * across + 2.0 * by_trace * dot(a, b)
        };
        let squares = self.scales.map(|s| s * s);
        let by_scale = [0, 1, 2].map(|k| squares[k] * pair(k, k));
        out.log_scales[3 * i..3 * i + 3].copy_from_slice(&by_scale);

        // A turn about the splat's own axes, then along the quaternion's sphere.
        let mut turn = DVec3::new(
            pair(1, 2) * (squares[1] - squares[2]),
            pair(2, 0) * (squares[2] - squares[0]),
            pair(0, 1) * (squares[0] - squares[1]),
        );
        let normal = DVec3::from_array(pulls.normal) * self.decisions.sign;
        let local = DVec3::from_array(self.axes.map(|axis| axis.dot(normal)));
        turn += DVec3::AXES[self.decisions.axis].cross(local);
        let q: [f64; 4] = std::array::from_fn(|k| parameters.quats[4 * i + k]);
        let length = q.iter().map(|v| v * v).sum::<f64>().sqrt();
        let [w, x, y, z] = q.map(|v| v / length);
        let tangents = [[-x, w, z, -y], [-y, -z, w, x], [-z, y, -x, w]];
        for k in 0..4 {
            out.quats[4 * i + k] =
                (0..3).map(|axis| 2.0 * turn[axis] * tangents[axis][k]).sum::<f64>() / length;
        }

        // The mean: through the Jacobian, the centre, the depth and the colour.
        let rotation = camera.rotation();
        let by_m = [0, 1, 2].map(|j| {
            let [y_u, y_v] = pulled(whitened(self.m[j]));
            let mut by = [self.u_x * y_u + self.v_x * y_v, self.v_y * y_v];
            for k in 0..3 {
                let minor = cross(self.m[j], self.m[k]);
                by[0] += 2.0 * by_sharp * minor * self.m[k][1];
                by[1] -= 2.0 * by_sharp * minor * self.m[k][0];
            }
            [by[0] + 2.0 * by_trace * self.m[j][0], by[1] + 2.0 * by_trace * self.m[j][1]]
        });
        let focal = [camera.fx, camera.fy];
        let by_center = self.mean2d_gradient(pulls);
        let mut by_view = DVec3::new(0.0, 0.0, pulls.depth - by_scale.iter().sum::<f64>() / self.view.z);
        for k in 0..2 {
            let along = focal[k] / self.view.z;
            by_view[k] += by_center[k] * along;
            by_view.z -= by_center[k] * along * self.view[k] / self.view.z;
            if self.decisions.tangents[k].is_none() {
                let by_tangent: f64 = (0..3)
                    .map(|j| -along * by_m[j][k] * self.scales[j] * rotation.row(2).dot(self.axes[j]))
                    .sum();
                by_view[k] += by_tangent / self.view.z;
                by_view.z -= by_tangent * self.tangents[k] / self.view.z;
            }
        }
        let distance = self.offset.length();
        let direction = self.offset / distance;
        let slopes = basis_slopes(direction.to_array());
        let basis = sh::basis(direction.to_array());
        let stride = 3 * sh::coefficients(parameters.sh_degree);
        let mut by_direction = DVec3::ZERO;
        for k in 0..sh::coefficients(config.sh_degree) {
            for c in (0..3).filter(|c| self.decisions.lit[*c]) {
                let at = stride * i + 3 * k + c;
                let pull = self.slopes[c] * pulls.rgb[c];
                out.sh[at] = basis[k] * pull;
                by_direction += DVec3::from_array(slopes[k]) * parameters.sh[at] * pull;
            }
        }
        let by_offset = (by_direction - by_direction.dot(direction) * direction) / distance;
        let by_mean = rotation.transpose() * by_view + by_offset;
        out.means[3 * i..3 * i + 3].copy_from_slice(&by_mean.to_array());
    }
}
