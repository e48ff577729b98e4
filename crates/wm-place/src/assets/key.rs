//! Keys of assets.

use std::any::Any;
use std::sync::Arc;
use wm_weather::cover::{Airflow, CoverRequest};
use wm_weather::light::LampLights;
use wm_weather::paper::PaperCover;

/// An asset of any kind.
pub(crate) type AnyAsset = Arc<dyn Any + Send + Sync>;
/// An asset with its key.
pub(crate) type KeyedAsset = (AssetKey, AnyAsset);

/// The law that something lies by, and how much.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum LyingKey {
    Physical(Airflow, Vec<CoverRequest>),
    Paper(PaperCover),
}

macro_rules! keys {
    ($($kind:ident($key:ty) => $asset:ty,)*) => {
        /// An asset of a place: its kind, and the numbers that tell it from others of the kind.
        #[derive(Clone, Debug, PartialEq)]
        pub(crate) enum AssetKey {
            $($kind($key),)*
        }
    };
}

kinds!(keys);

impl AssetKey {
    /// Finds the asset of the key among some.
    pub fn find<'a>(&self, among: &'a [KeyedAsset]) -> Option<&'a AnyAsset> {
        among.iter().find(|(known, _)| known == self).map(|(_, asset)| asset)
    }
}
