//! The brightness that a white card would have in the photos, which turns colours into
//! reflectances.
//!
//! Nobody held a card into the photos, so what is in them tells: each kind of surface has a usual
//! reflectance, and the sky gives the light that falls. Every clue is a guess of the logarithm of
//! the brightness with an error of its own; the most likely value counts, with less trust in clues
//! that lie far from the others.

use super::places::Surfaces;
use super::quantile::quantile;
use crate::optics::{CapturedSky, Site};
use glam::Vec3;
use serde::{Deserialize, Serialize};
use wm_base::color::luminance;
use wm_scene::Metadata;

/// Usual reflectances and the error of each, as a standard deviation of its logarithm: the median
/// of ground that is not green, of walls, and of what is green, and the brightest twentieth of all
/// that is not green.
const GROUND_REFLECTANCE: [f64; 2] = [0.22, 0.4];
const WALL_REFLECTANCE: [f64; 2] = [0.3, 0.6];
const PLANT_REFLECTANCE: [f64; 2] = [0.1, 0.5];
const BRIGHT_REFLECTANCE: [f64; 2] = [0.6, 0.4];
/// Excess of green over red and blue by which plants are recognised.
const GREEN_EXCESS_RATIO: f32 = 1.06;
/// Least share of the surfaces of a kind that tells.
const LEAST_SHARE: f64 = 0.02;
/// Brightness of a card on level ground over that of the sky near the horizon: under clouds (CIE
/// overcast sky: 7/9 of the zenith, which is three times as bright as the horizon) and in an even
/// sky; and the errors.
const BY_CLOUDS: [f64; 2] = [7.0 / 3.0, 0.5];
const BY_SKY: [f64; 2] = [0.8, 0.6];
/// Brightness of the sky from which it may be burned out: it is brighter by an unknown factor
/// then.
const MIN_BURNED_BRIGHTNESS: f64 = 0.85;
/// Lower clamp of the irradiance, over that of open ground.
const MIN_IRRADIANCE: f64 = 0.01;
/// Variance of the log irradiance above which it must show in the colours.
const MIN_LOG_VARIANCE: f64 = 0.05;
/// Bounds of the brightness of a card, display values.
const CARD_BRIGHTNESS_LIMITS: [f64; 2] = [0.3, 5.0];
/// Least cosine between up and the normal of ground, and greatest of a wall.
const MIN_GROUND_COSINE: f32 = 0.8;
const MAX_WALL_COSINE: f32 = 0.3;

/// An estimate of the log brightness with its standard deviation; `is_least` if it is a lower
/// bound.
#[derive(Clone, Copy, Debug)]
struct BrightnessGuess {
    value: f64,
    error: f64,
    is_least: bool,
}

/// The brightness of white cards under a captured light.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct WhiteCard {
    /// Brightness of a card on level ground in the open, where the irradiance is 1, display values
    /// in linear light.
    open: f64,
    /// Exponent of the irradiance, 0-1: 1 where colours go with the irradiance that was found, less
    /// where they do not, since what stands in the way of the light, such as crowns without leaves,
    /// is not known well.
    trust: f64,
}

impl WhiteCard {
    /// The card of a place of which nothing is known.
    pub(crate) const USUAL: Self = Self { open: 1.0, trust: 1.0 };

    /// Finds the card of a capture. `irradiance` gives that of a surface over that of open ground,
    /// luminance; `sky_share` is the share of the sky in the light of open ground, 0-1;
    /// `is_overcast` says that the place was captured under clouds.
    pub(crate) fn new(
        surfaces: &Surfaces,
        site: &Site,
        sky_share: f64,
        is_overcast: bool,
        irradiance: impl Fn(usize) -> f64,
    ) -> Self {
        if let Some(open) = site.white_card {
            return Self { open, ..Self::USUAL };
        }
        let up = Vec3::from_array(site.up.map(|v| v as f32));
        // Logarithms of the irradiance and of the light.
        let logs = |i: usize| {
            let light = luminance(surfaces.light[i].to_array().map(f64::from));
            [irradiance(i).max(MIN_IRRADIANCE).ln(), light.max(1e-4).ln()]
        };
        let [mut ground, mut walls, mut green, mut neutral] = [const { Vec::new() }; 4];
        for i in 0..surfaces.len() {
            let normal = surfaces.normals[i];
            let color = surfaces.light[i];
            if color.y > GREEN_EXCESS_RATIO * color.x.max(color.z) {
                green.push(logs(i));
                continue;
            }
            if normal == Vec3::ZERO {
                continue;
            }
            neutral.push(logs(i));
            let rise = normal.dot(up);
            if rise > MIN_GROUND_COSINE {
                ground.push(logs(i));
            } else if rise.abs() < MAX_WALL_COSINE {
                walls.push(logs(i));
            }
        }
        let trust = slope(&neutral);
        let least = LEAST_SHARE * surfaces.len() as f64;
        let guess = |kind: &[[f64; 2]], share: f64, [usual, error]: [f64; 2]| {
            // What little light reaches is known worst.
            let lit = quantile(kind.iter().map(|log| log[0]).collect(), 0.5)?;
            let lit = kind.iter().filter(|log| log[0] >= lit);
            let cards = lit.map(|[irradiance, light]| light - trust * irradiance).collect();
            let value = quantile(cards, share).filter(|_| kind.len() as f64 >= least)?;
            Some(BrightnessGuess { value: value - usual.ln(), error, is_least: false })
        };
        let sky = luminance(site.airlight);
        let is_grey = is_overcast || site.captured_sky == CapturedSky::Overcast;
        let [by_sky, error] = if is_grey { BY_CLOUDS } else { BY_SKY };
        let knows_sky = !matches!(site.captured_sky, CapturedSky::Unknown) && sky > 0.0;
        let by_sky = knows_sky.then(|| BrightnessGuess {
            value: (sky * by_sky / sky_share.max(0.05)).ln(),
            error,
            is_least: sky > MIN_BURNED_BRIGHTNESS,
        });
        let clues: Vec<BrightnessGuess> = [
            guess(&ground, 0.5, GROUND_REFLECTANCE),
            guess(&walls, 0.5, WALL_REFLECTANCE),
            guess(&green, 0.5, PLANT_REFLECTANCE),
            guess(&neutral, 0.95, BRIGHT_REFLECTANCE),
            by_sky,
        ]
        .into_iter()
        .flatten()
        .collect();
        let open = most_likely(&clues)
            .map_or(1.0, f64::exp)
            .clamp(CARD_BRIGHTNESS_LIMITS[0], CARD_BRIGHTNESS_LIMITS[1]);
        Self { open, trust }
    }

    /// The light of a card in an irradiance, display values in linear light.
    pub(crate) fn light(&self, irradiance: f64) -> f64 {
        self.open * irradiance.max(0.0).powf(self.trust)
    }

    /// Returns true if it can be that of a capture.
    pub(crate) fn is_sound(&self) -> bool {
        Metadata::WHITE_CARDS.contains(&self.open) && (0.0..=1.0).contains(&self.trust)
    }
}

/// Returns the slope of the logarithm of light over that of irradiance, 0-1. An irradiance that
/// hardly varies counts in full: one of variance [`MIN_LOG_VARIANCE`] with which no colour goes
/// gets a slope of a half.
fn slope(logs: &[[f64; 2]]) -> f64 {
    let count = logs.len().max(1) as f64;
    let mean = [0, 1].map(|k| logs.iter().map(|log| log[k]).sum::<f64>() / count);
    let (mut both, mut own) = (0.0, 0.0);
    for log in logs {
        let [irradiance, light] = [0, 1].map(|k| log[k] - mean[k]);
        both += irradiance * light / count;
        own += irradiance * irradiance / count;
    }
    ((both + MIN_LOG_VARIANCE) / (own + MIN_LOG_VARIANCE)).clamp(0.0, 1.0)
}

/// The most likely value of clues; `None` without any.
fn most_likely(clues: &[BrightnessGuess]) -> Option<f64> {
    let mut value = clues.iter().map(|clue| clue.value).sum::<f64>() / clues.len() as f64;
    for _ in 0..20 {
        let weight = |clue: &BrightnessGuess| {
            let off = (clue.value - value) / clue.error;
            // A least value holds nothing against a greater one; what is far off counts less.
            let trust = if clue.is_least && off < 0.0 { 0.0 } else { 1.0 / (1.0 + 0.5 * off * off) };
            trust / (clue.error * clue.error)
        };
        let total: f64 = clues.iter().map(weight).sum();
        if total <= 0.0 {
            break;
        }
        value = clues.iter().map(|clue| weight(clue) * clue.value).sum::<f64>() / total;
    }
    (!clues.is_empty()).then_some(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clue(value: f64, error: f64) -> BrightnessGuess {
        BrightnessGuess { value, error, is_least: false }
    }

    #[test]
    fn clues_are_weighed() {
        assert_eq!(most_likely(&[]), None);
        assert!((most_likely(&[clue(1.0, 0.5), clue(2.0, 0.5)]).unwrap() - 1.5).abs() < 1e-9);
        assert!(most_likely(&[clue(1.0, 0.1), clue(2.0, 1.0)]).unwrap() < 1.1);
        // One that is far off hardly counts.
        let value = most_likely(&[clue(0.0, 0.3), clue(0.1, 0.3), clue(-0.1, 0.3), clue(6.0, 0.3)]).unwrap();
        assert!(value.abs() < 0.1, "{value}");
        // The sky is burned out: it may be brighter, and not darker.
        let burned = |value: f64| BrightnessGuess { value, error: 0.3, is_least: true };
        assert!((most_likely(&[clue(1.0, 0.3), burned(0.0)]).unwrap() - 1.0).abs() < 1e-6);
        assert!(most_likely(&[clue(1.0, 0.3), burned(2.0)]).unwrap() > 1.4);
    }

    #[test]
    fn irradiance_counts_as_far_as_colours_go_with_it() {
        let with = |exponent: f64| -> Vec<[f64; 2]> {
            (0..200).map(|i| f64::from(i % 20) * 0.2 - 2.0).map(|log| [log, exponent * log - 1.0]).collect()
        };
        assert!((slope(&with(1.0)) - 1.0).abs() < 1e-9 && slope(&with(0.0)) < 0.1);
        assert!(
            (slope(&with(0.5)) - 0.5).abs() < 0.05 && slope(&with(-0.5)) == 0.0 && slope(&with(2.0)) == 1.0
        );
        // In even light nothing speaks against it.
        assert_eq!(slope(&[[0.0, -1.0], [0.0, -3.0]]), 1.0);
    }
}
