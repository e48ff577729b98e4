//! Lenses that are no pinholes: where a direction is seen in the picture, and the direction of a
//! picture point.

use super::distortion::Distortion;
use super::pinhole::{Camera, CameraError};
use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Points along each side of a picture at which the lens is checked for folds.
const EDGE_SAMPLES: u32 = 64;
/// Steps of the angle from the axis at which a fisheye is checked for folds.
const ANGLE_STEPS: u32 = 512;

/// The projection of a lens, with the focal lengths, the principal point, the size and the pose of
/// a [`Camera`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LensModel {
    /// A pinhole with distortion, OpenCV's model with k1, k2, p1, p2 and k3.
    Perspective(Distortion),
    /// OpenCV's fisheye (Kannala and Brandt 2006): a ray at an angle `t` from the axis is seen at
    /// `t (1 + k1 t^2 + k2 t^4 + k3 t^6 + k4 t^8)` focal lengths from the principal point. With
    /// zeros an equidistant lens.
    Fisheye {
        /// k1, k2, k3, k4.
        radial: [f64; 4],
        /// Largest angle from the axis that is shown, radians, up to half a turn.
        widest: f64,
    },
    /// All directions, longitude along the picture and latitude down it: the middle is forward, the
    /// left and the right edge are behind. Focal lengths and principal point are not used.
    Equirectangular,
}

impl LensModel {
    /// An equidistant fisheye in a picture of this size that shows a circle of `degrees` across its
    /// shorter side, and nothing around it: the lens, and a camera at the origin.
    ///
    /// # Errors
    /// [`CameraError`] if the size makes no picture or the angle is not above 0 and at most 360
    /// degrees.
    pub fn fisheye(size: (u32, u32), degrees: f64) -> Result<(Self, Camera), CameraError> {
        let (width, height) = size;
        if !(degrees > 0.0 && degrees <= 360.0) {
            let expected = "a fisheye shows more than 0 and at most 360 degrees";
            return Err(CameraError::Value { field: "fov", value: degrees, expected });
        }
        let focal = f64::from(width.min(height)) / degrees.to_radians();
        let center = [0.5 * f64::from(width), 0.5 * f64::from(height)];
        let camera = Camera::pinhole(size, [focal; 2], center);
        camera.check()?;
        Ok((Self::Fisheye { radial: [0.0; 4], widest: 0.5 * degrees.to_radians() }, camera))
    }

    /// Checks that no two directions are seen at one point of the picture.
    ///
    /// # Errors
    /// [`CameraError::Lens`] with the angle at which the lens folds; [`CameraError`] if the camera
    /// itself is wrong.
    pub fn check(&self, camera: &Camera) -> Result<(), CameraError> {
        camera.check()?;
        let (width, height) = (f64::from(camera.width), f64::from(camera.height));
        match self {
            Self::Equirectangular => Ok(()),
            Self::Perspective(distortion) => {
                if let Some(bad) = distortion.coefficients().into_iter().find(|v| !v.is_finite()) {
                    return Err(CameraError::Lens(format!("a coefficient is {bad}: must be finite")));
                }
                for step in 0..=EDGE_SAMPLES {
                    let share = f64::from(step) / f64::from(EDGE_SAMPLES);
                    for (x, y) in [(share, 0.0), (share, 1.0), (0.0, share), (1.0, share)] {
                        let (x, y) = (x * width, y * height);
                        if self.ray(camera, [x, y]).is_none() {
                            return Err(CameraError::Lens(format!(
                                "its distortion folds within the picture, at {x:.0},{y:.0} px; check its coefficients"
                            )));
                        }
                    }
                }
                Ok(())
            }
            Self::Fisheye { radial, widest } => {
                if let Some(bad) = radial.iter().chain([widest]).find(|v| !v.is_finite()) {
                    return Err(CameraError::Lens(format!("a coefficient is {bad}: must be finite")));
                }
                let corner =
                    |x: f64, y: f64| ((x - camera.cx) / camera.fx).hypot((y - camera.cy) / camera.fy);
                let farthest = corner(0.0, 0.0)
                    .max(corner(width, 0.0))
                    .max(corner(0.0, height))
                    .max(corner(width, height));
                for step in 0..=ANGLE_STEPS {
                    let angle = widest.min(PI) * f64::from(step) / f64::from(ANGLE_STEPS);
                    let (radius, slope) = radius_of(radial, angle);
                    if slope <= 0.0 {
                        return Err(CameraError::Lens(format!(
                            "its distortion folds {:.0} degrees from the axis, within the picture; check its coefficients",
                            angle.to_degrees()
                        )));
                    }
                    if radius > farthest {
                        break;
                    }
                }
                Ok(())
            }
        }
    }

    /// The direction that is seen at a picture point (px; the centre of the top left pixel is at
    /// 0.5, 0.5): length 1, camera axes (x right, y down, z forward). `None` where the lens shows
    /// nothing.
    #[must_use]
    pub fn ray(&self, camera: &Camera, point: [f64; 2]) -> Option<DVec3> {
        let [x, y] = point;
        let (u, v) = ((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy);
        match self {
            Self::Perspective(distortion) => {
                let (u, v) = distortion.undistort(u, v)?;
                Some(DVec3::new(u, v, 1.0).normalize())
            }
            Self::Fisheye { radial, widest } => {
                let radius = u.hypot(v);
                let angle = angle_of(radial, radius).filter(|angle| angle <= widest)?;
                let (sine, cosine) = angle.sin_cos();
                let scale = if radius > 0.0 { sine / radius } else { 1.0 };
                Some(DVec3::new(u * scale, v * scale, cosine))
            }
            Self::Equirectangular => {
                let longitude = TAU * (x / f64::from(camera.width) - 0.5);
                let latitude = PI * (y / f64::from(camera.height) - 0.5);
                let inside = longitude.abs() <= PI + 1e-9 && latitude.abs() <= FRAC_PI_2 + 1e-9;
                let (level, down) = (latitude.cos(), latitude.sin());
                inside.then(|| DVec3::new(level * longitude.sin(), down, level * longitude.cos()))
            }
        }
    }

    /// The picture point, px, at which a direction in camera axes is seen; `None` where the lens
    /// does not see it.
    #[must_use]
    pub fn project(&self, camera: &Camera, direction: DVec3) -> Option<[f64; 2]> {
        let DVec3 { x, y, z } = direction;
        match self {
            Self::Perspective(distortion) => {
                if z <= 0.0 {
                    return None;
                }
                let (u, v) = distortion.distort(x / z, y / z);
                // Beyond the fold it would be seen a second time.
                let (back_u, back_v) = distortion.undistort(u, v)?;
                let is_same = (back_u - x / z).hypot(back_v - y / z) < 1e-6 * (1.0 + (x / z).hypot(y / z));
                is_same.then_some([camera.fx * u + camera.cx, camera.fy * v + camera.cy])
            }
            Self::Fisheye { radial, widest } => {
                let side = x.hypot(y);
                let angle = side.atan2(z);
                let (radius, slope) = radius_of(radial, angle);
                let scale = if side > 0.0 { radius / side } else { 1.0 };
                (slope > 0.0 && angle <= widest + 1e-9)
                    .then_some([camera.fx * x * scale + camera.cx, camera.fy * y * scale + camera.cy])
            }
            Self::Equirectangular => {
                let longitude = x.atan2(z);
                let latitude = y.atan2(x.hypot(z));
                Some([
                    f64::from(camera.width) * (longitude / TAU + 0.5),
                    f64::from(camera.height) * (latitude / PI + 0.5),
                ])
            }
        }
    }
}

/// Distance from the principal point, focal lengths, at which a fisheye shows an angle from its
/// axis, and its derivative.
fn radius_of(radial: &[f64; 4], angle: f64) -> (f64, f64) {
    let [k1, k2, k3, k4] = radial;
    let square = angle * angle;
    let radius = angle * (1.0 + square * (k1 + square * (k2 + square * (k3 + square * k4))));
    let slope = 1.0 + square * (3.0 * k1 + square * (5.0 * k2 + square * (7.0 * k3 + square * 9.0 * k4)));
    (radius, slope)
}

/// The angle from the axis that a fisheye shows at a distance from the principal point, focal
/// lengths; `None` beyond half a turn and where the lens folds.
fn angle_of(radial: &[f64; 4], radius: f64) -> Option<f64> {
    // Newton's method, kept between two angles that show less and more.
    let (mut low, mut high) = (0.0, PI);
    let mut angle = radius.min(PI);
    for _ in 0..60 {
        let (found, slope) = radius_of(radial, angle);
        if (found - radius).abs() < 1e-13 * (1.0 + radius) {
            break;
        }
        *(if found < radius { &mut low } else { &mut high }) = angle;
        let next = angle - (found - radius) / slope;
        angle = if next > low && next < high { next } else { 0.5 * (low + high) };
    }
    let (found, slope) = radius_of(radial, angle);
    ((found - radius).abs() < 1e-9 * (1.0 + radius) && slope > 0.0).then_some(angle)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn camera() -> Camera {
        LensModel::fisheye((640, 480), 180.0).unwrap().1
    }

    #[test]
    fn known_points_of_lenses() {
        let (lens, camera) = LensModel::fisheye((640, 480), 180.0).unwrap();
        // Half a turn across the height: what is straight up is at the upper edge, and the corners
        // are dark.
        let up = lens.project(&camera, DVec3::NEG_Y).unwrap();
        assert_eq!((lens.ray(&camera, [1.0, 1.0]), lens.project(&camera, DVec3::NEG_Z)), (None, None));
        assert!((up[0] - 320.0).abs() < 1e-9 && up[1].abs() < 1e-9);
        let wide = Camera { width: 360, height: 180, ..camera };
        for (direction, point) in [
            (DVec3::Z, [180.0, 90.0]),
            (DVec3::X, [270.0, 90.0]),
            (DVec3::new(0.0, -1.0, 1.0), [180.0, 45.0]),
            (DVec3::NEG_X, [90.0, 90.0]),
        ] {
            let found = LensModel::Equirectangular.project(&wide, direction).unwrap();
            assert!((found[0] - point[0]).hypot(found[1] - point[1]) < 1e-9, "{direction}: {found:?}");
        }
    }

    #[test]
    fn folds_are_refused() {
        let camera = camera();
        let says = |lens: LensModel| lens.check(&camera).unwrap_err().to_string();
        let folded = says(LensModel::Fisheye { radial: [-0.3, 0.0, 0.0, 0.0], widest: PI });
        // 1 - 0.9 t^2 is 0 at 60.4 degrees.
        assert!(folded.contains("folds 60 degrees from the axis"), "{folded}");
        let folded = says(LensModel::Perspective(Distortion::of([-1.0, 0.0, 0.0, 0.0, 0.0])));
        assert!(folded.contains("folds within the picture"), "{folded}");
        let broken = says(LensModel::Fisheye { radial: [f64::NAN, 0.0, 0.0, 0.0], widest: PI });
        assert!(broken.contains("must be finite"), "{broken}");
        assert!(LensModel::Fisheye { radial: [0.05, 0.01, 0.0, 0.0], widest: PI }.check(&camera).is_ok());
        assert!(LensModel::fisheye((640, 480), 400.0).is_err());
    }

    proptest! {
        #[test]
        fn points_come_back(
            x in 0.0..640.0f64, y in 0.0..480.0f64, k1 in -0.02..0.1f64, k2 in -0.002..0.02f64,
            kind in 0..3usize,
        ) {
            let camera = camera();
            let lens = match kind {
                0 => LensModel::Perspective(Distortion::of([k1, k2, 0.001, -0.002, 0.001])),
                1 => LensModel::Fisheye { radial: [k1, k2, 0.001, -0.0001], widest: 2.0 },
                _ => LensModel::Equirectangular,
            };
            if let Some(ray) = lens.ray(&camera, [x, y]) {
                prop_assert!((ray.length() - 1.0).abs() < 1e-12);
                let [u, v] = lens.project(&camera, ray).unwrap();
                prop_assert!((u - x).hypot(v - y) < 1e-6, "{kind}: {x},{y} becomes {u},{v}");
            } else {
                prop_assert!(kind < 2);
            }
        }

        #[test]
        fn no_coefficients_panic(values in prop::array::uniform5(prop::num::f64::ANY), x in prop::num::f64::ANY) {
            let camera = camera();
            let [a, b, c, d, _] = values;
            for lens in [LensModel::Perspective(Distortion::of(values)), LensModel::Fisheye { radial: [a, b, c, d], widest: x }] {
                let _ = lens.check(&camera);
                let _ = lens.ray(&camera, [x, 3.0]);
                let _ = lens.project(&camera, DVec3::new(x, a, b));
            }
        }
    }
}
