//! A site that the tests of several modules share.

use crate::optics::{Daylight, Site};

/// A place in metres with z up.
pub const SITE: Site = Site {
    metres_per_unit: 1.0,
    up: [0.0, 0.0, 1.0],
    ground: 0.0,
    airlight: [0.8; 3],
    daylight: Daylight::Known,
    far: 100.0,
};
