//! The water on a place in the weather that is drawn.

use crate::assets::{AssetStore, lock};
use std::sync::{Arc, Mutex};
use wm_scene::Camera;
use wm_weather::cover::{Cover, CoverRequest};
use wm_weather::shelter::Shelter;
use wm_weather::splash::{SplashGround, SplashTiles};
use wm_weather::water::{WaterGrid, puddles};
use wm_weather::wetness::{
    Catchments, RunOff, WaterState, WetGains, WetRequest, WetShares, WetState, WetSurfaces,
};
use wm_weather::{PreparedWeather, Site};

/// The water of the last frame, for the next.
#[derive(Default)]
pub(crate) struct PlaceWater {
    /// The surfaces that the rain of the last direction reaches.
    reached: Option<ReachedSurfaces>,
    state: Option<WetState>,
    /// The surface of the water, with what it is of.
    puddles: Option<(PuddleKey, Arc<WaterGrid>)>,
}

/// All that the surface of the water depends on: the request, and what lies on it.
type PuddleKey = (WetRequest, Vec<CoverRequest>);

/// Snow or dust that lies on the ground.
pub(crate) struct OnGround<'a> {
    /// The covers, as they were asked for.
    pub requests: &'a [CoverRequest],
    /// The ground that they lie on.
    pub cover: Arc<Mutex<Cover>>,
    /// Their depths, as [`wm_weather::cover::LyingCover::settled`] lists them, m.
    pub depths: &'a [Vec<f32>],
}

/// The surfaces that a rain reaches.
struct ReachedSurfaces {
    surfaces: Arc<WetSurfaces>,
    shares: WetShares,
    catchments: Catchments,
    run_off: RunOff,
    tiles: SplashTiles,
    /// The shelter of the rain's own direction is known.
    is_exact: bool,
}

impl PlaceWater {
    /// Finds the water of a weather, if it wets anything and the surfaces are known.
    pub fn find(
        &mut self,
        prepared: &PreparedWeather,
        store: &mut AssetStore,
        site: &Site,
        pool: &rayon::ThreadPool,
    ) {
        self.state = None;
        let (Some(asked), Some(surfaces)) = (prepared.wetness(), store.take_up::<WetSurfaces>(())) else {
            return;
        };
        let shelter = store.take_up::<Shelter>(asked.rain.fall);
        let is_exact = shelter.is_some();
        // Of a draft it may be another one.
        let shelter = shelter.or_else(|| store.last());
        let is_known = |reached: &ReachedSurfaces| {
            reached.shares.rain == asked.rain
                && reached.is_exact == is_exact
                && Arc::ptr_eq(&reached.surfaces, &surfaces)
        };
        if !self.reached.as_ref().is_some_and(is_known) {
            let shares = pool.install(|| WetShares::of(&surfaces, &asked.rain, shelter.as_deref(), site));
            let catchments = Catchments::of(&surfaces, &shares);
            let run_off = RunOff::of(&surfaces, &shares);
            let tiles = SplashTiles::of(&surfaces, site);
            self.reached = Some(ReachedSurfaces { surfaces, shares, catchments, run_off, tiles, is_exact });
            self.puddles = None;
        }
        self.state =
            self.reached.as_ref().map(|reached| WetState::of(asked, &reached.surfaces, &reached.catchments));
    }

    /// The factors on the light of the scene's splats as a camera sees them, or without what
    /// depends on that; `None` where nothing is wet.
    pub fn gains(&self, prepared: &PreparedWeather, camera: Option<&Camera>) -> Option<WetGains<'_>> {
        let (reached, state, asked) = (self.reached.as_ref()?, self.state.as_ref()?, prepared.wetness()?);
        let gains = WetGains::new(&reached.surfaces, &reached.shares, state, asked.porosity);
        Some(match camera {
            Some(camera) => gains.with_sheen(prepared.sheen(camera), state, asked.texture),
            None => gains,
        })
    }

    /// The wetness of the scene's splats, whatever it does to their colours; `None` where nothing
    /// is wet.
    pub fn wetness(&self, prepared: &PreparedWeather) -> Option<WetGains<'_>> {
        let (reached, state) = (self.reached.as_ref()?, self.state.as_ref()?);
        prepared.wetness()?;
        Some(WetGains::new(&reached.surfaces, &reached.shares, state, 1.0))
    }

    /// The surface of the water on the ground, where nothing lies on it; `None` where nothing is
    /// wet.
    pub fn puddles(
        &mut self,
        prepared: &PreparedWeather,
        lying: Option<&OnGround<'_>>,
        site: &Site,
    ) -> Option<Arc<WaterGrid>> {
        let asked = prepared.wetness()?;
        let requests = lying.map_or(&[][..], |lying| lying.requests);
        let is_known = |((wet, covers), _): &(PuddleKey, _)| wet == asked && covers == requests;
        if !self.puddles.as_ref().is_some_and(is_known) {
            let mut grid = puddles(&self.state()?, asked.texture, site);
            if let (Some(lying), Some(reached)) = (lying, &self.reached) {
                let (ground, cover) = (reached.surfaces.ground(), lock(&lying.cover));
                grid = grid
                    .hidden_by(|at| ground.middle(at).map_or(0.0, |point| cover.hides(lying.depths, point)));
            }
            self.puddles = Some(((asked.clone(), requests.to_vec()), Arc::new(grid)));
        }
        self.puddles.as_ref().map(|(_, grid)| Arc::clone(grid))
    }

    /// The ground that rain splashes on; `None` where nothing is wet, or snow lies on it.
    pub fn splash_ground(&self, prepared: &PreparedWeather, site: &Site) -> Option<SplashGround<'_>> {
        let (reached, state) = (self.reached.as_ref()?, self.state.as_ref()?);
        let asked =
            prepared.wetness().filter(|_| prepared.cover().is_empty() && prepared.splash.is_some())?;
        let (surfaces, shares, tiles) = (&reached.surfaces, &reached.shares, &reached.tiles);
        Some(SplashGround::new(surfaces, shares, state, asked.texture, asked.eaves, tiles, site))
    }

    /// The water on the ground; `None` where nothing is wet.
    pub fn state(&self) -> Option<WaterState> {
        let (reached, state) = (self.reached.as_ref()?, self.state.as_ref()?);
        Some(WaterState::of(&reached.surfaces, &reached.shares, &reached.run_off, state))
    }
}
