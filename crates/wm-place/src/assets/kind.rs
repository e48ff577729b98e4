//! A kind of asset: what it is made of, how it is made, and how it is kept.

use super::cache::AssetCache;
use super::kinds::{LyingKey, SceneSurfaces, StandingOccluders};
use super::make::Workshop;
use crate::Result;
use std::any::Any;
use std::fmt;
use std::sync::{Arc, Mutex};
use wm_weather::cover::{Airflow, Cover, LyingCover};
use wm_weather::light::{CaptureLight, LampLights, LampShadows, ShadowCasters, SunShadows};
use wm_weather::open_water::OpenWater;
use wm_weather::shelter::{Occluders, Shelter};
use wm_weather::wetness::WetSurfaces;

/// An asset of any kind.
pub(crate) type AnyAsset = Arc<dyn Any + Send + Sync>;

/// The time that an asset takes to make, without that of what it is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Cost {
    /// Less than a second for most scenes.
    Quick,
    /// Seconds.
    Slow,
}

/// The treatment of an asset once it is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Keep {
    /// The store keeps so many of the kind, those that were used last.
    Last(usize),
    /// As [`Self::Last`] with one, but only if it was asked for, not if another asset needed it.
    IfAsked,
    /// It serves the assets that are made of it, and is dropped.
    No,
}

/// A kind of asset.
pub(crate) trait Asset: Any + Send + Sync + Sized {
    /// The numbers that tell one asset of the kind from another.
    type Key;

    /// The work, in words for a progress bar.
    const WORK: &'static str;
    const KEEP: Keep;
    /// Draft pictures look right without it, or with another asset of its kind.
    const DRAFTS_DO_WITHOUT: bool = false;
    /// The file is written after everything else is made, since making the rest changes the asset.
    const FILE_COMES_LAST: bool = false;

    fn cost(_: &Self::Key) -> Cost {
        Cost::Slow
    }

    /// The assets that it is made of.
    fn needs(_: &Self::Key) -> Vec<AssetKey> {
        Vec::new()
    }

    /// Makes the asset of those that it needs, which the workshop has.
    fn make(key: &Self::Key, workshop: &Workshop<'_>) -> Result<Self>;

    /// The word that a file's name begins with, and the numbers that tell it from others of its
    /// kind; `None` for a kind that is not kept on disk.
    fn file(_: &Self::Key) -> Option<AssetFile> {
        None
    }

    /// Reads the asset for a scene of so many splats; `None` if there is no file that fits.
    fn read(_: &Self::Key, _cache: &AssetCache, _splats: usize) -> Option<Self> {
        None
    }

    /// Writes the asset.
    fn write(&self, _: &Self::Key, _cache: &AssetCache) {}
}

/// The name of an asset's file: a word, and numbers.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct AssetFile {
    pub word: &'static str,
    pub numbers: Vec<f64>,
}

/// Lists the kinds, the slowest first: a progress bar shows the first that is missing.
macro_rules! kinds {
    ($($kind:ident($key:ty) => $asset:ty,)*) => {
        /// An asset of a place: its kind, and the numbers that tell it from others of the kind.
        #[derive(Clone, PartialEq)]
        pub(crate) enum AssetKey {
            $($kind($key),)*
        }

        impl fmt::Debug for AssetKey {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                match self {
                    $(Self::$kind(key) => f.debug_tuple(stringify!($kind)).field(key).finish(),)*
                }
            }
        }

        $(impl AssetOf<$asset> for AssetKey {
            fn of(key: $key) -> Self {
                Self::$kind(key)
            }
        })*

        impl AssetKey {
            /// The place of the kind in the list.
            pub fn rank(&self) -> usize {
                let mut rank = 0;
                $(
                    if matches!(self, Self::$kind(_)) {
                        return rank;
                    }
                    rank += 1;
                )*
                rank
            }

            pub fn is_of<A: Asset>(&self) -> bool {
                match self {
                    $(Self::$kind(_) => std::any::TypeId::of::<A>() == std::any::TypeId::of::<$asset>(),)*
                }
            }

            pub fn work(&self) -> &'static str {
                match self { $(Self::$kind(_) => <$asset>::WORK,)* }
            }

            pub fn keep(&self) -> Keep {
                match self { $(Self::$kind(_) => <$asset>::KEEP,)* }
            }

            pub fn drafts_do_without(&self) -> bool {
                match self { $(Self::$kind(_) => <$asset>::DRAFTS_DO_WITHOUT,)* }
            }

            pub fn file_comes_last(&self) -> bool {
                match self { $(Self::$kind(_) => <$asset>::FILE_COMES_LAST,)* }
            }

            pub fn cost(&self) -> Cost {
                match self { $(Self::$kind(key) => <$asset>::cost(key),)* }
            }

            pub fn needs(&self) -> Vec<AssetKey> {
                match self { $(Self::$kind(key) => <$asset>::needs(key),)* }
            }

            pub fn file(&self) -> Option<AssetFile> {
                match self { $(Self::$kind(key) => <$asset>::file(key),)* }
            }

            pub fn make(&self, workshop: &Workshop<'_>) -> Result<AnyAsset> {
                match self { $(Self::$kind(key) => Ok(Arc::new(<$asset>::make(key, workshop)?)),)* }
            }

            pub fn read(&self, cache: &AssetCache, splats: usize) -> Option<AnyAsset> {
                match self {
                    $(Self::$kind(key) => {
                        <$asset>::read(key, cache, splats).map(|asset| Arc::new(asset) as AnyAsset)
                    })*
                }
            }

            pub fn write(&self, asset: &AnyAsset, cache: &AssetCache) {
                match self {
                    $(Self::$kind(key) => {
                        if let Some(asset) = asset.downcast_ref::<$asset>() {
                            asset.write(key, cache);
                        }
                    })*
                }
            }
        }
    };
}

/// The key of an asset of a type.
pub(crate) trait AssetOf<A: Asset> {
    fn of(key: A::Key) -> Self;
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
