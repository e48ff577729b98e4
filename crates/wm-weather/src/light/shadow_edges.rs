//! The edges of shadows where colours show them.
//!
//! A map of what stands in the sun's way puts the edge of a shadow as far off as the geometry is.
//! The colours show it exactly, but not what is shadow and what is a dark material. So surfaces
//! near a mapped edge take that light, between full shade and full sun, with which their
//! reflectance changes least from each to those beside it. With `c` the log of the colour and `s`
//! that of the light, the sum of `|(c - s) - (c' - s')|` over neighbours is least: a convex
//! problem, solved by reweighted averages.

use super::places::Surfaces;
use super::sun_search::same_material;
use crate::point_grid::PointGrid;
use crate::threads::map;
use glam::Vec3;
use wm_base::color::luminance;
use wm_scene::{Splats, quat};

const MAX_NEIGHBOUR_COUNT: usize = 10;
/// Least cosine between the normals of neighbours.
const MIN_NORMAL_COSINE: f32 = 0.9;
const AVERAGING_ROUND_COUNT: usize = 300;
/// Differences of logs below which a difference is as good as none.
const MIN_LOG_DIFFERENCE: f32 = 0.03;
/// The weight of the mapped light of a surface near an edge, in that of a neighbour: of surfaces
/// that photos show, whose places are a little off, and of splats without photos.
const MAPPED_LIGHT_WEIGHTS: [f32; 2] = [0.01, 0.1];
/// Least luminance and irradiance whose log is taken, and least gain by the sun with which a colour
/// tells its share.
const MIN_LUMINANCE: f32 = 1e-4;
const LEAST_GAIN: f32 = 1.05;
/// Least difference between the sun's shares around a splat at the edge of a shadow.
const MIN_EDGE_DIFFERENCE: f32 = 0.5;
/// Least difference between the sun's shares around a splat whose share is sharpened.
const MIN_SHARPENED_DIFFERENCE: f32 = 0.1;
/// Standard deviations, in those of a splat, of the part that its colour is the mean of, and of
/// what a picture of overlapping splats shows at its middle.
const COLOR_SIGMAS: f32 = 0.45;
const BLENDED_SIGMAS: f32 = 0.85;
/// Least standard deviation across a flat splat, in the longest: it is not off what lies a little
/// above it.
const MIN_SIGMA_RATIO: f32 = 0.5;
/// The part of the difference between these two that is added to the share: all of it leaves bright
/// flecks where the edge is not exactly known.
const SHARPENING_SHARE: f32 = 0.6;
/// Least light of a sharpened splat, of that in full shade, and the largest share of the sun.
const LEAST_LIGHT: f32 = 0.5;
const MOST_SHARE: f32 = 1.4;

/// The surfaces whose light the colours tell, with their neighbours.
pub(super) struct ShadowEdges {
    unsure: Vec<EdgeSurface>,
    neighbours: Vec<u32>,
    /// Logs of the luminances of all surfaces.
    color: Vec<f32>,
    /// The weight of the mapped light.
    mapped: f32,
}

/// A surface near the edge of a shadow, whose light is estimated from colours.
struct EdgeSurface {
    index: u32,
    /// Range of its neighbours.
    first: u32,
    end: u32,
}

impl ShadowEdges {
    /// Finds the neighbours, up to `reach` (scene units) away, of the surfaces whose mapped light
    /// is not sure.
    pub(crate) fn new(surfaces: &Surfaces, is_sure: &[bool], reach: f32) -> Self {
        let asked: Vec<usize> =
            (0..surfaces.len()).filter(|i| !is_sure[*i] && surfaces.normals[*i] != Vec3::ZERO).collect();
        let grid = PointGrid::new(&surfaces.points, reach);
        let found = map(asked.len(), |k| {
            let i = asked[k];
            let (point, normal, light) = (surfaces.points[i], surfaces.normals[i], surfaces.light[i]);
            let is_like = |other: &usize| {
                *other != i
                    && surfaces.normals[*other].dot(normal) > MIN_NORMAL_COSINE
                    && same_material(surfaces.light[*other], light)
            };
            let mut near: Vec<(f32, u32)> = grid
                .near(point)
                .filter(is_like)
                .map(|other| (surfaces.points[other].distance_squared(point), other as u32))
                .filter(|(distance, _)| *distance < reach * reach)
                .collect();
            near.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            // Near and far ones, so that the light spreads in few rounds.
            let step = near.len().div_ceil(MAX_NEIGHBOUR_COUNT).max(1);
            near.into_iter().step_by(step).map(|(_, other)| other).collect::<Vec<u32>>()
        });
        let (mut neighbours, mut unsure) = (Vec::new(), Vec::with_capacity(asked.len()));
        for (index, near) in asked.iter().zip(found).filter(|(_, near)| !near.is_empty()) {
            let first = neighbours.len() as u32;
            neighbours.extend(near);
            unsure.push(EdgeSurface { index: *index as u32, first, end: neighbours.len() as u32 });
        }
        let color = surfaces.light.iter().map(|light| log_luminance(*light));
        let mapped = MAPPED_LIGHT_WEIGHTS[usize::from(surfaces.oriented == 0)];
        Self { unsure, neighbours, color: color.collect(), mapped }
    }

    /// The share of the sun that each surface sees. `amounts` are its irradiances in shade and in
    /// full sun, `mapped` the share by the map.
    pub(crate) fn shares(&self, amounts: &[[f32; 2]], mapped: &[f32]) -> Vec<f32> {
        let of_share = |i: usize, share: f32| {
            let [shade, sunny] = amounts[i];
            (shade + (sunny - shade) * share).max(MIN_LUMINANCE).ln()
        };
        let mut light: Vec<f32> = (0..mapped.len()).map(|i| of_share(i, mapped[i])).collect();
        // By the map, in full shade and in full sun.
        let limits: Vec<[f32; 3]> = self
            .unsure
            .iter()
            .map(|it| it.index as usize)
            .map(|i| [light[i], of_share(i, 0.0), of_share(i, 1.0)])
            .collect();
        let mut reflectance: Vec<f32> =
            self.color.iter().zip(&light).map(|(color, light)| color - light).collect();
        for _ in 0..AVERAGING_ROUND_COUNT {
            let told = map(self.unsure.len(), |k| {
                let EdgeSurface { index, first, end } = self.unsure[k];
                let index = index as usize;
                let ([prior, shade, sunny], own) = (limits[k], reflectance[index]);
                let weight =
                    self.mapped * (end - first) as f32 / (light[index] - prior).abs().max(MIN_LOG_DIFFERENCE);
                let (mut sum, mut weights) = (weight * prior, weight);
                for other in &self.neighbours[first as usize..end as usize] {
                    let other = reflectance[*other as usize];
                    let weight = 1.0 / (own - other).abs().max(MIN_LOG_DIFFERENCE);
                    sum += weight * (self.color[index] - other);
                    weights += weight;
                }
                (sum / weights).clamp(shade, sunny)
            });
            for (unsure, told) in self.unsure.iter().zip(told) {
                let index = unsure.index as usize;
                (light[index], reflectance[index]) = (told, self.color[index] - told);
            }
        }
        let mut shares = mapped.to_vec();
        for EdgeSurface { index, .. } in &self.unsure {
            let index = *index as usize;
            let [shade, sunny] = amounts[index];
            if sunny > LEAST_GAIN * shade {
                shares[index] = ((light[index].exp() - shade) / (sunny - shade)).clamp(0.0, 1.0);
            }
        }
        shares
    }
}

/// The share of the sun that a splat of this light (linear RGB) sees, if its place is at the edge
/// of a shadow; `None` elsewhere. Training leaves splats some decimetres off what they show, but
/// their colour says to which side they belong. `around` are the surfaces about it, `nearest` is
/// the one that is nearest.
pub(super) fn edge_share<I: Iterator<Item = usize>>(
    surfaces: &Surfaces,
    amounts: &[[f32; 2]],
    seen: &[f32],
    nearest: usize,
    around: impl Fn() -> I,
    light: Vec3,
) -> Option<f32> {
    let is_like = |i: &usize| surfaces.normals[*i].dot(surfaces.normals[nearest]) > MIN_NORMAL_COSINE;
    let [shade, sunny] = *amounts.get(nearest)?;
    let [low, high] = range(seen, around().filter(is_like));
    if high - low < MIN_EDGE_DIFFERENCE || sunny < LEAST_GAIN * shade {
        return None;
    }
    let (mut sum, mut count) = (0.0, 0.0);
    for i in around().filter(is_like).filter(|i| same_material(surfaces.light[*i], light)) {
        let irradiance = amounts[i][0] + (amounts[i][1] - amounts[i][0]) * seen[i];
        sum += log_luminance(surfaces.light[i]) - irradiance.max(MIN_LUMINANCE).ln();
        count += 1.0;
    }
    (count > 0.0)
        .then(|| (((log_luminance(light) - sum / count).exp() - shade) / (sunny - shade)).clamp(low, high))
}

/// The share of the sun that explains the colour of a splat beside the edge of a shadow; `None`
/// elsewhere. A picture shows the mean of overlapping splats. So a sharp edge in it needs splats
/// that are brighter than full sun on one side and darker than full shade on the other: their
/// shares lie above 1 and below 0. Shares of 0 to 1 leave dark and bright lines along the edge.
/// `around` are the surfaces about the splat, `nearest` is the nearest of them.
pub(super) fn sharpened_share<I: Iterator<Item = usize>>(
    surfaces: &Surfaces,
    amounts: &[[f32; 2]],
    seen: &[f32],
    nearest: usize,
    around: impl Fn() -> I,
    splats: &Splats,
    index: usize,
) -> Option<f32> {
    let [shade, sunny] = *amounts.get(nearest)?;
    let like =
        || around().filter(|i| surfaces.normals[*i].dot(surfaces.normals[nearest]) > MIN_NORMAL_COSINE);
    let [low, high] = range(seen, like());
    if high - low < MIN_SHARPENED_DIFFERENCE || sunny < LEAST_GAIN * shade {
        return None;
    }
    let point = Vec3::from_array(splats.means[index]);
    let turn = quat::to_matrix(splats.quats[index].map(f64::from)).map(|row| row.map(|v| v as f32));
    let widths = splats.scales(index).map(|scale| scale as f32);
    let longest = widths.into_iter().fold(f32::MIN_POSITIVE, f32::max);
    // Squares of distances in standard deviations of the splat.
    let squared = |i: usize| {
        let off = (surfaces.points[i] - point).to_array();
        let along = |axis: usize| (0..3).map(|k| turn[k][axis] * off[k]).sum::<f32>();
        (0..3).map(|axis| (along(axis) / widths[axis].max(MIN_SIGMA_RATIO * longest)).powi(2)).sum::<f32>()
    };
    let least = like().map(squared).fold(f32::INFINITY, f32::min);
    let (mut sums, mut weights) = ([0.0f32; 2], [0.0f32; 2]);
    for i in like() {
        let distance = squared(i);
        for (k, width) in [COLOR_SIGMAS, BLENDED_SIGMAS].into_iter().enumerate() {
            let weight = (0.5 * (least - distance) / (width * width)).exp();
            sums[k] += weight * seen[i];
            weights[k] += weight;
        }
    }
    let [own, blended] = [0, 1].map(|k| sums[k] / weights[k]);
    let darkest = -LEAST_LIGHT * shade / (sunny - shade);
    Some((own + SHARPENING_SHARE * (own - blended)).clamp(darkest, MOST_SHARE))
}

/// The least and the greatest share of the sun that some surfaces see.
fn range(seen: &[f32], surfaces: impl Iterator<Item = usize>) -> [f32; 2] {
    surfaces.fold([1.0, 0.0], |[low, high], i| [low.min(seen[i]), high.max(seen[i])])
}

/// The log of the luminance of a colour, linear RGB.
fn log_luminance(light: Vec3) -> f32 {
    (luminance(light.to_array().map(f64::from)) as f32).max(MIN_LUMINANCE).ln()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surfel::surfel;
    use crate::testing::on_threads;
    use glam::DVec3;
    use wm_base::random::uniform;

    /// Distance between the surfaces, and by how much the map's shadow is too wide, m.
    const SURFACE_SPACING_M: f32 = 0.1;
    const MAP_ERROR_M: f32 = 0.4;

    /// Textured ground whose shadow ends at x = 0, under a map that has it end elsewhere: the
    /// colours move it back.
    #[test]
    fn a_mapped_edge_moves_to_where_the_colours_show_it() {
        let amounts = [0.3, 1.0];
        let points: Vec<Vec3> = (0..3600u32)
            .map(|i| Vec3::new((i % 60) as f32 - 29.5, (i / 60) as f32 - 29.5, 0.0) * SURFACE_SPACING_M)
            .collect();
        let share = |edge: f32| move |point: &Vec3| if point.x > edge { 1.0 } else { 0.0 };
        let light = points.iter().enumerate().map(|(i, point)| {
            let albedo = 0.3 * (0.9 + 0.2 * uniform(7, i as u64) as f32);
            Vec3::splat(albedo * (amounts[0] + (amounts[1] - amounts[0]) * share(0.0)(point)))
        });
        let light = light.collect();
        let surfaces =
            Surfaces { normals: vec![Vec3::Z; points.len()], oriented: points.len(), light, points };
        let mapped: Vec<f32> = surfaces.points.iter().map(share(MAP_ERROR_M)).collect();
        let is_sure: Vec<bool> =
            surfaces.points.iter().map(|point| (point.x - MAP_ERROR_M).abs() > 0.8).collect();
        let edges = ShadowEdges::new(&surfaces, &is_sure, 0.35);
        let [shares, on_more] = on_threads([7, 2], || edges.shares(&vec![amounts; surfaces.len()], &mapped));
        let wrong = |shares: &[f32]| {
            let pairs = surfaces.points.iter().zip(shares);
            pairs.filter(|(point, own)| (share(0.0)(point) - **own).abs() > 0.4).count()
        };
        assert!(wrong(&mapped) >= 240 && wrong(&shares) < 12, "{} of {}", wrong(&shares), wrong(&mapped));
        assert_eq!(shares, on_more);
        // What is sure stays.
        assert!((0..surfaces.len()).all(|i| !is_sure[i] || shares[i] == mapped[i]));
    }

    /// Ground of splats whose shadow ends between two rows: beside it the share goes past shade and
    /// sun, and the mean of what lies over a row, as pictures show it, is less off the edge than
    /// that of plain shares. Far from the edge nothing changes.
    #[test]
    fn shares_are_sharpened_beside_an_edge() {
        let mut splats = Splats::with_capacity(1600, 0);
        for i in 0..1600u32 {
            let point = [(i % 40) as f32 - 19.5, (i / 40) as f32 - 19.5, 0.0]
                .map(|v| f64::from(v * SURFACE_SPACING_M));
            let scales = [0.66 * f64::from(SURFACE_SPACING_M), 0.66 * f64::from(SURFACE_SPACING_M), 0.006];
            splats.push(&surfel(point, DVec3::Z, DVec3::X, scales, [0.5; 3], 0.98));
        }
        let points: Vec<Vec3> = splats.means.iter().map(|mean| Vec3::from_array(*mean)).collect();
        let surfaces = Surfaces {
            normals: vec![Vec3::Z; points.len()],
            oriented: 0,
            light: vec![Vec3::splat(0.2); points.len()],
            points,
        };
        let seen: Vec<f32> = surfaces.points.iter().map(|p| if p.x > 0.0 { 1.0 } else { 0.0 }).collect();
        let grid = PointGrid::new(&surfaces.points, 0.4);
        let amounts = vec![[0.5, 1.0]; seen.len()];
        let share = |i: usize| {
            let around = || {
                grid.near(surfaces.points[i])
                    .filter(|k| surfaces.points[*k].distance(surfaces.points[i]) < 0.4)
            };
            sharpened_share(&surfaces, &amounts, &seen, i, around, &splats, i)
        };
        let row = 20 * 40;
        assert_eq!([share(row + 5), share(row + 34)], [None, None]);
        let [dark, bright] = [row + 19, row + 20].map(|i| share(i).unwrap());
        assert!((-0.4..-0.05).contains(&dark) && (1.05..1.4).contains(&bright), "{dark} {bright}");
        let shown = |shares: &dyn Fn(usize) -> f32| {
            let weight = |k: i32| (-0.5 * (k as f32 / (0.66 * BLENDED_SIGMAS)).powi(2)).exp();
            let sum: f32 =
                (-3..=3).map(|k| weight(k) * shares((row + 20).wrapping_add_signed(k as isize))).sum();
            sum / (-3..=3).map(weight).sum::<f32>()
        };
        let [plain, sharp] = [shown(&|i| seen[i]), shown(&|i| share(i).unwrap_or(seen[i]))];
        assert!((1.0 - sharp).abs() < 0.75 * (1.0 - plain), "{plain} {sharp}");
    }
}
