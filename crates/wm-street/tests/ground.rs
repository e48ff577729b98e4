//! The ground that a capture of the built-in street tells, against the street itself.

use glam::DVec3;
use wm_capture::ground::ground;
use wm_capture::testing::{rolled, taken_if};
use wm_scene::Camera;
use wm_scene::synthetic::rotation;
use wm_scene::testing::Dice;
use wm_street::Street;

/// The built-in street, in metres, with true occlusion, however many photos are taken.
#[test]
fn the_built_in_street_is_right_from_eye_level() {
    let street = Street::builtin();
    for (seed, count) in [(1, 6), (2, 10), (3, 24), (4, 70)] {
        let mut dice = Dice::new(seed);
        let cameras: Vec<Camera> = (0..count)
            .map(|index| {
                let mut view = Street::dolly(index as f64 / (count - 1) as f64);
                let step = DVec3::new(dice.draw(-0.8, 0.8), 0.0, dice.draw(-0.2, 0.2));
                view.eye += step;
                view.target += step;
                rolled(view.camera((300, 200)).unwrap(), dice.draw(-0.04, 0.04))
            })
            .collect();
        let points: Vec<DVec3> = (0..2500)
            .filter_map(|_| {
                let camera = &cameras[dice.draw(0.0, count as f64) as usize % count];
                let (x, y) = (dice.draw(0.0, 300.0), dice.draw(0.0, 200.0));
                street.cast(camera.center(), camera.ray(x, y)).map(|hit| hit.point)
            })
            .collect();
        let sees = |eye: DVec3, point: DVec3| {
            street.first(eye, point - eye).is_some_and(|first| first.t > eye.distance(point) - 0.05)
        };
        let capture = taken_if(&cameras, &points, rotation(seed, 3), 0.07, sees);
        let found = ground(&capture).map(|found| found.height / (1.6 * 0.07));
        assert!(found.is_ok_and(|found| (found - 1.0).abs() < 0.1), "{count} photos: {found:?}");
    }
}
