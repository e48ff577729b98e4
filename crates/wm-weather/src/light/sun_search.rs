//! The direction of the sun, found in the shadows of a capture.
//!
//! Pairs of points of one material, less than a step apart and equally inclined, differ in brightness where one is in the
//! sun and the other in the shade. For the sun's true direction the map of what stands in its way says which; for other
//! directions it is wrong about many, and the ratios scatter. Dark patterns score alike whichever way the sun stands, so
//! a direction must do better than the same height with another azimuth.

use super::places::{PointGrid, Surfaces};
use super::quantile::median;
use crate::dome::{from_level, level_axes};
use crate::optics::Site;
use crate::shelter::{Occluders, Shelter};
use crate::threads::map;
use glam::Vec3;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;
use wm_scene::random::{self, RandomStream};

/// Distances between the points of a pair, m: narrow ones tell the direction finely, wide ones from afar.
pub(super) const NARROW: [f32; 2] = [0.2, 0.6];
pub(super) const WIDE: [f32; 2] = [0.6, 2.0];
/// Least cosine between their normals: 10 degrees.
const ALIKE: f32 = 0.985;
/// Most that their chromaticities differ.
const SAME_COLOR: f32 = 0.08;
/// Points that are asked for a partner.
const ASKED: usize = 60_000;
/// Least cosine of the sun's incidence on both.
const INCIDENCE: f32 = 0.15;
/// Log of the ratio from which on a pair is one of light and shade: 1.3.
const SHADOW: f64 = 0.262;
/// Fewest pairs of light and shade by which a direction can be told.
const FEWEST: usize = 150;
/// Directions that are tried first, and the limits of their elevations, degrees.
const TRIED: usize = 128;
const ELEVATIONS: [f64; 2] = [5.0, 75.0];
/// Widths of the cells of maps, in those of the occluders: of the search, then of its refinement.
const COARSE: f64 = 4.0;
const FINE: f64 = 2.0;
/// The finest.
const FINEST: f64 = 0.5;
/// Steps of the refinement by wide pairs, then by narrow ones, degrees.
const WIDE_STEPS: [f64; 3] = [6.0, 3.0, 1.5];
const NARROW_STEP: f64 = 1.0;
/// Rings of directions about the best, a step of this (degrees) apart, whose mean is the sun's, weighted by what they score
/// above this share of the best.
const RINGS: i32 = 1;
const RING_STEP: f64 = 1.0;
const WEIGHED: f64 = 0.85;
/// Turn of the azimuth that must do worse, degrees.
const TURNED: f64 = 40.0;
/// Deviations above the median of all directions that are chance, and the factor over that and over the turned directions
/// that a sun must reach. Rough geometry lowers the ratio of light to shade: any will do if little else explains it.
const DEVIATIONS: f64 = 3.0;
const EVIDENT: f64 = 2.5;
const LEAST_RATIO: f64 = 1.05;
/// A clear ratio of light to shade, and the factor that is enough with it: few walls shade much the same from other azimuths.
const CLEAR_RATIO: f64 = 1.6;
const CLEARLY: f64 = 1.5;
/// Sine of the least elevation of a sun that is found: 5 degrees.
const LOWEST: f64 = 0.087;

/// Height above a surface at which it is asked what stands in the way, in cells.
pub(super) const LIFT: f64 = 1.2;

/// Two points of one material.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pair {
    pub points: [u32; 2],
    /// Log of the ratio of their luminances, the first over the second.
    pub log_ratio: f32,
}

/// The best direction of a search for the sun, with what speaks for it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FoundSun {
    /// Towards the sun, world axes, length 1.
    pub direction: [f64; 3],
    /// Median ratio of light to shade over pairs.
    pub ratio: f64,
    /// The score, that of the better of two turned azimuths, and the best that directions get by chance.
    pub scores: [f64; 3],
}

impl FoundSun {
    /// Returns true if the evidence is enough for a sun over a place whose up is `up`.
    #[must_use]
    pub fn is_sun(&self, up: [f64; 3]) -> bool {
        let [own, turned, chance] = self.scores;
        let sin: f64 = (0..3).map(|k| self.direction[k] * up[k]).sum();
        let factor = if self.ratio >= CLEAR_RATIO { CLEARLY } else { EVIDENT };
        self.ratio >= LEAST_RATIO && own > factor * turned.max(chance) && sin > LOWEST
    }
}

fn luminance(light: Vec3) -> f32 {
    light.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}

fn chromaticity(light: Vec3) -> Vec3 {
    light / light.element_sum().max(1e-6)
}

/// Returns true if two captured colours can be those of one material, in the sun and in the shade.
pub(super) fn same_material(a: Vec3, b: Vec3) -> bool {
    (chromaticity(a) - chromaticity(b)).abs().max_element() < SAME_COLOR
}

/// Finds pairs, about one a point that is asked.
pub(super) fn pairs(surfaces: &Surfaces, apart: [f32; 2], site: &Site, threads: usize) -> Vec<Pair> {
    let scale = 1.0 / site.metres_per_unit as f32;
    let grid = PointGrid::new(&surfaces.points, apart[1] * scale);
    let solid: Vec<u32> =
        (0..surfaces.len() as u32).filter(|i| surfaces.normals[*i as usize] != Vec3::ZERO).collect();
    let chosen = RandomStream::new(1, 0x5041_4952u64, 0);
    let asked = solid.len().min(ASKED);
    let found = map(asked, threads, |k| {
        let index = solid[k * solid.len() / asked] as usize;
        let (point, normal, light) = (surfaces.points[index], surfaces.normals[index], surfaces.light[index]);
        let is_partner = |other: usize| {
            let distance = surfaces.points[other].distance(point) / scale;
            (apart[0]..apart[1]).contains(&distance)
                && surfaces.normals[other].dot(normal) > ALIKE
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
pub(super) fn sun_map(occluders: &Occluders, sun: [f64; 3], threads: usize) -> Shelter {
    occluders.shelter(sun.map(|v| -v), Some(threads))
}

/// The place of a surface from which it looks at the sky, above its own roughness.
pub(super) fn lifted(point: Vec3, normal: Vec3, towards: Vec3, map: &Shelter, site: &Site) -> [f32; 3] {
    let lift = (LIFT * map.cell() / site.metres_per_unit) as f32;
    let away = if normal == Vec3::ZERO { towards } else { normal };
    (point + away * lift).to_array()
}

/// Median ratio of light to shade, and the score of a direction; `None` where too few pairs tell.
fn score(
    (surfaces, pairs): (&Surfaces, &[Pair]),
    sun: [f64; 3],
    occluders: &Occluders,
) -> Option<(f64, f64)> {
    let map = sun_map(occluders, sun, 1);
    let sun = Vec3::from_array(sun.map(|v| v as f32));
    let is_lit = |index: u32| {
        let index = index as usize;
        map.is_lit(surfaces.points[index], surfaces.normals[index])
    };
    let ratios: Vec<f64> = pairs
        .iter()
        .filter(|pair| pair.points.iter().all(|i| surfaces.normals[*i as usize].dot(sun) > INCIDENCE))
        .filter_map(|pair| match pair.points.map(is_lit) {
            [true, false] => Some(f64::from(pair.log_ratio)),
            [false, true] => Some(-f64::from(pair.log_ratio)),
            _ => None,
        })
        .collect();
    if ratios.len() < FEWEST {
        return None;
    }
    let shadows = ratios.iter().filter(|ratio| **ratio > SHADOW).count() as f64 / ratios.len() as f64;
    let median = median(ratios)?;
    Some((median.exp(), (median * shadows).max(0.0)))
}

/// A direction by elevation and azimuth (radians, about up), world axes.
fn towards(site: &Site, elevation: f64, azimuth: f64) -> [f64; 3] {
    let (sin, cos) = elevation.sin_cos();
    from_level(&level_axes(site.up), [cos * azimuth.cos(), cos * azimuth.sin(), sin])
}

/// Looks for the sun by narrow and by wide pairs; `None` if too few pairs tell. Under clouds no direction explains the shadows,
/// and the best is no sun ([`FoundSun::is_sun`]).
pub(super) fn find_sun(
    surfaces: &Surfaces,
    [narrow, wide]: [&[Pair]; 2],
    occluders: &Occluders,
    site: &Site,
    threads: usize,
) -> Option<FoundSun> {
    let coarse = occluders.sketched(COARSE);
    let [low, high] = ELEVATIONS.map(|degrees: f64| degrees.to_radians().sin());
    let golden = TAU * 0.618_033_988_75;
    let tried: Vec<[f64; 2]> = (0..TRIED)
        .map(|i| {
            let sin = low + (high - low) * (i as f64 + 0.5) / TRIED as f64;
            [sin.asin(), golden * i as f64]
        })
        .collect();
    let value = |place: (&Surfaces, &[Pair]), [elevation, azimuth]: [f64; 2], occluders: &Occluders| {
        score(place, towards(site, elevation, azimuth), occluders)
    };
    let scores: Vec<f64> = map(tried.len(), threads, |k| {
        value((surfaces, wide), tried[k], &coarse).map_or(0.0, |(_, score)| score)
    });
    let first = (0..tried.len()).max_by(|a, b| scores[*a].total_cmp(&scores[*b]))?;
    let middle = median(scores.clone())?;
    let spread = median(scores.iter().map(|score| (score - middle).abs()).collect())?;
    let chance = middle + DEVIATIONS * spread;
    let fine = occluders.sketched(FINE);
    let by_wide = |at: [f64; 2]| value((surfaces, wide), at, &fine);
    let mut best = (tried[first], by_wide(tried[first])?);
    for step in WIDE_STEPS {
        best = climbed(best, step.to_radians(), threads, by_wide);
    }
    let turned = [-TURNED, TURNED]
        .map(|turn: f64| by_wide([best.0[0], best.0[1] + turn.to_radians()]).map_or(0.0, |(_, score)| score));
    let turned = turned[0].max(turned[1]);
    let (ratio, score) = best.1;
    let found = |[elevation, azimuth]: [f64; 2]| FoundSun {
        direction: towards(site, elevation, azimuth),
        ratio,
        scores: [score, turned, chance],
    };
    if !found(best.0).is_sun(site.up) {
        return Some(found(best.0));
    }
    // Few narrow pairs are no reason to doubt what wide ones say.
    let middling = occluders.sketched(1.0);
    let by_narrow = |at: [f64; 2]| value((surfaces, narrow), at, &middling);
    let Some(first) = by_narrow(best.0) else { return Some(found(best.0)) };
    let direction = climbed((best.0, first), NARROW_STEP.to_radians(), threads, by_narrow).0;
    let finest = occluders.sketched(FINEST);
    let direction = centred(direction, threads, |at| value((surfaces, narrow), at, &finest));
    Some(found(direction))
}

/// The steps in elevation and azimuth that are tried about a direction.
const NEIGHBOURS: [[f64; 2]; 4] = [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]];

/// The mean of directions about one, weighted by their scores: shadows are told by few pairs, so that scores are rough.
fn centred(
    [elevation, azimuth]: [f64; 2],
    threads: usize,
    value: impl Fn([f64; 2]) -> Option<(f64, f64)> + Sync,
) -> [f64; 2] {
    let step = RING_STEP.to_radians();
    let wide = step / elevation.cos().max(0.2);
    let steps = -RINGS..=RINGS;
    let around: Vec<[f64; 2]> = steps
        .clone()
        .flat_map(|e| steps.clone().map(move |a| [e, a].map(f64::from)))
        .map(|[e, a]| [elevation + e * step, azimuth + a * wide])
        .collect();
    let scores = map(around.len(), threads, |k| value(around[k]).map_or(0.0, |(_, score)| score));
    let least = WEIGHED * scores.iter().copied().fold(0.0, f64::max);
    let (mut sum, mut weights) = ([0.0; 2], 0.0);
    for (at, score) in around.iter().zip(scores) {
        let weight = (score - least).max(0.0);
        (0..2).for_each(|k| sum[k] += weight * at[k]);
        weights += weight;
    }
    if weights > 0.0 { sum.map(|v| v / weights) } else { [elevation, azimuth] }
}

/// A direction (elevation and azimuth) with the ratio of light to shade and the score there.
type Tried = ([f64; 2], (f64, f64));

/// The best direction about one, by steps of `step`, radians, until none is better, or three are taken.
fn climbed(
    mut best: Tried,
    step: f64,
    threads: usize,
    value: impl Fn([f64; 2]) -> Option<(f64, f64)> + Sync,
) -> Tried {
    for _ in 0..3 {
        let [elevation, azimuth] = best.0;
        let wide = step / elevation.cos().max(0.2);
        let around = NEIGHBOURS.map(|[e, a]: [f64; 2]| [elevation + e * step, azimuth + a * wide]);
        let found = map(around.len(), threads, |k| value(around[k]));
        let better = around.into_iter().zip(found).filter_map(|(at, found)| Some((at, found?)));
        match better.max_by(|a, b| a.1.1.total_cmp(&b.1.1)) {
            Some(found) if found.1.1 > best.1.1 => best = found,
            _ => break,
        }
    }
    best
}
