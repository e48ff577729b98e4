//! The ground of a place as a height field, where photos see it at a grazing angle.
//!
//! A few degrees above the ground a training finds its depth badly: it leaves upright pieces that
//! look like far ground from the path, with gaps between. Their heights are still known to some
//! decimetres, since an error of depth moves a point mostly along the ground. So heights are
//! gathered from all views, fitted with a smooth surface that has bushes and posts above it, and
//! pixels that show something close to that surface are put on it.
//!
//! # The fit
//! The surface is a sum of lattices of hat functions, each half as wide as the one before, each a
//! weighted mean of what the coarser ones leave, drawn towards 0 where there are few points. It is
//! fitted in rounds: points that lie off the last surface weigh less, those above it sooner than
//! those below.

use super::floor::FloorPlane;
use crate::threads::map;
use glam::{DMat3, DVec3};

/// Width of the finest lattice, m, and nodes along a side at most.
const MIN_LATTICE_WIDTH_M: f64 = 1.0;
const MAX_SIDE_NODES: usize = 512;
/// Largest distance of ground from the centre of the cameras, m.
pub(super) const MAX_GROUND_DISTANCE_M: f64 = 400.0;
/// Points that weigh as much as the coarser lattice does.
const PRIOR_WEIGHT: f32 = 4.0;
/// Distances above and below the last surface at which points count no more, m, in each round.
const ROUND_DISTANCES_M: [[f32; 2]; 5] =
    [[f32::INFINITY; 2], [6.0, 18.0], [2.5, 7.0], [1.0, 2.0], [0.5, 0.7]];
/// Height of cameras that a person carries, m, and the share by which most differ in it at most.
const CARRIED_CAMERA_HEIGHTS_M: std::ops::Range<f64> = 0.8..3.0;
const MAX_HEIGHT_SPREAD: f64 = 0.4;
/// Weight from which a node of a lattice is supported by points.
const MIN_SUPPORT_WEIGHT: f32 = 4.0;
/// Doubt of a height beside its spread: m, and for each metre of the lattice that supports it.
const HEIGHT_DOUBT_TERMS: [f32; 2] = [0.05, 0.03];
/// Largest doubt of a height that is used: m, and as a share of the camera's height if that is
/// more.
const MOST_DOUBT: [f64; 2] = [1.2, 0.1];
/// Largest sine of the angle between a ray and the ground that counts as grazing, and the doubt, m,
/// from which pixels are put on the ground at any angle.
const MAX_GRAZING_SINE: f64 = 0.25;
const MAX_DOUBT_M: f64 = 0.4;
/// Distance from the surface, m, within which pixels of a walk or drive are put on it at any angle:
/// errors of depth leave lumps as high as that on the ground.
const PATH_SURFACE_DISTANCE_M: f64 = 0.5;
/// Half of the slab about the surface that belongs to it: in doubts, at least and at most, m, and
/// the most as a share of the camera's height if that is more.
const SLAB_LIMITS: [f64; 4] = [2.0, 0.2, 0.6, 0.12];
/// Steepest ground, as a tangent, that a ray may skip; and most steps of a ray.
const MAX_SKIPPED_SLOPE: f64 = 0.5;
const MAX_STEP_COUNT: usize = 60;

/// Heights of the ground with their doubt.
#[derive(Clone, Debug)]
pub struct GroundField {
    /// World to level axes, and m for each scene unit.
    level: DMat3,
    metres_per_unit: f64,
    /// The corner of the lattice along the level axes, and its spacing, m.
    corner: [f64; 2],
    spacing: f64,
    /// Nodes along a side.
    side: usize,
    /// m along up, and their doubt, m; row by row.
    height: Vec<f32>,
    doubt: Vec<f32>,
    /// True if people carried the cameras over it, or a car did.
    pub(super) is_path: bool,
}

/// A camera above the ground.
#[derive(Clone, Copy)]
pub(crate) struct Eye {
    /// Position, level axes, m.
    at: DVec3,
    /// Height above the ground, m.
    height: f64,
}

/// A lattice of hat functions over the square of the field.
struct Lattice {
    /// Nodes along a side.
    side: usize,
    /// Spacing of the finest lattice over its own.
    scale: f32,
    /// The value of each node, the weight that it was found with, and the mean square of what is
    /// left, m^2.
    value: Vec<f32>,
    weight: Vec<f32>,
    spread: Vec<f32>,
}

/// The four nodes about a place and their shares.
fn nodes_about(side: usize, point: [f32; 2]) -> [(usize, f32); 4] {
    let [x, y] = point;
    let cell = |v: f32| (v.max(0.0) as usize).min(side - 2);
    let (column, row) = (cell(x), cell(y));
    let [u, v] = [(x - column as f32).clamp(0.0, 1.0), (y - row as f32).clamp(0.0, 1.0)];
    let first = row * side + column;
    [
        (first, (1.0 - u) * (1.0 - v)),
        (first + 1, u * (1.0 - v)),
        (first + side, (1.0 - u) * v),
        (first + side + 1, u * v),
    ]
}

impl Lattice {
    /// A lattice over the square of the finest, of `finest` nodes a side, with a spacing `scale`
    /// times as wide.
    fn new(finest: usize, scale: usize) -> Self {
        let side = (finest - 1).div_ceil(scale) + 1;
        let side = side.max(2);
        let zeros = || vec![0.0; side * side];
        Self { side, scale: 1.0 / scale as f32, value: zeros(), weight: zeros(), spread: zeros() }
    }

    fn nodes_about(&self, point: [f32; 2]) -> [(usize, f32); 4] {
        let [x, y] = point;
        nodes_about(self.side, [x * self.scale, y * self.scale])
    }

    fn at(&self, place: [f32; 2]) -> f32 {
        self.nodes_about(place).iter().map(|(node, share)| share * self.value[*node]).sum()
    }

    /// Fits what is left of the points, with their weights, and takes its part from them.
    fn fit(&mut self, places: &[[f32; 2]], left: &mut [f32], weights: &[f32]) {
        for ((place, left), weight) in places.iter().zip(left.iter()).zip(weights) {
            for (node, share) in self.nodes_about(*place) {
                self.weight[node] += weight * share * share;
                self.value[node] += weight * share * share * left;
            }
        }
        for (value, weight) in self.value.iter_mut().zip(&self.weight) {
            *value /= weight + PRIOR_WEIGHT;
        }
        for ((place, left), weight) in places.iter().zip(left).zip(weights) {
            *left -= self.at(*place);
            for (node, share) in self.nodes_about(*place) {
                self.spread[node] += weight * share * share * *left * *left;
            }
        }
    }
}

impl GroundField {
    /// The height at which cameras (level axes, m) were carried by a person, m; `None` if they were
    /// not.
    pub(super) fn carried_at(&self, cameras: &[DVec3]) -> Option<f64> {
        let known = |camera: &&DVec3| {
            self.place(**camera).is_some_and(|place| self.mean(&self.doubt, place) < MAX_DOUBT_M)
        };
        let mut heights: Vec<f64> =
            cameras.iter().filter(known).filter_map(|camera| self.above(*camera)).collect();
        heights.sort_by(f64::total_cmp);
        let [low, middle, high] = [1, 4, 7].map(|eighth| heights.get(heights.len() * eighth / 8).copied());
        let middle = middle.filter(|height| CARRIED_CAMERA_HEIGHTS_M.contains(height))?;
        (high? - low? < MAX_HEIGHT_SPREAD * middle).then_some(middle)
    }

    /// Fits points (level axes from `middle`, m) with their weights.
    pub(super) fn fit(level: DMat3, metres_per_unit: f64, middle: DVec3, points: &[([f32; 3], f32)]) -> Self {
        let reach = reach(points);
        let side = ((2.0 * reach / MIN_LATTICE_WIDTH_M) as usize + 2).min(MAX_SIDE_NODES);
        let spacing = 2.0 * reach / (side - 1) as f64;
        let place = |point: &[f32; 3]| [0, 1].map(|k| ((f64::from(point[k]) + reach) / spacing) as f32);
        let places: Vec<[f32; 2]> = points.iter().map(|(point, _)| place(point)).collect();
        let mut lattices: Vec<Lattice> = Vec::new();
        let mut left: Vec<f32> = vec![0.0; points.len()];
        for [over, under] in ROUND_DISTANCES_M {
            let kept = |off: f32| {
                let off = if off > 0.0 { off / over } else { -off / under };
                (1.0 - off * off).max(0.0).powi(2)
            };
            let weights: Vec<f32> =
                points.iter().zip(&left).map(|((_, weight), off)| weight * kept(*off)).collect();
            left = points.iter().map(|(point, _)| point[2]).collect();
            lattices.clear();
            let mut scale = (side - 1).next_power_of_two();
            while scale > 0 {
                let mut lattice = Lattice::new(side, scale);
                lattice.fit(&places, &mut left, &weights);
                lattices.push(lattice);
                scale /= 2;
            }
        }
        let node = |index: usize| {
            let place = [(index % side) as f32, (index / side) as f32];
            let height: f32 = lattices.iter().map(|lattice| lattice.at(place)).sum();
            // The finest that points support, and what they leave there.
            let support = lattices.iter().rev().find_map(|lattice| {
                let mean = |values: &[f32]| -> f32 {
                    lattice.nodes_about(place).iter().map(|(node, share)| share * values[*node]).sum()
                };
                let weight = mean(&lattice.weight);
                let spread = || (mean(&lattice.spread) / weight).sqrt();
                (weight >= MIN_SUPPORT_WEIGHT).then(|| (spacing as f32 / lattice.scale, spread()))
            });
            let doubt = support.map_or(f32::INFINITY, |(width, spread)| {
                HEIGHT_DOUBT_TERMS[0] + HEIGHT_DOUBT_TERMS[1] * width + spread
            });
            (height + middle.z as f32, doubt)
        };
        let (height, doubt) = map(side * side, node).into_iter().unzip();
        let corner = [middle.x - reach, middle.y - reach];
        Self { level, metres_per_unit, corner, spacing, side, height, doubt, is_path: false }
    }

    /// Column and row of a point (level axes, m) on the lattice; `None` beyond it.
    fn place(&self, point: DVec3) -> Option<[f32; 2]> {
        let [x, y] = [point.x - self.corner[0], point.y - self.corner[1]].map(|v| v / self.spacing);
        let last = (self.side - 1) as f64;
        ((0.0..=last).contains(&x) && (0.0..=last).contains(&y)).then_some([x as f32, y as f32])
    }

    fn mean(&self, values: &[f32], place: [f32; 2]) -> f64 {
        f64::from(
            nodes_about(self.side, place).iter().map(|(node, share)| share * values[*node]).sum::<f32>(),
        )
    }

    /// Height of a point (level axes, m) above the ground, m.
    fn above(&self, point: DVec3) -> Option<f64> {
        Some(point.z - self.mean(&self.height, self.place(point)?))
    }

    /// Follows a ray of length 1 (level axes) from a point (m) to the ground: the distance, m.
    fn meet(&self, from: DVec3, ray: DVec3) -> Option<f64> {
        let mut way = 0.0;
        for _ in 0..MAX_STEP_COUNT {
            let above = self.above(from + way * ray)?;
            if above < 0.005 {
                return (above > -0.5).then_some(way);
            }
            let closes = (MAX_SKIPPED_SLOPE * ray.truncate().length() - ray.z).max(1e-3);
            way += above / closes;
        }
        None
    }

    /// The normal of the ground at a point (level axes, m), world axes.
    fn normal(&self, point: DVec3) -> Option<DVec3> {
        let step = self.spacing;
        let rise = |x: f64, y: f64| {
            let at = |sign: f64| self.above(point + sign * DVec3::new(x, y, 0.0));
            Some((at(-1.0)? - at(1.0)?) / (2.0 * step))
        };
        let normal = DVec3::new(-rise(step, 0.0)?, -rise(0.0, step)?, 1.0).normalize();
        Some(self.level.transpose() * normal)
    }

    /// The plane of the ground about a point of it (world, scene units).
    pub(super) fn plane(&self, point: DVec3) -> Option<FloorPlane> {
        let normal = self.normal(self.level * point * self.metres_per_unit)?;
        Some(FloorPlane { point, normal, reach: f64::INFINITY, slab: 0.0 })
    }

    /// A camera at a point (world, scene units); `None` if the ground below it is not known.
    pub(super) fn eye(&self, center: DVec3) -> Option<Eye> {
        let at = self.level * center * self.metres_per_unit;
        Some(Eye { at, height: self.above(at)? })
    }

    /// Puts a pixel on the ground that shows a point at `depth` along a ray of length 1 (world;
    /// scene units, 0 for nothing): the distance to it. `None` for a pixel that shows something
    /// else or is known well.
    pub(super) fn snapped(&self, eye: Eye, ray: DVec3, depth: f64) -> Option<f64> {
        let Eye { at: eye, height } = eye;
        let ray = self.level * ray;
        if ray.z > MAX_SKIPPED_SLOPE * ray.truncate().length() {
            return None;
        }
        let widest = SLAB_LIMITS[2].max(SLAB_LIMITS[3] * height);
        let shown = eye + depth * self.metres_per_unit * ray;
        let above = if depth > 0.0 { self.above(shown)? } else { f64::NEG_INFINITY };
        if above > widest {
            return None;
        }
        let way = self.meet(eye, ray)?;
        let met = eye + way * ray;
        let doubt = self.mean(&self.doubt, self.place(met)?);
        let slab = (SLAB_LIMITS[0] * doubt).clamp(SLAB_LIMITS[1], widest);
        let normal = self.normal(met)?;
        let is_low = self.is_path && above.abs() < PATH_SURFACE_DISTANCE_M;
        let is_rough = doubt > MAX_DOUBT_M || -(self.level * normal).dot(ray) < MAX_GRAZING_SINE;
        let is_known = doubt < MOST_DOUBT[0].max(MOST_DOUBT[1] * height);
        let is_shown = is_known && (is_low || is_rough && above < slab);
        is_shown.then_some(way / self.metres_per_unit)
    }
}

/// Half of the side of the square about the origin that holds the points, m.
fn reach(points: &[([f32; 3], f32)]) -> f64 {
    let far = points.iter().map(|([x, y, _], _)| x.abs().max(y.abs())).fold(0.0, f32::max);
    f64::from(far).clamp(5.0, MAX_GROUND_DISTANCE_M)
}
