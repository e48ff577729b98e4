//! The change of the light on each splat, from that of the capture to another.

use super::capture::CaptureLight;
use super::irradiance::SceneLight;
use crate::threads::map;
use wm_render::hooks::{Attribute, AttributeBlock, SplatAttributes};
use wm_scene::color::{luminance, srgb_decode, srgb_encode};
use wm_scene::{Splats, sh};

/// Most that the light on a splat grows.
const MOST: f64 = 8.0;
/// Most that the channels of a gain differ from its luminance, as a share: more turns former shadows neon.
const TINT: f64 = 0.25;

/// Gains of the splats of one scene, by channel.
#[derive(Clone, Debug, PartialEq)]
pub struct LightGains {
    gains: Vec<[f32; 3]>,
}

impl LightGains {
    /// The gains from the captured light to `light`, whose unit is that of [`CaptureLight::light`]. The sun of `light` stands where
    /// the capture's did. Where the capture could not be split all splats have the gain of level ground.
    #[must_use]
    pub fn new(capture: &CaptureLight, light: &SceneLight, up: [f64; 3], threads: usize) -> Self {
        if !capture.is_split() {
            let sin = capture.sun.map_or(0.0, |sun| (0..3).map(|k| sun.direction[k] * up[k]).sum());
            let gain = limited(ratio(capture.light.irradiance(sin), light.irradiance(sin)));
            return Self { gains: vec![gain; capture.len()] };
        }
        let (before, after) = (capture.mean(&capture.light), capture.mean(light));
        let gains = map(capture.len(), threads, |index| {
            let surface = capture.surface(index, up);
            limited(ratio(surface.irradiance(&capture.light, before), surface.irradiance(light, after)))
        });
        Self { gains }
    }

    /// The splats in the changed light, for programs that know no gains. Each colour is changed as the renderer does it, seen from
    /// where the spherical harmonics are neutral; these keep their share of it.
    #[must_use]
    pub fn applied(&self, splats: &Splats) -> Splats {
        let mut relit = splats.clone();
        let stride = splats.sh_stride();
        for (index, gain) in self.gains.iter().enumerate() {
            if stride == 0 || *gain == [1.0; 3] {
                continue;
            }
            let sh = &mut relit.sh[index * stride..(index + 1) * stride];
            let shown: [f64; 3] = std::array::from_fn(|k| (0.5 + sh::C0 * f64::from(sh[k])).max(0.0));
            let light = shown.map(srgb_decode);
            let limit = light.into_iter().fold(1.0, f64::max);
            let changed: [f64; 3] = std::array::from_fn(|k| light[k] * f64::from(gain[k]));
            let scale = limit / changed.into_iter().fold(limit, f64::max);
            for k in 0..3 {
                let value = srgb_encode(changed[k] * scale);
                let factor = if shown[k] > 1e-6 { value / shown[k] } else { 1.0 };
                sh[k] = sh::dc_of(value) as f32;
                sh[3..].iter_mut().skip(k).step_by(3).for_each(|v| *v = (f64::from(*v) * factor) as f32);
            }
        }
        relit
    }
}

impl SplatAttributes for LightGains {
    fn fill(&self, indices: &[u32], block: &mut AttributeBlock) {
        for (k, gain) in Attribute::GAINS.into_iter().enumerate() {
            for (index, value) in indices.iter().zip(block.column_mut(gain)) {
                // What pads the last group has no splat.
                *value = self.gains.get(*index as usize).map_or(1.0, |gain| gain[k]);
            }
        }
    }

    fn changes_light(&self) -> bool {
        true
    }
}

fn ratio(before: [f64; 3], after: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| after[k].max(0.0) / before[k].max(1e-3))
}

/// A gain within its limits.
fn limited(gain: [f64; 3]) -> [f32; 3] {
    let level = luminance(gain);
    if level <= 0.0 {
        return [0.0; 3];
    }
    let strength = level.min(MOST) / level;
    gain.map(|v| (strength * v.clamp((1.0 - TINT) * level, (1.0 + TINT) * level)) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gains_are_bounded_and_nearly_grey() {
        let gain = limited([40.0, 20.0, 10.0]);
        assert!(gain.iter().all(|v| *v <= (MOST * (1.0 + TINT)) as f32), "{gain:?}");
        assert!(f64::from(gain[0] / gain[2]) < (1.0 + TINT) / (1.0 - TINT) + 1e-6, "{gain:?}");
        assert_eq!(limited([0.0; 3]), [0.0; 3]);
    }
}
