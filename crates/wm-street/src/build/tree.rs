//! Trees: a trunk, branches that reach for clusters of leaves spread through a crown, leaves.
//!
//! The crown is planned first: cluster centres are spread evenly through its envelope, mostly near
//! its skin. Each, from the trunk outwards, is joined to the nearest wood that is not above it by a
//! bent branch, so boughs fork as they reach out. Thickness follows from what a branch carries.

use super::builder::Builder;
use crate::hash::{Dice, noise3};
use crate::paint::PaintId;
use crate::shape::{Outline, Shape};
use glam::DVec3;

/// The kind of tree.
#[derive(Clone, Copy, Debug)]
pub(super) struct Kind {
    pub(crate) height: f64,
    /// The height of the crown's lower end above the foot, m.
    pub(crate) base: f64,
    /// Largest radius of the crown, m.
    pub(crate) radius: f64,
    /// The share of the crown's height at which it is widest, 0-1.
    pub(crate) widest: f64,
    /// Radius of the trunk at breast height, m.
    pub(crate) trunk: f64,
    pub(crate) clusters: u32,
    /// Leaves of a cluster.
    pub(crate) leaves: u32,
    /// Length of a leaf, m.
    pub(crate) leaf: f64,
    /// The droop of twigs and leaves, 0-1.
    pub(crate) droop: f64,
    pub(crate) bark: PaintId,
    pub(crate) foliage: PaintId,
    /// Berries or blossoms, if any.
    pub(crate) fruit: Option<PaintId>,
}

struct Joint {
    at: DVec3,
    parent: usize,
    /// Radius to the power of [`BRANCH_EXPONENT`], summed from the tips.
    load: f64,
    trunk: bool,
}

/// Branch radii add up by this power.
const BRANCH_EXPONENT: f64 = 2.3;
/// Radius of a twig, m.
const TWIG_RADIUS_M: f64 = 0.006;

/// Grows a tree of `kind` on `foot`.
pub(super) fn tree(b: &mut Builder, foot: DVec3, kind: &Kind, seed: u64) {
    let mut dice = Dice::new(b.seed, seed);
    let shape = dice.range(0.0, 100.0);
    let centers = crown(kind, foot, &mut dice, shape);
    let mut joints = trunk(kind, foot, &mut dice);
    let mut order: Vec<usize> = (0..centers.len()).collect();
    let reach = |c: DVec3| (c - foot).truncate().length() + 0.25 * (c.z - foot.z);
    order.sort_by(|i, j| reach(centers[*i]).total_cmp(&reach(centers[*j])));
    for index in order {
        bough(&mut joints, centers[index], kind, &mut dice);
    }
    for index in (1..joints.len()).rev() {
        joints[index].load = joints[index].load.max(TWIG_RADIUS_M.powf(BRANCH_EXPONENT));
        let (load, parent) = (joints[index].load, joints[index].parent);
        joints[parent].load += load;
    }
    wood(b, &joints, kind, foot);
    for center in centers {
        cluster(b, center, foot, kind, &mut dice);
    }
}

/// Cluster centres: of several candidates each time the one farthest from those there are.
fn crown(kind: &Kind, foot: DVec3, dice: &mut Dice, shape: f64) -> Vec<DVec3> {
    let depth = kind.height - kind.base;
    let mut centers: Vec<DVec3> = Vec::new();
    while centers.len() < kind.clusters as usize {
        let (mut best, mut widest) = (DVec3::ZERO, -1.0);
        for _ in 0..7 {
            let h = dice.unit();
            // An egg: two half sines that meet where it is widest.
            let side = if h < kind.widest { h / kind.widest } else { (1.0 - h) / (1.0 - kind.widest) };
            let (sin, cos) = dice.range(0.0, std::f64::consts::TAU).sin_cos();
            let lumps = 1.0 + 0.32 * noise3(DVec3::new(cos * 1.3, sin * 1.3, h * 3.0 + shape), 5);
            let skin = kind.radius * (side * std::f64::consts::FRAC_PI_2).sin().powf(0.62) * lumps;
            let r = skin * dice.range(0.10, 1.0).sqrt();
            let point = foot + DVec3::new(r * cos, r * sin, kind.base + depth * (0.04 + 0.94 * h));
            let gap = centers.iter().map(|c| c.distance_squared(point)).fold(f64::INFINITY, f64::min);
            if gap > widest {
                (best, widest) = (point, gap);
            }
        }
        centers.push(best);
    }
    centers
}

fn trunk(kind: &Kind, foot: DVec3, dice: &mut Dice) -> Vec<Joint> {
    let top = kind.base + 0.80 * (kind.height - kind.base);
    let steps = (top / 0.5).ceil().max(2.0);
    let mut joints = vec![Joint { at: foot, parent: 0, load: 0.0, trunk: true }];
    let mut lean = DVec3::new(dice.bell(), dice.bell(), 0.0) * 0.025;
    for step in 1..=steps as usize {
        lean += DVec3::new(dice.bell(), dice.bell(), 0.0) * 0.022;
        lean *= 0.92;
        let at = joints[step - 1].at + (DVec3::Z + lean * 2.0) * (top / steps);
        joints.push(Joint { at, parent: step - 1, load: 0.0, trunk: true });
    }
    joints
}

/// Joins `center` to the best wood by a branch that leaves it steeply and bends outwards.
fn bough(joints: &mut Vec<Joint>, center: DVec3, kind: &Kind, dice: &mut Dice) {
    let cost = |joint: &Joint| {
        let away = center - joint.at;
        let below = away.truncate().length() * (0.55 - 0.5 * kind.droop) - away.z;
        away.length() + 1.1 * below.max(0.0) + if joint.trunk { 0.15 } else { 0.0 }
    };
    let first = usize::from(joints.len() > 3) * 2;
    let root =
        (first..joints.len()).min_by(|i, j| cost(&joints[*i]).total_cmp(&cost(&joints[*j]))).unwrap_or(0);
    let from = joints[root].at;
    let length = from.distance(center);
    let steps = (length / 0.42).ceil().max(1.0);
    let bend = from.lerp(center, 0.5)
        + DVec3::Z * (0.10 + 0.12 * kind.droop) * length
        + DVec3::new(dice.bell(), dice.bell(), dice.bell()) * (0.06 * length);
    let mut parent = root;
    for step in 1..=steps as usize {
        let t = step as f64 / steps;
        let at = from.lerp(bend, t).lerp(bend.lerp(center, t), t);
        joints.push(Joint { at, parent, load: 0.0, trunk: false });
        parent = joints.len() - 1;
    }
}

fn wood(b: &mut Builder, joints: &[Joint], kind: &Kind, foot: DVec3) {
    // The trunk's own thickness sets the scale.
    let scale = kind.trunk / joints[1].load.powf(1.0 / BRANCH_EXPONENT);
    let radius = |joint: &Joint| {
        let pipe = joint.load.powf(1.0 / BRANCH_EXPONENT) * scale.min(1.8);
        let height = joint.at.z - foot.z;
        if joint.trunk {
            let taper = kind.trunk * (1.0 - 0.75 * height / kind.height);
            // The foot spreads into the ground.
            taper.max(pipe.min(taper)) * (1.0 + 0.55 * (-height / 0.22).exp())
        } else {
            pipe.min(0.55 * kind.trunk)
        }
    };
    for joint in &joints[1..] {
        let parent = &joints[joint.parent];
        let end = radius(joint).max(TWIG_RADIUS_M);
        let start =
            if parent.trunk && !joint.trunk { end * 1.15 } else { radius(parent).min(end * 1.6).max(end) };
        b.stump(parent.at, joint.at, [start, end], kind.bark);
    }
}

/// Twigs that part from a cluster's centre, with leaves along them.
fn cluster(b: &mut Builder, center: DVec3, foot: DVec3, kind: &Kind, dice: &mut Dice) {
    let middle = foot + DVec3::Z * (kind.base + 0.45 * (kind.height - kind.base));
    let outward = (center - middle).normalize_or(DVec3::Z);
    let size = 3.4 * kind.leaf.max(0.10) + 0.06 * kind.radius;
    let twigs = 5;
    let ends: Vec<DVec3> = (0..twigs)
        .map(|_| {
            let way = outward * 0.55 + dice.direction() * 0.9 + DVec3::Z * (0.25 - 1.3 * kind.droop);
            center + way.normalize_or(DVec3::Z) * size * dice.range(0.7, 1.25)
        })
        .collect();
    for end in &ends {
        b.stump(center, *end, [TWIG_RADIUS_M, 0.5 * TWIG_RADIUS_M], kind.bark);
    }
    for leaf in 0..kind.leaves {
        let end = ends[leaf as usize % twigs];
        let t = dice.range(0.25, 1.08);
        let scatter = DVec3::new(dice.bell(), dice.bell(), dice.bell()) * (0.24 * size);
        let at = center.lerp(end, t) + scatter;
        let way = (outward * 0.5 + (end - center) / size * 0.5 + dice.direction() * 0.8
            - DVec3::Z * (0.25 + 0.6 * kind.droop))
            .normalize_or(outward);
        card(b, at, way, kind.leaf * dice.range(0.75, 1.2), 0.62, kind.foliage, dice);
    }
    if let Some(fruit) = kind.fruit {
        for _ in 0..3 {
            let at = center + dice.direction() * size;
            for _ in 0..5 {
                let berry = at + dice.direction() * 0.05;
                b.ball(berry, DVec3::splat(0.022), fruit);
            }
        }
    }
}

/// A leaf that starts at `at` and points along `way`, its face mostly to the sky.
pub(super) fn card(
    b: &mut Builder,
    at: DVec3,
    way: DVec3,
    length: f64,
    breadth: f64,
    paint: PaintId,
    dice: &mut Dice,
) {
    let face = (DVec3::Z * 0.8 + dice.direction()).normalize_or(DVec3::Z);
    let side = face.cross(way).try_normalize().unwrap_or_else(|| way.any_orthonormal_vector());
    let (u, v) = (way * length, side * (length * breadth));
    b.add(Shape::Flat { corner: at - v * 0.5, u, v, outline: Outline::Leaf }, paint);
}
