//! The light of the capture, split into sun and sky.

use super::standing::StandingOccluders;
use crate::Result;
use crate::assets::AssetKey;
use crate::assets::cache::AssetFile;
use crate::assets::kind::{Asset, AssetFiles, Keep, Workshop};
use wm_scene::Camera;
use wm_weather::light::CaptureLight;

impl Asset for CaptureLight {
    const WORK: &'static str = "splitting the light of the capture into sun and sky";
    const FILES: Option<AssetFiles<Self>> = Some(AssetFiles {
        name: |()| AssetFile { word: "light", numbers: Vec::new() },
        read: |_, cache, file, splats| cache.get(file).filter(|found: &Self| found.is_consistent(splats)),
        write: |asset, cache, file| cache.put(file, asset),
    });
    const KEEP: Keep = Keep::Last(1);

    fn needs((): &()) -> Vec<AssetKey> {
        vec![AssetKey::Surfaces(()), AssetKey::Standing(())]
    }

    fn make((): &(), workshop: &Workshop<'_>) -> Result<Self> {
        let source = workshop.source;
        let found = workshop.surfaces()?;
        let standing = workshop.get::<StandingOccluders>(());
        let cameras: Vec<Camera> = source.scene.views.iter().map(|view| view.camera).collect();
        let (splats, sun, site) = (source.splats()?, source.known_sun, &source.site);
        Ok(Self::split(splats, &found, &standing.0, sun, &cameras, site))
    }
}
