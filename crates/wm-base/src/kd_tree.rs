//! The nearest of many points in space.

use std::cmp::Ordering;
use std::ops::{Add, Mul, Sub};

/// Most points of a part of a tree that is searched one by one.
const LEAF_POINTS: usize = 16;

/// A k-d tree: each part of the points has its median along one axis in its middle, what is below
/// before it and what is above behind it; the axes take turns.
#[derive(Clone, Debug)]
pub struct KdTree<T> {
    points: Vec<TreePoint<T>>,
}

#[derive(Clone, Copy, Debug)]
struct TreePoint<T> {
    place: [T; 3],
    index: u32,
    /// Smallest index in the part that has this point in its middle.
    least: u32,
}

/// A point that was found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Neighbour<T> {
    /// Squared distance.
    pub square: T,
    /// Index among the points of the tree.
    pub index: u32,
}

struct Search<'a, T> {
    at: &'a [T; 3],
    count: usize,
    found: Vec<Neighbour<T>>,
}

impl<T> KdTree<T>
where
    T: Copy + Default + PartialOrd + Add<Output = T> + Sub<Output = T> + Mul<Output = T>,
{
    /// Sorts points, none of which is NaN, into a tree.
    pub fn new(points: &[[T; 3]]) -> Self {
        let mut points: Vec<_> = (0..)
            .zip(points)
            .map(|(index, place)| TreePoint { place: *place, index, least: index })
            .collect();
        sort(&mut points, 0);
        Self { points }
    }

    /// Returns the `count` points that are nearest to a place, or all, the nearest first; of
    /// equally near ones, those that come first among the points.
    pub fn nearest(&self, at: &[T; 3], count: usize) -> Vec<Neighbour<T>> {
        let mut search = Search { at, count, found: Vec::with_capacity(count.min(self.points.len())) };
        if count > 0 {
            search.visit(&self.points, 0, [T::default(); 3]);
        }
        search.found
    }
}

fn sort<T: PartialOrd>(part: &mut [TreePoint<T>], axis: usize) {
    let Some(least) = part.iter().map(|point| point.index).min() else { return };
    if part.len() > LEAF_POINTS {
        // Points that share a place stand by index, so that a search need not look at all of them.
        let along = |a: &TreePoint<T>, b: &TreePoint<T>| {
            let order = a.place[axis].partial_cmp(&b.place[axis]).unwrap_or(Ordering::Equal);
            order.then(a.index.cmp(&b.index))
        };
        let (below, _, above) = part.select_nth_unstable_by(part.len() / 2, along);
        sort(below, (axis + 1) % 3);
        sort(above, (axis + 1) % 3);
    }
    part[part.len() / 2].least = least;
}

impl<T> Search<'_, T>
where
    T: Copy + PartialOrd + Add<Output = T> + Sub<Output = T> + Mul<Output = T>,
{
    /// Looks through a part of the tree, `offsets` away from the place along each axis or more.
    fn visit(&mut self, part: &[TreePoint<T>], axis: usize, mut offsets: [T; 3]) {
        if part.len() <= LEAF_POINTS {
            part.iter().for_each(|point| self.offer(point));
            return;
        }
        let (below, rest) = part.split_at(part.len() / 2);
        let (middle, above) = (&rest[0], &rest[1..]);
        let offset = self.at[axis] - middle.place[axis];
        let (near, far) = if self.at[axis] <= middle.place[axis] { (below, above) } else { (above, below) };
        self.visit(near, (axis + 1) % 3, offsets);
        self.offer(middle);
        offsets[axis] = offset;
        // Rounding never makes a sum of squares smaller than one of smaller numbers.
        if self.is_wanted(square(offsets), far[far.len() / 2].least) {
            self.visit(far, (axis + 1) % 3, offsets);
        }
    }

    fn is_wanted(&self, square: T, index: u32) -> bool {
        let last = (self.found.len() == self.count).then(|| self.found[self.count - 1]);
        last.is_none_or(|last| Neighbour { square, index }.is_before(&last))
    }

    fn offer(&mut self, point: &TreePoint<T>) {
        let square = square(std::array::from_fn(|axis| self.at[axis] - point.place[axis]));
        if self.is_wanted(square, point.index) {
            self.found.truncate(self.count - 1);
            let new = Neighbour { square, index: point.index };
            let slot = self.found.iter().rposition(|found| found.is_before(&new)).map_or(0, |slot| slot + 1);
            self.found.insert(slot, new);
        }
    }
}

impl<T: PartialOrd> Neighbour<T> {
    fn is_before(&self, other: &Self) -> bool {
        self.square < other.square || self.square == other.square && self.index < other.index
    }
}

fn square<T: Copy + Add<Output = T> + Mul<Output = T>>([x, y, z]: [T; 3]) -> T {
    x * x + y * y + z * z
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn places(count: std::ops::Range<usize>) -> impl Strategy<Value = Vec<[f32; 3]>> {
        let coordinate = (0..6u8).prop_map(f32::from);
        prop::collection::vec([coordinate.clone(), coordinate.clone(), coordinate], count)
    }

    proptest! {
        /// Many are equally near here, and many share a place.
        #[test]
        fn the_nearest_are_those_of_a_search_one_by_one(
            points in places(0..300), at in places(1..2), count in 0..9usize
        ) {
            let at = at[0];
            let mut all: Vec<(f32, u32)> = (0..)
                .zip(&points)
                .map(|(index, point)| (square(std::array::from_fn(|axis| at[axis] - point[axis])), index))
                .collect();
            all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            all.truncate(count);
            let found = KdTree::new(&points).nearest(&at, count);
            prop_assert_eq!(found.iter().map(|n| (n.square, n.index)).collect::<Vec<_>>(), all);
        }
    }

    #[test]
    fn points_in_one_place_are_found_at_once() {
        let tree = KdTree::new(&[[1.0; 3]; 100_000]);
        for _ in 0..10_000 {
            assert_eq!(tree.nearest(&[1.0; 3], 2).iter().map(|n| n.index).collect::<Vec<_>>(), [0, 1]);
        }
    }
}
