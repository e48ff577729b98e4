//! The airlight: the colour that fog has where nothing is seen through it any more.
//!
//! In daylight it is about the mean radiance of the sky near the horizon. Where a scene has a sky,
//! its splats say it; where not, the brightest surfaces give a measure of the daylight.

use super::middle::weighted_median;
use super::sample::SurveySample;
use super::sky::SkyRegion;
use crate::{Splats, sh};
use glam::DVec3;
use wm_base::color::{luminance, srgb_decode};
use wm_base::statistics::quantile;

/// Brightest airlight: photos show a burned-out sky as "white or more", and fog at display white
/// would show no shape and no snow in front of it.
const MAX_AIRLIGHT: f64 = 0.9;
/// Darkest airlight without a sky: a shady courtyard does not make a dark fog.
const MIN_SURFACE_AIRLIGHT: f64 = 0.35;
/// Brightest airlight without a sky: white surfaces in the sun are brighter than fog in the light
/// that fog transmits.
const MAX_SURFACE_AIRLIGHT: f64 = 0.62;
/// Colour of daylight fog without a sky: a touch of blue.
const FOG_TINT: [f64; 3] = [0.97, 1.0, 1.05];
/// Largest ratio of blue to red. A clear sky is blue above; fog is lit by it and by the sun, and
/// white at the horizon.
const MAX_BLUE_RATIO: f64 = 1.1;
/// Upper edges of the bands above the horizon that are tried, as sines: 20 and 40 degrees, all.
const BAND_SINES: [f64; 3] = [0.342, 0.643, 1.0];
/// Least share of the visible sky in a band.
const MIN_BAND_SHARE: f64 = 0.04;

/// The airlight, linear RGB, 1 = display white.
pub(crate) fn estimate(splats: &Splats, sample: &SurveySample, sky: &SkyRegion, up: DVec3) -> [f64; 3] {
    let surfaces = from_surfaces(splats, sample);
    from_sky(splats, sample, sky, up, luminance(surfaces)).unwrap_or(surfaces)
}

/// A piece of a sky.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SkyPatch {
    /// Sine of its elevation.
    pub sin: f64,
    /// Solid angle times opacity, in any unit.
    pub weight: f64,
    /// Radiance, linear RGB, 1 = display white.
    pub rgb: [f64; 3],
}

/// The sky of a capture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CapturedSky {
    /// It is not in the scene.
    #[default]
    Unknown,
    /// Too bright in the photos to tell, or grey over a place with shadows.
    Burned,
    /// Blue, with or without clouds: there is a sun.
    Clear,
    /// Grey: the light is diffuse.
    Overcast,
}

/// Least ratio of blue to red of a blue piece of the sky: overcast skies have 1.0 to 1.1.
const MIN_BLUE_RATIO: f64 = 1.3;
/// Least share of the upper sky that is blue under a sun, between clouds.
const MIN_BLUE_SHARE: f64 = 0.15;
/// Sine of the elevation above which a clear sky is blue: 17 degrees.
const UPPER_SKY_SINE: f64 = 0.3;
/// Least light of a channel that is burned out in photos.
const BURNED_LIGHT: f64 = 0.93;
/// Largest share of the sky that may be burned out.
const MAX_BURNED_SHARE: f64 = 0.5;

/// Tells a clear sky from an overcast one by its colour.
pub(super) fn captured_sky(
    splats: &Splats,
    sample: &SurveySample,
    sky: &SkyRegion,
    up: DVec3,
) -> CapturedSky {
    let indices = sky.indices(splats).into_iter().filter(|index| splats.is_sound(*index));
    let patches = indices.map(|index| patch(splats, index, sample.center, up));
    let (mut all, mut burned, mut blue) = (0.0, 0.0, 0.0);
    for SkyPatch { weight, rgb, .. } in patches.filter(|patch| patch.sin > UPPER_SKY_SINE) {
        all += weight;
        burned += if rgb[0] >= BURNED_LIGHT { weight } else { 0.0 };
        blue += if rgb[2] > MIN_BLUE_RATIO * rgb[0] { weight } else { 0.0 };
    }
    if blue > MIN_BLUE_SHARE * all {
        CapturedSky::Clear
    } else if all <= 0.0 {
        CapturedSky::Unknown
    } else if burned > MAX_BURNED_SHARE * all {
        CapturedSky::Burned
    } else {
        CapturedSky::Overcast
    }
}

fn from_sky(
    splats: &Splats,
    sample: &SurveySample,
    sky: &SkyRegion,
    up: DVec3,
    sunlit: f64,
) -> Option<[f64; 3]> {
    let indices = sky.indices(splats).into_iter().filter(|index| splats.is_sound(*index));
    let mut patches: Vec<SkyPatch> = indices.map(|index| patch(splats, index, sample.center, up)).collect();
    let mut weights: Vec<f64> = patches.iter().map(|p| p.weight).collect();
    let most = quantile(&mut weights, 0.95);
    for patch in &mut patches {
        patch.weight = patch.weight.min(most);
    }
    airlight_of_sky(patches, sunlit)
}

/// The airlight under a sky, linear RGB; `None` without patches of any weight.
///
/// The mean radiance within 20 degrees of the horizon, of higher bands where too little is seen
/// there; at most 0.9 of display white, and no bluer than daylight fog is. What lies below the
/// horizon counts only where nothing lies above it; what is far darker than the rest is taken for
/// no sky. A blue sky has a sun, which lights fog as it lights the brightest surfaces: their
/// luminance is `sunlit`, 0 where none is known.
#[must_use]
pub fn airlight_of_sky(mut patches: Vec<SkyPatch>, sunlit: f64) -> Option<[f64; 3]> {
    // A shell may close under the ground, where it has no light of its own.
    if patches.iter().any(|p| p.sin > 0.0) {
        patches.retain(|p| p.sin > 0.0);
    }
    // What is far darker than the rest was never seen: it lies behind houses, and training left
    // anything there.
    patches.sort_by(|a, b| luminance(a.rgb).total_cmp(&luminance(b.rgb)));
    let typical = weighted_median(patches.iter().map(|p| (luminance(p.rgb), p.weight)))?;
    patches.retain(|p| luminance(p.rgb) >= 0.65 * typical);
    let seen: f64 = patches.iter().map(|p| p.weight).sum();
    let mean = BAND_SINES
        .into_iter()
        .find_map(|band| mean(patches.iter().filter(|p| p.sin <= band), MIN_BAND_SHARE * seen));
    mean.map(|mean| whitened(mean, sunlit))
}

/// The colour with no more blue than daylight fog has: the light of the sky with as much of the
/// sun's as that takes.
fn whitened(rgb: [f64; 3], sunlit: f64) -> [f64; 3] {
    let [red, _, blue] = rgb;
    let grey = luminance(rgb).max(sunlit);
    if blue <= MAX_BLUE_RATIO * red {
        return rgb;
    }
    // The share of grey g at which (1 - g) blue + g grey is as often the red.
    let over = blue - MAX_BLUE_RATIO * red;
    let share = over / (over + (MAX_BLUE_RATIO - 1.0) * grey);
    rgb.map(|v| (1.0 - share) * v + share * grey)
}

fn patch(splats: &Splats, index: usize, center: DVec3, up: DVec3) -> SkyPatch {
    let offset = DVec3::from_array(splats.means[index].map(f64::from)) - center;
    let mut scales = splats.scales(index);
    scales.sort_by(f64::total_cmp);
    let solid_angle = scales[1] * scales[2] / offset.length_squared();
    let direction = offset.normalize_or_zero();
    let rgb = light(splats, index, direction);
    SkyPatch { sin: direction.dot(up), weight: solid_angle * splats.opacity(index), rgb }
}

/// The linear colour of a splat seen in a direction, 0-1.
fn light(splats: &Splats, index: usize, direction: DVec3) -> [f64; 3] {
    sh::color(splats.sh_of(index), direction.to_array()).map(|v| srgb_decode(v.clamp(0.0, 1.0)))
}

/// Mean radiance; `None` if the patches have no weight or less than `least` in all.
fn mean<'a>(patches: impl Iterator<Item = &'a SkyPatch>, least: f64) -> Option<[f64; 3]> {
    let (mut sum, mut weight) = ([0.0; 3], 0.0);
    for patch in patches {
        weight += patch.weight;
        for (sum, value) in sum.iter_mut().zip(patch.rgb) {
            *sum += value * patch.weight;
        }
    }
    let mean = sum.map(|v| v / weight);
    (weight > 0.0 && weight >= least).then(|| limited_airlight(mean))
}

/// Scales an airlight, linear RGB, down to a luminance of at most 0.9.
pub fn limited_airlight(rgb: [f64; 3]) -> [f64; 3] {
    let scale = (MAX_AIRLIGHT / luminance(rgb).max(MAX_AIRLIGHT)).min(1.0);
    rgb.map(|v| v * scale)
}

fn from_surfaces(splats: &Splats, sample: &SurveySample) -> [f64; 3] {
    let displayed = |index: usize, at: DVec3| {
        let direction = (at - sample.center).normalize_or_zero().to_array();
        luminance(sh::color(splats.sh_of(index), direction).map(|v| v.clamp(0.0, 1.0)))
    };
    let mut values: Vec<f64> = sample.points.iter().map(|p| displayed(p.index, p.at)).collect();
    let bright = srgb_decode(quantile(&mut values, 0.95)).clamp(MIN_SURFACE_AIRLIGHT, MAX_SURFACE_AIRLIGHT);
    FOG_TINT.map(|v| v * bright / luminance(FOG_TINT))
}
