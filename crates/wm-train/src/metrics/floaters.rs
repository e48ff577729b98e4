//! Splats that hang in the air: in front of the true surface, where the photos saw through.
//!
//! The centre of a splat is projected into every view. It is in front if it is nearer than the true
//! depth there by more than [`DEPTH_TOLERANCE_SHARE`]; of the pixel and its eight neighbours the
//! nearest surface counts, since a centre near a silhouette falls on either side of it. The sky is
//! infinitely far. Where the truth is not known nothing is said.
//!
//! Only splats of opacity above 0.1 that are not the sky's are looked at.

use super::coverage::DEPTH_TOLERANCE_SHARE;
use rayon::prelude::*;
use wm_render::reference;
use wm_scene::{Camera, Group, Rasterization, Splats};

/// Splats fainter than this are not looked at: opacity.
pub(crate) const MIN_OPACITY: f64 = 0.1;

/// The numbers of floaters; see `Floaters`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FloaterShare {
    /// Splats that any view has in it, where its truth is known.
    pub splats: usize,
    /// Splats that are in front of a surface in any view.
    pub floaters: usize,
    /// The share of the splats in view that is in front, each weighted by opacity times its area in
    /// the image and without those behind the surface, over all views, 0-1.
    pub weighted: f64,
}

impl FloaterShare {
    /// Share of the splats in view that are in front of a surface in any, 0-1.
    #[must_use]
    pub fn share(&self) -> f64 {
        self.floaters as f64 / self.splats.max(1) as f64
    }
}

/// Adds up views.
pub(crate) struct Floaters<'a> {
    splats: &'a Splats,
    rasterization: Rasterization,
    /// Where each splat was seen, `[N]`.
    seen: Vec<SplatPlace>,
    /// Weight in front, and of all that is not behind.
    weights: [f64; 2],
}

/// The position of a splat relative to true surfaces, in the views so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
enum SplatPlace {
    /// In no view.
    #[default]
    Nowhere,
    /// Nowhere in front of a surface.
    Sound,
    /// In front of one.
    InFront,
}

impl<'a> Floaters<'a> {
    /// Begins with no view.
    pub(crate) fn new(splats: &'a Splats, rasterization: Rasterization) -> Self {
        Self { splats, rasterization, seen: vec![SplatPlace::Nowhere; splats.len()], weights: [0.0; 2] }
    }

    /// Adds a view; `truth` is its true depth, `[H, W]`, view z in scene units: 0 where it is not
    /// known, infinite in the sky. The same for any number of threads.
    ///
    /// # Panics
    /// If `truth` is not of the camera's size.
    pub(crate) fn add(&mut self, camera: &Camera, truth: &[f32]) {
        let (width, height) = (camera.width as usize, camera.height as usize);
        assert_eq!(truth.len(), width * height, "a truth of the camera's size");
        let splats = self.splats;
        let look = |index: usize| -> Option<(SplatPlace, [f64; 2])> {
            if splats.groups[index] == Group::Sky || splats.opacity(index) <= MIN_OPACITY {
                return None;
            }
            let seen = reference::project(splats, index, camera, self.rasterization, 1.0)?;
            let [x, y] = seen.mean2d;
            if !(x >= 0.0 && y >= 0.0 && x < width as f64 && y < height as f64) {
                return None;
            }
            let nearest = nearest(truth, width, height, x as usize, y as usize)?;
            // A Gaussian's integral, at most the whole picture.
            let [xx, xy, yy] = seen.cov2d;
            let area = std::f64::consts::TAU * (xx * yy - xy * xy).max(0.0).sqrt();
            let weight = seen.opacity * area.min((width * height) as f64);
            let slack = f64::from(DEPTH_TOLERANCE_SHARE);
            if seen.depth < nearest * (1.0 - slack) {
                Some((SplatPlace::InFront, [weight, weight]))
            } else {
                let is_behind = seen.depth > nearest * (1.0 + slack);
                Some((SplatPlace::Sound, [0.0, if is_behind { 0.0 } else { weight }]))
            }
        };
        let looked: Vec<_> = (0..splats.len()).into_par_iter().map(look).collect();
        for (known, looked) in self.seen.iter_mut().zip(looked) {
            let Some((seen, weights)) = looked else { continue };
            *known = (*known).max(seen);
            for (sum, weight) in self.weights.iter_mut().zip(weights) {
                *sum += weight;
            }
        }
    }

    /// Returns the numbers; `None` if no splat is in any view.
    pub(crate) fn share(&self) -> Option<FloaterShare> {
        let count = |least: SplatPlace| self.seen.iter().filter(|seen| **seen >= least).count();
        let splats = count(SplatPlace::Sound);
        let weighted = self.weights[0] / self.weights[1].max(f64::MIN_POSITIVE);
        (splats > 0).then(|| FloaterShare { splats, floaters: count(SplatPlace::InFront), weighted })
    }
}

/// The nearest surface about a pixel; `None` if the pixel's own is not known.
fn nearest(truth: &[f32], width: usize, height: usize, x: usize, y: usize) -> Option<f64> {
    let is_known = |depth: f32| depth > 0.0;
    if !is_known(truth[y * width + x]) {
        return None;
    }
    let rows = y.saturating_sub(1)..(y + 2).min(height);
    let columns = x.saturating_sub(1)..(x + 2).min(width);
    let about = rows.flat_map(|y| columns.clone().map(move |x| truth[y * width + x]));
    Some(f64::from(about.filter(|depth| is_known(*depth)).fold(f32::INFINITY, f32::min)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use wm_scene::splats::{Splat, logit};

    fn splat(x: f32, z: f32, opacity: f64, group: Group) -> Splat {
        Splat {
            mean: [x, 0.0, z],
            quat: [1.0, 0.0, 0.0, 0.0],
            log_scale: [-3.0; 3],
            logit_opacity: logit(opacity) as f32,
            rgb: [0.5; 3],
            group,
        }
    }

    #[test]
    fn what_hangs_in_front_of_the_surface_floats() {
        let camera = Camera::looking((9, 5), 60.0, DVec3::ZERO, DVec3::Z, DVec3::NEG_Y).unwrap();
        let mut splats = Splats::with_capacity(8, 0);
        // In front, on the surface, behind it; too faint; sky; outside; unknown; against the sky.
        for (x, z, opacity, group) in [
            (0.0, 5.0, 0.9, Group::Scene),
            (0.0, 9.9, 0.9, Group::Scene),
            (0.0, 12.0, 0.9, Group::Scene),
            (0.0, 5.0, 0.05, Group::Scene),
            (0.0, 5.0, 0.9, Group::Sky),
            (90.0, 5.0, 0.9, Group::Scene),
            (-7.5, 8.0, 0.9, Group::Scene),
            (7.5, 8.0, 0.9, Group::Scene),
        ] {
            splats.push(&splat(x, z, opacity, group));
        }
        let row = [0.0, 0.0, 0.0, 10.0, 10.0, 10.0, 10.0, f32::INFINITY, f32::INFINITY];
        let truth: Vec<f32> = row.iter().copied().cycle().take(45).collect();
        let mut floaters = Floaters::new(&splats, Rasterization::Classic);
        assert_eq!(floaters.share(), None);
        floaters.add(&camera, &truth);
        let found = floaters.share().unwrap();
        assert_eq!((found.splats, found.floaters), (4, 2));
        assert!(found.weighted > 0.5 && found.weighted < 1.0, "{found:?}");
        // Nothing changes by a view that says nothing.
        floaters.add(&camera, &[0.0; 45]);
        assert_eq!(floaters.share(), Some(found));
    }

    #[test]
    fn at_silhouettes_the_nearer_side_counts() {
        let truth = [f32::INFINITY, 4.0, 9.0, 0.0];
        let at = |x| nearest(&truth, 4, 1, x, 0);
        assert_eq!([at(0), at(1), at(2), at(3)], [Some(4.0), Some(4.0), Some(4.0), None]);
    }
}
