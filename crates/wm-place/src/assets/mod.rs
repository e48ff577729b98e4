//! Data of a place that takes seconds to compute and serves many frames: the shelter under roofs,
//! the light of the capture, the ground under snow.
//!
//! An asset has a key: its kind, and the numbers that tell it from others of the kind. A kind is a
//! file in `kinds/` and its entry of `kinds!` in `list.rs`: what it is made of, how it is made,
//! kept and written. A weather at an instant asks for keys; [`MissingAssets`] are those that are
//! not there, with what they are made of, [`AssetSource`] holds what they are made from, and
//! [`MissingAssets::make`] makes them, on any thread. [`AssetCache`] keeps them on disk.
//!
//! [`PreparedPlace::missing_assets`](crate::PreparedPlace::missing_assets) tells what a frame
//! lacks, and [`Renderer::insert_assets`](crate::Renderer::insert_assets) adds what was made. The
//! viewer makes assets on a second thread and draws drafts meanwhile
//! ([`Patience::Draft`](crate::Patience::Draft)); everyone else waits. To delete the files on disk
//! changes no picture.

#[macro_use]
mod list;
mod cache;
mod key;
mod kind;
mod kinds;
mod make;
mod packed;
mod store;
mod views;

pub(crate) use cache::scene_digest;
pub use cache::{AssetCache, AssetDigest};
pub(crate) use key::{AnyAsset, AssetKey, KeyedAsset, LyingKey};
pub use kind::AssetSource;
pub(crate) use kind::{Keep, SurfaceViews};
pub(crate) use kinds::lock;
pub use make::{Assets, MissingAssets};
pub use packed::pack_asset;
pub(crate) use store::AssetStore;
pub(crate) use views::{ViewDetail, WithoutSky, photo_views};

use wm_weather::cover::Airflow;
use wm_weather::paper::PaperCover;
use wm_weather::{Site, Weather};

/// The assets that the frames of a weather need, over all of its time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AssetNeeds {
    /// Something may fall that roofs stop.
    pub shelter: bool,
    /// The airflow that carries snow and dust; `None` if nothing lies at any time.
    pub cover: Option<Airflow>,
    /// The paper's lying snow.
    pub paper_cover: Option<PaperCover>,
    /// The light of the capture.
    pub light: bool,
    /// The direction of the rain that wets surfaces; `None` if nothing is wet at any time.
    pub wetness: Option<[f64; 3]>,
}

impl AssetNeeds {
    /// Returns true if frames of the weather, whose needs they are, use splats or assets beside the
    /// scene that is drawn.
    pub(crate) fn any(&self, weather: &Weather) -> bool {
        *self != Self::default() || uses_thinned(weather)
    }

    /// The needs of a weather at a site.
    #[must_use]
    pub fn of(weather: &Weather, site: &Site) -> Self {
        use wm_weather::{Fidelity, Need};
        let prepared = weather.at(0.0).prepare(site);
        let paper_cover = prepared.paper_cover.clone();
        // The paper's rain falls through roofs.
        let shelter = weather.needs(Need::Shelter) && weather.fidelity == Fidelity::Physical;
        let lies = weather.needs(Need::Cover) && paper_cover.is_none();
        let wetness = prepared.wetting_rain().map(|rain| rain.fall).filter(|_| weather.needs(Need::Water));
        // A weather that keeps the captured light at all times never asks for it.
        let changes_light = !weather.is_constant() || prepared.light().is_some() || prepared.moves_light();
        let light = weather.needs(Need::Light) && (changes_light || wetness.is_some());
        Self { shelter, cover: lies.then(|| prepared.airflow()), paper_cover, light, wetness }
    }
}

/// Returns true if a weather is drawn with a thinned copy of the scene: in drops on the lens, and in
/// what water mirrors.
pub(crate) fn uses_thinned(weather: &Weather) -> bool {
    weather.effects().any(|(effect, _)| ["lens", "wetness", "flood"].contains(&effect.name))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A weather that keeps the captured light at all times does not need the split of it.
    #[test]
    fn only_weathers_that_change_the_light_need_it() {
        let needs = |changes: &[&str]| {
            let mut weather = Weather::clear();
            changes.iter().try_for_each(|change| weather.set_text(change)).unwrap();
            AssetNeeds::of(&weather, &Site::PLAIN).light
        };
        assert!(!needs(&["light.model=captured", "rain.rate=10"]));
        assert!(needs(&["light.model=overcast"]) && needs(&["light.model=0:captured,5:overcast"]));
        assert!(needs(&["light.model=captured", "lightning.rate=5"]));
        assert!(needs(&["light.model=captured", "wetness.amount=1"]));
    }
}
