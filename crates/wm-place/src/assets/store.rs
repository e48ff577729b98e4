//! The assets of a place that are in memory.

use super::key::{AnyAsset, AssetKey, KeyedAsset};
use super::kind::{Asset, Keep};
use std::any::TypeId;
use std::sync::Arc;

/// The assets of a place, by their keys.
#[derive(Clone, Default)]
pub(crate) struct AssetStore {
    /// The last used at the end.
    pub entries: Vec<KeyedAsset>,
}

impl AssetStore {
    pub fn has(&self, key: &AssetKey) -> bool {
        key.find(&self.entries).is_some()
    }

    /// The asset of a key.
    pub fn get<A: Asset>(&self, key: A::Key) -> Option<&A> {
        A::KEY(key).find(&self.entries)?.downcast_ref()
    }

    /// The asset of a key, which counts as used now, so that it is kept longest.
    pub fn take_up<A: Asset>(&mut self, key: A::Key) -> Option<Arc<A>> {
        let key = A::KEY(key);
        let place = self.entries.iter().position(|(known, _)| *known == key)?;
        let entry = self.entries.remove(place);
        let found = Arc::clone(&entry.1).downcast().ok();
        self.entries.push(entry);
        found
    }

    /// The asset of a kind that was used last.
    pub fn last<A: Asset>(&self) -> Option<Arc<A>> {
        let (_, asset) =
            self.entries.iter().rev().find(|(key, _)| key.kind().type_id == TypeId::of::<A>())?;
        Arc::clone(asset).downcast().ok()
    }

    /// Adds an asset in the place of one with its key, and drops the one of its kind that was used
    /// longest ago where there are too many.
    pub fn add(&mut self, key: AssetKey, asset: AnyAsset) {
        let kind = key.kind();
        let most = if let Keep::Last(most) = kind.keep { most } else { 1 };
        self.entries.retain(|(known, _)| *known != key);
        self.entries.push((key, asset));
        let is_own = |(known, _): &KeyedAsset| known.kind().type_id == kind.type_id;
        if self.entries.iter().filter(|entry| is_own(entry)).count() > most
            && let Some(oldest) = self.entries.iter().position(is_own)
        {
            self.entries.remove(oldest);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wm_weather::light::ShadowCasters;
    use wm_weather::shelter::Shelter;

    #[test]
    fn the_last_used_of_a_kind_are_kept() {
        let mut store = AssetStore::default();
        let key = |x: f64| AssetKey::Shelter([x, 0.0, -1.0]);
        let asset = || -> AnyAsset { Arc::new(0u8) };
        store.add(AssetKey::Light(()), asset());
        for x in 0..6 {
            store.add(key(f64::from(x)), asset());
        }
        // Not of the type, but used.
        assert!(store.take_up::<Shelter>([0.0, 0.0, -1.0]).is_none());
        store.add(key(6.0), asset());
        assert!(store.has(&key(0.0)) && !store.has(&key(1.0)) && store.has(&key(2.0)));
        assert!(store.has(&AssetKey::Light(())) && !store.has(&AssetKey::Casters(())));
        assert!(store.get::<ShadowCasters>(()).is_none());
    }
}
