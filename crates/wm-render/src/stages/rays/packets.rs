//! Packets of rays that go about the same way, and a tree of cones about them.

use super::Rays;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::ops::Range;

/// Rays of a packet.
pub(crate) const PACKET: usize = 64;
/// Children of a node of the tree.
pub(crate) const CHILDREN: usize = 8;
/// Ratio of the extent of all origins to the largest extent of the origins of one group.
const ORIGIN_PARTS: f32 = 16.0;
/// Bits of each coordinate of a direction in its index along the curve.
const CURVE_BITS: u32 = 12;
/// Half angle of a packet's cone, relative to the median of all, above which it is split.
const MAX_RELATIVE_ANGLE: f64 = 2.0;
/// Angle that is added to cones, since directions are rounded.
const ROUNDING_ANGLE_RAD: f64 = 1e-5;

/// Rays from about one place, in packets: consecutive rays of a group go about the same way.
#[derive(Clone, Debug)]
pub(crate) struct RayGroup {
    /// The middle of the origins.
    pub(crate) center: [f32; 3],
    /// The greatest distance of an origin from it.
    pub(crate) radius: f32,
    /// The packets of the group, as numbers for [`Packets::rays`].
    pub(crate) packets: Range<usize>,
    /// The levels of the tree, the packets' own cones first, the root last.
    pub(crate) levels: Vec<Vec<Cones>>,
}

/// Cones of up to eight children of a node.
#[derive(Clone, Debug)]
#[repr(C, align(32))]
pub(crate) struct Cones {
    /// Axes.
    pub(crate) axis: [[f32; CHILDREN]; 3],
    /// Cosine and sine of the half angles; a cosine far below 0 for cones of a half space and more,
    /// above 1 where there is no child.
    pub(crate) cos: [f32; CHILDREN],
    /// See `cos`.
    pub(crate) sin: [f32; CHILDREN],
}

/// Rays in the order of their packets.
#[derive(Clone, Debug, Default)]
pub(crate) struct Packets {
    /// The rays, packet by packet.
    pub(crate) order: Vec<u32>,
    /// First ray of each packet in `order`, and the end.
    pub(crate) starts: Vec<u32>,
    /// The groups, which cut the packets.
    pub(crate) groups: Vec<RayGroup>,
}

impl Packets {
    /// Groups rays by their origins, and then by their directions. A function of the rays alone.
    pub(crate) fn new(rays: &Rays) -> Self {
        Self::no_wider(rays, f64::INFINITY)
    }

    /// Makes the groups with smaller packets where rays would be more than `widest` radians away
    /// from the axis of their packet.
    pub(crate) fn no_wider(rays: &Rays, widest: f64) -> Self {
        let mut packets = Self { starts: vec![0], ..Self::default() };
        if rays.is_empty() {
            return packets;
        }
        let (low, high) = bounds(&rays.origins, 0..rays.len() as u32);
        let most = (high - low).max_element() / ORIGIN_PARTS;
        let mut parts = vec![(0..rays.len() as u32).collect::<Vec<u32>>()];
        while let Some(part) = parts.pop() {
            let (low, high) = bounds(&rays.origins, part.iter().copied());
            let extent = high - low;
            if extent.max_element() > most.max(f32::MIN_POSITIVE) {
                let axis =
                    (0..3).max_by(|a, b| extent[*a].total_cmp(&extent[*b]).then(b.cmp(a))).unwrap_or(0);
                let middle = 0.5 * (low[axis] + high[axis]);
                let (near, far): (Vec<u32>, Vec<u32>) =
                    part.iter().partition(|ray| rays.origins[**ray as usize][axis] <= middle);
                // Neighbours in single precision have no middle between them.
                if !near.is_empty() && !far.is_empty() {
                    parts.extend([far, near]);
                    continue;
                }
            }
            packets.add(rays, &part, low, high, widest);
        }
        packets
    }

    fn add(&mut self, rays: &Rays, part: &[u32], low: Vec3, high: Vec3, widest: f64) {
        let center = 0.5 * (low + high);
        let radius = 0.5 * (high - low).length();
        let direction = |ray: u32| Vec3::from_array(rays.directions[ray as usize]);
        let place = |ray: &u32| u64::from(along_curve(direction(*ray))) << 32 | u64::from(*ray);
        let mut places: Vec<u64> = part.par_iter().map(place).collect();
        places.par_sort_unstable();
        let own: Vec<u32> = places.into_iter().map(|place| place as u32).collect();
        let directions: Vec<Vec3> = own.iter().map(|ray| direction(*ray)).collect();
        let first = self.starts.len() - 1;
        let mut cones = Vec::new();
        for (packet, cone) in cut(&directions, widest) {
            cones.push(cone);
            self.order.extend(&own[packet]);
            self.starts.push(self.order.len() as u32);
        }
        let packets = first..self.starts.len() - 1;
        let mut levels = Vec::new();
        loop {
            levels.push(cones.chunks(CHILDREN).map(Cones::of).collect::<Vec<_>>());
            if cones.len() <= CHILDREN {
                break;
            }
            let parent = |children: &[Cone]| Cone::around(children.iter().map(|cone| (cone.axis, cone.half)));
            cones = cones.chunks(CHILDREN).map(parent).collect();
        }
        self.groups.push(RayGroup { center: center.to_array(), radius, packets, levels });
    }

    /// The rays of a packet.
    pub(crate) fn rays(&self, packet: usize) -> &[u32] {
        &self.order[self.starts[packet] as usize..self.starts[packet + 1] as usize]
    }
}

/// Cuts directions along the curve into packets with their cones. Where the curve leaves the
/// pattern and comes back elsewhere, two parts of it would share one wide cone, which all splats
/// between them touch: a packet ends there, and where its half angle would be above `widest`,
/// radians.
fn cut(directions: &[Vec3], widest: f64) -> Vec<(Range<usize>, Cone)> {
    let about = |range: &Range<usize>| Cone::about(directions[range.clone()].iter().copied());
    let chunk = |packet: usize| packet * PACKET..directions.len().min((packet + 1) * PACKET);
    let count = directions.len().div_ceil(PACKET);
    let packets: Vec<(Range<usize>, Cone)> =
        (0..count).into_par_iter().map(chunk).map(|range| (range.clone(), about(&range))).collect();
    let mut halves: Vec<f64> = packets.iter().map(|(_, cone)| cone.half).collect();
    let middle = halves.len() / 2;
    let widest = widest.min(MAX_RELATIVE_ANGLE * *halves.select_nth_unstable_by(middle, f64::total_cmp).1);
    let mut narrow = Vec::with_capacity(packets.len());
    for packet in packets {
        let mut parts = vec![packet];
        while let Some((range, cone)) = parts.pop() {
            let gap = |at: &usize| directions[*at].dot(directions[at - 1]);
            let farthest = || (range.start + 1..range.end).min_by(|a, b| gap(a).total_cmp(&gap(b)));
            match (cone.half > widest).then(farthest).flatten() {
                Some(at) => {
                    let [near, far] = [range.start..at, at..range.end];
                    parts.extend([far, near].map(|range| (range.clone(), about(&range))));
                }
                None => narrow.push((range, cone)),
            }
        }
    }
    narrow
}

/// A cone of directions.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cone {
    pub(crate) axis: DVec3,
    /// Half its angle, radians.
    half: f64,
}

impl Cone {
    /// A cone about directions.
    pub(crate) fn about(directions: impl Iterator<Item = Vec3> + Clone) -> Self {
        let directions = directions.map(Vec3::as_dvec3);
        let axis = directions.clone().sum::<DVec3>().normalize_or(DVec3::Z);
        let least = directions.map(|direction| axis.dot(direction)).fold(1.0, f64::min);
        Self { axis, half: least.max(-1.0).acos() + ROUNDING_ANGLE_RAD }
    }

    /// The cosine and sine of half its angle; a cosine far below 0 for a half space and more.
    pub(crate) fn cos_sin(&self) -> (f32, f32) {
        let is_narrow = self.half < std::f64::consts::FRAC_PI_2;
        let (sin, cos) = if is_narrow { self.half.sin_cos() } else { (1.0, -1e9) };
        (cos as f32, sin as f32)
    }

    /// A cone about others, each an axis and half an angle.
    fn around(others: impl Iterator<Item = (DVec3, f64)> + Clone) -> Self {
        let sum: DVec3 = others.clone().map(|(axis, _)| axis).sum();
        let axis = sum.normalize_or(DVec3::Z);
        let reaches = others.map(|(other, half)| axis.dot(other).clamp(-1.0, 1.0).acos() + half);
        Self { axis, half: reaches.fold(0.0, f64::max) + ROUNDING_ANGLE_RAD }
    }
}

impl Cones {
    fn of(cones: &[Cone]) -> Self {
        let mut packed =
            Self { axis: [[0.0; CHILDREN]; 3], cos: [f32::INFINITY; CHILDREN], sin: [0.0; CHILDREN] };
        for (child, cone) in cones.iter().enumerate() {
            for k in 0..3 {
                packed.axis[k][child] = cone.axis[k] as f32;
            }
            (packed.cos[child], packed.sin[child]) = cone.cos_sin();
        }
        packed
    }
}

fn bounds(points: &[[f32; 3]], chosen: impl Iterator<Item = u32>) -> (Vec3, Vec3) {
    let start = (Vec3::splat(f32::INFINITY), Vec3::splat(f32::NEG_INFINITY));
    chosen.fold(start, |(low, high), index| {
        let point = Vec3::from_array(points[index as usize]);
        (low.min(point), high.max(point))
    })
}

/// The place of a direction on a Hilbert curve over the octahedron's map.
fn along_curve(direction: Vec3) -> u32 {
    let sum = direction.abs().element_sum().max(f32::MIN_POSITIVE);
    let [x, y] = [direction.x / sum, direction.y / sum];
    let fold = |own: f32, other: f32| (1.0 - other.abs()).copysign(own);
    let [x, y] = if direction.z < 0.0 { [fold(x, y), fold(y, x)] } else { [x, y] };
    let last = ((1u32 << CURVE_BITS) - 1) as f32;
    let cell = |v: f32| ((0.5 * v + 0.5) * last).clamp(0.0, last) as u32;
    let (mut x, mut y, mut place) = (cell(x), cell(y), 0);
    let mut side = 1u32 << (CURVE_BITS - 1);
    while side > 0 {
        let (right, up) = (u32::from(x & side > 0), u32::from(y & side > 0));
        place += side * side * ((3 * right) ^ up);
        if up == 0 {
            if right == 1 {
                let most = (1u32 << CURVE_BITS) - 1;
                (x, y) = (most - x, most - y);
            }
            std::mem::swap(&mut x, &mut y);
        }
        side >>= 1;
    }
    place
}
