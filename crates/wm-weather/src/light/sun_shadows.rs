//! The shadows of a sun that stands elsewhere than when the place was captured.
//!
//! They come from one map of what stands in the sun's way, as fine as the surfaces of the scene
//! are, and their edges are as wide as the sun makes them from where they are cast.

use serde::{Deserialize, Serialize};

/// The share of one sun that each splat of a scene sees.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SunShadows {
    /// Towards the sun, world axes, length 1.
    pub(super) direction: [f64; 3],
    /// 255 is all of the sun.
    pub(super) seen: Vec<u8>,
    /// Mean over the splats of the sun's incidence times its share.
    pub(super) mean: f64,
}

impl SunShadows {
    /// Towards the sun, world axes, length 1.
    #[must_use]
    pub fn direction(&self) -> [f64; 3] {
        self.direction
    }

    /// The number of splats.
    #[must_use]
    pub fn len(&self) -> usize {
        self.seen.len()
    }

    /// Returns true if it has no splats.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.seen.is_empty()
    }

    /// The share of the sun that a splat sees, 0-1.
    pub(crate) fn seen(&self, index: usize) -> f32 {
        f32::from(self.seen[index]) / 255.0
    }
}
