//! All that casts the shadows of suns, for a sun that moves.

use super::standing::StandingOccluders;
use crate::Result;
use crate::assets::AssetKey;
use crate::assets::kind::{Asset, Keep, Workshop};
use wm_weather::light::ShadowCasters;

impl Asset for ShadowCasters {
    const WORK: &'static str = "casting the shadows of the sun";
    const KEEP: Keep = Keep::IfAsked;
    const DRAFTS_DO_WITHOUT: bool = true;

    fn needs((): &()) -> Vec<AssetKey> {
        vec![AssetKey::Surfaces(()), AssetKey::Standing(())]
    }

    fn make((): &(), workshop: &Workshop<'_>) -> Result<Self> {
        let source = workshop.source;
        let found = workshop.surfaces()?;
        let standing = workshop.get::<StandingOccluders>(());
        let points = found.places(source.splats()?).to_vec();
        Ok(Self::new(points, &standing.0))
    }
}
