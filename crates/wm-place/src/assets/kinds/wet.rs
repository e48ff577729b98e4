//! The surfaces that get wet.

use super::surfaces::SceneSurfaces;
use crate::Result;
use crate::assets::cache::AssetFile;
use crate::assets::kind::{Asset, AssetFiles, AssetKey, Keep, Workshop};
use wm_weather::light::CaptureLight;
use wm_weather::open_water::OpenWater;
use wm_weather::wetness::WetSurfaces;

impl Asset for WetSurfaces {
    type Key = ();

    const KEY: fn(Self::Key) -> AssetKey = AssetKey::Wet;
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
        let surfaces = workshop.get::<SceneSurfaces>(());
        let found = surfaces.of(source.splats()?);
        let capture = workshop.get::<CaptureLight>(());
        let water = workshop.get::<OpenWater>(());
        let (splats, path, is_up_known) = (source.splats()?, source.path(), source.is_up_known);
        Ok(Self::of(splats, &found, &capture, &water, path, is_up_known, &source.site))
    }
}
