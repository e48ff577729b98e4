//! The renderer of instruments: a place, and targets in the same renderer and the same air.
//!
//! Plain targets are splats in the air, without the light of the weather. Lit targets are places of
//! their own: their light is split, their shadows are cast and their lamps shine by the code that
//! does it for scenes.

use super::{InstrumentRenderer, InstrumentScan, LevelFrame, ShadowReport, ShotSubject};
use glam::DVec3;
use wm_place::LayerPasses;
use wm_place::frame::FrameInputs;
use wm_place::lidar::{LidarSweep, ReturnMode, ScanOptions, SubRays};
use wm_place::{Error, FrameRequest, Picture, PreparedPlace, Renderer, Result};
use wm_render::{Background, RenderBackend, RenderConfig, SetId, SetView};
use wm_scene::{Camera, Lamp, Metadata, Scene, Splats};
use wm_weather::cover::{Airflow, Buried, Cover, CoverRequest};
use wm_weather::fused_surfaces::FusedSurfaces;
use wm_weather::wetness::WaterState;
use wm_weather::{PreparedWeather, Site, Weather};

/// Distance of the second view to the side of the first, m: not ahead, so that the air in front of
/// both is as long.
const VIEW_BASELINE_M: f64 = 0.3;

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
enum Target {
    Plain(Box<PlainTarget>),
    Lit(Box<PreparedPlace>),
}

/// A target without the light of the weather.
struct PlainTarget {
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
}

impl PlainTarget {
    /// Lays out what lies on it.
    fn lay(&mut self, renderer: &mut Renderer, site: &Site, weather: &PreparedWeather) -> Result<()> {
        let backend = renderer.backend_mut();
        let Self { splats, cover, lying, .. } = self;
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
            let middle = LevelFrame::of(site).point([0.0; 3]).to_array();
            let surfaces = FusedSurfaces::from_splats(splats);
            let made = || Cover::of(splats, &surfaces, site, &airflow, [middle; 2]);
            *cover = Some((airflow, backend.pool().install(made)));
        }
        if let Some((_, cover)) = cover {
            let lies = backend.pool().install(|| cover.lay_all(requests));
            *lying = Some((requests.to_vec(), backend.load(&lies.splats)?, lies.buried));
        }
        Ok(())
    }
}

impl PlainTarget {
    /// Draws the target in the air of a place.
    fn draw(
        &mut self,
        renderer: &mut Renderer,
        place: &PreparedPlace,
        request: &FrameRequest<'_>,
        picture: &mut Picture,
    ) -> Result<()> {
        let site = place.site();
        let weather = request.weather.at(request.time).prepare(site);
        self.lay(renderer, site, &weather)?;
        let Self { set, lying, .. } = self;
        let buried = lying.as_ref().map(|(_, _, buried)| buried as &dyn wm_render::hooks::SplatAttributes);
        let mut sets = vec![SetView::plain(*set).with_attributes(buried)];
        sets.extend(lying.as_ref().map(|(_, set, _)| SetView::plain(*set)));
        let background = Background::Color([0.0; 3]);
        let passes = LayerPasses::of(request.layers);
        let config = RenderConfig { outputs: passes.outputs, background, ..RenderConfig::default() };
        let camera = request.camera.at(request.time, place)?.camera;
        let inputs = FrameInputs::of_sets(&sets, &weather, &camera, &config);
        renderer.draw(&FrameInputs { parts: &passes.parts, ..inputs }, picture)?;
        Ok(())
    }
}

/// The place or the lit target that a subject is.
fn lit_subject<'a>(
    place: &'a mut PreparedPlace,
    targets: &'a mut [Target],
    subject: ShotSubject,
) -> Result<&'a mut PreparedPlace> {
    match subject {
        ShotSubject::Place => Ok(place),
        ShotSubject::Target(index) => match &mut targets[index] {
            Target::Lit(place) => Ok(place),
            Target::Plain(_) => Err(Error::Unsupported("a plain target cannot be swept".into())),
        },
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
        let step = rotation.row(0) * level.units(VIEW_BASELINE_M);
        let viewmat = wm_scene::camera::viewmat_of(rotation, -(rotation * (first.center() + step)));
        Ok([first, Camera { viewmat, ..first }])
    }

    fn set_up(&mut self, splats: Splats) -> Result<ShotSubject> {
        let set = self.renderer.backend_mut().load(&splats)?;
        self.targets.push(Target::Plain(Box::new(PlainTarget { splats, set, cover: None, lying: None })));
        Ok(ShotSubject::Target(self.targets.len() - 1))
    }

    fn set_up_lit(&mut self, splats: Splats, lamps: Vec<Lamp>) -> Result<ShotSubject> {
        let site = self.place.site();
        let metadata = Metadata {
            metres_per_unit: Some(site.metres_per_unit),
            up: Some(DVec3::from_array(site.up)),
            ground: Some(site.ground),
            airlight: Some(site.airlight),
            // Boards are painted in their reflectances.
            white_card: Some(1.0),
            lamps: Some(lamps),
            ..Metadata::default()
        };
        let mut place = self.renderer.load(Scene { splats, metadata, ..Scene::default() })?;
        place.background = Background::Color([0.0; 3]);
        self.targets.push(Target::Lit(Box::new(place)));
        Ok(ShotSubject::Target(self.targets.len() - 1))
    }

    fn clear_away(&mut self) {
        for target in self.targets.drain(..) {
            match target {
                Target::Plain(target) => {
                    let backend = self.renderer.backend_mut();
                    target.lying.iter().for_each(|(_, set, _)| backend.unload(*set));
                    backend.unload(target.set);
                }
                Target::Lit(place) => {
                    // Of this renderer, so it does not fail.
                    let _ = self.renderer.unload(*place);
                }
            }
        }
    }

    fn shadows(&mut self) -> Result<ShadowReport> {
        let capture = self.renderer.capture_light(&mut self.place, &mut ())?;
        let toward = capture.sun.map(|sun| DVec3::from_array(sun.direction));
        Ok(match toward {
            Some(sun) if capture.is_split() => {
                let is_photographed = !self.place.scene().views.is_empty();
                ShadowReport::Split { sun, is_photographed }
            }
            Some(sun) => ShadowReport::Kept { sun },
            None => ShadowReport::None,
        })
    }

    fn water(&mut self, subject: ShotSubject, weather: &Weather, time: f64) -> Result<Option<WaterState>> {
        let Ok(place) = lit_subject(&mut self.place, &mut self.targets, subject) else { return Ok(None) };
        self.renderer.water_state(place, weather, time, &mut ())
    }

    fn scan(&mut self, scan: &InstrumentScan<'_>) -> Result<LidarSweep> {
        let place = lit_subject(&mut self.place, &mut self.targets, scan.subject)?;
        let options = ScanOptions {
            time: scan.time,
            sub_rays: SubRays::One,
            returns: ReturnMode::All,
            ..ScanOptions::default()
        };
        self.renderer.scan_once(place, scan.weather, scan.lidar, scan.motion, &options)
    }

    fn draw(
        &mut self,
        subject: ShotSubject,
        request: &FrameRequest<'_>,
        picture: &mut Picture,
    ) -> Result<()> {
        if let ShotSubject::Target(index) = subject
            && let Target::Plain(target) = &mut self.targets[index]
        {
            return target.draw(&mut self.renderer, &self.place, request, picture);
        }
        let place = lit_subject(&mut self.place, &mut self.targets, subject)?;
        self.renderer.render_into(place, request, picture, &mut ()).map(drop)
    }
}
