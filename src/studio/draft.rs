//! A studio for weathers that change: what they lack is made elsewhere, while frames are drawn with what there is.

use super::{Lack, Needs, Studio};
use anyhow::Result;
use std::sync::Arc;
use wm_render::{DrawPass, Frame, RenderBackend, SetView, Stats};
use wm_scene::Camera;
use wm_weather::Weather;
use wm_weather::cover::Cover;
use wm_weather::shelter::Occluders;

impl Lack {
    /// What it is, in words.
    pub fn what(&self) -> &'static str {
        match (&self.cover, &self.paper_cover, &self.lying) {
            (None, None, None) => "finding where roofs keep the rain off",
            (None, None, _) => "laying out the snow",
            _ => "finding what snow can lie on",
        }
    }

    /// Whether something is missing and takes no more than a second, for most scenes.
    pub fn is_quick(&self) -> bool {
        let Self { occluders, shelter, cover, lying, paper_cover } = self;
        let is_slow = *occluders || cover.is_some() || paper_cover.is_some();
        !is_slow && (shelter.is_some() || lying.is_some())
    }
}

impl Studio {
    /// What is missing for the instant `time` of a weather.
    pub fn lack(&self, weather: &Weather, time: f64) -> Lack {
        let needs = Needs::of(weather, &self.site);
        let sky = weather.at(time).over(&self.site);
        let has = |fall: &[f64; 3]| self.shelters.iter().any(|(known, _)| known == fall);
        let shelter = sky.fall().filter(|fall| needs.fall && !has(fall));
        let asked = needs.cover.filter(|_| !sky.cover().is_empty()).map(|air| (air, sky.cover().to_vec()));
        let is_laid =
            |asked: &_| self.lying.as_ref().is_some_and(|lying| lying.asked.as_ref() == Some(asked));
        Lack { shelter, lying: asked.filter(|asked| !is_laid(asked)), ..self.lack_of(&needs) }
    }

    /// Whether a small picture does without what is missing, since there is something like it.
    pub fn has_like(&self, lack: &Lack) -> bool {
        let Lack { occluders, shelter, cover, lying, paper_cover } = lack;
        let is_sheltered = shelter.is_none() || !self.shelters.is_empty();
        !occluders && is_sheltered && cover.is_none() && lying.is_none() && paper_cover.is_none()
    }

    /// Gives the cover away that something is to be laid on; [`Self::take`] takes it back.
    pub fn lend(&mut self, lack: &Lack) -> Option<Cover> {
        let (wanted, _) = lack.lying.as_ref()?;
        let place = self.covers.iter().position(|(airflow, _)| airflow == wanted)?;
        Some(self.covers.remove(place).1)
    }

    /// What may stop what falls, if that is known.
    pub fn occluders(&self) -> Option<&Arc<Occluders>> {
        self.occluders.as_ref()
    }

    /// Gets ready for a weather with what there is.
    pub fn turn_to(&mut self, weather: &Weather) {
        let mut needs = Needs::of(weather, &self.site);
        if needs.paper_cover.is_none() && self.needs.paper_cover.is_some() {
            self.clear();
        } else if needs.paper_cover != self.needs.paper_cover {
            // Still to be made.
            needs.paper_cover = self.needs.paper_cover.take();
        }
        if let Some(place) = self.covers.iter().position(|(airflow, _)| needs.cover == Some(*airflow)) {
            let known = self.covers.remove(place);
            self.covers.push(known);
        }
        self.needs = needs;
    }

    /// Renders the scene without any weather, and without what lies.
    pub fn render_clear(&mut self, camera: &Camera, frame: &mut Frame) -> Result<Stats> {
        let sets = [SetView::plain(self.loaded.set)];
        let job = DrawPass::new(&sets, camera, &self.config);
        Ok(self.loaded.renderer.render(&job, frame)?)
    }
}
