//! A kind of asset: what it is made of, how it is made, and how it is kept.

use super::cache::{AssetCache, AssetFile};
use super::key::{AssetKey, KeyedAsset};
use super::views::path_of_photos;
use crate::{Error, Result};
use std::any::Any;
use std::sync::Arc;
use wm_scene::{Scene, Splats};
use wm_weather::Site;
use wm_weather::fused_surfaces::PhotoView;
use wm_weather::light::KnownSun;

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

/// A kind of asset in the list of all kinds.
pub(crate) trait Keyed {
    /// The numbers that tell one asset of the kind from another.
    type Key;

    /// The key among those of all kinds.
    const KEY: fn(Self::Key) -> AssetKey;
}

/// A kind of asset.
pub(crate) trait Asset: Keyed + Any + Send + Sync + Sized {
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

    /// The files of the kind; `None` for a kind that is not kept on disk.
    const FILES: Option<AssetFiles<Self>> = None;
}

/// The files of a kind of asset.
pub(crate) struct AssetFiles<A: Asset> {
    /// The name of the file of a key.
    pub name: fn(&A::Key) -> AssetFile,
    /// Reads the asset for a scene of so many splats; `None` if there is no file that fits.
    pub read: fn(&A::Key, &AssetCache, &AssetFile, usize) -> Option<A>,
    /// Writes the asset.
    pub write: fn(&A, &AssetCache, AssetFile),
}

/// The views that surfaces are found in; empty for what is not made.
#[derive(Default)]
pub(crate) struct SurfaceViews {
    pub shelter: Vec<PhotoView>,
    pub cover: Vec<PhotoView>,
}

/// The inputs of [`MissingAssets::make`](super::MissingAssets::make). They are owned, so that
/// another thread can do the work.
pub struct AssetSource {
    pub(crate) scene: Arc<Scene>,
    pub(crate) views: SurfaceViews,
    /// The assets that are there.
    pub(crate) known: Vec<KeyedAsset>,
    pub(crate) site: Site,
    /// The direction or elevation of the capture's sun, as the survey knows it.
    pub(crate) known_sun: KnownSun,
    pub(crate) threads: usize,
    /// Up is stated or measured, not estimated from the splats.
    pub(crate) is_up_known: bool,
    pub(crate) cache: AssetCache,
    /// The line along which cameras are, by its ends (world, scene units), of a place that reaches
    /// far beyond what they see; `None` for that of the photos.
    pub(crate) path: Option<[[f64; 3]; 2]>,
    /// The number of the scene, among those of the place.
    pub(crate) scene_number: u64,
}

impl AssetSource {
    /// The splats of the scene.
    ///
    /// # Errors
    /// [`Error::Unsupported`] if they were released.
    pub fn splats(&self) -> Result<&Splats> {
        if self.scene.splats.is_empty() {
            return Err(Error::Unsupported(
                "the splats of this place were released: load the scene again to change its weather".into(),
            ));
        }
        Ok(&self.scene.splats)
    }

    /// The line along which cameras are, by its ends (world, scene units).
    pub fn path(&self) -> [[f64; 3]; 2] {
        self.path.unwrap_or_else(|| path_of_photos(&self.scene))
    }
}

/// The inputs of one asset.
pub(crate) struct Workshop<'a> {
    pub source: &'a AssetSource,
    pub made: &'a [KeyedAsset],
}

impl Workshop<'_> {
    /// An asset that was listed as needed.
    ///
    /// # Panics
    /// If it was not.
    pub fn get<A: Asset>(&self, key: A::Key) -> &A {
        let key = A::KEY(key);
        let asset = key.find(self.made).or_else(|| key.find(&self.source.known));
        asset.expect("needs are made first").downcast_ref().expect("a key has assets of one type")
    }
}
