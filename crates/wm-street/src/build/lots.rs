//! The plots along the street.

use super::builder::Frame;
use glam::DVec3;

/// From the middle to the outer edge of the pavement, m.
pub(super) const PAVEMENT_EDGE_M: f64 = 5.2;
/// Height of pavements and plots above the carriageway, m.
pub(super) const PLOT_HEIGHT_M: f64 = 0.12;

/// The frame of a plot that begins at `y` on the left (x < 0) of the street.
pub(super) fn left(y: f64) -> Frame {
    Frame::facing(DVec3::new(-PAVEMENT_EDGE_M, y, PLOT_HEIGHT_M), -DVec3::X)
}

/// The frame of a plot that ends at `y` on the right: its x runs towards smaller y.
pub(super) fn right(y: f64) -> Frame {
    Frame::facing(DVec3::new(PAVEMENT_EDGE_M, y, PLOT_HEIGHT_M), DVec3::X)
}
