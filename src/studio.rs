//! A loaded scene and how it is drawn: all that a frame needs but the weather and the camera.

use crate::progress;
use crate::scene::Loaded;
use crate::view::spec;
use anyhow::Result;
use glam::DVec3;
use std::sync::Arc;
use std::time::Instant;
use wm_render::hooks::{Hooks, Slot, Visibility};
use wm_render::{
    AnyRenderer, Background, Frame, Geometry, Job, MedianDepth, Outputs, RenderConfig, Renderer, SetId,
    SetView, Stats,
};
use wm_scene::survey::{Source, Survey};
use wm_scene::{Camera, Group, Scene, Splats};
use wm_weather::cover::{Airflow, Asked, Buried, Cover, Lying};
use wm_weather::paper::{PaperCover, Stages, composite};
use wm_weather::scan::{Floor, Scan, Sight};
use wm_weather::shelter::{Occluders, Shelter, ShelterOptions};
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

/// What is not made yet of what a picture needs. It takes seconds for a large scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Lack {
    occluders: bool,
    shelter: Option<[f64; 3]>,
    cover: Option<Airflow>,
    /// On what, and what.
    lying: Option<(Airflow, Vec<Asked>)>,
    paper_cover: Option<PaperCover>,
}

impl Lack {
    /// Whether nothing is missing.
    pub fn is_nothing(&self) -> bool {
        *self == Self::default()
    }

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

    /// Whether it is found in what the photos' cameras see.
    pub fn takes_sights(&self) -> bool {
        self.occluders || self.cover.is_some()
    }

    /// Makes it, of a whole scene, what its photos' cameras see, and the cover that [`Studio::lend`] gave.
    pub fn make(&self, of: &Place<'_>, lent: Option<Cover>) -> Made {
        let scan = (self.occluders || self.cover.is_some()).then(|| of.scan());
        let occluders = scan.as_ref().filter(|_| self.occluders);
        let occluders =
            occluders.map(|scan| Arc::new(Occluders::of(&scan.splats, of.site, &ShelterOptions::default())));
        let from = occluders.as_ref().or(of.occluders);
        let shelter = self.shelter.zip(from);
        let new = self.cover.zip(scan.as_ref()).map(|(air, scan)| (air, of.cover(scan, &air)));
        let mut cover = new.or_else(|| self.lying.as_ref().map(|(air, _)| *air).zip(lent));
        let asked = self.lying.clone().zip(cover.as_mut());
        let snow = |paper: &PaperCover| (paper.clone(), paper.snow(&of.scene.splats, of.site));
        Made {
            shelter: shelter.map(|(fall, from)| (fall, from.shelter(fall, Some(of.threads)))),
            lying: asked.map(|(asked, (_, cover))| (cover.lying_on_each_other(&asked.1), asked)),
            cover,
            paper_cover: self.paper_cover.as_ref().map(snow),
            occluders,
        }
    }
}

/// What was missing.
pub struct Made {
    occluders: Option<Arc<Occluders>>,
    shelter: Option<([f64; 3], Shelter)>,
    cover: Option<(Airflow, Cover)>,
    lying: Option<(Lying, (Airflow, Vec<Asked>))>,
    paper_cover: Option<(PaperCover, Splats)>,
}

/// A place as what lies and what stops rain are found in it.
pub struct Place<'a> {
    /// The whole scene.
    pub scene: &'a Scene,
    /// What its photos' cameras see.
    pub sights: &'a [Sight],
    /// What weather knows of it.
    pub site: &'a Site,
    /// What may stop what falls, if that is known.
    pub occluders: Option<&'a Arc<Occluders>>,
    /// Of the work.
    pub threads: usize,
}

impl<'a> Place<'a> {
    /// The surfaces of the place, as its photos' cameras see them.
    fn scan(&self) -> Scan<'a> {
        let waiting = progress::spinner("finding the surfaces that the photos show");
        let scan = Scan::of(&self.scene.splats, self.sights, self.site, self.threads);
        waiting.finish_and_clear();
        scan
    }

    /// What something may lie on.
    fn cover(&self, scan: &Scan<'_>, airflow: &Airflow) -> Cover {
        let waiting = progress::spinner("finding what can be covered");
        let cover = Cover::of(&self.scene.splats, scan, self.site, airflow, path(self.scene), self.threads);
        waiting.finish_and_clear();
        if cover.is_bare() {
            eprintln!(
                "warning: nothing can lie here: no surface looks up at the sky; give --up if up is wrong"
            );
        }
        cover
    }
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
    let visibility = lying.map(|(_, buried)| buried as &dyn Visibility);
    let scene = SetView { set: scene, visibility };
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

/// Where the photos of a place were taken: the line along most of them; without photos the middle of the place.
fn path(scene: &Scene) -> [[f64; 3]; 2] {
    let middle = |points: &[DVec3]| {
        DVec3::from_array(std::array::from_fn(|k| {
            let mut values: Vec<f64> = points.iter().map(|point| point[k]).collect();
            values.sort_by(f64::total_cmp);
            values.get(values.len() / 2).copied().unwrap_or(0.0)
        }))
    };
    let views: Vec<DVec3> = scene.views.iter().map(|view| view.camera.center()).collect();
    if views.is_empty() {
        let means = &scene.splats.means;
        let means: Vec<DVec3> = means.iter().map(|mean| DVec3::from_array(mean.map(f64::from))).collect();
        return [middle(&means).to_array(); 2];
    }
    let middle = middle(&views);
    let far = |a: &&DVec3, b: &&DVec3| a.distance(middle).total_cmp(&b.distance(middle));
    let along = views.iter().max_by(far).map_or(DVec3::X, |far| (far - middle).normalize_or(DVec3::X));
    let mut ways: Vec<f64> = views.iter().map(|view| (view - middle).dot(along)).collect();
    ways.sort_by(f64::total_cmp);
    // Without a twentieth at each end: a stray photo is no path.
    let stray = ways.len() / 20;
    [ways[stray], ways[ways.len() - 1 - stray]].map(|way| (middle + way * along).to_array())
}

/// How the air carries what lies: the mean wind at the start.
pub fn airflow(weather: &Weather, site: &Site) -> Airflow {
    weather.at(0.0).over(site).airflow()
}

/// What something may lie on.
pub fn cover(loaded: &mut Loaded, site: &Site, airflow: &Airflow) -> Result<Cover> {
    let sights = sights_of(loaded)?;
    let place = place(loaded, &sights, site);
    Ok(place.cover(&place.scan(), airflow))
}

fn place<'a>(loaded: &'a Loaded, sights: &'a [Sight], site: &'a Site) -> Place<'a> {
    Place { scene: &loaded.scene, sights, site, occluders: None, threads: loaded.renderer.threads() }
}

/// Photos that say what is free, at most, and their longest side, px.
const SIGHTS: usize = 40;
const SIGHT: f64 = 480.0;

/// All of a scene but its sky.
struct WithoutSky<'a>(&'a [Group]);

impl Visibility for WithoutSky<'_> {
    fn factors(&self, indices: &[u32], out: &mut [f32]) {
        for (index, factor) in indices.iter().zip(out) {
            *factor = if self.0[*index as usize] == Group::Sky { 0.0 } else { 1.0 };
        }
    }
}

/// What the cameras of the photos see, of some of them, in a renderer that holds the scene as `set`.
pub fn sights(renderer: &mut AnyRenderer, set: SetId, scene: &Scene, survey: &Survey) -> Result<Vec<Sight>> {
    let outputs = Outputs { median_depth: MedianDepth::On, ..Outputs::default() };
    let config = RenderConfig { outputs, ..RenderConfig::default() };
    let views = &scene.views;
    let without_sky = WithoutSky(&scene.splats.groups);
    let sets = [SetView { set, visibility: Some(&without_sky) }];
    let mut frame = Frame::default();
    let mut sights = Vec::new();
    for view in views.iter().step_by(views.len().div_ceil(SIGHTS).max(1)) {
        let camera = &view.camera;
        let small = (SIGHT / f64::from(camera.width.max(camera.height))).min(1.0);
        let [width, height] =
            [camera.width, camera.height].map(|side| (f64::from(side) * small).round().max(1.0) as u32);
        let camera = camera.resized(width, height);
        let job = Job { sets: &sets, camera: &camera, config: &config, hooks: Hooks::default() };
        renderer.render(&job, &mut frame)?;
        sights.push(Sight::new(camera, frame.median_depth.clone(), frame.rgb.clone()));
    }
    let floors = floors(scene, survey, &sights);
    sights.iter_mut().for_each(|sight| sight.stop_at(&floors));
    Ok(sights)
}

/// [`sights`] of a scene that is whole.
fn sights_of(loaded: &mut Loaded) -> Result<Vec<Sight>> {
    sights(&mut loaded.renderer, loaded.set, &loaded.scene, &loaded.survey)
}

/// The ground that the photos' cameras were carried over, where it is known or missed.
fn floors(scene: &Scene, survey: &Survey, sights: &[Sight]) -> Vec<Floor> {
    let cameras: Vec<Camera> = scene.views.iter().map(|view| view.camera).collect();
    let (up, ground) = (survey.up.value, survey.ground);
    if let Some(height) = scene.metadata.camera_height {
        let centers: Vec<DVec3> = cameras.iter().map(Camera::center).collect();
        return centers.iter().map(|center| Floor::below(*center, &centers, up, height)).collect();
    }
    let is_known = ground.source != Source::Assumed;
    let whole = is_known.then(|| Floor::under(&cameras, up, ground.value)).flatten();
    whole.filter(|floor| floor.is_lost(sights)).into_iter().collect()
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
            let sights = if lack.takes_sights() { sights_of(&mut studio.loaded)? } else { Vec::new() };
            let made = lack.make(&place(&studio.loaded, &sights, &studio.site), None);
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
        work: impl FnOnce(&mut AnyRenderer, &Job<'_>) -> Result<R>,
    ) -> Result<R> {
        self.with_sky(&weather.at(time).over(&self.site), moving, work)
    }

    fn with_sky<R>(
        &mut self,
        sky: &Sky,
        Moving { camera, velocity }: Moving,
        work: impl FnOnce(&mut AnyRenderer, &Job<'_>) -> Result<R>,
    ) -> Result<R> {
        self.prepare(sky);
        self.lay(sky)?;
        let sets = sets(self.loaded.set, self.lying.as_ref().map(Laid::set));
        let shelter = sky.fall().and(self.shelters.last().map(|(_, shelter)| shelter));
        sky.with_hooks(&Seen { camera: &camera, velocity, shelter }, |hooks| {
            let job = Job { sets: &sets, camera: &camera, config: &self.config, hooks };
            work(&mut self.loaded.renderer, &job)
        })
    }

    /// Renders the scene without any weather, and without what lies.
    pub fn render_clear(&mut self, camera: &Camera, frame: &mut Frame) -> Result<Stats> {
        let sets = [SetView::plain(self.loaded.set)];
        let job = Job { sets: &sets, camera, config: &self.config, hooks: Hooks::default() };
        Ok(self.loaded.renderer.render(&job, frame)?)
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
            Ok(self.renderer.render(&Job { sets: &self.sets, camera, config, hooks }, frame)?)
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
        let config = RenderConfig { outputs: Outputs { geometry, ..asked.outputs }, ..asked.clone() };
        let mut stats = sky.with_hooks(&seen, |hooks| {
            self.renderer.render(&Job { sets: &self.sets, camera, config: &config, hooks }, frame)
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
                let job = Job { sets: &sets, camera, config: &config, hooks: Hooks::default() };
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
