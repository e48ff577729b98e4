//! The change of the light on each splat, from that of the capture to another.

use super::capture::CaptureLight;
use super::irradiance::SceneLight;
use super::sun_shadows::SunShadows;
use crate::threads::map;
use wm_render::hooks::{Attribute, AttributeBlock, SplatAttributes};
use wm_scene::color::{luminance, srgb_decode, srgb_encode};
use wm_scene::{Splats, sh};

/// Most that the light on a splat grows.
const MOST: f64 = 8.0;
/// Most of the captured light's tint that is taken away, as a share: more turns former shadows neon.
const TINT: f64 = 0.25;

/// The light that a captured place shall lie in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NewLight {
    /// Sun and sky; the unit is that of [`CaptureLight::light`].
    pub light: SceneLight,
    /// Sine of the sun's elevation.
    pub sin_sun: f64,
    /// Factor on the light of the captured sky, where it is drawn.
    pub sky_gain: f64,
    /// Factor on the opacity of the captured sky's splats, 0-1.
    pub sky_opacity: f64,
    /// The photos are said to have no shadows.
    pub is_diffuse: bool,
}

/// Gains of the splats of one scene, by channel.
#[derive(Clone, Debug, PartialEq)]
pub struct LightGains {
    gains: Vec<[f32; 3]>,
    /// The splats of the captured sky, and the factor on their opacity; empty where that is 1.
    sky: Vec<bool>,
    sky_opacity: f32,
}

impl LightGains {
    /// The gains from the captured light to another. The sun stands where the capture's did, or where `shadows` say. Where the
    /// capture keeps its shadows all splats have the gain of level ground.
    #[must_use]
    pub fn new(
        capture: &CaptureLight,
        new: &NewLight,
        shadows: Option<&SunShadows>,
        up: [f64; 3],
        threads: usize,
    ) -> Self {
        let level = limited(capture.light.irradiance(capture.sin_sun(up)), new.light.irradiance(new.sin_sun));
        let is_moved =
            shadows.is_some() || (capture.takes_another_sun(new.is_diffuse) && new.light.sun == [0.0; 3]);
        let follows = if is_moved { capture.takes_another_sun(new.is_diffuse) } else { capture.is_split() };
        let before = capture.mean(&capture.light);
        let after =
            shadows.map_or_else(|| capture.mean(&new.light), |shadows| capture.mean_in(&new.light, shadows));
        let gains = map(capture.len(), threads, |index| {
            if capture.is_sky(index) {
                return [new.sky_gain as f32; 3];
            }
            if !follows {
                return level;
            }
            let old = capture.surface(index, up);
            let lit = shadows.map_or(old, |shadows| capture.surface_in(index, up, shadows));
            limited(old.irradiance(&capture.light, before), lit.irradiance(&new.light, after))
        });
        let fades = new.sky_opacity < 1.0;
        let sky =
            if fades { (0..capture.len()).map(|index| capture.is_sky(index)).collect() } else { Vec::new() };
        Self { gains, sky, sky_opacity: new.sky_opacity as f32 }
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
        if !self.sky.is_empty() {
            for (index, factor) in indices.iter().zip(block.column_mut(Attribute::Visibility)) {
                if self.sky.get(*index as usize) == Some(&true) {
                    *factor *= self.sky_opacity;
                }
            }
        }
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

/// The gain from one irradiance to another. The tint of the captured light is taken away within limits; that of the new
/// light comes whole.
fn limited(before: [f64; 3], after: [f64; 3]) -> [f32; 3] {
    let [old, new] = [luminance(before).max(1e-3), luminance(after)];
    if new <= 0.0 {
        return [0.0; 3];
    }
    let strength = (new / old).min(MOST);
    std::array::from_fn(|k| {
        let untinted = (old / before[k].max(1e-3)).clamp(1.0 - TINT, 1.0 + TINT);
        (strength * untinted * after[k].max(0.0) / new) as f32
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gains_are_bounded_and_nearly_grey() {
        let gain = limited([0.05, 0.1, 0.2], [2.0; 3]);
        assert!(gain.iter().all(|v| *v <= (MOST * (1.0 + TINT)) as f32), "{gain:?}");
        assert!(f64::from(gain[0] / gain[2]) < (1.0 + TINT) / (1.0 - TINT) + 1e-6, "{gain:?}");
        assert_eq!(limited([1.0; 3], [0.0; 3]), [0.0; 3]);
    }
}
