//! Look: exposure, white balance, saturation and contrast of the finished picture.
//!
//! In linear light, in this order, on the colour `c` of a pixel:
//!
//! 1. exposure and temperature: `c_k 2^exposure w_k`, with the gains `w` of `balance` in
//!    `grade.rs`;
//! 2. saturation `s`: `Y + s (c - Y)`, with `Y` the luminance (ITU-R BT.709), and not below 0;
//! 3. contrast `a`: `0.18 (c / 0.18)^a`, each channel by itself: log2 of the light about mid grey
//!    is scaled, so mid grey and black stay.
//!
//! Pixels are decoded from sRGB before and encoded after, without a limit at white. At its defaults
//! it is no effect at all, so that not a byte changes.
//!
//! The colour filter that the paper lays over rain and snow is exposure -0.5, saturation 0.7,
//! contrast 0.85 and slightly cooler (temperature -0.2): part of them in fidelity `paper`
//! ([`crate::paper::composite`]), else to be asked for.

use crate::effects::effect::{Effect, EffectRole};
use crate::grade::ColorGrade;
use crate::param::ParamValue;

crate::param::params! {
    /// The parameters of the effect.
    struct LookParams {
        /// Change of exposure: the light times 2 to this power.
        exposure: f64 = ParamValue::Number(0.0), -10.0 => 10.0, "EV";
        /// Factor on the distance of colours from grey of the same luminance; 0 is without colour.
        saturation: f64 = ParamValue::Number(1.0), 0.0 => 4.0, "";
        /// Factor on the distance of light from mid grey (0.18 in linear light), in log2; below 1
        /// is flatter.
        contrast: f64 = ParamValue::Number(1.0), 0.1 => 4.0, "";
        /// Shift of the white balance, above 0 warmer: red times 2 to the power of half of it and
        /// blue divided by that, at the same luminance of grey. At 1 red has doubled against blue,
        /// about as if light of 6500 K became one of 4500 K; at -1 one of 13000 K.
        temperature: f64 = ParamValue::Number(0.0), -1.0 => 1.0, "";
    }
}

/// The entry of [`EFFECTS`](super::EFFECTS).
pub(crate) const EFFECT: Effect = Effect {
    name: "look",
    about: "Exposure, white balance, saturation and contrast of the finished picture",
    role: EffectRole::Lens,
    needs: &[],
    precipitation: None,
    params: LookParams::PARAMS,
    contribute: |now, weather| {
        let LookParams { exposure, saturation, contrast, temperature } = LookParams::of(now.values);
        let grade = ColorGrade::new(exposure, saturation, contrast, temperature);
        weather.prepared.grade = Some(grade).filter(|grade| !grade.is_neutral());
    },
    contribute_as_paper: None,
};
