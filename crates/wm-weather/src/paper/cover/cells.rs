//! Points by the cells of a grid, of spacings that differ by orders of magnitude.

/// End of a chain.
const END_OF_CHAIN: u32 = u32::MAX;

/// Points, hashed by cell. A point lies in a grid whose cells are 2 to 4 of its spacings wide.
pub(super) struct Cells {
    /// The last point of those whose cells share a hash.
    heads: Vec<u32>,
    /// The point before it.
    before: Vec<u32>,
    points: Vec<[f32; 3]>,
}

impl Cells {
    /// For about twice as many points as `expected`; more only take longer.
    pub(crate) fn new(expected: usize) -> Self {
        let heads = (2 * expected).next_power_of_two().clamp(16, 1 << 26);
        Self { heads: vec![END_OF_CHAIN; heads], before: Vec::new(), points: Vec::new() }
    }

    /// Adds a point, unless its spacing is no number above 0.
    pub(crate) fn add(&mut self, at: [f32; 3], spacing: f64) {
        if !(spacing > 0.0 && spacing.is_finite()) || self.points.len() >= END_OF_CHAIN as usize {
            return;
        }
        let level = level(spacing);
        let head = self.head(at.map(|v| cell(f64::from(v), level)), level);
        self.before.push(self.heads[head]);
        self.heads[head] = self.points.len() as u32;
        self.points.push(at);
    }

    /// Returns true if no point is nearer than `spacing`, of those whose own is not less than half
    /// or more than twice as large.
    pub(crate) fn is_free(&self, at: [f32; 3], spacing: f64) -> bool {
        let level = level(spacing);
        (level - 1..=level + 1).all(|level| {
            let [x, y, z] = at.map(f64::from).map(|v| cell(v - spacing, level)..=cell(v + spacing, level));
            x.into_iter().all(|x| {
                y.clone().all(|y| z.clone().all(|z| self.is_far(self.head([x, y, z], level), at, spacing)))
            })
        })
    }

    fn is_far(&self, head: usize, at: [f32; 3], spacing: f64) -> bool {
        let mut next = self.heads[head];
        while next != END_OF_CHAIN {
            let other = self.points[next as usize];
            let squared: f64 = (0..3).map(|k| (f64::from(other[k]) - f64::from(at[k])).powi(2)).sum();
            if squared < spacing * spacing {
                return false;
            }
            next = self.before[next as usize];
        }
        true
    }

    /// Cells of one hash share a chain: points are told apart by their distance.
    fn head(&self, cell: [i64; 3], level: i32) -> usize {
        let mix = |hash: u64, v: i64| (hash ^ v as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29);
        let hash = cell.into_iter().fold(mix(0, i64::from(level)), mix);
        (hash.wrapping_mul(0xd1b5_4a32_d192_ed03) >> 32) as usize & (self.heads.len() - 1)
    }
}

/// The least power of two that is not below a spacing.
fn level(spacing: f64) -> i32 {
    spacing.log2().ceil() as i32
}

/// The number of a cell of two such powers.
fn cell(v: f64, level: i32) -> i64 {
    (v / 2f64.powi(level + 1)).floor() as i64
}
