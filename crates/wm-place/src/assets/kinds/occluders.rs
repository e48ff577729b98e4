//! The surfaces that may stop what falls: roofs and crowns.

use crate::Result;
use crate::assets::kind::{Asset, Keep, Workshop};
use wm_weather::fused_surfaces::FusedSurfaces;
use wm_weather::shelter::{Occluders, ShelterOptions};

/// Distance from the cameras' path up to which roofs keep rain off in a place that reaches far
/// beyond what they see, m: falling drops are drawn nearer than that.
const SHELTER_REACH_M: f64 = 100.0;

impl Asset for Occluders {
    const WORK: &'static str = "finding where roofs keep the rain off";
    const KEEP: Keep = Keep::Last(1);

    fn make((): &(), workshop: &Workshop<'_>) -> Result<Self> {
        let source = workshop.source;
        let (splats, site) = (source.splats()?, &source.site);
        let found = FusedSurfaces::from_views(splats, &source.views.shelter, site);
        let focus = source.path.map(|path| (path, SHELTER_REACH_M));
        Ok(Self::of(&found.splats, site, &ShelterOptions { focus, ..ShelterOptions::default() }))
    }
}
