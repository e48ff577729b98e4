//! The sparse points of a capture, as structure from motion leaves them: where there is texture,
//! from noisy sightings, and some of them wrong.

use super::settings::CaptureSettings;
use crate::dataset::{sees, to_byte};
use crate::light::SHARED_BUDGET;
use crate::{Material, Place, display_of};
use glam::{DMat3, DVec2, DVec3};
use rayon::prelude::*;
use wm_base::random::{RandomStream, uniform};
use wm_capture::Observation;
use wm_scene::Camera;
use wm_scene::SparsePoints;

/// Standard deviation of a sighting along each axis, px.
const SIGHTING_NOISE_PX: f64 = 0.5;
/// The share of points that are mismatches.
const MISMATCH_SHARE: f64 = 0.02;
/// The share of the photos that show a point in which it is found.
const DETECTION_SHARE: f64 = 0.75;
/// The largest angle between two rays under which a point still looks alike, and the largest ratio
/// of distances.
const MATCH_LIMITS: (f64, f64) = (0.7, 2.5);
/// Smallest angle between two rays of a point, radians, and its largest mean error, px; other
/// points are dropped.
const TRIANGULATION_LIMITS: (f64, f64) = (0.02, 3.0);
/// Batches of candidates, each as many as points are asked for.
const MAX_BATCHES: u64 = 16;

/// A sighting: view and position, px.
type Sighting = (usize, DVec2);

struct Candidate {
    point: DVec3,
    color: [u8; 3],
    seen: Vec<Sighting>,
    error: f64,
}

/// Points in world axes, and which each camera sees where. `masks` says of each camera's pixels
/// whether a mover hides the place there.
pub(super) fn points(
    place: &Place,
    cameras: &[Camera],
    masks: &[Vec<bool>],
    settings: &CaptureSettings,
) -> (SparsePoints, Vec<Vec<Observation>>) {
    let seed = settings.seed ^ 0x51_0000;
    let most = u64::from(settings.points);
    let mut found: Vec<Candidate> = Vec::new();
    for batch in 0..MAX_BATCHES {
        if found.len() as u64 >= most {
            break;
        }
        let indices = (batch * most..(batch + 1) * most).into_par_iter();
        found.par_extend(indices.filter_map(|index| candidate(place, cameras, masks, settings, seed, index)));
    }
    found.truncate(most as usize);
    let mut points = SparsePoints::default();
    let mut observations = vec![Vec::new(); cameras.len()];
    for candidate in found {
        for (view, at) in &candidate.seen {
            let xy = [at.x as f32, at.y as f32];
            observations[*view].push(Observation { point: points.len() as u32, xy });
        }
        let Candidate { point, color, seen, error } = candidate;
        points.push(point.to_array(), color, error as f32, seen.len() as u32);
    }
    (points, observations)
}

/// The share of places on a material that a detector finds again in another photo.
fn texture(material: Material) -> f64 {
    match material {
        Material::Water => 0.004,
        Material::Grass | Material::Meadow | Material::Field => 0.07,
        Material::Glass => 0.08,
        Material::Plaster | Material::Metal => 0.25,
        Material::Asphalt => 0.2,
        Material::Soil | Material::Gravel | Material::Grit | Material::Blade => 0.4,
        Material::Leaf | Material::Wood => 0.5,
        _ => 1.0,
    }
}

fn candidate(
    place: &Place,
    cameras: &[Camera],
    masks: &[Vec<bool>],
    settings: &CaptureSettings,
    seed: u64,
    index: u64,
) -> Option<Candidate> {
    let random = |lane: u64| uniform(seed, 8 * index + lane);
    let first = (random(0) * cameras.len() as f64) as usize % cameras.len();
    let camera = &cameras[first];
    let at = DVec2::new(random(1) * f64::from(camera.width), random(2) * f64::from(camera.height));
    let (eye, direction) = (camera.center(), camera.ray(at.x, at.y));
    let surface = place.first(eye, direction)?;
    let through = settings.air(place).map_or(1.0, |air| air.transmittance(surface.t));
    if is_hidden(camera, &masks[first], at) || random(3) > texture(surface.material) * through * through {
        return None;
    }
    let point = eye + direction * surface.t;
    // Few candidates come through: only those are worth light.
    let colored = |candidate: Candidate| {
        let hit = place.cast_with(eye, direction, SHARED_BUDGET);
        let color = hit.map_or([0; 3], |hit| display_of(hit.radiance).map(to_byte));
        Candidate { color, ..candidate }
    };
    let noise = RandomStream::new(seed ^ index, 1u64, 0);
    let noisy = |view: usize, at: DVec2| {
        let [x, y, _] = noise.normal3(view as u64);
        at + DVec2::new(x, y) * SIGHTING_NOISE_PX
    };
    if random(4) < MISMATCH_SHARE {
        return mismatch(cameras, first, at, surface.t, seed, index, &noisy).map(colored);
    }
    let mut seen = vec![(first, noisy(first, at))];
    for (view, other) in cameras.iter().enumerate() {
        if view == first || noise.uniform(1000 + view as u64) > DETECTION_SHARE {
            continue;
        }
        let ray = point - other.center();
        let (angle, ratio) = (ray.angle_between(direction), ray.length() / surface.t);
        if angle > MATCH_LIMITS.0 || ratio > MATCH_LIMITS.1 || ratio < 1.0 / MATCH_LIMITS.1 {
            continue;
        }
        if let Some(xy) = sees(place, other, point, 0.02 + 0.002 * ray.length()) {
            let at = DVec2::from_array(xy.map(f64::from));
            if !is_hidden(other, &masks[view], at) {
                seen.push((view, noisy(view, at)));
            }
        }
    }
    triangulated(cameras, seen).map(colored)
}

/// A sighting in one photo that was matched with another thing on the same line of a second photo.
fn mismatch(
    cameras: &[Camera],
    first: usize,
    at: DVec2,
    distance: f64,
    seed: u64,
    index: u64,
    noisy: &dyn Fn(usize, DVec2) -> DVec2,
) -> Option<Candidate> {
    let random = |lane: u64| uniform(seed, 8 * index + lane);
    let camera = &cameras[first];
    let wrong = camera.center() + camera.ray(at.x, at.y) * distance * (0.4 + 1.4 * random(5));
    let second = (random(6) * cameras.len() as f64) as usize % cameras.len();
    let (x, y, _) = cameras[second].project(wrong).filter(|_| second != first)?;
    let inside = x > 0.0 && y > 0.0 && x < f64::from(camera.width) && y < f64::from(camera.height);
    let seen = vec![(first, noisy(first, at)), (second, noisy(second, DVec2::new(x, y)))];
    triangulated(cameras, seen).filter(|_| inside)
}

/// The point nearest to all rays, each counted by its angle; `None` where the rays do not tell.
fn triangulated(cameras: &[Camera], seen: Vec<Sighting>) -> Option<Candidate> {
    if seen.len() < 2 {
        return None;
    }
    let rays: Vec<(DVec3, DVec3)> =
        seen.iter().map(|(view, at)| (cameras[*view].center(), cameras[*view].ray(at.x, at.y))).collect();
    let widest = rays.iter().map(|(_, ray)| ray.angle_between(rays[0].1)).fold(0.0, f64::max);
    if widest < TRIANGULATION_LIMITS.0 {
        return None;
    }
    let mut point = solved(rays.iter().map(|ray| (*ray, 1.0)))?;
    for _ in 0..2 {
        let weigh = |ray: &(DVec3, DVec3)| (*ray, (point - ray.0).length_squared().max(1e-6).recip());
        point = solved(rays.iter().map(weigh))?;
    }
    let mut error = 0.0;
    for (view, at) in &seen {
        let (x, y, _) = cameras[*view].project(point)?;
        error += at.distance(DVec2::new(x, y)) / seen.len() as f64;
    }
    (error < TRIANGULATION_LIMITS.1).then_some(Candidate { point, color: [0; 3], seen, error })
}

/// The least squares solution of the distances from rays, with weights.
fn solved(rays: impl Iterator<Item = ((DVec3, DVec3), f64)>) -> Option<DVec3> {
    let (mut matrix, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for ((origin, way), weight) in rays {
        let across = (DMat3::IDENTITY - DMat3::from_cols(way * way.x, way * way.y, way * way.z)) * weight;
        matrix += across;
        right += across * origin;
    }
    let point = matrix.inverse() * right;
    point.is_finite().then_some(point)
}

fn is_hidden(camera: &Camera, mask: &[bool], at: DVec2) -> bool {
    let x = (at.x.max(0.0) as usize).min(camera.width as usize - 1);
    let y = (at.y.max(0.0) as usize).min(camera.height as usize - 1);
    mask[y * camera.width as usize + x]
}
