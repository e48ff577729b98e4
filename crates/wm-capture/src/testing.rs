//! Captures of known points and cameras.

use crate::{Capture, CaptureView, Observation};
use glam::{DMat3, DMat4, DQuat, DVec3};
use wm_scene::Camera;
use wm_scene::{SparsePoints, camera::Distortion};

/// A camera turned about its optical axis, radians.
#[must_use]
pub fn rolled(camera: Camera, roll: f64) -> Camera {
    Camera { viewmat: DMat4::from_rotation_z(roll) * camera.viewmat, ..camera }
}

/// The capture of `points` by `cameras`, turned, scaled and moved
/// (`p -> turn * (scale p) + shift`); `sees` tells whether nothing lies between an eye and a point.
#[must_use]
pub fn taken_if(
    cameras: &[Camera],
    points: &[DVec3],
    turn: DQuat,
    scale: f64,
    sees: impl Fn(DVec3, DVec3) -> bool,
) -> Capture {
    let shift = DVec3::new(3.0, -7.0, 11.0);
    let mut stored = SparsePoints::default();
    for point in points {
        stored.push((turn * (*point * scale) + shift).to_array(), [128; 3], 0.5, 2);
    }
    let observations = cameras
        .iter()
        .map(|camera| {
            let seen = points.iter().enumerate().filter_map(|(index, point)| {
                let (x, y, _) = camera.project(*point)?;
                let is_in = x > 0.0 && y > 0.0 && x < f64::from(camera.width) && y < f64::from(camera.height);
                let xy = [x as f32, y as f32];
                (is_in && sees(camera.center(), *point)).then_some(Observation { point: index as u32, xy })
            });
            seen.collect()
        })
        .collect();
    let views = cameras
        .iter()
        .enumerate()
        .map(|(index, camera)| {
            let rotation = camera.rotation() * DMat3::from_quat(turn.inverse());
            let center = turn * (camera.center() * scale) + shift;
            let viewmat = DMat4::from_mat3(rotation) * DMat4::from_translation(-center);
            let name = format!("{index:03}.jpg");
            let camera = Camera { viewmat, ..*camera };
            CaptureView::new(&name, camera, Distortion::None, 1)
        })
        .collect();
    Capture { source: "made up".into(), views, points: stored, observations, ..Capture::default() }
}
