//! Chooses a good view of any scene.
//!
//! Where there are photos, it is the view of the one nearest to the middle of all. Otherwise places
//! are tried as a photographer would ([`super::candidates`]): at eye level on the ground, raised,
//! from outside. Small pictures of the most promising are rendered and rated (`rate.rs`); about the
//! best of them it is tried whether a little aside, a turn or a tilt is better.

use super::candidates::{CandidateKind, candidates};
use super::rate::{SIZE, SplatSample, rate};
use super::space::OccupancyGrid;
use super::spec::of_view;
use super::{DEFAULT_FOV, ViewError, ViewSearch};
use glam::{DQuat, DVec3};
use wm_render::{Frame, RenderError, SetId};
use wm_scene::survey::Survey;
use wm_scene::{Camera, Group, SceneView, Splats};

/// A view and how it was found.
#[derive(Clone, Debug, PartialEq)]
pub struct ChosenView {
    /// The camera, for the asked picture size.
    pub camera: Camera,
    /// In words: the photo's name, or that it was chosen.
    pub how: String,
}

/// Number of rated views whose variations are tried.
const VARIED_VIEWS: usize = 2;
/// Rating of the height of a person's eyes.
const EYE_LEVEL_RATING: f64 = 1.0;
/// Most splats in the renders that are rated, those of the sky left aside.
const MAX_RATED_SPLATS: usize = 80_000;

/// A good view of a scene.
///
/// The same scene gives the same view on every machine of one SIMD path. About 50 small renders of
/// at most 80,000 splats.
///
/// # Errors
/// [`ViewError`] if what is given makes no camera or a view cannot be rendered.
pub fn choose(site: &mut ViewSearch<'_>) -> Result<ChosenView, ViewError> {
    let (scene, survey, options) = (site.scene, site.survey, site.options);
    if let Some(view) = middle_view(&scene.views) {
        let how = format!("that of the photo \"{}\"", view.name);
        return Ok(ChosenView { camera: of_view(view, survey, &options)?, how });
    }
    let space = OccupancyGrid::of(&scene.splats, survey);
    let thin = thinned(&scene.splats);
    let set = match &thin {
        Some(thin) => site.renderer.load(thin)?,
        None => site.set,
    };
    let grain = SplatSample::of(&scene.splats);
    let best = ViewCritic { site, set, grain, frame: Frame::default() }.best(&space);
    if thin.is_some() {
        site.renderer.unload(set);
    }
    let best = best?;
    let (eye, forward) = best.map_or_else(|| from_afar(survey), |view| (view.eye, view.forward));
    let fov = options.fov.unwrap_or(DEFAULT_FOV);
    let camera = Camera::looking(options.size(), fov, eye, eye + forward, options.up(survey))?;
    let how = "chosen among views of the scene".into();
    Ok(ChosenView { camera: Camera { near: options.near(survey), ..camera }, how })
}

/// Returns a part of large scenes: every k-th splat, wider by the square root of k, so that
/// surfaces stay closed.
fn thinned(splats: &Splats) -> Option<Splats> {
    let is_sky = |index: &usize| splats.groups[*index] == Group::Sky;
    let (sky, things): (Vec<usize>, Vec<usize>) = (0..splats.len()).partition(is_sky);
    let step = things.len().div_ceil(MAX_RATED_SPLATS);
    if step <= 1 {
        return None;
    }
    let kept: Vec<usize> = things.into_iter().step_by(step).collect();
    let mut thin = splats.select(&[sky, kept.clone()].concat());
    let wider = 0.5 * (step as f32).ln();
    let own = thin.log_scales.len() - kept.len();
    thin.log_scales[own..].iter_mut().flatten().for_each(|scale| *scale += wider);
    Some(thin)
}

/// The view whose camera is nearest to the middle of all.
pub(crate) fn middle_view(views: &[SceneView]) -> Option<&SceneView> {
    let middle = views.iter().map(|v| v.camera.center()).sum::<DVec3>() / views.len().max(1) as f64;
    let distance = |view: &&SceneView| view.camera.center().distance(middle);
    views.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)))
}

/// Returns a view of the whole from outside, for scenes where no view can be rated.
fn from_afar(survey: &Survey) -> (DVec3, DVec3) {
    let up = survey.up.value;
    let side = up.any_orthonormal_vector();
    let back = (side + 0.4 * up).normalize();
    let distance = if survey.radius > 0.0 { 2.5 * survey.radius } else { 3.0 };
    (survey.center + back * distance, -back)
}

/// A rated view.
#[derive(Clone, Copy, Debug)]
struct RatedView {
    kind: CandidateKind,
    eye: DVec3,
    forward: DVec3,
    /// The rating's sum and what the kind of view is worth.
    score: f64,
}

/// Rates views of one scene.
struct ViewCritic<'a, 's> {
    site: &'a mut ViewSearch<'s>,
    /// The splats that are rendered.
    set: SetId,
    grain: SplatSample,
    frame: Frame,
}

impl ViewCritic<'_, '_> {
    /// The rated view; `None` where the directions make no camera.
    fn rated(
        &mut self,
        kind: CandidateKind,
        eye: DVec3,
        forward: DVec3,
    ) -> Result<Option<RatedView>, RenderError> {
        let survey = self.site.survey;
        let camera = Camera::looking(SIZE, DEFAULT_FOV, eye, eye + forward, survey.up.value);
        let Ok(camera) = camera else { return Ok(None) };
        let camera = Camera { near: self.site.options.near(survey), ..camera };
        self.site.look(self.set, &camera, &mut self.frame)?;
        let rating = rate(&self.frame, &camera, survey, &self.grain);
        // A place is first of all what people see of it.
        let worth = if kind == CandidateKind::EyeLevel { EYE_LEVEL_RATING } else { 0.0 };
        Ok(Some(RatedView { kind, eye, forward, score: rating.sum() + worth }))
    }

    /// The rated candidates, the best first.
    fn all(&mut self, space: &OccupancyGrid) -> Result<Vec<RatedView>, RenderError> {
        let mut rated = Vec::new();
        for candidate in candidates(space, self.site.survey) {
            rated.extend(self.rated(candidate.kind, candidate.eye, candidate.forward)?);
        }
        rated.sort_by(|a, b| b.score.total_cmp(&a.score));
        Ok(rated)
    }

    /// The best of the candidates and of the variations of the best few.
    fn best(&mut self, space: &OccupancyGrid) -> Result<Option<RatedView>, RenderError> {
        let rated = self.all(space)?;
        let mut best = rated.first().copied();
        for view in rated.into_iter().take(VARIED_VIEWS) {
            for (eye, forward) in self.variations(space, &view) {
                let varied = self.rated(view.kind, eye, forward)?;
                best = varied.into_iter().chain(best).max_by(|a, b| a.score.total_cmp(&b.score));
            }
        }
        Ok(best)
    }

    /// A step back or aside, a turn, a tilt.
    fn variations(&self, space: &OccupancyGrid, view: &RatedView) -> Vec<(DVec3, DVec3)> {
        let survey = self.site.survey;
        let up = survey.up.value;
        let Some(right) = view.forward.cross(up).try_normalize() else { return Vec::new() };
        let ahead = up.cross(right);
        let step = 0.06 * survey.radius;
        let turned = |axis: DVec3, degrees: f64| {
            (view.eye, DQuat::from_axis_angle(axis, degrees.to_radians()) * view.forward)
        };
        let mut all = vec![turned(up, 12.0), turned(up, -12.0), turned(right, 6.0), turned(right, -6.0)];
        for way in [-ahead, right, -right] {
            let mut eye = view.eye + way * step;
            if let Some((here, there)) = space.ground(view.eye).zip(space.ground(eye)) {
                eye += up * (there - here);
            }
            if space.is_clear(eye, 0.02 * survey.radius) {
                all.push((eye, view.forward));
            }
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::super::ViewOptions;
    use super::super::testing::{LoadedScene, place, real, views};
    use super::*;
    use wm_scene::Scene;

    fn chosen(loaded: &mut LoadedScene) -> Camera {
        choose(&mut loaded.site(ViewOptions::default())).unwrap().camera
    }

    #[test]
    fn the_photo_in_the_middle_wins() {
        let scene = Scene { views: views(&["a", "b", "c", "d"]), ..place("table") };
        let mut loaded = LoadedScene::new(scene, Some(1));
        let options = ViewOptions { size: Some((90, 60)), ..ViewOptions::default() };
        let chosen = choose(&mut loaded.site(options)).unwrap();
        assert_eq!(chosen.how, "that of the photo \"b\"");
        assert_eq!((chosen.camera.width, chosen.camera.center().x.round()), (90, 1.0));
    }

    #[test]
    fn made_up_places_are_seen_well() {
        for name in ["street", "street-sky", "table", "rooms", "village"] {
            let mut loaded = LoadedScene::new(place(name), None);
            let camera = chosen(&mut loaded);
            let (eye, survey) = (camera.center(), &loaded.survey);
            let space = OccupancyGrid::of(&loaded.scene.splats, survey);
            assert!(space.is_clear(eye, 0.01 * survey.radius), "{name}: {eye}");
            assert!(survey.height(eye) > 0.01 * survey.radius, "{name}: {eye}");
            assert!(eye.distance(survey.center) < 2.0 * survey.radius && camera.up().z > 0.7);
            // Along a street, not at its walls; on the table, not under it.
            match name {
                "table" => assert!(eye.z > 0.8, "{eye}"),
                // Inside, under the ceiling.
                "rooms" => assert!((1.2..2.2).contains(&eye.z), "{eye}"),
                "village" => {}
                _ => assert!(camera.forward().x.abs() > 0.8, "{name}: {}", camera.forward()),
            }
        }
    }

    #[test]
    fn threads_do_not_matter() {
        let [one, two] = [1, 2].map(|threads| chosen(&mut LoadedScene::new(place("table"), Some(threads))));
        assert_eq!(one, two);
    }

    #[test]
    fn any_scene_has_a_view() {
        let whole = place("table");
        for count in [0, 1, 40] {
            let splats = whole.splats.select(&(0..count).collect::<Vec<_>>());
            let camera = chosen(&mut LoadedScene::new(Scene { splats, ..Scene::default() }, Some(1)));
            assert!(camera.check().is_ok());
        }
        // What is given shapes the picture.
        let options =
            ViewOptions { fov: Some(30.0), near: Some(0.5), size: Some((64, 64)), up: Some(DVec3::Z) };
        let camera = choose(&mut LoadedScene::new(whole, None).site(options)).unwrap().camera;
        assert!((camera.fov_y() - 30.0).abs() < 1e-9 && (camera.width, camera.near) == (64, 0.5));
    }

    #[test]
    fn real_scenes_are_seen_well() {
        if let Some(garden) = real("headquarter-garden") {
            let camera = chosen(&mut LoadedScene::new(garden, None));
            let eye = camera.center();
            // On the paving of the courtyard, at the height of a person, level.
            assert!((0.0..15.0).contains(&eye.x) && (-70.0..5.0).contains(&eye.y), "{eye}");
            assert!((-0.5..3.0).contains(&eye.z) && camera.forward().z.abs() < 0.3, "{eye}");
        }
        if let Some(camp) = real("taebak") {
            let camera = chosen(&mut LoadedScene::new(camp, None));
            let height = -camera.center().y;
            assert!((1.5..12.0).contains(&height) && camera.forward().y > 0.1, "{height}");
        }
    }
}
