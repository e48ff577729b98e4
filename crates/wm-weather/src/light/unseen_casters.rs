//! Shadows of what no photo shows.
//!
//! Photos of a walk end above doors: the crown of a tree that throws a shadow on the road may be in
//! none of them, and the map of what stands in the sun's way knows nothing of it. So where the
//! photos do not show the way to the sun, the colours of level ground decide. Ground whose light is
//! known tells which reflectances there are. Ground that in the sun would have a reflectance which
//! hardly any of it has, and in the shade one that is common, lies in the shade.

use super::places::Surfaces;
use super::sun_search::{MIN_LEVEL_COSINE, chromaticity, luminance};
use crate::optics::Site;
use crate::point_grid::PointGrid;
use crate::threads::map;
use glam::{DVec3, Vec3};
use wm_scene::Camera;

/// Heights above the ground at which it is asked whether photos show the way to the sun: those
/// of crowns and eaves.
const TESTED_HEIGHTS_M: [f64; 8] = [1.5, 3.0, 4.5, 6.0, 7.5, 9.0, 10.5, 12.0];
/// Number of these heights unseen by all photos from which something may stand there.
const MIN_UNSEEN_HEIGHTS: usize = 2;
/// Greatest distance from which a photo shows what stands somewhere, m.
const MAX_PHOTO_DISTANCE_M: f64 = 60.0;
/// Widths of the bins of reflectances: the log of the luminance, and the shares of red and green;
/// and numbers of bins.
const BIN_WIDTHS: [f32; 3] = [0.12, 0.02, 0.02];
const BIN_COUNTS: [usize; 3] = [64, 50, 50];
/// Log of the least luminance of the bins.
const MIN_BIN_LOG_LUMINANCE: f32 = -6.5;
/// Prior probability that such ground lies in shade.
const IN_SHADE: f32 = 0.2;
/// The share of all ground in a bin of reflectances that is added to each, so that none is
/// impossible.
const BIN_FLOOR: f32 = 2e-4;
/// Largest log odds that one surface's colour contributes.
const MAX_LOG_ODDS: f32 = 3.0;
/// Radius within which surfaces decide together, m, and their mean log of odds from which it is
/// shade.
const DECISION_RADIUS_M: f32 = 0.3;
const MIN_SHADE_LOG_ODDS: f32 = 0.2;
/// Least number of surfaces in known light for an estimate of reflectances.
const LEAST_KNOWN: usize = 1000;

/// Returns for each surface whether something that no photo shows may stand between it and the sun:
/// it is level ground, and no camera shows a part of its way to the sun.
pub(super) fn may_be_shaded(
    surfaces: &Surfaces,
    cameras: &[Camera],
    sun: [f64; 3],
    site: &Site,
) -> Vec<bool> {
    let (up, sun) = (DVec3::from_array(site.up), DVec3::from_array(sun));
    let level = up.as_vec3();
    let rise = sun.dot(up);
    let far = MAX_PHOTO_DISTANCE_M / site.metres_per_unit;
    map(surfaces.len(), |i| {
        if surfaces.normals[i].dot(level) < MIN_LEVEL_COSINE || cameras.is_empty() {
            return false;
        }
        let point = surfaces.points[i].as_dvec3();
        let is_shown = |height: &&f64| {
            let place = point + sun * (**height / rise / site.metres_per_unit);
            cameras.iter().any(|camera| {
                camera.center().distance_squared(place) < far * far
                    && camera.project(place).is_some_and(|(x, y, _)| {
                        x >= 0.0 && y >= 0.0 && x < f64::from(camera.width) && y < f64::from(camera.height)
                    })
            })
        };
        TESTED_HEIGHTS_M.len() - TESTED_HEIGHTS_M.iter().filter(is_shown).count() >= MIN_UNSEEN_HEIGHTS
    })
}

/// Returns the share of level ground in each bin of reflectances, by known ones, linear RGB, of
/// which there must be some.
fn shares_of_bins(known: &[Vec3]) -> Vec<f32> {
    let mut counts = vec![0.0f32; BIN_COUNTS.iter().product()];
    known.iter().filter_map(|color| bin(*color)).for_each(|bin| counts[bin] += 1.0);
    for axis in 0..3 {
        counts = smoothed(&counts, axis);
    }
    counts.iter_mut().for_each(|count| *count /= known.len() as f32);
    counts
}

/// The bin of a reflectance; `None` for one that is in no bin.
fn bin(color: Vec3) -> Option<usize> {
    let shares = chromaticity(color);
    // The log of nothing is below all bins.
    let at = [
        (luminance(color).ln() - MIN_BIN_LOG_LUMINANCE) / BIN_WIDTHS[0],
        shares.x / BIN_WIDTHS[1],
        shares.y / BIN_WIDTHS[2],
    ];
    let inside = (0..3).all(|k| at[k] >= 0.0 && at[k] < BIN_COUNTS[k] as f32);
    inside.then(|| {
        let [a, b, c] = at.map(|v| v as usize);
        (a * BIN_COUNTS[1] + b) * BIN_COUNTS[2] + c
    })
}

/// The mean of each bin and those beside it along an axis, weighted 1, 2, 1.
fn smoothed(counts: &[f32], axis: usize) -> Vec<f32> {
    let step: usize = BIN_COUNTS[axis + 1..].iter().product();
    let at = |i: usize| i / step % BIN_COUNTS[axis];
    (0..counts.len())
        .map(|i| {
            let before = if at(i) > 0 { counts[i - step] } else { 0.0 };
            let after = if at(i) + 1 < BIN_COUNTS[axis] { counts[i + step] } else { 0.0 };
            0.25 * before + 0.5 * counts[i] + 0.25 * after
        })
        .collect()
}

/// The light of the ground by the map of the sun, which colours amend.
pub(super) struct MappedLight<'a> {
    /// The share of the sun that each surface sees.
    pub(crate) shares: &'a mut [f32],
    /// True where the map is right about the surface, if it knows what stands in the way.
    pub(crate) is_sure: &'a mut [bool],
}

/// Lets the colours of level ground say that it lies in the shade, where `may_be` says that the map
/// may not know. `reflectance` is that of a surface if it is in full shade, and if it is in full
/// sun, linear RGB. Within `around` (scene units) of the edges of such shade nothing is sure.
pub(super) fn amend(
    surfaces: &Surfaces,
    may_be: &[bool],
    mapped: MappedLight<'_>,
    reflectance: impl Fn(usize) -> [Vec3; 2] + Sync,
    around: f32,
    site: &Site,
) {
    let MappedLight { shares, is_sure } = mapped;
    let up = DVec3::from_array(site.up).as_vec3();
    let is_ground = |i: &usize| surfaces.normals[*i].dot(up) > MIN_LEVEL_COSINE;
    let known: Vec<Vec3> = (0..surfaces.len())
        .filter(|i| is_sure[*i] && !may_be[*i] && is_ground(i))
        .map(|i| reflectance(i)[usize::from(shares[i] > 0.5)])
        .collect();
    if known.len() < LEAST_KNOWN {
        return;
    }
    let common = shares_of_bins(&known);
    let share = |color: Vec3| bin(color).map_or(0.0, |bin| common[bin]);
    let asked: Vec<usize> = (0..surfaces.len()).filter(|i| may_be[*i] && shares[*i] > 0.5).collect();
    let said = map(asked.len(), |k| {
        let [shade, sunny] = reflectance(asked[k]).map(share);
        let odds = IN_SHADE * (shade + BIN_FLOOR) / ((1.0 - IN_SHADE) * (sunny + BIN_FLOOR));
        odds.ln().clamp(-MAX_LOG_ODDS, MAX_LOG_ODDS)
    });
    let reach = DECISION_RADIUS_M / site.metres_per_unit as f32;
    let points: Vec<Vec3> = asked.iter().map(|i| surfaces.points[*i]).collect();
    let grid = PointGrid::new(&points, reach);
    let is_shade = map(asked.len(), |k| {
        let near = grid.near(points[k]).filter(|i| points[*i].distance_squared(points[k]) < reach * reach);
        let (sum, count) = near.fold((0.0f32, 0.0f32), |(sum, count), i| (sum + said[i], count + 1.0));
        sum > MIN_SHADE_LOG_ODDS * count
    });
    let [in_sun, in_shade] = [false, true].map(|shade| -> Vec<Vec3> {
        (0..asked.len()).filter(|k| is_shade[*k] == shade).map(|k| points[k]).collect()
    });
    let grids = [&in_sun, &in_shade].map(|points| PointGrid::new(points, around));
    let is_near = |grid: &PointGrid, points: &[Vec3], point: Vec3| {
        grid.near(point).any(|i| points[i].distance_squared(point) < around * around)
    };
    let is_edge = map(asked.len(), |k| match is_shade[k] {
        true => is_near(&grids[0], &in_sun, points[k]),
        false => is_near(&grids[1], &in_shade, points[k]),
    });
    for (k, i) in asked.iter().enumerate() {
        if is_shade[k] {
            shares[*i] = 0.0;
        }
        is_sure[*i] &= !is_edge[k];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;
    use crate::testing::on_threads;
    use wm_base::random::uniform;

    const SURFACE_SPACING_M: f32 = 0.1;
    /// Half of the width of the ground, in surfaces.
    const HALF_WIDTH_SURFACES: i32 = 60;
    /// Irradiances in the shade and in the sun.
    const SHADE_AND_SUN_IRRADIANCES: [f32; 2] = [0.25, 1.0];

    fn site() -> Site {
        Site { metres_per_unit: 1.0, up: [0.0, 0.0, 1.0], ground: 0.0, ..testing::SITE }
    }

    /// Ground of grey paving and of a darker road, with texture, in the sun where `is_lit`.
    fn ground(is_lit: impl Fn(Vec3) -> bool) -> Surfaces {
        let cells = (-HALF_WIDTH_SURFACES..HALF_WIDTH_SURFACES)
            .flat_map(|y| (-HALF_WIDTH_SURFACES..HALF_WIDTH_SURFACES).map(move |x| [x, y]));
        let points: Vec<Vec3> =
            cells.map(|[x, y]| Vec3::new(x as f32, y as f32, 0.0) * SURFACE_SPACING_M).collect();
        let light = points.iter().enumerate().map(|(i, point)| {
            let albedo = if point.x < 0.0 { 0.35 } else { 0.2 };
            let texture = 0.85 + 0.3 * uniform(5, i as u64) as f32;
            Vec3::splat(albedo * texture * SHADE_AND_SUN_IRRADIANCES[usize::from(is_lit(*point))])
        });
        let light = light.collect();
        Surfaces { normals: vec![Vec3::Z; points.len()], oriented: points.len(), light, points }
    }

    /// The surfaces that are found to lie in the shade. Of those with a positive y the way to the
    /// sun is not known.
    fn decide(surfaces: &Surfaces) -> Vec<bool> {
        let may_be: Vec<bool> = surfaces.points.iter().map(|point| point.y > 0.0).collect();
        let (mut shares, mut is_sure) = (vec![1.0; surfaces.len()], vec![true; surfaces.len()]);
        let mapped = MappedLight { shares: &mut shares, is_sure: &mut is_sure };
        let reflectance =
            |i: usize| SHADE_AND_SUN_IRRADIANCES.map(|irradiance| surfaces.light[i] / irradiance);
        amend(surfaces, &may_be, mapped, reflectance, 0.3, &site());
        shares.into_iter().map(|share| share < 0.5).collect()
    }

    /// The crown over the road is in no photo: its shadow is found on both materials, and the road
    /// beside the paving is none.
    #[test]
    fn shade_of_what_no_photo_shows_is_told_by_colour() {
        let is_shade = |point: Vec3| point.y > 1.0 && point.y < 4.0 && point.x.abs() < 2.5;
        let surfaces = ground(|point| !is_shade(point));
        let [found, on_more] = on_threads([2, 3], || decide(&surfaces));
        let wrong = surfaces.points.iter().zip(&found).filter(|(point, found)| is_shade(**point) != **found);
        let all = surfaces.points.iter().filter(|point| is_shade(**point)).count();
        assert!(wrong.clone().count() < all / 10, "{} of {all}", wrong.count());
        assert_eq!(found, on_more);
        assert!(decide(&ground(|_| true)).iter().all(|is_shaded| !is_shaded));
    }

    /// A camera that looks level shows the way to a high sun over ground far ahead, not over that
    /// before its feet.
    #[test]
    fn only_ground_whose_way_to_the_sun_is_seen_is_known() {
        let surfaces = ground(|_| true);
        let eye = DVec3::new(0.0, -30.0, 1.6);
        let camera = Camera::looking((60, 40), 60.0, eye, DVec3::new(0.0, 0.0, 1.6), DVec3::Z).unwrap();
        let may_be = |cameras: &[Camera], sun: [f64; 3]| {
            may_be_shaded(&surfaces, cameras, sun, &site()).iter().filter(|may_be| **may_be).count()
        };
        let near =
            Camera::looking((60, 40), 60.0, DVec3::new(0.0, -6.0, 1.6), DVec3::new(0.0, 0.0, 1.6), DVec3::Z);
        assert_eq!(may_be(&[camera], [0.0, 0.0, 1.0]), 0);
        assert_eq!(may_be(&[near.unwrap()], [0.0, 0.0, 1.0]), surfaces.len());
        // No photos say nothing.
        assert_eq!(may_be(&[], [0.0, 0.0, 1.0]), 0);
    }
}
