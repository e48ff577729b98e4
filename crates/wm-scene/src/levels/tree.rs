//! A binary tree over boxes.

use glam::DVec3;

/// An axis-aligned box.
#[derive(Clone, Copy, Debug)]
pub(super) struct Extent {
    /// Least coordinates.
    pub(super) low: [f32; 3],
    /// Greatest coordinates.
    pub(super) high: [f32; 3],
}

impl Extent {
    /// The box of nothing.
    const EMPTY: Self = Self { low: [f32::INFINITY; 3], high: [f32::NEG_INFINITY; 3] };

    /// The box of everything.
    pub(super) const ALL: Self = Self { low: [f32::NEG_INFINITY; 3], high: [f32::INFINITY; 3] };

    /// The smallest box that holds both.
    pub(super) fn union(self, other: Self) -> Self {
        Self {
            low: std::array::from_fn(|k| self.low[k].min(other.low[k])),
            high: std::array::from_fn(|k| self.high[k].max(other.high[k])),
        }
    }

    pub(super) fn middle(self) -> DVec3 {
        DVec3::from_array(std::array::from_fn(|k| 0.5 * (f64::from(self.low[k]) + f64::from(self.high[k]))))
    }

    /// Length of the diagonal.
    pub(super) fn diagonal(self) -> f64 {
        (0..3).map(|k| (f64::from(self.high[k]) - f64::from(self.low[k])).powi(2)).sum::<f64>().sqrt()
    }

    pub(super) fn is_finite(&self) -> bool {
        self.low.iter().chain(&self.high).all(|v| v.is_finite())
    }
}

/// A tree whose leaves are boxes, by their indices.
pub(super) enum BoxTree {
    Leaf(usize),
    Node(Extent, Box<[Self; 2]>),
}

impl BoxTree {
    /// The tree over `boxes`: each node has half of them, split across the longest side of their
    /// middles. `None` if there is none.
    pub(crate) fn of(boxes: &[Extent]) -> Option<Self> {
        let mut order: Vec<usize> = (0..boxes.len()).collect();
        (!boxes.is_empty()).then(|| Self::over(boxes, &mut order))
    }

    fn over(boxes: &[Extent], order: &mut [usize]) -> Self {
        if let [leaf] = *order {
            return Self::Leaf(leaf);
        }
        let middle = |leaf: usize, k: usize| 0.5 * boxes[leaf].low[k] + 0.5 * boxes[leaf].high[k];
        let side = |k: usize| {
            let (low, high) =
                order.iter().map(|leaf| middle(*leaf, k)).fold(EMPTY_RANGE, |(a, b), v| (a.min(v), b.max(v)));
            high - low
        };
        let sides = [0, 1, 2].map(side);
        let longest = (0..3).rev().max_by(|a, b| sides[*a].total_cmp(&sides[*b])).unwrap_or(0);
        let half = order.len() / 2;
        let key = |leaf: &usize| middle(*leaf, longest);
        order.select_nth_unstable_by(half, |a, b| key(a).total_cmp(&key(b)).then(a.cmp(b)));
        let (first, second) = order.split_at_mut(half);
        let both = first.iter().chain(&*second);
        let extent = both.fold(Extent::EMPTY, |extent, leaf| extent.union(boxes[*leaf]));
        Self::Node(extent, Box::new([Self::over(boxes, first), Self::over(boxes, second)]))
    }
}

/// The range of no numbers.
const EMPTY_RANGE: (f32, f32) = (f32::INFINITY, f32::NEG_INFINITY);
