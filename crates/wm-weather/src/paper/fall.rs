//! The paper's noise scene: rain and snow as Gaussians of their own in a box about the camera.
//!
//! # As printed
//! Gaussians at random places, grey. A raindrop is one long Gaussian, a snowflake three at 60
//! degrees to each other. For a video each is displaced from frame to frame. The cloud is split
//! into k sub-clouds of at most so many Gaussians each, so that seldom two of one cloud lie over
//! one pixel.
//!
//! # Where the paper leaves it open
//! - **The box.** A cube about the camera in which things leave on one side and come in on the
//!   other. They stand in the world, so that a camera that moves goes by them. Of them the ball in
//!   it is seen: its corners would show as denser.
//! - **Orientation.** The long axis of a drop lies along its velocity as the camera sees it: the
//!   random rotation is about that axis, where it changes nothing. A flake lies in any plane.
//! - **Displacement.** Fall speed times time, each by its own factor of 0.75 to 1.25, and the drift
//!   of the wind.
//! - **Sub-clouds.** Slices of depth with the same number in each.
//!
//! All is a pure function of (seed, number of the thing, time).

use super::fog::PaperFog;
use crate::grade::ColorGrade;
use crate::level::{from_level, level_axes, to_level};
use crate::optics::Site;
use crate::particles::fall::WindSample;
use crate::particles::random::RandomSequence;
use crate::particles::{ParticleShape, PrecipitationKind};
use glam::{DQuat, DVec3};
use std::f64::consts::{FRAC_PI_3, TAU};
use wm_render::hooks::ParticleView;
use wm_scene::splats::{Splat, logit};
use wm_scene::{Camera, Group, Splats};

/// Nearest to the camera, m: what is nearer fills the picture.
const MIN_DISTANCE_M: f64 = 0.5;
/// Factors on the fall speed, from and to.
const SPEED_FACTORS: [f64; 2] = [0.75, 1.25];
/// Standard deviation of a Gaussian as a share of its length: two to each side.
const SIGMA_RATIO: f64 = 0.25;
/// Projected width at which things count as too far.
const MIN_WIDTH_PX: f64 = 0.3;
const FLAKE_ARM_COUNT: usize = 3;

/// Rain or snow of the paper at one instant.
#[derive(Clone, Debug, PartialEq)]
pub struct PaperFall {
    /// Drops or flakes.
    pub(crate) kind: &'static PrecipitationKind,
    /// The seed of random positions.
    pub(crate) seed: u64,
    /// The number of particles in the box; a fraction is dropped.
    pub(crate) number: f64,
    /// Edge of the box, m.
    pub(crate) edge: f64,
    /// Mean fall speed now, m/s.
    pub(crate) speed: f64,
    /// Distance fallen since time 0 at the mean speed, m.
    pub(crate) fallen: f64,
    /// Display-referred colour, 0-1.
    pub(crate) color: [f64; 3],
    /// Opacity of a Gaussian, 0-1.
    pub(crate) opacity: f64,
    /// Length of a drop, or of a flake's arms, m: four standard deviations.
    pub(crate) length: f64,
    /// Width, m.
    pub(crate) width: f64,
    /// k: how many sub-clouds.
    pub(crate) layers: usize,
    /// L_sky, display-referred, 0-1.
    pub(crate) sky: f64,
    /// Least and greatest difference of brightness that counts.
    pub(crate) t: [f64; 2],
    /// t_D, m; `None` where the projected width is 0.3 px.
    pub(crate) t_d: Option<f64>,
    /// t_C, brightness.
    pub(crate) t_c: f64,
    /// Depth that counts as 1, scene units.
    pub(crate) d_max: f64,
    /// The fog over the distance.
    pub(crate) fog: PaperFog,
    /// Standard deviation of the last blur, px; 0 for none.
    pub(crate) blur: f64,
    /// The colour filter.
    pub(crate) filter: ColorGrade,
}

/// The place, the wind and the camera of the paper's fall.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PaperFallContext<'a> {
    /// The place.
    pub(crate) site: &'a Site,
    /// The wind.
    pub(crate) wind_now: WindSample,
    /// The camera.
    pub(crate) camera: &'a Camera,
    /// Velocity of the camera, m/s, world axes.
    pub(crate) velocity: [f64; 3],
}

/// One drop or flake.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PaperParticle {
    /// Number of the particle.
    pub(crate) index: u64,
    /// Place from the camera's centre, world axes, m.
    pub(crate) offset: [f64; 3],
    /// View z, m.
    pub(crate) depth: f64,
    /// Fall speed, m/s.
    pub(crate) speed: f64,
}

impl PaperFall {
    /// t_D in metres in front of a camera.
    pub(crate) fn reach(&self, camera: &Camera) -> f64 {
        let seen = match self.kind.shape {
            ParticleShape::Ball => self.width,
            ParticleShape::Flake => self.length,
        };
        self.t_d.unwrap_or_else(|| f64::from(ParticleView::new(camera).pixels()) * seen / MIN_WIDTH_PX)
    }

    /// The numbers of thing `index`.
    fn draws(&self, index: u64) -> RandomSequence {
        let kind = self.kind.key | 0x9a9e;
        let own =
            RandomSequence::new(self.seed ^ kind << 20).bits() ^ index.wrapping_mul(0xd1b5_4a32_d192_ed03);
        // Twice, since sequences whose keys are near may run into each other.
        RandomSequence::new(RandomSequence::new(own).bits())
    }

    /// Returns the particles that the camera may see, the nearest first; of equal depth by number.
    pub(crate) fn noise(&self, before: &PaperFallContext<'_>) -> Vec<PaperParticle> {
        let view = ParticleView::new(before.camera);
        let axes = level_axes(before.site.up);
        let metres = before.site.metres_per_unit;
        let center = to_level(&axes, view.center.map(|v| v * metres));
        let mut seen = Vec::new();
        for index in 0..self.number as u64 {
            let mut draws = self.draws(index);
            let home = [draws.uniform(), draws.uniform(), draws.uniform()].map(|v| v * self.edge);
            let factor = SPEED_FACTORS[0] + (SPEED_FACTORS[1] - SPEED_FACTORS[0]) * draws.uniform();
            let come = [before.wind_now.drift[0], before.wind_now.drift[1], -factor * self.fallen];
            let level: [f64; 3] = std::array::from_fn(|k| {
                (home[k] + come[k] - center[k] + 0.5 * self.edge).rem_euclid(self.edge) - 0.5 * self.edge
            });
            let offset = from_level(&axes, level);
            let depth = (0..3).map(|k| f64::from(view.rotation[2][k]) * offset[k]).sum();
            let units = offset.map(|v| (v / metres) as f32);
            let is_near = offset.iter().map(|v| v * v).sum::<f64>() <= 0.25 * self.edge * self.edge;
            if is_near && depth > MIN_DISTANCE_M && view.may_see(units, (self.length / metres) as f32) {
                seen.push(PaperParticle { index, offset, depth, speed: factor * self.speed });
            }
        }
        seen.sort_by(|a, b| a.depth.total_cmp(&b.depth).then(a.index.cmp(&b.index)));
        seen
    }

    /// The sub-clouds, the farthest first: slices of depth of as many things each, none of them
    /// empty.
    pub(crate) fn sub_clouds(&self, before: &PaperFallContext<'_>) -> Vec<Splats> {
        let noise = self.noise(before);
        let most = noise.len().div_ceil(self.layers.max(1)).max(1);
        noise.chunks(most).rev().map(|slice| self.splats(slice, before)).collect()
    }

    /// Things as Gaussians.
    fn splats(&self, things: &[PaperParticle], before: &PaperFallContext<'_>) -> Splats {
        let each = if self.kind.shape == ParticleShape::Flake { FLAKE_ARM_COUNT } else { 1 };
        let mut splats = Splats::with_capacity(each * things.len(), 0);
        let metres = before.site.metres_per_unit;
        let [x, y, up] = level_axes(before.site.up).map(DVec3::from_array);
        let [wind_x, wind_y] = before.wind_now.wind;
        let air = x * wind_x + y * wind_y - DVec3::from_array(before.velocity);
        let center = before.camera.center();
        let size = [self.length, self.width, self.width].map(|v| (SIGMA_RATIO * v / metres).ln() as f32);
        for thing in things {
            let mean = (center + DVec3::from_array(thing.offset) / metres).to_array().map(|v| v as f32);
            let mut add = |turn: DQuat| {
                splats.push(&Splat {
                    mean,
                    quat: [turn.w, turn.x, turn.y, turn.z].map(|v| v as f32),
                    log_scale: size,
                    logit_opacity: logit(self.opacity) as f32,
                    rgb: self.color.map(|v| v as f32),
                    group: Group::Scene,
                });
            };
            match self.kind.shape {
                ParticleShape::Ball => {
                    // Down, where it stands still in front of the camera.
                    let way = (air - up * thing.speed).try_normalize().unwrap_or(-up);
                    add(DQuat::from_rotation_arc(DVec3::X, way));
                }
                ParticleShape::Flake => {
                    let turn = any_turn(&mut self.draws(thing.index ^ 1 << 63));
                    (0..FLAKE_ARM_COUNT)
                        .for_each(|arm| add(turn * DQuat::from_rotation_z(FRAC_PI_3 * arm as f64)));
                }
            }
        }
        splats
    }
}

/// A rotation, all equally likely (Shoemake 1992).
fn any_turn(draws: &mut RandomSequence) -> DQuat {
    let share = draws.uniform();
    let [(a, b), (c, d)] = [(TAU * draws.uniform()).sin_cos(), (TAU * draws.uniform()).sin_cos()];
    let (near, far) = ((1.0 - share).sqrt(), share.sqrt());
    DQuat::from_xyzw(near * a, near * b, far * c, far * d)
}

#[cfg(test)]
mod tests;
