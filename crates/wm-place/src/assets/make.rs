//! Makes the assets that are missing, each after those that it is made of.

use super::key::{AssetKey, KeyedAsset};
use super::kind::{AssetSource, Cost, Keep, Workshop};
use super::store::AssetStore;
use crate::{Error, Progress, Result};

/// Assets that were made, to be taken by [`crate::Renderer::insert_assets`].
pub struct Assets {
    /// In the order in which they were made.
    pub(crate) made: Vec<KeyedAsset>,
    /// As of [`AssetSource`].
    pub(crate) scene_number: u64,
}

/// The assets that a frame needs and that are not made yet. They take seconds for a large scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MissingAssets {
    /// The assets that were asked for, in the order in which they are made.
    pub(crate) asked: Vec<AssetKey>,
    /// Missing assets from which those are made.
    pub(crate) needed: Vec<AssetKey>,
}

impl MissingAssets {
    /// The assets that were asked for and that a store lacks.
    pub(crate) fn of(asked: impl IntoIterator<Item = AssetKey>, store: &AssetStore) -> Self {
        let mut missing = Self::default();
        for key in asked {
            if !store.has(&key) && !missing.asked.contains(&key) {
                missing.asked.push(key);
            }
        }
        missing.needed = needs_of(&missing.asked, |need| !store.has(need) && !missing.asked.contains(need));
        missing
    }

    /// Keeps the assets that `is_wanted` accepts, with what they are made of.
    pub(crate) fn only(self, is_wanted: impl Fn(&AssetKey) -> bool) -> Self {
        let mut asked = self.asked;
        asked.retain(is_wanted);
        let needed = needs_of(&asked, |need| self.needed.contains(need));
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
        !self.is_empty() && self.all().all(|key| key.cost() == Cost::Quick)
    }

    /// The longest of the work, in words for a progress bar.
    #[must_use]
    pub fn description(&self) -> &'static str {
        self.all().min_by_key(|key| key.rank()).map_or("", |key| key.kind().work)
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
        for (key, asset) in made.iter().filter(|(key, _)| key.kind().file_comes_last) {
            key.write(asset, &source.cache);
        }
        let is_kept = |key: &AssetKey| match key.kind().keep {
            Keep::Last(_) => true,
            Keep::IfAsked => self.asked.contains(key),
            Keep::No => false,
        };
        made.retain(|(key, _)| is_kept(key));
        Ok(Assets { made, scene_number: source.scene_number })
    }
}

/// Lists what assets are made of, and what that is made of, as far as it is missing.
fn needs_of(asked: &[AssetKey], is_missing: impl Fn(&AssetKey) -> bool) -> Vec<AssetKey> {
    let (mut needed, mut open) = (Vec::new(), asked.to_vec());
    while let Some(key) = open.pop() {
        for need in key.needs() {
            if is_missing(&need) && !needed.contains(&need) {
                needed.push(need.clone());
                open.push(need);
            }
        }
    }
    needed
}

/// Makes an asset if it is not there, after those that it is made of.
fn make(
    key: &AssetKey,
    source: &AssetSource,
    pool: &rayon::ThreadPool,
    made: &mut Vec<KeyedAsset>,
    progress: &mut dyn Progress,
) -> Result<()> {
    if key.find(&source.known).or(key.find(made)).is_some() {
        return Ok(());
    }
    for need in key.needs() {
        make(&need, source, pool, made, progress)?;
    }
    if progress.is_stopped() {
        return Err(Error::Stopped);
    }
    progress.begin(key.kind().work, None);
    let asset = pool.install(|| key.make(&Workshop { source, made }));
    progress.end();
    let asset = asset?;
    if !key.kind().file_comes_last {
        key.write(&asset, &source.cache);
    }
    made.push((key.clone(), asset));
    Ok(())
}
