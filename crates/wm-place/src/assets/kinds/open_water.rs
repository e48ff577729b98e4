//! The open water of the photos, where nothing lies and nothing gets wet.

use crate::Result;
use crate::assets::AssetKey;
use crate::assets::kind::{Asset, Keep, Workshop};
use wm_weather::open_water::OpenWater;

impl Asset for OpenWater {
    const WORK: &'static str = "finding open water";
    const KEEP: Keep = Keep::No;

    fn needs((): &()) -> Vec<AssetKey> {
        vec![AssetKey::Surfaces(())]
    }

    fn make((): &(), workshop: &Workshop<'_>) -> Result<Self> {
        let source = workshop.source;
        let metadata = &source.scene.metadata;
        let found = workshop.surfaces()?;
        let mut water = Self::of(&found.splats, metadata.water.as_deref(), &source.site);
        water.add_labelled(source.splats()?, metadata.water_labels.as_deref().unwrap_or_default());
        Ok(water)
    }
}
