//! The renderer of instruments: a place, and targets in the same renderer and the same air.

use super::{InstrumentRenderer, InstrumentShot, LevelFrame, ShotSubject};
use crate::frame::FrameRequest;
use crate::{FrameOptions, Picture, PreparedPlace, Renderer, Result};
use wm_render::{Background, RenderBackend, RenderConfig, SetId, SetView};
use wm_scene::{Camera, Splats};
use wm_weather::cover::{Airflow, Buried, Cover, CoverRequest};
use wm_weather::fused_surfaces::FusedSurfaces;
use wm_weather::{PreparedWeather, Site};

/// Distance of the second view to the side of the first, m: not ahead, so that the air in front of both is as long.
const STEP: f64 = 0.3;

/// A place to measure at, and the renderer that holds it.
pub struct PlaceRenderer {
    /// The renderer.
    pub renderer: Renderer,
    /// The place.
    pub place: PreparedPlace,
    camera: Camera,
    targets: Vec<Target>,
}

/// A target of an instrument.
struct Target {
    splats: Splats,
    set: SetId,
    /// The cover of its ground, by how the air carries what lies.
    cover: Option<(Airflow, Cover)>,
    lying: Option<(Vec<CoverRequest>, SetId, Buried)>,
}

impl PlaceRenderer {
    /// Returns the renderer of a place, whose first view is `camera`.
    pub fn new(renderer: Renderer, place: PreparedPlace, camera: Camera) -> Self {
        Self { renderer, place, camera, targets: Vec::new() }
    }

    /// Lays out what lies on a target.
    fn lay(&mut self, index: usize, weather: &PreparedWeather) -> Result<()> {
        let (site, backend) = (*self.place.site(), self.renderer.backend_mut());
        let Target { splats, cover, lying, .. } = &mut self.targets[index];
        let requests = weather.cover();
        if lying.as_ref().map_or(&[][..], |(known, _, _)| known) == requests {
            return Ok(());
        }
        if let Some((_, set, _)) = lying.take() {
            backend.unload(set);
        }
        if requests.is_empty() {
            return Ok(());
        }
        let airflow = weather.airflow();
        if cover.as_ref().is_none_or(|(known, _)| *known != airflow) {
            let threads = backend.threads();
            let middle = LevelFrame::of(&site).point([0.0; 3]).to_array();
            let surfaces = FusedSurfaces::from_splats(splats);
            *cover = Some((airflow, Cover::of(splats, &surfaces, &site, &airflow, [middle; 2], threads)));
        }
        if let Some((_, cover)) = cover {
            let lies = cover.lay_all(requests);
            *lying = Some((requests.to_vec(), backend.load(&lies.splats)?, lies.buried));
        }
        Ok(())
    }
}

impl InstrumentRenderer for PlaceRenderer {
    fn site(&self) -> Site {
        *self.place.site()
    }

    fn views(&mut self) -> Result<[Camera; 2]> {
        let first = self.camera;
        let level = LevelFrame::of(self.place.site());
        let rotation = first.rotation();
        let step = rotation.row(0) * level.units(STEP);
        let viewmat = wm_scene::camera::viewmat_of(rotation, -(rotation * (first.center() + step)));
        Ok([first, Camera { viewmat, ..first }])
    }

    fn set_up(&mut self, splats: Splats) -> Result<ShotSubject> {
        let set = self.renderer.backend_mut().load(&splats)?;
        self.targets.push(Target { splats, set, cover: None, lying: None });
        Ok(ShotSubject::Target(self.targets.len() - 1))
    }

    fn clear_away(&mut self) {
        let backend = self.renderer.backend_mut();
        for target in self.targets.drain(..) {
            target.lying.iter().for_each(|(_, set, _)| backend.unload(*set));
            backend.unload(target.set);
        }
    }

    fn draw(&mut self, shot: &InstrumentShot<'_>, picture: &mut Picture) -> Result<()> {
        let index = match shot.subject {
            ShotSubject::Place => {
                self.place.config.outputs = shot.outputs;
                let options =
                    FrameOptions { parts: shot.parts, ..FrameOptions::new(shot.time, *shot.camera) };
                self.renderer.render_into(&mut self.place, shot.weather, &options, picture, &mut ())?;
                return Ok(());
            }
            ShotSubject::Target(index) => index,
        };
        let weather = shot.weather.at(shot.time).prepare(self.place.site());
        self.lay(index, &weather)?;
        let Target { set, lying, .. } = &self.targets[index];
        let buried = lying.as_ref().map(|(_, _, buried)| buried as &dyn wm_render::hooks::SplatAttributes);
        let mut sets = vec![SetView::plain(*set).with_attributes(buried)];
        sets.extend(lying.as_ref().map(|(_, set, _)| SetView::plain(*set)));
        let background = Background::Color([0.0; 3]);
        let config = RenderConfig { outputs: shot.outputs, background, ..RenderConfig::default() };
        let request = FrameRequest {
            sets: &sets,
            weather: &weather,
            camera: (*shot.camera).into(),
            shelter: None,
            lamps: None,
            threads: 1,
            config: &config,
            parts: shot.parts,
        };
        self.renderer.draw(&request, picture)?;
        Ok(())
    }
}
