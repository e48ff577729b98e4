//! Data of a place that takes seconds to compute and serves many frames: the shelter under roofs,
//! and the ground under snow.
//!
//! [`MissingAssets`] says what a frame needs that is not there, [`AssetSource`] holds what it is
//! made from, and [`MissingAssets::make`] makes it, on any thread. [`AssetCache`] keeps it on disk.

mod cache;
mod packed;
mod views;

pub use cache::{AssetCache, AssetDigest};
pub(crate) use cache::{AssetFile, scene_digest};
pub use packed::pack_asset;
pub(crate) use views::{ViewDetail, WithoutSky, photo_views};

use crate::{Error, Progress, Result};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use wm_scene::{Camera, Scene, Splats};
use wm_weather::cover::{Airflow, Cover, CoverRequest, LyingCover};
use wm_weather::fused_surfaces::{FusedSurfaces, GroundField, PhotoView};
use wm_weather::light::{CaptureLight, KnownSun, LampLights, LampShadows, ShadowCasters, SunShadows};
use wm_weather::open_water::OpenWater;
use wm_weather::paper::PaperCover;
use wm_weather::shelter::{Occluders, Shelter, ShelterOptions};
use wm_weather::wetness::WetSurfaces;
use wm_weather::{Site, Weather};

/// Shelter maps that are kept, one for each direction of fall: enough for a wind that turns.
const SHELTERS: usize = 6;
/// Distance from the photos' path up to which the light is split finely, m.
const LIGHT_REACH: f64 = 60.0;
/// Distance from the cameras' path up to which roofs keep rain off in a place that reaches far
/// beyond what they see, m: falling drops are drawn nearer than that.
const SHELTER_REACH: f64 = 100.0;
/// Shadows that are kept, one for each place of the sun.
const SUNS: usize = 4;
/// Covers that are kept, one for each way in which the air carries what lies.
const COVERS: usize = 2;

/// A cover whose ladder of depths grows as it is used.
pub(crate) type SharedCover = Arc<Mutex<Cover>>;

/// Locks a cover. A panic of another thread leaves it whole: its ladder only grows.
pub(crate) fn lock(cover: &SharedCover) -> MutexGuard<'_, Cover> {
    cover.lock().unwrap_or_else(PoisonError::into_inner)
}

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
        let thins =
            || weather.effects().any(|(effect, _)| ["lens", "wetness", "flood"].contains(&effect.name));
        *self != Self::default() || thins()
    }

    /// The needs of a weather at a site.
    #[must_use]
    pub fn of(weather: &Weather, site: &Site) -> Self {
        use wm_weather::{Fidelity, Need};
        let prepared = weather.at(0.0).prepare(site);
        let paper_cover = prepared.paper_cover().cloned();
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

/// The prepared assets of a place that frames ask for.
#[derive(Default)]
pub(crate) struct AssetStore {
    pub occluders: Option<Arc<Occluders>>,
    pub light: Option<Arc<CaptureLight>>,
    /// Kept for a sun that moves.
    pub casters: Option<Arc<ShadowCasters>>,
    pub lamps: Option<Arc<LampShadows>>,
    pub wet: Option<Arc<WetSurfaces>>,
    /// By the direction of fall, the last used at the end.
    shelters: Vec<([f64; 3], Arc<Shelter>)>,
    /// By the direction towards the sun, the last used at the end.
    shadows: Vec<([f64; 3], Arc<SunShadows>)>,
    /// The last used at the end.
    covers: Vec<(Airflow, SharedCover)>,
}

impl AssetStore {
    /// The shelter map of a direction of fall.
    pub fn shelter(&mut self, fall: [f64; 3]) -> Option<&Arc<Shelter>> {
        newest(&mut self.shelters, &fall)
    }

    /// The shelter map that was used last, whatever its direction.
    pub fn any_shelter(&self) -> Option<&Arc<Shelter>> {
        self.shelters.last().map(|(_, shelter)| shelter)
    }

    pub fn has_shelter(&self, fall: [f64; 3]) -> bool {
        self.shelters.iter().any(|(known, _)| *known == fall)
    }

    /// The cover of an airflow.
    pub fn cover(&mut self, airflow: &Airflow) -> Option<&SharedCover> {
        newest(&mut self.covers, airflow)
    }

    pub fn has_cover(&self, airflow: &Airflow) -> bool {
        self.covers.iter().any(|(known, _)| known == airflow)
    }

    pub fn add_shelter(&mut self, fall: [f64; 3], shelter: Arc<Shelter>) {
        keep(&mut self.shelters, (fall, shelter), SHELTERS);
    }

    /// The light of these lamps.
    pub fn lamps(&self, lamps: &LampLights) -> Option<&Arc<LampShadows>> {
        self.lamps.as_ref().filter(|known| are_same_lamps(known.lamps(), lamps))
    }

    /// The shadows of a sun.
    pub fn shadows(&self, sun: [f64; 3]) -> Option<&Arc<SunShadows>> {
        self.shadows.iter().find(|(known, _)| *known == sun).map(|(_, shadows)| shadows)
    }

    pub fn has_shadows(&self, sun: [f64; 3]) -> bool {
        self.shadows(sun).is_some()
    }

    /// Adds the shadows of a sun that was asked for: those of a file may have other last digits.
    pub fn add_shadows(&mut self, sun: [f64; 3], shadows: Arc<SunShadows>) {
        keep(&mut self.shadows, (sun, shadows), SUNS);
    }

    pub fn add_cover(&mut self, airflow: Airflow, cover: SharedCover) {
        keep(&mut self.covers, (airflow, cover), COVERS);
    }
}

/// Returns true if lamps are the same but for their last digits, which differ from system to
/// system.
pub(crate) fn are_same_lamps(a: &LampLights, b: &LampLights) -> bool {
    let (a, b) = (a.numbers(), b.numbers());
    let is_near = |(a, b): (f64, f64)| (a - b).abs() <= 1e-5 * a.abs().max(1e-3);
    a.len() == b.len() && a.into_iter().zip(b).all(is_near)
}

/// Finds an entry and moves it to the end.
fn newest<'a, K: PartialEq, V>(kept: &'a mut Vec<(K, V)>, key: &K) -> Option<&'a V> {
    let place = kept.iter().position(|(known, _)| known == key)?;
    let found = kept.remove(place);
    kept.push(found);
    kept.last().map(|(_, value)| value)
}

/// Adds an entry, in the place of one with the same key or of the oldest where there are too many.
fn keep<K: PartialEq, V>(kept: &mut Vec<(K, V)>, new: (K, V), most: usize) {
    kept.retain(|(known, _)| *known != new.0);
    kept.push(new);
    if kept.len() > most {
        kept.remove(0);
    }
}

/// The assets that a frame needs and that are not made yet. They take seconds for a large scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MissingAssets {
    /// The surfaces that may stop what falls.
    pub(crate) occluders: bool,
    /// The map of where a fall leaves the ground dry, by its direction.
    pub(crate) shelter: Option<[f64; 3]>,
    /// The same of the rain that wets surfaces, where it is another one.
    pub(crate) wet_shelter: Option<[f64; 3]>,
    /// The surfaces that get wet.
    pub(crate) wet: bool,
    /// The ground that something can lie on.
    pub(crate) cover: Option<Airflow>,
    /// The splats of the snow or dust on that ground.
    pub(crate) lying: Option<(Airflow, Vec<CoverRequest>)>,
    /// The paper's lying snow.
    pub(crate) paper_cover: Option<PaperCover>,
    /// The light of the capture.
    pub(crate) light: bool,
    /// The shadows of a sun, by the direction towards it.
    pub(crate) sun: Option<[f64; 3]>,
    /// All that casts the shadows of suns.
    pub(crate) casters: bool,
    /// The lamps whose light is wanted.
    pub(crate) lamps: Option<LampLights>,
}

impl MissingAssets {
    /// Returns true if nothing is missing.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// Returns true if a number by which an asset would be found is NaN: it would be made again and
    /// again.
    pub(crate) fn has_nan(&self) -> bool {
        // NaN is the one number that does not equal itself.
        *self != self.clone()
    }

    /// Returns true if something is missing that takes no more than a second for most scenes.
    #[must_use]
    pub fn is_quick(&self) -> bool {
        let Self {
            occluders,
            shelter,
            wet_shelter,
            wet,
            cover,
            lying,
            paper_cover,
            light,
            sun,
            casters,
            lamps,
        } = self;
        let makes_surfaces =
            cover.is_some() || *light || *wet || sun.is_some() || *casters || lamps.is_some();
        let is_slow = *occluders || paper_cover.is_some() || makes_surfaces;
        !is_slow && (shelter.is_some() || wet_shelter.is_some() || lying.is_some())
    }

    /// The longest of the work, in words for a progress bar.
    #[must_use]
    pub fn description(&self) -> &'static str {
        match (&self.cover, &self.paper_cover, &self.lying) {
            (None, None, None) if (self.sun.is_some() || self.casters) && !self.light => {
                "casting the shadows of the sun"
            }
            (None, None, None) if self.lamps.is_some() && !self.light => "casting the shadows of the lamps",
            (None, None, None) if self.light => "splitting the light of the capture into sun and sky",
            (None, None, None) if self.wet => "finding what gets wet",
            (None, None, None) => "finding where roofs keep the rain off",
            (None, None, _) => "laying out the snow",
            _ => "finding what snow can lie on",
        }
    }

    /// Makes what is missing.
    ///
    /// # Errors
    /// [`Error::Unsupported`] if the splats of the place were released, [`Error::Stopped`] if
    /// `progress` asked to stop.
    pub fn make(&self, source: AssetSource, progress: &mut dyn Progress) -> Result<Assets> {
        let AssetSource {
            scene,
            views,
            surfaces,
            site,
            known_sun,
            light,
            casters,
            threads,
            occluders,
            cover,
            is_up_known,
            cache,
            path: known_path,
            scene_number,
        } = source;
        let path = known_path.unwrap_or_else(|| views::path_of_photos(&scene));
        let lamps_wait = self.lamps.is_some();
        let needs_light = self.light || (casters.is_none() && (self.casters || self.sun.is_some()));
        let needs_surfaces = self.cover.is_some() || needs_light || lamps_wait || self.wet;
        let needs_splats = self.occluders || self.paper_cover.is_some() || needs_surfaces;
        if needs_splats && scene.splats.is_empty() {
            return Err(Error::Unsupported(
                "the splats of this place were released: load the scene again to change its weather".into(),
            ));
        }
        let fused = |views: &[PhotoView]| FusedSurfaces::from_views(&scene.splats, views, &site, threads);
        let made_occluders = self.occluders.then(|| {
            let found = fused(&views.shelter);
            let focus = known_path.map(|path| (path, SHELTER_REACH));
            Arc::new(Occluders::of(
                &found.splats,
                &site,
                &ShelterOptions { focus, ..ShelterOptions::default() },
            ))
        });
        let surfaces = needs_surfaces.then(|| {
            surfaces.unwrap_or_else(|| {
                progress.begin("finding the surfaces that the photos show", None);
                let on_ground = GroundField::snap(&views.cover, site.up, site.metres_per_unit, threads);
                let found = fused(&on_ground);
                progress.end();
                // Without photos they are the splats themselves.
                if !views.cover.is_empty() {
                    cache.put(&AssetFile::Surfaces, &found);
                }
                found
            })
        });
        go_on(progress)?;
        let in_the_way = surfaces.as_ref().filter(|_| needs_light).map(|found| {
            let options = ShelterOptions { focus: Some((path, LIGHT_REACH)), ..ShelterOptions::default() };
            (found, Occluders::of(&found.casters(), &site, &options).standing(threads))
        });
        let made_light = in_the_way.as_ref().filter(|_| self.light).map(|(found, occluders)| {
            progress.begin("splitting the light of the capture into sun and sky", None);
            let cameras: Vec<Camera> = scene.views.iter().map(|view| view.camera).collect();
            let light =
                CaptureLight::split(&scene.splats, found, occluders, known_sun, &cameras, &site, threads);
            progress.end();
            cache.put(&AssetFile::Light, &light);
            Arc::new(light)
        });
        go_on(progress)?;
        let casters = casters.or_else(|| {
            in_the_way.map(|(found, occluders)| {
                let points = found.places(&scene.splats).to_vec();
                Arc::new(ShadowCasters::new(points, &occluders, threads))
            })
        });
        let capture = made_light.as_ref().or(light.as_ref());
        let shadows = self.sun.zip(capture).zip(casters.as_ref()).map(|((sun, capture), casters)| {
            progress.begin("casting the shadows of the sun", None);
            let shadows = SunShadows::of(casters, capture, sun, &site, threads);
            progress.end();
            cache.put(&AssetFile::SunShadows(sun), &shadows);
            Arc::new(shadows)
        });
        go_on(progress)?;
        let lamps = match (&self.lamps, capture, surfaces.as_ref()) {
            (Some(lamps), Some(capture), Some(found)) => {
                progress.begin("casting the shadows of the lamps", None);
                let points = found.places(&scene.splats);
                let shadows = LampShadows::of(lamps, &found.casters(), capture, points, &site, threads)?;
                progress.end();
                cache.put(&AssetFile::Lamps(lamps), &shadows);
                Some(Arc::new(shadows))
            }
            _ => None,
        };
        go_on(progress)?;
        let occluders = made_occluders.as_ref().or(occluders.as_ref());
        let sheltered = |fall: Option<[f64; 3]>| {
            fall.zip(occluders).map(|(fall, occluders)| {
                let shelter = occluders.shelter(fall, Some(threads));
                cache.put(&AssetFile::Shelter(fall), &shelter);
                (fall, Arc::new(shelter))
            })
        };
        let shelters = [sheltered(self.wet_shelter), sheltered(self.shelter)];
        go_on(progress)?;
        let ground = surfaces.as_ref().filter(|_| self.wet || self.cover.is_some());
        let ground = ground.map(|found| {
            let mut water = OpenWater::of(&found.splats, scene.metadata.water.as_deref(), &site);
            water.add_labelled(&scene.splats, scene.metadata.water_labels.as_deref().unwrap_or_default());
            (found, water)
        });
        let wet = ground.as_ref().filter(|_| self.wet).zip(capture).map(|((found, water), capture)| {
            progress.begin("finding what gets wet", None);
            let wet =
                WetSurfaces::of(&scene.splats, found, capture, water, path, is_up_known, &site, threads);
            progress.end();
            cache.put(&AssetFile::Wet, &wet);
            Arc::new(wet)
        });
        go_on(progress)?;
        let made_cover = self.cover.zip(ground.as_ref()).map(|(airflow, (found, water))| {
            progress.begin("finding what can be covered", None);
            let cover = Cover::of(&scene.splats, found, &site, &airflow, path, threads).off_water(water);
            progress.end();
            (airflow, Arc::new(Mutex::new(cover)))
        });
        go_on(progress)?;
        let cover = made_cover.as_ref().map(|(_, cover)| cover).or(cover.as_ref());
        let lying = self.lying.clone().zip(cover).map(|((airflow, requests), cover)| {
            let lying = lock(cover).lay_all(&requests);
            (lying, (airflow, requests))
        });
        if let Some((airflow, cover)) = &made_cover {
            // After it was first used: with what has slid by then.
            cache.put(&AssetFile::Cover(*airflow), &*lock(cover));
        }
        let snow = |paper: &PaperCover| (paper.clone(), paper.snow(&scene.splats, &site));
        Ok(Assets {
            paper_cover: self.paper_cover.as_ref().map(snow),
            occluders: made_occluders,
            shelters,
            wet,
            cover: made_cover,
            lying,
            light: made_light,
            shadows,
            casters: casters.filter(|_| self.casters),
            lamps,
            scene_number,
        })
    }
}

/// Checks between two parts of the work whether it should stop.
///
/// # Errors
/// [`Error::Stopped`] if it should.
fn go_on(progress: &mut dyn Progress) -> Result<()> {
    if progress.is_stopped() { Err(Error::Stopped) } else { Ok(()) }
}

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
    pub(crate) surfaces: Option<FusedSurfaces<'static>>,
    pub(crate) site: Site,
    /// The direction or elevation of the capture's sun, as the survey knows it.
    pub(crate) known_sun: KnownSun,
    pub(crate) light: Option<Arc<CaptureLight>>,
    pub(crate) casters: Option<Arc<ShadowCasters>>,
    pub(crate) threads: usize,
    pub(crate) occluders: Option<Arc<Occluders>>,
    pub(crate) cover: Option<SharedCover>,
    /// Up is stated or measured, not estimated from the splats.
    pub(crate) is_up_known: bool,
    pub(crate) cache: AssetCache,
    /// The line along which cameras are, by its ends (world, scene units), of a place that reaches
    /// far beyond what they see; `None` for that of the photos.
    pub(crate) path: Option<[[f64; 3]; 2]>,
    /// The number of the scene, among those of the place.
    pub(crate) scene_number: u64,
}

/// Assets that were made, to be taken by [`crate::Renderer::insert_assets`].
pub struct Assets {
    pub(crate) occluders: Option<Arc<Occluders>>,
    /// Maps of the rain that wets surfaces, and of what falls, with their directions.
    pub(crate) shelters: [Option<([f64; 3], Arc<Shelter>)>; 2],
    pub(crate) wet: Option<Arc<WetSurfaces>>,
    pub(crate) cover: Option<(Airflow, SharedCover)>,
    pub(crate) lying: Option<(LyingCover, (Airflow, Vec<CoverRequest>))>,
    pub(crate) paper_cover: Option<(PaperCover, Splats)>,
    pub(crate) shadows: Option<Arc<SunShadows>>,
    pub(crate) casters: Option<Arc<ShadowCasters>>,
    pub(crate) light: Option<Arc<CaptureLight>>,
    pub(crate) lamps: Option<Arc<LampShadows>>,
    /// As of [`AssetSource`].
    pub(crate) scene_number: u64,
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
