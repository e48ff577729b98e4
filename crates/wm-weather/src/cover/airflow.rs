//! The effect of the wind on what lies.

/// The effect of the wind on what falls and on what has fallen.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Airflow {
    /// Sideways drift for each metre of fall, along [`level_axes`](crate::level::level_axes).
    pub slope: [f64; 2],
    /// Share of what falls in the open that the wind carries on along the ground, 0-1.
    pub moved: f64,
}
