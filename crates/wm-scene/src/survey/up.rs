//! Finds the direction that is up.
//!
//! Directions that could be up are collected: the world axes, those that much surface faces, the
//! axes of the scene's extent, the middle of the sky. Each is rated by a sum of evidence in nats
//! (natural logarithms of odds), both ways round:
//! - ground: much surface faces it at one height near its lower end, with nothing below;
//! - alone: there is no such surface at its upper end, as there is where walls face each other;
//! - open: the scene is dense at the ground and thins out upwards, while between two walls it is
//!   even;
//! - thin: places are wider than high;
//! - sky: the shell lies above;
//! - cameras: by the habits of who took the photos ([`super::habits`]), which weigh most;
//! - prior: programs write scenes with an axis up, most often that of cameras with y down.
//!
//! The best is refined: the plane of the ground, plumb walls where much is built, cameras that were
//! held upright, and a world axis near by each tell up with an error of their own, and the most
//! likely direction is taken. No axis overrules what is seen.

use super::habits::{self, Habit, HabitKind};
use super::middle::strided;
use super::sample::{SurveyPoint, SurveySample};
use super::sky::SkyRegion;
use super::sourced::{Confidence, FactSource, MIN_POINTS};
use super::{ground, plan};
use crate::{Camera, SceneView, Splats};
use glam::{DMat3, DVec3};
use wm_base::linear::{direction, eigen, horizontals, outer};
use wm_base::statistics::quantile;

/// Directions over the half sphere in which surfaces are counted: 7 degrees apart.
const DIRECTION_COUNT: usize = 400;
/// Points by which each candidate is rated.
const RATED_POINTS: usize = 8000;
/// Half width of a peak of normals, as a cosine: 12 degrees.
const PEAK_COS: f64 = 0.978;
/// Largest angle from a world axis that is rounded to it, degrees.
const SAME_AXIS_DEG: f64 = 0.4;
/// Largest angle from the nearest world axis to which a program may have aligned the scene,
/// degrees.
const NEAR_AXIS_DEG: f64 = 6.0;
/// Least cosine between the up of cameras and the estimate with which they agree: 20 degrees.
const AGREEMENT_COS: f64 = 0.94;
/// Layers of height by which a candidate is rated.
const HEIGHT_LAYERS: usize = 64;

/// Standard deviation of the roll of a camera that is held upright, degrees.
const ROLL_ERROR_DEG: f64 = 2.0;
/// Standard deviation of up by surfaces that face it, degrees.
const SURFACE_ERROR_DEG: f64 = 3.0;
/// Standard deviation of up by the plane of ground without walls, degrees.
const LONE_GROUND_ERROR_DEG: f64 = 2.0;
/// Standard deviation of up by the plane of ground with walls, which is therefore no slope,
/// degrees: paving falls by 1 to 2 % so that it drains.
const GROUND_ERROR_DEG: f64 = 1.0;
/// Standard deviation of up by walls, degrees.
const WALL_ERROR_DEG: f64 = 0.4;
/// Standard deviation of up by the axis of a format, degrees.
const AXIS_ERROR_DEG: f64 = 2.0;
/// Least angle between the plumb directions by the plan of walls and by their normals with which
/// the normals are biased, degrees.
const MIN_BIAS_DEG: f64 = 0.8;
/// Largest angle between the ups of surfaces and of upright cameras with which the surfaces are not
/// taken for rough, degrees.
const MAX_CAMERA_ANGLE_DEG: f64 = 4.0;
/// Least angle between the ups of walls and of the ground with which the ground is a slope,
/// degrees.
const MIN_SLOPE_DEG: f64 = 2.5;
/// Number of neighbouring photos that are rolled alike.
const ALIKE_PHOTOS: f64 = 4.0;
/// Most photos whose rolls count as independent.
const MAX_INDEPENDENT: f64 = 8.0;
/// Largest cosine between rival directions: 15 degrees.
const RIVAL_COS: f64 = 0.966;
/// Least lead over the best rival with which up is sure, nats.
const SURE_LEAD_NATS: f64 = 4.0;
/// Least lead over the best rival with which up is likely, nats.
const LIKELY_LEAD_NATS: f64 = 1.5;
/// Least evidence of ground, nats: a tenth of the surfaces. Without ground the other evidence is
/// noise, as of an object that was cut out.
const MIN_GROUND_NATS: f64 = -3.3;
/// Least length of the mean direction of the sky with which it determines up.
const MIN_SKY_LENGTH: f64 = 0.2;
/// Up of an object without ground, and of a handful of splats: most programs write y down, as
/// cameras of structure from motion have it.
pub(super) const USUAL_UP: DVec3 = DVec3::NEG_Y;
/// Lead of another direction over the usual up with which an object does not stand so, nats.
const OBJECT_LEAD_NATS: f64 = 4.0;
/// Least cosine between up and an axis of programs: 45 degrees.
const ODD_AXIS_COS: f64 = 0.707;
/// Largest angle between the ups of the two halves of a scene with which up is sure, degrees.
const MAX_HALVES_DEG: f64 = 5.0;

/// Up as the scene has it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UpEstimate {
    /// The direction against gravity, length 1.
    pub(crate) up: DVec3,
    /// The source: the cameras, the splats alone, or assumed where these tell next to nothing.
    pub(crate) source: FactSource,
    /// The confidence in it.
    pub(crate) confidence: Confidence,
    /// The evidence for it.
    pub(crate) evidence: UpScore,
    /// The direction that is next best, if any, and its evidence.
    pub(crate) rival: Option<(DVec3, UpScore)>,
    /// The normal of the ground, where a plane fits it.
    pub(crate) ground_normal: Option<DVec3>,
    /// The direction along which walls stand, where there are some.
    pub(crate) walls: Option<DVec3>,
}

impl UpEstimate {
    fn without_surfaces(up: DVec3, source: FactSource, confidence: Confidence) -> Self {
        let evidence = UpScore::default();
        Self { up, source, confidence, evidence, rival: None, ground_normal: None, walls: None }
    }
}

/// Finds up; `None` if nothing tells it.
pub(crate) fn estimate(
    splats: &Splats,
    sample: &SurveySample,
    sky: &SkyRegion,
    views: &[SceneView],
) -> Option<UpEstimate> {
    let cameras: Vec<_> = views.iter().map(|view| view.camera).collect();
    let habits = habits::habits(&cameras);
    if sample.points.len() < MIN_POINTS || sample.radius <= 0.0 {
        let habit = habits.iter().max_by(|a, b| a.log_odds.total_cmp(&b.log_odds));
        let (up, source) = match habit {
            Some(habit) => (along_axis(habit.up), FactSource::Cameras),
            None if sample.points.is_empty() => return None,
            None => (USUAL_UP, FactSource::Assumed),
        };
        let confidence = if habits.len() == 1 { Confidence::Likely } else { Confidence::Guess };
        return Some(UpEstimate::without_surfaces(up, source, confidence));
    }
    let clues = Clues { heaven: heaven(splats, sample, sky), habits: &habits };
    let rated = rated(sample);
    let mut scored: Vec<(UpScore, DVec3)> = candidates(sample, &rated, clues)
        .into_iter()
        .flat_map(|axis| [axis, -axis])
        .map(|up| (evidence(sample, &rated, up, clues), up))
        .collect();
    // Stable: of equals the first candidate stays first.
    scored.sort_by(|a, b| b.0.sum().total_cmp(&a.0.sum()));
    let (best, first) = *scored.first()?;
    let rival = scored.iter().find(|(_, other)| other.dot(first) < RIVAL_COS);
    let lead = rival.map_or(f64::INFINITY, |(score, _)| best.sum() - score.sum());
    // Only the splats tell up.
    let is_alone = clues.heaven.length() < MIN_SKY_LENGTH && habits.is_empty();
    let stands = ground::below(sample, first, &[]).is_some();
    let is_object = is_alone && (best.ground < MIN_GROUND_NATS || !stands);
    let usual = evidence(sample, &rated, USUAL_UP, clues);
    let tells_little = lead < LIKELY_LEAD_NATS && best.sum() - usual.sum() < OBJECT_LEAD_NATS;
    if is_object && (!stands || tells_little) && first.dot(USUAL_UP) < RIVAL_COS {
        return Some(UpEstimate {
            evidence: usual,
            rival: Some((first, best)),
            ..UpEstimate::without_surfaces(USUAL_UP, FactSource::Assumed, Confidence::Guess)
        });
    }
    let surfaces = refined(sample, &rated, first, 0.97, plan::plumb);
    let apart = halves_apart(sample, first);
    // The halves are told by normals: where the plan of high walls shows that those are biased,
    // they say nothing.
    let deviation =
        if surfaces.is_by_plan { surfaces.deviation } else { surfaces.deviation.max(0.5 * apart) };
    let surfaces = Refined { deviation, ..surfaces };
    let up = on_ground(sample, views, levelled(&surfaces, &cameras, &habits));
    let agree = habits.iter().any(|habit| habit.up.dot(up) > AGREEMENT_COS);
    // Cameras that say something else are a doubt, however clear the splats are; and where there is
    // no ground, nor sky nor cameras, the rest is noise.
    let confidence = match lead {
        _ if is_object => Confidence::Guess,
        // What a photo shows from the front lies on its back then, as on a ground.
        _ if is_alone && prior_axis(up) < ODD_AXIS_COS => Confidence::Guess,
        _ if lead < LIKELY_LEAD_NATS || !(agree || habits.is_empty()) => Confidence::Guess,
        _ if lead < SURE_LEAD_NATS || apart > MAX_HALVES_DEG || habits.len() > 1 => Confidence::Likely,
        _ => Confidence::Sure,
    };
    Some(UpEstimate {
        up,
        source: if agree { FactSource::Cameras } else { FactSource::Estimated },
        confidence,
        evidence: best,
        rival: rival.map(|(score, other)| (*other, *score)),
        ground_normal: surfaces.ground,
        walls: surfaces.walls,
    })
}

/// The most likely up by the surfaces, the rolls of cameras that were held upright, and a world
/// axis near by: a few rough or sloping surfaces tilt the first by degrees, nobody holds all
/// cameras aslant, and many scenes were aligned.
fn levelled(surfaces: &Refined, cameras: &[Camera], habits: &[Habit]) -> DVec3 {
    let up = surfaces.up;
    let precision = |degrees: f64| degrees.to_radians().powi(-2);
    let held = match habits {
        [Habit { kind: HabitKind::Upright, up: held, .. }] if held.dot(up) >= AGREEMENT_COS => Some(*held),
        _ => None,
    };
    let apart = held.map_or(0.0, |held| held.angle_between(up).to_degrees());
    // So far off the cameras, surfaces are rough: half of the difference is their error.
    let deviation =
        if apart > MAX_CAMERA_ANGLE_DEG { surfaces.deviation.max(0.5 * apart) } else { surfaces.deviation };
    let (mut known, mut off) = (DMat3::from_diagonal(DVec3::splat(precision(deviation))), DVec3::ZERO);
    if held.is_some() {
        let count = cameras.len() as f64;
        let roll = (count / ALIKE_PHOTOS).min(MAX_INDEPENDENT) / count * precision(ROLL_ERROR_DEG);
        for right in cameras.iter().map(|camera| camera.rotation().row(0)) {
            known += outer(right, roll);
            off += right * (roll * right.dot(up));
        }
    }
    let axis = nearest_axis(up);
    if axis.angle_between(up).to_degrees() < NEAR_AXIS_DEG {
        known += DMat3::from_diagonal(DVec3::splat(precision(AXIS_ERROR_DEG)));
        off += (up - axis) * precision(AXIS_ERROR_DEG);
    }
    along_axis((up - (known.inverse() * off).reject_from_normalized(up)).normalize())
}

/// Angle between the ups to which two halves of the scene are refined from the same `first`,
/// degrees: the error of what surfaces tell. The scene is cut across where it is longest.
fn halves_apart(sample: &SurveySample, first: DVec3) -> f64 {
    let level = |point: &SurveyPoint| (point.at - sample.center).reject_from_normalized(first);
    let near = |point: &&SurveyPoint| level(point).length() < sample.radius;
    let moments = sample.points.iter().filter(near).fold(DMat3::ZERO, |sum, p| sum + outer(level(p), p.area));
    let [_, _, (_, longest)] = eigen(moments);
    let up = |sign: f64| {
        let is_here = |point: &&SurveyPoint| sign * (point.at - sample.center).dot(longest) > 0.0;
        let points = sample.points.iter().filter(is_here).copied().collect();
        let half = SurveySample { points, ..*sample };
        // The plan of high walls needs all of them, and takes longer.
        refined(&half, &rated(&half), first, 0.97, |_, _| None).up
    };
    up(1.0).angle_between(up(-1.0)).to_degrees()
}

/// Points by which directions are rated: each stands for the same area, so that strays, which are
/// faint, count little.
fn rated(sample: &SurveySample) -> Vec<SurveyPoint> {
    let total: f64 = sample.points.iter().map(|p| p.area).sum();
    if total <= 0.0 {
        return sample.points.clone();
    }
    let (mut sum, mut rated) = (0.0, Vec::with_capacity(RATED_POINTS));
    for point in &sample.points {
        sum += point.area;
        while (rated.len() as f64 + 0.5) * total < sum * RATED_POINTS as f64 {
            rated.push(*point);
        }
    }
    rated
}

/// The evidence for up apart from the splats of the scene.
#[derive(Clone, Copy, Debug)]
struct Clues<'a> {
    /// The middle of the sky, see [`heaven`].
    heaven: DVec3,
    /// The habits by which the photos may have been taken.
    habits: &'a [Habit],
}

/// Up by the surfaces alone.
#[derive(Clone, Copy, Debug)]
struct Refined {
    up: DVec3,
    /// Standard deviation, degrees.
    deviation: f64,
    /// The normal of the ground.
    ground: Option<DVec3>,
    /// The direction along which walls stand.
    walls: Option<DVec3>,
    /// The plan of high walls told `walls`, not their normals.
    is_by_plan: bool,
}

/// `up` turned to the surfaces that face it, to the plane of the ground and to the walls, if they
/// are within `limit` (a cosine) of it. `by_plan` finds the plumb direction of high walls.
fn refined(
    sample: &SurveySample,
    rated: &[SurveyPoint],
    up: DVec3,
    limit: f64,
    by_plan: impl Fn(&SurveySample, DVec3) -> Option<DVec3>,
) -> Refined {
    let facing = peak(rated, up, limit.max(PEAK_COS));
    let start = if facing.dot(up) > limit { facing } else { up };
    let plane = ground::level(sample, start, None).and_then(|height| ground::plane(sample, start, height));
    let ground = plane.filter(|normal| normal.dot(up) > limit);
    let level = ground.unwrap_or(start);
    // Plumb walls do not stand on steep ground: beyond 8 degrees it is something else that was
    // found.
    let is_near = |plumb: &DVec3| plumb.dot(level) > 0.99;
    let normals = walls(sample, level).filter(is_near);
    // Where little is built, what the plan tells is chance; that of low walls tells less than their
    // normals, and that of high ones shows whether those are biased.
    let plan = normals.and_then(|normals| {
        let shows_bias = |plan: &DVec3| plan.angle_between(normals).to_degrees() >= MIN_BIAS_DEG;
        by_plan(sample, level).filter(is_near).filter(shows_bias)
    });
    let walls = plan.or(normals);
    let (up, deviation) = match (walls, ground) {
        (Some(plumb), Some(level)) if plumb.angle_between(level).to_degrees() < MIN_SLOPE_DEG => {
            let [a, b] = [WALL_ERROR_DEG, GROUND_ERROR_DEG].map(|degrees| degrees.powi(-2));
            ((plumb * a + level * b).normalize(), (a + b).powf(-0.5))
        }
        (Some(plumb), _) => (plumb, WALL_ERROR_DEG),
        (None, Some(level)) => (level, LONE_GROUND_ERROR_DEG),
        (None, None) => (start, SURFACE_ERROR_DEG),
    };
    Refined { up, deviation, ground, walls, is_by_plan: plan.is_some() }
}

/// The direction that walls have in them by their normals, near `up`; `None` where there are few,
/// or all are parallel.
fn walls(sample: &SurveySample, up: DVec3) -> Option<DVec3> {
    let mut plumb = up;
    let total: f64 = sample.points.iter().map(|p| p.area).sum();
    if total <= 0.0 {
        return None;
    }
    // Half widths as sines: 12 degrees to find them, 9 to fit them.
    for width in [0.2, 0.2, 0.15, 0.15, 0.15, 0.15] {
        let (mut moments, mut share) = (DMat3::ZERO, 0.0);
        for point in &sample.points {
            let off = point.normal.dot(plumb) / width;
            if off.abs() < 1.0 {
                let weight = point.area / total * (1.0 - off * off).powi(2);
                moments += outer(point.normal, weight);
                share += weight;
            }
        }
        // Normals at random would give 8/15 of the width.
        if share < 1.4 * width * 8.0 / 15.0 {
            return None;
        }
        let [(_, axis), (second, _), _] = eigen(moments * (1.0 / share));
        if second < 0.15 {
            return None;
        }
        plumb = if axis.dot(up) < 0.0 { -axis } else { axis };
    }
    Some(plumb)
}

/// Returns the world axis near `up` if there is a ground along that and none along `up`: then the
/// surfaces are too rough to tell more. Else returns `up`.
fn on_ground(sample: &SurveySample, views: &[SceneView], up: DVec3) -> DVec3 {
    let axis = nearest_axis(up);
    let is_near = axis.angle_between(up).to_degrees() < NEAR_AXIS_DEG;
    let stands = |up: DVec3| ground::below(sample, up, views).is_some();
    if is_near && !stands(up) && stands(axis) { axis } else { up }
}

fn nearest_axis(up: DVec3) -> DVec3 {
    let longest = up.abs().max_position();
    // Adding 0 turns -0 to 0.
    DVec3::AXES[longest] * up[longest].signum() + 0.0
}

/// The nearest world axis if it is within [`SAME_AXIS_DEG`], else `up`.
fn along_axis(up: DVec3) -> DVec3 {
    let axis = nearest_axis(up);
    if up.angle_between(axis).to_degrees() < SAME_AXIS_DEG { axis } else { up }
}

/// The middle of the sky's splats as seen from the scene's: length 0 if it is all around or there
/// is none, 0.5 for a half sphere.
fn heaven(splats: &Splats, sample: &SurveySample, sky: &SkyRegion) -> DVec3 {
    let mut indices = sky.indices(splats);
    indices = strided(indices.len(), 5000).map(|i| indices[i]).collect();
    let mut cells = vec![false; DIRECTION_COUNT];
    let directions: Vec<DVec3> = (0..DIRECTION_COUNT).map(|i| direction(i, DIRECTION_COUNT)).collect();
    for index in indices {
        let offset = DVec3::from_array(splats.means[index].map(f64::from)) - sample.center;
        cells[nearest(&directions, |d| d.dot(offset))] = true;
    }
    // By direction and not by splat: a patch of many small clouds counts no more than plain sky.
    let covered: Vec<DVec3> = directions.into_iter().zip(cells).filter(|c| c.1).map(|c| c.0).collect();
    covered.iter().sum::<DVec3>() / covered.len().max(1) as f64
}

fn nearest(directions: &[DVec3], closeness: impl Fn(DVec3) -> f64) -> usize {
    let better = |a: &usize, b: &usize| closeness(directions[*a]).total_cmp(&closeness(directions[*b]));
    (0..directions.len()).max_by(better).unwrap_or(0)
}

/// Axes that could be vertical, the sign open, those that surfaces face first.
fn candidates(sample: &SurveySample, rated: &[SurveyPoint], clues: Clues<'_>) -> Vec<DVec3> {
    // The first half of the spiral is the upper half sphere.
    let directions: Vec<DVec3> = (0..DIRECTION_COUNT).map(|i| direction(i, 2 * DIRECTION_COUNT)).collect();
    let mut surface = vec![0.0; DIRECTION_COUNT];
    for point in rated {
        surface[nearest(&directions, |d| d.dot(point.normal).abs())] += 1.0;
    }
    let smooth = |d: &DVec3| -> f64 {
        let near = directions.iter().zip(&surface).filter(|(e, _)| e.dot(*d).abs() > PEAK_COS);
        near.map(|(_, s)| s).sum()
    };
    let mut peaks: Vec<(f64, DVec3)> = directions.iter().map(|d| (smooth(d), *d)).collect();
    peaks.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut axes: Vec<DVec3> = Vec::new();
    let add = |axes: &mut Vec<DVec3>, axis: DVec3, apart: f64| {
        if axes.iter().all(|other| other.dot(axis).abs() < apart) {
            axes.push(axis);
        }
    };
    for (_, peak_axis) in peaks {
        if axes.len() < 8 {
            add(&mut axes, peak(rated, peak_axis, PEAK_COS), 0.94);
        }
    }
    let mut moments = DMat3::ZERO;
    for point in rated {
        let offset = point.at - sample.center;
        if offset.length() <= sample.radius {
            moments += outer(offset, 1.0 / RATED_POINTS as f64);
        }
    }
    for axis in DVec3::AXES.into_iter().chain(eigen(moments).map(|e| e.1)) {
        add(&mut axes, axis, 0.996);
    }
    let habits = clues.habits.iter().map(|habit| habit.up);
    for axis in clues.heaven.try_normalize().into_iter().chain(habits) {
        add(&mut axes, axis, 0.996);
    }
    axes
}

/// The mean of the normals about `axis`, followed to where they are densest; on the side of `axis`.
fn peak(rated: &[SurveyPoint], axis: DVec3, width: f64) -> DVec3 {
    let mut middle = axis;
    for _ in 0..6 {
        let mut sum = DVec3::ZERO;
        for point in rated {
            let cos = point.normal.dot(middle);
            if cos.abs() > width {
                sum += point.normal * (cos.signum() * (cos.abs() - width));
            }
        }
        middle = sum.try_normalize().unwrap_or(middle);
    }
    middle
}

/// The evidence for a direction, in nats.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct UpScore {
    /// Much surface faces it at one height near its lower end.
    pub(crate) ground: f64,
    /// There is no such surface at its upper end.
    pub(crate) alone: f64,
    /// The scene is dense at the ground and thins out upwards.
    pub(crate) open: f64,
    /// The scene is wider than high.
    pub(crate) thin: f64,
    /// The sky lies above.
    pub(crate) sky: f64,
    /// The cameras' habits.
    pub(crate) cameras: f64,
    /// The prior probability by the axes of programs.
    pub(crate) prior: f64,
}

impl UpScore {
    /// All together.
    #[must_use]
    pub(crate) fn sum(&self) -> f64 {
        self.ground + self.alone + self.open + self.thin + self.sky + self.cameras + self.prior
    }
}

fn evidence(sample: &SurveySample, rated: &[SurveyPoint], up: DVec3, clues: Clues<'_>) -> UpScore {
    let (x, y) = horizontals(up);
    let extent = |axis: DVec3| {
        let mut along: Vec<f64> = rated.iter().map(|p| p.at.dot(axis)).collect();
        [0.01, 0.5, 0.99].map(|q| quantile(&mut along, q))
    };
    let [low, middle, high] = extent(up);
    let across = [x, y].map(|axis| {
        let [low, _, high] = extent(axis);
        high - low
    });
    let (across, along) = (across[0].max(across[1]), (high - low).max(1e-9 * sample.radius));
    // A thin scene's ground has some relief.
    let step = (along / HEIGHT_LAYERS as f64).max(sample.radius / 60.0);
    let ground = (surface(rated, up, low, step) + 0.01).ln();
    let ceiling = (surface(rated, -up, -high, step) + 0.01).ln();
    UpScore {
        ground: 1.5 * ground,
        alone: 0.7 * (ground - ceiling).clamp(-1.5, 1.5),
        open: 3.0 * (0.5 - (middle - low) / along),
        thin: (0.7 * (across / along).ln()).clamp(-1.0, 1.5),
        sky: 8.0 * up.dot(clues.heaven),
        cameras: habits::fit(up, clues.habits),
        prior: prior(up),
    }
}

/// Share of all surface that faces `up` at one height, less the more lies below that height.
///
/// Heights are counted in layers of `step` from `low` on.
fn surface(rated: &[SurveyPoint], up: DVec3, low: f64, step: f64) -> f64 {
    let (mut level, mut mass) = ([0.0; HEIGHT_LAYERS + 1], [0.0; HEIGHT_LAYERS + 1]);
    for point in rated {
        let layer = ((point.at.dot(up) - low) / step).clamp(0.0, HEIGHT_LAYERS as f64) as usize;
        mass[layer] += 1.0;
        if point.normal.dot(up).abs() > 0.94 {
            level[layer] += 1.0;
        }
    }
    let count = rated.len() as f64;
    let (mut below, mut best) = (0.0, 0.0f64);
    for layer in 0..HEIGHT_LAYERS {
        let clear = (1.0 - below / (0.15 * count)).max(0.0);
        best = best.max((level[layer] + level[layer + 1]) * clear);
        // What is in the layer itself or the one before is relief.
        below += if layer > 0 { mass[layer - 1] } else { 0.0 };
    }
    best / count
}

/// Nearness of `up` to the nearest of the axes that programs have up, as a cosine.
fn prior_axis(up: DVec3) -> f64 {
    [DVec3::Z, DVec3::Y, DVec3::NEG_Y].into_iter().map(|axis| up.dot(axis)).fold(f64::MIN, f64::max)
}

/// The prior probability of `up`, before the scene is looked at.
fn prior(up: DVec3) -> f64 {
    // Nearness to an axis: 1 at it, 1/2 at 4 degrees.
    let near = |axis: DVec3| 1.0 / (1.0 + ((1.0 - up.dot(axis)).max(0.0) / 0.0024));
    let axes = 0.8 * near(DVec3::Z) + 0.8 * near(DVec3::Y) + 0.8 * near(DVec3::NEG_Y);
    let odd = 0.3 * near(DVec3::X) + 0.3 * near(DVec3::NEG_X) + 0.3 * near(DVec3::NEG_Z);
    // Cameras of structure from motion: y down in the first photo's frame, which may be pitched.
    axes + odd + if up.dot(DVec3::NEG_Y) > 0.8 { 0.3 } else { 0.0 }
}
