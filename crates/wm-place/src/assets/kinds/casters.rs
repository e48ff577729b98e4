//! All that casts the shadows of suns, for a sun that moves.

use super::standing::StandingOccluders;
use super::surfaces::SceneSurfaces;
use crate::Result;
use crate::assets::kind::{Asset, AssetKey, Keep, Workshop};
use wm_weather::light::ShadowCasters;

impl Asset for ShadowCasters {
    type Key = ();

    const KEY: fn(Self::Key) -> AssetKey = AssetKey::Casters;
    const WORK: &'static str = "casting the shadows of the sun";
    const KEEP: Keep = Keep::IfAsked;
    const DRAFTS_DO_WITHOUT: bool = true;

    fn needs((): &()) -> Vec<AssetKey> {
        vec![AssetKey::Surfaces(()), AssetKey::Standing(())]
    }

    fn make((): &(), workshop: &Workshop<'_>) -> Result<Self> {
        let source = workshop.source;
        let surfaces = workshop.get::<SceneSurfaces>(());
        let found = surfaces.of(source.splats()?);
        let standing = workshop.get::<StandingOccluders>(());
        let points = found.places(source.splats()?).to_vec();
        Ok(Self::new(points, &standing.0))
    }
}
