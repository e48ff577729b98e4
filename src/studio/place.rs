//! What frames of a weather must know of a place: where a fall leaves it dry, and what lies on what. It is made once, of the whole scene
//! and what its photos' cameras see.

use crate::progress;
use crate::scene::Loaded;
use anyhow::Result;
use glam::DVec3;
use std::sync::Arc;
use wm_render::hooks::{Hooks, Visibility};
use wm_render::{AnyRenderer, Frame, Job, MedianDepth, Outputs, RenderConfig, Renderer, SetId, SetView};
use wm_scene::survey::{FactSource, Survey};
use wm_scene::{Camera, Group, Scene, Splats};
use wm_weather::Site;
use wm_weather::cover::{Airflow, Asked, Cover, Lying};
use wm_weather::paper::PaperCover;
use wm_weather::scan::{Floor, Scan, Sight};
use wm_weather::shelter::{Occluders, Shelter, ShelterOptions};

/// What is not made yet of what a picture needs. It takes seconds for a large scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Lack {
    pub(super) occluders: bool,
    pub(super) shelter: Option<[f64; 3]>,
    pub(super) cover: Option<Airflow>,
    /// On what, and what.
    pub(super) lying: Option<(Airflow, Vec<Asked>)>,
    pub(super) paper_cover: Option<PaperCover>,
}

impl Lack {
    /// Whether nothing is missing.
    pub fn is_nothing(&self) -> bool {
        *self == Self::default()
    }

    /// Whether it is found in what the photos' cameras see.
    pub fn takes_sights(&self) -> bool {
        self.occluders || self.cover.is_some()
    }

    /// Makes it, of a whole scene, what its photos' cameras see, and the cover that `Studio::lend` gave.
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
    pub(super) occluders: Option<Arc<Occluders>>,
    pub(super) shelter: Option<([f64; 3], Shelter)>,
    pub(super) cover: Option<(Airflow, Cover)>,
    pub(super) lying: Option<(Lying, (Airflow, Vec<Asked>))>,
    pub(super) paper_cover: Option<(PaperCover, Splats)>,
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

/// What something may lie on.
pub fn cover(loaded: &mut Loaded, site: &Site, airflow: &Airflow) -> Result<Cover> {
    let sights = sights_of(loaded)?;
    let place = place(loaded, &sights, site);
    Ok(place.cover(&place.scan(), airflow))
}

/// A place whose scene is whole.
pub(super) fn place<'a>(loaded: &'a Loaded, sights: &'a [Sight], site: &'a Site) -> Place<'a> {
    Place { scene: &loaded.scene, sights, site, occluders: None, threads: loaded.renderer.threads() }
}

/// Photos that say what is free, at most, and their longest side, px.
const SIGHTS: usize = 40;
const SIGHT: f64 = 480.0;

/// All of a scene but its sky.
struct WithoutSky<'a>(&'a [Group]);

impl SplatAttributes for WithoutSky<'_> {
    fn fill(&self, indices: &[u32], block: &mut AttributeBlock) {
        for (index, factor) in indices.iter().zip(block.column_mut(Attribute::Visibility)) {
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
    let sets = [SetView::plain(set).with_attributes(Some(&without_sky))];
    let mut frame = Frame::default();
    let mut sights = Vec::new();
    for view in views.iter().step_by(views.len().div_ceil(SIGHTS).max(1)) {
        let camera = &view.camera;
        let small = (SIGHT / f64::from(camera.width.max(camera.height))).min(1.0);
        let [width, height] =
            [camera.width, camera.height].map(|side| (f64::from(side) * small).round().max(1.0) as u32);
        let camera = camera.resized(width, height);
        let job = DrawPass::new(&sets, &camera, &config);
        renderer.render(&job, &mut frame)?;
        sights.push(Sight::new(camera, frame.median_depth.clone(), frame.rgb.clone()));
    }
    let floors = floors(scene, survey, &sights);
    sights.iter_mut().for_each(|sight| sight.stop_at(&floors));
    Ok(sights)
}

/// [`sights`] of a scene that is whole.
pub(super) fn sights_of(loaded: &mut Loaded) -> Result<Vec<Sight>> {
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
    let is_known = ground.source != FactSource::Assumed;
    let whole = is_known.then(|| Floor::under(&cameras, up, ground.value)).flatten();
    whole.filter(|floor| floor.is_lost(sights)).into_iter().collect()
}
