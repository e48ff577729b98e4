//! The bench of an instrument: the place that it measures at, the weather that is asked for, and
//! what it finds.

use super::lit::{LIGHT_ALONE, LightPicture, paint_card};
use super::plot::{Axis, Plot, Series};
use super::{
    Finding, InstrumentRenderer, LevelFrame, MeasureRequest, MeasuredPicture, Reading, ShotSubject,
    Tolerance, changed, expected,
};
use std::fmt::Display;
use wm_place::{FrameRequest, Layers, Picture, Result};
use wm_render::Frame;
use wm_scene::card::Card;
use wm_scene::{Camera, Lamp, Splats};
use wm_weather::Weather;

/// The place, the weather and the finding that an instrument works with.
pub(crate) struct Bench<'a> {
    pub(crate) rig: &'a mut dyn InstrumentRenderer,
    /// Level coordinates at the place.
    pub(crate) level: LevelFrame,
    /// The weather to measure.
    pub(crate) weather: &'a Weather,
    /// The time, s.
    pub(crate) time: f64,
    pub(crate) finding: Finding,
}

impl<'a> Bench<'a> {
    pub(super) fn new(rig: &'a mut dyn InstrumentRenderer, request: &MeasureRequest<'a>) -> Self {
        let level = LevelFrame::of(&rig.site());
        let finding = Finding { setting: request.setting.to_owned(), ..Finding::default() };
        Self { rig, level, weather: request.weather, time: request.time, finding }
    }

    /// Returns a parameter of the weather, if its effect is on and it is a number.
    pub(crate) fn number(&self, effect: &str, param: &str) -> Option<f64> {
        expected::number(self.weather, self.time, effect, param)
    }

    /// Returns the weather with changes.
    pub(crate) fn with(&self, changes: &str) -> Result<Weather> {
        changed(self.weather, changes)
    }

    /// Returns the weather with one effect alone.
    pub(crate) fn alone(&self, only: &str) -> Result<Weather> {
        let mut weather = self.weather.clone();
        for (effect, _) in self.weather.effects().filter(|(effect, _)| effect.name != only) {
            weather.set_text(&format!("{}=off", effect.name))?;
        }
        Ok(weather)
    }

    /// Returns the weather with its light alone, and with changes.
    pub(crate) fn with_light(&self, changes: &str) -> Result<Weather> {
        changed(&self.with(LIGHT_ALONE)?, changes)
    }

    /// Sets up one lit card: see [`paint_card`].
    pub(crate) fn card(
        &mut self,
        center: [f64; 3],
        halves: [[f64; 3]; 2],
        grain: f64,
        light: f64,
    ) -> Result<ShotSubject> {
        self.card_by_lamps(center, halves, grain, light, Vec::new())
    }

    /// Sets up one lit card with lamps at the place.
    pub(crate) fn card_by_lamps(
        &mut self,
        center: [f64; 3],
        halves: [[f64; 3]; 2],
        grain: f64,
        light: f64,
        lamps: Vec<Lamp>,
    ) -> Result<ShotSubject> {
        let mut splats = Splats::default();
        paint_card(&self.level, center, halves, grain, light, &mut splats);
        self.rig.set_up_lit(splats, lamps)
    }

    /// Sets up a square board of one grey (sRGB) about a point: `axes` are the directions of its
    /// sides in level coordinates, `half` is half a side, m, and `cells` counts the splats along
    /// one.
    pub(crate) fn square(
        &mut self,
        center: [f64; 3],
        axes: [[f64; 3]; 2],
        half: f64,
        cells: usize,
        grey: f32,
    ) -> Result<ShotSubject> {
        let [u, v] = axes.map(|axis| self.level.vector(axis) * self.level.units(half));
        let mut splats = Splats::default();
        Card { center: self.level.point(center), u, v }.paint(&mut splats, (cells, cells), [grey; 3]);
        self.rig.set_up(splats)
    }

    /// Sets up a lit target without lamps.
    pub(crate) fn set_up_lit(&mut self, splats: Splats) -> Result<ShotSubject> {
        self.rig.set_up_lit(splats, Vec::new())
    }

    /// Draws layers of the place or a target.
    pub(crate) fn draw(
        &mut self,
        subject: ShotSubject,
        camera: &Camera,
        weather: &Weather,
        layers: Layers,
    ) -> Result<Picture> {
        self.draw_at(self.time, subject, camera, weather, layers)
    }

    /// Draws layers of the place or a target at another time, s.
    pub(crate) fn draw_at(
        &mut self,
        time: f64,
        subject: ShotSubject,
        camera: &Camera,
        weather: &Weather,
        layers: Layers,
    ) -> Result<Picture> {
        let mut picture = Picture::default();
        let request = FrameRequest { layers, ..FrameRequest::new(weather, camera, time) };
        self.rig.draw(subject, &request, &mut picture)?;
        Ok(picture)
    }

    /// Draws a target by its light alone.
    pub(crate) fn light(
        &mut self,
        subject: ShotSubject,
        camera: &Camera,
        weather: &Weather,
    ) -> Result<LightPicture> {
        self.light_at(self.time, subject, camera, weather)
    }

    /// Draws a target by its light alone at another time, s.
    pub(crate) fn light_at(
        &mut self,
        time: f64,
        subject: ShotSubject,
        camera: &Camera,
        weather: &Weather,
    ) -> Result<LightPicture> {
        self.draw_at(time, subject, camera, weather, Layers::COLOR).map(LightPicture::of)
    }

    /// Adds a reading without a standard error: the expected and the measured value.
    pub(crate) fn add(
        &mut self,
        quantity: impl Into<String>,
        unit: &'static str,
        values: [f64; 2],
        tolerance: Tolerance,
    ) -> &mut Reading {
        let [asked, measured] = values;
        let (quantity, setting) = (quantity.into(), self.finding.setting.clone());
        let reading = Reading { quantity, setting, unit, asked, measured, standard_error: None, tolerance };
        self.finding.readings.push_mut(reading)
    }

    /// Adds curves over two axes, with the setting in their title.
    pub(crate) fn plot(&mut self, title: &str, x: impl Into<Axis>, y: impl Into<Axis>, series: Vec<Series>) {
        let title = format!("{title}, {}", self.finding.setting);
        self.finding.plots.push(Plot { title, x: x.into(), y: y.into(), series });
    }

    /// Adds the colours of a picture, with the setting before its caption.
    pub(crate) fn show(&mut self, caption: impl Display, picture: &Picture) {
        self.show_picture(MeasuredPicture::of(caption.to_string(), &picture.frame));
    }

    /// Adds the colours of the place, with the setting as its caption.
    pub(crate) fn show_place(&mut self, frame: &Frame) {
        self.finding.pictures.push(MeasuredPicture::of(self.finding.setting.clone(), frame));
    }

    /// Adds a picture, with the setting before its caption.
    pub(crate) fn show_picture(&mut self, mut picture: MeasuredPicture) {
        picture.caption = format!("{}: {}", self.finding.setting, picture.caption);
        self.finding.pictures.push(picture);
    }
}
