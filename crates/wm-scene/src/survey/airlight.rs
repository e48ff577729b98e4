//! The airlight: the colour that fog has where nothing is seen through it any more.
//!
//! In daylight it is about the mean radiance of the sky near the horizon. Where a scene has a sky,
//! its splats say it; where not, the brightest surfaces give a measure of the daylight.

use super::linear::quantile;
use super::sample::SurveySample;
use super::sky::SkyRegion;
use crate::color::{luminance, srgb_decode};
use crate::{Splats, sh};
use glam::DVec3;

/// Brightest airlight: a sky that photos burned out says "white or more", and fog at display white
/// would show no shape and no snow before it.
const MOST: f64 = 0.9;
/// Darkest airlight without a sky: a shady courtyard does not make a dark fog.
const LEAST: f64 = 0.35;
/// Brightest airlight without a sky: what is white in the sun is brighter than fog in the light
/// that fog lets through.
const MOST_WITHOUT_SKY: f64 = 0.62;
/// Colour of daylight fog without a sky: a touch of blue.
const TINT: [f64; 3] = [0.97, 1.0, 1.05];
/// Most blue against red. A clear sky is blue above; fog is lit by it and by the sun, and white at
/// the horizon.
const BLUEST: f64 = 1.1;
/// Upper edges of the bands above the horizon that are tried, as sines: 20 and 40 degrees, all.
const BANDS: [f64; 3] = [0.342, 0.643, 1.0];
/// Share of the seen sky that a band needs.
const ENOUGH: f64 = 0.04;

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

/// Blue against red above which a piece of the sky is blue: overcast skies have 1.0 to 1.1 of it.
const BLUE: f64 = 1.3;
/// Share of the upper sky that is blue under a sun, clouds between.
const LEAST_BLUE: f64 = 0.15;
/// Sine of the elevation from which on a sky is blue if it is clear: 17 degrees.
const UPPER: f64 = 0.3;
/// Light of a channel that is burned out in photos, and the share of the sky that may be.
const BURNED: f64 = 0.93;
const MOST_BURNED: f64 = 0.5;

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
    for SkyPatch { weight, rgb, .. } in patches.filter(|patch| patch.sin > UPPER) {
        all += weight;
        burned += if rgb[0] >= BURNED { weight } else { 0.0 };
        blue += if rgb[2] > BLUE * rgb[0] { weight } else { 0.0 };
    }
    if blue > LEAST_BLUE * all {
        CapturedSky::Clear
    } else if all <= 0.0 {
        CapturedSky::Unknown
    } else if burned > MOST_BURNED * all {
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
    let typical = median_luminance(&mut patches)?;
    patches.retain(|p| luminance(p.rgb) >= 0.65 * typical);
    let seen: f64 = patches.iter().map(|p| p.weight).sum();
    let mean =
        BANDS.into_iter().find_map(|band| mean(patches.iter().filter(|p| p.sin <= band), ENOUGH * seen));
    mean.map(|mean| whitened(mean, sunlit))
}

/// The colour with no more blue than daylight fog has: the light of the sky with as much of the
/// sun's as that takes.
fn whitened(rgb: [f64; 3], sunlit: f64) -> [f64; 3] {
    let [red, _, blue] = rgb;
    let grey = luminance(rgb).max(sunlit);
    if blue <= BLUEST * red {
        return rgb;
    }
    // The share of grey g at which (1 - g) blue + g grey is as often the red.
    let over = blue - BLUEST * red;
    let share = over / (over + (BLUEST - 1.0) * grey);
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

/// Weighted median of the luminance; the patches are sorted by it.
fn median_luminance(patches: &mut [SkyPatch]) -> Option<f64> {
    patches.sort_by(|a, b| luminance(a.rgb).total_cmp(&luminance(b.rgb)));
    let half = 0.5 * patches.iter().map(|p| p.weight).sum::<f64>();
    let mut sum = 0.0;
    let middle = patches.iter().find(|patch| {
        sum += patch.weight;
        sum >= half
    });
    middle.map(|patch| luminance(patch.rgb))
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
    let scale = (MOST / luminance(mean).max(MOST)).min(1.0);
    (weight > 0.0 && weight >= least).then(|| mean.map(|v| v * scale))
}

fn from_surfaces(splats: &Splats, sample: &SurveySample) -> [f64; 3] {
    let displayed = |index: usize, at: DVec3| {
        let direction = (at - sample.center).normalize_or_zero().to_array();
        luminance(sh::color(splats.sh_of(index), direction).map(|v| v.clamp(0.0, 1.0)))
    };
    let mut values: Vec<f64> = sample.points.iter().map(|p| displayed(p.index, p.at)).collect();
    let bright = srgb_decode(quantile(&mut values, 0.95)).clamp(LEAST, MOST_WITHOUT_SKY);
    TINT.map(|v| v * bright / luminance(TINT))
}
