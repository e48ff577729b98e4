//! Makes the assets that are missing, each after those that it is made of.

use super::kind::{AnyAsset, Asset, AssetKey, AssetOf, Keep};
use super::store::AssetStore;
use super::{AssetCache, views};
use crate::{Error, Progress, Result};
use std::sync::Arc;
use wm_scene::{Scene, Splats};
use wm_weather::Site;
use wm_weather::fused_surfaces::PhotoView;
use wm_weather::light::KnownSun;

/// The views that surfaces are found in; empty for what is not made.
#[derive(Default)]
pub(crate) struct SurfaceViews {
    pub shelter: Vec<PhotoView>,
    pub cover: Vec<PhotoView>,
}

/// The inputs of [`MissingAssets::make`]. They are owned, so that another thread can do the work.
pub struct AssetSource {
    pub(crate) scene: Arc<Scene>,
    pub(crate) views: SurfaceViews,
    /// The assets that are there.
    pub(crate) known: AssetStore,
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
        self.path.unwrap_or_else(|| views::path_of_photos(&self.scene))
    }
}

/// Assets that were made, to be taken by [`crate::Renderer::insert_assets`].
pub struct Assets {
    /// In the order in which they were made.
    pub(crate) made: Vec<(AssetKey, AnyAsset)>,
    /// As of [`AssetSource`].
    pub(crate) scene_number: u64,
}

/// The inputs of one asset.
pub(crate) struct Workshop<'a> {
    pub source: &'a AssetSource,
    made: &'a [(AssetKey, AnyAsset)],
}

impl Workshop<'_> {
    /// An asset that was listed as needed.
    ///
    /// # Panics
    /// If it was not.
    pub fn get<A: Asset>(&self, key: A::Key) -> Arc<A>
    where
        AssetKey: AssetOf<A>,
    {
        let key = AssetKey::of(key);
        let made = self.made.iter().find(|(known, _)| *known == key).map(|(_, asset)| asset);
        let asset = made.or_else(|| self.source.known.any(&key)).expect("needs are made first");
        Arc::clone(asset).downcast().expect("a key has assets of one type")
    }
}

/// The assets that a frame needs and that are not made yet. They take seconds for a large scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MissingAssets {
    /// The assets that were asked for, in the order in which they are made.
    pub(crate) asked: Vec<AssetKey>,
    /// What they are made of and what is not there either.
    pub(crate) needed: Vec<AssetKey>,
}

impl MissingAssets {
    /// Those of the assets that were asked for that a store lacks.
    pub(crate) fn of(asked: impl IntoIterator<Item = AssetKey>, store: &AssetStore) -> Self {
        let mut missing = Self::default();
        for key in asked {
            if !store.has(&key) && !missing.asked.contains(&key) {
                missing.asked.push(key);
            }
        }
        let mut open = missing.asked.clone();
        while let Some(key) = open.pop() {
            for need in key.needs() {
                if !store.has(&need) && !missing.asked.contains(&need) && !missing.needed.contains(&need) {
                    missing.needed.push(need.clone());
                    open.push(need);
                }
            }
        }
        missing
    }

    /// Keeps the assets that `is_wanted` accepts, with what they are made of.
    pub(crate) fn only(self, is_wanted: impl Fn(&AssetKey) -> bool) -> Self {
        let mut asked = self.asked;
        asked.retain(is_wanted);
        let mut needed = Vec::new();
        let mut open = asked.clone();
        while let Some(key) = open.pop() {
            for need in key.needs() {
                if self.needed.contains(&need) && !needed.contains(&need) {
                    needed.push(need.clone());
                    open.push(need);
                }
            }
        }
        Self { asked, needed }
    }

    fn all(&self) -> impl Iterator<Item = &AssetKey> {
        self.asked.iter().chain(&self.needed)
    }

    /// Returns true if nothing is missing.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.asked.is_empty()
    }

    /// Returns true if a number by which an asset would be found is NaN: it would be made again and
    /// again.
    pub(crate) fn has_nan(&self) -> bool {
        // NaN is the one number that does not equal itself.
        self.all().any(|key| *key != key.clone())
    }

    /// Returns true if something is missing that takes no more than a second for most scenes.
    #[must_use]
    pub fn is_quick(&self) -> bool {
        !self.is_empty() && self.all().all(|key| key.cost() == super::kind::Cost::Quick)
    }

    /// The longest of the work, in words for a progress bar.
    #[must_use]
    pub fn description(&self) -> &'static str {
        self.all().min_by_key(|key| key.rank()).map_or("", |key| key.work())
    }

    /// Makes what is missing.
    ///
    /// # Errors
    /// [`Error::Unsupported`] if the splats of the place were released, [`Error::Stopped`] if
    /// `progress` asked to stop.
    pub fn make(&self, source: AssetSource, progress: &mut dyn Progress) -> Result<Assets> {
        // Threads beside those of the renderer, which may draw meanwhile.
        let pool = wm_render::cpu::pool(source.threads)?;
        let mut made = Vec::new();
        for key in &self.asked {
            make(key, &source, &pool, &mut made, progress)?;
        }
        for (key, asset) in made.iter().filter(|(key, _)| key.file_comes_last()) {
            key.write(asset, &source.cache);
        }
        let is_kept = |key: &AssetKey| match key.keep() {
            Keep::Last(_) => true,
            Keep::IfAsked => self.asked.contains(key),
            Keep::No => false,
        };
        made.retain(|(key, _)| is_kept(key));
        Ok(Assets { made, scene_number: source.scene_number })
    }
}

/// Makes an asset if it is not there, after those that it is made of.
fn make(
    key: &AssetKey,
    source: &AssetSource,
    pool: &rayon::ThreadPool,
    made: &mut Vec<(AssetKey, AnyAsset)>,
    progress: &mut dyn Progress,
) -> Result<()> {
    if source.known.has(key) || made.iter().any(|(known, _)| known == key) {
        return Ok(());
    }
    for need in key.needs() {
        make(&need, source, pool, made, progress)?;
    }
    if progress.is_stopped() {
        return Err(Error::Stopped);
    }
    progress.begin(key.work(), None);
    let asset = pool.install(|| key.make(&Workshop { source, made }));
    progress.end();
    let asset = asset?;
    if !key.file_comes_last() {
        key.write(&asset, &source.cache);
    }
    made.push((key.clone(), asset));
    Ok(())
}
