//! Posts in a scene: thin things that stand upright and straight, such as lampposts.

use crate::survey::{SkyRegion, Survey};
use crate::{Splats, quat};
use glam::{DVec2, DVec3};
use std::collections::BTreeSet;
use wm_base::statistics::quantile;

/// Width of a cell, m.
const CELL_M: f64 = 0.15;
/// Height of a layer, m.
const LAYER_M: f64 = 0.25;
/// Layers above the ground: 16 m.
const LAYER_COUNT: usize = 64;
/// Most cells of the grid: a larger place has its lamps on a map.
const MAX_CELLS: usize = 8_000_000;
/// Distance from the middle of the scene in which posts are searched, radii of the scene.
const SEARCH_RADII: f64 = 1.5;
/// Least opacity of a splat that counts.
const MIN_OPACITY: f64 = 0.35;
/// Largest standard deviation across the length of a splat of a post, m.
const MAX_WIDTH_M: f64 = 0.07;
/// Least ratio of the standard deviations along and across a splat that has a direction.
const MIN_ELONGATION: f64 = 2.5;
/// Least cosine of the angle between that direction and up.
const MIN_UPRIGHT_COS: f64 = 0.96;
/// Longest standard deviation of a splat that counts, m.
const MAX_LENGTH_M: f64 = 2.0;
/// Standard deviations to which splats reach.
const REACH_DEVIATIONS: f64 = 1.5;
/// Height from which a post must be visible, m.
const MIN_VISIBLE_HEIGHT_M: f64 = 0.75;
/// Least and greatest height of a post, m.
const HEIGHTS_M: [f64; 2] = [2.7, 12.0];
/// Most layers that may be missing in a post between others.
const MAX_GAP_LAYERS: usize = 2;
/// Least share of the layers of a post that are filled.
const MIN_FILLED_SHARE: f64 = 0.8;
/// Radius of a post, m.
const RADIUS_M: f64 = 0.15;
/// Radius of the surroundings of its axis, m.
const SURROUND_RADIUS_M: f64 = 0.4;
/// Least share of the splats in the surroundings that belong to the post, by weight.
const MIN_SURROUND_SHARE: f64 = 0.6;
/// Least distance between posts, m.
const MIN_DISTANCE_M: f64 = 0.6;
/// Largest median distance of the middles of a post's layers from its axis, m: lampposts of
/// captures have 4 to 9 mm, trunks, stakes and boughs 14 to 50 mm.
const MAX_CROOKEDNESS_M: f64 = 0.0125;
/// Largest tangent of the angle between a post and up: 3.5 degrees, since up is rarely known better
/// than by one.
const MAX_LEAN: f64 = 0.061;
/// Fewest splats of a post.
const MIN_PIECES: usize = 20;
/// Fewest layers of a post.
const MIN_LAYERS: usize = 6;
/// Largest distance of a crown or a roof from the axis, m.
const CROWN_RADIUS_M: f64 = 1.0;
/// Range of heights of a crown over the top of the post, m.
const CROWN_HEIGHTS_M: [f64; 2] = [0.25, 2.0];
/// Largest ratio of the area of splats in the space of a crown to the area of that space seen from
/// the side.
const MAX_CROWN_DENSITY: f64 = 0.3;
/// Range of heights of a roof over the top of the post, m: columns of a hall and frames of windows
/// end at one.
const ROOF_HEIGHTS_M: [f64; 2] = [-0.4, 2.0];
/// Least cosine between up and the normals of the splats of a roof.
const MIN_LEVEL_COS: f64 = 0.9;
/// Largest ratio of the area of such splats to that of the disc about the axis.
const MAX_ROOF_COVER: f64 = 0.3;
/// Distance of the lamp from the top of a post, m.
const HEAD_DEPTH_M: f64 = 0.3;

/// A thin thing that stands upright.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Post {
    /// The point on its axis 0.3 m below its top, scene units.
    pub head: DVec3,
    /// Height of its top over the ground of the scene, m.
    pub height: f64,
}

/// A thin splat.
#[derive(Clone, Copy)]
struct Piece {
    /// The middle: distances along both level axes and height over the ground, m.
    at: DVec3,
    /// How far it reaches up and down from there, m.
    half: f64,
    /// Standard deviation along it, m, times its opacity.
    weight: f64,
}

impl Piece {
    /// The layers that the piece reaches, from the lowest to that above the highest.
    fn layers(&self) -> std::ops::Range<usize> {
        let layer = |height: f64| (height / LAYER_M).clamp(0.0, LAYER_COUNT as f64) as usize;
        let range = layer(self.at.z - self.half)..layer(self.at.z + self.half) + 1;
        range.start..range.end.min(LAYER_COUNT)
    }
}

/// Thin splats over the cells of a level grid.
struct Columns {
    low: DVec2,
    side: usize,
    /// The layers that are filled in each cell.
    filled: Vec<u64>,
    /// Cells and their pieces, in order of cells.
    pieces: Vec<(usize, Piece)>,
}

impl Columns {
    /// Puts pieces into the cells within a distance of a middle along both level axes, m; `None` if
    /// these were too many.
    fn new(middle: DVec2, distance: f64, pieces: &[Piece]) -> Option<Self> {
        let side = 2.0 * distance / CELL_M + 1.0;
        let is_possible = side * side <= MAX_CELLS as f64;
        if !is_possible {
            return None;
        }
        let side = side as usize;
        let mut columns =
            Self { low: middle - distance, side, filled: vec![0; side * side], pieces: Vec::new() };
        for piece in pieces {
            let at = (piece.at.truncate() - columns.low) / CELL_M;
            let is_in = at.min_element() >= 0.0 && at.max_element() < side as f64;
            if is_in {
                let cell = at.y as usize * side + at.x as usize;
                columns.filled[cell] |= piece.layers().fold(0, |layers, layer| layers | 1 << layer);
                columns.pieces.push((cell, *piece));
            }
        }
        columns.pieces.sort_by_key(|(cell, _)| *cell);
        Some(columns)
    }

    /// The cells within `reach` cells of a cell, row by row.
    fn rows(&self, cell: usize, reach: usize) -> impl Iterator<Item = std::ops::Range<usize>> {
        let (column, row, side) = (cell % self.side, cell / self.side, self.side);
        let near = move |at: usize| at.saturating_sub(reach)..(at + reach + 1).min(side);
        near(row).map(move |row| row * side + near(column).start..row * side + near(column).end)
    }

    /// The layer above the last of those that are filled from [`MIN_VISIBLE_HEIGHT_M`] on with
    /// small gaps.
    fn top(&self, cell: usize) -> usize {
        // Posts lean and are rough: a cell and those beside it are one.
        let layers = self.rows(cell, 1).flatten().fold(0, |layers, cell| layers | self.filled[cell]);
        let first = (MIN_VISIBLE_HEIGHT_M / LAYER_M) as usize;
        let (mut top, mut missing) = (first, 0);
        for layer in first..LAYER_COUNT {
            missing = if layers >> layer & 1 == 1 { 0 } else { missing + 1 };
            match missing {
                0 => top = layer + 1,
                missing if missing > MAX_GAP_LAYERS => break,
                _ => {}
            }
        }
        top
    }

    /// The pieces in the cells within `reach` cells of a cell, between two heights, m.
    fn near(&self, cell: usize, reach: usize, heights: [f64; 2]) -> Vec<Piece> {
        let of_row = |cells: std::ops::Range<usize>| {
            let at = |cell: usize| self.pieces.partition_point(|(own, _)| *own < cell);
            &self.pieces[at(cells.start)..at(cells.end)]
        };
        let is_between = |piece: &&(usize, Piece)| (heights[0]..heights[1]).contains(&piece.1.at.z);
        self.rows(cell, reach).flat_map(of_row).filter(is_between).map(|(_, piece)| *piece).collect()
    }

    /// The axis of the post that ends at a layer above a cell; `None` if what is there is no post.
    fn post(&self, cell: usize, top: usize) -> Option<Axis> {
        let height = top as f64 * LAYER_M;
        let cells = (MIN_DISTANCE_M / CELL_M) as usize;
        let near = self.near(cell, cells, [MIN_VISIBLE_HEIGHT_M, height]);
        // Cheaper than a fit: too few pieces, or too little of them in this cell and those beside
        // it.
        let are_few = near.len() < MIN_PIECES;
        if are_few
            || weight_of(&self.near(cell, 1, [MIN_VISIBLE_HEIGHT_M, height]))
                < 0.3 * MIN_SURROUND_SHARE * weight_of(&near)
        {
            return None;
        }
        let axis = Axis::through(&near)?;
        let within = |distance: f64| -> Vec<Piece> {
            near.iter().filter(|piece| axis.distance(piece.at) < distance).copied().collect()
        };
        let own = within(RADIUS_M);
        let layers = (MIN_VISIBLE_HEIGHT_M / LAYER_M) as usize..top;
        let is_filled = |layer: &usize| own.iter().any(|piece| piece.layers().contains(layer));
        let filled = layers.clone().filter(is_filled).count();
        let is_post = own.len() >= MIN_PIECES
            && weight_of(&own) >= MIN_SURROUND_SHARE * weight_of(&within(SURROUND_RADIUS_M))
            && filled as f64 >= MIN_FILLED_SHARE * layers.len() as f64
            && axis.slope.length() <= MAX_LEAN
            && axis.crookedness(&own, layers)? <= MAX_CROOKEDNESS_M;
        is_post.then_some(axis)
    }
}

/// Returns the sum of the weights of pieces.
fn weight_of(pieces: &[Piece]) -> f64 {
    pieces.iter().map(|piece| piece.weight).sum()
}

/// A nearly plumb line.
#[derive(Clone, Copy)]
struct Axis {
    /// The point at which it meets the ground, along both level axes, m.
    foot: DVec2,
    /// How far it leans along them a metre of height.
    slope: DVec2,
}

impl Axis {
    /// The level distance of a point from the line, m.
    fn off(&self, at: DVec3) -> DVec2 {
        at.truncate() - self.foot - self.slope * at.z
    }

    /// The point at a height, m.
    fn at(&self, height: f64) -> DVec3 {
        (self.foot + self.slope * height).extend(height)
    }

    fn distance(&self, at: DVec3) -> f64 {
        self.off(at).length()
    }

    /// The line along which most of some pieces stand; `None` if they are all at one height.
    fn through(pieces: &[Piece]) -> Option<Self> {
        const MAX_ANCHOR_COUNT: usize = 64;
        let about = |foot: DVec2| {
            let line = Self { foot, slope: DVec2::ZERO };
            pieces
                .iter()
                .map(|piece| piece.weight * (1.0 - line.distance(piece.at) / RADIUS_M).max(0.0))
                .sum::<f64>()
        };
        let anchors = pieces
            .iter()
            .step_by(pieces.len().div_ceil(MAX_ANCHOR_COUNT).max(1))
            .map(|piece| piece.at.truncate());
        let foot = anchors.max_by(|a, b| about(*a).total_cmp(&about(*b)))?;
        let mut line = Self { foot, slope: DVec2::ZERO };
        // Least squares of those that are near the line, nearer each time.
        for radius in [1.5, 1.0, 0.6, 0.6].map(|share| share * RADIUS_M) {
            let own = pieces.iter().filter(|piece| line.distance(piece.at) < radius);
            let (mut sum, mut height, mut place) = (0.0, 0.0, DVec2::ZERO);
            for Piece { at, weight, .. } in own.clone() {
                (sum, height, place) =
                    (sum + weight, height + weight * at.z, place + *weight * at.truncate());
            }
            let (height, place) = (height / sum, place / sum);
            let (mut square, mut product) = (0.0, DVec2::ZERO);
            for Piece { at, weight, .. } in own {
                let up = at.z - height;
                (square, product) =
                    (square + weight * up * up, product + *weight * up * (at.truncate() - place));
            }
            let is_line = square > 1e-6 * sum;
            if !is_line {
                return None;
            }
            let slope = product / square;
            line = Self { foot: place - slope * height, slope };
        }
        Some(line)
    }

    /// The median distance of the middles of layers of pieces from the line, m; `None` if they are
    /// in few layers.
    fn crookedness(&self, pieces: &[Piece], layers: std::ops::Range<usize>) -> Option<f64> {
        let middle = |layer: usize| {
            let in_layer = |piece: &&Piece| (piece.at.z / LAYER_M) as usize == layer;
            let (mut sum, mut off) = (0.0, DVec2::ZERO);
            for piece in pieces.iter().filter(in_layer) {
                (sum, off) = (sum + piece.weight, off + piece.weight * self.off(piece.at));
            }
            (sum > 0.0).then(|| (off / sum).length())
        };
        let mut offs: Vec<f64> = layers.filter_map(middle).collect();
        (offs.len() >= MIN_LAYERS).then(|| quantile(&mut offs, 0.5))
    }
}

/// The thin splats of a scene, in its level axes from its ground: long upright ones, or small ones
/// of any direction.
struct ThinSplats {
    long: Vec<Piece>,
    small: Vec<Piece>,
}

impl ThinSplats {
    fn of(splats: &Splats, survey: &Survey, level: impl Fn(DVec3) -> DVec3) -> Self {
        let metres = survey.metres_per_unit.value;
        let sky = SkyRegion::of(splats);
        let mut thin = Self { long: Vec::new(), small: Vec::new() };
        for index in 0..splats.len() {
            let at = level(DVec3::from_array(splats.means[index].map(f64::from)));
            let is_low = (-1.0..LAYER_COUNT as f64 * LAYER_M).contains(&at.z);
            let is_seen = || splats.is_sound(index) && splats.opacity(index) >= MIN_OPACITY;
            if !is_low || !is_seen() {
                continue;
            }
            let scales = splats.scales(index).map(|scale| scale * metres);
            let longest = (0..3).fold(0, |best, k| if scales[k] > scales[best] { k } else { best });
            let (long, wide) = (scales[longest], scales[(longest + 1) % 3].max(scales[(longest + 2) % 3]));
            if wide >= MAX_WIDTH_M || long >= MAX_LENGTH_M || sky.holds(splats, index) {
                continue;
            }
            let turn = quat::to_matrix(splats.quats[index].map(f64::from));
            let cosine = DVec3::from_array([0, 1, 2].map(|k| turn[k][longest])).dot(survey.up.value).abs();
            let piece = Piece {
                at,
                half: (REACH_DEVIATIONS * long * cosine).max(0.5 * CELL_M),
                weight: long.min(0.5) * splats.opacity(index),
            };
            if long > MIN_ELONGATION * wide && cosine > MIN_UPRIGHT_COS {
                thin.long.push(piece);
            }
            if long < MAX_WIDTH_M {
                thin.small.push(piece);
            }
        }
        thin
    }
}

/// Finds the posts of a scene: 2.7 to 12 m high, at most 30 cm thick, straight and plumb, with no
/// crown and no roof on them. Most trunks, stakes and boughs are not as straight. Whether posts
/// carry lamps is not known.
#[must_use]
pub fn find_posts(splats: &Splats, survey: &Survey) -> Vec<Post> {
    let metres = survey.metres_per_unit.value;
    let up = survey.up.value;
    let (x, y) = up.any_orthonormal_pair();
    let level =
        |point: DVec3| DVec3::new(point.dot(x), point.dot(y), point.dot(up) - survey.ground.value) * metres;
    let middle = level(survey.center).truncate();
    let thin = ThinSplats::of(splats, survey, level);
    let mut posts: Vec<(Axis, f64)> = Vec::new();
    // Posts of trained captures are of long splats, also amid leaves; those of made scenes are of
    // small ones.
    for pieces in [thin.long, thin.small] {
        let Some(columns) = Columns::new(middle, SEARCH_RADII * survey.radius * metres, &pieces) else {
            return Vec::new();
        };
        let is_high = |top: &usize| (HEIGHTS_M[0]..HEIGHTS_M[1]).contains(&(*top as f64 * LAYER_M));
        let mut candidates: Vec<(usize, usize)> = (0..columns.filled.len())
            .filter(|cell| columns.filled[*cell] != 0)
            .map(|cell| (cell, columns.top(cell)))
            .filter(|(_, top)| is_high(top))
            .collect();
        // The highest first; what is beside it is the same.
        candidates.sort_by_key(|(cell, top)| (std::cmp::Reverse(*top), *cell));
        let mut taken = BTreeSet::new();
        for (cell, top) in candidates {
            if taken.contains(&cell) {
                continue;
            }
            let Some(axis) = columns.post(cell, top) else { continue };
            taken.extend(columns.rows(cell, (MIN_DISTANCE_M / CELL_M) as usize).flatten());
            let height = top as f64 * LAYER_M;
            let is_new = posts.iter().all(|post| post.0.distance(axis.at(height)) > MIN_DISTANCE_M);
            if is_new {
                posts.push((axis, height));
            }
        }
    }
    let over = overheads(splats, survey, level, &posts);
    let free = posts
        .iter()
        .zip(over)
        .filter(|(_, over)| over.crown < MAX_CROWN_DENSITY && over.roof < MAX_ROOF_COVER);
    let post = |axis: &Axis, height: f64| {
        let at = axis.at(height - HEAD_DEPTH_M) / metres;
        Post { head: x * at.x + y * at.y + up * (survey.ground.value + at.z), height }
    };
    free.map(|((axis, height), _)| post(axis, *height)).collect()
}

/// Areas of the splats over a post.
#[derive(Clone, Copy, Default)]
struct Overhead {
    /// Area of all splats in the space of a crown, over the area of that space seen from the side.
    crown: f64,
    /// Area of the level splats in the space of a roof, over the area of that space seen from
    /// above.
    roof: f64,
}

/// Finds what is over posts, given by axis and height.
fn overheads(
    splats: &Splats,
    survey: &Survey,
    level: impl Fn(DVec3) -> DVec3,
    posts: &[(Axis, f64)],
) -> Vec<Overhead> {
    let metres = survey.metres_per_unit.value;
    let mut found = vec![Overhead::default(); posts.len()];
    for index in 0..splats.len() {
        let at = level(DVec3::from_array(splats.means[index].map(f64::from)));
        for (over, (axis, height)) in found.iter_mut().zip(posts) {
            let is_over = (ROOF_HEIGHTS_M[0]..ROOF_HEIGHTS_M[1]).contains(&(at.z - height))
                && axis.distance(at) < CROWN_RADIUS_M;
            let is_seen = || splats.is_sound(index) && splats.opacity(index) >= MIN_OPACITY;
            if !is_over || !is_seen() {
                continue;
            }
            let scales = splats.scales(index).map(|scale| scale * metres);
            let mut order = [0, 1, 2];
            order.sort_by(|a, b| scales[*a].total_cmp(&scales[*b]));
            let area = std::f64::consts::PI * scales[order[1]] * scales[order[2]].min(MAX_LENGTH_M);
            if (CROWN_HEIGHTS_M[0]..CROWN_HEIGHTS_M[1]).contains(&(at.z - height)) {
                over.crown += area / (2.0 * CROWN_RADIUS_M * (CROWN_HEIGHTS_M[1] - CROWN_HEIGHTS_M[0]));
            }
            let turn = quat::to_matrix(splats.quats[index].map(f64::from));
            let normal = DVec3::from_array([0, 1, 2].map(|k| turn[k][order[0]]));
            if normal.dot(survey.up.value).abs() > MIN_LEVEL_COS {
                over.roof += area / (std::f64::consts::PI * CROWN_RADIUS_M * CROWN_RADIUS_M);
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::Builder;
    use crate::{Metadata, Scene};

    const HEADS: [[f64; 2]; 3] = [[-6.0, 2.0], [3.0, 5.0], [7.0, -4.0]];

    /// The posts of a place on level ground about the origin, with so many metres a unit.
    fn found(place: Builder, metres_per_unit: f64) -> Vec<Post> {
        let scene = Scene { splats: place.build(), ..Scene::default() };
        let given = Metadata {
            up: Some(DVec3::Z),
            ground: Some(0.0),
            metres_per_unit: Some(metres_per_unit),
            ..Metadata::default()
        };
        find_posts(&scene.splats, &Survey::of(&scene, &given))
    }

    fn ground() -> Builder {
        let mut place = Builder::new(9);
        place.block(DVec3::new(0.0, 0.0, -0.2), DVec3::new(30.0, 30.0, 0.2), 0.3, [0.5; 3]);
        place
    }

    fn assert_heads(posts: &[Post], heads: &[[f64; 2]]) {
        assert_eq!(posts.len(), heads.len(), "{posts:?}");
        for [x, y] in heads {
            let is_there = |post: &&Post| post.head.truncate().distance(DVec2::new(*x, *y)) < 0.1;
            let post = posts.iter().find(is_there).unwrap();
            assert!((post.height - 4.0).abs() < 0.4 && (post.head.z - 3.7).abs() < 0.4, "{post:?}");
        }
    }

    #[test]
    fn posts_are_found_and_trees_walls_and_bollards_are_not() {
        let place = || {
            let mut place = ground();
            let mut post = |[x, y]: [f64; 2], height: f64| {
                place.block(DVec3::new(x, y, 0.0), DVec3::new(0.12, 0.12, height), 0.06, [0.1; 3]);
            };
            HEADS.into_iter().for_each(|at| post(at, 4.0));
            // A bollard, and a trunk.
            post([0.0, 0.0], 1.2);
            post([-8.0, -8.0], 3.0);
            place.leaves(DVec3::new(-8.0, -8.0, 4.0), 1.6, 3000, [0.1, 0.4, 0.1]);
            place.block(DVec3::new(0.0, 12.0, 0.0), DVec3::new(10.0, 0.3, 4.0), 0.2, [0.6; 3]);
            // A hall on four columns.
            for [x, y] in [[-12.0, 8.0], [-12.0, 12.0], [-8.0, 8.0], [-8.0, 12.0]] {
                place.block(DVec3::new(x, y, 0.0), DVec3::new(0.12, 0.12, 3.0), 0.06, [0.7; 3]);
            }
            place.block(DVec3::new(-10.0, 10.0, 3.0), DVec3::new(5.0, 5.0, 0.2), 0.2, [0.7; 3]);
            place
        };
        assert_heads(&found(place(), 1.0), &HEADS);
        // A scene that says another scale has other posts.
        assert!(found(place(), 0.1).is_empty());
    }

    #[test]
    fn posts_of_long_splats_are_found_amid_bushes_and_stakes_are_not() {
        let mut place = ground();
        let mut rod = |[x, y]: [f64; 2], lean: f64| {
            for step in 0..80 {
                let height = 0.05 * f64::from(step);
                let at = DVec3::new(x + lean * height, y, height);
                place.push(at, DVec3::Z, [0.02, 0.02, 0.12], 0.9, [0.1; 3]);
            }
        };
        HEADS.into_iter().for_each(|at| rod(at, 0.02));
        rod([0.0, -9.0], 0.12);
        for [x, y] in HEADS {
            place.leaves(DVec3::new(x + 0.5, y, 0.8), 0.9, 400, [0.1, 0.4, 0.1]);
        }
        assert_heads(&found(place, 1.0), &HEADS.map(|[x, y]| [x + 0.02 * 3.7, y]));
    }
}
