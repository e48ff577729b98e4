//! The cameras of captures, in world axes.

use super::settings::{CaptureKind, CaptureSettings};
use crate::Place;
use crate::ground::along;
use glam::{DMat3, DVec2, DVec3};
use std::f64::consts::TAU;
use wm_base::random::RandomStream;
use wm_scene::{Camera, CameraError};

/// A photo to be taken.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shot {
    pub(crate) camera: Camera,
    /// Seconds after the first photo.
    pub(crate) time: f64,
    /// Motion of the picture while it is exposed by the hand that holds it, px.
    pub(crate) shake: DVec2,
}

/// Vertical field of view of a drone's camera, degrees: 24 mm on full frame.
const DRONE_FOV_DEG: f64 = 53.0;
/// Height of the survey, m.
const SURVEY_HEIGHT_M: f64 = 50.0;
/// The share of a photo that the next one shows too, along and across the lines of flight.
const OVERLAP_SHARE: f64 = 0.75;
/// Distance between photos of a walk and a drive, m.
const PHOTO_SPACING_M: (f64, f64) = (1.5, 2.0);
/// Speed of the drone, the walker and the car, m/s.
const SPEEDS_M_S: (f64, f64, f64) = (6.0, 1.2, 8.0);
/// Purpose of the random numbers.
const HAND_SHAKE_LANE: u64 = 40;

/// The shots of a capture, in their order; with `few`, those that are kept.
pub(super) fn shots(place: &Place, settings: &CaptureSettings) -> Result<Vec<Shot>, CameraError> {
    let count = settings.count.max(1);
    let shot = |index: u32| {
        let noise = |which: u32| {
            DVec3::from_array(RandomStream::new(settings.seed, HAND_SHAKE_LANE, which).normal3(index.into()))
        };
        let take = match settings.kind {
            CaptureKind::Nadir => nadir,
            CaptureKind::Oblique => oblique,
            CaptureKind::Walk => walk,
            CaptureKind::Drive => drive,
        };
        let shot = take(place, settings, index, count, [0, 1, 2].map(noise));
        shot.camera.check().map(|()| shot)
    };
    kept(count, settings.flaws.few).into_iter().map(shot).collect()
}

/// The photos that are kept of `count`: all, or `few` of them, evenly spread.
fn kept(count: u32, few: Option<u32>) -> Vec<u32> {
    let few = few.unwrap_or(count).min(count);
    (0..few)
        .map(|index| (f64::from(index) * f64::from(count - 1) / f64::from((few - 1).max(1))).round() as u32)
        .collect()
}

/// The pose of a camera, degrees: the heading from north to the east, upwards, and the head tilted
/// to the right.
#[derive(Clone, Copy)]
struct Attitude {
    heading: f64,
    pitch: f64,
    roll: f64,
}

impl Attitude {
    fn camera(&self, size: (u32, u32), fov_y: f64, eye: DVec3) -> Camera {
        let (sin, cos) = self.heading.to_radians().sin_cos();
        let (up, level) = self.pitch.to_radians().sin_cos();
        let forward = DVec3::new(sin * level, cos * level, up);
        let right = DVec3::new(cos, -sin, 0.0);
        let rotation = DMat3::from_cols(right, forward.cross(right), forward).transpose();
        let rolled = DMat3::from_rotation_z(-self.roll.to_radians()) * rotation;
        Camera::posed(size, fov_y, eye, rolled)
    }
}

fn nadir(place: &Place, settings: &CaptureSettings, index: u32, count: u32, noise: [DVec3; 3]) -> Shot {
    let [one, two, _] = noise;
    let (width, height) = settings.size;
    let seen = 2.0 * SURVEY_HEIGHT_M * (0.5 * DRONE_FOV_DEG.to_radians()).tan();
    let along = seen * (1.0 - OVERLAP_SHARE);
    let across = along * f64::from(width) / f64::from(height.max(1));
    // Lines along north, there and back, about as long as they are wide together.
    let lines = (f64::from(count) * along / across).sqrt().round().max(1.0) as u32;
    let long = count.div_ceil(lines);
    let (line, step) = (index / long, index % long);
    let is_back = line % 2 == 1;
    let step = if is_back { long - 1 - step } else { step };
    let at = place.sights.middle.truncate()
        + DVec2::new(
            (f64::from(line) - 0.5 * f64::from(lines - 1)) * across,
            (f64::from(step) - 0.5 * f64::from(long - 1)) * along,
        );
    let eye = (at + one.truncate() * 0.8).extend(SURVEY_HEIGHT_M + 0.6 * one.z);
    let heading = if is_back { 180.0 } else { 0.0 };
    let attitude =
        Attitude { heading: heading + 2.5 * two.x, pitch: -90.0 + 2.0 * two.y.abs(), roll: 1.5 * two.z };
    let camera = attitude.camera(settings.size, DRONE_FOV_DEG, eye);
    Shot { camera, time: f64::from(index) * along / SPEEDS_M_S.0, shake: DVec2::ZERO }
}

fn oblique(place: &Place, settings: &CaptureSettings, index: u32, count: u32, noise: [DVec3; 3]) -> Shot {
    let [one, two, _] = noise;
    let turn = TAU * f64::from(index) / f64::from(count);
    let out = DVec2::new(turn.sin(), turn.cos());
    // Every third photo looks farther ahead, from lower down.
    let (down, height) = if index % 3 == 2 { (20.0, 0.62) } else { (45.0, 1.0) };
    let radius = place.sights.orbit;
    let at = place.sights.middle.truncate() + out * radius * (1.0 + 0.03 * one.x);
    let eye = at.extend(radius * height + one.z);
    let attitude = Attitude {
        heading: turn.to_degrees() + 180.0 + 3.0 * two.x,
        pitch: -down + 1.5 * two.y,
        roll: 1.0 * two.z,
    };
    let camera = attitude.camera(settings.size, DRONE_FOV_DEG, eye);
    let time = f64::from(index) * TAU * radius / f64::from(count) / SPEEDS_M_S.0;
    Shot { camera, time, shake: DVec2::ZERO }
}

fn length(line: &[DVec2]) -> f64 {
    line.windows(2).map(|pair| pair[0].distance(pair[1])).sum()
}

fn heading_of(ahead: DVec2) -> f64 {
    ahead.x.atan2(ahead.y).to_degrees()
}

fn walk(place: &Place, settings: &CaptureSettings, index: u32, count: u32, noise: [DVec3; 3]) -> Shot {
    let [one, two, three] = noise;
    let path = &place.sights.path;
    let whole = length(path);
    let step = PHOTO_SPACING_M.0.min(whole / f64::from(count.max(2) - 1));
    let (at, ahead) = along(path, f64::from(index) * step / whole);
    let at = at + ahead.perp() * (0.25 * one.x);
    let eye = place.above(at, 1.6 + 0.04 * one.y);
    // Looks about, to both sides in turn, and now and then holds the phone badly.
    let look = 24.0 * (TAU * f64::from(index) / 9.0).sin();
    let is_clumsy = index % 10 == 7;
    let roll = if is_clumsy { 8.0 * two.x.signum() } else { (3.0 * two.x).clamp(-7.0, 7.0) };
    let attitude =
        Attitude { heading: heading_of(ahead) + look + 5.0 * two.y, pitch: -4.0 + 3.5 * two.z, roll };
    let camera = attitude.camera(settings.size, 52.0, eye);
    // Fractions of a pixel of a picture 600 px wide, and some pixels now and then.
    let strong = if index % 8 == 5 { 4.0 } else { 0.6 };
    let shake = three.truncate() * strong * f64::from(settings.size.0) / 600.0 * 0.7;
    Shot { camera, time: f64::from(index) * step / SPEEDS_M_S.1, shake: shake.clamp_length_max(8.0) }
}

fn drive(place: &Place, settings: &CaptureSettings, index: u32, count: u32, noise: [DVec3; 3]) -> Shot {
    let [one, two, _] = noise;
    let (from, to) = place.sights.road;
    let whole = from.distance(to);
    let step = PHOTO_SPACING_M.1.min(whole / f64::from(count.max(2) - 1));
    let ahead = (to - from) / whole;
    let at = from + ahead * (f64::from(index) * step) + ahead.perp() * (0.06 * one.x);
    let eye = place.above(at, 1.45 + 0.02 * one.y);
    let attitude =
        Attitude { heading: heading_of(ahead) + 0.8 * two.x, pitch: -1.5 + 0.6 * two.y, roll: 0.5 * two.z };
    let camera = attitude.camera(settings.size, 50.0, eye);
    Shot { camera, time: f64::from(index) * step / SPEEDS_M_S.2, shake: DVec2::ZERO }
}
