//! Optical flow of what falls: where each drop or flake that a picture shows is at the next
//! instant.

use super::FlowView;
use crate::drawing::Drawing;
use crate::layers::{LaterFrame, Row, Source};
use crate::shot::{PinholeContent, PinholeShot};
use crate::{Picture, PictureLayer, Result};
use glam::{DMat3, DVec2, DVec3};
use rayon::prelude::*;
use std::f64::consts::TAU;
use wm_render::Stats;
use wm_render::hooks::Particle;
use wm_render::stages::particles as stage;
use wm_scene::Camera;

pub(crate) const ROW: Row = Row {
    note: "of falling rain, snow and hail",
    source: Source::Later(|drawing, frame, picture| Box::pin(drawing.particle_flow(frame, picture))),
    values: |picture| picture.later(PictureLayer::ParticleFlow).into(),
    ..super::ROW
};

/// Added to the diagonal of the covariance in the picture, px^2, as in the drawing of particles.
const DILATION: f64 = stage::DILATION as f64;
/// Maximum optical depth of one particle, as in the drawing of particles.
const MAX_OPTICAL_DEPTH: f64 = stage::MAX_OPTICAL_DEPTH as f64;
/// A pixel takes the flow of a particle at this optical depth or more: it hides a twentieth of what
/// is behind it.
const MIN_OPTICAL_DEPTH: f64 = 0.05;
/// Rows of pixels in a strip; each strip is filled by one thread.
const STRIP_ROWS: usize = 16;

/// The ellipse of pixels that a particle covers, and its motion in the picture.
#[derive(Clone, Copy, Debug)]
struct ParticleFootprint {
    at: DVec2,
    /// Inverse covariance: xx, xy, yy, 1/px^2.
    inverse: [f64; 3],
    /// Half the height of the ellipse, px.
    half_height: f64,
    /// Half the width of the ellipse, px.
    half_width: f64,
    /// Squared Mahalanobis distance from the centre to the edge of the ellipse.
    squared_radius: f64,
    depth: f64,
    vector: DVec2,
}

/// Computes the integral of `(1 - e^-t) / t` from 0 to `p`.
fn ein(p: f64) -> f64 {
    let (mut sum, mut term) = (0.0, 1.0);
    // Alternating and absolutely small: exact enough up to 16.
    for n in 1..80 {
        let n = f64::from(n);
        term *= -p / n;
        sum -= term / n;
    }
    sum
}

/// Solves `Ein(p) = w`: the optical depth at the centre of a Gaussian whose integrated opacity is
/// `w` times the area of its ellipse.
fn peak_optical_depth(w: f64) -> f64 {
    if w >= ein(MAX_OPTICAL_DEPTH) {
        return MAX_OPTICAL_DEPTH;
    }
    let (mut low, mut high) = (0.0, MAX_OPTICAL_DEPTH);
    for _ in 0..30 {
        let middle = 0.5 * (low + high);
        *(if ein(middle) < w { &mut low } else { &mut high }) = middle;
    }
    0.5 * (low + high)
}

impl ParticleFootprint {
    /// Projects a particle with its velocity relative to the camera (scene units a second, world
    /// axes). Returns `None` if it is too faint in every pixel, or is behind either camera.
    fn project(
        particle: &Particle,
        velocity: DVec3,
        camera: &Camera,
        next: &Camera,
        seconds: f64,
        drift: DVec3,
    ) -> Option<Self> {
        let vector = |v: [f32; 3]| DVec3::from_array(v.map(f64::from));
        let rotation = camera.rotation();
        let offset = vector(particle.offset);
        let p = rotation * offset;
        if p.z <= camera.near {
            return None;
        }
        let (fx, fy) = (camera.fx / p.z, camera.fy / p.z);
        let jacobian = |v: DVec3| DVec2::new(fx * (v.x - p.x / p.z * v.z), fy * (v.y - p.y / p.z * v.z));
        let sigma = f64::from(particle.sigma);
        let axes = DMat3::IDENTITY * sigma;
        let reaches = particle.reach.map(|reach| rotation * vector(reach));
        let columns = [axes.x_axis, axes.y_axis, axes.z_axis, reaches[0], reaches[1]].map(jacobian);
        let sum = |of: &dyn Fn(&DVec2) -> f64| columns.iter().map(of).sum::<f64>();
        let (xx, xy, yy) =
            (sum(&|c| c.x * c.x) + DILATION, sum(&|c| c.x * c.y), sum(&|c| c.y * c.y) + DILATION);
        let det = xx * yy - xy * xy;
        let cover = f64::from(particle.area) * fx * fy / (TAU * det.sqrt());
        // Most particles are far too faint: skip the search for their peak.
        if cover < 0.5 * MIN_OPTICAL_DEPTH {
            return None;
        }
        let reach = 2.0 * (peak_optical_depth(cover) / MIN_OPTICAL_DEPTH).ln();
        if reach <= 0.0 {
            return None;
        }
        let project = |camera: &Camera, p: DVec3| {
            DVec2::new(camera.fx * p.x / p.z + camera.cx, camera.fy * p.y / p.z + camera.cy)
        };
        let moved = next.rotation() * (offset + velocity * seconds + drift);
        if moved.z <= next.near {
            return None;
        }
        let at = project(camera, p);
        Some(Self {
            at,
            inverse: [yy / det, -xy / det, xx / det],
            half_height: (reach * yy).sqrt(),
            half_width: (reach * xx).sqrt(),
            squared_radius: reach,
            depth: p.z,
            vector: project(next, moved) - at,
        })
    }
}

/// The flow of particles from a picture to the next, `[H, W, 2]`: each pixel has the vector of the
/// nearest particle that hides at least a twentieth of it and is nearer than the scene; NaN where
/// there is none. Velocities are relative to the camera, which itself moves by `velocity`, scene
/// units a second, world axes.
///
/// # Panics
/// If the view's depth has another size than its camera.
fn particle_flow(
    from: &FlowView<'_>,
    next: &Camera,
    seconds: f64,
    velocity: [f64; 3],
    particles: &[(Particle, [f64; 3])],
) -> Vec<f32> {
    let (width, height) = (from.camera.width as usize, from.camera.height as usize);
    assert_eq!(from.depth.len(), width * height, "a depth per pixel");
    // From where a particle would be seen by a camera that goes on evenly, to where the next camera
    // is.
    let drift = DVec3::from_array(velocity) * seconds + from.camera.center() - next.center();
    let project = |(particle, own): &(Particle, [f64; 3])| {
        ParticleFootprint::project(particle, DVec3::from_array(*own), &from.camera, next, seconds, drift)
    };
    let footprints: Vec<ParticleFootprint> = particles.par_iter().filter_map(project).collect();
    let mut strips: Vec<Vec<u32>> = vec![Vec::new(); height.div_ceil(STRIP_ROWS)];
    for (index, one) in footprints.iter().enumerate() {
        let strip = |y: f64| (y.max(0.0) as usize / STRIP_ROWS).min(strips.len());
        let (first, last) =
            (strip(one.at.y - one.half_height), strip(one.at.y + one.half_height + STRIP_ROWS as f64));
        if one.at.y + one.half_height > 0.0 {
            strips[first..last].iter_mut().for_each(|strip| strip.push(index as u32));
        }
    }
    let mut vectors = vec![f32::NAN; 2 * width * height];
    vectors.par_chunks_mut(2 * width * STRIP_ROWS).zip(&strips).enumerate().for_each(
        |(strip, (vectors, list))| {
            let top = strip * STRIP_ROWS;
            let mut nearest = vec![f64::INFINITY; vectors.len() / 2];
            for one in list.iter().map(|index| &footprints[*index as usize]) {
                let column = |x: f64| (x.max(0.0) as usize).min(width);
                let (left, right) =
                    (column(one.at.x - one.half_width), column(one.at.x + one.half_width + 1.0));
                for row in 0..nearest.len() / width {
                    for x in left..right {
                        let d = DVec2::new(x as f64 + 0.5, (top + row) as f64 + 0.5) - one.at;
                        let [xx, xy, yy] = one.inverse;
                        let squared = xx * d.x * d.x + 2.0 * xy * d.x * d.y + yy * d.y * d.y;
                        let own = row * width + x;
                        let scene = f64::from(from.depth[top * width + own]);
                        let is_before = scene <= 0.0 || one.depth < scene;
                        if squared <= one.squared_radius && is_before && one.depth < nearest[own] {
                            nearest[own] = one.depth;
                            vectors[2 * own..2 * own + 2].copy_from_slice(&one.vector.as_vec2().to_array());
                        }
                    }
                }
            }
        },
    );
    vectors
}

impl Drawing<'_> {
    /// Finds the flow of what falls from one pinhole picture to the next: of rain, snow and hail as
    /// they are drawn, not of splashes. Particles go on with their velocity of the first instant.
    async fn particle_flow(&mut self, frame: &LaterFrame<'_>, picture: &mut Picture) -> Result<Stats> {
        let (from, Some(to)) = (&frame.shot, &frame.next) else { return Ok(Stats::default()) };
        let shot = PinholeShot { content: PinholeContent::Particles, parts: &[], ..*from };
        let mut fallen = Picture::default();
        self.pinhole(&shot, &mut fallen).await?;
        let depth = self.own_surface_depth(frame, picture).await?;
        let view = FlowView::new(None, &from.camera.camera, depth);
        let velocity = from.camera.velocity.map(|v| v / self.place.site().metres_per_unit);
        let (next, seconds) = (&to.camera.camera, to.time - from.time);
        let flow = self
            .renderer
            .backend()
            .pool()
            .install(|| particle_flow(&view, next, seconds, velocity, &fallen.falling));
        picture.later.insert(PictureLayer::ParticleFlow, flow);
        Ok(Stats::default())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A drop has the flow of its own way, where it is and nowhere else, before the scene alone;
    /// the nearest counts.
    #[test]
    fn a_drop_flows_by_its_own_velocity() {
        let camera = Camera::looking((80, 60), 60.0, DVec3::ZERO, DVec3::X, DVec3::Z).unwrap();
        let eye = DVec3::new(0.2, 0.0, 0.0);
        let next = Camera::looking((80, 60), 60.0, eye, eye + DVec3::X, DVec3::Z).unwrap();
        let drop = |x: f32, y: f32| Particle {
            offset: [x, y, 0.1],
            sigma: 0.02,
            reach: [[0.0, 0.0, 0.05], [0.0; 3]],
            area: 0.02,
            rgb: [1.0; 3],
        };
        // It falls by 6 and the camera drives by 10 a second: relative to that it comes towards it.
        let relative = [-10.0, 0.0, -6.0];
        let particles = [(drop(3.0, 0.0), relative), (drop(2.0, 0.0), relative), (drop(3.0, 0.8), relative)];
        let want = |x: f64, y: f64| {
            let (a, b, _) = camera.project(DVec3::new(x, y, 0.1)).unwrap();
            let (c, d, _) = next.project(DVec3::new(x, y, 0.1 - 6.0 * 0.02)).unwrap();
            ([a, b], [c - a, d - b])
        };
        for (depth, hides) in [(0.0, false), (10.0, false), (2.5, true), (1.0, true)] {
            let depth = vec![depth; 80 * 60];
            let view = FlowView::new(None, &camera, &depth);
            let flow = particle_flow(&view, &next, 0.02, [10.0, 0.0, 0.0], &particles);
            let at = |[x, y]: [f64; 2]| {
                let pixel = 2 * (y as usize * 80 + x as usize);
                [flow[pixel], flow[pixel + 1]].map(f64::from)
            };
            let (place, near) = want(2.0, 0.0);
            let found = at(place);
            if depth[0] == 1.0 {
                assert!(flow.iter().all(|v| v.is_nan()));
                continue;
            }
            assert!((0..2).all(|k| (found[k] - near[k]).abs() < 1e-3), "{found:?} and {near:?}");
            let (place, side) = want(3.0, 0.8);
            let found = at(place);
            if hides {
                assert!(found[0].is_nan());
            } else {
                assert!((0..2).all(|k| (found[k] - side[k]).abs() < 1e-3), "{found:?} and {side:?}");
            }
            let known = flow.iter().filter(|v| !v.is_nan()).count() / 2;
            assert!((10..400).contains(&known), "{known} px");
        }
    }

    #[test]
    fn peaks_are_those_of_their_cover() {
        for w in [1e-3, 0.1, 1.0, 3.0] {
            assert!((ein(peak_optical_depth(w)) - w).abs() < 1e-6 * (1.0 + w), "{w}");
        }
        assert!((ein(1.0) - 0.796_599_599_297).abs() < 1e-9);
    }
}
