//! A leaf's coarser levels: splats that are alike become one.
//!
//! Of each splat and its nearest neighbours, those pairs are joined first that differ least: in
//! place, in standard deviations of both, and in colour, times the worth that a merge of the two
//! moves. Several may come together in one step.

use crate::moments::{apart, covariance, put};
use glam::{DMat3, DVec3};
use wm_base::kd_tree::KdTree;
use wm_scene::Splats;

/// Number of neighbours that a splat may be merged with.
const NEIGHBOUR_COUNT: usize = 6;
/// Maximum number of splats that become one in a step: larger groups would blur detail that the
/// rest of the leaf keeps.
const MAX_GROUP_SPLATS: usize = 4;
/// Weight of colour against position: colours that differ by 1 in all channels cost about as much
/// as this many squared standard deviations.
const COLOR_COST: f64 = 20.0;

/// A pair that may be joined.
struct Pair {
    cost: f32,
    a: u32,
    b: u32,
}

/// Joins splats until about `target` are left, and gives them with their worth; more are left where
/// too few are neighbours.
pub(crate) fn halved(splats: &Splats, worth: &[f64], target: usize) -> (Splats, Vec<f64>) {
    let mut groups = Groups::new(splats.len());
    for pair in pairs(splats, worth) {
        if groups.count <= target {
            break;
        }
        groups.join(pair.a, pair.b);
    }
    let mut sets: Vec<Vec<u32>> = Vec::with_capacity(groups.count);
    let mut slots = vec![usize::MAX; splats.len()];
    for index in 0..splats.len() as u32 {
        let slot = &mut slots[groups.root(index) as usize];
        if *slot == usize::MAX {
            *slot = sets.len();
            sets.push(Vec::new());
        }
        sets[*slot].push(index);
    }
    for set in &mut sets {
        // The first is worth most.
        set.sort_by(|a, b| worth[*b as usize].total_cmp(&worth[*a as usize]).then(a.cmp(b)));
    }
    let keepers: Vec<usize> = sets.iter().map(|set| set[0] as usize).collect();
    let mut out = splats.select(&keepers);
    for (slot, set) in sets.iter().enumerate().filter(|(_, set)| set.len() > 1) {
        put(&mut out, slot, splats, worth, set);
    }
    let worth = sets.iter().map(|set| set.iter().map(|i| worth[*i as usize]).sum()).collect();
    (out, worth)
}

/// Pairs of neighbours, the cheapest first.
fn pairs(splats: &Splats, worth: &[f64]) -> Vec<Pair> {
    let places: Vec<[f64; 3]> = splats.means.iter().map(|mean| mean.map(f64::from)).collect();
    let tree = KdTree::new(&places);
    let covariances: Vec<DMat3> = (0..splats.len()).map(|i| covariance(splats, i)).collect();
    // What is worth nothing has an order too.
    let least = 1e-6 * worth.iter().sum::<f64>() / worth.len().max(1) as f64 + 1e-30;
    let mut pairs = Vec::with_capacity(splats.len() * NEIGHBOUR_COUNT);
    for (a, place) in places.iter().enumerate() {
        for near in tree.nearest(place, NEIGHBOUR_COUNT + 1) {
            let b = near.index as usize;
            if a == b || splats.groups[a] != splats.groups[b] {
                continue;
            }
            let between = DVec3::from_array(*place) - DVec3::from_array(places[b]);
            let place = apart(between, covariances[a] + covariances[b]);
            let (wa, wb) = (worth[a] + least, worth[b] + least);
            let moved = wa * wb / (wa + wb);
            let cost = moved * (place + COLOR_COST * f64::from(color_difference(splats, a, b)));
            pairs.push(Pair { cost: cost as f32, a: a as u32, b: b as u32 });
        }
    }
    pairs.sort_unstable_by(|x, y| x.cost.total_cmp(&y.cost).then((x.a, x.b).cmp(&(y.a, y.b))));
    pairs
}

/// The squared difference of two splats in colour over all directions, up to the factor of 3
/// channels and a mean: the SH are orthonormal.
fn color_difference(splats: &Splats, a: usize, b: usize) -> f32 {
    let square = (wm_scene::sh::C0 * wm_scene::sh::C0) as f32;
    square * splats.sh_of(a).iter().zip(splats.sh_of(b)).map(|(a, b)| (a - b) * (a - b)).sum::<f32>()
}

/// Splats that became one.
struct Groups {
    parents: Vec<u32>,
    sizes: Vec<u8>,
    count: usize,
}

impl Groups {
    fn new(count: usize) -> Self {
        Self { parents: (0..count as u32).collect(), sizes: vec![1; count], count }
    }

    fn root(&mut self, index: u32) -> u32 {
        let mut index = index;
        while self.parents[index as usize] != index {
            let above = self.parents[self.parents[index as usize] as usize];
            self.parents[index as usize] = above;
            index = above;
        }
        index
    }

    /// Joins the groups of two splats, if they are not too large.
    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        let (first, second) = (a.min(b), a.max(b));
        let size = self.sizes[first as usize] + self.sizes[second as usize];
        if a != b && usize::from(size) <= MAX_GROUP_SPLATS {
            self.parents[second as usize] = first;
            self.sizes[first as usize] = size;
            self.count -= 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::moments::cover;
    use wm_scene::{Group, splats::Splat};

    fn worth(splats: &Splats) -> Vec<f64> {
        (0..splats.len()).map(|i| splats.opacity(i) * cover(splats.log_scales[i])).collect()
    }

    fn row(count: usize, color: impl Fn(usize) -> f32) -> Splats {
        let mut splats = Splats::with_capacity(count, 0);
        for index in 0..count {
            splats.push(&Splat {
                mean: [index as f32, 0.0, 0.0],
                quat: [1.0, 0.0, 0.0, 0.0],
                log_scale: [-0.5, -0.5, -4.0],
                logit_opacity: 3.0,
                rgb: [color(index), 0.5, 0.5],
                group: Group::Scene,
            });
        }
        splats
    }

    #[test]
    fn what_is_alike_is_joined_and_covers_as_much() {
        // Pairs of a colour: none is joined over the border of two.
        let splats = row(64, |index| if index / 2 % 2 == 0 { 0.0 } else { 1.0 });
        let (half, importance) = halved(&splats, &worth(&splats), 32);
        assert_eq!(half.len(), 32);
        for index in 0..32 {
            let red = half.base_color(index)[0];
            assert!(red.abs() < 1e-5 || (red - 1.0).abs() < 1e-5, "{red}");
        }
        let (before, after) = (worth(&splats).iter().sum::<f64>(), worth(&half).iter().sum::<f64>());
        assert!((after / before - 1.0).abs() < 0.2, "{before} {after}");
        assert!((importance.iter().sum::<f64>() / before - 1.0).abs() < 1e-9);
    }

    #[test]
    fn lone_and_equal_splats_are_fine() {
        let one = row(1, |_| 0.5);
        assert_eq!(halved(&one, &worth(&one), 0).0, one);
        let same = one.select(&[0; 40]);
        let (few, _) = halved(&same, &worth(&same), 10);
        assert!((10..40).contains(&few.len()) && few.means.iter().all(|mean| *mean == [0.0; 3]));
    }
}
