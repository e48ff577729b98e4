//! A tree of boxes over the primitives, so that a ray looks at few of them.

use super::shape::{Crossing, Shape};
use glam::{DVec3, Vec3A};

/// Most primitives of a leaf that is not worth splitting.
const MAX_LEAF_PRIMITIVES: usize = 3;
/// Bins that a split is looked for in.
const SPLIT_BINS: usize = 12;
/// Deepest tree that the traversal's stack holds; the build falls back to halves before.
const MAX_DEPTH: usize = 60;

/// A part of the tree.
#[derive(Clone, Copy, Debug)]
struct Node {
    /// The pair of an inner node; a leaf's first primitive.
    first: u32,
    /// Primitives of a leaf; 0 for an inner node.
    count: u32,
}

/// A box along the axes; aligned for SIMD, which halves the time of a ray.
#[derive(Clone, Copy, Debug)]
struct Extent {
    lower: Vec3A,
    upper: Vec3A,
}

/// Both children of an inner node: a ray looks at both at once.
#[derive(Clone, Copy, Debug)]
struct Pair {
    extents: [Extent; 2],
    parts: [Node; 2],
}

/// The tree. Primitives are known by their place in the order that [`Bvh::build`] gives.
#[derive(Clone, Debug)]
pub(super) struct Bvh {
    root: Option<(Extent, Node)>,
    pairs: Vec<Pair>,
}

#[derive(Clone, Copy)]
struct Item {
    low: DVec3,
    high: DVec3,
    index: usize,
}

impl Bvh {
    /// Builds the tree; the second result is the order the primitives must be put in.
    pub(super) fn build(shapes: impl Iterator<Item = Shape>) -> (Self, Vec<usize>) {
        let mut items: Vec<Item> = shapes
            .enumerate()
            .map(|(index, shape)| {
                let (low, high) = shape.bounds();
                Item { low, high, index }
            })
            .collect();
        let mut tree = Self { root: None, pairs: Vec::with_capacity(items.len() / 2) };
        let count = items.len();
        if count > 0 {
            tree.root = Some(tree.grow(&mut items, 0, count, 0));
        }
        (tree, items.into_iter().map(|item| item.index).collect())
    }

    fn grow(&mut self, items: &mut [Item], first: usize, count: usize, depth: usize) -> (Extent, Node) {
        let slice = &mut items[first..first + count];
        let (low, high) = slice.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), item| {
            (low.min(item.low), high.max(item.high))
        });
        // Boxes are a little larger than what they hold: f32 slabs then never lose a crossing.
        let pad = low.abs().max(high.abs()) * 1e-6 + 1e-4;
        let extent = Extent { lower: (low - pad).as_vec3a(), upper: (high + pad).as_vec3a() };
        if count <= MAX_LEAF_PRIMITIVES {
            return (extent, Node { first: first as u32, count: count as u32 });
        }
        let middle = if depth < MAX_DEPTH - 24 { split(slice) } else { None };
        let middle = middle.unwrap_or_else(|| {
            slice.sort_by(|a, b| (a.low.y + a.high.y).total_cmp(&(b.low.y + b.high.y)));
            count / 2
        });
        let part = Node { first: self.pairs.len() as u32, count: 0 };
        self.pairs.push(Pair { extents: [extent; 2], parts: [part; 2] });
        let below = self.grow(items, first, middle, depth + 1);
        let above = self.grow(items, first + middle, count - middle, depth + 1);
        self.pairs[part.first as usize] = Pair { extents: [below.0, above.0], parts: [below.1, above.1] };
        (extent, part)
    }

    /// Visits the primitives whose boxes a ray may meet before `high`, near ones first.
    ///
    /// `visit` gets a primitive's place and the present `high`, and gives the new one; a value
    /// below 0 ends the walk.
    fn walk(&self, origin: DVec3, direction: DVec3, mut high: f64, mut visit: impl FnMut(usize, f64) -> f64) {
        let from = origin.as_vec3a();
        let inverse = direction.to_array().map(|d| 1.0 / if d.abs() < 1e-12 { 1e-12f32 } else { d as f32 });
        let inverse = Vec3A::from_array(inverse);
        let Some((extent, mut part)) = self.root else { return };
        let Some(mut near) = enter(&extent, from, inverse, high as f32) else { return };
        let mut stack = [(Node { first: 0, count: 0 }, 0f32); MAX_DEPTH + 4];
        let mut top = 0;
        loop {
            if near <= high as f32 {
                if part.count > 0 {
                    for place in part.first..part.first + part.count {
                        high = visit(place as usize, high);
                        if high < 0.0 {
                            return;
                        }
                    }
                } else {
                    let Pair { extents: [one, two], parts: [first, second] } =
                        &self.pairs[part.first as usize];
                    let limit = high as f32;
                    match (enter(one, from, inverse, limit), enter(two, from, inverse, limit)) {
                        (Some(a), Some(b)) => {
                            let (nearer, farther) =
                                if a <= b { ((first, a), (second, b)) } else { ((second, b), (first, a)) };
                            stack[top] = (*farther.0, farther.1);
                            top += 1;
                            (part, near) = (*nearer.0, nearer.1);
                            continue;
                        }
                        (Some(a), None) => {
                            (part, near) = (*first, a);
                            continue;
                        }
                        (None, Some(b)) => {
                            (part, near) = (*second, b);
                            continue;
                        }
                        (None, None) => {}
                    }
                }
            }
            if top == 0 {
                return;
            }
            top -= 1;
            (part, near) = stack[top];
        }
    }

    /// The nearest crossing with `low < t < high` and the place of its primitive.
    pub(super) fn nearest<'a>(
        &self,
        shape: impl Fn(usize) -> &'a Shape,
        origin: DVec3,
        direction: DVec3,
        low: f64,
        high: f64,
    ) -> Option<(usize, Crossing)> {
        let mut found = None;
        self.walk(origin, direction, high, |place, high| {
            match shape(place).crossing(origin, direction, low, high) {
                Some(crossing) => {
                    found = Some((place, crossing));
                    crossing.t
                }
                None => high,
            }
        });
        found
    }

    /// Returns true if anything is crossed with `low < t < high`.
    pub(super) fn any<'a>(
        &self,
        shape: impl Fn(usize) -> &'a Shape,
        origin: DVec3,
        direction: DVec3,
        low: f64,
        high: f64,
    ) -> bool {
        let mut found = false;
        self.walk(origin, direction, high, |place, high| {
            found = shape(place).crossing(origin, direction, low, high).is_some();
            if found { -1.0 } else { high }
        });
        found
    }
}

/// The distance at which a ray enters a box; `None` if it misses it or enters beyond `limit`.
#[inline]
fn enter(extent: &Extent, from: Vec3A, inverse: Vec3A, limit: f32) -> Option<f32> {
    let (one, two) = ((extent.lower - from) * inverse, (extent.upper - from) * inverse);
    let near = one.min(two).max_element().max(0.0);
    let far = one.max(two).min_element().min(limit);
    // Three roundings of f32 in each distance.
    (near <= far * 1.000_001).then_some(near)
}

/// Splits by the surface area heuristic; `None` if all centres fall together.
fn split(items: &mut [Item]) -> Option<usize> {
    let center = |item: &Item| (item.low + item.high) * 0.5;
    let (low, high) = items.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), item| {
        (low.min(center(item)), high.max(center(item)))
    });
    let extent = high - low;
    let mut best = (f64::INFINITY, 0, 0);
    for axis in 0..3 {
        if extent[axis] < 1e-9 {
            continue;
        }
        let mut bins = [(0usize, DVec3::INFINITY, DVec3::NEG_INFINITY); SPLIT_BINS];
        for item in items.iter() {
            let bin = &mut bins[bin_of(center(item)[axis], low[axis], extent[axis])];
            *bin = (bin.0 + 1, bin.1.min(item.low), bin.2.max(item.high));
        }
        let mut right = [(0usize, 0.0); SPLIT_BINS];
        let mut sum = (0, DVec3::INFINITY, DVec3::NEG_INFINITY);
        for at in (1..SPLIT_BINS).rev() {
            sum = (sum.0 + bins[at].0, sum.1.min(bins[at].1), sum.2.max(bins[at].2));
            right[at] = (sum.0, half_area(sum.1, sum.2));
        }
        let mut sum = (0, DVec3::INFINITY, DVec3::NEG_INFINITY);
        for at in 0..SPLIT_BINS - 1 {
            sum = (sum.0 + bins[at].0, sum.1.min(bins[at].1), sum.2.max(bins[at].2));
            let cost = sum.0 as f64 * half_area(sum.1, sum.2) + right[at + 1].0 as f64 * right[at + 1].1;
            if sum.0 > 0 && right[at + 1].0 > 0 && cost < best.0 {
                best = (cost, axis, at + 1);
            }
        }
    }
    let (cost, axis, bin) = best;
    if !cost.is_finite() {
        return None;
    }
    let mut middle = 0;
    for at in 0..items.len() {
        if bin_of(center(&items[at])[axis], low[axis], extent[axis]) < bin {
            items.swap(at, middle);
            middle += 1;
        }
    }
    Some(middle)
}

fn bin_of(value: f64, low: f64, extent: f64) -> usize {
    (((value - low) / extent * SPLIT_BINS as f64) as usize).min(SPLIT_BINS - 1)
}

fn half_area(low: DVec3, high: DVec3) -> f64 {
    if low.x > high.x {
        return 0.0;
    }
    let e = high - low;
    e.x * e.y + e.y * e.z + e.z * e.x
}

#[cfg(test)]
mod tests {
    use super::super::hash::Dice;
    use super::super::shape::Outline;
    use super::*;

    #[test]
    fn the_tree_finds_what_a_search_through_all_finds() {
        let mut dice = Dice::new(5, 0);
        let mut shapes: Vec<Shape> = (0..400)
            .map(|index| {
                let at = dice.direction() * dice.range(0.0, 20.0);
                let (u, v) = (dice.direction() * 2.0, dice.direction() * 1.5);
                match index % 3 {
                    0 => Shape::Flat { corner: at, u, v, outline: Outline::Parallelogram },
                    1 => Shape::Stump { from: at, to: at + u, radii: [0.4, 0.1] },
                    _ => Shape::Ellipsoid { center: at, radii: v.abs() + 0.05 },
                }
            })
            .collect();
        // Many at one place, where no split parts them.
        shapes.extend([shapes[0]; 9]);
        let (tree, order) = Bvh::build(shapes.iter().copied());
        let shapes: Vec<Shape> = order.into_iter().map(|index| shapes[index]).collect();
        for _ in 0..2000 {
            let (origin, direction) = (dice.direction() * 25.0, dice.direction());
            let all = shapes.iter().filter_map(|s| s.crossing(origin, direction, 0.0, 100.0)).map(|c| c.t);
            let nearest = all.min_by(f64::total_cmp);
            let found = tree.nearest(|place| &shapes[place], origin, direction, 0.0, 100.0);
            assert_eq!(found.map(|(_, crossing)| crossing.t), nearest);
            assert_eq!(tree.any(|place| &shapes[place], origin, direction, 0.0, 100.0), nearest.is_some());
        }
    }

    #[test]
    fn an_empty_tree_is_met_nowhere() {
        let (tree, order) = Bvh::build(std::iter::empty());
        assert!(order.is_empty());
        assert!(!tree.any(|_| unreachable!(), DVec3::ZERO, DVec3::X, 0.0, 1.0));
    }
}
