//! Comparisons with the reference, and splats that are hard to draw.

use super::{Backend, RandomLoss, random_splats};
use crate::attributes::SplatAttributes;
use crate::config::{Geometry, MedianDepth, Outputs, ParticlePass, WaterPass};
use crate::differentiable::{Differentiable, ForwardConfig};
use crate::error::RenderError;
use crate::frame::Frame;
#[cfg(feature = "gpu")]
use crate::frame::srgb_decode;
use crate::gradients::{Gradients, Learn};
use crate::hooks::{AirGroup, AirOnRay, GROUP, Medium, ShadeGroup, WgslSource};
use crate::plan::{DrawPass, SetView};
use crate::reference;
use crate::reference::backward::{self, Parameters, ReferenceGradients};
use crate::reference::frame::ReferenceFrame;
use crate::renderer::RenderBackend;
use crate::simd::SimdPath;
use wm_base::random::uniform;
use wm_scene::{Camera, Splats, splats::logit};

/// Kinds of splats that break renderers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum HardSplats {
    /// Larger than the picture.
    Huge,
    /// A hundred times longer than wide, some thousand px long.
    Needle,
    /// Centres just before and behind the near plane.
    NearPlane,
    /// All round the camera, most of them behind it.
    Behind,
    /// Opacities about 1/255 and 0.
    Faint,
    /// Opacities of 0.99 to 1.
    Opaque,
    /// Many at one depth.
    OneDepth,
    /// Far smaller than a pixel.
    Tiny,
}

impl HardSplats {
    /// Every kind.
    pub(crate) const ALL: [Self; 8] = [
        Self::Huge,
        Self::Needle,
        Self::NearPlane,
        Self::Behind,
        Self::Faint,
        Self::Opaque,
        Self::OneDepth,
        Self::Tiny,
    ];

    /// `count` splats of this kind, for [`camera`].
    pub(crate) fn splats(self, count: usize, seed: u64) -> Splats {
        let mut splats = random_splats(count, 1, seed);
        for i in 0..count {
            let u = |k: u64| uniform(seed ^ 0x5eed, i as u64 * 8 + k) as f32;
            match self {
                Self::Huge => {
                    splats.log_scales[i] = [0.5 + 2.0 * u(0), 0.5 + 2.0 * u(1), 0.5 + 2.0 * u(2)];
                    splats.logit_opacities[i] -= 1.5;
                }
                Self::Needle => splats.log_scales[i] = [1.0 + u(0), -4.0 - u(1), -4.0 - u(2)],
                Self::NearPlane => splats.means[i][2] = -6.0 + 0.2 + 0.02 * (u(0) - 0.3),
                Self::Behind => splats.means[i][2] = -6.0 + 3.0 * (u(0) - 0.7),
                Self::Faint => splats.logit_opacities[i] = logit(f64::from(u(0)) * 2.5 / 255.0) as f32,
                Self::Opaque => {
                    splats.logit_opacities[i] = if u(1) < 0.2 { f32::INFINITY } else { 4.6 + 10.0 * u(0) }
                }
                Self::OneDepth => splats.means[i][2] = 0.5,
                Self::Tiny => splats.log_scales[i] = [-9.0 - u(0), -9.0 - u(1), -9.0 - u(2)],
            }
        }
        splats
    }
}

/// Every output on.
pub(crate) const ALL_OUTPUTS: Outputs = Outputs {
    geometry: Geometry::DepthNormal,
    median_depth: MedianDepth::On,
    particles: ParticlePass::Off,
    water: WaterPass::Off,
};

/// Compares a frame with the reference's. Tight where no decision is near: colours within `1e-4` of
/// each pixel and `1e-5` in the mean, sums of depth and normal likewise relative to their size.
/// Where one is (see [`ReferenceFrame::slack`]), by the weight at stake and no more.
///
/// The bound of a pixel: rasterize's contract gives 1e-6 relative an alpha; with up to a few
/// hundred splats over a pixel and colours up to 2 the sum stays under 1e-4.
///
/// # Errors
/// A line that names the first pixel beyond its bound, or the mean.
pub(crate) fn compare(frame: &Frame, want: &ReferenceFrame, largest_color: f64) -> Result<(), String> {
    let mut mean = 0.0;
    let largest_depth = want.depth_sum.iter().copied().fold(1.0, f64::max);
    for i in 0..frame.pixels() {
        let at = (i % frame.width as usize, i / frame.width as usize);
        let slack = want.slack[i];
        let check = |name: &str, got: f64, wanted: f64, scale: f64| {
            let bound = scale * (1e-4 + 2.0 * slack);
            let off = (got - wanted).abs();
            if off <= bound {
                Ok(off)
            } else {
                Err(format!("{name} at {at:?} is {got}, want {wanted}: off by {off:.2e}, bound {bound:.2e}"))
            }
        };
        for k in 0..3 {
            let off = check("rgb", f64::from(frame.rgb[3 * i + k]), want.rgb[i][k], largest_color)?;
            if slack == 0.0 {
                mean += off / largest_color;
            }
        }
        let alpha = f64::from(frame.alpha[i]);
        check("alpha", alpha, want.alpha[i], 1.0)?;
        if want.alpha[i] > 0.1 {
            let (depth, wanted) = (f64::from(frame.depth[i]), want.depth_sum[i] / want.alpha[i]);
            check("depth", depth, wanted, largest_depth / want.alpha[i])?;
            let sum = want.normal_sum[i];
            let length = sum.iter().map(|v| v * v).sum::<f64>().sqrt();
            if length > 0.1 {
                for k in 0..3 {
                    check("normal", f64::from(frame.normal[3 * i + k]), sum[k] / length, 2.0 / length)?;
                }
            }
        }
        // A median is the depth of one splat: right, or another's where a decision is near one
        // half.
        if want.median_margin[i] > 1e-4 + 2.0 * slack {
            let (got, wanted) = (f64::from(frame.median_depth[i]), want.median_depth[i]);
            if (got - wanted).abs() > 1e-5 * wanted.max(1.0) {
                return Err(format!("median depth at {at:?} is {got}, want {wanted}"));
            }
        }
    }
    let mean = mean / (3 * frame.pixels()) as f64;
    if mean < 1e-5 { Ok(()) } else { Err(format!("mean difference {mean:.2e}, bound 1e-5")) }
}

/// Draws a pass into a frame of its own.
pub(crate) fn drawn(renderer: &mut dyn RenderBackend, pass: &DrawPass<'_>) -> Frame {
    let mut frame = Frame::default();
    renderer.render(pass, &mut frame).unwrap();
    frame
}

/// Makes a step of training: the picture, and the gradients of a random loss.
///
/// # Errors
/// The errors of [`Differentiable::forward`] and [`Differentiable::backward`].
pub(crate) fn step(
    renderer: &mut dyn Differentiable,
    splats: &Splats,
    camera: &Camera,
    config: &ForwardConfig,
    learn: Learn,
    seed: u64,
) -> Result<(Frame, Gradients), RenderError> {
    let (mut frame, mut gradients) = (Frame::default(), Gradients::default());
    renderer.forward(splats, camera, config, &mut frame)?;
    let loss = RandomLoss::new(config.channels, frame.pixels(), seed, |_| true);
    renderer.backward(splats, &loss.upstream(), learn, &mut gradients)?;
    Ok((frame, gradients))
}

/// Renders sets with their attributes as `pass` says, and compares the frame with the reference's.
///
/// # Errors
/// As of [`compare`].
pub(crate) fn rendered(
    backend: Backend,
    sets: &[(&Splats, Option<&dyn SplatAttributes>)],
    pass: &DrawPass<'_>,
) -> Result<Frame, String> {
    let mut renderer = backend.renderer();
    let mut loaded = |splats: &Splats| SetView::plain(renderer.load(splats).unwrap());
    let views = sets.iter().map(|set| loaded(set.0).with_attributes(set.1)).collect();
    let frame = drawn(&mut *renderer, &DrawPass { sets: views, ..pass.clone() });
    compare(&frame, &reference::frame::render(sets, pass), 2.0)?;
    Ok(frame)
}

/// Coloured air.
pub(crate) struct TestAir {
    /// Extinction of each channel, per scene unit.
    pub(crate) extinction: [f64; 3],
    /// Light of endless air.
    pub(crate) light: [f64; 3],
    /// Change of the light with the direction of the ray.
    pub(crate) by_direction: f64,
    /// Change of the light with the place of the camera.
    pub(crate) by_origin: f64,
}

impl Medium for TestAir {
    fn evaluate(&self, _: SimdPath, origin: [f32; 3], rays: &[ShadeGroup], out: &mut [AirGroup]) {
        evaluate_by_reference(self, origin, rays, out);
    }

    fn evaluate_reference(&self, origin: [f64; 3], direction: [f64; 3], distance: f64) -> AirOnRay {
        let kept = self.extinction.map(|extinction| (-extinction * distance).exp());
        let light = |k: usize| self.light[k] + self.by_direction * direction[k] + self.by_origin * origin[k];
        AirOnRay { transmittance: kept, airlight: [0, 1, 2].map(|k| (1.0 - kept[k]) * light(k)) }
    }

    fn wgsl(&self, origin: [f32; 3]) -> Option<WgslSource> {
        let wgsl = "fn evaluate_air(direction: vec3<f32>, distance: f32) -> AirOnRay {
            let kept = exp(-vec3<f32>(air[0], air[1], air[2]) * min(distance, 1e6));
            let origin = vec3<f32>(air[8], air[9], air[10]);
            let light = vec3<f32>(air[3], air[4], air[5]) + air[6] * direction + air[7] * origin;
            return AirOnRay(kept, (1.0 - kept) * light);
        }";
        let changes = [&self.by_direction, &self.by_origin];
        let own = self.extinction.iter().chain(&self.light).chain(changes).map(|value| *value as f32);
        Some(WgslSource { wgsl: wgsl.into(), parameters: own.chain(origin).collect() })
    }
}

/// An air without a form for the GPU: whatever lies behind it looks grey, 0.25.
#[cfg(feature = "gpu")]
pub(crate) struct HeavyAir;

#[cfg(feature = "gpu")]
impl Medium for HeavyAir {
    fn evaluate(&self, _: SimdPath, origin: [f32; 3], rays: &[ShadeGroup], out: &mut [AirGroup]) {
        evaluate_by_reference(self, origin, rays, out);
    }

    fn evaluate_reference(&self, _: [f64; 3], _: [f64; 3], _: f64) -> AirOnRay {
        AirOnRay { transmittance: [0.0; 3], airlight: [srgb_decode(0.25); 3] }
    }

    fn name(&self) -> &'static str {
        "heavy air"
    }
}

/// Evaluates an air by its reference.
fn evaluate_by_reference(medium: &dyn Medium, origin: [f32; 3], rays: &[ShadeGroup], out: &mut [AirGroup]) {
    for (rays, out) in rays.iter().zip(out) {
        for lane in 0..GROUP {
            let direction = [0, 1, 2].map(|k| f64::from(rays.direction[k][lane]));
            let distance = f64::from(rays.distance[lane]);
            let air = medium.evaluate_reference(origin.map(f64::from), direction, distance);
            for k in 0..3 {
                out.transmittance[k][lane] = air.transmittance[k] as f32;
                out.airlight[k][lane] = air.airlight[k] as f32;
            }
        }
    }
}

/// Gradients of a random loss by the back end and by the reference. The loss counts only the pixels
/// at which both must decide alike ([`backward::Decisions::steady`]).
///
/// # Panics
/// If the renderer cannot be started, or more than a few pixels are not steady.
pub(crate) fn gradients_of(
    backend: Backend,
    splats: &Splats,
    camera: &Camera,
    config: &ForwardConfig,
    seed: u64,
) -> (Gradients, ReferenceGradients) {
    let parameters = Parameters::of(splats);
    let decisions = backward::decide(&parameters, camera, config);
    let pixels = decisions.steady.len();
    let loss = RandomLoss::new(config.channels, pixels, seed, |i| decisions.steady[i]);
    let mut renderer = backend.differentiable();
    let (mut frame, mut gradients) = (Frame::default(), Gradients::default());
    renderer.forward(splats, camera, config, &mut frame).expect("it renders");
    renderer.backward(splats, &loss.upstream(), Learn::ALL, &mut gradients).expect("it derives");
    let want = backward::gradients(&parameters, camera, config, &decisions, &loss.upstream());
    (gradients, want)
}

/// Relative L2 distance of each array of gradients from the reference's.
pub(crate) fn gradient_errors(got: &Gradients, want: &ReferenceGradients) -> Vec<(&'static str, f64)> {
    let mut want = want.clone();
    let stride = want.parameters.sh.len() / want.weights.len().max(1);
    let mut errors = Vec::new();
    let mut add = |name: &'static str, got_rows: &[f32], want: &[f64], stride: usize| {
        if got_rows.is_empty() {
            return;
        }
        let width = got_rows.len() / got.visible.len();
        // What the back end does not show counts as 0.
        let mut full = vec![0.0; want.len()];
        for (row, index) in got_rows.chunks_exact(width).zip(&got.visible) {
            for (k, value) in row.iter().enumerate() {
                full[*index as usize * stride + k] = f64::from(*value);
            }
        }
        let norm: f64 = want.iter().map(|v| v * v).sum();
        let error: f64 = want.iter().zip(&full).map(|(a, b)| (a - b) * (a - b)).sum();
        errors.push((name, (error / norm.max(1e-60)).sqrt()));
    };
    let ReferenceGradients { parameters, means2d, absgrads, weights, radii } = &mut want;
    add("means", got.means.as_flattened(), &parameters.means, 3);
    add("quats", got.quats.as_flattened(), &parameters.quats, 4);
    add("log_scales", got.log_scales.as_flattened(), &parameters.log_scales, 3);
    add("logit_opacities", &got.logit_opacities, &parameters.logit_opacities, 1);
    add("sh", &got.sh, &parameters.sh, stride);
    add("means2d", got.means2d.as_flattened(), means2d.as_flattened(), 2);
    add("absgrads", got.absgrads.as_flattened(), absgrads.as_flattened(), 2);
    add("weights", &got.weights, weights, 1);
    // Splats in the picture by their centre alone have radii there and not here.
    for (index, radius) in radii.iter_mut().enumerate() {
        if got.visible.binary_search(&(index as u32)).is_err() {
            *radius = 0.0;
        }
    }
    add("radii", &got.radii, radii, 1);
    errors
}
