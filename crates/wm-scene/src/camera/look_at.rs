//! Cameras described by a position and a target.

use super::pinhole::{Camera, CameraError};
use glam::DVec3;

/// A camera described by its position and its target, to be completed by the scene it looks at.
///
/// Made by [`Camera::look_at`]; [`LookAt::camera`] turns it into a [`Camera`].
///
/// ```
/// use wm_scene::Camera;
/// use glam::DVec3;
///
/// let look = Camera::look_at([4.0, -20.0, 1.6], [4.0, -30.0, 1.5]).fov_y(50.0).size(1200, 800);
/// let camera = look.camera(DVec3::Z, 0.2)?;
/// assert_eq!((camera.width, camera.height), (1200, 800));
/// assert!((camera.fov_y() - 50.0).abs() < 1e-9);
/// # Ok::<(), wm_scene::CameraError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LookAt {
    eye: DVec3,
    target: DVec3,
    fov_y: f64,
    size: (u32, u32),
    up: Option<DVec3>,
    near: Option<f64>,
}

impl LookAt {
    /// Sets the vertical field of view, degrees, 0.1 to 170; [`Camera::DEFAULT_FOV_Y`] otherwise.
    #[must_use]
    pub fn fov_y(self, degrees: f64) -> Self {
        Self { fov_y: degrees, ..self }
    }

    /// Sets the width and height of the picture, px; [`Camera::DEFAULT_SIZE`] otherwise.
    #[must_use]
    pub fn size(self, width: u32, height: u32) -> Self {
        Self { size: (width, height), ..self }
    }

    /// Sets the direction that is up in the picture, world axes, any length but 0; the scene's
    /// otherwise.
    #[must_use]
    pub fn up(self, up: impl Into<DVec3>) -> Self {
        Self { up: Some(up.into()), ..self }
    }

    /// Sets the near plane, scene units, above 0; that of the scene otherwise.
    #[must_use]
    pub fn near(self, units: f64) -> Self {
        Self { near: Some(units), ..self }
    }

    /// The camera in a scene whose up is `up` and whose near plane is `near`, where this does not
    /// set them.
    ///
    /// # Errors
    /// [`CameraError`] if the size, the field of view, the near plane or the directions make no
    /// camera.
    pub fn camera(&self, up: DVec3, near: f64) -> Result<Camera, CameraError> {
        let up = self.up.unwrap_or(up);
        let camera = Camera::looking(self.size, self.fov_y, self.eye, self.target, up)?;
        let camera = Camera { near: self.near.unwrap_or(near), ..camera };
        camera.check()?;
        Ok(camera)
    }
}

impl Camera {
    /// Vertical field of view of [`Camera::look_at`], degrees.
    pub const DEFAULT_FOV_Y: f64 = 50.0;

    /// Width and height of the picture of [`Camera::look_at`], px.
    pub const DEFAULT_SIZE: (u32, u32) = (1200, 800);

    /// Describes a camera at `eye` that looks at `target`, both world axes, scene units.
    pub fn look_at(eye: impl Into<DVec3>, target: impl Into<DVec3>) -> LookAt {
        LookAt {
            eye: eye.into(),
            target: target.into(),
            fov_y: Self::DEFAULT_FOV_Y,
            size: Self::DEFAULT_SIZE,
            up: None,
            near: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scene_completes_what_is_not_set() {
        let look = Camera::look_at([0.0, -5.0, 1.0], [0.0, 0.0, 1.0]);
        let camera = look.camera(DVec3::Z, 0.3).unwrap();
        assert_eq!((camera.near, camera.fov_y().round(), camera.height), (0.3, 50.0, 800));
        assert!(camera.up().z > 0.999);
        let camera = look.up([0.0, 0.0, -2.0]).near(0.7).size(30, 20).camera(DVec3::Z, 0.3).unwrap();
        assert!(camera.up().z < -0.999 && camera.near == 0.7 && camera.width == 30);
        assert!(look.near(-1.0).camera(DVec3::Z, 0.3).is_err());
        assert!(look.camera(DVec3::Y, 0.3).is_err());
    }
}
