//! Points of a reconstruction.

/// The points of a reconstruction, structure of arrays, all of equal length N.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SparsePoints {
    /// `[N, 3]`, world axes, scene units.
    pub positions: Vec<[f64; 3]>,
    /// `[N, 3]`, sRGB.
    pub colors: Vec<[u8; 3]>,
    /// Mean distance between where a point was seen and where it falls, px; NaN where not known.
    pub errors: Vec<f32>,
    /// The number of photos in which a point was seen; 0 where not known.
    pub track_lengths: Vec<u32>,
}

impl SparsePoints {
    /// The number of points.
    #[must_use]
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Returns true if there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Appends a point.
    pub fn push(&mut self, position: [f64; 3], color: [u8; 3], error: f32, track_length: u32) {
        self.positions.push(position);
        self.colors.push(color);
        self.errors.push(error);
        self.track_lengths.push(track_length);
    }
}
