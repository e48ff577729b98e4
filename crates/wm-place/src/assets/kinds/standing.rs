//! Occluders of the sun: the surfaces that cast shadows, without what hangs in the air.

use crate::Result;
use crate::assets::AssetKey;
use crate::assets::kind::{Asset, Keep, Workshop};
use wm_weather::shelter::{Occluders, ShelterOptions};

/// Distance from the photos' path up to which the light is split finely, m.
const LIGHT_REACH_M: f64 = 60.0;

/// The surfaces that cast shadows.
pub(crate) struct StandingOccluders(pub Occluders);

impl Asset for StandingOccluders {
    const WORK: &'static str = "finding what casts shadows";
    const KEEP: Keep = Keep::No;

    fn needs((): &()) -> Vec<AssetKey> {
        vec![AssetKey::Surfaces(())]
    }

    fn make((): &(), workshop: &Workshop<'_>) -> Result<Self> {
        let source = workshop.source;
        let found = workshop.surfaces()?;
        let focus = Some((source.path(), LIGHT_REACH_M));
        let options = ShelterOptions { focus, ..ShelterOptions::default() };
        Ok(Self(Occluders::of(&found.casters(), &source.site, &options).standing()))
    }
}
