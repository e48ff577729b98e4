//! Access of lidars and radars to a prepared place.

use super::prepared::PreparedPlace;
use crate::assets::{AssetKey, MissingAssets};
use crate::{Error, Progress, Result};
use wm_render::AnyRenderer;
use wm_weather::shelter::Shelter;
use wm_weather::wetness::WetGains;
use wm_weather::{PreparedWeather, Weather};

impl PreparedPlace {
    /// Hands what sensors other than cameras need of an instant of a weather to `scan`: the
    /// threads, the weather at the place, the shelter of what falls and the wetness of the splats.
    /// Missing assets are made first.
    pub(crate) fn for_sensors<R>(
        &mut self,
        backend: &mut AnyRenderer,
        weather: &Weather,
        time: f64,
        progress: &mut dyn Progress,
        scan: impl FnOnce(&rayon::ThreadPool, &PreparedWeather, Option<&Shelter>, Option<&WetGains<'_>>) -> R,
    ) -> Result<R> {
        // Light is of no use to them, but to tell the surfaces that get wet, which ask for it.
        let missing = self.missing_assets(weather, time);
        let missing = missing.only(|key| matches!(key, AssetKey::Wet(()) | AssetKey::Shelter(_)));
        let prepared = self.prepare_sensors(backend, weather, time, missing, progress)?;
        let shelter = prepared.fall().and_then(|fall| self.store.take_up::<Shelter>(fall));
        self.water.find(&prepared, &mut self.store, &self.site, backend.pool());
        let wet = self.water.wetness(&prepared);
        Ok(scan(backend.pool(), &prepared, shelter.as_deref(), wet.as_ref()))
    }

    /// Hands what radars need of an instant of a weather to `scan`: the threads, the weather at the
    /// place, and the shelter of the rain. What is missing is made first.
    pub(crate) fn for_radars<R>(
        &mut self,
        backend: &mut AnyRenderer,
        weather: &Weather,
        time: f64,
        progress: &mut dyn Progress,
        scan: impl FnOnce(&rayon::ThreadPool, &PreparedWeather, Option<&Shelter>) -> R,
    ) -> Result<R> {
        let rains = self.prepare_weather(weather, time).rain_rate() > 0.0;
        let missing = self.missing_assets(weather, time);
        let missing = missing.only(|key| rains && matches!(key, AssetKey::Shelter(_)));
        let prepared = self.prepare_sensors(backend, weather, time, missing, progress)?;
        let fall = prepared.fall().filter(|_| rains);
        let shelter = fall.and_then(|fall| self.store.take_up::<Shelter>(fall));
        Ok(scan(backend.pool(), &prepared, shelter.as_deref()))
    }

    /// Makes what is missing for sensors other than cameras, and prepares the weather.
    fn prepare_sensors(
        &mut self,
        backend: &mut AnyRenderer,
        weather: &Weather,
        time: f64,
        missing: MissingAssets,
        progress: &mut dyn Progress,
    ) -> Result<PreparedWeather> {
        if self.is_released {
            return Err(Error::Unsupported("the splats were released: sensors need them".into()));
        }
        self.prepare(backend, missing, progress)?;
        let prepared = self.prepare_weather(weather, time);
        if prepared.flood().is_some() {
            let fault = "lidars and radars do not see floods yet: leave it out with --set flood=off";
            return Err(Error::Unsupported(fault.into()));
        }
        Ok(prepared)
    }
}
