//! The shadows of a sun that stands elsewhere than when the place was captured.
//!
//! They come from one map of what stands in the sun's way, as fine as the surfaces of the scene
//! are, and their edges are as wide as the sun makes them from where they are cast.

use super::capture::CaptureLight;
use super::sun_search::sun_map;
use crate::optics::Site;
use crate::shelter::{Occluders, SUN};
use crate::threads::map;
use glam::Vec3;
use serde::{Deserialize, Serialize};

/// Limits of the width of a map's cells, in those of the occluders, which have the width of the
/// surfaces' spacing between them.
const CELLS: [f64; 2] = [0.25, 1.0];

/// All that the shadows of any sun are made from, but for the light of the capture.
#[derive(Clone, Debug)]
pub struct ShadowCasters {
    occluders: Occluders,
    /// The places of the splats, world axes, scene units.
    points: Vec<[f32; 3]>,
}

impl ShadowCasters {
    /// The places of the splats of a scene (world axes, scene units), and what stands between them
    /// and the sky.
    #[must_use]
    pub fn new(points: Vec<[f32; 3]>, occluders: &Occluders) -> Self {
        let fine = occluders.spacing() / occluders.cell();
        let occluders = occluders.coarser(fine.clamp(CELLS[0], CELLS[1]));
        Self { occluders, points }
    }
}

/// The share of one sun that each splat of a scene sees.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SunShadows {
    /// Towards the sun, world axes, length 1.
    direction: [f64; 3],
    /// 255 is all of the sun.
    seen: Vec<u8>,
    /// Mean over the splats of the sun's incidence times its share.
    pub(super) mean: f64,
}

impl SunShadows {
    /// The shadows that `casters` cast on the splats of a scene. `direction` is towards the sun,
    /// world axes, length 1.
    #[must_use]
    pub fn of(casters: &ShadowCasters, capture: &CaptureLight, direction: [f64; 3], site: &Site) -> Self {
        let shadow_map = sun_map(&casters.occluders, direction);
        let seen = map(casters.points.len(), |index| {
            let point = Vec3::from_array(casters.points[index]);
            (255.0 * shadow_map.lit(point, capture.normal(index), SUN)).round() as u8
        });
        let mut shadows = Self { direction, seen, mean: 0.0 };
        let (mut sum, mut count) = (0.0, 0.0f64);
        for index in (0..casters.points.len()).filter(|index| !capture.is_sky(*index)) {
            let surface = capture.surface_beside(index, capture.normal(index), site.up, Some(&shadows));
            sum += surface.incidence * surface.sun;
            count += 1.0;
        }
        shadows.mean = sum / count.max(1.0);
        shadows
    }

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
