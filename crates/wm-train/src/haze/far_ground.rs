//! The ground that the haze hides, from where it begins to the horizon.
//!
//! Photos that look down into endless haze show ground, but none of its texture: neither the
//! reconstruction nor stereo has points there. A training that must cover these pixels has nothing
//! but what stands before them, and blows it up into white curtains at distances where the haze is
//! still thin. So nothing is claimed of these pixels while the scene learns ([`without_hidden`]),
//! and its sky reaches as far down as they do ([`FarGround::lowest`]). In the finished scene level
//! ground lies there, of the mean colour of what is known. It does not learn: of what haze hides,
//! steps of the optimiser are a random walk.
//!
//! Ground that lay there from the start would grow over the sky, whose light through haze is the
//! same.

use super::photo_haze::PhotoHaze;
use super::settle::{mean_color, nearest};
use crate::photos::Photo;
use crate::priors::{Prior, SkyClass};
use glam::{DQuat, DVec3};
use std::f64::consts::TAU;
use wm_base::color::srgb_encode;
use wm_scene::SparsePoints;
use wm_scene::splats::{Splat, logit};
use wm_scene::{Camera, Group, Splats};

/// Transmittance, from the nearest camera, below which photos show hardly anything.
const HIDDEN_TRANSMITTANCE: f64 = 0.1;
/// Transmittance at which the added ground begins, overlapping the ground that photos show.
const FIRST_TRANSMITTANCE: f64 = 0.2;
/// Largest height above or below the ground of splats that give its colour, in heights of the
/// cameras.
const LEVEL_TOLERANCE: f64 = 0.1;
/// Rank of the ground's height among the points: below are outliers, above are objects.
const GROUND_RANK: f64 = 0.15;
/// Ratio of the radii of two rings.
const RING_RATIO: f64 = 1.15;
/// Radius of the last ring in heights of the cameras over the ground: 0.25 degrees below the
/// horizon.
const LAST_RING_RADIUS: f64 = 250.0;
/// Standard deviation of splats in distances to their neighbours, and their opacity: leaves no
/// gaps.
const SPLAT_SCALE: f64 = 0.7;
const SPLAT_OPACITY: f64 = 0.98;
/// Thickness of splats in heights of the cameras over the ground.
const SPLAT_THICKNESS: f64 = 0.03;
/// Radius of the farthest ring, in extents of the scene; the sky begins at 20.
const MAX_RADIUS_EXTENTS: f64 = 16.0;
/// Overlap of sky and ground at the edge where the ground begins, sine of the elevation.
const EDGE_MARGIN: f64 = 0.05;
/// Largest difference of a pixel from the airlight at which it shows nothing else,
/// display-referred.
const AIRLIGHT_TOLERANCE: f64 = 0.03;

/// The ground beyond what photos show through the haze.
#[derive(Clone, Debug)]
pub(crate) struct FarGround<'a> {
    cameras: &'a [Camera],
    /// The mean position of the cameras.
    center: DVec3,
    up: DVec3,
    /// Height of `center` over the ground, scene units, above 0.
    height: f64,
    /// Distance from the nearest camera at which the added ground begins, scene units.
    begins: f64,
    /// Distance beyond which photos show hardly anything, scene units.
    hidden: f64,
}

impl<'a> FarGround<'a> {
    /// Returns the ground under `cameras`, of which `points` tell the height; `None` if the cameras
    /// are not above it.
    pub(crate) fn new(
        cameras: &'a [Camera],
        points: &SparsePoints,
        up: DVec3,
        haze: &PhotoHaze,
    ) -> Option<Self> {
        let center = cameras.iter().map(Camera::center).sum::<DVec3>() / cameras.len().max(1) as f64;
        let mut heights: Vec<f64> = points.positions.iter().map(|p| up.dot(DVec3::from_array(*p))).collect();
        heights.retain(|height| height.is_finite());
        if heights.is_empty() {
            return None;
        }
        let rank = (GROUND_RANK * heights.len() as f64) as usize;
        let height = up.dot(center) - *heights.select_nth_unstable_by(rank, f64::total_cmp).1;
        let [begins, hidden] =
            [FIRST_TRANSMITTANCE, HIDDEN_TRANSMITTANCE].map(|kept| -kept.ln() / haze.shown);
        (height > 0.0).then_some(Self { cameras, center, up, height, begins, hidden })
    }

    /// Returns the sine of the elevation below which no photo shows endless haze.
    pub(crate) fn lowest(&self) -> f64 {
        let highest = self.cameras.iter().map(|camera| self.up.dot(camera.center() - self.center));
        let highest = self.height + highest.fold(0.0, f64::max);
        (-highest / self.hidden - EDGE_MARGIN).max(-1.0)
    }

    /// Adds the ground to a finished scene of `extent` units, in the mean colour of the ground that
    /// the cameras show, or of everything they show if they show no ground.
    pub(crate) fn add(&self, splats: &mut Splats, extent: f64, haze: &PhotoHaze) {
        let of = |counts: &dyn Fn(DVec3) -> bool| mean_color(splats, self.cameras, &haze.air(), counts);
        let level = self.up.dot(self.center) - self.height;
        let is_level = |at: DVec3| (self.up.dot(at) - level).abs() < LEVEL_TOLERANCE * self.height;
        let Some(rgb) = of(&is_level).or_else(|| of(&|_| true)) else { return };
        let east = self.up.any_orthonormal_vector();
        let north = self.up.cross(east);
        let rotation = DQuat::from_rotation_arc(DVec3::Z, self.up);
        let around = (TAU / RING_RATIO.ln()) as usize;
        let farthest = MAX_RADIUS_EXTENTS * extent;
        let mut radius = self.begins.min(farthest);
        while radius < LAST_RING_RADIUS * self.height {
            for k in 0..around {
                let (sin, cos) = (TAU * k as f64 / around as f64).sin_cos();
                let offset = radius * (cos * east + sin * north) - self.height * self.up;
                // Beyond the farthest ring a splat is drawn nearer and smaller: it looks the same.
                let nearer = (farthest / offset.length()).min(1.0);
                let at = self.center + nearer * offset;
                if nearest(self.cameras, at, |_| true) < self.begins.min(farthest - extent) {
                    continue;
                }
                let size = (nearer * SPLAT_SCALE * radius * RING_RATIO.ln()).ln() as f32;
                splats.push(&Splat {
                    mean: at.to_array().map(|v| v as f32),
                    quat: [rotation.w, rotation.x, rotation.y, rotation.z].map(|v| v as f32),
                    log_scale: [size, size, (nearer * SPLAT_THICKNESS * self.height).ln() as f32],
                    logit_opacity: logit(SPLAT_OPACITY) as f32,
                    rgb,
                    group: Group::Scene,
                });
            }
            radius *= RING_RATIO;
        }
    }
}

/// Returns a photo's prior with class unknown where the photo shows the airlight and depth is not
/// known.
pub(crate) fn without_hidden(prior: &Prior, photo: &Photo, haze: &PhotoHaze) -> Prior {
    let mut prior = prior.clone();
    let light = haze.airlight.map(|light| 255.0 * srgb_encode(light));
    let (width, height) = (prior.width as usize, prior.height as usize);
    let (columns, rows) = (photo.width as usize, photo.height as usize);
    for (at, class) in prior.sky.iter_mut().enumerate() {
        if *class != SkyClass::Place || prior.disparity.get(at).is_some_and(|disparity| *disparity > 0.0) {
            continue;
        }
        let pixel = at / width * rows / height * columns + at % width * columns / width;
        let rgb = &photo.rgb[3 * pixel..];
        if (0..3).all(|c| (f64::from(rgb[c]) - light[c]).abs() < 255.0 * AIRLIGHT_TOLERANCE) {
            *class = SkyClass::Unknown;
        }
    }
    prior
}

#[cfg(test)]
mod tests {
    use super::*;

    const HAZE: PhotoHaze = PhotoHaze { extinction: 0.02, error: None, shown: 0.02, airlight: [0.5; 3] };

    /// A camera 10 units over a floor of which the haze hides all from 80 units on.
    fn camera() -> Camera {
        Camera::looking((64, 48), 60.0, DVec3::new(0.0, 0.0, 10.0), DVec3::new(0.0, 50.0, 0.0), DVec3::Z)
            .unwrap()
    }

    #[test]
    fn ground_begins_where_the_haze_hides_it_and_ends_below_the_horizon() {
        let mut points = SparsePoints::default();
        (0..100).for_each(|i| points.push([f64::from(i), 20.0, 0.0], [90; 3], 0.5, 3));
        let cameras = [camera()];
        let ground = FarGround::new(&cameras, &points, DVec3::Z, &HAZE).unwrap();
        assert!((-0.15..-0.1).contains(&ground.lowest()), "{}", ground.lowest());
        let mut splats = Splats::with_capacity(1, 1);
        let (mean, quat, rgb) = ([0.0, 20.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.2, 0.4, 0.1]);
        splats.push(&Splat { mean, quat, log_scale: [0.0; 3], logit_opacity: 2.0, rgb, group: Group::Scene });
        ground.add(&mut splats, 40.0, &HAZE);
        assert!((300..3000).contains(&splats.len()), "{}", splats.len());
        let eye = cameras[0].center();
        for i in 1..splats.len() {
            let offset = DVec3::from_array(splats.means[i].map(f64::from)) - eye;
            let (distance, sine) = (offset.length(), offset.z / offset.length());
            assert!(HAZE.transmittance(distance) < 0.2001 && distance < 640.1 && sine < -0.003);
            assert!(splats.log_scales[i][2] < splats.log_scales[i][0] - 2.0);
        }
        let stride = splats.sh_stride();
        assert!((0..3).all(|c| (splats.sh[stride + c] - splats.sh[c]).abs() < 1e-5));
        // Cameras below the ground give none.
        let (under, points) = ([camera()], &mut points);
        points.positions.iter_mut().for_each(|at| at[2] = 20.0);
        assert!(FarGround::new(&under, points, DVec3::Z, &HAZE).is_none());
    }

    #[test]
    fn pixels_in_endless_haze_are_unknown() {
        let light = (255.0 * srgb_encode(0.5)).round() as u8;
        let prior = Prior {
            width: 4,
            height: 1,
            disparity: vec![f32::NAN, f32::NAN, 0.1, f32::NAN],
            sky: vec![SkyClass::Place, SkyClass::Place, SkyClass::Place, SkyClass::Sky],
            ..Prior::default()
        };
        let gray = |v: u8| [v; 6];
        let rgb = [gray(light), gray(light - 20), gray(light), gray(light)].concat();
        let photo = Photo { width: 8, height: 1, rgb, mask: None, camera: camera() };
        let found = without_hidden(&prior, &photo, &HAZE);
        assert_eq!(found.sky, [SkyClass::Unknown, SkyClass::Place, SkyClass::Place, SkyClass::Sky]);
    }
}
