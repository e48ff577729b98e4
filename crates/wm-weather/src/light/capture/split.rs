//! Splits the captured light into that of the sun and that of the sky.

use super::terms::{CaptureSun, MeanSurface, captured_light, surface_of};
use crate::level::dot;
use crate::light::irradiance::{SceneLight, SkyGradation, SurfaceLight};
use crate::light::places::Surfaces;
use crate::light::quantile::median;
use crate::light::shadow_edges::ShadowEdges;
use crate::light::sun_search::{self, Pair};
use crate::light::unseen_casters::{self, MappedLight};
use crate::optics::Site;
use crate::shelter::Occluders;
use crate::threads::map;
use glam::Vec3;
use wm_base::color::luminance;
use wm_scene::Camera;

/// Radius about a point over which the map is averaged, m, and radius within which all of it must
/// be lit or all in shade to be believed, m: where more than [`MIN_AGREED_SHARE`] of the pairs in
/// sun and shade show it, and where fewer do.
const AGREED_RADII_M: [f32; 2] = [0.12, 0.3];
const DISPUTED_RADII_M: [f32; 2] = [0.35, 1.2];
const MIN_AGREED_SHARE: f64 = 0.7;
/// The share below which the shadows are not those of this sun.
const LEAST_AGREEMENT: f64 = 0.47;
/// Share of the sun by which colours contradict the map, and the growth of the ratio of sun to sky
/// without what they contradict above which they take patterns for shadows.
const MIN_CONTRADICTION_SHARE: f32 = 0.2;
const MAX_RATIO_GROWTH: f64 = 1.5;
/// Distance of the surfaces whose colours tell the light of each other.
const COLOR_RADIUS_M: f32 = 0.4;
/// Level light of the sun over that of the sky, below which there is none.
const LEAST_SUN: f64 = 0.3;
/// Ratio of sun to sky of level ground that no photo shows.
const MOST_RATIO: f64 = 40.0;

/// The light of a capture with a sun.
pub(super) struct Split {
    pub(super) sun: CaptureSun,
    /// The share of the sun that each surface sees.
    pub(super) seen: Vec<f32>,
    /// The irradiance of each in shade and in full sun, luminance.
    pub(super) amounts: Vec<[f32; 2]>,
}

impl Split {
    /// Splits the light of surfaces by a sun; `None` where no pair tells its strength.
    #[allow(
        clippy::too_many_arguments,
        reason = "the surfaces, what may shade them and the cameras that saw them"
    )]
    pub(super) fn new(
        surfaces: &Surfaces,
        open: &[[f32; 2]],
        pairs: &[Pair],
        occluders: &Occluders,
        coarseness: f32,
        direction: [f64; 3],
        cameras: &[Camera],
        site: &Site,
    ) -> Option<Self> {
        let map_of_sun = sun_search::sun_map(occluders, direction);
        let (up, sun) = ([site.up, direction]).map(|v| Vec3::from_array(v.map(|v| v as f32))).into();
        let lit_within = |metres: f32| {
            let radius = coarseness * metres;
            map(surfaces.len(), |i| map_of_sun.lit_within(surfaces.points[i], surfaces.normals[i], radius))
        };
        let place =
            |seen: &[f32], i: usize| surface_of(surfaces.normals[i], open[i], seen[i], up, Some(direction));
        let on_ground: Vec<Pair> =
            sun_search::ground_pairs(surfaces, open, pairs, site).iter().map(|it| it.pair).collect();
        let rough = lit_within(DISPUTED_RADII_M[0]);
        let agreement = agreement(&on_ground, &rough);
        if agreement < LEAST_AGREEMENT {
            return None;
        }
        let (mut prior, around) = if agreement > MIN_AGREED_SHARE {
            (lit_within(AGREED_RADII_M[0]), AGREED_RADII_M[1])
        } else {
            (rough, DISPUTED_RADII_M[1])
        };
        let mut is_sure: Vec<bool> =
            lit_within(around).into_iter().map(|share| !(0.03..0.97).contains(&share)).collect();
        let reach = coarseness * COLOR_RADIUS_M / site.metres_per_unit as f32;
        let given = |seen: &[f32], known: &[f32]| {
            let mean = MeanSurface::new((0..surfaces.len()).map(|i| place(seen, i)));
            let of_pairs = |pairs| sun_to_sky(surfaces, pairs, known, &mean, |i| place(seen, i));
            let ratio = of_pairs(&on_ground).or_else(|| of_pairs(pairs))?;
            // Corners under a grey sky are darker too, but not by this.
            (luminance(ratio) * dot(direction, site.up) >= LEAST_SUN).then_some((mean, ratio))
        };
        let in_light = |found: &(MeanSurface, [f64; 3])| {
            let (mean, ratio) = found;
            let sun = CaptureSun { direction, ratio: *ratio, lit: 0.0, contrast_left: 1.0 };
            let light = captured_light(Some(&sun), site);
            (sun, light, mean.under(&light))
        };
        let by_map = given(&prior, &prior)?;
        let may_be = unseen_casters::may_be_shaded(surfaces, cameras, direction, site);
        if may_be.contains(&true) {
            let (_, light, mean) = in_light(&by_map);
            let by_place = vec![0.0; surfaces.len()];
            let reflectance = |i: usize| {
                let shade = place(&by_place, i);
                [0.0, 1.0].map(|sun| {
                    let irradiance = SurfaceLight { sun, ..shade }.irradiance(&light, mean);
                    surfaces.light[i] / Vec3::from_array(irradiance.map(|v| v.max(1e-4) as f32))
                })
            };
            let mapped = MappedLight { shares: &mut prior, is_sure: &mut is_sure };
            let around = coarseness * around / site.metres_per_unit as f32;
            unseen_casters::amend(surfaces, &may_be, mapped, reflectance, around, site);
        }
        let prior = prior;
        let edges = ShadowEdges::new(surfaces, &is_sure, reach);
        let solve_shares = |found: (MeanSurface, [f64; 3])| {
            let (sun, light, mean) = in_light(&found);
            let both = |i: usize| {
                let shade = SurfaceLight { sun: 0.0, ..place(&prior, i) };
                let sunny = SurfaceLight { sun: 1.0, ..shade };
                [shade, sunny].map(|surface| luminance(surface.irradiance(&light, mean)) as f32)
            };
            let amounts: Vec<[f32; 2]> = (0..surfaces.len()).map(both).collect();
            let seen = edges.shares(&amounts, &prior);
            (sun, amounts, seen)
        };
        let first = solve_shares(by_map);
        // The map without what colours contradict tells the ratio better, unless it gives way to
        // them.
        let agreed: Vec<f32> = prior
            .iter()
            .zip(&first.2)
            .map(|(mapped, seen)| if (mapped - seen).abs() < MIN_CONTRADICTION_SHARE { *mapped } else { 0.5 })
            .collect();
        let better = given(&first.2, &agreed)
            .filter(|(_, ratio)| luminance(*ratio) < MAX_RATIO_GROWTH * luminance(first.0.ratio));
        let (trial, amounts, seen) = better.map_or(first, solve_shares);
        let facing: Vec<usize> =
            (0..surfaces.len()).filter(|i| surfaces.normals[*i].dot(sun) > 0.2).collect();
        let lit = facing.iter().map(|i| f64::from(seen[*i])).sum::<f64>() / facing.len().max(1) as f64;
        let contrast_left = contrast_left(pairs, &amounts, &seen);
        Some(Self { sun: CaptureSun { lit, contrast_left, ..trial }, seen, amounts })
    }
}

/// The ratio of sun to sky by channel: the median over pairs of which one point is surely in the
/// sun, and the other in shade, and which show it: where the geometry is rough, the map is wrong
/// about many.
fn sun_to_sky(
    surfaces: &Surfaces,
    pairs: &[Pair],
    seen: &[f32],
    mean: &MeanSurface,
    place: impl Fn(usize) -> SurfaceLight,
) -> Option<[f64; 3]> {
    let unit = SceneLight { sun: [0.0; 3], sky: SkyGradation::even([1.0; 3]) };
    let mean_sky = mean.under(&unit)[0];
    let mut ratios = [const { Vec::new() }; 3];
    for pair in pairs {
        let [a, b] = pair.points.map(|i| i as usize);
        let (lit, shade) = match [seen[a], seen[b]] {
            [a_seen, b_seen] if a_seen > 0.97 && b_seen < 0.03 => (a, b),
            [a_seen, b_seen] if a_seen < 0.03 && b_seen > 0.97 => (b, a),
            _ => continue,
        };
        let log_ratio = if lit == a { pair.log_ratio } else { -pair.log_ratio };
        if f64::from(log_ratio) < sun_search::MIN_SHADOW_LOG_RATIO {
            continue;
        }
        let (mut in_sun, mut in_shade) = (place(lit), place(shade));
        let mid: [f64; 2] = std::array::from_fn(|k| 0.5 * (in_sun.open[k] + in_shade.open[k]));
        (in_sun.open, in_shade.open) = (mid, mid);
        let sky = |surface: &SurfaceLight| SurfaceLight { sun: 0.0, ..*surface }.direct(&unit)[0];
        for k in 0..3 {
            let ratio = f64::from(surfaces.light[lit][k] / surfaces.light[shade][k].max(1e-4));
            let sum = ratio * (sky(&in_shade) + in_shade.returned() * mean_sky)
                - (sky(&in_sun) + in_sun.returned() * mean_sky);
            let share = in_sun.incidence + (in_sun.returned() - ratio * in_shade.returned()) * mean.sun;
            if share > 0.05 && in_sun.incidence > 0.15 {
                ratios[k].push(sum / share);
            }
        }
    }
    if ratios[0].len() < 30 {
        return None;
    }
    let ratio = ratios.map(|all| median(all).unwrap_or(0.0));
    ratio.iter().all(|ratio| *ratio > 0.05).then(|| ratio.map(|ratio| ratio.min(MOST_RATIO)))
}

/// The share of the pairs in sun and shade by the map that show it, 0-1; 1 without any.
fn agreement(pairs: &[Pair], mapped: &[f32]) -> f64 {
    let (mut agreed, mut all) = (0.0, 0.0);
    for pair in pairs {
        let [a, b] = pair.points.map(|i| mapped[i as usize]);
        if (a - b).abs() > 0.94 {
            all += 1.0;
            agreed += f64::from(u8::from(
                f64::from(pair.log_ratio * (a - b).signum()) > sun_search::MIN_SHADOW_LOG_RATIO,
            ));
        }
    }
    if all > 0.0 { agreed / all } else { 1.0 }
}

/// Spread of reflectance over pairs of light and shade, beyond that of pairs in one light, of the
/// contrast before.
fn contrast_left(pairs: &[Pair], amounts: &[[f32; 2]], seen: &[f32]) -> f64 {
    let irradiance = |i: u32| {
        let [shade, sunny] = amounts[i as usize];
        f64::from(shade + (sunny - shade) * seen[i as usize])
    };
    let (mut before, mut after, mut same) = (Vec::new(), Vec::new(), Vec::new());
    for pair in pairs {
        let [a, b] = pair.points;
        let left = (f64::from(pair.log_ratio) - (irradiance(a) / irradiance(b)).ln()).abs();
        if (seen[a as usize] - seen[b as usize]).abs() > 0.7 {
            before.push(f64::from(pair.log_ratio).abs());
            after.push(left);
        } else if (seen[a as usize] - seen[b as usize]).abs() < 0.1 {
            same.push(left);
        }
    }
    let median = |values: Vec<f64>| median(values).unwrap_or(f64::NAN);
    let left = (median(after) - median(same)).max(0.0) / median(before);
    if left.is_nan() { 1.0 } else { left.min(1.0) }
}
