//! The splats that a training starts with: at the points of the reconstruction, or anywhere in view
//! where there are none.
//!
//! As published (Kerbl et al. 2023) they are round, with the root mean square distance to the
//! three nearest neighbours as standard deviation and the colour of the point.

mod sky;

pub(crate) use sky::{SkyPhotos, add_sky};

use crate::random::{Purpose, Random};
use glam::DVec3;
use rayon::prelude::*;
use wm_base::kd_tree::KdTree;
use wm_scene::SparsePoints;
use wm_scene::splats::{Splat, logit};
use wm_scene::{Camera, Group, Splats};

/// Nearest neighbours that determine the size of a splat.
const NEIGHBOUR_COUNT: usize = 3;
/// Number of splats where there are no points.
const BLIND_SPLATS: usize = 20_000;
/// Largest standard deviation of a splat, as a fraction of the extent: an outlier must not become
/// a wall.
const MAX_SCALE_EXTENTS: f64 = 0.2;

/// Options of the first splats.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct StartConfig {
    /// Opacity, 0-1.
    pub(crate) opacity: f64,
    /// Standard deviation in distances to neighbours.
    pub(crate) scale: f64,
    /// Most splats.
    pub(crate) most: usize,
    /// Degree of the spherical harmonics.
    pub(crate) sh_degree: u8,
    /// The seed for the choice among too many points, and for random points.
    pub(crate) seed: u64,
}

/// Returns the extent of a scene, scene units: 1.1 times the largest distance of a camera from the
/// mean position.
pub(crate) fn extent(cameras: &[Camera]) -> f64 {
    let centers: Vec<DVec3> = cameras.iter().map(Camera::center).collect();
    let mean = centers.iter().sum::<DVec3>() / centers.len().max(1) as f64;
    let farthest = centers.iter().map(|center| center.distance(mean)).fold(0.0, f64::max);
    // Cameras at one position still see a scene around them.
    if farthest > 1e-6 { 1.1 * farthest } else { 1.0 }
}

/// Returns splats at the points, one for equal points.
pub(crate) fn from_points(points: &SparsePoints, extent: f64, config: &StartConfig) -> Splats {
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
        let size = (distance * config.scale).clamp(1e-7, MAX_SCALE_EXTENTS * extent);
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

/// Returns grey splats along random rays of the cameras, from a tenth of the extent to ten times
/// it.
pub(crate) fn blind(cameras: &[Camera], extent: f64, config: &StartConfig) -> Splats {
    let random = Random::new(config.seed, Purpose::Start, 0);
    let mut points = SparsePoints::default();
    for i in 0..BLIND_SPLATS.min(config.most) as u64 {
        let u = |k: u64| random.uniform(4 * i + k);
        let camera = &cameras[random.below(4 * i + 3, cameras.len())];
        let ray = camera.ray(u(0) * f64::from(camera.width), u(1) * f64::from(camera.height));
        let distance = 0.1 * extent * 100f64.powf(u(2));
        points.push((camera.center() + ray * distance).to_array(), [128; 3], f32::NAN, 0);
    }
    from_points(&points, extent, config)
}

/// Returns the root mean square distance to the nearest neighbours; `alone` for a point without
/// any.
fn neighbour_distances(positions: &[[f32; 3]], alone: f64) -> Vec<f64> {
    if positions.len() < 2 {
        return vec![alone; positions.len()];
    }
    let tree = KdTree::new(positions);
    positions
        .par_iter()
        .map(|position| {
            // The nearest is the point itself.
            let found = tree.nearest(position, NEIGHBOUR_COUNT + 1);
            let squares: Vec<f64> = found.iter().skip(1).map(|near| f64::from(near.square)).collect();
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
