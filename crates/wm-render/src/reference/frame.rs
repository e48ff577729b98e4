//! The reference picture. It tells for each pixel how far a correct f32 back end may be away: see
//! [`ReferenceFrame::slack`].

use super::{Projected, projected};
use crate::attributes::{Attribute, AttributeBlock, SplatAttributes};
use crate::frame::{srgb_decode, srgb_encode};
use crate::hooks::{AirOnRay, SkySplats};
use crate::plan::{DrawPass, Shading};
use crate::stages::rasterize::{MAX_ALPHA, MIN_TRANSMITTANCE};
use wm_scene::{Group, Splats, sh};

impl Projected {
    /// log2 of alpha at the picture point `(x, y)`.
    pub(crate) fn log2_alpha(&self, x: f64, y: f64) -> f64 {
        let (dx, dy) = (x - self.mean2d[0], y - self.mean2d[1]);
        let [xx, xy, yy] = self.cov2d;
        // By the Cholesky factor: the conic's form cancels for needles even in f64.
        let u = dx / xx.sqrt();
        let v = (dy - xy / xx * dx) / (yy - xy * xy / xx).sqrt();
        self.opacity.log2() - 0.5 * std::f64::consts::LOG2_E * (u * u + v * v)
    }
}

/// The reference picture.
#[derive(Clone, Debug, Default)]
pub(crate) struct ReferenceFrame {
    /// With background, before pixel effects, `[H, W]`.
    pub(crate) rgb: Vec<[f64; 3]>,
    /// `[H, W]`.
    pub(crate) alpha: Vec<f64>,
    /// Sum of weight times view z, `[H, W]`.
    pub(crate) depth_sum: Vec<f64>,
    /// Sum of weight times normal, `[H, W]`.
    pub(crate) normal_sum: Vec<[f64; 3]>,
    /// View z where the transmittance passes 0.5; 0 where it does not, `[H, W]`.
    pub(crate) median_depth: Vec<f64>,
    /// Distance from one half of the transmittances before and after the median splat, the lesser.
    pub(crate) median_margin: Vec<f64>,
    /// The sums of [`crate::Frame::front`], `[H, W]`; empty without a surface.
    pub(crate) front: Vec<[f64; 5]>,
    /// Weight of splats so close to the surface in view z that f32 may count them on either side,
    /// `[H, W]`.
    pub(crate) front_slack: Vec<f64>,
    /// Bound of the error that the rounding of slopes makes in the sum of reciprocal depths,
    /// 1/scene units, `[H, W]`.
    pub(crate) slope_slack: Vec<f64>,
    /// Weight that may be placed otherwise because a decision is too close for f32: a splat at the
    /// alpha cut, the stop, or two splats whose view z differ by less than f32 holds. `[H, W]`
    pub(crate) slack: Vec<f64>,
}

/// Tolerance of log2 alpha at the cut: within it, either side is right.
pub(crate) const CUT_BAND: f64 = 2e-3;
/// Relative distance of the transmittance from the stop within which either side is right.
pub(crate) const STOP_BAND: f64 = 0.02;
/// Changes the light on a display-referred colour.
fn relit(rgb: [f64; 3], gains: [f64; 3]) -> [f64; 3] {
    if gains == [1.0; 3] {
        return rgb;
    }
    let light = rgb.map(srgb_decode);
    let limit = light.into_iter().fold(1.0, f64::max);
    let changed: [f64; 3] = std::array::from_fn(|k| light[k] * gains[k]);
    let scale = limit / changed.into_iter().fold(limit, f64::max);
    changed.map(|v| srgb_encode(v * scale))
}

/// Relative error of the slopes of reciprocal depths: a little more than their rounding.
pub(crate) const SLOPE_BAND: f64 = 0.01;

/// Relative difference in view z within which either order is right: a few ulp of f32 sums.
pub(crate) const ORDER_BAND: f64 = 2e-6;

/// Draws sets as a pass does whose own sets do not count.
pub(crate) fn render(
    sets: &[(&Splats, Option<&dyn SplatAttributes>)],
    pass: &DrawPass<'_>,
) -> ReferenceFrame {
    let DrawPass { camera, config, hooks, shading, surface, cut, .. } = pass;
    let origin = camera.center().to_array();
    let backdrop = hooks.background.unwrap_or(&config.background);
    let pixel_angle = camera.widest_pixel();
    let is_drawn = |group: Group| group != Group::Sky || hooks.sky_splats() == SkySplats::Kept;
    let mut drawn = Vec::new();
    let shade = |direction: [f64; 3], distance: f64, rgb: [f64; 3]| match (*shading, hooks.medium) {
        (Shading::Color, None) => rgb,
        (Shading::Color, Some(medium)) => medium.reference(origin, direction, distance, rgb),
        (Shading::Transmittance, medium) => {
            let air = medium.map(|medium| medium.evaluate_reference(origin, direction, distance));
            air.unwrap_or(AirOnRay::CLEAR).transmittance
        }
    };
    for (splats, attributes) in sets {
        let mut block = AttributeBlock::default();
        for index in (0..splats.len()).filter(|index| is_drawn(splats.groups[*index])) {
            if let Some(attributes) = attributes {
                block.read(*attributes, &[index as u32]);
            }
            let visibility = f64::from(block.column(Attribute::Visibility)[0]);
            let normal = surface.map_or([0.0; 3], |surface| surface.normal);
            let mode = config.rasterization;
            let Some(p) = projected(splats, index, camera, mode, visibility, normal) else { continue };
            let height: f64 = cut.map_or(0.0, |plane| {
                let along = |k: usize| plane.normal[k] * f64::from(splats.means[index][k]);
                (0..3).map(along).sum::<f64>() - plane.height
            });
            if height < 0.0 {
                continue;
            }
            let rgb = sh::color(splats.sh_of(index), p.direction).map(|v| v.max(0.0));
            let even: [f64; 3] =
                std::array::from_fn(|k| (0.5 + sh::C0 * f64::from(splats.sh_of(index)[k])).max(0.0));
            let fade = f64::from(block.column(Attribute::Fade)[0]);
            let rgb = std::array::from_fn(|k| rgb[k] + fade * (even[k] - rgb[k]));
            let rgb = relit(rgb, Attribute::GAINS.map(|gain| f64::from(block.column(gain)[0])));
            let distance = if splats.groups[index] == Group::Sky { f64::INFINITY } else { p.distance };
            let rgb = shade(p.direction, distance, rgb);
            drawn.push((p, rgb));
        }
    }
    drawn.sort_by(|a, b| a.0.depth.total_cmp(&b.0.depth));

    let mut frame = ReferenceFrame::default();
    for y in 0..camera.height {
        for x in 0..camera.width {
            let at = (y * camera.width + x) as usize;
            let split = surface.map(|surface| f64::from(surface.depth[at]));
            pixel(&drawn, f64::from(x) + 0.5, f64::from(y) + 0.5, split, &mut frame);
            let ray = camera.ray(f64::from(x) + 0.5, f64::from(y) + 0.5).to_array();
            let behind = shade(ray, f64::INFINITY, backdrop.reference(pixel_angle, ray));
            let (Some(rgb), Some(alpha)) = (frame.rgb.last_mut(), frame.alpha.last()) else { continue };
            for k in 0..3 {
                rgb[k] += (1.0 - alpha) * behind[k];
            }
        }
    }
    frame
}

fn pixel(drawn: &[(Projected, [f64; 3])], x: f64, y: f64, surface: Option<f64>, frame: &mut ReferenceFrame) {
    let split = surface.map_or(f64::NEG_INFINITY, |z| if z.is_nan() { f64::NEG_INFINITY } else { 1.0 / z });
    let (mut front, mut front_slack, mut slope_slack) = ([0.0; 5], 0.0, 0.0);
    let cut = -(255f64.log2());
    let stop = f64::from(MIN_TRANSMITTANCE);
    let (mut rgb, mut normal) = ([0.0; 3], [0.0; 3]);
    let mut margin: f64 = 1.0;
    let (mut alpha_sum, mut depth, mut median, mut slack, mut transmittance) = (0.0, 0.0, 0.0, 0.0, 1.0);
    let mut last: Option<(f64, f64)> = None;
    for (p, color) in drawn {
        let q = p.log2_alpha(x, y);
        if (q - cut).abs() < CUT_BAND {
            slack += transmittance / 255.0;
        }
        if q < cut {
            continue;
        }
        let alpha = q.exp2().min(f64::from(MAX_ALPHA));
        let next = transmittance * (1.0 - alpha);
        if (next / stop - 1.0).abs() < STOP_BAND {
            slack += transmittance;
        }
        if next <= stop {
            break;
        }
        if let Some((z, other)) = last
            && p.depth - z < ORDER_BAND * z
        {
            slack += transmittance / (1.0 - other) * alpha * other;
        }
        last = Some((p.depth, alpha));
        let weight = alpha * transmittance;
        margin = margin.min((transmittance - 0.5).abs());
        if transmittance > 0.5 {
            median = p.depth;
        }
        for k in 0..3 {
            rgb[k] += weight * color[k];
            normal[k] += weight * p.normal[k];
        }
        let change = [p.slopes[0] * (x - p.mean2d[0]), p.slopes[1] * (y - p.mean2d[1])];
        let reciprocal = 1.0 / p.depth + change[0] + change[1];
        let rounding = SLOPE_BAND * (change[0].abs() + change[1].abs()) + ORDER_BAND / p.depth;
        if (reciprocal - split).abs() < rounding {
            front_slack += weight;
        }
        if reciprocal > split {
            let values = [color[0], color[1], color[2], 0.0, 1.0];
            (0..5).for_each(|k| front[k] += weight * values[k]);
        } else {
            front[3] += weight * reciprocal.max(0.0);
        }
        slope_slack += weight * rounding;
        alpha_sum += weight;
        depth += weight * p.depth;
        transmittance = next;
    }
    if surface.is_some() {
        frame.front.push(front);
        frame.front_slack.push(front_slack);
        frame.slope_slack.push(slope_slack);
    }
    frame.rgb.push(rgb);
    frame.alpha.push(alpha_sum);
    frame.depth_sum.push(depth);
    frame.normal_sum.push(normal);
    frame.median_depth.push(if transmittance <= 0.5 { median } else { 0.0 });
    frame.median_margin.push(margin.min((transmittance - 0.5).abs()));
    frame.slack.push(slack);
}
