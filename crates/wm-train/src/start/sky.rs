//! The sky: splats on a far half sphere, in the colours that photos show there.
//!
//! Reconstructions have no points in the sky. Without these splats the sky is painted on floaters
//! near and far, which fog would hide like near objects. They are not trained, since they would
//! take the colours of objects in front while those are still transparent.

use crate::priors::SkyClass;
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};
use wm_base::linear::direction;
use wm_scene::SparsePoints;
use wm_scene::splats::{Splat, logit};
use wm_scene::{Camera, Group, Splats};

/// Least radius of the sky, in extents of the scene.
const SKY_RADIUS_EXTENTS: f64 = 20.0;
/// Sine of the elevation at which the sky begins: 5 degrees below the horizon, since up is known
/// to a few degrees.
const LOWEST_SINE: f64 = -0.09;
/// Standard deviation of splats in distances to their neighbours, and their opacity: leaves no
/// gaps.
const SPLAT_SCALE: f64 = 0.7;
const SPLAT_OPACITY: f64 = 0.9;
/// Least share of the half sphere that photos show: less is a gap in a crown, or no sky.
const MIN_SHOWN_SHARE: f64 = 0.004;

/// Colours between these, 0-1, are more and more likely clipped.
const CLIPPED_RANGE: [f32; 2] = [0.95, 0.99];
/// Weight of a clipped colour beside one that is not.
const CLIPPED_WEIGHT: f32 = 0.05;
/// Share of a photo's width and height over which its weight falls off to its border, so that no
/// border shows.
const BORDER_SHARE: f64 = 0.25;
/// Standard deviations of the smoothing of colours: in distances to neighbours, and in radians for
/// directions that no photo shows.
const FINE_DEVIATION: f64 = 1.2;
const COARSE_DEVIATION: f64 = 0.3;
/// Fractions of the full weight of the neighbourhood at which half of a colour comes from the
/// wider mean.
const FINE_HALF_WEIGHT: f64 = 0.05;
const COARSE_HALF_WEIGHT: f64 = 1e-3;
/// Approximate largest number of directions in the wide means.
const MAX_SOURCES: usize = 1000;

/// The photos from which the sky is made.
pub(crate) struct SkyPhotos<'a> {
    /// Cameras.
    pub(crate) cameras: &'a [Camera],
    /// The class and colour (sRGB) of a picture point, given as shares of width and height, in
    /// photo `index`.
    pub(crate) look: &'a (dyn Fn(usize, [f64; 2]) -> (SkyClass, [u8; 3]) + Sync),
    /// The gain of photo `index` in red, green and blue relative to the scene, display-referred.
    pub(crate) gain: &'a (dyn Fn(usize) -> [f32; 3] + Sync),
    /// The direction against gravity, world axes, length 1.
    pub(crate) up: DVec3,
    /// The sine of the elevation down to which photos show endless haze, which looks like sky;
    /// `None` without haze.
    pub(crate) lowest: Option<f64>,
}

/// The colour of a direction, 0-1, and its weight, 0 where no photo shows it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct ShownColors {
    color: [f32; 3],
    weight: f32,
}

/// Adds splats on a far half sphere about the scene, in group [`Group::Sky`], and returns their
/// number.
///
/// Splats have the mean colour of the photos that show the sky there, in the scene's exposure.
/// Directions that no photo shows have the mean of their neighbourhood, and farther away that of
/// their elevation, so that there are no gaps. `count` splats cover the half sphere around up (and
/// a little below the horizon); nothing is added if photos show next to no sky.
pub(crate) fn add_sky(
    splats: &mut Splats,
    photos: &SkyPhotos<'_>,
    points: &SparsePoints,
    extent: f64,
    count: usize,
) -> usize {
    let cameras = photos.cameras;
    let center = cameras.iter().map(Camera::center).sum::<DVec3>() / cameras.len().max(1) as f64;
    let (up, below) = (photos.up, photos.lowest.map_or(LOWEST_SINE, |lowest| lowest.min(LOWEST_SINE)));
    let mut distances: Vec<f64> = points
        .positions
        .iter()
        .map(|p| center.distance(DVec3::from_array(*p)))
        .filter(|d| d.is_finite())
        .collect();
    distances.sort_by(f64::total_cmp);
    // Outliers among the points do not enlarge the sky.
    let farthest = distances.get(distances.len() * 99 / 100).copied().unwrap_or(0.0);
    let radius = (SKY_RADIUS_EXTENTS * extent).max(3.0 * farthest);
    // Neighbours on a Fibonacci sphere are about this far apart, radians.
    let whole = (2 * count).max(2);
    let spacing = (4.0 * PI / whole as f64).sqrt();
    let all = (0..whole).map(|index| direction(index, whole));
    let directions: Vec<DVec3> = all.filter(|direction| direction.dot(up) > below).collect();
    let shown: Vec<ShownColors> =
        directions.par_iter().map(|direction| shown(photos, center + radius * *direction)).collect();
    let seen = shown.iter().filter(|shown| shown.weight > 0.0).count();
    if (seen as f64) < MIN_SHOWN_SHARE * directions.len() as f64 {
        return 0;
    }
    let colors = smoothed(&directions, &shown, spacing, up);
    for (direction, rgb) in directions.iter().zip(colors) {
        splats.push(&Splat {
            mean: (center + radius * *direction).to_array().map(|v| v as f32),
            quat: [1.0, 0.0, 0.0, 0.0],
            log_scale: [(SPLAT_SCALE * spacing * radius).ln() as f32; 3],
            logit_opacity: logit(SPLAT_OPACITY) as f32,
            rgb,
            group: Group::Sky,
        });
    }
    directions.len()
}

/// Returns the mean colour of a direction over the photos that show the sky there, in the scene's
/// exposure.
fn shown(photos: &SkyPhotos<'_>, point: DVec3) -> ShownColors {
    let (mut sum, mut weights) = ([0.0f32; 3], 0.0f32);
    for (index, camera) in photos.cameras.iter().enumerate() {
        let Some((x, y, _)) = camera.project(point) else { continue };
        let at = [x / f64::from(camera.width), y / f64::from(camera.height)];
        let border = at.iter().fold(1.0, |least: f64, at| least.min(at.min(1.0 - at) / BORDER_SHARE));
        if border <= 0.0 {
            continue;
        }
        let (SkyClass::Sky, color) = (photos.look)(index, at) else { continue };
        let (color, gain) = (color.map(|v| f32::from(v) / 255.0), (photos.gain)(index));
        let clipped =
            color.map(|v| ((v - CLIPPED_RANGE[0]) / (CLIPPED_RANGE[1] - CLIPPED_RANGE[0])).clamp(0.0, 1.0));
        let most = clipped.iter().fold(0.0, |a: f32, b| a.max(*b));
        let weight = border as f32 * (1.0 + most * (CLIPPED_WEIGHT - 1.0));
        for c in 0..3 {
            // A clipped colour is a lower bound of brightness: it stays white in the scene's
            // exposure.
            let own = color[c] / gain[c];
            sum[c] += weight * (own + clipped[c] * (own.max(1.0) - own)).min(1.0);
        }
        weights += weight;
    }
    if weights > 0.0 {
        ShownColors { color: sum.map(|v| v / weights), weight: weights.min(1.0) }
    } else {
        ShownColors::default()
    }
}

/// Smooths the colours of all directions, which are sorted along one axis: means over neighbours,
/// wider ones where few are shown.
fn smoothed(directions: &[DVec3], shown: &[ShownColors], spacing: f64, up: DVec3) -> Vec<[f32; 3]> {
    let by_height = ByHeight::new(directions.iter().zip(shown).map(|(d, shown)| (d.dot(up), *shown)));
    let step = directions.len().div_ceil(MAX_SOURCES);
    let mean = |at: DVec3, sources: &mut dyn Iterator<Item = usize>, width: f64| {
        let (mut sum, mut weights) = ([0.0f64; 3], 0.0f64);
        for i in sources.filter(|i| shown[*i].weight > 0.0) {
            let weight = f64::from(shown[i].weight) * ((at.dot(directions[i]) - 1.0) / (width * width)).exp();
            weights += weight;
            (0..3).for_each(|c| sum[c] += weight * f64::from(shown[i].color[c]));
        }
        (sum.map(|v| v / weights.max(1e-300)), weights)
    };
    let own = |i: usize| {
        let at = directions[i];
        let mut color = by_height.at(at.dot(up)).map(f64::from);
        let mut refine = |sources: &mut dyn Iterator<Item = usize>, width: f64, apart: f64, half: f64| {
            let (finer, weights) = mean(at, sources, width);
            // The weight of a fully sampled sphere.
            let full = TAU * width * width / (apart * apart);
            let share = weights / (weights + half * full);
            (0..3).for_each(|c| color[c] += share * (finer[c] - color[c]));
        };
        let apart = spacing * (step as f64).sqrt();
        let all = &mut (0..directions.len()).step_by(step);
        refine(all, COARSE_DEVIATION, apart, COARSE_HALF_WEIGHT);
        let width = FINE_DEVIATION * spacing;
        let near = |height: f64| directions.partition_point(|d| d.z > height);
        let near = near(at.z + 3.0 * width)..near(at.z - 3.0 * width);
        refine(&mut near.into_iter(), width, spacing, FINE_HALF_WEIGHT);
        color.map(|v| v as f32)
    };
    (0..directions.len()).into_par_iter().map(own).collect()
}

/// Mean colours of the sky by elevation.
struct ByHeight(Vec<Option<[f32; 3]>>);

impl ByHeight {
    /// Rings, from straight down to straight up.
    const RING_COUNT: usize = 60;

    fn ring(height: f64) -> usize {
        let angle = height.clamp(-1.0, 1.0).asin() / PI + 0.5;
        ((angle * Self::RING_COUNT as f64) as usize).min(Self::RING_COUNT - 1)
    }

    fn new(seen: impl Iterator<Item = (f64, ShownColors)>) -> Self {
        let mut sums = vec![([0.0f32; 3], 0.0f32); Self::RING_COUNT];
        for (height, ShownColors { color, weight }) in seen {
            let (sum, weights) = &mut sums[Self::ring(height)];
            sum.iter_mut().zip(color).for_each(|(sum, v)| *sum += weight * v);
            *weights += weight;
        }
        let mean = |sum: [f32; 3], weights: f32| (weights > 0.0).then(|| sum.map(|v| v / weights));
        Self(sums.into_iter().map(|(sum, weights)| mean(sum, weights)).collect())
    }

    /// Returns the colour of the nearest ring that any photo shows.
    fn at(&self, height: f64) -> [f32; 3] {
        let ring = Self::ring(height);
        let seen = (0..Self::RING_COUNT).filter(|i| self.0[*i].is_some());
        seen.min_by_key(|i| i.abs_diff(ring)).and_then(|i| self.0[i]).unwrap_or([0.75; 3])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (u32, u32) = (80, 60);

    fn camera(target: DVec3) -> Camera {
        Camera::looking(SIZE, 50.0, DVec3::ZERO, target, DVec3::Z).unwrap()
    }

    /// The sky of photos towards `targets` that show `look` at shares of width and height.
    fn sky(
        targets: &[DVec3],
        gains: &[f32],
        look: &(dyn Fn(usize, [f64; 2]) -> (SkyClass, [u8; 3]) + Sync),
    ) -> Splats {
        let mut splats = Splats::with_capacity(0, 1);
        let cameras: Vec<Camera> = targets.iter().map(|target| camera(*target)).collect();
        let mut points = SparsePoints::default();
        points.push([0.0, 30.0, 0.0], [9; 3], 0.5, 3);
        let gain = |index: usize| [gains[index]; 3];
        let photos = SkyPhotos { cameras: &cameras, look, gain: &gain, up: DVec3::Z, lowest: None };
        assert_eq!(add_sky(&mut splats, &photos, &points, 2.0, 1000), splats.len());
        splats
    }

    /// The colours of splats that `camera` shows, with the shares of its width and height where
    /// they are.
    fn colors(splats: &Splats, camera: &Camera) -> Vec<([f64; 2], [f32; 3])> {
        let mut found = Vec::new();
        for i in 0..splats.len() {
            let mean = DVec3::from_array(splats.means[i].map(f64::from));
            let sh = &splats.sh[i * splats.sh_stride()..][..3];
            let Some((x, y, _)) = camera.project(mean) else { continue };
            let at = [x / f64::from(SIZE.0), y / f64::from(SIZE.1)];
            if at.iter().all(|at| (0.0..1.0).contains(at)) {
                found.push((at, [0, 1, 2].map(|k| sh[k] * 0.282_094_8 + 0.5)));
            }
        }
        found
    }

    #[test]
    fn the_sky_is_far_and_of_the_colours_of_photos() {
        // The upper half of the photo is sky, redder on the left.
        let look = |_: usize, [x, y]: [f64; 2]| match y < 0.5 {
            true => (SkyClass::Sky, [if x < 0.5 { 200 } else { 0 }, 100, 200]),
            false => (SkyClass::Place, [0; 3]),
        };
        let none = |_: usize, _: [f64; 2]| (SkyClass::Place, [0; 3]);
        assert_eq!(sky(&[DVec3::Y], &[1.0], &none).len(), 0);
        let splats = sky(&[DVec3::Y], &[1.0], &look);
        assert!((1000..1100).contains(&splats.len()), "{}", splats.len());
        assert!(splats.groups.iter().all(|group| *group == Group::Sky));
        for (i, mean) in splats.means.iter().enumerate() {
            let mean = DVec3::from_array(mean.map(f64::from));
            assert!((mean.length() - 90.0).abs() < 0.1 && mean.z > -9.0);
            let blue = splats.sh[i * splats.sh_stride() + 2] * 0.282_094_8 + 0.5;
            assert!((blue - 200.0 / 255.0).abs() < 1e-3);
        }
        let shown = colors(&splats, &camera(DVec3::Y));
        let of = |from: f64, to: f64| {
            let reds: Vec<f32> = shown
                .iter()
                .filter(|(at, _)| at[1] < 0.4 && (from..to).contains(&at[0]))
                .map(|s| s.1[0])
                .collect();
            assert!(reds.len() > 5, "{}", reds.len());
            reds.iter().sum::<f32>() / reds.len() as f32
        };
        assert!(of(0.0, 0.35) > 0.75 && of(0.65, 1.0) < 0.04, "{} {}", of(0.0, 0.35), of(0.65, 1.0));
    }

    /// Two photos beside each other of one sky, the right one twice as bright and clipped: no
    /// border, and the left one's colour.
    #[test]
    fn exposures_leave_no_border() {
        let look = |index: usize, _: [f64; 2]| (SkyClass::Sky, [[90, 100, 115], [180, 200, 230]][index]);
        let targets = [DVec3::new(-0.35, 1.0, 0.4), DVec3::new(0.35, 1.0, 0.4)];
        let splats = sky(&targets, &[1.0, 2.0], &look);
        for (at, color) in colors(&splats, &camera(DVec3::new(0.0, 1.0, 0.4))) {
            let want = [90.0, 100.0, 115.0].map(|v: f32| v / 255.0);
            assert!((0..3).all(|c| (color[c] - want[c]).abs() < 0.01), "{at:?} {color:?}");
        }
        let clipped = |index: usize, _: [f64; 2]| (SkyClass::Sky, [[150, 160, 180], [255; 3]][index]);
        let splats = sky(&targets, &[1.0, 2.0], &clipped);
        let shown = colors(&splats, &camera(targets[0]));
        let inner = shown.iter().filter(|(at, _)| (0.3..0.7).contains(&at[0]));
        for (at, color) in inner {
            assert!((color[2] - 180.0 / 255.0).abs() < 0.05, "{at:?} {color:?}");
        }
    }
}
