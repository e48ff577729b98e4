//! A binary tree over boxes.

/// A box: its least and its greatest coordinates.
pub(super) type Extent = ([f32; 3], [f32; 3]);

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
        let middle = |leaf: usize, k: usize| 0.5 * boxes[leaf].0[k] + 0.5 * boxes[leaf].1[k];
        let side = |k: usize| {
            let (low, high) =
                order.iter().map(|leaf| middle(*leaf, k)).fold(EMPTY, |(a, b), v| (a.min(v), b.max(v)));
            high - low
        };
        let sides = [0, 1, 2].map(side);
        let longest = (0..3).rev().max_by(|a, b| sides[*a].total_cmp(&sides[*b])).unwrap_or(0);
        let half = order.len() / 2;
        let key = |leaf: &usize| middle(*leaf, longest);
        order.select_nth_unstable_by(half, |a, b| key(a).total_cmp(&key(b)).then(a.cmp(b)));
        let (first, second) = order.split_at_mut(half);
        let extent = first.iter().chain(&*second).fold(
            ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]),
            |(low, high), leaf| {
                let (a, b) = boxes[*leaf];
                (std::array::from_fn(|k| low[k].min(a[k])), std::array::from_fn(|k| high[k].max(b[k])))
            },
        );
        Self::Node(extent, Box::new([Self::over(boxes, first), Self::over(boxes, second)]))
    }
}

/// The range of no numbers.
const EMPTY: (f32, f32) = (f32::INFINITY, f32::NEG_INFINITY);
