//! The park: its plan, viewpoints, and a walk through it.

use crate::Place;
use crate::build::{self, Builder};
use crate::ground::along;
use crate::place::Sights;
use crate::views::{Audience, Viewpoint};
use glam::{DVec2, DVec3};
use wm_scene::Gps;

/// Height of a walker's eyes, m.
const EYE_HEIGHT_M: f64 = 1.6;

/// The plan of the built-in park: 120 x 120 m around a road along y; [`Park::builtin`] builds it.
#[derive(Clone, Copy, Debug)]
pub struct Park;

impl Park {
    /// The park of `seed`: trees, textures and clouds differ, the plan is the same.
    #[must_use]
    pub fn place(seed: u64) -> Place {
        let mut builder = Builder::new(seed);
        build::park::build(&mut builder);
        Place::of("park", builder, Self::sights())
    }

    /// The park as the project's pictures show it.
    #[must_use]
    pub fn builtin() -> Place {
        Self::place(1)
    }

    /// Views that look good, the best first.
    #[must_use]
    pub fn views() -> Vec<Viewpoint> {
        vec![
            Viewpoint::new("pond", [12.0, 8.5, 1.7], [36.0, 26.0, 0.6], 52.0),
            Viewpoint::new("lawn", [12.5, -39.5, 1.6], [30.0, -20.0, 1.2], 52.0),
            Viewpoint::new("hill", [-31.0, 17.0, 7.2], [6.0, -4.0, 0.0], 55.0),
            Viewpoint::new("road", [1.2, -50.0, 1.6], [0.0, 20.0, 2.6], 50.0),
            Viewpoint::new("wood", [-14.0, -30.0, 1.6], [-36.0, -42.0, 3.0], 55.0),
            Viewpoint::new("high", [-58.0, -58.0, 48.0], [4.0, 4.0, 0.0], 53.0),
            Viewpoint::new("above", [2.0, 0.0, 110.0], [2.0, 1e-3, 0.0], 60.0),
        ]
    }

    /// The walk along the path around pond and lawn; `time` runs from 0 to 1.
    fn dolly(place: &Place, time: f64) -> Viewpoint {
        let path = &place.sights.path;
        let (eye, _) = along(path, 0.9 * time);
        let (ahead, _) = along(path, 0.9 * time + 0.1);
        Viewpoint {
            name: "dolly",
            eye: place.above(eye, EYE_HEIGHT_M),
            target: place.above(ahead, EYE_HEIGHT_M - 0.3),
            fov_y: 50.0,
        }
    }

    fn sights() -> Sights {
        Sights {
            views: Self::views(),
            dolly: Self::dolly,
            path: build::park::walk(),
            road: (DVec2::new(1.35, -52.0), DVec2::new(1.35, 30.0)),
            middle: DVec3::new(2.0, 0.0, 0.0),
            orbit: 52.0,
            audience: Audience { x: 4.0, y: (-45.0, 45.0), z: 1.6, lead: 0.0 },
            home: Gps { latitude: 52.0851, longitude: 5.1683, altitude: Some(3.0) },
            lowest: -1.0,
        }
    }
}
