//! Collects what effects contribute to a weather at one instant of one place.

use super::prepared::PreparedWeather;
use crate::cover::CoverRequest;
use crate::dome::Dome;
use crate::level::level_axes;
use crate::light::{Flash, FlashLight, LightChange};
use crate::optics::{AirLayer, Atmosphere, Daylight, Site, SiteLight};
use crate::particles::fall::WindSample;
use crate::particles::{LEAST_RATE, Precipitation};
use crate::wind::Wind;
use wm_render::hooks::SkySplats;

/// A weather in the making. Effects contribute in the order of their list: each finds the light
/// that the sky and the effects before it have left.
pub(crate) struct WeatherBuilder {
    pub(crate) prepared: PreparedWeather,
    /// The layers of the air, those of what falls among them.
    layers: Vec<AirLayer>,
    flash: Option<Flash>,
}

impl WeatherBuilder {
    /// A clear instant, in seconds, at a place.
    pub(crate) fn new(site: Site, time: f64) -> Self {
        let prepared = PreparedWeather {
            air: Atmosphere::new(Vec::new(), site),
            site,
            time,
            paper: Vec::new(),
            paper_falls: Vec::new(),
            falling: Vec::new(),
            floating: Vec::new(),
            wind_now: WindSample::default(),
            dome: None,
            light: None,
            flash: None,
            has_lightning: false,
            grade: None,
            cover: Vec::new(),
            carried: f64::INFINITY,
            paper_cover: None,
            wetness: None,
            flood: None,
            splash: None,
            glass: None,
            pixels: Vec::new(),
            strongest_wind: 0.0,
        };
        Self { prepared, layers: Vec::new(), flash: None }
    }

    /// The place, with the light of the effects so far.
    pub(crate) fn site(&self) -> &Site {
        &self.prepared.site
    }

    /// Puts a sky behind the scene. It must come before all other effects, so that they are lit by
    /// this sky.
    pub(crate) fn set_sky(&mut self, sky: Dome) {
        let site = &mut self.prepared.site;
        let lights = site.daylight == Daylight::Guessed || sky.sky_splats == SkySplats::LeftOut;
        site.airlight = sky.airlight().filter(|_| lights).unwrap_or(site.airlight);
        self.prepared.dome = Some(sky);
    }

    /// Changes the light on the scene, and with it the sky if no effect has named one.
    pub(crate) fn change_light(&mut self, change: LightChange) {
        if change.is_nothing() {
            return;
        }
        let PreparedWeather { site, dome, light, .. } = &mut self.prepared;
        if let (None, Some(sky)) = (&dome, change.dome(site)) {
            site.airlight = sky.airlight().unwrap_or(site.airlight);
            *dome = Some(sky);
        }
        site.light = SiteLight::OfWeather;
        *light = Some(change);
    }

    /// Adds lightning, which flashes at the instant or does not.
    pub(crate) fn set_flash(&mut self, flash: Option<Flash>) {
        self.flash = flash;
        self.prepared.has_lightning = true;
        self.prepared.site.light = SiteLight::OfWeather;
        self.prepared.light.get_or_insert(LightChange::CAPTURED);
    }

    /// Adds a layer of air that floats.
    pub(crate) fn add_air(&mut self, layer: AirLayer) {
        self.layers.push(layer);
        self.prepared.floating.push(layer);
    }

    /// Sets the wind.
    pub(crate) fn set_wind(&mut self, wind: &Wind) {
        let time = self.prepared.time;
        self.prepared.wind_now =
            WindSample { drift: wind.drift(time), wind: wind.at(time), mean: wind.mean(time) };
    }

    /// Adds something that falls, and its part of the air.
    pub(crate) fn add_fall(&mut self, fall: Precipitation) {
        if fall.rate >= LEAST_RATE {
            self.layers.push(fall.layer());
            self.prepared.falling.push(fall);
        }
    }

    /// Adds something that lies, on what lies already.
    pub(crate) fn add_cover(&mut self, request: CoverRequest) {
        self.prepared.carried = self.prepared.carried.min(request.threshold);
        if !request.is_nothing() {
            self.prepared.cover.push(request);
        }
    }

    /// Ends the weather: the air of all layers, and what depends on the light.
    pub(crate) fn finish(self) -> PreparedWeather {
        let Self { mut prepared, layers, flash } = self;
        let site = prepared.site;
        prepared.air = Atmosphere::new(layers, site);
        prepared.flash = flash
            .zip(prepared.light.as_ref())
            .map(|(flash, light)| FlashLight::new(&flash, light.display(&site), &level_axes(site.up)));
        let flash = prepared.flash;
        prepared.dome = prepared.dome.map(|dome| dome.lit_by(flash));
        prepared
    }
}
