//! The reference of gradients: the formulas of the backward stages in f64, by brute force.
//!
//! A render is no smooth function: splats fall under the cut, clamps bite, the order changes. A
//! gradient is that of the smooth piece at hand, so all decisions are taken once ([`Decisions`])
//! and kept: [`render`] under kept decisions is smooth, and [`gradients`] is its derivative, which
//! tests check by finite differences. [`Decisions::steady`] tells the pixels where f32 decides
//! alike.

mod splat;
#[cfg(test)]
mod tests;

use crate::differentiable::{Channels, DepthAlpha, ForwardConfig, Upstream};
use crate::frame::MIN_ALPHA;
use crate::reference::frame::{CUT_BAND, ORDER_BAND, STOP_BAND};
use crate::stages::rasterize::{LOG2_MAX_ALPHA, MAX_ALPHA, MIN_TRANSMITTANCE};
use splat::{Splat, SplatDecisions, SplatDerivatives};
use std::f64::consts::LN_2;
use wm_scene::{Camera, Splats, sh};

/// Stored parameters, or their gradients, in f64. Flat, shapes as in [`Splats`].
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Parameters {
    /// `[N, 3]`.
    pub(crate) means: Vec<f64>,
    /// `[N, 4]`.
    pub(crate) quats: Vec<f64>,
    /// `[N, 3]`.
    pub(crate) log_scales: Vec<f64>,
    /// `[N]`.
    pub(crate) logit_opacities: Vec<f64>,
    /// `[N, K, 3]`.
    pub(crate) sh: Vec<f64>,
    /// Degree of `sh`.
    pub(crate) sh_degree: u8,
}

impl Parameters {
    /// The parameters of `splats`.
    pub(crate) fn of(splats: &Splats) -> Self {
        let wide = |values: &[f32]| values.iter().copied().map(f64::from).collect();
        Self {
            means: wide(splats.means.as_flattened()),
            quats: wide(splats.quats.as_flattened()),
            log_scales: wide(splats.log_scales.as_flattened()),
            logit_opacities: wide(&splats.logit_opacities),
            sh: wide(&splats.sh),
            sh_degree: splats.sh_degree,
        }
    }

    /// Number of splats.
    pub(crate) fn len(&self) -> usize {
        self.logit_opacities.len()
    }

    /// The arrays with their names.
    pub(crate) fn arrays(&mut self) -> [(&'static str, &mut Vec<f64>); 5] {
        [
            ("means", &mut self.means),
            ("quats", &mut self.quats),
            ("log_scales", &mut self.log_scales),
            ("logit_opacities", &mut self.logit_opacities),
            ("sh", &mut self.sh),
        ]
    }

    fn zeros(&self) -> Self {
        let mut zeros = self.clone();
        for (_, array) in zeros.arrays() {
            array.fill(0.0);
        }
        zeros
    }
}

/// Everything about a view that is decided and not computed.
#[derive(Clone, Debug)]
pub(crate) struct Decisions {
    /// The splats in view, in the order of blending.
    order: Vec<usize>,
    splats: Vec<Option<SplatDecisions>>,
    /// For each pixel the splats that it holds, and whether their alpha is clamped.
    pixels: Vec<Vec<(usize, bool)>>,
    /// True if a pixel has depth and normal.
    covered: Vec<bool>,
    /// True if no decision of a pixel is so close that f32 may take it otherwise, `[H, W]`.
    pub(crate) steady: Vec<bool>,
}

/// Blended pictures in f64; those that are not asked for are 0.
#[derive(Clone, Debug, Default)]
pub(crate) struct ReferencePictures {
    /// `[H, W, 3]`.
    pub(crate) rgb: Vec<[f64; 3]>,
    /// `[H, W]`.
    pub(crate) alpha: Vec<f64>,
    /// `[H, W]`.
    pub(crate) depth: Vec<f64>,
    /// `[H, W, 3]`.
    pub(crate) normal: Vec<[f64; 3]>,
}

impl ReferencePictures {
    /// The loss whose derivative is `upstream`: the sum of each value times its own.
    pub(crate) fn loss(&self, upstream: &Upstream<'_>) -> f64 {
        let dot = |values: &[f64], weights: &[f32]| -> f64 {
            values.iter().zip(weights).map(|(value, weight)| value * f64::from(*weight)).sum()
        };
        dot(self.rgb.as_flattened(), upstream.rgb)
            + dot(&self.alpha, upstream.alpha)
            + dot(&self.depth, upstream.depth)
            + dot(self.normal.as_flattened(), upstream.normal)
    }
}

/// The result of [`gradients`].
#[derive(Clone, Debug)]
pub(crate) struct ReferenceGradients {
    /// By the stored parameters.
    pub(crate) parameters: Parameters,
    /// By the centres, px, `[N, 2]`.
    pub(crate) means2d: Vec<[f64; 2]>,
    /// Sums of absolute values of the same, `[N, 2]`.
    pub(crate) absgrads: Vec<[f64; 2]>,
    /// Sums of weights, `[N]`.
    pub(crate) weights: Vec<f64>,
    /// Three standard deviations along the longest axis in the picture, px, `[N]`; 0 out of view.
    pub(crate) radii: Vec<f64>,
}

/// Takes all decisions of a view.
pub(crate) fn decide(parameters: &Parameters, camera: &Camera, config: &ForwardConfig) -> Decisions {
    let seen: Vec<Option<Splat>> =
        (0..parameters.len()).map(|i| Splat::new(parameters, i, camera, config, None)).collect();
    let mut order: Vec<usize> = (0..seen.len()).filter(|i| seen[*i].is_some()).collect();
    order.sort_by(|a, b| match (&seen[*a], &seen[*b]) {
        (Some(a), Some(b)) => a.depth().total_cmp(&b.depth()),
        _ => std::cmp::Ordering::Equal,
    });
    let mut decisions = Decisions {
        splats: seen.iter().map(|splat| splat.as_ref().map(|splat| splat.decisions)).collect(),
        pixels: Vec::new(),
        covered: Vec::new(),
        steady: Vec::new(),
        order,
    };
    let stop = f64::from(MIN_TRANSMITTANCE);
    for y in 0..camera.height {
        for x in 0..camera.width {
            let at = (f64::from(x) + 0.5, f64::from(y) + 0.5);
            let (mut held, mut transmittance, mut steady) = (Vec::new(), 1.0, true);
            let mut last = f64::NEG_INFINITY;
            for index in &decisions.order {
                let Some(splat) = &seen[*index] else { continue };
                let q = splat.log2_alpha(at.0, at.1).0;
                let cut = -(255f64.log2());
                steady &= (q - cut).abs() >= CUT_BAND;
                if q < cut {
                    continue;
                }
                let clamped = q.exp2() > f64::from(MAX_ALPHA);
                steady &= (q - f64::from(LOG2_MAX_ALPHA)).abs() >= 1e-4;
                let next = transmittance * (1.0 - if clamped { f64::from(MAX_ALPHA) } else { q.exp2() });
                steady &= (next / stop - 1.0).abs() >= STOP_BAND;
                if next <= stop {
                    break;
                }
                steady &= splat.depth() - last >= ORDER_BAND * last;
                last = splat.depth();
                transmittance = next;
                held.push((*index, clamped));
            }
            steady &= ((1.0 - transmittance) / f64::from(MIN_ALPHA) - 1.0).abs() >= 1e-3;
            decisions.covered.push(1.0 - transmittance >= f64::from(MIN_ALPHA));
            decisions.pixels.push(held);
            decisions.steady.push(steady);
        }
    }
    decisions
}

/// One splat at one pixel.
struct Touch {
    index: usize,
    clamped: bool,
    alpha: f64,
    transmittance: f64,
    u: f64,
    v: f64,
}

/// One pixel's sums.
#[derive(Default)]
struct Sums {
    rgb: [f64; 3],
    alpha: f64,
    depth: f64,
    normal: [f64; 3],
    transmittance: f64,
}

impl Sums {
    fn of(touches: &[Touch], splats: &[Option<Splat>]) -> Self {
        let mut sums = Self { transmittance: 1.0, ..Self::default() };
        for touch in touches {
            let Some(splat) = &splats[touch.index] else { continue };
            let weight = touch.alpha * touch.transmittance;
            for k in 0..3 {
                sums.rgb[k] += weight * splat.rgb[k];
                sums.normal[k] += weight * splat.normal()[k];
            }
            sums.alpha += weight;
            sums.depth += weight * splat.depth();
            sums.transmittance = touch.transmittance * (1.0 - touch.alpha);
        }
        sums
    }

    fn normal_length(&self) -> f64 {
        self.normal.iter().map(|v| v * v).sum::<f64>().sqrt()
    }
}

fn touches(decisions: &Decisions, splats: &[Option<Splat>], pixel: usize, camera: &Camera) -> Vec<Touch> {
    let width = camera.width as usize;
    let at = ((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
    let mut transmittance = 1.0;
    let mut touches = Vec::new();
    for (index, clamped) in &decisions.pixels[pixel] {
        let Some(splat) = &splats[*index] else { continue };
        let (q, u, v) = splat.log2_alpha(at.0, at.1);
        let alpha = if *clamped { f64::from(MAX_ALPHA) } else { q.exp2() };
        touches.push(Touch { index: *index, clamped: *clamped, alpha, transmittance, u, v });
        transmittance *= 1.0 - alpha;
    }
    touches
}

fn project(
    parameters: &Parameters,
    camera: &Camera,
    config: &ForwardConfig,
    decisions: &Decisions,
) -> Vec<Option<Splat>> {
    let project = |i| {
        let kept = decisions.splats.get(i).copied().flatten()?;
        Splat::new(parameters, i, camera, config, Some(&kept))
    };
    (0..parameters.len()).map(project).collect()
}

/// Renders under kept decisions.
pub(crate) fn render(
    parameters: &Parameters,
    camera: &Camera,
    config: &ForwardConfig,
    decisions: &Decisions,
) -> ReferencePictures {
    let splats = project(parameters, camera, config, decisions);
    let mut pictures = ReferencePictures::default();
    for pixel in 0..decisions.pixels.len() {
        let sums = Sums::of(&touches(decisions, &splats, pixel, camera), &splats);
        let behind = config.background.map(|c| f64::from(c) * (1.0 - sums.alpha));
        let covered = decisions.covered[pixel];
        let length = sums.normal_length();
        pictures.rgb.push([0, 1, 2].map(|k| sums.rgb[k] + behind[k]));
        pictures.alpha.push(sums.alpha);
        pictures.depth.push(if covered { sums.depth / sums.alpha } else { 0.0 });
        pictures.normal.push(if covered && length > 1e-10 {
            sums.normal.map(|n| n / length)
        } else {
            [0.0; 3]
        });
    }
    pictures
}

/// The gradients of the loss whose derivative by each pixel is `upstream`.
pub(crate) fn gradients(
    parameters: &Parameters,
    camera: &Camera,
    config: &ForwardConfig,
    decisions: &Decisions,
    upstream: &Upstream<'_>,
) -> ReferenceGradients {
    upstream.check(decisions.pixels.len(), config.channels);
    let splats = project(parameters, camera, config, decisions);
    let mut pulls: Vec<SplatDerivatives> = vec![SplatDerivatives::default(); splats.len()];
    for pixel in 0..decisions.pixels.len() {
        let touches = touches(decisions, &splats, pixel, camera);
        let sums = Sums::of(&touches, &splats);
        pixel_gradients(
            &touches,
            &splats,
            &sums,
            config,
            decisions.covered[pixel],
            upstream,
            pixel,
            &mut pulls,
        );
    }

    let mut out = ReferenceGradients {
        parameters: parameters.zeros(),
        means2d: vec![[0.0; 2]; splats.len()],
        absgrads: vec![[0.0; 2]; splats.len()],
        weights: vec![0.0; splats.len()],
        radii: vec![0.0; splats.len()],
    };
    for (index, splat) in splats.iter().enumerate() {
        let Some(splat) = splat else { continue };
        splat.gradients(parameters, index, camera, config, &pulls[index], &mut out.parameters);
        out.means2d[index] = splat.mean2d_gradient(&pulls[index]);
        out.absgrads[index] = pulls[index].absolute;
        out.weights[index] = pulls[index].weight;
        out.radii[index] = splat.radius();
    }
    out
}

/// Adds one pixel's pulls on its splats.
#[allow(clippy::too_many_arguments, reason = "few callers; a struct would only repeat the names")]
fn pixel_gradients(
    touches: &[Touch],
    splats: &[Option<Splat>],
    sums: &Sums,
    config: &ForwardConfig,
    covered: bool,
    upstream: &Upstream<'_>,
    pixel: usize,
    pulls: &mut [SplatDerivatives],
) {
    let read = |values: &[f32], at: usize| values.get(at).map_or(0.0, |v| f64::from(*v));
    let by_rgb = [0, 1, 2].map(|k| read(upstream.rgb, 3 * pixel + k));
    let mut by_alpha = read(upstream.alpha, pixel);
    let mut by_depth = 0.0;
    let mut by_normal = [0.0; 3];
    for k in 0..3 {
        by_alpha -= by_rgb[k] * f64::from(config.background[k]);
    }
    if covered {
        // depth = sum / alpha
        by_depth = read(upstream.depth, pixel) / sums.alpha;
        if upstream.depth_alpha == DepthAlpha::Learns {
            by_alpha -= by_depth * sums.depth / sums.alpha;
        }
        // normal = sum / |sum|
        let length = sums.normal_length();
        if length > 1e-10 {
            let by_unit = [0, 1, 2].map(|k| read(upstream.normal, 3 * pixel + k));
            let along: f64 = (0..3).map(|k| by_unit[k] * sums.normal[k] / length).sum();
            by_normal = [0, 1, 2].map(|k| (by_unit[k] - along * sums.normal[k] / length) / length);
        }
    }
    let mut behind = 0.0;
    for touch in touches.iter().rev() {
        let Some(splat) = &splats[touch.index] else { continue };
        let pull = &mut pulls[touch.index];
        let weight = touch.alpha * touch.transmittance;
        let color = if config.channels == Channels::Depth { [0.0; 3] } else { splat.rgb };
        let mut value = by_depth * splat.depth();
        for k in 0..3 {
            value += by_rgb[k] * color[k] + by_normal[k] * splat.normal()[k];
            pull.rgb[k] += weight * by_rgb[k];
            pull.normal[k] += weight * by_normal[k];
        }
        pull.depth += weight * by_depth;
        pull.weight += weight;
        if !touch.clamped {
            let by_alpha =
                touch.transmittance * value - (behind - by_alpha * sums.transmittance) / (1.0 - touch.alpha);
            let s = touch.alpha * by_alpha;
            let (u, v) = (touch.u, touch.v);
            for (sum, moment) in pull.moments.iter_mut().zip([1.0, u, v, u * u, u * v, v * v]) {
                *sum += s * moment;
            }
            let [by_x, by_y] = splat.slope(u, v);
            pull.absolute[0] += (LN_2 * s * by_x).abs();
            pull.absolute[1] += (LN_2 * s * by_y).abs();
        }
        behind += weight * value;
    }
}

/// The derivatives of the 16 basis functions of [`sh::basis`], taken as polynomials, at
/// `direction`.
pub(crate) fn basis_slopes(direction: [f64; 3]) -> [[f64; 3]; 16] {
    use sh::{C1, C2, C3};
    let [x, y, z] = direction;
    let (xx, yy, zz) = (x * x, y * y, z * z);
    let times = |c: f64, slopes: [f64; 3]| slopes.map(|s| c * s);
    [
        [0.0; 3],
        [0.0, -C1, 0.0],
        [0.0, 0.0, C1],
        [-C1, 0.0, 0.0],
        times(C2[0], [y, x, 0.0]),
        times(C2[1], [0.0, z, y]),
        times(C2[2], [-2.0 * x, -2.0 * y, 4.0 * z]),
        times(C2[3], [z, 0.0, x]),
        times(C2[4], [2.0 * x, -2.0 * y, 0.0]),
        times(C3[0], [6.0 * x * y, 3.0 * (xx - yy), 0.0]),
        times(C3[1], [y * z, x * z, x * y]),
        times(C3[2], [-2.0 * x * y, 4.0 * zz - xx - 3.0 * yy, 8.0 * y * z]),
        times(C3[3], [-6.0 * x * z, -6.0 * y * z, 6.0 * zz - 3.0 * (xx + yy)]),
        times(C3[4], [4.0 * zz - 3.0 * xx - yy, -2.0 * x * y, 8.0 * x * z]),
        times(C3[5], [2.0 * x * z, -2.0 * y * z, xx - yy]),
        times(C3[6], [3.0 * (xx - yy), -6.0 * x * y, 0.0]),
    ]
}
