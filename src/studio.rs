//! A loaded scene and how it is drawn: all that a frame needs but the weather and the camera.

#[cfg(feature = "viewer")]
mod draft;
mod place;

pub use place::{Lack, Made, cover};
#[cfg(feature = "viewer")]
pub use place::{Place, sights};

use crate::scene::Loaded;
use crate::view::spec;
use anyhow::Result;
use std::sync::Arc;
use std::time::Instant;
use wm_render::hooks::{Slot, SplatAttributes};
use wm_render::{
    AnyRenderer, Background, DrawPass, Frame, Geometry, Outputs, RenderBackend, RenderConfig, SetId, SetView,
    Stats,
};
use wm_scene::{Camera, Splats};
use wm_weather::cover::{Airflow, Asked, Buried, Cover};
use wm_weather::paper::{PaperCover, Stages, composite};
use wm_weather::shelter::{Occluders, Shelter};
use wm_weather::{Fidelity, Seen, Site, Sky, Weather};

/// Maps of shelter that are kept, one for each direction of fall: enough for a wind that turns.
const MAPS: usize = 6;
/// Covers that are kept, one for each way in which the air carries what lies.
const COVERS: usize = 2;

/// Where frames are made.
pub struct Studio {
    /// The scene.
    pub loaded: Loaded,
    /// What weather knows of it.
    pub site: Site,
    /// What is rendered, and over what.
    pub config: RenderConfig,
    /// Whether frames wait for what is not made yet.
    pub patience: Patience,
    needs: Needs,
    /// What may stop what falls, until it is asked for.
    occluders: Option<Arc<Occluders>>,
    /// Directions of fall with what they leave dry, the last used at the end.
    shelters: Vec<([f64; 3], Shelter)>,
    /// What something may lie on, the last used at the end.
    covers: Vec<(Airflow, Cover)>,
    lying: Option<Laid>,
}

/// Whether frames wait for what is not made yet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Patience {
    /// Every frame is as it must be.
    #[default]
    Whole,
    /// Frames are drawn with what there is, for a camera that moves: snow may be missing or of another instant, and
    /// roofs may not stop the rain.
    Draft,
}

/// What lies, in the renderer.
struct Laid {
    /// On what, and what; `None` for the paper's.
    asked: Option<(Airflow, Vec<Asked>)>,
    set: SetId,
    buried: Buried,
}

impl Laid {
    fn set(&self) -> (SetId, &Buried) {
        (self.set, &self.buried)
    }
}

/// A scene and what lies on it, which hides some of it.
pub fn sets(scene: SetId, lying: Option<(SetId, &Buried)>) -> Vec<SetView<'_>> {
    let attributes = lying.map(|(_, buried)| buried as &dyn SplatAttributes);
    let scene = SetView::plain(scene).with_attributes(attributes);
    [scene].into_iter().chain(lying.map(|(set, _)| SetView::plain(set))).collect()
}

/// What must be known of a place for all frames of a weather.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Needs {
    /// Whether something may fall that roofs stop.
    pub fall: bool,
    /// How the air carries what lies; `None` where nothing does at any time.
    pub cover: Option<Airflow>,
    /// The paper's lying snow.
    pub paper_cover: Option<PaperCover>,
}

impl Needs {
    /// Of a weather at a place.
    pub fn of(weather: &Weather, site: &Site) -> Self {
        // The paper's rain falls through roofs.
        let fall = weather.has_fall() && weather.fidelity == Fidelity::Physical;
        let paper_cover = weather.at(0.0).over(site).paper_cover().cloned();
        let lies = weather.effects().any(|(effect, _)| effect.slot == Slot::Surface) && paper_cover.is_none();
        Self { fall, cover: lies.then(|| airflow(weather, site)), paper_cover }
    }
}

/// How the air carries what lies: the mean wind at the start.
pub fn airflow(weather: &Weather, site: &Site) -> Airflow {
    weather.at(0.0).over(site).airflow()
}

/// Adds to what is kept, and drops the first where it is too much.
fn keep<T>(kept: &mut Vec<T>, new: Option<T>, most: usize) {
    kept.extend(new);
    if kept.len() > most {
        kept.remove(0);
    }
}

/// A camera and how it moves.
#[derive(Clone, Copy, Debug)]
pub struct Moving {
    /// The camera.
    pub camera: Camera,
    /// m/s, world axes.
    pub velocity: [f64; 3],
}

impl From<Camera> for Moving {
    /// One that stands still.
    fn from(camera: Camera) -> Self {
        Self { camera, velocity: [0.0; 3] }
    }
}

impl Studio {
    /// Opens it. The splats as they were read are freed: the renderer has its own.
    ///
    /// # Errors
    /// If there is more lying snow than the renderer holds.
    pub fn new(loaded: Loaded, config: RenderConfig, needs: impl FnOnce(&Site) -> Needs) -> Result<Self> {
        let mut studio = Self::open(loaded, config);
        let needs = needs(&studio.site);
        let lack = studio.lack_of(&needs);
        if !lack.is_nothing() {
            let sights = if lack.takes_sights() { place::sights_of(&mut studio.loaded)? } else { Vec::new() };
            let made = lack.make(&place::place(&studio.loaded, &sights, &studio.site), None);
            studio.take(made)?;
        }
        studio.needs = needs;
        studio.loaded.release();
        Ok(studio)
    }

    /// Opens it for weathers that are not known yet: what they need is made and taken later.
    pub fn open(loaded: Loaded, config: RenderConfig) -> Self {
        Self {
            site: loaded.weather_site(),
            loaded,
            config,
            patience: Patience::default(),
            needs: Needs::default(),
            occluders: None,
            shelters: Vec::new(),
            covers: Vec::new(),
            lying: None,
        }
    }

    /// What is missing for all frames of a weather, but for where a fall leaves the ground dry.
    fn lack_of(&self, needs: &Needs) -> Lack {
        let has = |airflow: &Airflow| self.covers.iter().any(|(known, _)| known == airflow);
        let is_laid = self.needs.paper_cover == needs.paper_cover;
        Lack {
            occluders: needs.fall && self.occluders.is_none(),
            shelter: None,
            cover: needs.cover.filter(|airflow| !has(airflow)),
            lying: None,
            paper_cover: needs.paper_cover.clone().filter(|_| !is_laid),
        }
    }

    /// Takes what was missing.
    ///
    /// # Errors
    /// If there is more lying snow than the renderer holds.
    pub fn take(&mut self, made: Made) -> Result<()> {
        self.occluders = made.occluders.or(self.occluders.take());
        keep(&mut self.shelters, made.shelter, MAPS);
        keep(&mut self.covers, made.cover, COVERS);
        if let Some((lying, asked)) = made.lying {
            self.put(&lying.splats, Some(asked), lying.buried)?;
            self.needs.paper_cover = None;
        }
        if let Some((paper, snow)) = made.paper_cover {
            self.put(&snow, None, Buried::default())?;
            self.needs.paper_cover = Some(paper);
        }
        Ok(())
    }

    /// Puts something in the place of what lies.
    fn put(&mut self, splats: &Splats, asked: Option<(Airflow, Vec<Asked>)>, buried: Buried) -> Result<()> {
        self.clear();
        let set = self.loaded.renderer.load(splats)?;
        self.lying = Some(Laid { asked, set, buried });
        Ok(())
    }

    /// Takes away what lies.
    fn clear(&mut self) {
        if let Some(old) = self.lying.take() {
            self.loaded.renderer.unload(old.set);
        }
    }

    /// Lays out what lies under `sky`, if it is not there.
    fn lay(&mut self, sky: &Sky) -> Result<()> {
        if self.needs.paper_cover.is_some() {
            // It lies there from the start.
            return Ok(());
        }
        let asked = if self.needs.cover.is_some() { sky.cover() } else { &[] };
        if asked.is_empty() {
            self.clear();
            return Ok(());
        }
        let is_laid =
            |(airflow, known): &(Airflow, Vec<Asked>)| Some(*airflow) == self.needs.cover && known == asked;
        let is_there = self.lying.as_ref().is_some_and(|lying| lying.asked.as_ref().is_some_and(is_laid));
        let Some((airflow, cover)) = self.covers.last_mut() else { return Ok(()) };
        if is_there || self.patience == Patience::Draft {
            return Ok(());
        }
        let lying = cover.lying_on_each_other(asked);
        let asked = (*airflow, asked.to_vec());
        self.put(&lying.splats, Some(asked), lying.buried)
    }

    /// The renderer with the scene and what lies on it under `sky`, and how it is to be drawn.
    fn stand(&mut self, sky: &Sky) -> Result<(Stand<'_>, &RenderConfig)> {
        self.lay(sky)?;
        let sets = sets(self.loaded.set, self.lying.as_ref().map(Laid::set));
        Ok((Stand { renderer: &mut self.loaded.renderer, sets }, &self.config))
    }

    /// Makes the map of where what falls under `sky` does not, the last of the list, if it is not there.
    fn prepare(&mut self, sky: &Sky) {
        let (Some(fall), Some(occluders)) = (sky.fall(), &self.occluders) else { return };
        if let Some(place) = self.shelters.iter().position(|(known, _)| *known == fall) {
            let known = self.shelters.remove(place);
            self.shelters.push(known);
        } else if self.patience == Patience::Whole {
            let shelter = occluders.shelter(fall, Some(self.loaded.renderer.threads()));
            keep(&mut self.shelters, Some((fall, shelter)), MAPS);
        }
    }

    /// Renders the instant `time` of a weather, alone: nothing depends on other frames.
    pub fn render(
        &mut self,
        weather: &Weather,
        time: f64,
        moving: Moving,
        frame: &mut Frame,
    ) -> Result<Stats> {
        let sky = weather.at(time).over(&self.site);
        if !sky.paper_falls().is_empty() {
            let (mut stand, config) = self.stand(&sky)?;
            return stand.render_as_paper(&sky, config, moving, frame, None);
        }
        self.with_sky(&sky, moving, |renderer, job| Ok(renderer.render(job, frame)?))
    }

    /// Calls `work` with the renderer and all that a picture of the instant `time` is made of, but for the paper's rain
    /// and snow, which take several.
    pub fn with_job<R>(
        &mut self,
        weather: &Weather,
        time: f64,
        moving: Moving,
        work: impl FnOnce(&mut AnyRenderer, &DrawPass<'_>) -> Result<R>,
    ) -> Result<R> {
        self.with_sky(&weather.at(time).over(&self.site), moving, work)
    }

    fn with_sky<R>(
        &mut self,
        sky: &Sky,
        Moving { camera, velocity }: Moving,
        work: impl FnOnce(&mut AnyRenderer, &DrawPass<'_>) -> Result<R>,
    ) -> Result<R> {
        self.prepare(sky);
        self.lay(sky)?;
        let sets = sets(self.loaded.set, self.lying.as_ref().map(Laid::set));
        let shelter = sky.fall().and(self.shelters.last().map(|(_, shelter)| shelter));
        sky.with_hooks(&Seen { camera: &camera, velocity, shelter }, |hooks| {
            let job = DrawPass::new(&sets, &camera, &self.config).with_hooks(hooks);
            work(&mut self.loaded.renderer, &job)
        })
    }

    /// The same in the paper's fidelity with rain or snow, and what lies between the clear picture and the last; where
    /// none falls that is the picture itself, without noise.
    pub fn render_stages(
        &mut self,
        weather: &Weather,
        time: f64,
        moving: Moving,
        (frame, stages): (&mut Frame, &mut Stages),
    ) -> Result<Stats> {
        let sky = weather.at(time).over(&self.site);
        let (mut stand, config) = self.stand(&sky)?;
        stand.render_as_paper(&sky, config, moving, frame, Some(stages))
    }

    /// The renderer in words.
    pub fn describe(&self) -> String {
        self.loaded.renderer.describe()
    }

    /// What is written into a file besides its pixels; `scene` is the name of the scene.
    pub fn tags(&self, scene: &str, weather: &Weather, time: f64, camera: &Camera) -> Vec<(String, String)> {
        vec![
            ("program".into(), concat!("weather-magician ", env!("CARGO_PKG_VERSION")).into()),
            ("scene".into(), scene.into()),
            ("weather".into(), weather_text(weather, time)),
            ("time".into(), format!("{time} s")),
            ("camera".into(), spec::text_of(camera)),
            // Without the number of threads: no byte of a picture depends on it, and none of its words may.
            ("renderer".into(), self.loaded.renderer.arithmetic()),
            ("metres_per_unit".into(), self.site.metres_per_unit.to_string()),
        ]
    }
}

/// A renderer with a scene in it.
pub struct Stand<'a> {
    /// The renderer.
    pub renderer: &'a mut AnyRenderer,
    /// The scene, and what lies on it.
    pub sets: Vec<SetView<'a>>,
}

impl Stand<'_> {
    /// Renders what is under a sky, without shelter.
    pub fn render(
        &mut self,
        sky: &Sky,
        config: &RenderConfig,
        moving: Moving,
        frame: &mut Frame,
    ) -> Result<Stats> {
        if !sky.paper_falls().is_empty() {
            return self.render_as_paper(sky, config, moving, frame, None);
        }
        let camera = &moving.camera;
        let seen = Seen { camera, velocity: moving.velocity, shelter: None };
        sky.with_hooks(&seen, |hooks| {
            Ok(self.renderer.render(&DrawPass::new(&self.sets, camera, config).with_hooks(hooks), frame)?)
        })
    }

    /// Draws the scene, then each sub-cloud of what falls by itself, and lays them over it.
    fn render_as_paper(
        &mut self,
        sky: &Sky,
        asked: &RenderConfig,
        Moving { camera, velocity }: Moving,
        frame: &mut Frame,
        mut stages: Option<&mut Stages>,
    ) -> Result<Stats> {
        let started = Instant::now();
        let camera = &camera;
        let seen = Seen { camera, velocity, shelter: None };
        let geometry = match asked.outputs.geometry {
            Geometry::None => Geometry::Depth,
            other => other,
        };
        let config = RenderConfig { outputs: Outputs { geometry, ..asked.outputs }, ..*asked };
        let mut stats = sky.with_hooks(&seen, |hooks| {
            self.renderer.render(&DrawPass::new(&self.sets, camera, &config).with_hooks(hooks), frame)
        })?;
        if let Some(stages) = &mut stages {
            stages.begin(frame);
        }
        let config = RenderConfig {
            outputs: Outputs { geometry: Geometry::Depth, ..Outputs::default() },
            background: Background::default(),
            ..config
        };
        let mut noise = Frame::default();
        for fall in sky.paper_falls() {
            let blend = sky.blend(fall, camera);
            for cloud in sky.sub_clouds(fall, &seen) {
                let set = self.renderer.load(&cloud)?;
                let sets = [SetView::plain(set)];
                let job = DrawPass::new(&sets, camera, &config);
                let drawn = self.renderer.render(&job, &mut noise);
                self.renderer.unload(set);
                stats += drawn?;
                composite::add(&blend, frame, &noise, stages.as_deref_mut());
            }
        }
        sky.finish(self.renderer.path(), frame);
        if asked.outputs.geometry == Geometry::None {
            frame.depth.clear();
        }
        stats.wall = started.elapsed().as_secs_f64();
        Ok(stats)
    }
}

/// The weather of an instant with every value that is not its default.
fn weather_text(weather: &Weather, time: f64) -> String {
    let instant = weather.at(time);
    let mut words = vec![weather.name.clone(), instant.fidelity.name().to_owned()];
    for (effect, values) in instant.effects() {
        for (param, value) in effect.params.iter().zip(values) {
            if *value != param.default || param.name == "mor" {
                words.push(format!("{}.{}={value}", effect.name, param.name));
            }
        }
    }
    words.join(" ")
}
