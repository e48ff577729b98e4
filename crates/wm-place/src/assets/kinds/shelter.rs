//! The map of where a fall leaves the ground dry, by its direction.

use crate::Result;
use crate::assets::AssetKey;
use crate::assets::cache::AssetFile;
use crate::assets::kind::{Asset, AssetFiles, Cost, Keep, Workshop};
use wm_weather::shelter::{Occluders, Shelter};

/// Directions of fall whose maps are kept: enough for a wind that turns.
const MAX_FALLS: usize = 6;

impl Asset for Shelter {
    const WORK: &'static str = "finding where roofs keep the rain off";
    const FILES: Option<AssetFiles<Self>> = Some(AssetFiles {
        name: |fall| AssetFile { word: "shelter", numbers: fall.to_vec() },
        read: |_, cache, file, _| cache.get(file).filter(|found: &Self| found.is_consistent()),
        write: |asset, cache, file| cache.put(file, asset),
    });
    const KEEP: Keep = Keep::Last(MAX_FALLS);

    fn cost(_: &[f64; 3]) -> Cost {
        Cost::Quick
    }

    fn needs(_: &[f64; 3]) -> Vec<AssetKey> {
        vec![AssetKey::Occluders(())]
    }

    fn make(fall: &[f64; 3], workshop: &Workshop<'_>) -> Result<Self> {
        Ok(workshop.get::<Occluders>(()).shelter(*fall))
    }
}
