//! Renders the views of a scene's photos, which tell its surfaces from haze.
//!
//! Maps of shelter need less detail than the ground under snow, so their views are smaller and
//! fewer (`ViewDetail`).

use crate::Result;
use glam::DVec3;
use wm_render::hooks::{Attribute, AttributeBlock, SplatAttributes};
use wm_render::{
    AnyRenderer, DrawPass, Frame, MedianDepth, Outputs, RenderBackend, RenderConfig, SetId, SetView,
};
use wm_scene::survey::{FactSource, Survey};
use wm_scene::{Camera, Group, Scene};
use wm_weather::fused_surfaces::{FloorPlane, PhotoView};

/// The number and the size of the views that surfaces are found in.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ViewDetail {
    /// Photos that are looked at, at most.
    photos: usize,
    /// Longest side of their views, px.
    side: f64,
}

impl ViewDetail {
    /// Shelter from rain: roofs and crowns, in a fraction of a second.
    pub const SHELTER: Self = Self { photos: 24, side: 192.0 };
    /// The ground under snow, to some centimetres.
    pub const COVER: Self = Self { photos: 40, side: 360.0 };
}

/// All of a scene but its sky.
pub(crate) struct WithoutSky<'a>(&'a [Group]);

impl<'a> WithoutSky<'a> {
    /// The splats of a scene whose sky is labelled.
    pub fn of(scene: &'a Scene) -> Self {
        Self(&scene.splats.groups)
    }
}

impl SplatAttributes for WithoutSky<'_> {
    fn fill(&self, indices: &[u32], block: &mut AttributeBlock) {
        for (index, factor) in indices.iter().zip(block.column_mut(Attribute::Visibility)) {
            *factor = if self.0[*index as usize] == Group::Sky { 0.0 } else { 1.0 };
        }
    }
}

/// Renders what some of the photos' cameras see of a scene, which the renderer holds as `set`.
pub(crate) fn photo_views(
    renderer: &mut AnyRenderer,
    set: SetId,
    scene: &Scene,
    survey: &Survey,
    detail: ViewDetail,
) -> Result<Vec<PhotoView>> {
    let outputs = Outputs { median_depth: MedianDepth::On, ..Outputs::default() };
    let config = RenderConfig { outputs, ..RenderConfig::default() };
    let views = &scene.views;
    let without_sky = WithoutSky::of(scene);
    let sets = [SetView::plain(set).with_attributes(Some(&without_sky))];
    let mut frame = Frame::default();
    let mut seen = Vec::new();
    for view in views.iter().step_by(views.len().div_ceil(detail.photos).max(1)) {
        let camera = &view.camera;
        let scale = (detail.side / f64::from(camera.width.max(camera.height))).min(1.0);
        let [width, height] =
            [camera.width, camera.height].map(|side| (f64::from(side) * scale).round().max(1.0) as u32);
        let camera = camera.resized(width, height);
        renderer.render(&DrawPass::new(&sets, &camera, &config), &mut frame)?;
        seen.push(PhotoView::new(camera, frame.median_depth.clone(), frame.rgb.clone()));
    }
    let floors = floors(scene, survey, &seen);
    Ok(renderer.pool().install(|| PhotoView::stopped_at(&seen, &floors)))
}

/// The ground that the photos' cameras were carried over, where it is known or missed.
fn floors(scene: &Scene, survey: &Survey, seen: &[PhotoView]) -> Vec<FloorPlane> {
    let cameras: Vec<Camera> = scene.views.iter().map(|view| view.camera).collect();
    let (up, ground) = (survey.up.value, survey.ground);
    if let Some(height) = scene.metadata.camera_height {
        let centers: Vec<DVec3> = cameras.iter().map(Camera::center).collect();
        return centers.iter().map(|center| FloorPlane::below(*center, &centers, up, height)).collect();
    }
    let is_known = ground.source != FactSource::Assumed;
    let whole = is_known.then(|| FloorPlane::under(&cameras, up, ground.value)).flatten();
    whole.filter(|floor| floor.is_lost(seen)).into_iter().collect()
}

/// The line along which most photos were taken, by its ends; without photos the middle of the
/// place, twice.
pub(crate) fn path_of_photos(scene: &Scene) -> [[f64; 3]; 2] {
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
