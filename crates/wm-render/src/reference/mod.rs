//! The reference: the whole render in f64, by brute force, without tiles and vectors.
//!
//! It follows the contracts of the stages and nothing else. Tests compare all back ends with it;
//! the projection of one splat also serves measurements that have to be exact.

#[cfg(test)]
pub(crate) mod backward;
#[cfg(test)]
pub(crate) mod frame;
#[cfg(test)]
pub(crate) mod particles;
#[cfg(test)]
pub(crate) mod rays;

use crate::stages::project::{
    DILATION, FLATTENING, MAX_DET, MAX_LYING_SHARE, MIN_COMPENSATION, MIN_STANDING_SHARE, SLOPE_DILATION,
};
use glam::{DMat3, DVec3};
use wm_scene::{Camera, Rasterization, Splats, quat, splats::shortest_axis};

/// One splat in the picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Projected {
    /// Centre, px.
    pub mean2d: [f64; 2],
    /// xx, xy, yy, px^2, dilated.
    pub cov2d: [f64; 3],
    /// Opacity at the centre.
    pub opacity: f64,
    /// View z, scene units.
    pub depth: f64,
    /// World axes, towards the camera, length 1.
    pub(crate) normal: [f64; 3],
    /// Unit direction from the camera centre.
    pub(crate) direction: [f64; 3],
    /// Distance from the camera centre.
    pub(crate) distance: f64,
    /// Slopes of the reciprocal view z at which it is densest, along x and y, 1/(scene units px);
    /// flattened if a surface splits the blend.
    pub(crate) slopes: [f64; 2],
}

/// Projects splat `index`; `None` if it is not drawn.
#[must_use]
pub fn project(
    splats: &Splats,
    index: usize,
    camera: &Camera,
    mode: Rasterization,
    visibility: f64,
) -> Option<Projected> {
    projected(splats, index, camera, mode, visibility, [0.0; 3])
}

/// Projects a splat like [`project`], with slopes of the splat flattened along `surface_normal`.
fn projected(
    splats: &Splats,
    index: usize,
    camera: &Camera,
    mode: Rasterization,
    visibility: f64,
    surface_normal: [f64; 3],
) -> Option<Projected> {
    let mean = DVec3::from_array(splats.means[index].map(f64::from));
    let rotation = camera.rotation();
    let offset = mean - camera.center();
    let view = rotation * offset;
    if view.z <= camera.near {
        return None;
    }
    let clamp = |tangent: f64, principal: f64, size: f64, focal: f64| {
        let margin = 0.3 * 0.5 * size / focal;
        tangent.clamp(-principal / focal - margin, (size - principal) / focal + margin)
    };
    let tan_x = clamp(view.x / view.z, camera.cx, f64::from(camera.width), camera.fx);
    let tan_y = clamp(view.y / view.z, camera.cy, f64::from(camera.height), camera.fy);
    let row_x = camera.fx / view.z * (rotation.row(0) - tan_x * rotation.row(2));
    let row_y = camera.fy / view.z * (rotation.row(1) - tan_y * rotation.row(2));
    let axes = quat::to_matrix(splats.quats[index].map(f64::from));
    let axes = DMat3::from_cols_array_2d(&axes).transpose();
    let scales = splats.scales(index);
    let m_x: Vec<f64> = (0..3).map(|k| axes.col(k).dot(row_x) * scales[k]).collect();
    let m_y: Vec<f64> = (0..3).map(|k| axes.col(k).dot(row_y) * scales[k]).collect();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let (xx, xy, yy) = (dot(&m_x, &m_x), dot(&m_x, &m_y), dot(&m_y, &m_y));
    let sharp: f64 =
        [(0, 1), (0, 2), (1, 2)].iter().map(|(i, j)| (m_x[*i] * m_y[*j] - m_x[*j] * m_y[*i]).powi(2)).sum();
    let dilation = f64::from(DILATION);
    let det = sharp + dilation * (xx + yy) + dilation * dilation;
    if det >= f64::from(MAX_DET) {
        return None;
    }
    let mut opacity = splats.opacity(index) * visibility;
    if mode == Rasterization::Antialiased {
        opacity *= (sharp / det).max(f64::from(MIN_COMPENSATION).powi(2)).sqrt();
    }
    if opacity < 1.0 / 255.0 {
        return None;
    }
    let axis = shortest_axis(scales.map(|s| s as f32));
    let normal = axes.col(axis) * if axes.col(axis).dot(offset) > 0.0 { -1.0 } else { 1.0 };
    Some(Projected {
        mean2d: [camera.fx * view.x / view.z + camera.cx, camera.fy * view.y / view.z + camera.cy],
        cov2d: [xx + dilation, xy, yy + dilation],
        opacity,
        depth: view.z,
        normal: normal.to_array(),
        direction: offset.normalize().to_array(),
        distance: offset.length(),
        slopes: {
            let m_z: Vec<f64> = (0..3).map(|k| axes.col(k).dot(rotation.row(2)) * scales[k]).collect();
            let up = DVec3::from_array(surface_normal);
            let m_h: Vec<f64> = (0..3).map(|k| axes.col(k).dot(up) * scales[k]).collect();
            let high = dot(&m_h, &m_h).max(1e-30);
            let share = high / dot(&scales, &scales).max(1e-30);
            let lies = ((f64::from(MIN_STANDING_SHARE) - share)
                / f64::from(MIN_STANDING_SHARE - MAX_LYING_SHARE))
            .clamp(0.0, 1.0);
            let flat = |m: &[f64]| -> Vec<f64> {
                let less = lies * f64::from(FLATTENING) * dot(m, &m_h) / high;
                m.iter().zip(&m_h).map(|(own, height)| own - less * height).collect()
            };
            let (m_x, m_y, m_z) = (flat(&m_x), flat(&m_y), flat(&m_z));
            let (zx, zy) = (dot(&m_z, &m_x), dot(&m_z, &m_y));
            let dilation = f64::from(SLOPE_DILATION);
            let (xx, xy, yy) = (dot(&m_x, &m_x), dot(&m_x, &m_y), dot(&m_y, &m_y));
            let minor = |i: usize, j: usize| (m_x[i] * m_y[j] - m_x[j] * m_y[i]).powi(2);
            let sharp = minor(0, 1) + minor(0, 2) + minor(1, 2);
            let det = sharp + dilation * (xx + yy) + dilation * dilation;
            let (xx, yy) = (xx + dilation, yy + dilation);
            let scale = -1.0 / (view.z * view.z * det);
            [(zx * yy - zy * xy) * scale, (zy * xx - zx * xy) * scale]
        },
    })
}
