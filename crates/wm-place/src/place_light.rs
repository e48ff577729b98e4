//! The light on a place in the weather that is drawn: the gains of its splats and of what lies on
//! it, and its lamps.

use crate::assets::AssetStore;
use crate::lamps::PlaceLamps;
use std::sync::Arc;
use wm_scene::{Scene, Splats};
use wm_weather::light::{
    CaptureLight, LampLight, LampShadows, LightCasts, LightGains, MovingLight, NearSplats, NewLight,
    PlacedSurfaces, ShadowedLight, SunShadows, window_splats,
};
use wm_weather::{CapturedSky, LampSource, PreparedWeather, Site};

/// The light of the last frame, for the next.
pub(crate) struct PlaceLight {
    /// The lamps that weathers may ask for.
    pub lamps: PlaceLamps,
    /// The places of the splats; kept from when they are first needed.
    points: Option<Arc<[[f32; 3]]>>,
    /// The splats that are near a point.
    near: Option<NearSplats>,
    relit: Option<DrawnLight>,
    /// The warning that the shadows of the photos stay was given.
    is_told: bool,
    /// The warning that lamps are guessed was given.
    has_told_lamps: bool,
}

/// The last light that was drawn, and its gains.
struct DrawnLight {
    key: RelitKey,
    gains: LightGains,
}

/// All that gains depend on.
#[derive(Clone, Copy, Debug, PartialEq)]
struct RelitKey {
    light: NewLight,
    /// The direction of the sun whose shadows it casts.
    sun: Option<[f64; 3]>,
    /// The lamps that shine.
    lamps: Option<LampSource>,
    /// Light acts on it that changes from frame to frame.
    moves: bool,
}

/// The light on what lies on a place.
pub(crate) struct CoverLight {
    /// The splats, until their surfaces are found.
    splats: Option<Splats>,
    surfaces: Option<PlacedSurfaces>,
    relit: Option<DrawnLight>,
}

impl CoverLight {
    /// The light of these splats, which are not lit yet.
    pub fn of(splats: Splats) -> Self {
        Self { splats: Some(splats), surfaces: None, relit: None }
    }

    /// The gains of its splats, if a weather has lit them.
    pub fn gains(&self) -> Option<&LightGains> {
        self.relit.as_ref().map(|relit| &relit.gains)
    }
}

impl PlaceLight {
    /// Nothing is lit yet.
    pub fn new(lamps: PlaceLamps) -> Self {
        Self { lamps, points: None, near: None, relit: None, is_told: false, has_told_lamps: false }
    }

    /// Takes other lamps.
    pub fn set_lamps(&mut self, lamps: PlaceLamps) {
        (self.lamps, self.relit) = (lamps, None);
    }

    /// Returns a warning if lamps shine in a weather that are guessed, the first time.
    pub fn doubt_of_lamps(&mut self, prepared: &PreparedWeather) -> Option<String> {
        let (source, _) = prepared.light()?.lamps?;
        if source != LampSource::Path || std::mem::replace(&mut self.has_told_lamps, true) {
            return None;
        }
        self.lamps.doubt()
    }

    /// Keeps the places of splats that are about to be released.
    pub fn keep_points(&mut self, splats: &Splats) {
        if self.points.is_none() && !splats.is_empty() {
            self.points = Some(splats.means.as_slice().into());
        }
    }

    /// The gains of the scene's splats; `None` if the weather leaves their light as it is.
    pub fn gains(&self, prepared: &PreparedWeather) -> Option<&LightGains> {
        self.relit.as_ref().filter(|_| prepared.light().is_some()).map(|relit| &relit.gains)
    }

    /// Finds the gains of the light, if it changes and the capture's is known. Returns a warning
    /// where the shadows of the photos stay, once.
    pub fn relight(
        &mut self,
        prepared: &PreparedWeather,
        store: &AssetStore,
        splats: &Splats,
        lying: Option<&mut CoverLight>,
        site: &Site,
        pool: &rayon::ThreadPool,
    ) -> Option<String> {
        let (change, capture) = (prepared.light()?, store.get::<CaptureLight>(())?);
        let light = change.over(capture, site);
        let shadows = change.sun.and_then(|sun| store.get::<SunShadows>(sun));
        let source = change.lamps.map(|(source, _)| source);
        let lamps = source.and_then(|source| store.get::<LampShadows>(self.lamps.get(source)?.clone()));
        let moves = prepared.moves_light();
        let key = RelitKey { light, sun: shadows.and(change.sun), lamps: lamps.and(source), moves };
        let casts = LightCasts { shadows, lamps };
        if moves || lying.is_some() {
            self.keep_points(splats);
        }
        if self.relit.as_ref().is_none_or(|relit| relit.key != key) {
            let points = self.points.as_deref().filter(|_| moves);
            let gains = pool.install(|| LightGains::new(capture, &light, casts, points, site.up));
            self.relit = Some(DrawnLight { key, gains });
        }
        if let Some(lying) = lying.filter(|lying| lying.relit.as_ref().is_none_or(|relit| relit.key != key)) {
            if let Some((splats, points)) = lying.splats.as_ref().zip(self.points.as_deref()) {
                let near = self.near.get_or_insert_with(|| NearSplats::new(points, capture, site));
                lying.surfaces = Some(pool.install(|| PlacedSurfaces::of(splats, near, site)));
                lying.splats = None;
            }
            lying.relit = lying.surfaces.as_ref().map(|surfaces| {
                let gains = || LightGains::of_placed(capture, surfaces, &light, casts, moves, site.up);
                DrawnLight { key, gains: pool.install(gains) }
            });
        }
        let has_shadows = !change.is_diffuse && site.captured_sky != CapturedSky::Overcast;
        let is_new = has_shadows && !capture.is_split() && !std::mem::replace(&mut self.is_told, true);
        is_new.then(|| {
            format!(
                "the shadows of the photos stay, and only tint and exposure follow the weather (light.photos = diffuse if there are \
                 none): {}",
                capture.report(site.up)
            )
        })
    }

    /// The lit windows of a weather as splats, in its light; `None` where there are none.
    pub fn windows(&self, prepared: &PreparedWeather, scene: &Scene, site: &Site) -> Option<Splats> {
        let change = prepared.light()?;
        let (_, share) = change.lamps?;
        let windows = scene.metadata.windows.as_deref().filter(|windows| !windows.is_empty())?;
        Some(window_splats(windows, share * change.display(site), site))
    }

    /// The lamps of a weather with their shadows, and the display value of a lux; `None` where none
    /// shine.
    pub fn sources<'a>(
        &self,
        prepared: &PreparedWeather,
        store: &'a AssetStore,
        moving: Option<&MovingLight>,
        site: &Site,
    ) -> Option<(Vec<ShadowedLight<'a>>, f32)> {
        let change = prepared.light()?;
        let mut lights = Vec::new();
        if let Some((source, share)) = change.lamps
            && let Some(lamps) =
                self.lamps.get(source).and_then(|lamps| store.get::<LampShadows>(lamps.clone()))
        {
            lights.extend(lamps.sources().map(|(light, cube)| {
                let intensity = light.intensity.map(|v| v * share as f32);
                (LampLight { intensity, ..*light }, Some(cube))
            }));
        }
        let headlamps = moving.and_then(|moving| moving.headlamps.as_ref());
        lights.extend(headlamps.map(|headlamps| (headlamps.source(), None)));
        (!lights.is_empty()).then(|| (lights, change.display(site) as f32))
    }
}
