//! Posts in a scene: thin things that stand free and upright and end without a crown, such as lampposts.

use crate::survey::{SkyRegion, Survey};
use crate::{Splats, quat};
use glam::DVec3;
use std::collections::BTreeSet;

/// Width of a cell, and height of a layer, m.
const CELL: f64 = 0.15;
const LAYER: f64 = 0.25;
/// Layers above the ground that are looked at: 16 m.
const LAYERS: usize = 64;
/// Most cells of the grid: a larger place has its lamps on a map.
const MOST_CELLS: usize = 8_000_000;
/// Distance from the middle of the scene in which posts are looked for, radii of the scene.
const ABOUT: f64 = 1.5;
/// Least opacity of a splat that counts, and the distance of the points that stand for it, m; longest piece of it that counts, m.
const OPAQUE: f64 = 0.35;
const STEP: f64 = 0.12;
const LONGEST: f64 = 3.0;
/// Standard deviations to which a splat reaches.
const REACH: f64 = 1.5;
/// Height from which a post must be seen, m; how high it is at least and at most.
const FROM: f64 = 0.75;
const HEIGHTS: [f64; 2] = [2.7, 12.0];
/// Layers that may be missing in a post between others.
const GAP: usize = 1;
/// Distances of the round that must be free about a post, cells, and the share of it, below its head.
const ROUND: [i32; 2] = [4, 6];
const FREE: f64 = 0.98;
/// Height of the head, m, the distance to which it reaches, cells, and the distance in which nothing may hang over it.
const HEAD: f64 = 0.75;
const HEAD_REACH: i32 = 8;
const OVER: i32 = 7;
/// Share of the space over and beside a head that may be filled.
const FILLED: f64 = 0.08;

/// A thin thing that stands free.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Post {
    /// The middle of its head, scene units.
    pub head: DVec3,
    /// Height of its top over the ground of the scene, m.
    pub height: f64,
}

/// The layers that are filled over each cell of a level grid.
struct Columns {
    low: [f64; 2],
    size: [usize; 2],
    filled: Vec<u64>,
}

impl Columns {
    /// Makes empty columns within a distance from a middle along both level axes, m; `None` if they were too many.
    fn around(middle: [f64; 2], distance: f64) -> Option<Self> {
        let side = 2.0 * distance / CELL + 1.0;
        (side * side <= MOST_CELLS as f64).then(|| {
            let side = side as usize;
            Self { low: middle.map(|v| v - distance), size: [side; 2], filled: vec![0; side * side] }
        })
    }

    /// Fills the layer of a point (level coordinates, m), if it is in the grid.
    fn fill(&mut self, [x, y, height]: [f64; 3]) {
        let [column, row] = [(x - self.low[0]) / CELL, (y - self.low[1]) / CELL];
        let layer = height / LAYER;
        let is_in = |at: f64, size: usize| at >= 0.0 && at < size as f64;
        if is_in(column, self.size[0]) && is_in(row, self.size[1]) && is_in(layer, LAYERS) {
            self.filled[row as usize * self.size[0] + column as usize] |= 1 << layer as u32;
        }
    }

    /// The filled layers of a cell; none off the grid.
    fn at(&self, [x, y]: [i32; 2]) -> u64 {
        let is_in = x >= 0 && y >= 0 && (x as usize) < self.size[0] && (y as usize) < self.size[1];
        if is_in { self.filled[y as usize * self.size[0] + x as usize] } else { 0 }
    }

    /// The layer above the last of those that are filled from [`FROM`] on without a gap.
    fn top(&self, cell: [i32; 2]) -> usize {
        // Posts lean and are rough: a cell and those beside it are one.
        let layers = square(1).map(|[x, y]| self.at([cell[0] + x, cell[1] + y])).fold(0, |a, b| a | b);
        let first = (FROM / LAYER) as usize;
        let (mut top, mut missing) = (first, 0);
        for layer in first..LAYERS {
            missing = if layers >> layer & 1 == 1 { 0 } else { missing + 1 };
            match missing {
                0 => top = layer + 1,
                missing if missing > GAP => break,
                _ => {}
            }
        }
        top
    }

    /// Share of the layers from `bottom` to `top` that are filled in the cells of a square ring about a cell.
    fn share(&self, cell: [i32; 2], rings: [i32; 2], [bottom, top]: [usize; 2]) -> f64 {
        let mask = mask(top) & !mask(bottom);
        let is_in = |[x, y]: &[i32; 2]| (rings[0]..=rings[1]).contains(&x.abs().max(y.abs()));
        let (mut filled, mut all) = (0, 0);
        for [x, y] in square(rings[1]).filter(is_in) {
            filled += (self.at([cell[0] + x, cell[1] + y]) & mask).count_ones();
            all += mask.count_ones();
        }
        if all == 0 { 0.0 } else { f64::from(filled) / f64::from(all) }
    }

    /// Returns true if a post ends at a layer above a cell.
    fn is_post(&self, cell: [i32; 2], top: usize) -> bool {
        let layers = |metres: f64| (metres / LAYER).round() as usize;
        let shoulder = top.saturating_sub(layers(HEAD));
        let height = top as f64 * LAYER;
        (HEIGHTS[0]..HEIGHTS[1]).contains(&height)
            && self.share(cell, ROUND, [layers(FROM) + 1, shoulder]) < 1.0 - FREE
            && self.share(cell, [0, OVER], [(top + 1).min(LAYERS), (top + layers(2.0)).min(LAYERS)]) < FILLED
            && self.share(cell, [OVER, OVER + 5], [shoulder, (top + layers(1.0)).min(LAYERS)]) < FILLED
    }

    /// The middle of what is at the top of a post, in cells and layers.
    fn head(&self, cell: [i32; 2], top: usize) -> [f64; 3] {
        let bottom = top.saturating_sub((HEAD / LAYER) as usize);
        // The layer below the top is filled, so that there is something.
        let (mut sum, mut count) = ([0.0; 3], 0.0);
        for [x, y] in square(HEAD_REACH) {
            let at = [cell[0] + x, cell[1] + y];
            for layer in (bottom..(top + 1).min(LAYERS)).filter(|layer| self.at(at) >> layer & 1 == 1) {
                let place = [f64::from(at[0]), f64::from(at[1]), layer as f64];
                (0..3).for_each(|k| sum[k] += place[k] + 0.5);
                count += 1.0;
            }
        }
        sum.map(|v| v / count)
    }
}

/// The bits of the lowest layers.
fn mask(layers: usize) -> u64 {
    if layers >= 64 { u64::MAX } else { (1 << layers) - 1 }
}

/// The cells within a distance along both axes.
fn square(reach: i32) -> impl Iterator<Item = [i32; 2]> {
    (-reach..=reach).flat_map(move |x| (-reach..=reach).map(move |y| [x, y]))
}

/// Finds the posts of a scene: upright, at most two cells of 15 cm wide up to their heads, free about that, and without a crown or
/// a roof over them. What is shorter than 2.7 m is none. Whether they carry lamps is not known.
#[must_use]
pub fn find_posts(splats: &Splats, survey: &Survey) -> Vec<Post> {
    let metres = survey.metres_per_unit.value;
    let up = survey.up.value;
    let (x, y) = up.any_orthonormal_pair();
    let level =
        |point: DVec3| DVec3::new(point.dot(x), point.dot(y), point.dot(up) - survey.ground.value) * metres;
    let sky = SkyRegion::of(splats);
    let middle = level(survey.center);
    let Some(mut columns) = Columns::around([middle.x, middle.y], ABOUT * survey.radius * metres) else {
        return Vec::new();
    };
    for index in 0..splats.len() {
        let middle = level(DVec3::from_array(splats.means[index].map(f64::from)));
        let is_low = (-LONGEST..LAYERS as f64 * LAYER + LONGEST).contains(&middle.z);
        let is_seen = || splats.is_sound(index) && splats.opacity(index) >= OPAQUE;
        if !is_low || !is_seen() || sky.holds(splats, index) {
            continue;
        }
        let halves = splats.scales(index).map(|scale| (REACH * scale * metres).min(LONGEST));
        if halves.iter().all(|half| *half < STEP) {
            columns.fill(middle.to_array());
            continue;
        }
        let turn = quat::to_matrix(splats.quats[index].map(f64::from));
        let mut axes = [0, 1, 2].map(|k| {
            let axis = DVec3::new(turn[0][k], turn[1][k], turn[2][k]);
            (DVec3::new(axis.dot(x), axis.dot(y), axis.dot(up)) * STEP, (halves[k] / STEP) as i32)
        });
        axes.sort_by_key(|axis| std::cmp::Reverse(axis.1));
        let [(long, lengths), (wide, widths), _] = axes;
        for i in -lengths..=lengths {
            let start = middle + long * f64::from(i);
            for j in -widths..=widths {
                columns.fill((start + wide * f64::from(j)).to_array());
            }
        }
    }
    let cells = (0..columns.filled.len()).filter(|at| columns.filled[*at] >> (FROM / LAYER) as u32 & 3 != 0);
    let cell = |at: usize| [(at % columns.size[0]) as i32, (at / columns.size[0]) as i32];
    let mut found: Vec<([i32; 2], usize)> = cells
        .map(|at| (cell(at), columns.top(cell(at))))
        .filter(|(cell, top)| columns.is_post(*cell, *top))
        .collect();
    // The highest first; what is beside it is the same.
    found.sort_by_key(|(cell, top)| (std::cmp::Reverse(*top), *cell));
    let mut taken = BTreeSet::new();
    let mut posts = Vec::new();
    for (cell, top) in found {
        if taken.contains(&cell) {
            continue;
        }
        taken.extend(square(HEAD_REACH).map(|[x, y]| [cell[0] + x, cell[1] + y]));
        let [column, row, layer] = columns.head(cell, top);
        let [a, b] = [columns.low[0] + column * CELL, columns.low[1] + row * CELL].map(|v| v / metres);
        let head = x * a + y * b + up * (survey.ground.value + layer * LAYER / metres);
        posts.push(Post { head, height: top as f64 * LAYER });
    }
    posts
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::Builder;
    use crate::{Metadata, Scene};

    const HEADS: [[f64; 2]; 3] = [[-6.0, 2.0], [3.0, 5.0], [7.0, -4.0]];

    #[test]
    fn posts_are_found_and_trees_walls_and_bollards_are_not() {
        let mut place = Builder::new(9);
        place.block(DVec3::new(0.0, 0.0, -0.2), DVec3::new(30.0, 30.0, 0.2), 0.3, [0.5; 3]);
        let mut post = |[x, y]: [f64; 2], height: f64| {
            place.block(DVec3::new(x, y, 0.0), DVec3::new(0.12, 0.12, height), 0.1, [0.1; 3]);
        };
        HEADS.into_iter().for_each(|at| post(at, 4.0));
        // A bollard, and a trunk.
        post([0.0, 0.0], 1.2);
        post([-8.0, -8.0], 3.0);
        place.leaves(DVec3::new(-8.0, -8.0, 4.0), 1.6, 3000, [0.1, 0.4, 0.1]);
        place.block(DVec3::new(0.0, 12.0, 0.0), DVec3::new(10.0, 0.3, 4.0), 0.2, [0.6; 3]);
        let given = Metadata { up: Some(DVec3::Z), ground: Some(0.0), ..Metadata::default() };
        let scene = Scene { splats: place.build(), ..Scene::default() };
        let survey = Survey::of(&scene, &given);
        let posts = find_posts(&scene.splats, &survey);
        assert_eq!(posts.len(), HEADS.len(), "{posts:?}");
        for [x, y] in HEADS {
            let is_there = |post: &&Post| post.head.truncate().distance(glam::DVec2::new(x, y)) < 0.2;
            let post = posts.iter().find(is_there).unwrap();
            assert!((post.height - 4.0).abs() < 0.4 && (post.head.z - 3.7).abs() < 0.4, "{post:?}");
        }
        // A scene that says another scale has other posts.
        let giant = Survey::of(&scene, &Metadata { metres_per_unit: Some(0.1), ..given });
        assert!(find_posts(&scene.splats, &giant).is_empty());
    }
}
