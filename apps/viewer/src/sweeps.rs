//! The sweeps that were made last, whose points are drawn over the picture.
//!
//! A sweep is kept by what it depends on: the weather, the time, the sensor and its place.

use crate::state::LidarState;
use crate::view::View;
use serde_json::{Map, Value, json};
use std::collections::VecDeque;
use std::sync::Arc;
use weather_magician::lidar::{EchoClass, LidarSweep, PointColors, PointOverlay};

/// Number of sweeps that are kept: the largest, of a million points with all returns in fog, has
/// some 80 MB.
const MAX_SWEEPS: usize = 3;
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
    use crate::state::{Follow, PoseKey, SensorPlace, ViewState};
    use crate::testing::{catalog, state};
    use glam::{DMat3, DVec3};
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
