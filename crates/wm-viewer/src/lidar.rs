//! The lidar whose points are drawn over the picture: its part of a state, and the sweeps that were
//! made last.

use crate::state::{View, check_point};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use std::collections::VecDeque;
use std::sync::Arc;
use weather_magician::lidar::{
    EchoClass, LidarModel, LidarSweep, PRESETS, PointColors, PointOverlay, ReturnMode, ScanOptions, SubRays,
    about,
};
use weather_magician::view::ViewOptions;
use weather_magician::view::spec::CameraSpec;
use wm_scene::Camera;
use wm_scene::survey::Survey;

/// Number of sweeps that are kept: the largest, of a million points with all returns in fog, has
/// some 80 MB.
const MAX_SWEEPS: usize = 3;
/// Largest coordinate of a sensor, scene units.
const MAX_COORDINATE: f64 = 1e6;

/// The lidar of a state, as clients send it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LidarState {
    /// The name of a preset.
    pub(crate) model: String,
    /// The place and the heading; `null` at the camera.
    #[serde(default)]
    pub(crate) at: Option<SensorPlace>,
    /// Rays of a pulse, 1 or 7.
    #[serde(default = "one_ray")]
    pub(crate) sub_rays: u8,
    /// The returns that become points, as `scan --returns` names them.
    #[serde(default = "usual_returns")]
    pub(crate) returns: String,
    /// The colours of points: class, range or intensity.
    #[serde(default = "usual_colors")]
    pub(crate) colors: String,
}

/// The place of a sensor that does not move.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorPlace {
    /// The origin, world axes, scene units.
    eye: [f64; 3],
    /// A point ahead of it.
    target: [f64; 3],
}

fn one_ray() -> u8 {
    1
}

fn usual_returns() -> String {
    "strongest".into()
}

fn usual_colors() -> String {
    "class".into()
}

impl SensorPlace {
    /// Returns the place in a scene of this origin as `scan --at` reads it; bit by bit, if the
    /// origin is zero.
    pub(crate) fn text(&self, origin: DVec3) -> String {
        let world = |point| (DVec3::from_array(point) + origin).to_array();
        [self.eye, self.target].map(|point| world(point).map(|v| v.to_string()).join(",")).join(":")
    }
}

/// The lidar of a state that was checked.
#[derive(Clone, Debug)]
pub struct CheckedLidar {
    /// The lidar.
    pub model: LidarModel,
    /// The camera that a sensor is at which does not move; `None` for the camera of the view.
    pub(crate) fixed: Option<Camera>,
    /// Rays of a pulse.
    sub_rays: SubRays,
    /// The returns that become points.
    returns: ReturnMode,
    /// The colours of points.
    colors: PointColors,
}

impl CheckedLidar {
    /// Checks the lidar of a state.
    ///
    /// # Errors
    /// The first invalid value, in one line.
    pub(crate) fn new(state: &LidarState, survey: &Survey) -> Result<Self, String> {
        let model = LidarModel::preset(&state.model).map_err(|error| format!("lidar: {error}"))?;
        let sub_rays = SubRays::of_count(state.sub_rays.into())
            .ok_or_else(|| format!("lidar.sub_rays is {}: must be 1 or 7", state.sub_rays))?;
        let returns = state.returns.parse().map_err(|_| {
            format!("lidar.returns is `{}`: must be one of {}", state.returns, return_names().join(", "))
        })?;
        let colors = state.colors.parse().map_err(|error: String| format!("lidar.colors: {error}"))?;
        let camera = |place: &SensorPlace| {
            check_point("lidar.at: eye", place.eye)?;
            check_point("lidar.at: target", place.target)?;
            let [eye, target] =
                [place.eye, place.target].map(|point| DVec3::from_array(point) + survey.origin);
            let camera = CameraSpec::LookAt { eye, target }.camera(&[], survey, &ViewOptions::default());
            camera.map_err(|error| format!("lidar.at: {error}"))
        };
        let fixed = state.at.as_ref().map(camera).transpose()?;
        let at = fixed.map_or(DVec3::ZERO, |camera| camera.center());
        if at.abs().max_element() > MAX_COORDINATE {
            return Err(format!("lidar.at: the sensor must be within {MAX_COORDINATE} scene units"));
        }
        Ok(Self { model, fixed, sub_rays, returns, colors })
    }

    /// Returns the options of a sweep at a time, s, as `scan` has them.
    pub fn options(&self, time: f64) -> ScanOptions {
        ScanOptions { time, sub_rays: self.sub_rays, returns: self.returns, ..ScanOptions::default() }
    }
}

/// Returns the presets as JSON.
pub(crate) fn presets() -> Value {
    PRESETS.iter().map(|(name, text)| json!({ "name": name, "about": about(text) })).collect()
}

/// Returns the names of the choices of returns.
pub(crate) fn return_names() -> Vec<&'static str> {
    ReturnMode::ALL.iter().map(|(_, name)| *name).collect()
}

impl View {
    /// Returns true if the sweep of another view is that of this one.
    fn has_sweep_of(&self, other: &Self) -> bool {
        let sweep = |view: &Self| {
            let lidar = view.state.lidar.clone()?;
            let rides = lidar.at.is_none().then(|| (view.state.follow, view.camera_file.clone()));
            Some((LidarState { colors: String::new(), ..lidar }, rides, view.state.time))
        };
        sweep(self) == sweep(other) && self.state.weather == other.state.weather
    }

    /// Returns true if the sweep of another view is of the same sensor at the same place, maybe in
    /// other weather or at another time.
    fn has_sensor_of(&self, other: &Self) -> bool {
        let sensor = |view: &Self| view.state.lidar.clone().map(|lidar| (lidar.model, lidar.at));
        sensor(self) == sensor(other)
    }
}

/// A sweep, or the reason why there is none.
struct MadeSweep {
    view: Arc<View>,
    sweep: Result<LidarSweep, String>,
    /// Duration of its making, s.
    seconds: f64,
    /// The colours, true for greys, and the points in them.
    overlay: Option<(PointColors, bool, Arc<PointOverlay>)>,
}

/// The sweeps that were made last.
#[derive(Default)]
pub struct SweepMemory {
    made: VecDeque<MadeSweep>,
}

impl SweepMemory {
    /// Keeps the outcome of the sweep of a view.
    pub fn insert(&mut self, view: &Arc<View>, sweep: Result<LidarSweep, String>, seconds: f64) {
        while self.made.len() >= MAX_SWEEPS {
            self.made.pop_back();
        }
        self.made.push_front(MadeSweep { view: Arc::clone(view), sweep, seconds, overlay: None });
    }

    /// Forgets all sweeps.
    pub fn clear(&mut self) {
        self.made.clear();
    }

    /// Returns the outcome of the sweep of a view, if it was made.
    pub fn get(&self, view: &View) -> Option<&Result<LidarSweep, String>> {
        self.made.iter().find(|made| made.view.has_sweep_of(view)).map(|made| &made.sweep)
    }

    /// Returns the points to draw over the picture of a view: those of its sweep, or else in greys
    /// those of the last sweep of its sensor. `None` if there are none.
    pub fn overlay(&mut self, view: &View) -> Option<Arc<PointOverlay>> {
        let colors = view.lidar.as_ref()?.colors;
        let own = self.made.iter().position(|made| made.view.has_sweep_of(view));
        let last = || self.made.iter().position(|made| made.view.has_sensor_of(view));
        let (index, is_grey) = own.map(|index| (index, false)).or_else(|| Some((last()?, true)))?;
        let made = &mut self.made[index];
        let sweep = made.sweep.as_ref().ok()?;
        if !made.overlay.as_ref().is_some_and(|(old, grey, _)| (*old, *grey) == (colors, is_grey)) {
            let overlay = PointOverlay::of(sweep, colors);
            let overlay = if is_grey { overlay.greyed() } else { overlay };
            made.overlay = Some((colors, is_grey, Arc::new(overlay)));
        }
        made.overlay.as_ref().map(|(_, _, overlay)| Arc::clone(overlay))
    }

    /// Returns the words for a page that shows a view: the number of points by class, or the reason
    /// why there are none; `null` without a lidar or until the sweep is made.
    pub fn report(&self, view: &View) -> Value {
        let Some(made) = self.made.iter().find(|made| made.view.has_sweep_of(view)) else {
            return Value::Null;
        };
        match &made.sweep {
            Err(error) => json!({ "error": error }),
            Ok(sweep) => {
                let counts = EchoClass::ALL.map(|class| (class.name().to_owned(), sweep.count(class).into()));
                json!({
                    "name": sweep.name, "pulses": sweep.pulses, "points": sweep.points.len(), "ms": 1e3 * made.seconds,
                    "classes": counts.into_iter().collect::<Map<_, _>>(),
                })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::state::{Follow, PoseKey, ViewState};
    use crate::testing::{catalog, state};
    use glam::DMat3;
    use weather_magician::lidar::PointFrame;

    fn lidar(at: Option<SensorPlace>) -> Option<LidarState> {
        let mut lidar: LidarState = serde_json::from_value(json!({ "model": "vlp-16" })).unwrap();
        lidar.at = at;
        Some(lidar)
    }

    fn view(lidar: Option<LidarState>, change: impl FnOnce(&mut ViewState)) -> Arc<View> {
        let mut state = ViewState { lidar, ..state() };
        change(&mut state);
        Arc::new(View::new(state, &catalog(), None).unwrap())
    }

    fn sweep() -> LidarSweep {
        LidarSweep {
            name: "VLP-16".into(),
            time: [0.0, 0.1],
            pose: weather_magician::lidar::SensorPose {
                origin: DVec3::ZERO,
                world_from_sensor: DMat3::IDENTITY,
            },
            metres_per_unit: 1.0,
            frame: PointFrame::Compensated,
            origin: DVec3::ZERO,
            pulses: 3,
            grid: None,
            points: Vec::new(),
        }
    }

    #[test]
    fn a_sweep_depends_on_weather_time_and_sensor_and_not_on_the_camera_of_another() {
        let place = SensorPlace { eye: [1.0, 2.0, 3.0], target: [1.0, 9.0, 3.0] };
        let standing = lidar(Some(place));
        let fly = |state: &mut ViewState| {
            (state.camera.eye, state.size, state.divider) = ([4.0; 3], [30, 20], Some(0.5));
        };
        let of = |lidar: &Option<LidarState>| view(lidar.clone(), |_| {});
        assert!(of(&standing).has_sweep_of(&view(standing.clone(), fly)));
        let red = standing.clone().map(|lidar| LidarState { colors: "range".into(), ..lidar });
        assert!(of(&standing).has_sweep_of(&of(&red)));
        let riding = lidar(None);
        assert!(
            of(&riding).has_sweep_of(&of(&riding)) && !of(&riding).has_sweep_of(&view(riding.clone(), fly))
        );
        let key = |time| PoseKey { time, eye: [time; 3], rotation: state().camera.rotation, fov: 50.0 };
        let along =
            |state: &mut ViewState| (state.follow, state.path) = (Follow::Path, vec![key(0.0), key(1.0)]);
        assert!(of(&standing).has_sweep_of(&view(standing.clone(), along)));
        assert!(!of(&riding).has_sweep_of(&view(riding.clone(), along)));
        let others = [
            view(standing.clone(), |state| state.time = 0.5),
            view(standing.clone(), |state| state.weather = json!({ "fog": {} })),
            of(&standing.clone().map(|lidar| LidarState { sub_rays: 7, ..lidar })),
            of(&standing.clone().map(|lidar| LidarState { returns: "all".into(), ..lidar })),
            of(&standing.clone().map(|lidar| LidarState { model: "mid-40".into(), ..lidar })),
            of(&riding),
        ];
        assert!(others.iter().all(|other| !of(&standing).has_sweep_of(other)));
    }

    #[test]
    fn the_last_sweep_of_a_sensor_stands_in_and_few_are_kept() {
        let mut memory = SweepMemory::default();
        let at = |time: f64| view(lidar(None), |state| state.time = time);
        assert!(memory.overlay(&at(0.0)).is_none() && memory.report(&at(0.0)).is_null());
        memory.insert(&at(0.0), Ok(sweep()), 0.1);
        assert_eq!(memory.report(&at(0.0))["pulses"], 3);
        // Another time: greys, and nothing to report.
        assert!(memory.overlay(&at(1.0)).is_some() && memory.report(&at(1.0)).is_null());
        let other = lidar(Some(SensorPlace { eye: [0.0; 3], target: [1.0, 0.0, 0.0] }));
        assert!(memory.overlay(&view(other, |_| {})).is_none());
        assert!(memory.overlay(&view(None, |_| {})).is_none());
        memory.insert(&at(1.0), Err("no".into()), 0.1);
        assert!(memory.overlay(&at(1.0)).is_none() && memory.report(&at(1.0))["error"] == "no");
        (2..2 + MAX_SWEEPS).for_each(|time| memory.insert(&at(time as f64), Ok(sweep()), 0.1));
        assert!(memory.get(&at(0.0)).is_none() && memory.get(&at(2.0)).is_some());
    }
}
