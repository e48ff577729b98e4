//! The change of the light on each splat, from that of the capture to another.

use super::capture::CaptureLight;
use super::irradiance::{SceneLight, SurfaceLight};
use super::lamp_shadows::LampShadows;
use super::moving::{MovingLight, MovingSplat};
use super::placed::PlacedSurfaces;
use super::sun_shadows::SunShadows;
use crate::threads::map;
use glam::Vec3;
use wm_base::color::{luminance, srgb_decode, srgb_encode};
use wm_render::hooks::{Attribute, AttributeBlock, Revision, SplatAttributes};
use wm_scene::{Splats, sh};

/// Largest factor on the light of a splat.
const MAX_GAIN: f64 = 8.0;
/// Most of the captured light's tint that is taken away, as a share: more turns former shadows
/// neon.
const MAX_TINT_CHANGE: f64 = 0.25;
/// Lower clamp of the captured irradiance in divisions.
const MIN_IRRADIANCE: f64 = 1e-3;

/// The light that a captured place shall lie in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NewLight {
    /// Sun and sky; the unit is that of [`CaptureLight::light`].
    pub(crate) light: SceneLight,
    /// Sine of the sun's elevation.
    pub(crate) sin_sun: f64,
    /// Factor on the light of the captured sky, where it is drawn.
    pub(crate) sky_gain: f64,
    /// Factor on the opacity of the captured sky's splats, 0-1.
    pub(crate) sky_opacity: f64,
    /// The photos are said to have no shadows.
    pub(crate) is_diffuse: bool,
    /// A lux of the lamps in the unit of `light`; 0 where they are off.
    pub(crate) lamps: f64,
}

/// The shadows of a new light, and the lamps.
#[derive(Clone, Copy, Default)]
pub struct LightCasts<'a> {
    /// Shadows of a sun that stands elsewhere than the captured one.
    pub shadows: Option<&'a SunShadows>,
    /// The lamps and their shadows.
    pub lamps: Option<&'a LampShadows>,
}

/// Gains of the splats of one set, by channel.
#[derive(Clone, Debug, PartialEq)]
pub struct LightGains {
    gains: Vec<[f32; 3]>,
    /// A bit per splat: those of the captured sky, and the factor on their opacity. Empty where
    /// that is 1, and where there is no sky.
    sky: Vec<u64>,
    sky_opacity: f32,
    /// The splats on which light acts that changes from frame to frame; empty where there is no
    /// such light.
    moving: Vec<MovingSplat>,
    /// Revision of the gains and the sky's opacity.
    revision: Revision,
}

impl LightGains {
    /// The gains from the captured light to another. The sun stands where the capture's did, or
    /// where the shadows say. Where the capture keeps its shadows all splats have the gain of level
    /// ground, tinted as what faces the sun, and the lamps add to it. `points` are the places of
    /// the splats, if light acts on them that changes from frame to frame ([`MovingLight`]).
    #[must_use]
    pub fn new(
        capture: &CaptureLight,
        new: &NewLight,
        casts: LightCasts<'_>,
        points: Option<&[[f32; 3]]>,
        up: [f64; 3],
    ) -> Self {
        let LightCasts { shadows, lamps } = casts;
        let lamps = lamps.filter(|_| new.lamps > 0.0);
        let before_level = capture.light.irradiance_as_seen(capture.sin_sun(up));
        let after_level = new.light.irradiance_as_seen(new.sin_sun);
        let is_moved =
            shadows.is_some() || (capture.takes_another_sun(new.is_diffuse) && new.light.sun == [0.0; 3]);
        let follows = if is_moved { capture.takes_another_sun(new.is_diffuse) } else { capture.is_split() };
        let before_mean = capture.mean(&capture.light);
        let after_mean = capture.mean_in(&new.light, shadows);
        let light = |index: usize| {
            let lamps = lamps.map_or([0.0; 3], |lamps| lamps.lit(index).map(|v| f64::from(v) * new.lamps));
            if !follows {
                return SplatIrradiances {
                    before: before_level,
                    sky: add(after_level, lamps),
                    beam: [0.0; 3],
                };
            }
            let old = capture.surface(index, up);
            let lit = capture.surface_beside(index, capture.normal(index), up, shadows);
            SplatIrradiances {
                before: old.irradiance(&capture.light, before_mean),
                sky: add(without_sun(&lit, &new.light, after_mean), lamps),
                beam: beam(&lit, &new.light),
            }
        };
        let gains = map(capture.len(), |index| {
            if capture.is_sky(index) { [new.sky_gain as f32; 3] } else { light(index).gain() }
        });
        let moving = points.map_or_else(Vec::new, |points| {
            map(capture.len(), |index| {
                if capture.is_sky(index) {
                    return MovingSplat::default();
                }
                let open = capture.surface(index, up).open[0];
                light(index).moving(points[index], capture.normal(index), open)
            })
        });
        let mut sky = Vec::new();
        if new.sky_opacity < 1.0 {
            for index in (0..capture.len()).filter(|index| capture.is_sky(*index)) {
                sky.resize(capture.len().div_ceil(64), 0);
                sky[index / 64] |= 1 << (index % 64);
            }
        }
        Self::whole(gains, sky, new.sky_opacity as f32, moving)
    }

    /// The gains of splats that are placed on a captured scene, whose colours are those in an
    /// irradiance of 1. `moves` says that light acts on them that changes from frame to frame.
    #[must_use]
    pub fn of_placed(
        capture: &CaptureLight,
        placed: &PlacedSurfaces,
        new: &NewLight,
        casts: LightCasts<'_>,
        moves: bool,
        up: [f64; 3],
    ) -> Self {
        let LightCasts { shadows, lamps } = casts;
        let lamps = lamps.filter(|_| new.lamps > 0.0);
        let mean = capture.mean_in(&new.light, shadows);
        let light = |index: usize| {
            let normal = placed.normal(index);
            let lamps = lamps.map_or([0.0; 3], |lamps| {
                let lit = lamps.irradiance(Vec3::from_array(placed.point(index)), normal);
                lit.to_array().map(|v| f64::from(v) * new.lamps)
            });
            let surface = placed.surface(index, capture, up, shadows);
            SplatIrradiances {
                before: [1.0 / capture.exposure; 3],
                sky: add(without_sun(&surface, &new.light, mean), lamps),
                beam: beam(&surface, &new.light),
            }
        };
        let exposure = capture.exposure;
        let gains = map(placed.len(), |index| light(index).total().map(|v| (exposure * v) as f32));
        let moving = if moves {
            map(placed.len(), |index| {
                let open = placed.surface(index, capture, up, shadows).open[0];
                light(index).moving(placed.point(index), placed.normal(index), open)
            })
        } else {
            Vec::new()
        };
        Self::whole(gains, Vec::new(), 1.0, moving)
    }

    fn whole(gains: Vec<[f32; 3]>, sky: Vec<u64>, sky_opacity: f32, moving: Vec<MovingSplat>) -> Self {
        let numbers = gains.iter().flatten().chain([&sky_opacity]).map(|number| number.to_bits());
        let bits = sky.iter().flat_map(|bits| [*bits as u32, (bits >> 32) as u32]);
        let revision = Revision::of(numbers.chain(bits));
        Self { gains, sky, sky_opacity, moving, revision }
    }

    /// Adds light that acts in one frame alone.
    #[must_use]
    pub fn in_frame<'a>(&'a self, moving: Option<&'a MovingLight>) -> FrameGains<'a> {
        FrameGains { gains: self, moving: moving.filter(|_| !self.moving.is_empty()) }
    }

    /// The splats in the changed light, for programs that know no gains. Each colour is changed as
    /// the renderer does it, seen from where the spherical harmonics are neutral; these keep their
    /// share of it.
    #[must_use]
    pub fn applied(&self, splats: &Splats) -> Splats {
        let mut relit = splats.clone();
        apply_gains(&self.gains, &mut relit);
        relit
    }
}

/// Multiplies the light of splats by gains: see [`LightGains::applied`].
pub(crate) fn apply_gains(gains: &[[f32; 3]], relit: &mut Splats) {
    let stride = relit.sh_stride();
    for (index, gain) in gains.iter().enumerate() {
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
}

/// Gains in one frame.
#[derive(Clone, Copy)]
pub struct FrameGains<'a> {
    gains: &'a LightGains,
    moving: Option<&'a MovingLight>,
}

impl SplatAttributes for FrameGains<'_> {
    fn fill(&self, indices: &[u32], block: &mut AttributeBlock) {
        let LightGains { sky, sky_opacity, .. } = self.gains;
        for (index, factor) in indices.iter().zip(block.column_mut(Attribute::Visibility)) {
            let index = *index as usize;
            if sky.get(index / 64).is_some_and(|bits| bits >> (index % 64) & 1 == 1) {
                *factor *= sky_opacity;
            }
        }
    }

    fn changes_visibility(&self) -> bool {
        !self.gains.sky.is_empty()
    }

    fn fill_light(&self, indices: &[u32], block: &mut AttributeBlock) {
        let LightGains { gains, moving, .. } = self.gains;
        let [red, green, blue] = block.gains_mut();
        let rows = red.iter_mut().zip(green).zip(blue);
        for (index, ((red, green), blue)) in indices.iter().zip(rows) {
            // What pads the last group has no splat.
            [*red, *green, *blue] = gains.get(*index as usize).copied().unwrap_or([1.0; 3]);
        }
        let Some(light) = self.moving else { return };
        for (at, index) in indices.iter().enumerate() {
            let Some(splat) = moving.get(*index as usize) else { continue };
            let change = light.change(splat);
            for (k, gain) in Attribute::GAINS.into_iter().enumerate() {
                let value = &mut block.column_mut(gain)[at];
                *value = (*value + change[k]).clamp(0.0, (MAX_GAIN * (1.0 + MAX_TINT_CHANGE)) as f32);
            }
        }
    }

    fn changes_light(&self) -> bool {
        true
    }

    fn revision(&self) -> Option<Revision> {
        self.moving.is_none().then_some(self.gains.revision)
    }
}

/// The irradiances of a splat, before and after.
#[derive(Clone, Copy, Debug)]
struct SplatIrradiances {
    /// Irradiance in the capture.
    before: [f64; 3],
    /// Irradiance by the sky, by other surfaces and by lamps.
    sky: [f64; 3],
    /// Irradiance by the beam of the sun.
    beam: [f64; 3],
}

impl SplatIrradiances {
    fn total(&self) -> [f64; 3] {
        add(self.sky, self.beam)
    }

    /// The gain from one irradiance to the other. The tint of the captured light is taken away
    /// within limits, beyond them as far as the new light has it too; that of the new light comes
    /// whole.
    fn gain(&self) -> [f32; 3] {
        let after = self.total();
        let [old, new] = [luminance(self.before).max(MIN_IRRADIANCE), luminance(after)];
        if new <= 0.0 {
            return [0.0; 3];
        }
        let strength = (new / old).min(MAX_GAIN);
        std::array::from_fn(|k| {
            let tint = after[k].max(0.0) / new;
            (strength * self.untinted(k, tint) * tint) as f32
        })
    }

    /// The splat for light that changes from frame to frame.
    fn moving(&self, point: [f32; 3], normal: Vec3, open: f64) -> MovingSplat {
        // By an irradiance of 1.
        let gain = |k| self.untinted(k, 1.0) / luminance(self.before).max(MIN_IRRADIANCE);
        MovingSplat::new(point, normal, open, std::array::from_fn(gain), self.beam)
    }

    /// The factor that takes the tint of a channel away, for new light of this tint.
    fn untinted(&self, k: usize, tint: f64) -> f64 {
        let [least, most] =
            [(1.0 - MAX_TINT_CHANGE).min(1.0 / tint), (1.0 + MAX_TINT_CHANGE).max(1.0 / tint)];
        (luminance(self.before).max(MIN_IRRADIANCE) / self.before[k].max(MIN_IRRADIANCE)).clamp(least, most)
    }
}

/// Irradiance by all but the beam of the sun. `mean` is that of all surfaces.
fn without_sun(surface: &SurfaceLight, light: &SceneLight, mean: [f64; 3]) -> [f64; 3] {
    surface.irradiance(&SceneLight { sun: [0.0; 3], ..*light }, mean)
}

/// Irradiance by the beam of the sun.
fn beam(surface: &SurfaceLight, light: &SceneLight) -> [f64; 3] {
    light.sun.map(|v| v * surface.incidence * surface.sun)
}

fn add(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| a[k] + b[k])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gains_are_bounded_and_nearly_grey() {
        let gain = SplatIrradiances { before: [0.05, 0.1, 0.2], sky: [1.5; 3], beam: [0.5; 3] }.gain();
        assert!(gain.iter().all(|v| *v <= (MAX_GAIN * (1.0 + MAX_TINT_CHANGE)) as f32), "{gain:?}");
        assert!(
            f64::from(gain[0] / gain[2]) < (1.0 + MAX_TINT_CHANGE) / (1.0 - MAX_TINT_CHANGE) + 1e-6,
            "{gain:?}"
        );
        // The same light changes nothing, however blue it is.
        let same =
            SplatIrradiances { before: [0.05, 0.1, 0.4], sky: [0.05, 0.1, 0.4], beam: [0.0; 3] }.gain();
        assert!(same.iter().all(|v| (v - 1.0).abs() < 1e-6), "{same:?}");
        let none = SplatIrradiances { before: [1.0; 3], sky: [0.0; 3], beam: [0.0; 3] };
        assert_eq!(none.gain(), [0.0; 3]);
    }
}
