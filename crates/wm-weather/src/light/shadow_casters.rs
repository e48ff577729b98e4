//! The surfaces that cast the shadows of a sun, and those shadows.

use super::capture::CaptureLight;
use super::sun_search::sun_map;
use super::sun_shadows::SunShadows;
use crate::optics::Site;
use crate::shelter::{Occluders, SUN};
use crate::threads::map;
use glam::Vec3;

/// Limits of the width of a map's cells, in those of the occluders, which have the width of the
/// surfaces' spacing between them.
const CELL_RATIO_LIMITS: [f64; 2] = [0.25, 1.0];

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
        let occluders = occluders.coarser(fine.clamp(CELL_RATIO_LIMITS[0], CELL_RATIO_LIMITS[1]));
        Self { occluders, points }
    }
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
}
