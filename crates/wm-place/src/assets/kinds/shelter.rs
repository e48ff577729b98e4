//! The map of where a fall leaves the ground dry, by its direction.

use crate::Result;
use crate::assets::cache::{AssetCache, AssetFile};
use crate::assets::kind::{Asset, AssetKey, Cost, Keep, Workshop};
use wm_weather::shelter::{Occluders, Shelter};

/// Directions of fall whose maps are kept: enough for a wind that turns.
const MAX_FALLS: usize = 6;

impl Asset for Shelter {
    type Key = [f64; 3];

    const KEY: fn(Self::Key) -> AssetKey = AssetKey::Shelter;
    const WORK: &'static str = "finding where roofs keep the rain off";
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

    fn file(fall: &[f64; 3]) -> Option<AssetFile> {
        Some(AssetFile { word: "shelter", numbers: fall.to_vec() })
    }

    fn read(fall: &[f64; 3], cache: &AssetCache, _: usize) -> Option<Self> {
        cache.get::<Self>(&Self::file(fall)?).filter(Self::is_consistent)
    }

    fn write(&self, fall: &[f64; 3], cache: &AssetCache) {
        cache.put(Self::file(fall), self);
    }
}
