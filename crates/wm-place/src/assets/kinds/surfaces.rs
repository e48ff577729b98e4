//! The surfaces that the photos show.

use crate::Result;
use crate::assets::cache::AssetFile;
use crate::assets::kind::{Asset, AssetFiles, AssetKey, Keep, Workshop};
use std::ops::Deref;
use wm_scene::Splats;
use wm_weather::fused_surfaces::{FusedSurfaces, GroundField};

/// The surfaces of a scene; without photos they are its splats themselves.
pub(crate) struct SceneSurfaces(Option<FusedSurfaces<'static>>);

/// The surfaces of a scene whose splats are at hand.
pub(crate) enum SurfacesOf<'a> {
    Fused(&'a FusedSurfaces<'static>),
    Splats(Box<FusedSurfaces<'a>>),
}

impl<'a> Deref for SurfacesOf<'a> {
    type Target = FusedSurfaces<'a>;

    fn deref(&self) -> &FusedSurfaces<'a> {
        match self {
            Self::Fused(found) => found,
            Self::Splats(found) => found,
        }
    }
}

impl SceneSurfaces {
    pub fn of<'a>(&'a self, splats: &'a Splats) -> SurfacesOf<'a> {
        match &self.0 {
            Some(found) => SurfacesOf::Fused(found),
            None => SurfacesOf::Splats(Box::new(FusedSurfaces::from_splats(splats))),
        }
    }
}

impl Asset for SceneSurfaces {
    type Key = ();

    const KEY: fn(Self::Key) -> AssetKey = AssetKey::Surfaces;
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
