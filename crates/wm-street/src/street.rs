//! The street: its plan, viewpoints, and a walk along it.

use crate::Place;
use crate::build::{self, Builder};
use crate::place::Sights;
use crate::views::{Audience, Viewpoint};
use glam::{DVec2, DVec3};
use wm_scene::Gps;

/// The plan of the built-in street, a village street that runs along +y; [`Street::builtin`] builds
/// it.
#[derive(Clone, Copy, Debug)]
pub struct Street;

/// Keyframes of the walk: share of the time, eye, target.
const WALK_KEYFRAMES: [(f64, DVec3, DVec3); 5] = [
    (0.0, DVec3::new(0.7, 0.0, 1.60), DVec3::new(-0.6, 40.0, 2.6)),
    (0.3, DVec3::new(0.9, 10.5, 1.60), DVec3::new(-1.5, 46.0, 2.8)),
    (0.55, DVec3::new(0.5, 19.5, 1.60), DVec3::new(0.6, 50.0, 2.9)),
    (0.8, DVec3::new(-0.4, 28.0, 1.60), DVec3::new(-6.5, 49.0, 2.6)),
    (1.0, DVec3::new(-0.9, 34.5, 1.60), DVec3::new(-9.5, 48.5, 2.3)),
];

impl Street {
    /// The street of `seed`: trees, textures and clouds differ, the plan is the same.
    #[must_use]
    pub fn place(seed: u64) -> Place {
        let mut builder = Builder::new(seed);
        build::street::build(&mut builder);
        Place::of("street", builder, Self::sights())
    }

    /// The street as the project's pictures show it.
    #[must_use]
    pub fn builtin() -> Place {
        Self::place(1)
    }

    fn sights() -> Sights {
        Sights {
            views: Self::views(),
            dolly: |_, time| Self::dolly(time),
            path: WALK_KEYFRAMES.iter().map(|key| key.1.truncate()).collect(),
            road: (DVec2::new(1.35, -6.0), DVec2::new(1.35, 60.0)),
            middle: DVec3::new(0.0, 28.0, 2.0),
            orbit: 42.0,
            audience: Audience { x: 0.0, y: (-2.0, 36.0), z: 1.6, lead: 1.25 },
            home: Gps { latitude: 52.0907, longitude: 5.1214, altitude: Some(4.0) },
            lowest: -0.002,
        }
    }

    /// Views that look good, the best first.
    #[must_use]
    pub fn views() -> Vec<Viewpoint> {
        vec![
            Viewpoint::new("street", [0.9, -1.5, 1.7], [-1.4, 40.0, 3.4], 50.0),
            Viewpoint::new("porch", [-1.4, 36.5, 1.6], [-9.8, 48.6, 2.3], 48.0),
            Viewpoint::new("corner", [2.2, 12.0, 1.7], [-6.0, 27.0, 3.2], 52.0),
            Viewpoint::new("lime", [1.8, 29.0, 1.6], [-6.5, 43.0, 3.4], 55.0),
            Viewpoint::new("shade", [-2.4, 20.0, 1.7], [5.4, 38.0, 2.9], 52.0),
            Viewpoint::new("high", [0.4, -4.0, 5.8], [-1.6, 45.0, 1.6], 50.0),
        ]
    }

    /// The walk along the street at 1.6 m eye height; `time` runs from 0 to 1.
    ///
    /// At walking speed it takes [`Self::WALK_SECONDS`]. Eye and target run through keyframes on
    /// smooth curves, so neither jerks.
    #[must_use]
    pub fn dolly(time: f64) -> Viewpoint {
        let time = time.clamp(0.0, 1.0);
        let last = WALK_KEYFRAMES.len() - 2;
        let at = (0..=last).rev().find(|i| WALK_KEYFRAMES[*i].0 <= time).unwrap_or(0);
        let (from, to) = (WALK_KEYFRAMES[at], WALK_KEYFRAMES[at + 1]);
        let span = to.0 - from.0;
        let t = (time - from.0) / span;
        // Cubic Hermite; the slope at a key is that of the chord between its neighbours.
        let slope = |i: usize, pick: fn(&(f64, DVec3, DVec3)) -> DVec3| {
            let (a, b) = (
                &WALK_KEYFRAMES[i.saturating_sub(1)],
                &WALK_KEYFRAMES[(i + 1).min(WALK_KEYFRAMES.len() - 1)],
            );
            (pick(b) - pick(a)) / (b.0 - a.0) * span
        };
        let curve = |pick: fn(&(f64, DVec3, DVec3)) -> DVec3| {
            let (t2, t3) = (t * t, t * t * t);
            pick(&from) * (2.0 * t3 - 3.0 * t2 + 1.0)
                + slope(at, pick) * (t3 - 2.0 * t2 + t)
                + pick(&to) * (3.0 * t2 - 2.0 * t3)
                + slope(at + 1, pick) * (t3 - t2)
        };
        Viewpoint { name: "dolly", eye: curve(|k| k.1), target: curve(|k| k.2), fov_y: 50.0 }
    }

    /// The duration of the walk at 1.4 m/s, s.
    pub const WALK_SECONDS: f64 = 25.0;

    /// Lowest and highest corner of the porch's floor, m: all of it lies under the porch's roof.
    #[must_use]
    pub fn porch() -> (DVec3, DVec3) {
        build::porch()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_walk_is_smooth_level_and_at_walking_speed() {
        let steps = 500;
        let views: Vec<Viewpoint> =
            (0..=steps).map(|i| Street::dolly(f64::from(i) / f64::from(steps))).collect();
        let second = Street::WALK_SECONDS / f64::from(steps);
        for pair in views.windows(2) {
            let speed = pair[0].eye.distance(pair[1].eye) / second;
            assert!((0.5..2.2).contains(&speed), "{speed}");
            assert!((pair[0].eye.z - 1.6).abs() < 1e-9);
            let turn = |view: &Viewpoint| (view.target - view.eye).normalize();
            assert!(turn(&pair[0]).angle_between(turn(&pair[1])).to_degrees() / second < 12.0);
        }
        assert_eq!(views[0].eye, WALK_KEYFRAMES[0].1);
        assert!(views[steps as usize].target.distance(WALK_KEYFRAMES[4].2) < 1e-9);
    }

    #[test]
    fn views_make_cameras_and_have_names_of_their_own() {
        for views in [Street::views(), crate::Park::views()] {
            for (index, view) in views.iter().enumerate() {
                assert!(view.camera((300, 200)).is_ok());
                assert!(views[index + 1..].iter().all(|other| other.name != view.name));
            }
        }
    }
}
