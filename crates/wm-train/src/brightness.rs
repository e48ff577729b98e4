//! Relative brightness of photos, by the points of the reconstruction that they share.
//!
//! A photo that is brighter than others shows the same points brighter. In logarithms,
//! `l_pi = a_i + g_p` with the colour of point i as photo p shows it, the point's own and the
//! photo's gain. Gains (medians over points) and points' colours (means over photos) are computed
//! in alternation, so that highlights and occluders do not count; the mean of the gains is 0.

use crate::photos::Photos;
use crate::priors::points::{inside, seen_points};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use wm_base::statistics::quantile;
use wm_capture::Capture;

/// Longest side of the photos in which colours are read, px.
const MAX_SIDE_PX: u32 = 500;
/// Range of colours, 0-1, that are neither crushed nor clipped.
const MIN_EXPOSED: f32 = 0.06;
const MAX_EXPOSED: f32 = 0.94;
/// Fewest points that a photo with a gain shares with others.
const MIN_SHARED_POINTS: usize = 30;
/// Most rounds: gains spread from photo to photo along a survey.
const MAX_ROUNDS: usize = 200;

/// The relative brightness of photos.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct PhotoGains {
    /// Gain of each photo for red, green and blue, display-referred; its mean over the photos is 1.
    pub(crate) gains: Vec<[f32; 3]>,
    /// Root mean square of their logarithms.
    pub(crate) spread: f64,
    /// Median absolute deviation of the logarithms of points' colours between photos, with equal
    /// gains and with these.
    pub(crate) differences: [f64; 2],
}

/// Least spread of exposures that are worth learning, and the largest ratio of the differences with
/// gains to those without: view-dependent colours leave a ratio of 1.
const MIN_SPREAD: f64 = 0.03;
const MAX_RESIDUAL_RATIO: f64 = 0.7;

impl PhotoGains {
    /// Returns true if photos differ so much that each should have an exposure of its own.
    pub(crate) fn differ(&self) -> bool {
        self.spread > MIN_SPREAD && self.differences[1] < MAX_RESIDUAL_RATIO * self.differences[0]
    }
}

/// [`PhotoGains`] by the names of photos.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct NamedGains {
    /// Root mean square of their logarithms.
    pub(crate) spread: f64,
    /// Differences of points' colours with equal gains and with these.
    pub(crate) differences: [f64; 2],
    /// Gains of red, green and blue by the names of photos.
    pub(crate) gains: BTreeMap<String, [f32; 3]>,
}

impl NamedGains {
    pub(crate) fn new(gains: &PhotoGains, names: &[String]) -> Self {
        let PhotoGains { gains, spread, differences } = gains.clone();
        Self { spread, differences, gains: names.iter().cloned().zip(gains).collect() }
    }

    /// Returns those of some photos, in their order; 1 for photos without.
    pub(crate) fn of<'a>(&self, photos: impl Iterator<Item = &'a str>) -> PhotoGains {
        let gains = photos.map(|name| self.gains.get(name).copied().unwrap_or([1.0; 3])).collect();
        PhotoGains { gains, spread: self.spread, differences: self.differences }
    }
}

/// A point as a photo shows it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct PointColor {
    point: u32,
    log: [f32; 3],
}

/// Returns the gains of the photos `places`; `None` if they share too few points. Photos that share
/// few, and damaged ones, have a gain of 1.
pub(crate) fn photo_gains(capture: &Capture, photos: &Photos, places: &[usize]) -> Option<PhotoGains> {
    let seen = seen_points(capture, photos, places);
    let shown: Vec<Vec<PointColor>> = places
        .par_iter()
        .zip(seen)
        .map(|(place, seen)| shown_points(capture, photos, *place, &seen))
        .collect();
    solve(&shown, capture.points.len())
}

/// Returns the colours of the well-exposed points among `seen` in a photo; none for a damaged
/// photo.
fn shown_points(capture: &Capture, photos: &Photos, place: usize, seen: &[u32]) -> Vec<PointColor> {
    // Damaged photos are reported by the training when it reads them.
    let Ok(photo) = photos.get(place, photos.level_within(place, MAX_SIDE_PX)) else { return Vec::new() };
    let (width, height) = (photo.width as usize, photo.height as usize);
    let color = |point: &u32| {
        let (x, y, _) = inside(capture, &photo.camera, *point)?;
        let (column, row) = (x as usize, y as usize);
        if column < 1 || row < 1 || column + 1 >= width || row + 1 >= height {
            return None;
        }
        let mut sum = [0.0f32; 3];
        for row in row - 1..=row + 1 {
            for column in column - 1..=column + 1 {
                let at = 3 * (row * width + column);
                (0..3).for_each(|c| sum[c] += f32::from(photo.rgb[at + c]));
            }
        }
        let mean = sum.map(|v| v / (9.0 * 255.0));
        let is_exposed = mean.iter().all(|v| (MIN_EXPOSED..MAX_EXPOSED).contains(v));
        is_exposed.then(|| PointColor { point: *point, log: mean.map(f32::ln) })
    };
    seen.iter().filter_map(color).collect()
}

fn solve(shown: &[Vec<PointColor>], points: usize) -> Option<PhotoGains> {
    let mut counts = vec![0u32; points];
    shown.iter().flatten().for_each(|shown| counts[shown.point as usize] += 1);
    let shared: Vec<Vec<PointColor>> = shown
        .iter()
        .map(|shown| shown.iter().copied().filter(|shown| counts[shown.point as usize] > 1).collect())
        .collect();
    if shared.iter().filter(|shown| shown.len() >= MIN_SHARED_POINTS).count() < 2 {
        return None;
    }
    let mut logs = vec![[0.0f64; 3]; shared.len()];
    let mut own = vec![[0.0f64; 3]; points];
    let mean_colors = |logs: &[[f64; 3]], own: &mut [[f64; 3]]| {
        own.fill([0.0; 3]);
        for (shown, gain) in shared.iter().zip(logs) {
            for PointColor { point, log } in shown {
                let count = f64::from(counts[*point as usize]);
                (0..3).for_each(|c| own[*point as usize][c] += (f64::from(log[c]) - gain[c]) / count);
            }
        }
    };
    let left = |logs: &[[f64; 3]], own: &[[f64; 3]]| {
        let mut offs: Vec<f64> = Vec::new();
        for (shown, gain) in shared.iter().zip(logs) {
            for PointColor { point, log } in shown {
                offs.extend((0..3).map(|c| (f64::from(log[c]) - gain[c] - own[*point as usize][c]).abs()));
            }
        }
        quantile(&mut offs, 0.5)
    };
    mean_colors(&logs, &mut own);
    let before = left(&logs, &own);
    for _ in 0..MAX_ROUNDS {
        let mut most = 0.0f64;
        for (shown, gain) in
            shared.iter().zip(&mut logs).filter(|(shown, _)| shown.len() >= MIN_SHARED_POINTS)
        {
            for c in 0..3 {
                let mut offs: Vec<f64> =
                    shown.iter().map(|s| f64::from(s.log[c]) - own[s.point as usize][c]).collect();
                let next = quantile(&mut offs, 0.5);
                most = most.max((next - gain[c]).abs());
                gain[c] = next;
            }
        }
        for c in 0..3 {
            let mean = logs.iter().map(|gain| gain[c]).sum::<f64>() / logs.len() as f64;
            logs.iter_mut().for_each(|gain| gain[c] -= mean);
        }
        mean_colors(&logs, &mut own);
        if most < 1e-4 {
            break;
        }
    }
    let after = left(&logs, &own);
    let spread = (logs.iter().flatten().map(|v| v * v).sum::<f64>() / (3 * logs.len()) as f64).sqrt();
    let mut gains: Vec<[f64; 3]> = logs.iter().map(|gain| gain.map(f64::exp)).collect();
    for c in 0..3 {
        let mean = gains.iter().map(|gain| gain[c]).sum::<f64>() / gains.len() as f64;
        gains.iter_mut().for_each(|gain| gain[c] /= mean);
    }
    let gains = gains.into_iter().map(|gain| gain.map(|v| v as f32)).collect();
    Some(PhotoGains { gains, spread, differences: [before, after] })
}

#[cfg(test)]
mod tests {
    use super::*;
    use wm_base::random::uniform;

    /// Photos along a way, each with the points of its neighbours, noise and some strays.
    #[test]
    fn gains_are_found_along_a_survey() {
        let (photos, points) = (12usize, 600usize);
        let gain = |photo: usize, c: usize| 0.2 * (photo as f64 * 1.7 + c as f64).sin();
        let photo = |p: usize| -> Vec<PointColor> {
            (0..points)
                .filter(|i| (i * photos / points).abs_diff(p) <= 1)
                .map(|i| {
                    let u = |k: usize| uniform(k as u64, (p * points + i) as u64);
                    let stray = if u(5) < 0.1 { 1.0 } else { 0.0 };
                    let log = [0, 1, 2].map(|c| {
                        (-1.0 + uniform(9, i as u64) + gain(p, c) + 0.05 * (u(c) - 0.5) + stray) as f32
                    });
                    PointColor { point: i as u32, log }
                })
                .collect()
        };
        let shown: Vec<Vec<PointColor>> = (0..photos).map(photo).collect();
        let found = solve(&shown, points).unwrap();
        assert!((found.spread - 0.14).abs() < 0.03, "{}", found.spread);
        assert!(found.differences[1] < 0.3 * found.differences[0], "{:?}", found.differences);
        let mean = (0..photos).map(|p| gain(p, 1).exp()).sum::<f64>() / photos as f64;
        for (p, gains) in found.gains.iter().enumerate() {
            let off = f64::from(gains[1]) / (gain(p, 1).exp() / mean) - 1.0;
            assert!(off.abs() < 0.03, "{p}: {off}");
        }
        assert!(found.differ());
        let even: Vec<Vec<PointColor>> = shown
            .iter()
            .enumerate()
            .map(|(p, shown)| {
                shown
                    .iter()
                    .map(|s| PointColor { log: [0, 1, 2].map(|c| s.log[c] - gain(p, c) as f32), ..*s })
                    .collect()
            })
            .collect();
        assert!(!solve(&even, points).unwrap().differ());
        assert_eq!(solve(&shown[..1], points), None);
    }
}
