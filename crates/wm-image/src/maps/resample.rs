//! Maps in another size.
//!
//! Pixel centres lie at half integers, so that the corners of old and new picture meet. A new pixel
//! that any number which is not finite has a share in is not finite itself: infinite if all of them
//! are, else NaN. A depth between a wall and a hole would be no depth of either.

use super::error::MapFault;
use super::map::Map;

/// The filter with which pixels are made of those around them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Filter {
    /// The one whose middle is nearest.
    Nearest,
    /// The four around it, by their distance; those beyond the border are those at it.
    Bilinear,
    /// All that lie under it, by the share that is covered.
    Area,
}

impl Map {
    /// The map in the size of its photo, px; the same if it has that.
    ///
    /// # Errors
    /// [`MapFault::Aspect`] if the aspect ratios differ by more than 1 %.
    pub fn fitted(self, width: u32, height: u32, filter: Filter) -> Result<Self, MapFault> {
        if (self.width, self.height) == (width, height) {
            return Ok(self);
        }
        self.check_shape(width, height)?;
        Ok(self.resampled(width, height, filter))
    }

    /// The map in another size, px.
    ///
    /// # Panics
    /// If a side is 0.
    #[must_use]
    pub fn resampled(&self, width: u32, height: u32, filter: Filter) -> Self {
        assert!(width > 0 && height > 0, "a map of {width}x{height} px");
        if (width, height) == (self.width, self.height) {
            return self.clone();
        }
        let channels = self.channels as usize;
        let (columns, rows) = (taps(self.width, width, filter), taps(self.height, height, filter));
        let mut values = Vec::with_capacity(width as usize * height as usize * channels);
        for row in &rows {
            for column in &columns {
                for channel in 0..channels {
                    let mut mix = Mix::default();
                    for (y, down) in row {
                        for (x, across) in column {
                            let at = (y * self.width as usize + x) * channels + channel;
                            mix.add(down * across, self.values[at]);
                        }
                    }
                    values.push(mix.value());
                }
            }
        }
        Self { width, height, values, ..*self }
    }
}

/// A weighted sum that knows of numbers which are none.
#[derive(Default)]
struct Mix {
    sum: f64,
    finite: bool,
    infinite: Option<f32>,
    none: bool,
}

impl Mix {
    fn add(&mut self, weight: f64, value: f32) {
        if value.is_finite() {
            self.sum += weight * f64::from(value);
            self.finite = true;
        } else if value.is_nan() || self.infinite.is_some_and(|other| other != value) {
            self.none = true;
        } else {
            self.infinite = Some(value);
        }
    }

    fn value(&self) -> f32 {
        match self.infinite {
            _ if self.none => f32::NAN,
            Some(_) if self.finite => f32::NAN,
            Some(infinite) => infinite,
            None => self.sum as f32,
        }
    }
}

/// Along one side: for each new pixel the old ones that it is made of and their shares, all above
/// 0.
fn taps(from: u32, to: u32, filter: Filter) -> Vec<Vec<(usize, f64)>> {
    let scale = f64::from(from) / f64::from(to);
    let last = from as usize - 1;
    let of = |index: u32| {
        let (low, high) = (f64::from(index) * scale, f64::from(index + 1) * scale);
        let middle = 0.5 * (low + high);
        match filter {
            Filter::Nearest => vec![((middle as usize).min(last), 1.0)],
            Filter::Bilinear => {
                let place = (middle - 0.5).clamp(0.0, last as f64);
                let (first, share) = (place as usize, place.fract());
                // A pixel that has no share is none of it.
                if share == 0.0 { vec![(first, 1.0)] } else { vec![(first, 1.0 - share), (first + 1, share)] }
            }
            Filter::Area => {
                let covered = |old: usize| {
                    let share = high.min(old as f64 + 1.0) - low.max(old as f64);
                    // Borders that should meet are off by rounding.
                    (share > 1e-9 * scale).then_some((old, share / scale))
                };
                (low as usize..=(high as usize).min(last)).filter_map(covered).collect()
            }
        }
    };
    (0..to).map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn row(values: &[f32]) -> Map {
        Map::new(values.len() as u32, 1, 1, values.to_vec())
    }

    #[test]
    fn centres_lie_at_half_integers() {
        let map = row(&[0.0, 4.0]);
        assert_eq!(map.resampled(4, 1, Filter::Bilinear).values, [0.0, 1.0, 3.0, 4.0]);
        assert_eq!(map.resampled(4, 1, Filter::Nearest).values, [0.0, 0.0, 4.0, 4.0]);
        assert_eq!(map.resampled(1, 1, Filter::Area).values, [2.0]);
        assert_eq!(row(&[0.0, 3.0, 6.0]).resampled(2, 1, Filter::Area).values, [1.0, 5.0]);
        let colored = Map::new(2, 1, 2, vec![0.0, 10.0, 2.0, 20.0]);
        assert_eq!(colored.resampled(1, 3, Filter::Area).values, [1.0, 15.0, 1.0, 15.0, 1.0, 15.0]);
    }

    #[test]
    fn beside_a_hole_is_a_hole() {
        let inf = f32::INFINITY;
        for filter in [Filter::Nearest, Filter::Bilinear, Filter::Area] {
            let sky = row(&[inf, inf, inf]).resampled(5, 2, filter);
            assert!(sky.values.iter().all(|v| *v == inf), "{filter:?}");
        }
        let found = row(&[1.0, f32::NAN, 5.0, 7.0]).resampled(8, 1, Filter::Bilinear).values;
        let holes: Vec<bool> = found.iter().map(|v| v.is_nan()).collect();
        assert_eq!(holes, [false, true, true, true, true, false, false, false]);
        assert!(row(&[1.0, inf]).resampled(1, 1, Filter::Area).values[0].is_nan());
        assert!(row(&[-inf, inf]).resampled(1, 1, Filter::Area).values[0].is_nan());
    }

    proptest! {
        #[test]
        fn means_are_kept(
            (width, height) in (1..20u32, 1..15u32),
            (new_width, new_height) in (1..40u32, 1..30u32),
            values in prop::collection::vec(-5.0..5.0f32, 300),
        ) {
            let map = Map::new(width, height, 1, values[..(width * height) as usize].to_vec());
            let mean = |map: &Map| map.values.iter().map(|v| f64::from(*v)).sum::<f64>() / map.values.len() as f64;
            let area = map.resampled(new_width, new_height, Filter::Area);
            prop_assert!((mean(&area) - mean(&map)).abs() < 1e-5);
            for filter in [Filter::Nearest, Filter::Bilinear, Filter::Area] {
                let new = map.resampled(new_width, new_height, filter);
                prop_assert_eq!(new.values.len() as u32, new_width * new_height);
                let bound = map.values.iter().copied().fold(0.0, |a: f32, b| a.max(b.abs()));
                prop_assert!(new.values.iter().all(|v| v.abs() <= bound * 1.0001));
            }
        }
    }
}
