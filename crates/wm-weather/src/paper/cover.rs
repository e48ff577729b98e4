//! The paper's lying snow: Gaussians of snow where surfaces look up, and on small planes between
//! them.
//!
//! # As printed
//! The normal of a Gaussian is its shortest axis; those that look up hold snow. About each, the
//! plane of its k nearest neighbours is estimated, and random points are filled in uniformly within
//! `r_plane = median(R) / (1 + 2 sigma)`, R the distances to the neighbours, where that plane is
//! within 30 degrees of level. Outliers are filtered at the end. All that is left gets the scale,
//! the opacity and the colour of snow.
//!
//! # Where the paper leaves it open
//! - **Normals** have no sign: that of the two which looks up.
//! - **Neighbours** are those that hold snow too: a wall does not tilt the plane of the floor
//!   before it. The plane is the one of least squares. What is farther from it than the spacing
//!   does not lie on it, and fills nothing.
//! - **`r_plane`.** As printed, 1 is added to a length: `sigma / mean(R)` is meant, which has no
//!   unit.
//! - **How many points.** So many that they are half the median distance apart, and no more: points
//!   at random, each kept if it is that far from all before it. The radius follows the density of
//!   the scene, and so does the spacing.
//! - **Outliers** are those farther from their neighbours on average than the mean and two standard
//!   deviations of the distances that these have to theirs, or with fewer than six near them. By
//!   the distances of all points, distant ground would be one: it is many times sparser than what
//!   is near.
//! - **The snow lies on** what it covers, by a share of the spacing: Gaussians of one depth are
//!   drawn in any order.
//!
//! Snow lies under roofs too, it does not grow, and from low views the Gaussians under it show: so
//! the paper has it.
//!
//! A pure function of the scene, the seed and the constants: neither the order of the splats nor
//! threads change it.

mod cells;

use crate::optics::Site;
use crate::particles::random::RandomSequence;
use crate::threads::map;
use cells::Cells;
use glam::{DQuat, DVec3};
use std::f64::consts::TAU;
use wm_base::jacobi::jacobi;
use wm_base::kd_tree::KdTree;
use wm_scene::splats::{Splat, logit};
use wm_scene::values::MAX_LOG_SCALE;
use wm_scene::{Group, Splats, quat};

/// Most neighbours that are looked at.
const MOST_NEIGHBOURS: usize = 64;
/// Most points tried a disc.
const MOST_DARTS: f64 = 256.0;
/// Largest coordinate, scene units: its square and sums of such still are numbers in f32.
const MAX_COORDINATE: f32 = 1e15;
/// Opacity below which a splat holds no snow.
const MIN_OPACITY: f64 = 0.1;
/// Standard deviation above which a splat holds no snow, m. Nor is there snow of such: what is so
/// sparse is no surface.
const MAX_SIGMA_M: f64 = 2.0;
/// Radius in which neighbours of what stays are counted, median distances between neighbours there.
const OUTLIER_RADIUS: f64 = 3.0;
/// Points tried in a disc as large as the spacing, and most snow Gaussians, if not set otherwise.
pub(crate) const USUAL_DARTS: f64 = 8.0;
pub(crate) const MAX_SNOW_SPLATS: usize = 4_000_000;
/// Share of the middle variance of points in the largest below which they lie on a line.
const MAX_LINE_VARIANCE_RATIO: f64 = 1e-6;

/// Lying snow of the paper.
#[derive(Clone, Debug, PartialEq)]
pub struct PaperCover {
    /// Cosine between a splat's normal and up above which it holds snow, 0-1.
    pub(crate) seed_cosine: f64,
    /// Angle between a plane's normal and up below which it is filled, degrees, 0-90.
    pub(crate) fill_angle: f64,
    /// k: neighbours that a plane is estimated from, 3-64. A smaller scene has fewer.
    pub(crate) neighbours: usize,
    /// Weight of sigma / mean in the radius of a plane, 0 or more.
    pub(crate) spread: f64,
    /// Distance between snow Gaussians, median distances to the neighbours, above 0.
    pub(crate) spacing: f64,
    /// Points tried in a disc as large as the spacing, above 0; a disc has 256 at most. The more,
    /// the fewer gaps.
    pub(crate) darts: f64,
    /// Standard deviations above the mean from which distances to the neighbours are an outlier's,
    /// 0 or more.
    pub(crate) outlier_sigmas: f64,
    /// Neighbours within [`OUTLIER_RADIUS`] that what stays has at least, 0-64.
    pub(crate) outlier_neighbours: usize,
    /// Standard deviation of a snow Gaussian along its plane, spacings, above 0. At 0.7 hardly a
    /// gap is left.
    pub(crate) size: f64,
    /// Standard deviation along the normal over that along the plane, 0-1.
    pub(crate) flatness: f64,
    /// Height of snow above the covered surface, spacings, 0 or more.
    pub(crate) lift: f64,
    /// Opacity of a snow Gaussian, 0-1: high, so that what it covers does not show.
    pub(crate) opacity: f64,
    /// Display-referred colour, 0-1: that of the albedo of fresh snow, 0.8-0.9 (Wiscombe and Warren
    /// 1980), under a light of 1.
    pub(crate) color: [f32; 3],
    /// The seed of the random filling.
    pub(crate) seed: u64,
    /// Most snow Gaussians. Half are for those on splats: of more, equally likely ones are left
    /// out, and the others are larger for it.
    pub(crate) most: usize,
}

/// The position of a snow Gaussian.
#[derive(Clone, Copy, Debug)]
struct Flake {
    /// Scene units.
    at: [f32; 3],
    /// Length 1.
    normal: DVec3,
    /// Distance to the next ones, scene units; 0 where no snow lies or it is not known yet.
    spacing: f64,
}

/// The statistics of a seed's neighbours.
struct Patch {
    /// Half their median distance, scene units; 0 where no snow lies.
    spacing: f64,
    /// The normal of their plane, where it is filled.
    normal: Option<DVec3>,
    /// Points on it that no seed nearby is too near to.
    pub(crate) darts: Vec<[f32; 3]>,
}

impl PaperCover {
    /// The snow on a scene, scene units, world axes: flat Gaussians of group [`Group::Snow`] and SH
    /// degree 0, `[M]`, M at most [`Self::most`]. Those of [`Group::Scene`] may hold snow; such
    /// with faults do not.
    ///
    /// Empty where the site has no up or no scale, or the arrays of the scene do not fit each
    /// other.
    #[must_use]
    pub fn snow(&self, splats: &Splats, site: &Site) -> Splats {
        let metres = site.metres_per_unit;
        let up = DVec3::from_array(site.up).try_normalize();
        let Some(up) = up.filter(|_| metres > 0.0 && metres.is_finite() && splats.check().is_ok()) else {
            return Splats::with_capacity(0, 0);
        };
        let mut flakes = self.seeds(splats, up, metres);
        let patches = self.patches(&flakes, up, metres);
        self.fill(&mut flakes, &patches);
        let stays = self.inliers(&flakes, up);
        let mut snow = Splats::with_capacity(stays.iter().filter(|stays| **stays).count(), 0);
        for (flake, stays) in flakes.iter().zip(stays) {
            if stays {
                snow.push(&self.surfel(flake));
            }
        }
        snow
    }

    /// Splats that look up, of those in one place one, near ones near each other in the list.
    fn seeds(&self, splats: &Splats, up: DVec3, metres: f64) -> Vec<Flake> {
        let mut seeds = Vec::new();
        for i in 0..splats.len() {
            let [a, b, c] = splats.log_scales[i];
            let holds = splats.groups[i] == Group::Scene
                && splats.opacity(i) >= MIN_OPACITY
                && f64::from(a.max(b).max(c)).exp() * metres <= MAX_SIGMA_M;
            let faults = splats.faults(i);
            let is_sound = !(faults.mean || faults.scale || faults.quat || faults.zero_quat)
                && splats.means[i].iter().all(|v| v.abs() <= MAX_COORDINATE);
            if !(holds && is_sound) {
                continue;
            }
            let normal = DVec3::from_array(splats.normal(i));
            let normal = if normal.dot(up) < 0.0 { -normal } else { normal };
            if normal.dot(up) > self.seed_cosine {
                // Of the two zeros the positive one.
                seeds.push(Flake { at: splats.means[i].map(|v| v + 0.0), normal, spacing: 0.0 });
            }
        }
        let seeds = one_flake_per_place(&seeds);
        self.random_sample(seeds, self.most.div_ceil(2))
    }

    /// Equally likely ones of too many, in their order.
    fn random_sample(&self, flakes: Vec<Flake>, most: usize) -> Vec<Flake> {
        if flakes.len() <= most {
            return flakes;
        }
        let keys: Vec<u64> = flakes.iter().map(|flake| self.key(flake.at)).collect();
        let mut ranks: Vec<(u64, usize)> = keys.iter().copied().zip(0..).collect();
        let limit = *ranks.select_nth_unstable(most).1;
        flakes
            .into_iter()
            .enumerate()
            .filter(|(i, _)| (keys[*i], *i) < limit)
            .map(|(_, flake)| flake)
            .collect()
    }

    /// A random number of a place, the same whatever else there is.
    fn key(&self, at: [f32; 3]) -> u64 {
        at.iter().fold(RandomSequence::new(self.seed).bits(), |key, v| {
            RandomSequence::new(key ^ u64::from(v.to_bits())).bits()
        })
    }

    /// The plane about each seed, and points on it. `[seeds]`
    fn patches(&self, seeds: &[Flake], up: DVec3, metres: f64) -> Vec<Patch> {
        let k = self.neighbours.clamp(3, MOST_NEIGHBOURS);
        let level = self.fill_angle.to_radians().cos();
        let near = FlakeNeighbours::new(seeds, up);
        map(seeds.len(), |i| {
            let center = place(seeds[i].at);
            let around: Vec<DVec3> = near.of(i, k).map(|j| place(seeds[j].at) - center).collect();
            let distances: Vec<f64> = around.iter().map(|offset| offset.length()).collect();
            let [mean, sigma] = moments(&distances);
            let median = median(&distances);
            let spacing = self.spacing * median;
            let radius = median / (1.0 + self.spread * sigma / mean);
            let mut patch = Patch { spacing: 0.0, normal: None, darts: Vec::new() };
            if !(radius > 0.0 && spacing > 0.0 && self.size * spacing * metres <= MAX_SIGMA_M) {
                return patch;
            }
            patch.spacing = spacing;
            let Some((middle, normal)) = plane(&around, up) else { return patch };
            let above = -middle.dot(normal);
            if normal.dot(up) <= level || above.abs() > spacing {
                return patch;
            }
            patch.normal = Some(normal);
            let (x, y) = normal.any_orthonormal_pair();
            // The seed, laid onto the plane.
            let foot = -normal * above;
            let mut draws = RandomSequence::new(self.key(seeds[i].at));
            let count = (self.darts * (radius / spacing).powi(2)).ceil().clamp(0.0, MOST_DARTS) as usize;
            for _ in 0..count {
                let out = radius * draws.uniform().sqrt();
                let (sin, cos) = (TAU * draws.uniform()).sin_cos();
                let dart = foot + (x * cos + y * sin) * out;
                let is_far = |from: &DVec3| dart.distance_squared(*from) >= spacing * spacing;
                // Most go here; the grid of cells then has little to do.
                if is_far(&DVec3::ZERO) && around.iter().all(is_far) {
                    patch.darts.push((center + dart).to_array().map(|v| v as f32));
                }
            }
            patch
        })
    }

    /// Adds points to the seeds, so far from each other and from seeds as each one's plane has it.
    fn fill(&self, flakes: &mut Vec<Flake>, patches: &[Patch]) {
        let mut cells = Cells::new(flakes.len());
        for (flake, patch) in flakes.iter_mut().zip(patches) {
            flake.spacing = patch.spacing;
            flake.normal = patch.normal.unwrap_or(flake.normal);
            cells.add(flake.at, flake.spacing);
        }
        let mut filled = Vec::new();
        for patch in patches {
            let (Some(normal), spacing) = (patch.normal, patch.spacing) else { continue };
            for &at in &patch.darts {
                if cells.is_free(at, spacing) {
                    cells.add(at, spacing);
                    filled.push(Flake { at, normal, spacing });
                }
            }
        }
        let room = self.most.saturating_sub(flakes.len());
        flakes.append(&mut self.random_sample(filled, room));
    }

    /// Marks the flakes that are no outliers. `[flakes]`
    fn inliers(&self, flakes: &[Flake], up: DVec3) -> Vec<bool> {
        let k = self.neighbours.clamp(3, MOST_NEIGHBOURS);
        let least = self.outlier_neighbours.min(MOST_NEIGHBOURS);
        let near = FlakeNeighbours::new(flakes, up);
        // Mean and standard deviation of the distances to the neighbours, and the distance of the
        // last that is needed.
        let own = map(flakes.len(), |i| {
            let center = place(flakes[i].at);
            let distances: Vec<f64> =
                near.of(i, k.max(least)).map(|j| place(flakes[j].at).distance(center)).collect();
            let last =
                if least == 0 { 0.0 } else { distances.get(least - 1).copied().unwrap_or(f64::INFINITY) };
            (moments(&distances[..k.min(distances.len())]), last)
        });
        map(flakes.len(), |i| {
            let there: Vec<[f64; 2]> = near.of(i, k).map(|j| own[j].0).collect();
            let means: Vec<f64> = there.iter().map(|[mean, _]| *mean).collect();
            let [mean, sigma] = moments(&means);
            // Of all their distances: that within each one's, and that between them.
            let within =
                there.iter().map(|[_, sigma]| sigma * sigma).sum::<f64>() / there.len().max(1) as f64;
            let most = mean + self.outlier_sigmas * (sigma * sigma + within).sqrt();
            let mut sorted = means;
            sorted.sort_unstable_by(f64::total_cmp);
            let ([own, _], last) = own[i];
            flakes[i].spacing > 0.0 && own <= most && last <= OUTLIER_RADIUS * median(&sorted)
        })
    }

    fn surfel(&self, flake: &Flake) -> Splat {
        let size = self.size * flake.spacing;
        let scales = [size, size, self.flatness * size];
        Splat {
            mean: (place(flake.at) + flake.normal * (self.lift * flake.spacing)).to_array().map(|v| v as f32),
            quat: quat::from_z_to(flake.normal.to_array()).map(|v| v as f32),
            log_scale: scales.map(|v| (v.ln() as f32).clamp(-MAX_LOG_SCALE, MAX_LOG_SCALE)),
            logit_opacity: logit(self.opacity) as f32,
            rgb: self.color,
            group: Group::Snow,
        }
    }
}

fn place(at: [f32; 3]) -> DVec3 {
    DVec3::from_array(at.map(f64::from))
}

/// Sorts flakes along a Z curve, and keeps of those in one place the one that looks up most. A
/// search in that order finds most of the tree in the cache.
fn one_flake_per_place(flakes: &[Flake]) -> Vec<Flake> {
    let low = flakes.iter().fold([f32::INFINITY; 3], |low, flake| [0, 1, 2].map(|k| low[k].min(flake.at[k])));
    let high =
        flakes.iter().fold([f32::NEG_INFINITY; 3], |high, flake| [0, 1, 2].map(|k| high[k].max(flake.at[k])));
    let edge = (0..3).map(|k| f64::from(high[k]) - f64::from(low[k])).fold(f64::MIN_POSITIVE, f64::max);
    // 21 bits an axis.
    let cell = |v: f32, low: f32| ((f64::from(v) - f64::from(low)) / edge * 2_097_151.0) as u64;
    let mut order: Vec<(u64, usize)> = flakes
        .iter()
        .map(|flake| [0, 1, 2].map(|k| interleaved_bits(cell(flake.at[k], low[k])) << k).into_iter().sum())
        .zip(0..)
        .collect();
    order.sort_unstable_by(|a, b| {
        let (one, other) = (&flakes[a.1], &flakes[b.1]);
        // By place next, and then by normal, so that the order of the splats does not count.
        let numbers = |flake: &Flake| [flake.at.map(f64::from), (-flake.normal).to_array()];
        let by_number = || {
            let (one, other) = (numbers(one), numbers(other));
            one.as_flattened()
                .iter()
                .zip(other.as_flattened())
                .map(|(a, b)| a.total_cmp(b))
                .find(|o| o.is_ne())
        };
        a.0.cmp(&b.0).then_with(|| by_number().unwrap_or(std::cmp::Ordering::Equal))
    });
    order.dedup_by(|a, b| flakes[a.1].at == flakes[b.1].at);
    order.into_iter().map(|(_, i)| flakes[i]).collect()
}

/// 21 bits with two zeros between any two.
fn interleaved_bits(mut v: u64) -> u64 {
    for (shift, mask) in [
        (32, 0x001f_0000_0000_ffff),
        (16, 0x001f_0000_ff00_00ff),
        (8, 0x100f_00f0_0f00_f00f),
        (4, 0x10c3_0c30_c30c_30c3),
        (2, 0x1249_2492_4924_9249),
    ] {
        v = (v | v << shift) & mask;
    }
    v
}

/// Mean and standard deviation; of none both 0.
fn moments(values: &[f64]) -> [f64; 2] {
    let count = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / count;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / count;
    [mean, variance.sqrt()]
}

/// The median of sorted values; of none 0.
fn median(sorted: &[f64]) -> f64 {
    let middle = |i: usize| sorted.get(i).copied().unwrap_or(0.0);
    0.5 * (middle(sorted.len().saturating_sub(1) / 2) + middle(sorted.len() / 2))
}

/// The plane of least squares through 0 and `around`, as a point on it and its normal, which looks
/// up; `None` where they lie on a line.
fn plane(around: &[DVec3], up: DVec3) -> Option<(DVec3, DVec3)> {
    let count = (around.len() + 1) as f64;
    let middle = around.iter().sum::<DVec3>() / count;
    let mut spreads = [[0.0; 3]; 3];
    for offset in around.iter().chain([&DVec3::ZERO]) {
        let v = (*offset - middle).to_array();
        (0..3).for_each(|i| (0..3).for_each(|j| spreads[i][j] += v[i] * v[j] / count));
    }
    let (values, vectors) = jacobi(spreads);
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
    let [least, between, most] = order;
    let is_plane = values[between] > MAX_LINE_VARIANCE_RATIO * values[most] && values[most].is_finite();
    let normal = DVec3::from_array(vectors[least]).try_normalize()?;
    is_plane.then_some((middle, if normal.dot(up) < 0.0 { -normal } else { normal }))
}

/// Nearest neighbours among flakes.
struct FlakeNeighbours {
    /// About one of them, with up between the axes: the tree halves along each axis in turn, and
    /// every third time would halve a floor into an upper and a lower sheet.
    points: Vec<[f32; 3]>,
    tree: KdTree<f32>,
}

impl FlakeNeighbours {
    fn new(flakes: &[Flake], up: DVec3) -> Self {
        let turn = DQuat::from_rotation_arc(up, DVec3::ONE.normalize());
        // One of them, since the mean may be far from all.
        let middle = flakes.get(flakes.len() / 2).map_or(DVec3::ZERO, |flake| place(flake.at));
        let turned = |flake: &Flake| (turn * (place(flake.at) - middle)).to_array().map(|v| v as f32);
        let points: Vec<[f32; 3]> = flakes.iter().map(turned).collect();
        Self { tree: KdTree::new(&points), points }
    }

    /// The `count` nearest to flake `index`, the nearest first, without itself.
    fn of(&self, index: usize, count: usize) -> impl Iterator<Item = usize> {
        let found = self.tree.nearest(&self.points[index], count + 1);
        found.into_iter().map(|near| near.index as usize).filter(move |near| *near != index).take(count)
    }
}

#[cfg(test)]
mod tests;
