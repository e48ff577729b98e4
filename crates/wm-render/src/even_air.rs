//! Even air: the haze in which the photos of a scene were taken.
//!
//! Training draws splats through it, so that they learn the colours that they have without it;
//! scores against such photos need it too. It is not the air of weather:
//!
//! - It is a straight line in display-referred colours, `c k + m` with `k` and `m` by distance: the
//!   tangent of `encode(decode(c) t + A (1 - t))` at a grey of 18 %. A pixel is a mean of displayed
//!   colours of splats, and only through a straight line is the mean seen like its parts: through
//!   the curve, splats that differ would look brighter together than what they show without haze,
//!   and would be learnt too dark.
//! - It leaves splats of the sky as they are: photos show the sky through the air, and how much of
//!   that is air they do not say.
//! - It knows no heights.

use crate::dispatch;
use crate::hooks::{AirGroup, AirOnRay, GROUP, Medium, ShadeGroup};
use crate::simd::{self, Lanes, SimdPath, exp2, powf};
use fearless_simd::{Select, SimdBase, SimdFloat};
use std::f32::consts::LOG2_E;
use wm_base::color::srgb_encode;

/// Linear light of the grey at which the line touches the curve.
pub(crate) const MIDDLE_GREY: f64 = 0.18;

/// Even, grey air from the camera to every surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EvenAir {
    /// Extinction a scene unit, 0 or more.
    pub extinction: f32,
    /// Light that endless air has, linear RGB, 0 or more.
    pub airlight: [f32; 3],
}

impl EvenAir {
    /// The share of light that is left after `distance`, scene units; all of the sky's, which is
    /// infinitely far.
    #[must_use]
    pub fn transmittance(&self, distance: f64) -> f64 {
        if distance.is_finite() { (-f64::from(self.extinction) * distance).exp() } else { 1.0 }
    }

    /// The factor and the summand of displayed colours through air that lets `transmittance`
    /// through: the reference.
    pub(crate) fn line(&self, transmittance: f64) -> [(f64, f64); 3] {
        let grey = srgb_encode(MIDDLE_GREY);
        self.airlight.map(|airlight| {
            let seen = srgb_encode(MIDDLE_GREY * transmittance + f64::from(airlight) * (1.0 - transmittance));
            let factor = transmittance * decode_slope(grey) / decode_slope(seen);
            (factor, seen - factor * grey)
        })
    }

    /// Factors and summands of one vector of rays of a group.
    #[inline(always)]
    fn lines<S: Lanes>(&self, simd: S, group: &ShadeGroup, first: usize) -> ([S::F; 3], [S::F; 3]) {
        let grey = srgb_encode(MIDDLE_GREY);
        let distance = simd.load(&group.distance[first..]);
        let is_near = distance.simd_lt(simd.set(f32::MAX));
        let power = (distance * (-self.extinction * LOG2_E)).max(simd.set(-126.0));
        let [kept] = exp2(simd, [power]);
        let mut light = [kept * MIDDLE_GREY as f32; 3];
        for k in 0..3 {
            light[k] = (simd.set(1.0) - kept).mul_add(simd.set(self.airlight[k]), light[k]);
        }
        let seen = simd::srgb_encode(simd, light);
        let slopes = decode_slopes(simd, seen);
        let (mut factors, mut summands) = (seen, seen);
        for k in 0..3 {
            let factor = kept * decode_slope(grey) as f32 / slopes[k];
            summands[k] = is_near.select((-factor).mul_add(simd.set(grey as f32), seen[k]), simd.set(0.0));
            factors[k] = is_near.select(factor, simd.set(1.0));
        }
        (factors, summands)
    }

    #[inline(always)]
    fn shade_groups<S: Lanes>(&self, simd: S, groups: &mut [ShadeGroup]) {
        for group in groups {
            for first in (0..GROUP).step_by(S::N) {
                let (factors, summands) = self.lines(simd, group, first);
                for k in 0..3 {
                    let seen = simd.load(&group.rgb[k][first..]).mul_add(factors[k], summands[k]);
                    seen.store_slice(&mut group.rgb[k][first..first + S::N]);
                }
            }
        }
    }

    /// Turns the derivatives `by_rgb` by colours seen through the air into those by the colours of
    /// `group`. What was held at black learns nothing.
    #[inline(always)]
    pub(crate) fn pull_back<S: Lanes>(&self, simd: S, group: &ShadeGroup, by_rgb: &mut [[f32; GROUP]; 3]) {
        for first in (0..GROUP).step_by(S::N) {
            let (factors, _) = self.lines(simd, group, first);
            for k in 0..3 {
                let is_lit = simd.load(&group.rgb[k][first..]).simd_gt(simd.set(0.0));
                let by = is_lit.select(simd.load(&by_rgb[k][first..]) * factors[k], simd.set(0.0));
                by.store_slice(&mut by_rgb[k][first..first + S::N]);
            }
        }
    }
}

/// Derivative of `srgb_decode`.
fn decode_slope(value: f64) -> f64 {
    if value <= 0.040_45 { 1.0 / 12.92 } else { 2.4 / 1.055 * ((value + 0.055) / 1.055).powf(1.4) }
}

/// Derivatives of [`simd::srgb_decode`].
#[inline(always)]
fn decode_slopes<S: Lanes>(simd: S, value: [S::F; 3]) -> [S::F; 3] {
    let mut base = value;
    for k in 0..3 {
        base[k] = value[k].mul_add(simd.set(1.0 / 1.055), simd.set(0.055 / 1.055));
    }
    let mut slopes = powf(simd, base, 1.4);
    for k in 0..3 {
        let power = slopes[k] * (2.4 / 1.055);
        slopes[k] = value[k].simd_le(simd.set(0.040_45)).select(simd.set(1.0 / 12.92), power);
    }
    slopes
}

impl Medium for EvenAir {
    /// Evaluates transmittance and airlight for linear light; [`Self::shade`] changes colours.
    fn evaluate(&self, _path: SimdPath, _origin: [f32; 3], rays: &[ShadeGroup], out: &mut [AirGroup]) {
        for (group, out) in rays.iter().zip(out) {
            for lane in 0..GROUP {
                let kept = self.transmittance(f64::from(group.distance[lane])) as f32;
                for k in 0..3 {
                    out.transmittance[k][lane] = kept;
                    out.airlight[k][lane] = self.airlight[k] * (1.0 - kept);
                }
            }
        }
    }

    fn shade(&self, path: SimdPath, _origin: [f32; 3], groups: &mut [ShadeGroup]) {
        dispatch!(path, s => self.shade_groups(s, groups));
    }

    fn evaluate_reference(&self, _origin: [f64; 3], _direction: [f64; 3], distance: f64) -> AirOnRay {
        let kept = self.transmittance(distance);
        AirOnRay { transmittance: [kept; 3], airlight: self.airlight.map(|v| f64::from(v) * (1.0 - kept)) }
    }

    fn reference(&self, _origin: [f64; 3], _direction: [f64; 3], distance: f64, rgb: [f64; 3]) -> [f64; 3] {
        if distance.is_infinite() {
            return rgb;
        }
        let line = self.line(self.transmittance(distance));
        std::array::from_fn(|k| rgb[k] * line[k].0 + line[k].1)
    }

    fn name(&self) -> &'static str {
        "the haze of the photos"
    }
}
