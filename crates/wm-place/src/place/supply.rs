//! The assets of a place: which its weathers need, and those that were made.

use super::prepared::{LoadedCover, PreparedPlace};
use super::surface::flood_follows_camera;
use crate::assets::{
    AnyAsset, AssetKey, AssetNeeds, AssetSource, Assets, Keep, KeyedAsset, LyingKey, MissingAssets,
    SurfaceViews, ViewDetail, lock, photo_views, uses_thinned,
};
use crate::place_light::CoverLight;
use crate::{Error, Progress, Renderer, Result};
use std::path::Path;
use std::sync::{Arc, Mutex};
use wm_render::{AnyRenderer, RenderBackend};
use wm_scene::survey::{CapturedSky, FactSource};
use wm_weather::cover::{Cover, LyingCover};
use wm_weather::light::{CaptureLight, KnownSun, LampShadows};
use wm_weather::shelter::Shelter;
use wm_weather::{PreparedWeather, Weather};

impl PreparedPlace {
    /// The assets that the instant `time` of a weather needs and that are not made yet.
    #[must_use]
    pub fn missing_assets(&self, weather: &Weather, time: f64) -> MissingAssets {
        self.lacking(weather, &self.prepare_weather(weather, time))
    }

    /// The folder of prepared assets; `None` if they are not kept.
    #[must_use]
    pub fn asset_folder(&self) -> Option<&Path> {
        self.cache.folder()
    }

    /// The names of the files of prepared assets that the instant `time` of a weather uses, whether
    /// they are there or not; none if assets are not kept.
    #[must_use]
    pub fn asset_files(&self, weather: &Weather, time: f64) -> Vec<String> {
        let prepared = self.prepare_weather(weather, time);
        let mut keys = self.asset_keys(weather, &prepared, true);
        if !prepared.cover().is_empty() {
            // Snow is laid out on ground that is on disk.
            keys.extend(AssetNeeds::of(weather, &self.site).cover.map(AssetKey::Cover));
        }
        let name = |key: &AssetKey| self.cache.name(&key.file()?);
        let mut names: Vec<String> = keys.iter().filter_map(name).collect();
        names.sort();
        names.dedup();
        names
    }

    /// The assets that an instant of a weather uses, in the order in which they are made. The light
    /// of the capture is among them if the surfaces that get wet are to be found by it.
    fn asset_keys(&self, weather: &Weather, prepared: &PreparedWeather, finds_wet: bool) -> Vec<AssetKey> {
        let needs = AssetNeeds::of(weather, &self.site);
        let wet = prepared.wetness().filter(|_| needs.wetness.is_some());
        let mut keys = Vec::new();
        let change = prepared.light();
        if needs.light && (change.is_some() || wet.is_some() && finds_wet) {
            keys.push(AssetKey::Light(()));
        }
        if let Some(change) = change {
            let capture = self.store.get::<CaptureLight>(());
            let takes_sun = capture.is_none_or(|capture| capture.takes_another_sun(change.is_diffuse));
            keys.extend(change.sun.filter(|_| takes_sun).map(AssetKey::SunShadows));
            let lamps = change.lamps.and_then(|(source, _)| self.light.lamps.get(source));
            keys.extend(lamps.cloned().map(AssetKey::Lamps));
        }
        if let Some(wet) = wet {
            keys.extend([AssetKey::Shelter(wet.rain.fall), AssetKey::Wet(())]);
        }
        keys.extend(prepared.fall().filter(|_| needs.shelter).map(AssetKey::Shelter));
        let requests = prepared.cover();
        let lying = needs.cover.filter(|_| !requests.is_empty());
        let lying = lying.map(|airflow| LyingKey::Physical(airflow, requests.to_vec()));
        let lying = lying.into_iter().chain(needs.paper_cover.map(LyingKey::Paper));
        keys.extend(lying.map(AssetKey::Lying));
        keys
    }

    /// The assets that a prepared instant of a weather needs and that are not made yet.
    pub(super) fn lacking(&self, weather: &Weather, prepared: &PreparedWeather) -> MissingAssets {
        let keys = self.asset_keys(weather, prepared, !self.store.has(&AssetKey::Wet(())));
        MissingAssets::of(keys.into_iter().filter(|key| !self.is_laid(key)), &self.store)
    }

    /// Returns true for what lies on the place as the renderer holds it.
    fn is_laid(&self, key: &AssetKey) -> bool {
        let AssetKey::Lying(what) = key else { return false };
        self.lying.as_ref().is_some_and(|lying| lying.what == *what)
    }

    /// Returns true if a small picture does without what is missing, since there is something like
    /// it.
    #[must_use]
    pub fn has_similar(&self, missing: &MissingAssets) -> bool {
        missing.asked.iter().all(|key| match key {
            AssetKey::Shelter(_) => self.store.last::<Shelter>().is_some(),
            _ => key.kind().drafts_do_without,
        })
    }

    /// Takes an asset from disk, or what it is made of, and collects what is not there in `absent`.
    fn read_cached(&mut self, key: &AssetKey, known: &mut Vec<KeyedAsset>, absent: &mut Vec<AssetKey>) {
        if self.store.has(key) || key.find(known).is_some() || absent.contains(key) {
            return;
        }
        match key.read(&self.cache, self.scene.splats.len()) {
            Some(asset) if key.kind().keep == Keep::No => known.push((key.clone(), asset)),
            Some(asset) => self.take_asset(key.clone(), asset),
            None => {
                absent.push(key.clone());
                for need in key.needs() {
                    self.read_cached(&need, known, absent);
                }
            }
        }
    }

    /// Returns the inputs for `missing`, and removes from it what was found on disk. Renders the
    /// photos' views if surfaces are to be found in them.
    pub(crate) fn asset_source(
        &mut self,
        backend: &mut AnyRenderer,
        missing: &mut MissingAssets,
    ) -> Result<AssetSource> {
        if missing.has_nan() {
            return Err(Error::Unsupported(
                "the weather gives a direction that is not a number (NaN): change its parameters".into(),
            ));
        }
        let (mut known, mut absent) = (Vec::new(), Vec::new());
        for key in &missing.asked {
            self.read_cached(key, &mut known, &mut absent);
        }
        *missing = MissingAssets::of(missing.asked.drain(..), &self.store);
        let mut views = SurfaceViews::default();
        if !self.scene.splats.is_empty() {
            let mut seen = |detail| photo_views(backend, self.set, &self.scene, &self.survey, detail);
            if absent.contains(&AssetKey::Occluders(())) {
                views.shelter = seen(ViewDetail::SHELTER)?;
            }
            if absent.contains(&AssetKey::Surfaces(())) {
                views.cover = seen(ViewDetail::COVER)?;
            }
        }
        known.extend(self.store.entries.iter().cloned());
        Ok(AssetSource {
            scene: Arc::clone(&self.scene),
            views,
            known,
            site: self.site,
            known_sun: KnownSun {
                direction: self.survey.sun.as_ref().map(|sun| sun.direction.to_array()),
                elevation: self.survey.sun_elevation,
            },
            threads: backend.threads(),
            is_up_known: !matches!(self.survey.up.source, FactSource::Estimated | FactSource::Assumed),
            cache: self.cache.clone(),
            path: self.weather_path(),
            scene_number: self.scene_number,
        })
    }

    /// Takes the light of the capture. Shadows tell more than colours whether there were clouds.
    fn take_light(&mut self, light: &CaptureLight) {
        let by_shadows = match (light.is_overcast, self.site.captured_sky) {
            (true, _) => CapturedSky::Overcast,
            (false, CapturedSky::Overcast) if light.sun.is_some() => CapturedSky::Clear,
            (false, CapturedSky::Overcast) => CapturedSky::Burned,
            (false, by_color) => by_color,
        };
        // In both: the site is made from the survey anew when lamps change.
        self.survey.captured_sky = by_shadows;
        self.site.captured_sky = by_shadows;
    }

    /// Takes assets that were made.
    pub(crate) fn insert(&mut self, backend: &mut AnyRenderer, assets: Assets) -> Result<()> {
        if assets.scene_number != self.scene_number {
            return Ok(());
        }
        for (key, asset) in assets.made {
            match key {
                AssetKey::Lying(what) => {
                    if let Some(lying) = asset.downcast().ok().and_then(Arc::into_inner) {
                        self.load_lying(backend, what, lying)?;
                    }
                }
                key => self.take_asset(key, asset),
            }
        }
        Ok(())
    }

    /// Keeps an asset, and what it says of the place.
    fn take_asset(&mut self, key: AssetKey, asset: AnyAsset) {
        self.warnings.extend(doubts_of_asset(&asset));
        if let Some(light) = asset.downcast_ref::<CaptureLight>() {
            self.take_light(light);
        }
        self.store.add(key, asset);
    }

    /// Loads what lies in the place of what lay before.
    fn load_lying(&mut self, backend: &mut AnyRenderer, what: LyingKey, lying: LyingCover) -> Result<()> {
        self.clear_cover(backend);
        let set = backend.load(&lying.splats)?;
        let LyingCover { splats, buried, settled, .. } = lying;
        let depths = settled.into_iter().map(|settled| settled.depth).collect();
        self.lying = Some(LoadedCover { what, set, buried, light: CoverLight::of(splats), depths });
        Ok(())
    }

    /// Takes away what lies.
    pub(super) fn clear_cover(&mut self, backend: &mut AnyRenderer) {
        if let Some(old) = self.lying.take() {
            backend.unload(old.set);
        }
    }

    /// Makes what an instant of a weather needs, and waits for it.
    pub(crate) fn prepare(
        &mut self,
        backend: &mut AnyRenderer,
        mut missing: MissingAssets,
        progress: &mut dyn Progress,
    ) -> Result<()> {
        if missing.is_empty() {
            return Ok(());
        }
        self.warnings.append(&mut self.doubts);
        if missing.asked.iter().any(|key| matches!(key, AssetKey::Cover(_) | AssetKey::Lying(_))) {
            self.warnings.extend(self.ground_doubt.take());
        }
        let source = self.asset_source(backend, &mut missing)?;
        let assets = missing.make(source, progress)?;
        self.insert(backend, assets)
    }
}

impl Renderer {
    /// Makes what a weather may need of the place at any time, so that no frame waits and
    /// [`PreparedPlace::release_splats`] may follow.
    ///
    /// # Errors
    /// As [`Self::render_into`].
    pub fn prepare(
        &mut self,
        place: &mut PreparedPlace,
        weather: &Weather,
        progress: &mut dyn Progress,
    ) -> Result<()> {
        let backend = self.backend_of(place)?;
        place.check_light(weather)?;
        // Without a shot each camera has splats of its own, whose assets are made when it is there.
        if place.levels.is_some() && !place.focus_on_shot(backend)? {
            return Ok(());
        }
        if uses_thinned(weather) {
            place.make_thinned(backend)?;
        }
        if flood_follows_camera(weather) {
            place.near_ground();
        }
        let needs = AssetNeeds::of(weather, &place.site);
        place.prepare(backend, place.missing_assets(weather, 0.0), progress)?;
        let mut keys = Vec::new();
        if needs.light {
            keys.push(AssetKey::Light(()));
        }
        if weather.moves_sun() {
            keys.push(AssetKey::Casters(()));
        }
        // Lamps shine where the light changes.
        let sources = if needs.light { weather.lamp_sources() } else { Vec::new() };
        let lamps = |source| Some(AssetKey::Lamps(place.light.lamps.get(source)?.clone()));
        keys.extend(sources.into_iter().filter_map(lamps));
        if let Some(fall) = needs.wetness {
            // Ground that is dry at first may get wet later.
            keys.extend([AssetKey::Shelter(fall), AssetKey::Wet(())]);
        }
        keys.extend(needs.cover.map(AssetKey::Cover));
        place.prepare(backend, MissingAssets::of(keys, &place.store), progress)?;
        // A fall that turns, or begins later, needs maps of other directions; those are made
        // without the splats.
        let turns = needs.shelter && !weather.is_constant();
        let occluders = turns.then_some(AssetKey::Occluders(()));
        place.prepare(backend, MissingAssets::of(occluders, &place.store), progress)
    }

    /// Returns the inputs for [`MissingAssets::make`] on another thread, and removes from `missing`
    /// what is found on disk.
    ///
    /// # Errors
    /// As [`Self::render`].
    pub fn asset_source(
        &mut self,
        place: &mut PreparedPlace,
        missing: &mut MissingAssets,
    ) -> Result<AssetSource> {
        let backend = self.backend_of(place)?;
        place.asset_source(backend, missing)
    }

    /// Gives a place the assets that were made for it.
    ///
    /// # Errors
    /// [`crate::Error::Render`] if there is more lying snow than the renderer holds.
    pub fn insert_assets(&mut self, place: &mut PreparedPlace, assets: Assets) -> Result<()> {
        let backend = self.backend_of(place)?;
        place.insert(backend, assets)
    }
}

/// The doubts that an asset raises about the place, one line each.
fn doubts_of_asset(asset: &AnyAsset) -> Vec<String> {
    if let Some(lamps) = asset.downcast_ref::<LampShadows>() {
        let says = "stands inside of something: the surfaces around it look away from it";
        let doubt = |[x, y, z]: [f32; 3]| format!("the lamp at {x:.2}, {y:.2}, {z:.2} {says}");
        return lamps.enclosed().map(doubt).collect();
    }
    let bare = asset.downcast_ref::<Mutex<Cover>>().is_some_and(|cover| lock(cover).is_bare());
    let says = "nothing can lie here: no surface looks up at the sky; give --up if up is wrong";
    bare.then(|| says.into()).into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use wm_scene::PhotoSun;
    use wm_street::Street;
    use wm_weather::optics::LampSource;

    /// A street with lamps whose photos were taken under clouds: fog keeps their light.
    #[test]
    fn a_weather_that_keeps_the_light_needs_no_asset_of_it() {
        let mut scene = Street::builtin().sampling(0.3).scene(&|_| true).unwrap();
        scene.metadata.sun = Some(PhotoSun::Diffuse);
        let mut renderer = Renderer::cpu().unwrap();
        let mut place = renderer.load(scene).unwrap();
        let mut has_light = |weather| {
            renderer.prepare(&mut place, &Weather::preset(weather).unwrap(), &mut ()).unwrap();
            let lamps = place.light.lamps.get(LampSource::Scene).unwrap().clone();
            [AssetKey::Light(()), AssetKey::Lamps(lamps)].map(|key| place.store.has(&key))
        };
        assert_eq!(has_light("fog"), [false; 2]);
        assert_eq!(has_light("night"), [true; 2]);
    }
}
