//! A scene with fewer splats: what is seen least goes into its neighbours.
//!
//! The importance of a splat is the sum of its weights (alpha times transmittance) over pictures
//! from places about the scene: of its photos where it has them, else from where a photographer
//! would stand. What no picture shows counts by its size, at a small share, so that a place that
//! was not looked at thins out instead of vanishing.
//!
//! Those that are worth least are taken away, at most half of all at a time. Each goes into the
//! nearest that stays: that one takes the moments of all, and so much opacity that what they cover
//! together stays. One that has no neighbour near is dropped.

use crate::moments::{cover, put};
use crate::view::candidates::candidates;
use crate::view::space::OccupancyGrid;
use crate::view::{DEFAULT_FOV, ViewOptions};
use crate::{Error, Progress, Result};
use glam::{DQuat, DVec3};
use wm_base::kd_tree::KdTree;
use wm_image::quality::psnr;
use wm_render::{Differentiable, ForwardConfig, Frame, Gradients, Learn, Upstream};
use wm_scene::survey::Survey;
use wm_scene::{Camera, Group, Metadata, Scene, Splats};

/// Longest side of the pictures, px.
const MAX_VIEW_SIDE_PX: u32 = 720;
/// Number of pictures of a scene with photos. Two of three measure the importance of splats, every
/// third the loss.
const VIEW_COUNT: usize = 48;
/// Importance of a splat that no picture shows, as a share of its pixels in a picture from nearby.
const UNSEEN_IMPORTANCE: f64 = 0.02;
/// Distance of that nearby picture, radii of the scene.
const NEAR_DISTANCE_RADII: f64 = 0.1;
/// Approximate focal length of the pictures, px.
const FOCAL_LENGTH_PX: f64 = 400.0;
/// Maximum number of pixels that an unseen splat counts with.
const MAX_UNSEEN_PIXELS: f64 = 400.0;
/// Maximum distance between merged splats, in standard deviations of both along their longest axes.
const MAX_MERGE_DISTANCE_SIGMA: f64 = 2.0;

/// The reduced scene.
pub struct ReducedScene {
    /// The splats.
    pub splats: Splats,
    /// One line about the reduction and its cost in quality.
    pub note: String,
}

/// Reduces a scene, whose sky should be labelled, to `most` splats.
///
/// # Errors
/// If it cannot be rendered, or `progress` asks to stop.
pub fn reduce(
    scene: &Scene,
    most: usize,
    renderer: &mut dyn Differentiable,
    progress: &mut dyn Progress,
) -> Result<ReducedScene> {
    let survey = Survey::of(scene, &Metadata::default());
    let cameras = cameras(scene, &survey, MAX_VIEW_SIDE_PX);
    let (measured, tried): (Vec<_>, Vec<_>) = cameras.into_iter().enumerate().partition(|(i, _)| i % 3 == 1);
    let mut eye = Eye {
        renderer,
        progress,
        config: ForwardConfig {
            rasterization: scene.metadata.rasterization.unwrap_or_default(),
            background: [0.5; 3],
            ..ForwardConfig::default()
        },
        frame: Frame::default(),
    };
    eye.progress.begin("reducing", None);
    let mut splats = scene.splats.clone();
    while splats.len() > most {
        let worth = eye.worth(&splats, &tried, survey.radius)?;
        let target = most.max(splats.len() / 2);
        splats = merged(&splats, &worth, target);
        eye.progress.advance(1);
    }
    let mut sum = 0.0;
    let measured = if measured.is_empty() { &tried } else { &measured };
    for (_, camera) in measured {
        let before = eye.look(&scene.splats, camera)?;
        let after = eye.look(&splats, camera)?;
        sum += psnr(&after, &before, None);
    }
    eye.progress.end();
    let quality = sum / measured.len() as f64;
    let (from, to) = (scene.splats.len(), splats.len());
    let note = format!(
        "reduced from {from} to {to} splats: PSNR {quality:.1} dB against all, mean of {} views",
        measured.len()
    );
    Ok(ReducedScene { splats, note })
}

/// Places to look from, for pictures of which no side is longer than this, px; neighbours in the
/// list are mostly alike.
pub(crate) fn cameras(scene: &Scene, survey: &Survey, longest: u32) -> Vec<Camera> {
    if !scene.views.is_empty() {
        let step = (scene.views.len() as f64 / VIEW_COUNT as f64).max(1.0);
        let count = scene.views.len().min(VIEW_COUNT);
        return (0..count).map(|i| small(&scene.views[(i as f64 * step) as usize].camera, longest)).collect();
    }
    let options = ViewOptions { size: Some((longest, longest * 9 / 16)), ..ViewOptions::default() };
    let at = |eye: DVec3, target: DVec3| {
        let camera = Camera::looking(options.size(), DEFAULT_FOV, eye, target, options.up(survey)).ok()?;
        Some(Camera { near: options.near(survey), ..camera })
    };
    let mut cameras: Vec<Camera> = candidates(&OccupancyGrid::of(&scene.splats, survey), survey)
        .into_iter()
        .filter_map(|view| at(view.eye, view.eye + view.forward))
        .collect();
    // From outside all about, for what stands free, and where no place inside was found.
    let up = survey.up.value;
    let (side, distance) = (up.any_orthonormal_vector(), 2.0 * survey.radius.max(1e-6));
    for step in 0..12 {
        let around = DQuat::from_axis_angle(up, f64::from(step) * std::f64::consts::TAU / 12.0) * side;
        cameras.extend(at(survey.center + distance * (around + 0.5 * up).normalize(), survey.center));
    }
    cameras
}

fn small(camera: &Camera, longest: u32) -> Camera {
    let scale = f64::from(longest) / f64::from(camera.width.max(camera.height));
    if scale >= 1.0 {
        return *camera;
    }
    let side = |length: u32| ((f64::from(length) * scale).round() as u32).max(1);
    camera.resized(side(camera.width), side(camera.height))
}

/// The importance of splats that no picture shows, of a scene of this radius: by their size, px.
pub(crate) fn unseen_worth(splats: &Splats, radius: f64) -> Vec<f64> {
    let pixels = (FOCAL_LENGTH_PX / (NEAR_DISTANCE_RADII * radius.max(1e-6))).powi(2);
    let unseen = |i: usize| {
        UNSEEN_IMPORTANCE * (splats.opacity(i) * cover(splats.log_scales[i]) * pixels).min(MAX_UNSEEN_PIXELS)
    };
    (0..splats.len()).map(unseen).collect()
}

/// Renders the pictures that splats are judged by.
struct Eye<'a> {
    renderer: &'a mut dyn Differentiable,
    progress: &'a mut dyn Progress,
    config: ForwardConfig,
    frame: Frame,
}

impl Eye<'_> {
    fn look(&mut self, splats: &Splats, camera: &Camera) -> Result<Vec<f32>> {
        if self.progress.is_stopped() {
            return Err(Error::Stopped);
        }
        let config = ForwardConfig { sh_degree: splats.sh_degree, ..self.config };
        self.renderer.forward(splats, camera, &config, &mut self.frame)?;
        Ok(self.frame.rgb.iter().map(|v| v.clamp(0.0, 1.0)).collect())
    }

    /// Returns the importance of each splat, px.
    fn worth(&mut self, splats: &Splats, cameras: &[(usize, Camera)], radius: f64) -> Result<Vec<f64>> {
        let mut worth = unseen_worth(splats, radius);
        let mut gradients = Gradients::default();
        for (_, camera) in cameras {
            self.look(splats, camera)?;
            self.renderer.backward(splats, &Upstream::default(), Learn::NONE, &mut gradients)?;
            for (index, weight) in gradients.visible.iter().zip(&gradients.weights) {
                worth[*index as usize] += f64::from(*weight);
            }
        }
        Ok(worth)
    }
}

/// The `target` splats that are worth most, with the others in them.
fn merged(splats: &Splats, worth: &[f64], target: usize) -> Splats {
    let mut order: Vec<usize> = (0..splats.len()).collect();
    order.sort_by(|a, b| worth[*b].total_cmp(&worth[*a]).then(a.cmp(b)));
    let (kept, gone) = order.split_at_mut(target);
    // They stay in the order of the scene.
    kept.sort_unstable();
    gone.sort_unstable();
    let places: Vec<[f64; 3]> = kept.iter().map(|i| splats.means[*i].map(f64::from)).collect();
    let tree = KdTree::new(&places);
    let mut taken: Vec<Vec<usize>> = vec![Vec::new(); kept.len()];
    for index in gone.iter().copied() {
        let at = splats.means[index].map(f64::from);
        let longest =
            |i: usize| f64::from(splats.log_scales[i].iter().fold(f32::MIN, |a, b| a.max(*b))).exp();
        let Some(near) = tree.nearest(&at, 1).pop() else { continue };
        let keeper = kept[near.index as usize];
        let alike = splats.groups[keeper] == splats.groups[index] && splats.groups[index] != Group::Sky;
        if alike && near.square.sqrt() <= MAX_MERGE_DISTANCE_SIGMA * (longest(index) + longest(keeper)) {
            taken[near.index as usize].push(index);
        }
    }
    let mut out = splats.select(kept);
    for (slot, (keeper, others)) in kept.iter().zip(&taken).enumerate() {
        if !others.is_empty() {
            let members: Vec<u32> =
                std::iter::once(keeper).chain(others).map(|index| *index as u32).collect();
            put(&mut out, slot, splats, worth, &members);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use wm_scene::splats::Splat;

    /// Two halves of a splat beside each other become one as wide as both, and as opaque.
    #[test]
    fn halves_become_a_whole() {
        let mut splats = Splats::with_capacity(3, 0);
        let half = |x: f32, red: f32| Splat {
            mean: [x, 0.0, 0.0],
            quat: [1.0, 0.0, 0.0, 0.0],
            log_scale: [0.0, 0.0, -3.0],
            logit_opacity: 0.0,
            rgb: [red, 0.5, 0.5],
            group: Group::Scene,
        };
        splats.push(&half(-1.0, 0.25));
        splats.push(&half(1.0, 0.75));
        splats.push(&half(50.0, 0.5));
        let one = merged(&splats, &[5.0, 5.0, 9.0], 2);
        assert_eq!(one.len(), 2);
        assert!(one.means[0][0].abs() < 1e-6);
        // Variance 1 of each and 1 of their distance from the middle.
        let mut scales = one.scales(0);
        scales.sort_by(f64::total_cmp);
        assert!((scales[2] - 2f64.sqrt()).abs() < 1e-6 && (scales[1] - 1.0).abs() < 1e-6);
        // What both cover is counted once: the product of two Gaussians of variance 1 at a distance
        // of 2.
        let overlap = 0.5 * 0.5 / 2.0 * (-0.5_f64 * 4.0 / 2.04).exp();
        let opacity = (2.0 * 0.5 - overlap) / 2f64.sqrt();
        assert!((one.opacity(0) - opacity).abs() < 1e-3, "{}", one.opacity(0));
        let grey = wm_scene::sh::color(one.sh_of(0), [0.0, 0.0, 1.0]);
        assert!(grey.iter().all(|v| (v - 0.5).abs() < 1e-6));
        assert_eq!(one.means[1], [50.0, 0.0, 0.0]);
        // What has no neighbour near is dropped, and nothing else changes.
        let two = merged(&splats, &[5.0, 5.0, 1.0], 2);
        assert_eq!(two, splats.select(&[0, 1]));
    }
}
