//! The kinds of assets, a file each, and what is done with a kind by its key.

mod casters;
mod cover;
mod lamps;
mod light;
mod lying;
mod occluders;
mod open_water;
mod shelter;
mod standing;
mod sun_shadows;
mod surfaces;
mod wet;

pub(crate) use cover::lock;

use super::cache::{AssetCache, AssetFile};
use super::key::{AnyAsset, AssetKey, LyingKey};
use super::kind::{Asset, Cost, Keep, Keyed, Workshop};
use crate::Result;
use standing::StandingOccluders;
use std::any::TypeId;
use std::sync::{Arc, Mutex};
use surfaces::SceneSurfaces;
use wm_weather::cover::{Airflow, Cover, LyingCover};
use wm_weather::light::{CaptureLight, LampLights, LampShadows, ShadowCasters, SunShadows};
use wm_weather::open_water::OpenWater;
use wm_weather::shelter::{Occluders, Shelter};
use wm_weather::wetness::WetSurfaces;

/// The kind of an asset, whatever its key: see [`Asset`].
pub(crate) struct AssetKind {
    pub type_id: TypeId,
    pub work: &'static str,
    pub keep: Keep,
    pub drafts_do_without: bool,
    pub file_comes_last: bool,
}

impl AssetKind {
    pub fn of<A: Asset>() -> Self {
        Self {
            type_id: TypeId::of::<A>(),
            work: A::WORK,
            keep: A::KEEP,
            drafts_do_without: A::DRAFTS_DO_WITHOUT,
            file_comes_last: A::FILE_COMES_LAST,
        }
    }
}

macro_rules! dispatch {
    ($($kind:ident($key:ty) => $asset:ty,)*) => {
        $(impl Keyed for $asset {
            type Key = $key;
            const KEY: fn(Self::Key) -> AssetKey = AssetKey::$kind;
        })*

        impl AssetKey {
            pub fn kind(&self) -> AssetKind {
                match self { $(Self::$kind(_) => AssetKind::of::<$asset>(),)* }
            }

            /// The place of the kind in the list.
            pub fn rank(&self) -> Option<usize> {
                let own = self.kind().type_id;
                [$(TypeId::of::<$asset>()),*].iter().position(|kind| *kind == own)
            }

            pub fn cost(&self) -> Cost {
                match self { $(Self::$kind(key) => <$asset>::cost(key),)* }
            }

            pub fn needs(&self) -> Vec<AssetKey> {
                match self { $(Self::$kind(key) => <$asset>::needs(key),)* }
            }

            pub fn file(&self) -> Option<AssetFile> {
                match self { $(Self::$kind(key) => Some((<$asset>::FILES?.name)(key)),)* }
            }

            pub fn make(&self, workshop: &Workshop<'_>) -> Result<AnyAsset> {
                match self { $(Self::$kind(key) => Ok(Arc::new(<$asset>::make(key, workshop)?)),)* }
            }

            pub fn read(&self, cache: &AssetCache, splats: usize) -> Option<AnyAsset> {
                let file = self.file()?;
                match self {
                    $(Self::$kind(key) => {
                        Some(Arc::new((<$asset>::FILES?.read)(key, cache, &file, splats)?))
                    })*
                }
            }

            pub fn write(&self, asset: &AnyAsset, cache: &AssetCache) {
                let Some(file) = self.file() else { return };
                match self {
                    $(Self::$kind(_) => {
                        if let Some((asset, files)) = asset.downcast_ref().zip(<$asset>::FILES) {
                            (files.write)(asset, cache, file);
                        }
                    })*
                }
            }
        }
    };
}

kinds!(dispatch);
