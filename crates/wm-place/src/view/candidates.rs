//! Places that a photographer would try, with what the grid of the scene promises of them.

use super::space::OccupancyGrid;
use glam::DVec3;
use std::f64::consts::TAU;
use wm_scene::survey::{FactSource, Survey};

/// A place and a direction to look from it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ViewCandidate {
    /// The kind of view.
    pub(crate) kind: CandidateKind,
    /// The camera centre, scene units.
    pub(crate) eye: DVec3,
    /// The viewing direction, length 1.
    pub(crate) forward: DVec3,
    /// The rating by the grid; comparable within a kind.
    pub(crate) promise: f64,
}

/// Kinds of views.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum CandidateKind {
    /// From the height of a person on the ground.
    EyeLevel,
    /// From a ladder, a window or a drone, down into the scene.
    Raised,
    /// From outside and above, the whole or a part of it: for objects and scenes from the air.
    Outside,
}

impl CandidateKind {
    /// Number of views of this kind that are rendered.
    fn share(self) -> usize {
        match self {
            Self::EyeLevel => 18,
            Self::Raised => 8,
            Self::Outside => 10,
        }
    }
}

/// Number of azimuths of the rays from an eye.
const AZIMUTH_COUNT: usize = 36;
/// Rays above and below each direction, degrees; those below come first.
const ELEVATIONS_DEGREES: [f64; 7] = [-20.0, -12.0, -6.0, 0.0, 6.0, 12.0, 20.0];
/// Rays that look down.
const DOWNWARD_RAYS: usize = 3;
/// Azimuths to each side of the middle of a picture: 30 degrees.
const VIEW_HALF_AZIMUTHS: usize = 3;
/// Free height over the eye, of that of the eye over the ground: rooms are 2.4 m high and more.
/// Where the scale is not known an eye that low may be under a table.
const HEADROOM_RATIO: f64 = 0.5;
const RAISED_HEADROOM_RATIO: f64 = 2.5;
/// Eye positions to each side of the middle, along each axis.
const GRID_HALF_STEPS: i32 = 9;
/// Free distance that a view needs, in heights of the eye above the ground.
const CLEAR_LENGTH_PER_HEIGHT: f64 = 20.0;
/// Loss of the score from the middle of a scene to its edge: most photos show the middle.
const EDGE_PENALTY: f64 = 0.7;

/// Returns the length by which it is judged whether things are near, scene units: the radius of the
/// scene, but less for an eye low above the ground, such as that of a person between the houses of
/// a street. `height` is that of the eye, scene units.
pub(super) fn room(survey: &Survey, height: f64) -> f64 {
    if height > 0.0 { survey.radius.min(CLEAR_LENGTH_PER_HEIGHT * height) } else { survey.radius }
}

/// The most promising places of each kind; empty for a scene without size.
pub(crate) fn candidates(space: &OccupancyGrid, survey: &Survey) -> Vec<ViewCandidate> {
    if survey.radius <= 0.0 {
        return Vec::new();
    }
    let mut all = within(space, survey);
    all.extend(outside(space, survey));
    let mut best: Vec<ViewCandidate> = Vec::new();
    for kind in [CandidateKind::EyeLevel, CandidateKind::Raised, CandidateKind::Outside] {
        let mut of_kind: Vec<&ViewCandidate> = all.iter().filter(|c| c.kind == kind).collect();
        of_kind.sort_by(|a, b| b.promise.total_cmp(&a.promise));
        best.extend(of_kind.into_iter().take(kind.share()));
    }
    best
}

/// Heights above the ground to look from, and how far down, degrees.
fn heights(survey: &Survey) -> Vec<(CandidateKind, f64, f64)> {
    let radius = survey.radius;
    let person = 1.6 / survey.metres_per_unit.value;
    // Should a unit be something else than a metre: most places are walked about in within 50 m.
    let likely = 0.035 * radius;
    let fits = (0.01 * radius..=0.15 * radius).contains(&person);
    let (kind, lowest) = if fits || survey.metres_per_unit.source != FactSource::Assumed {
        (CandidateKind::EyeLevel, person)
    } else if survey.sky_splats > 0 {
        (CandidateKind::EyeLevel, likely)
    } else {
        // A table, a room or a street: nobody knows what eye level is, and the floor is no place
        // for a lens.
        (CandidateKind::Raised, 0.1 * radius)
    };
    let high = (0.2 * radius).max(4.0 * lowest);
    vec![
        (kind, lowest, 0.0),
        (CandidateKind::Raised, 2.5 * lowest, -10.0),
        (CandidateKind::Raised, high, -12.0),
        (CandidateKind::Raised, high, -20.0),
    ]
}

/// Views from places above the seen ground.
fn within(space: &OccupancyGrid, survey: &Survey) -> Vec<ViewCandidate> {
    let (radius, heights) = (survey.radius, heights(survey));
    let [x, y, up] = space.axes();
    let mut all = Vec::new();
    for i in -GRID_HALF_STEPS..=GRID_HALF_STEPS {
        for j in -GRID_HALF_STEPS..=GRID_HALF_STEPS {
            let offset = (x * f64::from(i) + y * f64::from(j)) * (radius / f64::from(GRID_HALF_STEPS + 1));
            let below = survey.center + offset;
            let Some(ground) = space.ground(below) else { continue };
            for (kind, height, pitch) in &heights {
                let eye = below + up * (ground + height - below.dot(up));
                let headroom =
                    if *kind == CandidateKind::EyeLevel { HEADROOM_RATIO } else { RAISED_HEADROOM_RATIO };
                let is_free = space.hit(eye, up, headroom * height).is_none();
                if is_free && space.is_clear(eye, (0.5 * height).min(0.03 * radius)) {
                    let aside = EDGE_PENALTY * offset.length() / radius;
                    let views = look_about(space, survey, *kind, eye, *pitch, *height).into_iter();
                    all.extend(views.map(|view| ViewCandidate { promise: view.promise - aside, ..view }));
                }
            }
        }
    }
    all
}

/// The two best directions from a place that is so high above the ground, scene units.
fn look_about(
    space: &OccupancyGrid,
    survey: &Survey,
    kind: CandidateKind,
    eye: DVec3,
    pitch: f64,
    height: f64,
) -> Vec<ViewCandidate> {
    let azimuth = |i: usize| TAU * i as f64 / AZIMUTH_COUNT as f64;
    let look = |i: usize| {
        let ray = |e: f64| space.direction(azimuth(i), (e + pitch).to_radians());
        ELEVATIONS_DEGREES.map(|e| space.hit(eye, ray(e), 2.0 * survey.radius))
    };
    let seen: Vec<[Option<f64>; 7]> = (0..AZIMUTH_COUNT).map(look).collect();
    let mut views: Vec<ViewCandidate> = (0..AZIMUTH_COUNT)
        .step_by(VIEW_HALF_AZIMUTHS)
        .map(|i| {
            let picture: Vec<[Option<f64>; 7]> = (0..=2 * VIEW_HALF_AZIMUTHS)
                .map(|k| seen[(i + AZIMUTH_COUNT + k - VIEW_HALF_AZIMUTHS) % AZIMUTH_COUNT])
                .collect();
            let forward = space.direction(azimuth(i), pitch.to_radians());
            ViewCandidate { kind, eye, forward, promise: promise(&picture, room(survey, height)) }
        })
        .collect();
    views.sort_by(|a, b| b.promise.total_cmp(&a.promise));
    views.truncate(2);
    views
}

/// The rating by the rays of a picture: ground throughout, near and far things, room before the
/// lens, and some but not only sky.
fn promise(picture: &[[Option<f64>; 7]], room: f64) -> f64 {
    let part = |rays: std::ops::Range<usize>| {
        let part: Vec<Option<f64>> =
            picture.iter().flat_map(|column| column[rays.clone()].to_vec()).collect();
        part.iter().flatten().count() as f64 / part.len() as f64
    };
    let (cover, things) = (part(0..DOWNWARD_RAYS), part(DOWNWARD_RAYS..ELEVATIONS_DEGREES.len()));
    let mut distances: Vec<f64> = picture.iter().flatten().flatten().copied().collect();
    distances.sort_by(f64::total_cmp);
    let quantile = |q: f64| {
        let rank = (q * distances.len() as f64) as usize;
        distances.get(rank).copied().unwrap_or(0.01 * room)
    };
    let too_near = |limit: f64, q: f64| (limit * room / quantile(q)).ln().clamp(0.0, 2.0);
    -4.0 * (1.0 - cover) + 0.7 * (quantile(0.85) / quantile(0.15)).ln().clamp(0.0, 2.0)
        - too_near(0.2, 0.5)
        - too_near(0.04, 0.02)
        - 2.0 * (0.35 - things).max(0.0)
        - 2.0 * (things - 0.8).max(0.0)
}

/// Three-quarter views from outside, from near for a part to far for the whole.
fn outside(space: &OccupancyGrid, survey: &Survey) -> Vec<ViewCandidate> {
    let radius = survey.radius;
    let target = survey.center;
    let mut all = Vec::new();
    for i in 0..12 {
        for elevation in [20.0f64, 32.0] {
            for distance in [0.45, 0.8, 1.3, 1.9] {
                let back = space.direction(TAU * f64::from(i) / 12.0, elevation.to_radians());
                let eye = target + back * (distance * radius);
                if space.is_clear(eye, 0.05 * radius) {
                    // The middle of the scene should be in sight, not behind a wall.
                    let seen = space.hit(eye, -back, distance * radius).unwrap_or(distance * radius);
                    let promise = (seen / (distance * radius)).ln().max(-3.0) - 0.2 * distance;
                    all.push(ViewCandidate { kind: CandidateKind::Outside, eye, forward: -back, promise });
                }
            }
        }
    }
    all
}
