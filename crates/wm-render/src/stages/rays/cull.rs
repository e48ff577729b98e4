//! Finds the packets that splats touch: cones of directions against the caps in which spheres about
//! the splats are seen.

use super::packets::{CHILDREN, Cones, RayGroup};
use super::records::{CONE_TOLERANCE_SHARE, RayRecord, SPLATS_PER_CLUSTER, Sphere};
use crate::simd::Lanes;
use fearless_simd::{SimdBase, SimdMask, f32x8};
use glam::Vec3;

/// Most levels of a tree of eight children per node: enough for any number of packets.
const MAX_TREE_LEVELS: usize = 12;

/// Finds the packets of a group that each record touches. Both slices are cut from the same place.
#[inline(always)]
pub(super) fn cull<S: Lanes>(
    simd: S,
    records: &[RayRecord],
    clusters: &[Sphere],
    first: usize,
    group: &RayGroup,
    found: &mut Vec<(u32, u64)>,
) {
    let center = Vec3::from_array(group.center);
    // The records of a cluster begin at the nodes that all of it may touch, two levels above the
    // packets.
    let floor = usize::from(group.levels.len() > 1);
    let mut shared = Vec::new();
    for (at, record) in records.iter().enumerate() {
        if at % SPLATS_PER_CLUSTER == 0 {
            let cluster = &clusters[at / SPLATS_PER_CLUSTER];
            nodes_at(simd, group, floor, cluster.center - center, cluster.radius + group.radius, &mut shared);
        }
        if shared.is_empty() {
            continue;
        }
        let way = Vec3::from_array(record.mean) - center;
        let reach = record.reach + group.radius;
        let key = (u64::from(way.length().to_bits()) << 32) | (first + at) as u64;
        let Some(cap) = Cap::of(way, reach) else {
            // The centre of the group lies in the splat: rays may meet it in any direction.
            found.extend((0..group.packets.len() as u32).map(|packet| (packet, key)));
            continue;
        };
        for node in &shared {
            if floor == 0 {
                push_packets(simd, &cap, group, *node, key, found);
                continue;
            }
            let mut touched = cap.touches(simd, &group.levels[1][*node as usize]);
            while touched != 0 {
                let node = *node * CHILDREN as u32 + touched.trailing_zeros();
                touched &= touched - 1;
                push_packets(simd, &cap, group, node, key, found);
            }
        }
    }
}

/// Appends the packets of one of the lowest nodes that a cap touches.
#[inline(always)]
fn push_packets<S: Lanes>(
    simd: S,
    cap: &Cap,
    group: &RayGroup,
    node: u32,
    key: u64,
    found: &mut Vec<(u32, u64)>,
) {
    let mut touched = cap.touches(simd, &group.levels[0][node as usize]);
    while touched != 0 {
        found.push((node * CHILDREN as u32 + touched.trailing_zeros(), key));
        touched &= touched - 1;
    }
}

/// Lists the nodes of a level of a group's tree that a sphere, given by its middle and its radius,
/// may touch.
#[inline(always)]
fn nodes_at<S: Lanes>(simd: S, group: &RayGroup, floor: usize, way: Vec3, reach: f32, nodes: &mut Vec<u32>) {
    nodes.clear();
    let Some(cap) = Cap::of(way, reach) else {
        nodes.extend(0..group.levels[floor].len() as u32);
        return;
    };
    let top = group.levels.len() - 1;
    let mut stack = [(0usize, 0u32); MAX_TREE_LEVELS * CHILDREN];
    stack[0] = (top, 0);
    let mut depth = 1;
    while depth > 0 {
        depth -= 1;
        let (level, node) = stack[depth];
        if level == floor {
            nodes.push(node);
            continue;
        }
        let mut touched = cap.touches(simd, &group.levels[level][node as usize]);
        while touched != 0 {
            stack[depth] = (level - 1, node * CHILDREN as u32 + touched.trailing_zeros());
            touched &= touched - 1;
            depth += 1;
        }
    }
}

/// The directions in which a sphere is seen from the middle of a group.
struct Cap {
    /// To the middle of the sphere.
    way: Vec3,
    /// Length of a tangent to it.
    tangent: f32,
    reach: f32,
    slack: f32,
}

impl Cap {
    /// `None` where the sphere holds the middle of the group.
    #[inline(always)]
    fn of(way: Vec3, reach: f32) -> Option<Self> {
        let distance = way.length();
        let tangent = ((distance + reach) * (distance - reach)).sqrt();
        (distance > reach).then_some(Self { way, tangent, reach, slack: CONE_TOLERANCE_SHARE * distance })
    }

    /// The children of a node whose cones it touches: a bit each.
    #[inline(always)]
    fn touches<S: Lanes>(&self, simd: S, cones: &Cones) -> u32 {
        let [x, y, z] = &cones.axis;
        let dot = f32x8::from_slice(simd, x) * self.way.x
            + f32x8::from_slice(simd, y) * self.way.y
            + f32x8::from_slice(simd, z) * self.way.z
            + self.slack;
        let least = f32x8::from_slice(simd, &cones.cos) * self.tangent
            - f32x8::from_slice(simd, &cones.sin) * self.reach;
        dot.simd_ge(least).to_bitmask() as u32
    }
}
