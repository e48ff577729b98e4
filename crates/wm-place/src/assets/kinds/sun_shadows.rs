//! The shadows of a sun, by the direction towards it.

use crate::Result;
use crate::assets::AssetKey;
use crate::assets::cache::AssetFile;
use crate::assets::kind::{Asset, AssetFiles, Keep, Workshop};
use wm_weather::light::{CaptureLight, ShadowCasters, SunShadows};

/// Places of the sun whose shadows are kept.
const MAX_SUNS: usize = 4;

impl Asset for SunShadows {
    const WORK: &'static str = "casting the shadows of the sun";
    const FILES: Option<AssetFiles<Self>> = Some(AssetFiles {
        name: |sun| AssetFile { word: "sun", numbers: sun.to_vec() },
        read: |_, cache, file, splats| cache.get(file).filter(|found: &Self| found.len() == splats),
        write: |asset, cache, file| cache.put(file, asset),
    });
    const KEEP: Keep = Keep::Last(MAX_SUNS);
    const DRAFTS_DO_WITHOUT: bool = true;

    fn needs(_: &[f64; 3]) -> Vec<AssetKey> {
        vec![AssetKey::Light(()), AssetKey::Casters(())]
    }

    fn make(sun: &[f64; 3], workshop: &Workshop<'_>) -> Result<Self> {
        let source = workshop.source;
        let capture = workshop.get::<CaptureLight>(());
        let casters = workshop.get::<ShadowCasters>(());
        Ok(Self::of(casters, capture, *sun, &source.site))
    }
}
