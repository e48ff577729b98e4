//! The pixels in which a frame and a prior are compared: those of the coarser of the two.

use crate::priors::Prior;

/// Pairs of pixels of a frame and a prior.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Grid {
    /// Columns.
    pub(crate) width: usize,
    /// Rows.
    pub(crate) height: usize,
    columns: Vec<(u32, u32)>,
    rows: Vec<(u32, u32)>,
}

impl Grid {
    /// Returns the grid for a frame of `size` and a prior of the same view.
    pub(crate) fn new(size: (u32, u32), prior: &Prior) -> Self {
        let pairs = |frame: u32, prior: u32| -> Vec<(u32, u32)> {
            let count = frame.min(prior);
            let at = |i: u32, of: u32| {
                (u64::from(2 * i + 1) * u64::from(of) / u64::from(2 * count)).min(u64::from(of) - 1) as u32
            };
            (0..count).map(|i| (at(i, frame), at(i, prior))).collect()
        };
        let (columns, rows) = (pairs(size.0, prior.width), pairs(size.1, prior.height));
        let rows = rows.into_iter().map(|(f, p)| (f * size.0, p * prior.width)).collect::<Vec<_>>();
        Self { width: columns.len(), height: rows.len(), columns, rows }
    }

    /// Returns the number of pairs.
    pub(crate) fn len(&self) -> usize {
        self.width * self.height
    }

    /// Returns the indices of a pair in one-channel arrays of the frame and of the prior.
    #[inline(always)]
    pub(crate) fn at(&self, column: usize, row: usize) -> (usize, usize) {
        let ((x, u), (y, v)) = (self.columns[column], self.rows[row]);
        ((y + x) as usize, (v + u) as usize)
    }

    /// Iterates over all pairs, row by row.
    pub(crate) fn pairs(&self) -> impl Iterator<Item = (usize, usize)> {
        (0..self.height).flat_map(move |row| (0..self.width).map(move |column| self.at(column, row)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_grid_is_that_of_the_coarser_image() {
        let frame = (6, 4);
        let prior = Prior { width: 3, height: 2, ..Prior::default() };
        let grid = Grid::new(frame, &prior);
        assert_eq!((grid.width, grid.height, grid.len()), (3, 2, 6));
        // The middle of a pixel of the prior is the corner of four of the frame's.
        assert_eq!(grid.pairs().collect::<Vec<_>>(), [(7, 0), (9, 1), (11, 2), (19, 3), (21, 4), (23, 5)]);
        let fine = Prior { width: 12, height: 8, ..Prior::default() };
        assert_eq!(Grid::new(frame, &fine).at(1, 1), (7, 39));
    }
}
