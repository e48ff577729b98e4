//! A pinhole camera.

use super::rigid::{PoseFault, check_rigid, viewmat_at, viewmat_of};
use crate::values::MAX_SCENE_COORDINATE;
use glam::{DMat3, DMat4, DVec3};
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;
use thiserror::Error;

/// Largest picture side, px: keeps every tile count and pixel index inside 32 bits.
pub const MAX_SIDE: u32 = 32_768;

/// Most pixels of a picture, so that the buffers of one fit into 16 GiB.
pub const MAX_PIXELS: u64 = 1 << 28;

/// A pinhole camera with OpenCV axes: x right, y down, z forward.
///
/// A world point `p` is seen at `viewmat * p = (x, y, z)` and projected to
/// `(fx x / z + cx, fy y / z + cy)` pixels; the centre of the top left pixel is `(0.5, 0.5)`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// Picture width, px.
    pub width: u32,
    /// Picture height, px.
    pub height: u32,
    /// Focal length along x, px.
    pub fx: f64,
    /// Focal length along y, px.
    pub fy: f64,
    /// Principal point, px from the left edge.
    pub cx: f64,
    /// Principal point, px from the top edge.
    pub cy: f64,
    /// `camera_from_world`: a rotation and a translation; [`Camera::check`] tolerates errors of
    /// 1e-5 in the products of its rows.
    pub viewmat: DMat4,
    /// Splats whose centre is nearer than this (view z, scene units) are not drawn.
    pub near: f64,
}

/// The reason why numbers do not make a camera.
#[derive(Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum CameraError {
    /// A side is 0 or too long, or there are too many pixels.
    #[error("picture size {width}x{height}: each side must be 1 to {MAX_SIDE} px, {MAX_PIXELS} px in all")]
    Size {
        /// Asked width, px.
        width: u32,
        /// Asked height, px.
        height: u32,
    },
    /// A focal length is not positive, or a number is not finite.
    #[error("camera {field} is {}: {expected}", brief(*value))]
    Value {
        /// Name of the number.
        field: &'static str,
        /// Value of the number.
        value: f64,
        /// The condition that it does not meet.
        expected: &'static str,
    },
    /// The pose is not a rotation with a translation.
    #[error("camera viewmat (camera_from_world) is not a rotation with a translation: {0}")]
    Pose(#[from] PoseFault),
    /// The lens shows one point of its picture twice, or a number of it is not finite.
    #[error("the lens: {0}")]
    Lens(String),
    /// The eye is at the target, or up is along the view.
    #[error(
        "camera from {} to {} with up {} has no direction or no up; look from one point to another, not along up",
        point(eye),
        point(target),
        point(up)
    )]
    Degenerate {
        /// Camera centre.
        eye: DVec3,
        /// Point looked at.
        target: DVec3,
        /// Up vector.
        up: DVec3,
    },
}

/// A number without hundreds of digits.
fn brief(value: f64) -> String {
    if value == 0.0 || (1e-4..1e15).contains(&value.abs()) { value.to_string() } else { format!("{value:e}") }
}

/// Vertical fields of view of pinhole cameras. Beyond them a frame of rain or of a wide lens costs
/// time and memory without bound.
pub const FOV_RANGE_DEG: RangeInclusive<f64> = 0.1..=170.0;
/// Largest distance of a point of the picture from the principal point, focal lengths: 89.7 degrees
/// off the axis.
const MAX_OFFSET_FOCALS: f64 = 200.0;
/// Longest focal length, px, at which a pixel is a hundredth of an arc second wide.
const MAX_FOCAL_PX: f64 = 2e7;

impl Camera {
    /// Default near plane, scene units: that of the reference 3DGS viewers.
    pub const DEFAULT_NEAR: f64 = 0.2;

    /// A camera at `eye` that looks at `target`, the principal point in the middle.
    ///
    /// `fov_y` is the vertical field of view in degrees.
    ///
    /// # Errors
    /// [`CameraError`] if the size, the field of view or the directions make no camera.
    pub fn looking(
        size: (u32, u32),
        fov_y: f64,
        eye: DVec3,
        target: DVec3,
        up: DVec3,
    ) -> Result<Self, CameraError> {
        if !FOV_RANGE_DEG.contains(&fov_y) {
            let expected = "the vertical field of view must be 0.1 to 170 degrees";
            return Err(CameraError::Value { field: "fov", value: fov_y, expected });
        }
        let degenerate = CameraError::Degenerate { eye, target, up };
        let forward = (target - eye).try_normalize().ok_or(degenerate)?;
        let degenerate = CameraError::Degenerate { eye, target, up };
        let right = forward.cross(up.normalize_or_zero());
        if right.length() < 1e-6 {
            return Err(degenerate);
        }
        let right = right.normalize();
        let down = forward.cross(right);
        let rotation = DMat3::from_cols(right, down, forward).transpose();
        let camera = Self::posed(size, fov_y, eye, rotation);
        camera.check()?;
        Ok(camera)
    }

    /// A camera at `eye` with the rotation `camera_from_world`, the principal point in the middle,
    /// square pixels and the default near plane. `fov_y` is the vertical field of view in degrees.
    ///
    /// The numbers are not checked; [`Camera::check`] does that.
    #[must_use]
    pub fn posed(size: (u32, u32), fov_y: f64, eye: DVec3, rotation: DMat3) -> Self {
        let focal = 0.5 * f64::from(size.1) / (0.5 * fov_y.to_radians()).tan();
        let center = [0.5 * f64::from(size.0), 0.5 * f64::from(size.1)];
        Self { viewmat: viewmat_at(rotation, eye), ..Self::pinhole(size, [focal; 2], center) }
    }

    /// A camera at the origin that looks along z, with the default near plane. The numbers, all in
    /// px, are not checked.
    pub fn pinhole(size: (u32, u32), focal: [f64; 2], center: [f64; 2]) -> Self {
        Self {
            width: size.0,
            height: size.1,
            fx: focal[0],
            fy: focal[1],
            cx: center[0],
            cy: center[1],
            viewmat: DMat4::IDENTITY,
            near: Self::DEFAULT_NEAR,
        }
    }

    /// The angle of a pixel near the principal point, where it is widest, along the side where it
    /// is wider, radians.
    #[must_use]
    pub fn widest_pixel(&self) -> f64 {
        1.0 / self.fx.min(self.fy)
    }

    /// Checks that the camera can be rendered with: sizes, numbers and a rigid pose.
    ///
    /// # Errors
    /// [`CameraError`] names the first that cannot.
    pub fn check(&self) -> Result<(), CameraError> {
        let (width, height) = (self.width, self.height);
        let pixels = u64::from(width) * u64::from(height);
        if width.max(height) > MAX_SIDE || !(1..=MAX_PIXELS).contains(&pixels) {
            return Err(CameraError::Size { width, height });
        }
        for (field, value) in [("fx", self.fx), ("fy", self.fy), ("near plane", self.near)] {
            if !(value.is_finite() && value > 0.0) {
                return Err(CameraError::Value { field, value, expected: "must be finite and above 0" });
            }
        }
        let sides = [("cx", self.cx, self.fx, width), ("cy", self.cy, self.fy, height)];
        for (field, value, focal, side) in sides {
            if !value.is_finite() {
                return Err(CameraError::Value { field, value, expected: "must be finite" });
            }
            let reach = value.abs().max((f64::from(side) - value).abs());
            if focal > MAX_FOCAL_PX || reach > MAX_OFFSET_FOCALS * focal {
                let field = if field == "cx" { "fx" } else { "fy" };
                let expected = "a focal length must keep the picture within 89.7 degrees of the axis and pixels wider than 0.01 arc seconds";
                return Err(CameraError::Value { field, value: focal, expected });
            }
        }
        check_rigid(&self.viewmat).map_err(|fault| match fault {
            PoseFault::NotFinite(value) => {
                CameraError::Value { field: "viewmat", value, expected: "must be finite" }
            }
            fault => fault.into(),
        })?;
        let farthest = self.center().abs().max_element();
        if farthest > MAX_SCENE_COORDINATE.into() {
            let expected = "coordinates must be within 10^10 of zero";
            return Err(CameraError::Value { field: "position", value: farthest, expected });
        }
        Ok(())
    }

    /// The camera with its centre moved, world axes.
    #[must_use]
    pub fn moved(&self, by: DVec3) -> Self {
        if by == DVec3::ZERO {
            return *self;
        }
        let rotation = self.rotation();
        let translation = self.viewmat.w_axis.truncate() - rotation * by;
        Self { viewmat: viewmat_of(rotation, translation), ..*self }
    }

    /// The rotation of `viewmat`.
    #[must_use]
    pub fn rotation(&self) -> DMat3 {
        DMat3::from_mat4(self.viewmat)
    }

    /// The camera centre in world axes, scene units.
    #[must_use]
    pub fn center(&self) -> DVec3 {
        -(self.rotation().transpose() * self.viewmat.w_axis.truncate())
    }

    /// The viewing direction in world axes, length 1.
    #[must_use]
    pub fn forward(&self) -> DVec3 {
        self.rotation().row(2)
    }

    /// The direction that is up in the picture, in world axes, length 1.
    #[must_use]
    pub fn up(&self) -> DVec3 {
        -self.rotation().row(1)
    }

    /// The unit direction in world axes through the picture point `(x, y)`, px.
    #[must_use]
    #[inline]
    pub fn ray(&self, x: f64, y: f64) -> DVec3 {
        let local = DVec3::new((x - self.cx) / self.fx, (y - self.cy) / self.fy, 1.0);
        (self.rotation().transpose() * local).normalize()
    }

    /// Picture point (px) and view z of a world point; `None` behind the near plane.
    #[must_use]
    #[inline]
    pub fn project(&self, point: DVec3) -> Option<(f64, f64, f64)> {
        let p = self.viewmat.transform_point3(point);
        (p.z > self.near).then(|| (self.fx * p.x / p.z + self.cx, self.fy * p.y / p.z + self.cy, p.z))
    }

    /// Scales the view to another picture size: x and y are scaled apart, so nothing is cut off.
    #[must_use]
    pub fn resized(&self, width: u32, height: u32) -> Self {
        let (sx, sy) = (f64::from(width) / f64::from(self.width), f64::from(height) / f64::from(self.height));
        Self {
            width,
            height,
            fx: self.fx * sx,
            fy: self.fy * sy,
            cx: self.cx * sx,
            cy: self.cy * sy,
            ..*self
        }
    }

    /// Fits the view to another picture size with square pixels kept: the vertical field of view
    /// stays, more or less is seen at the sides.
    #[must_use]
    pub fn refitted(&self, width: u32, height: u32) -> Self {
        let scale = f64::from(height) / f64::from(self.height);
        Self {
            width,
            height,
            fx: self.fx * scale,
            fy: self.fy * scale,
            cx: (self.cx - 0.5 * f64::from(self.width)) * scale + 0.5 * f64::from(width),
            cy: self.cy * scale,
            ..*self
        }
    }

    /// Vertical field of view, degrees.
    #[must_use]
    pub fn fov_y(&self) -> f64 {
        let (up, down) = (self.cy / self.fy, (f64::from(self.height) - self.cy) / self.fy);
        (up.atan() + down.atan()).to_degrees()
    }
}

/// A point in a message: numbers far from 1 with an exponent, not with hundreds of digits.
fn point(point: &DVec3) -> String {
    point.to_array().map(|v| if v.abs() < 1e6 { format!("{v}") } else { format!("{v:e}") }).join(",")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        let (eye, target) = (DVec3::new(4.0, -60.0, 3.0), DVec3::new(4.0, -31.0, 2.5));
        Camera::looking((1200, 800), 50.0, eye, target, DVec3::Z).unwrap()
    }

    #[test]
    fn a_camera_sees_its_target_in_the_middle() {
        let camera = camera();
        let (x, y, z) = camera.project(DVec3::new(4.0, -31.0, 2.5)).unwrap();
        assert!((x - 600.0).abs() < 1e-9 && (y - 400.0).abs() < 1e-9);
        assert!((z - (29.0f64.powi(2) + 0.25).sqrt()).abs() < 1e-9);
        assert!((camera.center() - DVec3::new(4.0, -60.0, 3.0)).length() < 1e-9);
        assert!(camera.up().z > 0.99);
        assert!((camera.fov_y() - 50.0).abs() < 1e-9);
    }

    #[test]
    fn what_is_higher_is_higher_in_the_picture() {
        let camera = camera();
        let low = camera.project(DVec3::new(4.0, -31.0, 0.0)).unwrap();
        let high = camera.project(DVec3::new(4.0, -31.0, 9.0)).unwrap();
        let right = camera.project(DVec3::new(9.0, -31.0, 2.5)).unwrap();
        assert!(high.1 < low.1 && right.0 > 600.0);
    }

    #[test]
    fn rays_and_projection_agree() {
        let camera = Camera { cx: 500.0, cy: 430.0, ..camera() };
        let ray = camera.ray(123.0, 456.0);
        let (x, y, _) = camera.project(camera.center() + ray * 7.0).unwrap();
        assert!((x - 123.0).abs() < 1e-9 && (y - 456.0).abs() < 1e-9);
    }

    #[test]
    fn cameras_that_cannot_be_are_refused() {
        let (eye, up) = (DVec3::ZERO, DVec3::Z);
        for (size, fov, target) in [
            ((0, 800), 50.0, DVec3::X),
            ((100_000, 800), 50.0, DVec3::X),
            ((32_768, 32_768), 50.0, DVec3::X),
            ((1200, 800), 180.0, DVec3::X),
            ((1200, 800), f64::NAN, DVec3::X),
            ((1200, 800), 50.0, eye),
            ((1200, 800), 50.0, DVec3::Z),
        ] {
            assert!(Camera::looking(size, fov, eye, target, up).is_err());
        }
    }
}
