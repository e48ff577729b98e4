//! The direction of the sun, found in the shadows of a capture.
//!
//! Pairs of points on level ground, of one material and a step or two apart, differ in brightness
//! where one is in the sun and the other in the shade. For the sun's true direction the map of what
//! stands in its way says which; for other directions it is wrong about many. Points near walls are
//! darker in any light: only pairs that see as much of the sky as each other are asked. Dark
//! patterns score alike whichever way the sun stands, so a direction must do better than all that
//! are far from it.

use super::places::Surfaces;
use crate::level::{dot, from_level, level_axes};
use crate::optics::Site;
use crate::point_grid::PointGrid;
use crate::shelter::{Occluders, Shelter};
use crate::threads::map;
use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;
use wm_base::random::{self, RandomStream};

/// Distances between the points of a pair, m: narrow ones tell the direction finely, wide ones from
/// afar.
pub(super) const NARROW_PAIR_M: [f32; 2] = [0.2, 0.6];
pub(super) const WIDE_PAIR_M: [f32; 2] = [0.6, 2.0];
/// Least cosine between their normals: 10 degrees.
const MIN_NORMAL_COSINE: f32 = 0.985;
/// Largest difference of their chromaticities.
const SAME_COLOR: f32 = 0.08;
/// Points for which partners are searched.
const MAX_PAIR_POINTS: usize = 60_000;
/// Least cosine between up and the normal of level ground.
pub(super) const MIN_LEVEL_COSINE: f32 = 0.8;
/// Log of the ratio of what two points get of an overcast sky with which they are no longer
/// compared, and the share of that light that comes back from walls.
const MAX_SKY_LOG_RATIO: f32 = 0.15;
const RETURNED_LIGHT: f32 = 0.2;
/// Radius of the ground that must be in one light, m, for pairs of either width.
const WIDE_PAIR_GROUND_M: f32 = 0.5;
const NARROW_PAIR_GROUND_M: f32 = 0.15;
/// Logs of the ratio of two brightnesses: up to the first it is no evidence, since dirt, worn paint
/// and the corners of walls differ as much, and from the second on it does not matter how large it
/// is. In the sun it is mostly 0.7 to 1.5.
const EVIDENCE_LOG_RATIOS: [f32; 2] = [0.3, 0.8];
/// Log of the luminance ratio above which a pair is one of light and shade: 1.3.
pub(super) const MIN_SHADOW_LOG_RATIO: f64 = 0.262;
/// Pairs added to every score as a prior, so that few pairs are no evidence.
const PRIOR_PAIR_COUNT: f64 = 20.0;
/// Directions that are tried first: distance between them, and their elevations, degrees.
const FIRST_STEP_DEG: f64 = 9.0;
const FIRST_ELEVATIONS_DEG: [u32; 2] = [12, 75];
/// Widths of the cells of maps, in those of the occluders: of a first ranking, of the search, and
/// of its refinement.
const QUICK_CELLS: f64 = 8.0;
const COARSE_CELLS: f64 = 4.0;
const FINE_CELLS: f64 = 1.0;
/// Directions that the quick maps leave, of all and of those far from the best.
const MAX_CANDIDATES: usize = 32;
/// Cosine of the angle beyond which two directions are distinct: 25 degrees.
const OTHER_DIRECTION_COSINE: f64 = 0.906;
/// Distance between the directions about the best that wide and then narrow pairs judge, degrees,
/// the number of them to each side, and the shares of the best score above which they have a say.
const WIDE_STEP_DEG: f64 = 3.0;
const NARROW_STEP_DEG: f64 = 1.0;
const WIDE_RINGS: i32 = 3;
const NARROW_RINGS: i32 = 2;
const WIDE_PAIR_WEIGHT: f64 = 0.7;
const NARROW_PAIR_WEIGHT: f64 = 0.85;
/// Least score of a sun, and how often it must be that of the best direction far from it. Suns that
/// were there had 11.8 to 30; the best directions of 25 trainings whose ground shows no shadows of
/// a sun had 4.1 to 9.4.
const LEAST_SCORE: f64 = 11.0;
const MIN_SCORE_RATIO: f64 = 1.15;
/// Score below which there is no sun at all.
const MAX_SCORE_WITHOUT_SUN: f64 = 3.0;
/// Sine of the least elevation of a sun that is found: 5 degrees.
const MIN_SUN_SINE: f64 = 0.087;
/// Height above a surface at which it is asked what stands in the way.
pub(super) const LIFT_CELLS: f64 = 1.2;

/// Two points of one material.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pair {
    pub(crate) points: [u32; 2],
    /// Log of the ratio of their luminances, the first over the second.
    pub(crate) log_ratio: f32,
}

/// The best direction of a search for the sun, with what speaks for it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct FoundSun {
    /// Towards the sun, world axes, length 1.
    pub(crate) direction: [f64; 3],
    /// Score: about the standard deviations by which more pairs agree with it than by chance.
    pub(crate) score: f64,
    /// The best score of a direction far from it.
    pub(crate) rival: f64,
}

impl FoundSun {
    /// Returns true if the evidence is enough for a sun over a place whose up is `up`.
    pub(crate) fn is_sun(&self, up: [f64; 3]) -> bool {
        let sin = dot(self.direction, up);
        self.score >= LEAST_SCORE && self.score >= MIN_SCORE_RATIO * self.rival && sin > MIN_SUN_SINE
    }

    /// Returns true if no direction explains the shadows, not even poorly.
    pub(crate) fn is_none(&self) -> bool {
        self.score < MAX_SCORE_WITHOUT_SUN
    }
}

pub(super) fn luminance(light: Vec3) -> f32 {
    light.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}

pub(super) fn chromaticity(light: Vec3) -> Vec3 {
    light / light.element_sum().max(1e-6)
}

/// Returns true if two captured colours can be those of one material, in the sun and in the shade.
pub(super) fn same_material(a: Vec3, b: Vec3) -> bool {
    (chromaticity(a) - chromaticity(b)).abs().max_element() < SAME_COLOR
}

/// Finds pairs, about one per point that is asked.
pub(super) fn pairs(surfaces: &Surfaces, apart: [f32; 2], site: &Site) -> Vec<Pair> {
    let scale = 1.0 / site.metres_per_unit as f32;
    let grid = PointGrid::new(&surfaces.points, apart[1] * scale);
    let solid: Vec<u32> =
        (0..surfaces.len() as u32).filter(|i| surfaces.normals[*i as usize] != Vec3::ZERO).collect();
    let chosen = RandomStream::new(1, 0x5041_4952u64, 0);
    let asked = solid.len().min(MAX_PAIR_POINTS);
    let found = map(asked, |k| {
        let index = solid[k * solid.len() / asked] as usize;
        let (point, normal, light) = (surfaces.points[index], surfaces.normals[index], surfaces.light[index]);
        let is_partner = |other: usize| {
            let distance = surfaces.points[other].distance(point) / scale;
            (apart[0]..apart[1]).contains(&distance)
                && surfaces.normals[other].dot(normal) > MIN_NORMAL_COSINE
                && same_material(surfaces.light[other], light)
        };
        // One of those that fit, by chance: the most alike would be lit alike.
        let other = grid
            .near(point)
            .filter(|other| is_partner(*other))
            .min_by_key(|other| random::bits(chosen.seed() ^ index as u64, *other as u64))?;
        let lights = [light, surfaces.light[other]].map(luminance);
        let is_shown = lights.iter().all(|light| (0.004..0.97).contains(light));
        is_shown
            .then(|| Pair { points: [index as u32, other as u32], log_ratio: (lights[0] / lights[1]).ln() })
    });
    found.into_iter().flatten().collect()
}

/// The map of what stands between a place and the sun.
pub(super) fn sun_map(occluders: &Occluders, sun: [f64; 3]) -> Shelter {
    occluders.shelter(sun.map(|v| -v))
}

/// The place of a surface from which it looks at the sky, above its own roughness.
pub(super) fn lifted(point: Vec3, normal: Vec3, towards: Vec3, map: &Shelter, site: &Site) -> [f32; 3] {
    let lift = (LIFT_CELLS * map.cell() / site.metres_per_unit) as f32;
    let away = if normal == Vec3::ZERO { towards } else { normal };
    (point + away * lift).to_array()
}

/// A pair on level ground, with its weight by how alike the sky is over both.
pub(crate) struct GroundPair {
    pub(crate) pair: Pair,
    weight: f32,
}

/// The pairs on level ground that see about as much of the sky as each other; `open` is what each
/// surface sees of it.
pub(super) fn ground_pairs(
    surfaces: &Surfaces,
    open: &[[f32; 2]],
    pairs: &[Pair],
    site: &Site,
) -> Vec<GroundPair> {
    let up = Vec3::from_array(site.up.map(|v| v as f32));
    let sky = |i: u32| (1.0 - RETURNED_LIGHT) * open[i as usize][1] + RETURNED_LIGHT;
    let level =
        pairs.iter().filter(|pair| surfaces.normals[pair.points[0] as usize].dot(up) > MIN_LEVEL_COSINE);
    let weighed = level.map(|pair| {
        let [a, b] = pair.points.map(sky);
        GroundPair { pair: *pair, weight: 1.0 - (a / b).ln().abs() / MAX_SKY_LOG_RATIO }
    });
    weighed.filter(|pair| pair.weight > 0.0).collect()
}

/// The score of a direction: the evidence of the pairs of which it lights one point and not the
/// other, over its deviation.
fn score(surfaces: &Surfaces, pairs: &[GroundPair], sun: [f64; 3], occluders: &Occluders, tells: f32) -> f64 {
    let map = sun_map(occluders, sun);
    let lit = |index: u32| {
        let index = index as usize;
        map.lit_within(surfaces.points[index], surfaces.normals[index], tells)
    };
    let (mut sum, mut squares) = (0.0f64, PRIOR_PAIR_COUNT);
    for GroundPair { pair, weight } in pairs {
        let [a, b] = pair.points.map(lit);
        let weight = f64::from(weight * (a - b) * (a - b).abs());
        sum += weight * f64::from(evidence(pair.log_ratio));
        squares += weight * weight;
    }
    sum / squares.sqrt()
}

/// The evidence of a pair for light and shade by the log of the ratio of its brightnesses, -1 to 1.
fn evidence(log_ratio: f32) -> f32 {
    ((log_ratio.abs() - EVIDENCE_LOG_RATIOS[0]) / (EVIDENCE_LOG_RATIOS[1] - EVIDENCE_LOG_RATIOS[0]))
        .clamp(0.0, 1.0)
        .copysign(log_ratio)
}

/// A direction by elevation and azimuth (radians, about up), world axes.
fn towards(site: &Site, elevation: f64, azimuth: f64) -> [f64; 3] {
    let (sin, cos) = elevation.sin_cos();
    from_level(&level_axes(site.up), [cos * azimuth.cos(), cos * azimuth.sin(), sin])
}

/// The direction of the same azimuth at an elevation, radians.
fn at_elevation(direction: [f64; 3], elevation: f64, site: &Site) -> [f64; 3] {
    let up = DVec3::from_array(site.up);
    let level = DVec3::from_array(direction).reject_from(up).normalize_or_zero();
    let (sin, cos) = elevation.sin_cos();
    (level * cos + up * sin).to_array()
}

/// Looks for the sun by wide pairs, then by narrow ones, at `elevation` (radians) if that is known.
/// `open` is what each surface sees of the sky. `None` if no ground tells. Under clouds no
/// direction explains the shadows, and the best is no sun ([`FoundSun::is_sun`]).
#[allow(clippy::too_many_arguments, reason = "the ground, what may shade it and what is known of the sun")]
pub(super) fn find_sun(
    surfaces: &Surfaces,
    open: &[[f32; 2]],
    narrow: &[Pair],
    wide: &[Pair],
    occluders: &Occluders,
    coarseness: f32,
    site: &Site,
    elevation: Option<f64>,
) -> Option<FoundSun> {
    let wide = ground_pairs(surfaces, open, wide, site);
    if wide.is_empty() {
        return None;
    }
    let coarse = occluders.sketched(COARSE_CELLS);
    let mut tried: Vec<[f64; 3]> = Vec::new();
    let elevations = match elevation {
        Some(elevation) => vec![elevation],
        None => {
            let all = (FIRST_ELEVATIONS_DEG[0]..=FIRST_ELEVATIONS_DEG[1]).step_by(FIRST_STEP_DEG as usize);
            all.map(|degrees| f64::from(degrees).to_radians()).collect()
        }
    };
    for elevation in elevations {
        let around = (TAU * elevation.cos() / FIRST_STEP_DEG.to_radians()).round().max(6.0) as u32;
        let azimuth = |k: u32| TAU * f64::from(k) / f64::from(around);
        tried.extend((0..around).map(|k| towards(site, elevation, azimuth(k))));
    }
    let tells = coarseness * WIDE_PAIR_GROUND_M;
    // Quick maps rank the best directions among the first, at a third of the work of the maps that
    // score them.
    let quick = occluders.sketched(QUICK_CELLS);
    let guesses = map(tried.len(), |k| score(surfaces, &wide, tried[k], &quick, tells));
    let mut ranked: Vec<usize> = (0..tried.len()).collect();
    ranked.sort_by(|a, b| guesses[*b].total_cmp(&guesses[*a]));
    let is_far = |a: usize, b: usize| dot(tried[a], tried[b]) < OTHER_DIRECTION_COSINE;
    let rivals = ranked.iter().filter(|k| is_far(**k, ranked[0])).take(MAX_CANDIDATES);
    let mut kept: Vec<usize> = ranked.iter().take(MAX_CANDIDATES).chain(rivals).copied().collect();
    kept.sort_unstable();
    kept.dedup();
    let scores = map(kept.len(), |k| score(surfaces, &wide, tried[kept[k]], &coarse, tells));
    let best_of = |is_asked: &dyn Fn(usize) -> bool| {
        let asked = kept.iter().zip(&scores).filter(|(k, _)| is_asked(**k));
        asked.max_by(|a, b| a.1.total_cmp(b.1)).map(|(k, _)| *k)
    };
    let best = best_of(&|_| true)?;
    let far = best_of(&|k| is_far(k, best));
    let raised = |direction: [f64; 3]| elevation.map_or(direction, |to| at_elevation(direction, to, site));
    // The true direction of either lies between those that were tried.
    let closer = |at: usize| {
        let around = directions_about(tried[at], WIDE_STEP_DEG, WIDE_RINGS);
        let scores = map(around.len(), |k| score(surfaces, &wide, around[k], &coarse, tells));
        (raised(centred(&around, &scores, WIDE_PAIR_WEIGHT)), scores.into_iter().fold(0.0, f64::max))
    };
    let [mut own, mut rival] = [closer(best), far.map_or((tried[best], 0.0), closer)];
    if rival.1 > own.1 {
        std::mem::swap(&mut own, &mut rival);
    }
    let direction = own.0;
    let found = FoundSun { direction, score: own.1, rival: rival.1 };
    if !found.is_sun(site.up) {
        return Some(found);
    }
    let narrow = ground_pairs(surfaces, open, narrow, site);
    let fine = occluders.sketched(FINE_CELLS);
    let around = directions_about(direction, NARROW_STEP_DEG, NARROW_RINGS);
    let tells = coarseness * NARROW_PAIR_GROUND_M;
    let scores = map(around.len(), |k| score(surfaces, &narrow, around[k], &fine, tells));
    // Rough geometry says nothing more finely.
    let is_told = scores.iter().any(|score| *score >= LEAST_SCORE);
    let direction = if is_told { raised(centred(&around, &scores, NARROW_PAIR_WEIGHT)) } else { direction };
    Some(FoundSun { direction, ..found })
}

/// A direction and `rings` of those about it, some degrees apart, in a square.
fn directions_about(direction: [f64; 3], degrees: f64, rings: i32) -> Vec<[f64; 3]> {
    let middle = DVec3::from_array(direction);
    let across = middle.any_orthonormal_vector();
    let axes = [across, middle.cross(across)].map(|axis| axis * degrees.to_radians());
    let steps = (-rings..=rings).flat_map(|x| (-rings..=rings).map(move |y| [x, y].map(f64::from)));
    steps.map(|[x, y]| (middle + x * axes[0] + y * axes[1]).normalize().to_array()).collect()
}

/// The mean of directions, weighted by what they score above a share of the best: shadows are told
/// by few pairs, so that scores are rough.
fn centred(around: &[[f64; 3]], scores: &[f64], weighed: f64) -> [f64; 3] {
    let best = scores.iter().copied().fold(0.0, f64::max);
    let weighted = around
        .iter()
        .zip(scores)
        .map(|(direction, score)| DVec3::from_array(*direction) * (score - weighed * best).max(0.0));
    weighted.sum::<DVec3>().normalize_or(DVec3::from_array(around[around.len() / 2])).to_array()
}
