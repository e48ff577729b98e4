//! The splats that a training starts with: at the points of the reconstruction, or anywhere in view where there are
//! none.
//!
//! They are made as published (Kerbl et al. 2023): round, of the mean distance (root mean square) to the three nearest
//! neighbours, of the point's colour.

use crate::priors::SkyClass;
use crate::random::{Purpose, Random};
use glam::DVec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;
use std::num::NonZero;
use wm_scene::capture::SparsePoints;
use wm_scene::splats::{Splat, logit};
use wm_scene::{Camera, Group, Splats};

/// Neighbours that say how large a splat is.
const NEIGHBOURS: usize = 3;
/// Splats to begin with where there are no points.
const BLIND: usize = 20_000;
/// The largest size of a splat, in units of the extent: a stray point is no wall.
const LARGEST: f64 = 0.2;

/// Radius of the sky in extents, at least.
const SKY: f64 = 20.0;
/// Sine of the height at which it begins: 5 degrees below the horizon, since up is known to some degrees.
const BELOW: f64 = -0.09;
/// Standard deviation of its splats in distances to their neighbours, and their opacity: no gaps.
const SKY_SCALE: f64 = 0.7;
const SKY_OPACITY: f64 = 0.9;

/// Share of the half sphere that photos show, at least: less is a gap in a crown, or no sky.
const LEAST_SEEN: f64 = 0.004;

/// Options for starting splats.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StartConfig {
    /// Opacity, 0-1.
    pub opacity: f64,
    /// Standard deviation in distances to neighbours.
    pub scale: f64,
    /// Most splats.
    pub most: usize,
    /// Degree of their spherical harmonics.
    pub sh_degree: u8,
    /// For which of many points stay, and for points that there are not.
    pub seed: u64,
}

/// The size of a scene, scene units: 1.1 times the largest distance of a camera from their mean.
#[must_use]
pub fn extent(cameras: &[Camera]) -> f64 {
    let centers: Vec<DVec3> = cameras.iter().map(Camera::center).collect();
    let mean = centers.iter().sum::<DVec3>() / centers.len().max(1) as f64;
    let farthest = centers.iter().map(|center| center.distance(mean)).fold(0.0, f64::max);
    // Cameras in one place still have a scene about them.
    if farthest > 1e-6 { 1.1 * farthest } else { 1.0 }
}

/// Splats at the points; equal points once.
#[must_use]
pub fn from_points(points: &SparsePoints, extent: f64, config: &StartConfig) -> Splats {
    let mut kept: Vec<([f32; 3], [u8; 3])> = points
        .positions
        .iter()
        .zip(&points.colors)
        .map(|(position, color)| (position.map(|v| v as f32), *color))
        .filter(|(position, _)| position.iter().all(|v| v.is_finite()))
        .collect();
    kept.sort_by(|a, b| a.0.partial_cmp(&b.0).unwrap_or(std::cmp::Ordering::Equal));
    kept.dedup_by_key(|(position, _)| *position);
    if kept.len() > config.most {
        let order = Random::new(config.seed, Purpose::Start, 0).permutation(kept.len());
        let mut chosen: Vec<_> = order[..config.most].iter().map(|i| kept[*i]).collect();
        chosen.sort_by(|a, b| a.0.partial_cmp(&b.0).unwrap_or(std::cmp::Ordering::Equal));
        kept = chosen;
    }
    let positions: Vec<[f32; 3]> = kept.iter().map(|(position, _)| *position).collect();
    let distances = neighbour_distances(&positions, 0.01 * extent);
    let mut splats = Splats::with_capacity(kept.len(), config.sh_degree);
    for ((mean, color), distance) in kept.into_iter().zip(distances) {
        let size = (distance * config.scale).clamp(1e-7, LARGEST * extent);
        splats.push(&Splat {
            mean,
            quat: [1.0, 0.0, 0.0, 0.0],
            log_scale: [size.ln() as f32; 3],
            logit_opacity: logit(config.opacity) as f32,
            rgb: color.map(|v| f32::from(v) / 255.0),
            group: Group::Scene,
        });
    }
    splats
}

/// The photos from which the sky is made.
pub struct SkyPhotos<'a> {
    /// Cameras, those of `maps` in the same order.
    pub cameras: &'a [Camera],
    /// The class and colour (sRGB) of a picture point, given as shares of width and height, in photo `index`.
    pub look: &'a (dyn Fn(usize, [f64; 2]) -> (SkyClass, [u8; 3]) + Sync),
    /// The direction against gravity, world axes, length 1.
    pub up: DVec3,
    /// The sine of the height down to which photos show endless haze, which looks like sky; `None` without haze.
    pub lowest: Option<f64>,
}

/// Adds splats on a far half sphere about the scene, in group [`Group::Sky`].
///
/// Models have no points in the sky. Without it the sky is painted on whatever drifts there, near and far, and fog
/// would take it for what it is painted on. Where photos show the sky its colour is theirs; in other directions that
/// of what was seen at the same height, so that no camera looks into nothing. `count` splats cover the half sphere
/// about up (and a little below the horizon); nothing is added where photos show next to no sky.
pub fn add_sky(
    splats: &mut Splats,
    photos: &SkyPhotos<'_>,
    points: &SparsePoints,
    extent: f64,
    count: usize,
) -> usize {
    let cameras = photos.cameras;
    let center = cameras.iter().map(Camera::center).sum::<DVec3>() / cameras.len().max(1) as f64;
    let (up, below) = (photos.up, photos.lowest.map_or(BELOW, |lowest| lowest.min(BELOW)));
    let mut distances: Vec<f64> = points
        .positions
        .iter()
        .map(|p| center.distance(DVec3::from_array(*p)))
        .filter(|d| d.is_finite())
        .collect();
    distances.sort_by(f64::total_cmp);
    // Stray points are no reason for a larger sky.
    let farthest = distances.get(distances.len() * 99 / 100).copied().unwrap_or(0.0);
    let radius = (SKY * extent).max(3.0 * farthest);
    // Neighbours on a Fibonacci sphere are about this far apart.
    let whole = (2 * count).max(2);
    let spacing = radius * (4.0 * std::f64::consts::PI / whole as f64).sqrt();
    let directions: Vec<DVec3> = (0..whole)
        .map(|i| {
            let height = 1.0 - (2.0 * i as f64 + 1.0) / whole as f64;
            let (sin, cos) = (std::f64::consts::PI * (3.0 - 5f64.sqrt()) * i as f64).sin_cos();
            let around = (1.0 - height * height).sqrt();
            DVec3::new(around * cos, around * sin, height)
        })
        .filter(|direction| direction.dot(up) > below)
        .collect();
    let seen: Vec<Option<[f32; 3]>> =
        directions.par_iter().map(|direction| seen_sky(photos, center + radius * *direction)).collect();
    let shown = seen.iter().filter(|color| color.is_some()).count();
    if (shown as f64) < LEAST_SEEN * directions.len() as f64 {
        return 0;
    }
    let by_height = ByHeight::new(directions.iter().zip(&seen).map(|(d, color)| (d.dot(up), *color)));
    for (direction, color) in directions.iter().zip(&seen) {
        splats.push(&Splat {
            mean: (center + radius * *direction).to_array().map(|v| v as f32),
            quat: [1.0, 0.0, 0.0, 0.0],
            log_scale: [(SKY_SCALE * spacing).ln() as f32; 3],
            logit_opacity: logit(SKY_OPACITY) as f32,
            rgb: color.unwrap_or_else(|| by_height.at(direction.dot(up))),
            group: Group::Sky,
        });
    }
    directions.len()
}

/// The mean colour of a far point over the photos that show the sky there; `None` if none does.
fn seen_sky(photos: &SkyPhotos<'_>, point: DVec3) -> Option<[f32; 3]> {
    let (mut sum, mut count) = ([0.0f32; 3], 0.0f32);
    for (index, camera) in photos.cameras.iter().enumerate() {
        let Some((x, y, _)) = camera.project(point) else { continue };
        let at = [x / f64::from(camera.width), y / f64::from(camera.height)];
        if at.iter().all(|share| (0.0..1.0).contains(share))
            && let (SkyClass::Sky, color) = (photos.look)(index, at)
        {
            count += 1.0;
            sum.iter_mut().zip(color).for_each(|(sum, v)| *sum += f32::from(v) / 255.0);
        }
    }
    (count > 0.0).then(|| sum.map(|v| v / count))
}

/// Mean colours of rings of the sky.
struct ByHeight(Vec<Option<[f32; 3]>>);

impl ByHeight {
    /// Rings, from straight down to straight up.
    const RINGS: usize = 60;

    fn ring(height: f64) -> usize {
        let angle = height.clamp(-1.0, 1.0).asin() / std::f64::consts::PI + 0.5;
        ((angle * Self::RINGS as f64) as usize).min(Self::RINGS - 1)
    }

    fn new(seen: impl Iterator<Item = (f64, Option<[f32; 3]>)>) -> Self {
        let mut sums = vec![([0.0f32; 3], 0.0f32); Self::RINGS];
        for (height, color) in seen {
            if let Some(color) = color {
                let (sum, count) = &mut sums[Self::ring(height)];
                sum.iter_mut().zip(color).for_each(|(sum, v)| *sum += v);
                *count += 1.0;
            }
        }
        Self(sums.into_iter().map(|(sum, count)| (count > 0.0).then(|| sum.map(|v| v / count))).collect())
    }

    /// The colour of the nearest ring that was seen.
    fn at(&self, height: f64) -> [f32; 3] {
        let ring = Self::ring(height);
        let seen = (0..Self::RINGS).filter(|i| self.0[*i].is_some());
        seen.min_by_key(|i| i.abs_diff(ring)).and_then(|i| self.0[i]).unwrap_or([0.75; 3])
    }
}

/// Grey splats along random rays of the cameras, from a tenth of the extent to ten times it.
#[must_use]
pub fn blind(cameras: &[Camera], extent: f64, config: &StartConfig) -> Splats {
    let random = Random::new(config.seed, Purpose::Start, 0);
    let mut points = SparsePoints::default();
    for i in 0..BLIND.min(config.most) as u64 {
        let u = |k: u64| random.uniform(4 * i + k);
        let camera = &cameras[random.below(4 * i + 3, cameras.len())];
        let ray = camera.ray(u(0) * f64::from(camera.width), u(1) * f64::from(camera.height));
        let distance = 0.1 * extent * 100f64.powf(u(2));
        points.push((camera.center() + ray * distance).to_array(), [128; 3], f32::NAN, 0);
    }
    from_points(&points, extent, config)
}

/// Root mean square distance to the nearest neighbours; `alone` for a point without any.
fn neighbour_distances(positions: &[[f32; 3]], alone: f64) -> Vec<f64> {
    let Some(tree) =
        (positions.len() > 1).then(|| ImmutableKdTree::<f32, 3>::new_from_slice(positions).ok()).flatten()
    else {
        return vec![alone; positions.len()];
    };
    let wanted = NonZero::new(NEIGHBOURS + 1).unwrap_or(NonZero::<usize>::MIN);
    positions
        .par_iter()
        .map(|position| {
            // The nearest is the point itself.
            let found = tree.query(position).nearest_n::<SquaredEuclidean<f32>>(wanted).execute();
            let squares: Vec<f64> = found.iter().skip(1).map(|near| f64::from(near.distance)).collect();
            (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONFIG: StartConfig = StartConfig { opacity: 0.1, scale: 1.0, most: 1000, sh_degree: 2, seed: 0 };

    #[test]
    fn splats_fill_the_gaps_between_points() {
        let mut points = SparsePoints::default();
        for x in 0..5 {
            for y in 0..5 {
                points.push([f64::from(x), f64::from(y), 0.0], [255, 0, 128], 0.5, 3);
            }
        }
        // A point that is there twice is one splat.
        points.push([0.0; 3], [0; 3], 0.5, 3);
        let splats = from_points(&points, 100.0, &CONFIG);
        assert_eq!((splats.len(), splats.sh_stride(), splats.check()), (25, 27, Ok(())));
        let middle = splats.means.iter().position(|mean| *mean == [2.0, 2.0, 0.0]).unwrap();
        assert!((splats.scales(middle)[0] - 1.0).abs() < 1e-6 && (splats.opacity(middle) - 0.1).abs() < 1e-6);
        let few = from_points(&points, 100.0, &StartConfig { most: 7, ..CONFIG });
        assert_eq!(few.len(), 7);
        assert_eq!(from_points(&SparsePoints::default(), 1.0, &CONFIG).len(), 0);
    }

    #[test]
    fn the_sky_is_far_and_of_the_colours_of_photos() {
        let camera = Camera::looking((80, 60), 50.0, DVec3::ZERO, DVec3::Y, DVec3::Z).unwrap();
        let mut points = SparsePoints::default();
        points.push([0.0, 30.0, 0.0], [9; 3], 0.5, 3);
        let sky = |is_seen: bool| {
            let mut splats = Splats::with_capacity(0, 1);
            // The upper half of the photo is sky, redder on the left.
            let look = |_: usize, [x, y]: [f64; 2]| match is_seen && y < 0.5 {
                true => (SkyClass::Sky, [if x < 0.5 { 255 } else { 0 }, 100, 200]),
                false => (SkyClass::Place, [0; 3]),
            };
            let photos = SkyPhotos { cameras: &[camera], look: &look, up: DVec3::Z, lowest: None };
            assert_eq!(add_sky(&mut splats, &photos, &points, 2.0, 1000), splats.len());
            splats
        };
        assert_eq!(sky(false).len(), 0);
        let splats = sky(true);
        assert!((1000..1100).contains(&splats.len()), "{}", splats.len());
        assert!(splats.groups.iter().all(|group| *group == Group::Sky));
        let mut seen = [0; 3];
        for i in 0..splats.len() {
            let mean = DVec3::from_array(splats.means[i].map(f64::from));
            assert!((mean.length() - 90.0).abs() < 0.1 && mean.z > -9.0);
            let sh = &splats.sh[i * splats.sh_stride()..][..3];
            let [r, _, b] = [0, 1, 2].map(|k| sh[k] * 0.282_094_8 + 0.5);
            assert!((b - 200.0 / 255.0).abs() < 1e-3);
            // Left, right, and means of both.
            seen[if r > 0.99 {
                0
            } else if r < 0.01 {
                1
            } else {
                2
            }] += 1;
        }
        assert!(seen.iter().all(|count| *count > 20), "{seen:?}");
    }

    #[test]
    fn without_points_all_is_in_view() {
        let eye = DVec3::new(0.0, -3.0, 1.0);
        let camera = Camera::looking((80, 60), 50.0, eye, DVec3::ZERO, DVec3::Z).unwrap();
        let splats = blind(&[camera], 20.0, &CONFIG);
        assert_eq!(splats.len(), 1000);
        for mean in &splats.means {
            let (x, y, _) = camera.project(DVec3::from_array(mean.map(f64::from))).unwrap();
            assert!((-0.01..80.01).contains(&x) && (-0.01..60.01).contains(&y));
        }
    }
}
