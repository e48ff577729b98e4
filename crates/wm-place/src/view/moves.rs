//! The built-in camera paths: around the scene, forward into it, and along the photos.

use super::path::{CameraPath, PathKey};
use super::space::OccupancyGrid;
use super::{ViewError, ViewOptions, ViewSearch};
use glam::{DMat3, DQuat, DVec3};
use std::f64::consts::TAU;
use std::path::PathBuf;
use std::str::FromStr;
use wm_base::nearest;
use wm_render::Frame;
use wm_scene::survey::Survey;
use wm_scene::{Camera, SceneView};

/// A camera path by name or file, as `--path` takes it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PathSpec {
    /// Once around the middle of the scene: [`orbit`].
    Orbit,
    /// Forward along the view: [`dolly`].
    Dolly,
    /// From photo to photo: [`capture`].
    Capture,
    /// A JSON file of keyframes.
    File(PathBuf),
}

impl PathSpec {
    /// The names of the built-in paths.
    pub const NAMES: [&str; 3] = ["orbit", "dolly", "capture"];
}

impl FromStr for PathSpec {
    type Err = ViewError;

    fn from_str(text: &str) -> Result<Self, ViewError> {
        match text.trim() {
            "orbit" => Ok(Self::Orbit),
            "dolly" => Ok(Self::Dolly),
            "capture" => Ok(Self::Capture),
            file if file.to_lowercase().ends_with(".json") => Ok(Self::File(file.into())),
            other => {
                let meant = match nearest(other, Self::NAMES.into_iter(), 1)[..] {
                    [near] => format!("did you mean {near}?"),
                    _ => format!("give {} or a JSON file of keyframes", Self::NAMES.join(", ")),
                };
                Err(ViewError::text("path", other, format!("unknown path; {meant}")))
            }
        }
    }
}

/// Keys of an orbit: 5 degrees apart the spline is within 1e-6 of the circle.
const ORBIT_KEYS: usize = 72;
/// Keys of a dolly.
const DOLLY_KEYS: usize = 24;
/// Longest way of a dolly, scene radii.
const MAX_DOLLY_RADII: f64 = 0.6;

/// Once around the survey's middle, at the distance and height of the view `start`, looking at the
/// middle, in `duration` seconds; the last key is the first again.
///
/// Where the circle would run through things it is made narrower. Where no circle about the middle
/// is free it turns once on the spot of `start`.
///
/// # Errors
/// [`ViewError`] if the numbers make no path.
pub fn orbit(site: &ViewSearch<'_>, start: &Camera, duration: f64) -> Result<CameraPath, ViewError> {
    let (scene, survey, options) = (site.scene, site.survey, site.options);
    let up = options.up(survey);
    let space = OccupancyGrid::of(&scene.splats, survey);
    let from = start.center() - survey.center;
    let height = from.dot(up);
    let level = from.reject_from_normalized(up);
    let distance = level.length();
    let (outward, distance) = if distance > 0.05 * survey.radius {
        (level / distance, distance)
    } else {
        let back = -start.forward().reject_from_normalized(up);
        (back.try_normalize().unwrap_or_else(|| up.any_orthonormal_vector()), 0.5 * survey.radius)
    };
    let on_circle = |angle: f64, distance: f64| {
        survey.center + up * height + DQuat::from_axis_angle(up, angle) * outward * distance
    };
    // The last is the first to the last bit, which makes the path a loop.
    let angles = || (0..=ORBIT_KEYS).map(|i| TAU * (i % ORBIT_KEYS) as f64 / ORBIT_KEYS as f64);
    let room = 0.02 * survey.radius;
    let is_free = |distance: &f64| angles().all(|angle| space.is_clear(on_circle(angle, *distance), room));
    let free = (0..10).map(|i| distance * 0.85f64.powi(i)).find(is_free);
    let fov = start.fov_y();
    let mut keys = Vec::with_capacity(ORBIT_KEYS + 1);
    for (i, angle) in angles().enumerate() {
        let rotation = match free {
            Some(distance) => {
                let eye = on_circle(angle, distance);
                Camera::looking((1, 1), fov, eye, survey.center, up)?.rotation()
            }
            // camera_from_world turns the other way.
            None => start.rotation() * DMat3::from_axis_angle(up, -angle),
        };
        let eye = free.map_or(start.center(), |distance| on_circle(angle, distance));
        let rotation = DQuat::from_mat3(&rotation).normalize();
        keys.push(PathKey { time: duration * i as f64 / ORBIT_KEYS as f64, eye, rotation, fov });
    }
    CameraPath::new(keys, options.near(survey))
}

/// Forward along the viewing direction of `start`, level, in `duration` seconds, easing in and out;
/// the camera is not turned. It keeps its height above the ground where that rises.
///
/// Without a `distance` (scene units) the way ends well before what stands in it, as a picture of
/// the depth from `start` shows.
///
/// # Errors
/// [`ViewError`] if the view cannot be rendered or the numbers make no path.
pub fn dolly(
    site: &mut ViewSearch<'_>,
    start: &Camera,
    distance: Option<f64>,
    duration: f64,
) -> Result<CameraPath, ViewError> {
    let (scene, survey, options) = (site.scene, site.survey, site.options);
    let up = options.up(survey);
    let eye = start.center();
    let Some(ahead) = start.forward().reject_from_normalized(up).try_normalize() else {
        return Err(ViewError::Scene(
            "the view looks straight up or down: a dolly needs a view that looks ahead".into(),
        ));
    };
    let space = OccupancyGrid::of(&scene.splats, survey);
    let distance = match distance {
        Some(distance) => distance,
        None => room_ahead(site, start, ahead)?,
    };
    let clearance = space.ground(eye).map(|ground| eye.dot(up) - ground).filter(|height| *height > 0.0);
    let rotation = DQuat::from_mat3(&start.rotation()).normalize();
    let mut keys = Vec::with_capacity(DOLLY_KEYS + 1);
    let mut rise = 0.0f64;
    for i in 0..=DOLLY_KEYS {
        let t = i as f64 / DOLLY_KEYS as f64;
        let way = distance * t * t * (3.0 - 2.0 * t);
        let level = eye + ahead * way;
        // Only up: down a slope the view stays level, and a stray low cell is no hole to fall into.
        if let Some((ground, clearance)) = space.ground(level).zip(clearance) {
            rise = rise.max(ground + 0.7 * clearance - eye.dot(up));
        }
        keys.push(PathKey { time: duration * t, eye: level + up * rise, rotation, fov: start.fov_y() });
    }
    smooth(&mut keys, up);
    CameraPath::new(keys, options.near(survey))
}

/// Spreads a rise over several keys, so that a step in the ground is no step of the camera.
fn smooth(keys: &mut [PathKey], up: DVec3) {
    for _ in 0..8 {
        let heights: Vec<f64> = keys.iter().map(|key| key.eye.dot(up)).collect();
        for (i, key) in keys.iter_mut().enumerate().skip(1) {
            let mean = (heights[i - 1] + heights[i] + heights[(i + 1).min(heights.len() - 1)]) / 3.0;
            // Earlier is harmless, later would be in the ground.
            key.eye += up * (mean.max(heights[i]) - heights[i]);
        }
    }
}

/// The free distance along `ahead`, scene units.
fn room_ahead(site: &mut ViewSearch<'_>, start: &Camera, ahead: DVec3) -> Result<f64, ViewError> {
    let (survey, up) = (site.survey, site.options.up(site.survey));
    let camera = start.refitted(180, 120);
    let mut frame = Frame::default();
    site.look(site.set, &camera, &mut frame)?;
    let most = MAX_DOLLY_RADII * survey.radius;
    // A corridor as wide as a person with a tripod, its floor half way down to the ground.
    let half = (0.03 * survey.radius).min(1.0 / survey.metres_per_unit.value);
    let below = (0.5 * survey.height(start.center())).clamp(0.2 * half, half);
    let mut ways = Vec::new();
    for y in 0..frame.height {
        for x in 0..frame.width {
            let i = frame.index(x, y);
            if frame.alpha[i] < 0.3 {
                continue;
            }
            let ray = camera.ray(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let offset = ray * (f64::from(frame.depth[i]) / ray.dot(start.forward()));
            let (way, height) = (offset.dot(ahead), offset.dot(up));
            let aside = (offset - ahead * way - up * height).length();
            if way > 0.0 && aside < half && height > -below && height < half {
                ways.push(way);
            }
        }
    }
    // A few pixels are a twig or a stray.
    ways.sort_by(f64::total_cmp);
    let first = ways.get(5).copied().unwrap_or(most / 0.75);
    Ok((0.75 * (first - half)).clamp(0.05 * most, most))
}

/// From photo to photo in their order, in `duration` seconds, faster where they lie farther apart.
///
/// # Errors
/// [`ViewError`] if there are no views or they make no path.
pub fn capture(
    views: &[SceneView],
    survey: &Survey,
    options: &ViewOptions,
    duration: f64,
) -> Result<CameraPath, ViewError> {
    if views.is_empty() {
        return Err(ViewError::Scene(
            "the scene has no views of photos to go along; give orbit, dolly or a JSON file".into(),
        ));
    }
    let mut keys: Vec<PathKey> = Vec::with_capacity(views.len());
    let steps: Vec<f64> =
        views.windows(2).map(|v| v[0].camera.center().distance(v[1].camera.center())).collect();
    let mean = steps.iter().sum::<f64>() / steps.len().max(1) as f64;
    let mut time = 0.0;
    for view in views {
        let key = PathKey::of(&view.camera, 0.0);
        if let Some(last) = keys.last() {
            // A turn of 30 degrees takes as long as a mean step.
            let turn = last.rotation.angle_between(key.rotation).to_degrees() / 30.0;
            let way = if mean > 0.0 { last.eye.distance(key.eye) / mean } else { 0.0 };
            // The square root evens out what the pace of a photographer was.
            let span = (way + turn).sqrt();
            if span < 1e-3 {
                continue;
            }
            time += span;
        }
        let fov = options.fov.unwrap_or(key.fov);
        keys.push(PathKey { time, fov, ..key });
    }
    if time > 0.0 {
        keys.iter_mut().for_each(|key| key.time *= duration / time);
    }
    CameraPath::new(keys, options.near(survey))
}

#[cfg(test)]
mod tests {
    use super::super::testing::{LoadedScene, place, survey, views};
    use super::*;
    use wm_scene::synthetic::Builder;

    const SIZE: (u32, u32) = (60, 40);

    fn look(eye: [f64; 3], target: [f64; 3]) -> Camera {
        Camera::looking(SIZE, 50.0, eye.into(), target.into(), DVec3::Z).unwrap()
    }

    #[test]
    fn names_are_understood() {
        for (text, expected) in [
            ("orbit", PathSpec::Orbit),
            ("dolly", PathSpec::Dolly),
            (" capture", PathSpec::Capture),
            ("a.JSON", PathSpec::File("a.JSON".into())),
        ] {
            assert_eq!(text.parse::<PathSpec>().unwrap(), expected);
        }
        let say = |text: &str| text.parse::<PathSpec>().unwrap_err().to_string();
        assert_eq!(say("orbti"), "path \"orbti\": unknown path; did you mean orbit?");
        assert_eq!(
            say("spiral"),
            "path \"spiral\": unknown path; give orbit, dolly, capture or a JSON file of keyframes"
        );
    }

    #[test]
    fn an_orbit_goes_round_and_closes() {
        let mut loaded = LoadedScene::new(place("table"), Some(1));
        let start = look([-1.9, 0.0, 1.6], [0.0, 0.0, 0.8]);
        let path = orbit(&loaded.site(ViewOptions::default()), &start, 8.0).unwrap();
        let middle = loaded.survey.center;
        let first = path.at(0.0, SIZE);
        let radius = (first.center() - middle).truncate().length();
        let mut turned = 0.0;
        let mut last = first.center() - middle;
        for i in 0..=400 {
            let camera = path.at(8.0 * f64::from(i) / 400.0, SIZE);
            let from = camera.center() - middle;
            assert!((from.truncate().length() - radius).abs() < 1e-4 * radius);
            assert!((camera.center().z - 1.6).abs() < 1e-9);
            assert!(camera.forward().dot(-from.normalize()) > 0.9999, "it looks at the middle");
            turned += last.truncate().perp_dot(from.truncate()) / radius.powi(2);
            last = from;
        }
        assert!((turned - TAU).abs() < 1e-2, "{turned}");
        assert!(first.center().distance(path.at(8.0, SIZE).center()) < 1e-9);
    }

    #[test]
    fn where_no_circle_is_free_an_orbit_turns_on_the_spot() {
        // A pillar fills the middle of a lane.
        let mut place = Builder::new(1);
        place.surface(DVec3::new(-20.0, -3.0, 0.0), DVec3::X * 40.0, DVec3::Y * 6.0, 0.3, |_, _| [0.4; 3]);
        for y in [-3.0, 3.0] {
            place.surface(DVec3::new(-20.0, y, 0.0), DVec3::X * 40.0, DVec3::Z * 8.0, 0.3, |_, _| [0.7; 3]);
        }
        place.block(DVec3::ZERO, DVec3::new(5.0, 5.0, 8.0), 0.3, [0.5; 3]);
        let mut loaded =
            LoadedScene::new(wm_scene::Scene { splats: place.build(), ..Default::default() }, Some(1));
        let start = look([-12.0, 0.0, 1.6], [0.0, 0.5, 2.0]);
        let path = orbit(&loaded.site(ViewOptions::default()), &start, 4.0).unwrap();
        assert!(path.keys().iter().all(|key| key.eye.distance(start.center()) < 1e-9));
        assert!((path.at(0.0, SIZE).forward() - start.forward()).length() < 1e-6);
        let (there, back) = (start.forward(), path.at(2.0, SIZE).forward());
        assert!((back - DVec3::new(-there.x, -there.y, there.z)).length() < 1e-6);
        // Round to the left, as the circle would go.
        assert!(path.at(1.0, SIZE).forward().y > 0.9 && path.at(1.0, SIZE).up().z > 0.9);
    }

    /// A square of ground 40 m wide that rises by `slope`, with a wall across it at x = 12.
    fn court(slope: f64) -> LoadedScene {
        let mut place = Builder::new(2);
        let along = DVec3::new(40.0, 0.0, 40.0 * slope);
        place.surface(DVec3::new(-20.0, -20.0, 0.0), along, DVec3::Y * 40.0, 0.4, |_, _| [0.4; 3]);
        let foot = DVec3::new(12.0, -20.0, 32.0 * slope);
        place.surface(foot, DVec3::Y * 40.0, DVec3::Z * 9.0, 0.4, |_, _| [0.7; 3]);
        LoadedScene::new(wm_scene::Scene { splats: place.build(), ..Default::default() }, Some(1))
    }

    #[test]
    fn a_dolly_ends_before_the_wall_and_eases() {
        let mut loaded = court(0.0);
        let start = look([-8.0, 0.0, 1.6], [10.0, 0.0, 0.5]);
        let path = dolly(&mut loaded.site(ViewOptions::default()), &start, None, 6.0).unwrap();
        let at = |time: f64| path.at(time, SIZE).center();
        assert!((at(0.0) - start.center()).length() < 1e-9);
        let end = at(6.0);
        assert!((2.0..10.0).contains(&end.x) && end.y.abs() < 1e-9 && (end.z - 1.6).abs() < 1e-6, "{end}");
        let way = end.x + 8.0;
        assert!(at(0.3).x + 8.0 < 0.02 * way && end.x - at(5.7).x < 0.02 * way);
        assert!((at(3.0).x + 8.0 - 0.5 * way).abs() < 1e-3 * way);
        assert!((path.at(3.0, SIZE).forward() - start.forward()).length() < 1e-6);
        // A given distance is taken as it is; backwards too.
        let path = dolly(&mut loaded.site(ViewOptions::default()), &start, Some(-3.0), 1.0).unwrap();
        assert!((path.at(1.0, SIZE).center().x + 11.0).abs() < 1e-9);
    }

    #[test]
    fn a_dolly_stays_above_rising_ground() {
        let mut loaded = court(0.15);
        let up = loaded.survey.up.value;
        let ground = |x: f64| 0.15 * (x + 20.0);
        let eye = DVec3::new(-10.0, 0.0, ground(-10.0) + 1.6);
        let start = Camera::looking(SIZE, 50.0, eye, eye + DVec3::X, up).unwrap();
        let path = dolly(&mut loaded.site(ViewOptions::default()), &start, Some(18.0), 6.0).unwrap();
        for i in 0..=60 {
            let at = path.at(0.1 * f64::from(i), SIZE).center();
            assert!(at.z - ground(at.x) > 0.6, "{at}");
        }
    }

    #[test]
    fn straight_down_there_is_no_way_forward() {
        let mut loaded = court(0.0);
        let start = Camera::looking(SIZE, 50.0, DVec3::Z * 20.0, DVec3::ZERO, DVec3::X).unwrap();
        let error = dolly(&mut loaded.site(ViewOptions::default()), &start, None, 6.0).unwrap_err();
        assert_eq!(
            error.to_string(),
            "the view looks straight up or down: a dolly needs a view that looks ahead"
        );
    }

    #[test]
    fn a_capture_goes_from_photo_to_photo() {
        let mut views = views(&["a", "b", "c", "d"]);
        views[2].camera = views[1].camera;
        let path = capture(&views, &survey(), &ViewOptions::default(), 9.0).unwrap();
        assert_eq!((path.keys().len(), path.start(), path.duration()), (3, 0.0, 9.0));
        for (key, x) in path.keys().iter().zip([0.0, 1.0, 3.0]) {
            assert!((key.eye - DVec3::new(x, 0.0, 1.6)).length() < 1e-9 && (key.fov - 60.0).abs() < 1e-9);
        }
        let alone = capture(&views[..1], &survey(), &ViewOptions::default(), 9.0).unwrap();
        assert_eq!(alone.duration(), 0.0);
        let error = capture(&[], &survey(), &ViewOptions::default(), 9.0).unwrap_err().to_string();
        let expected = "the scene has no views of photos to go along; give orbit, dolly or a JSON file";
        assert_eq!(error, expected);
    }
}
