//! Echoes of drops and flakes: the very particles that cameras see, met one by one near the sensor.
//!
//! A particle whose middle lies in the beam sends back `rho min(1, (D / (theta r))^2)` of it as a
//! surface across it would. Its shadow on what lies behind is in the extinction of the air already.
//! Sweeps are cut into short times; in each the particles are gathered once in the directions of
//! its beams, and fly evenly.

use crate::echo::{Echo, EchoClass, MIN_ECHO_POWER};
use crate::model::LidarModel;
use crate::pattern::Beam;
use crate::pose::SensorPose;
use crate::scene::LidarScene;
use glam::{DMat3, DVec3};
use rayon::prelude::*;
use wm_render::hooks::ParticleView;
use wm_scene::Camera;
use wm_weather::InfraredAir;
use wm_weather::particles::{NearParticle, ParticleShape};

/// Reflectances of drops and flakes where water does not absorb, and where it does. Drops:
/// geometric optics. Flakes: from memory.
const DROP_REFLECTANCE: [f64; 2] = [0.023, 0.005];
const FLAKE_REFLECTANCE: [f64; 2] = [0.6, 0.15];
/// Longest time for which particles are gathered once, s.
const MAX_SLICE_S: f64 = 2e-3;
/// Shortest and longest reach of the search, m.
const REACH_RANGE_M: [f64; 2] = [0.3, 60.0];
/// Cells across a face of the cube of directions.
const MAX_FACE_CELLS: usize = 90;
/// Least power of an echo that is searched for, as a share of the least power that is detected
/// without noise: below it one in 10^3 is detected.
const MIN_SIGNAL: f64 = 0.4;

/// A pulse: its beam, its pose and its direction in the world.
#[derive(Clone, Copy)]
pub(crate) struct Pulse {
    pub(crate) beam: Beam,
    pub(crate) pose: SensorPose,
    pub(crate) direction: DVec3,
}

/// The reflectance of a particle.
fn reflectance(shape: ParticleShape, model: &LidarModel) -> f64 {
    let of = match shape {
        ParticleShape::Ball => DROP_REFLECTANCE,
        ParticleShape::Flake => FLAKE_REFLECTANCE,
    };
    of[usize::from(model.is_absorbed())]
}

/// The range up to which a particle of a diameter, m, may be detected in clear air, m.
fn reach(shape: ParticleShape, diameter: f64, model: &LidarModel) -> f64 {
    let signal = reflectance(shape, model) / (MIN_SIGNAL * model.least_power());
    let across = diameter / (1e-3 * model.divergence);
    // Beyond `across` the beam is wider than the particle.
    let far = (signal * across * across).powf(0.25);
    let found = if far > across { far } else { signal.sqrt() };
    found.clamp(REACH_RANGE_M[0], REACH_RANGE_M[1].min(model.range[1]))
}

/// The echoes of particles, with the number of their pulse, in the order of pulses.
pub(crate) fn echoes(
    pulses: &[Pulse],
    scene: &LidarScene<'_>,
    model: &LidarModel,
    air: &InfraredAir,
    duration: f64,
) -> Vec<(u32, Echo)> {
    if scene.weather.falling.is_empty() {
        return Vec::new();
    }
    let count = (duration / MAX_SLICE_S).ceil().max(1.0) as usize;
    let mut slices = vec![Vec::new(); count];
    for (index, pulse) in pulses.iter().enumerate() {
        let slice = ((pulse.beam.time / duration * count as f64) as usize).min(count - 1);
        slices[slice].push(index as u32);
    }
    let of_slice = |(slice, own): (usize, &Vec<u32>)| {
        let length = duration / count as f64;
        let middle = length * (slice as f64 + 0.5);
        let mut faces = vec![Vec::new(); 6];
        for index in own {
            faces[face_of(pulses[*index as usize].direction)].push(*index);
        }
        let mut found = Vec::new();
        for (face, own) in faces.iter().enumerate().filter(|(_, own)| !own.is_empty()) {
            let face = face_axes(face);
            FaceSlice { scene, model, air, pulses, own, face, middle, length }.add_echoes(&mut found);
        }
        found
    };
    let mut found: Vec<(u32, Echo)> = slices.par_iter().enumerate().flat_map_iter(of_slice).collect();
    found.sort_by_key(|(pulse, _)| *pulse);
    found
}

/// The face of a cube that a direction meets.
fn face_of(direction: DVec3) -> usize {
    let size = direction.abs();
    let axis = size.max_position();
    2 * axis + usize::from(direction[axis] < 0.0)
}

/// The axes of a camera that looks at a face: right, down and ahead, as rows.
fn face_axes(face: usize) -> DMat3 {
    let ahead = DVec3::AXES[face / 2] * if face.is_multiple_of(2) { 1.0 } else { -1.0 };
    let right = DVec3::AXES[(face / 2 + 1) % 3];
    DMat3::from_cols(right, ahead.cross(right), ahead).transpose()
}

/// Pulses of a short time that go through one face.
struct FaceSlice<'a> {
    scene: &'a LidarScene<'a>,
    model: &'a LidarModel,
    air: &'a InfraredAir,
    pulses: &'a [Pulse],
    own: &'a [u32],
    face: DMat3,
    /// After the start of the sweep, s.
    middle: f64,
    length: f64,
}

impl FaceSlice<'_> {
    /// The point at which a direction (world) meets the plane of the face at distance 1.
    fn on_face(&self, direction: DVec3) -> [f64; 2] {
        let seen = self.face * direction;
        [seen.x / seen.z, seen.y / seen.z]
    }

    /// Appends the echoes of the particles that fly through the face, with their pulses.
    fn add_echoes(&self, found: &mut Vec<(u32, Echo)>) {
        let (scene, model) = (self.scene, self.model);
        let metres = scene.site.metres_per_unit;
        let places: Vec<[f64; 2]> =
            self.own.iter().map(|index| self.on_face(self.pulses[*index as usize].direction)).collect();
        let fold = |pick: fn(f64, f64) -> f64, start: f64| {
            places.iter().fold([start; 2], |so_far, at| [0, 1].map(|k| pick(so_far[k], at[k])))
        };
        let (low, high) = (fold(f64::min, f64::INFINITY), fold(f64::max, f64::NEG_INFINITY));
        let theta = 1e-3 * model.divergence;
        // The middle of the origins; beams start a little beside it.
        let origin = |index: &u32| self.pulses[*index as usize].pose.origin;
        let center = self.own.iter().map(origin).sum::<DVec3>() / self.own.len() as f64;
        let off = self.own.iter().map(|index| origin(index).distance(center)).fold(0.0, f64::max) * metres;
        // Room for beams that are cones, and start beside the middle: of particles a hand's breadth
        // away.
        let room = theta + off / REACH_RANGE_M[0];
        let view = view(&self.face, center, low.map(|v| v - room), high.map(|v| v + room));
        let near = |shape: ParticleShape, diameter: f64| reach(shape, diameter, model) + off;
        let (shelter, after, duration) = (scene.shelter, self.middle, self.length);
        let particles = scene.weather.near_particles(scene.path, &view, shelter, after, duration, &near);
        // A grid over the pulses' places, as lists one after the other.
        let cells = ((self.own.len() as f64).sqrt() as usize).clamp(1, MAX_FACE_CELLS);
        let scale = [0, 1].map(|k| cells as f64 / (high[k] - low[k]).max(1e-9));
        let cell = |value: f64, k: usize| (((value - low[k]) * scale[k]).max(0.0) as usize).min(cells - 1);
        let mut lists = vec![Vec::new(); cells * cells];
        for (place, index) in places.iter().zip(self.own) {
            lists[cell(place[1], 1) * cells + cell(place[0], 0)].push(*index);
        }
        for particle in &particles {
            let at = DVec3::from_array(particle.offset);
            let seen = self.face * at;
            if seen.z <= 0.0 {
                continue;
            }
            let speed = DVec3::from_array(particle.velocity).length();
            let spread = 0.5 * speed * self.length + off + 0.5 * particle.diameter;
            // Tangents grow faster than angles towards the corners of a face.
            let reach = 3.0 * (spread / seen.z.max(1e-3) + 0.5 * theta);
            let middle = [seen.x / seen.z, seen.y / seen.z];
            if (0..2).any(|k| middle[k] + reach < low[k] || middle[k] - reach > high[k]) {
                continue;
            }
            for row in cell(middle[1] - reach, 1)..=cell(middle[1] + reach, 1) {
                for column in cell(middle[0] - reach, 0)..=cell(middle[0] + reach, 0) {
                    for index in &lists[row * cells + column] {
                        let pulse = &self.pulses[*index as usize];
                        let from = (pulse.pose.origin - center) * metres;
                        found.extend(self.meet(particle, pulse, from).map(|echo| (*index, echo)));
                    }
                }
            }
        }
    }

    /// The echo of a particle in the beam of a pulse that starts at `from`, m from the middle of
    /// the view.
    fn meet(&self, particle: &NearParticle, pulse: &Pulse, from: DVec3) -> Option<Echo> {
        let (model, direction) = (self.model, pulse.direction);
        let time = pulse.beam.time - self.middle;
        let at = DVec3::from_array(particle.offset) + DVec3::from_array(particle.velocity) * time - from;
        let along = at.dot(direction);
        if along <= 0.0 {
            return None;
        }
        let beam = 1e-3 * model.divergence * along;
        let across = (at - direction * along).length();
        if across > 0.5 * beam.max(particle.diameter) {
            return None;
        }
        let range = at.length();
        let share = (particle.diameter / beam).powi(2).min(1.0);
        let units = range / self.scene.site.metres_per_unit;
        let kept = self.air.transmittance(pulse.pose.origin.to_array(), direction.to_array(), units);
        let received = kept * kept * model.overlap_at(range) / (range * range);
        let power = reflectance(particle.shape, model) * share * received;
        let class = match particle.shape {
            ParticleShape::Ball => EchoClass::Drop,
            ParticleShape::Flake => EchoClass::Flake,
        };
        (power >= MIN_ECHO_POWER * model.least_power()).then_some(Echo { range, power, class, label: 0 })
    }
}

/// A view through a rectangle of a face.
fn view(face: &DMat3, center: DVec3, low: [f64; 2], high: [f64; 2]) -> ParticleView {
    const FOCAL_PX: f64 = 1000.0;
    // One pixel a length of 1 would round the sides to whole pixels: a thousand are fine enough.
    let size = [0, 1].map(|k| ((high[k] - low[k]) * FOCAL_PX).ceil().max(1.0));
    let camera = Camera {
        fx: FOCAL_PX,
        fy: FOCAL_PX,
        cx: -low[0] * FOCAL_PX,
        cy: -low[1] * FOCAL_PX,
        width: size[0] as u32,
        height: size[1] as u32,
        near: 1e-4,
        ..Camera::posed((1, 1), 90.0, center, *face)
    };
    ParticleView::new(&camera)
}
