//! The cameras that one cut of the levels is made for.

use glam::DVec3;
use wm_scene::Camera;

/// Maximum number of cameras of a shot, without the sides of a lens: the view changes little from
/// one to the next.
const MAX_CAMERAS: u32 = 120;
/// Width and height of the views in all directions, px.
const SURROUND_VIEW_SIDE_PX: u32 = 512;

/// Cameras evenly over the frames of a sequence, at most 121, the first and the last among them.
/// With a lens each becomes six views in all directions.
pub fn shot_cameras(frames: u32, camera: impl Fn(u32) -> Camera, has_lens: bool) -> Vec<Camera> {
    let last = frames.saturating_sub(1);
    let stops = last.min(MAX_CAMERAS);
    let at = |stop: u32| camera((u64::from(last) * u64::from(stop) / u64::from(stops.max(1))) as u32);
    let cameras = (0..=stops).map(at);
    if has_lens {
        cameras.flat_map(|camera| cameras_around(camera.center())).collect()
    } else {
        cameras.collect()
    }
}

/// Six cameras that see all sides of a point (world, scene units), for a cut of the levels in which
/// a picture of any lens can be taken.
pub(crate) fn cameras_around(eye: DVec3) -> Vec<Camera> {
    let sides = [DVec3::X, -DVec3::X, DVec3::Y, -DVec3::Y, DVec3::Z, -DVec3::Z];
    let look = |side: DVec3| {
        Camera::looking(
            (SURROUND_VIEW_SIDE_PX, SURROUND_VIEW_SIDE_PX),
            90.0,
            eye,
            eye + side,
            side.any_orthonormal_vector(),
        )
    };
    // Its numbers make a camera wherever the eye is.
    sides.into_iter().filter_map(|side| look(side).ok()).collect()
}
