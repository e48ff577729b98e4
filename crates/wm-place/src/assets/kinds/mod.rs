//! The kinds of assets, a file each, and the list of them.

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
pub(crate) use surfaces::SceneSurfaces;

use super::cache::{AssetCache, AssetFile};
use super::kind::{AnyAsset, Asset, Cost, Keep, Keyed, KeyedAsset, LyingKey, Workshop};
use crate::Result;
use standing::StandingOccluders;
use std::any::TypeId;
use std::sync::{Arc, Mutex};
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

/// Lists the kinds with what tells one asset of the kind from another, the slowest first: a
/// progress bar shows the first that is missing.
macro_rules! kinds {
    ($($kind:ident($key:ty) => $asset:ty,)*) => {
        /// An asset of a place: its kind, and the numbers that tell it from others of the kind.
        #[derive(Clone, Debug, PartialEq)]
        pub(crate) enum AssetKey {
            $($kind($key),)*
        }

        $(impl Keyed for $asset {
            type Key = $key;
            const KEY: fn(Self::Key) -> AssetKey = AssetKey::$kind;
        })*

        impl AssetKey {
            /// Finds the asset of the key among some.
            pub fn find<'a>(&self, among: &'a [KeyedAsset]) -> Option<&'a AnyAsset> {
                among.iter().find(|(known, _)| known == self).map(|(_, asset)| asset)
            }

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

kinds! {
    Cover(Airflow) => Mutex<Cover>,
    Lying(LyingKey) => LyingCover,
    Light(()) => CaptureLight,
    SunShadows([f64; 3]) => SunShadows,
    Casters(()) => ShadowCasters,
    Lamps(LampLights) => LampShadows,
    Wet(()) => WetSurfaces,
    Shelter([f64; 3]) => Shelter,
    Occluders(()) => Occluders,
    Surfaces(()) => SceneSurfaces,
    Standing(()) => StandingOccluders,
    OpenWater(()) => OpenWater,
}
