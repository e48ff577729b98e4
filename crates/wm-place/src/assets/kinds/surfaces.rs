//! The surfaces that the photos show.

use crate::Result;
use crate::assets::cache::AssetFile;
use crate::assets::kind::{Asset, AssetFiles, Keep, Workshop};
use std::borrow::Cow;
use wm_scene::Splats;
use wm_weather::fused_surfaces::{FusedSurfaces, GroundField};

/// The surfaces of a scene; without photos they are its splats themselves.
pub(crate) struct SceneSurfaces(Option<FusedSurfaces<'static>>);

impl SceneSurfaces {
    /// The surfaces of the scene with these splats.
    pub fn of<'a>(&'a self, splats: &'a Splats) -> Cow<'a, FusedSurfaces<'a>> {
        match &self.0 {
            Some(found) => Cow::Borrowed(found),
            None => Cow::Owned(FusedSurfaces::from_splats(splats)),
        }
    }
}

impl Asset for SceneSurfaces {
    const WORK: &'static str = "finding the surfaces that the photos show";
    const FILES: Option<AssetFiles<Self>> = Some(AssetFiles {
        name: |()| AssetFile { word: "surfaces", numbers: Vec::new() },
        read: |(), cache, file, splats| {
            let found: FusedSurfaces<'static> = cache.get(file)?;
            found.is_consistent(splats).then_some(Self(Some(found)))
        },
        write: |surfaces, cache, file| {
            if let Some(found) = &surfaces.0 {
                cache.put(file, found);
            }
        },
    });
    const KEEP: Keep = Keep::No;

    fn make((): &(), workshop: &Workshop<'_>) -> Result<Self> {
        let source = workshop.source;
        let (splats, site) = (source.splats()?, &source.site);
        if source.views.cover.is_empty() {
            return Ok(Self(None));
        }
        let on_ground = GroundField::snap(&source.views.cover, site.up, site.metres_per_unit);
        Ok(Self(Some(FusedSurfaces::from_views(splats, &on_ground, site).into_owned())))
    }
}

impl Workshop<'_> {
    /// The surfaces of the scene, for an asset that needs [`SceneSurfaces`].
    ///
    /// # Errors
    /// As [`AssetSource::splats`](crate::assets::AssetSource::splats).
    pub fn surfaces(&self) -> Result<Cow<'_, FusedSurfaces<'_>>> {
        Ok(self.get::<SceneSurfaces>(()).of(self.source.splats()?))
    }
}
