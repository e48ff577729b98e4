//! The surfaces that get wet.

use crate::Result;
use crate::assets::AssetKey;
use crate::assets::cache::AssetFile;
use crate::assets::kind::{Asset, AssetFiles, Keep, Workshop};
use wm_weather::light::CaptureLight;
use wm_weather::open_water::OpenWater;
use wm_weather::wetness::WetSurfaces;

impl Asset for WetSurfaces {
    const WORK: &'static str = "finding what gets wet";
    const FILES: Option<AssetFiles<Self>> = Some(AssetFiles {
        name: |()| AssetFile { word: "wet", numbers: Vec::new() },
        read: |_, cache, file, splats| cache.get(file).filter(|found: &Self| found.is_consistent(splats)),
        write: |asset, cache, file| cache.put(file, asset),
    });
    const KEEP: Keep = Keep::Last(1);

    fn needs((): &()) -> Vec<AssetKey> {
        vec![AssetKey::Surfaces(()), AssetKey::Light(()), AssetKey::OpenWater(())]
    }

    fn make((): &(), workshop: &Workshop<'_>) -> Result<Self> {
        let source = workshop.source;
        let found = workshop.surfaces()?;
        let capture = workshop.get::<CaptureLight>(());
        let water = workshop.get::<OpenWater>(());
        let (splats, path, is_up_known) = (source.splats()?, source.path(), source.is_up_known);
        Ok(Self::of(splats, &found, capture, water, path, is_up_known, &source.site))
    }
}
