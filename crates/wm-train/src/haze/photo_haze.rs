//! Haze of photos, and how it is measured.

#[cfg(test)]
mod tests;

use super::fit::{FreeParameters, HazeFit};
use super::sightings::{PointTrack, tracks};
use crate::brightness::PhotoGains;
use crate::photos::Photos;
use glam::DVec3;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::ops::Range;
use wm_base::color::{srgb_decode, srgb_encode};
use wm_base::statistics::quantile;
use wm_capture::Capture;
use wm_render::EvenAir;
use wm_scene::Metadata;
use wm_scene::SparsePoints;
use wm_scene::metadata::MOR_DEPTH;

/// Fewest tracks from which haze is measured.
const MIN_TRACKS: usize = 150;
/// Most tracks that are fitted.
const MAX_TRACKS: usize = 10_000;
/// Largest ratio of the least to the largest distance from which a point is seen: points that are
/// seen from about one distance say nothing about haze.
const MAX_NEARNESS: f32 = 0.95;
/// Most photos in a fit, each with a gain of its own.
const MAX_PHOTOS: usize = 300;
/// Rank, among the distances of sightings, from which they tell how distant surfaces look.
const FAR_RANK: f64 = 0.7;
/// Relative error of the extinction due to cameras' compression of bright light: 7 to 10 % in three
/// synthetic captures.
const TONE_CURVE_ERROR: f64 = 0.08;
/// Parts of the tracks, each of which is left out once to estimate the error (jackknife).
const JACKKNIFE_PARTS: usize = 10;
/// Approximate ratio of logarithms of linear light to those of display-referred values.
const DISPLAY_GAMMA: f64 = 2.2;
/// Least transmittance by which colours are divided, so that noise stays bounded.
const MIN_DIVISOR: f64 = 0.15;
/// Cells along the longest side of the scene; errors of points in one cell are correlated.
const CELLS_PER_SIDE: f64 = 6.0;

/// Even, grey haze.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PhotoHaze {
    /// Extinction, 1 / scene unit.
    pub(crate) extinction: f64,
    /// The standard deviation of the extinction; `None` if the extinction was given.
    pub(crate) error: Option<f64>,
    /// Extinction, 1 / scene unit, with which a render looks as hazy as the photos. It exceeds the
    /// physical one, since cameras compress bright light, that of endless haze most.
    pub(crate) shown: f64,
    /// Light of endless haze as photos show it, linear RGB, 1 = display white.
    pub(crate) airlight: [f64; 3],
}

impl PhotoHaze {
    /// Measures the haze of the photos `places`, and their gains; `None` if there is none, or
    /// nothing proves it.
    ///
    /// `horizon` is the sky just above the horizon, linear RGB: the light of endless haze, if
    /// photos show it. Without it the light is fitted too, which tells less of the extinction:
    /// thick haze of little light dims as thin haze of much light does.
    pub(crate) fn measured(
        capture: &Capture,
        photos: &Photos,
        places: &[usize],
        horizon: Option<[f64; 3]>,
    ) -> Option<(Self, PhotoGains)> {
        let known = KnownHaze { extinction: None, airlight: horizon };
        let evidence = Evidence::of_photos(capture, photos, places, known).filter(Evidence::proves)?;
        Some((evidence.haze, evidence.gains))
    }

    /// Returns haze of a given extinction (1 / scene unit) and the gains of the photos `places`.
    /// The airlight is that of `horizon`, or is fitted. `None` if the photos share too few points.
    pub(crate) fn given(
        capture: &Capture,
        photos: &Photos,
        places: &[usize],
        extinction: f64,
        horizon: Option<[f64; 3]>,
    ) -> Option<(Self, PhotoGains)> {
        let known = KnownHaze { extinction: Some(extinction), airlight: horizon };
        let Evidence { haze, gains, .. } = Evidence::of_photos(capture, photos, places, known)?;
        Some((Self { airlight: haze.airlight.map(|v| v.clamp(0.0, 1.5)), ..haze }, gains))
    }

    /// Returns the haze stated in a scene's metadata.
    pub(crate) fn of(metadata: &Metadata) -> Option<Self> {
        let (extinction, airlight) = (metadata.haze_extinction?, metadata.haze_airlight?);
        let shown = metadata.haze_shown_extinction.unwrap_or(extinction);
        Some(Self { extinction, error: metadata.haze_extinction_error, shown, airlight })
    }

    /// Writes the haze into a scene's metadata.
    pub(crate) fn note(&self, metadata: &mut Metadata) {
        metadata.haze_extinction = Some(self.extinction);
        metadata.haze_extinction_error = self.error;
        metadata.haze_shown_extinction = Some(self.shown);
        metadata.haze_airlight = Some(self.airlight);
    }

    /// Returns the extinction for a meteorological optical range, in the reciprocal of its unit.
    pub(crate) fn extinction_of(mor: f64) -> f64 {
        MOR_DEPTH / mor
    }

    /// Returns the medium for rendering.
    pub(crate) fn air(&self) -> EvenAir {
        EvenAir { extinction: self.shown as f32, airlight: self.airlight.map(|v| v as f32) }
    }

    /// Returns the transmittance over `distance`, scene units, as photos show it.
    pub(crate) fn transmittance(&self, distance: f64) -> f64 {
        (-self.shown * distance).exp()
    }

    /// Returns the clear colour (sRGB) of a surface that a photo shows as `rgb` through haze of the
    /// given transmittance.
    pub(crate) fn clear_color(&self, rgb: [u8; 3], transmittance: f64) -> [u8; 3] {
        // A smaller divisor would amplify noise.
        let kept = transmittance.max(MIN_DIVISOR);
        std::array::from_fn(|c| {
            let light = srgb_decode(f64::from(rgb[c]) / 255.0);
            let clear = (light - self.airlight[c] * (1.0 - kept)) / kept;
            (255.0 * srgb_encode(clear)).round().clamp(0.0, 255.0) as u8
        })
    }

    /// Takes the haze out of the colours of the points of `capture`, which are means over the
    /// photos that show them.
    pub(crate) fn clear_points(&self, capture: &Capture, points: &mut SparsePoints) {
        let mut kept = vec![(0.0f64, 0u32); points.len()];
        for (view, observed) in capture.views.iter().zip(&capture.observations) {
            let center = view.camera.center();
            for seen in observed {
                let at = DVec3::from_array(points.positions[seen.point as usize]);
                let (sum, count) = &mut kept[seen.point as usize];
                (*sum, *count) = (*sum + self.transmittance(center.distance(at)), *count + 1);
            }
        }
        for (color, (sum, count)) in points.colors.iter_mut().zip(kept) {
            if count > 0 {
                *color = self.clear_color(*color, sum / f64::from(count));
            }
        }
    }
}

/// Largest ratio of residuals with haze to those without: other changes of colour with distance
/// leave more.
const MAX_RESIDUAL_RATIO: f64 = 0.85;
/// Least number of standard deviations by which the extinction is above 0.
const MIN_DEVIATIONS: f64 = 4.0;
/// Least optical depth at the farthest points: thinner haze is hardly visible and not worth an
/// error.
const MIN_OPTICAL_DEPTH: f64 = 0.15;
/// Least ratio of the airlight to the median light of the photos: haze does not darken everything.
const MIN_AIRLIGHT_RATIO: f64 = 0.5;

/// Largest airlight, linear: photos are exposed for surfaces that it lights.
const MAX_AIRLIGHT: f64 = 2.0;
/// Largest ratio, either way, of the measured extinction to the shown one; they differ only by the
/// cameras' compression of bright light.
const MAX_SHOWN_RATIO: f64 = 2.0;

/// Range of the ratio of the horizon's light to the fitted airlight; outside it the horizon is not
/// sky.
const HORIZON_RATIO: Range<f64> = 0.7..1.15;

/// Values of the haze that are known before tracks are looked at.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct KnownHaze {
    extinction: Option<f64>,
    airlight: Option<[f64; 3]>,
}

/// The haze fitted to the tracks of a capture, proven or not.
#[derive(Clone, Debug, PartialEq)]
struct Evidence {
    haze: PhotoHaze,
    /// Airlight fitted to the tracks alone, linear.
    airlight: [f64; 3],
    gains: PhotoGains,
    /// Standard deviation of residuals with haze over that without.
    left: f64,
    /// 95th percentile of the distances of sightings, scene units.
    far: f64,
    /// Median of the light in the photos, linear.
    median: f64,
}

impl Evidence {
    /// Returns true if the haze is significant and plausible.
    fn proves(&self) -> bool {
        let PhotoHaze { extinction, error, shown, .. } = self.haze;
        let least = self.airlight.into_iter().fold(f64::INFINITY, f64::min);
        let most = self.airlight.into_iter().fold(0.0, f64::max);
        self.left < MAX_RESIDUAL_RATIO
            && extinction > MIN_DEVIATIONS * error.unwrap_or(0.0)
            && extinction * self.far > MIN_OPTICAL_DEPTH
            && least > MIN_AIRLIGHT_RATIO * self.median
            && most < MAX_AIRLIGHT
            && shown < MAX_SHOWN_RATIO * extinction
            && MAX_SHOWN_RATIO * shown > extinction
    }

    /// Fits haze to the points that the photos `places` share; `None` if they are too few. Known
    /// values are kept.
    fn of_photos(capture: &Capture, photos: &Photos, places: &[usize], known: KnownHaze) -> Option<Self> {
        let step = places.len().div_ceil(MAX_PHOTOS).max(1);
        let some: Vec<usize> = places.iter().copied().step_by(step).collect();
        let tracks = tracks(capture, photos, &some);
        let mut found = Self::of(tracks, &capture.points.positions, some.len(), known)?;
        if step > 1 {
            // Gains of the photos in between are not known.
            found.gains = PhotoGains { gains: vec![[1.0; 3]; places.len()], ..PhotoGains::default() };
        }
        Some(found)
    }

    /// Fits haze to the tracks of `photos` photos; `positions` are those of the points.
    fn of(
        mut tracks: Vec<PointTrack>,
        positions: &[[f64; 3]],
        photos: usize,
        known: KnownHaze,
    ) -> Option<Self> {
        tracks.retain(|track| nearness(track) < MAX_NEARNESS);
        if tracks.len() < MIN_TRACKS {
            return None;
        }
        let step = tracks.len().div_ceil(MAX_TRACKS);
        let tracks: Vec<PointTrack> = tracks.into_iter().step_by(step).collect();
        let sightings = || tracks.iter().flat_map(|track| &track.sightings);
        let mut distances: Vec<f64> = sightings().map(|sighting| f64::from(sighting.distance)).collect();
        distances.sort_by(f64::total_cmp);
        let (unit, far) = (distances[distances.len() / 2], distances[distances.len() * 95 / 100]);
        let mut lights: Vec<f64> = sightings().flat_map(|sighting| sighting.light.map(f64::from)).collect();
        let median = quantile(&mut lights, 0.5);

        let all: Vec<&PointTrack> = tracks.iter().collect();
        let clear = HazeFit::clear(photos).fitted(&all, unit, FreeParameters::Gains);
        let from = |beta: f64, airlight: Option<[f64; 3]>| {
            let added = airlight.unwrap_or([median; 3]).map(|light| light * beta);
            HazeFit { beta, added, airlight, ..clear.clone() }.fitted(&all, unit, FreeParameters::Light)
        };
        // Fits start from thin and from thick air, since the cost has several minima.
        let best = |airlight: Option<[f64; 3]>| {
            let fits = [0.1, 1.0].map(|beta| from(beta, airlight).fitted(&all, unit, FreeParameters::All));
            fits.into_iter().min_by(|a, b| a.sigma.total_cmp(&b.sigma))
        };
        let light = |fit: &HazeFit| fit.added.map(|added| added / fit.beta);
        let (fit, error) = match known.extinction {
            Some(extinction) => (from(extinction * unit, known.airlight), None),
            None => {
                // The horizon is not used here: the sky is brighter than distant haze in photos.
                let fit = best(None)?;
                let error = error(&fit, &tracks, &parts(&tracks, positions), unit) / unit;
                (fit, Some(error))
            }
        };
        let fitted = light(&fit);
        let is_like = |horizon: &[f64; 3]| (0..3).all(|c| HORIZON_RATIO.contains(&(horizon[c] / fitted[c])));
        let horizon = known.airlight.filter(|horizon| known.extinction.is_some() || is_like(horizon));
        let shown = match (known.extinction, horizon) {
            (None, Some(_)) => far_fit(&best(horizon)?, &tracks, unit, &distances).beta,
            _ => fit.beta,
        };
        let haze = PhotoHaze {
            extinction: fit.beta / unit,
            error: error.map(|error| error.hypot(TONE_CURVE_ERROR * fit.beta / unit)),
            shown: shown / unit,
            airlight: horizon.unwrap_or(fitted),
        };
        let gains = gains(&fit, fit.sigma_of_even(&all, unit));
        Some(Self { haze, airlight: fitted, gains, left: fit.sigma / clear.sigma, far, median })
    }
}

/// Fits again, with the known airlight, to the farthest sightings alone; returns `fit` if these are
/// too few.
///
/// Cameras compress bright light, and the more haze there is before a surface the brighter it is:
/// the extinction that photos show grows with the distance. A wrong value matters most far away,
/// while most tracks are of near points.
fn far_fit(fit: &HazeFit, tracks: &[PointTrack], unit: f64, distances: &[f64]) -> HazeFit {
    let from = distances[(FAR_RANK * distances.len() as f64) as usize] as f32;
    let far = |track: &PointTrack| {
        let some = track.sightings.iter().copied().filter(|sighting| sighting.distance > from);
        PointTrack { point: track.point, sightings: some.collect() }
    };
    let mut far: Vec<PointTrack> = tracks.iter().map(far).collect();
    far.retain(|track| track.sightings.len() > 1 && nearness(track) < MAX_NEARNESS);
    if far.len() < MIN_TRACKS {
        return fit.clone();
    }
    fit.clone().fitted(&far.iter().collect::<Vec<_>>(), unit, FreeParameters::All)
}

/// Returns the gains of a fit, display-referred; `even` is the deviation of residuals with equal
/// exposures.
fn gains(fit: &HazeFit, even: f64) -> PhotoGains {
    let logs: Vec<f64> = fit.gains.iter().map(|gain| gain / DISPLAY_GAMMA).collect();
    let count = logs.len().max(1) as f64;
    let spread = (logs.iter().map(|v| v * v).sum::<f64>() / count).sqrt();
    let mean = logs.iter().map(|log| log.exp()).sum::<f64>() / count;
    let gains = logs.iter().map(|log| [(log.exp() / mean) as f32; 3]).collect();
    PhotoGains { gains, spread, differences: [even, fit.sigma] }
}

/// Returns the standard deviation of a fit's extinction, by the jackknife over parts of the tracks.
fn error(fit: &HazeFit, tracks: &[PointTrack], parts: &[usize], unit: f64) -> f64 {
    let without = |part: usize| {
        let rest = tracks.iter().zip(parts).filter(|(_, own)| **own != part);
        let rest: Vec<&PointTrack> = rest.map(|(track, _)| track).collect();
        fit.clone().fitted(&rest, unit, FreeParameters::All).beta
    };
    let found: Vec<f64> = (0..JACKKNIFE_PARTS).into_par_iter().map(without).collect();
    let mean = found.iter().sum::<f64>() / JACKKNIFE_PARTS as f64;
    let squares = found.iter().map(|beta| (beta - mean).powi(2)).sum::<f64>();
    (squares * (JACKKNIFE_PARTS - 1) as f64 / JACKKNIFE_PARTS as f64).sqrt()
}

/// Returns the ratio of the least to the largest distance of a point's sightings.
fn nearness(track: &PointTrack) -> f32 {
    let distances = track.sightings.iter().map(|sighting| sighting.distance);
    let (least, most) =
        distances.fold((f32::INFINITY, 0.0f32), |(least, most), d| (least.min(d), most.max(d)));
    least / most
}

/// Assigns each track to a part: the cells of the scene are dealt to the parts in turn.
fn parts(tracks: &[PointTrack], positions: &[[f64; 3]]) -> Vec<usize> {
    let at = |track: &PointTrack| positions[track.point as usize];
    let mut size = 0.0f64;
    for axis in 0..3 {
        let mut along: Vec<f64> = tracks.iter().map(|track| at(track)[axis]).collect();
        along.sort_by(f64::total_cmp);
        size = size.max(along[along.len() * 95 / 100] - along[along.len() * 5 / 100]);
    }
    let cell =
        |track: &PointTrack| at(track).map(|v| (v / (size / CELLS_PER_SIDE).max(1e-12)).floor() as i64);
    let mut cells: BTreeMap<[i64; 3], usize> = tracks.iter().map(|track| (cell(track), 0)).collect();
    cells.values_mut().enumerate().for_each(|(number, part)| *part = number % JACKKNIFE_PARTS);
    tracks.iter().map(|track| cells[&cell(track)]).collect()
}
