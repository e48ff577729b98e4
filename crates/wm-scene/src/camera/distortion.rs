//! Lens distortion in closed form, its inverse, and the pinhole camera of an undistorted photo.
//!
//! With the ideal point `(x, y)` on the plane z = 1 and `r2 = x^2 + y^2`, a photo shows it at
//! ```text
//! x' = x (1 + k1 r2 + k2 r2^2 + k3 r2^3) + 2 p1 x y + p2 (r2 + 2 x^2)
//! y' = y (1 + k1 r2 + k2 r2^2 + k3 r2^3) + 2 p2 x y + p1 (r2 + 2 y^2)
//! ```
//! (Brown 1966), which is OpenCV's model with five coefficients. COLMAP calls it OPENCV, without
//! k3; its SIMPLE_RADIAL and RADIAL have `p1 = p2 = 0`, too.

use super::pinhole::Camera;

/// The distortion of a lens, relative to a pinhole camera.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Distortion {
    /// A pinhole.
    #[default]
    None,
    /// Along the radius alone.
    Radial {
        /// Coefficient of the squared radius.
        k1: f64,
        /// Coefficient of its fourth power.
        k2: f64,
    },
    /// Radial and tangential.
    OpenCv {
        /// Coefficient of the squared radius.
        k1: f64,
        /// Coefficient of its fourth power.
        k2: f64,
        /// Tangential coefficient, along y.
        p1: f64,
        /// Tangential coefficient, along x.
        p2: f64,
        /// Coefficient of its sixth power.
        k3: f64,
    },
}

/// Points along each edge of a photo at which distortion is inverted.
const EDGE_SAMPLES: u32 = 128;

/// Largest ratio of a side of the undistorted picture to that of the photo.
const MAX_SIDE_RATIO: f64 = 2.0;

impl Distortion {
    /// The least general form of the coefficients k1, k2, p1, p2 and k3, in OpenCV's order.
    #[must_use]
    pub fn of(coefficients: [f64; 5]) -> Self {
        let [k1, k2, p1, p2, k3] = coefficients;
        if p1 != 0.0 || p2 != 0.0 || k3 != 0.0 {
            Self::OpenCv { k1, k2, p1, p2, k3 }
        } else if k1 != 0.0 || k2 != 0.0 {
            Self::Radial { k1, k2 }
        } else {
            Self::None
        }
    }

    /// The distortion that a file gives as k1, k2, p1, p2, k3.
    ///
    /// # Errors
    /// A message, if a coefficient is not finite.
    pub fn from_file(lens: [f64; 5]) -> Result<Self, String> {
        match lens.iter().find(|v| !v.is_finite()) {
            Some(bad) => Err(format!("a coefficient of its distortion is {bad}: must be finite")),
            None => Ok(Self::of(lens)),
        }
    }

    /// k1, k2, p1, p2, k3.
    #[must_use]
    pub fn coefficients(self) -> [f64; 5] {
        match self {
            Self::None => [0.0; 5],
            Self::Radial { k1, k2 } => [k1, k2, 0.0, 0.0, 0.0],
            Self::OpenCv { k1, k2, p1, p2, k3 } => [k1, k2, p1, p2, k3],
        }
    }

    /// The distorted position of the ideal point `(x, y)`, both on the plane z = 1.
    #[must_use]
    pub fn distort(self, x: f64, y: f64) -> (f64, f64) {
        let [k1, k2, p1, p2, k3] = self.coefficients();
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let cross = 2.0 * x * y;
        (x * radial + p1 * cross + p2 * (r2 + 2.0 * x * x), y * radial + p2 * cross + p1 * (r2 + 2.0 * y * y))
    }

    /// The ideal point that is seen at `(x, y)`; `None` where the lens shows none, which is beyond
    /// the radius at which the distortion folds back.
    #[must_use]
    pub fn undistort(self, x: f64, y: f64) -> Option<(f64, f64)> {
        if self == Self::None {
            return Some((x, y));
        }
        // Newton's method from the distorted point: for one sign of k1 it starts inside of the fold
        // and comes from below, for the other there is no fold near.
        let (mut u, mut v) = (x, y);
        for _ in 0..50 {
            let (at_u, at_v) = self.distort(u, v);
            let [a, b, c] = self.slope(u, v);
            let determinant = a * c - b * b;
            if !(determinant > 1e-9 && a > 0.0) {
                return None;
            }
            let (du, dv) = (x - at_u, y - at_v);
            let (step_u, step_v) = ((c * du - b * dv) / determinant, (a * dv - b * du) / determinant);
            // No step goes farther than the picture is wide: far out the slope says little.
            let limit = (1.0 / step_u.hypot(step_v)).min(1.0);
            (u, v) = (u + limit * step_u, v + limit * step_v);
            if step_u.hypot(step_v) < 1e-14 * (1.0 + u.hypot(v)) {
                break;
            }
        }
        let (at_u, at_v) = self.distort(u, v);
        let [a, b, c] = self.slope(u, v);
        let met = (at_u - x).hypot(at_v - y) < 1e-11 * (1.0 + x.hypot(y));
        (met && a * c - b * b > 0.0 && a > 0.0).then_some((u, v))
    }

    /// The derivative of [`Self::distort`]: dx'/dx, dx'/dy (equal to dy'/dx) and dy'/dy.
    fn slope(self, x: f64, y: f64) -> [f64; 3] {
        let [k1, k2, p1, p2, k3] = self.coefficients();
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let growth = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * k3 * r2));
        [
            radial + growth * x * x + 2.0 * p1 * y + 6.0 * p2 * x,
            growth * x * y + 2.0 * p1 * x + 2.0 * p2 * y,
            radial + growth * y * y + 2.0 * p2 * x + 6.0 * p1 * y,
        ]
    }

    /// The pinhole camera of the undistorted photo of `camera`; `None` if the distortion folds over
    /// within the photo.
    ///
    /// It keeps pose and focal lengths, and shows the largest upright rectangle that has no point
    /// outside of the photo on any side: nothing in it is made up, and what lies beyond it is cut
    /// off. COLMAP's undistorter does the same by default, but keeps the principal point at its
    /// share of the width. Its size is whole pixels; sides above twice the photo's are cut.
    #[must_use]
    pub fn undistorted(self, camera: &Camera) -> Option<Camera> {
        if self == Self::None {
            return Some(*camera);
        }
        let (width, height) = (f64::from(camera.width), f64::from(camera.height));
        let ideal =
            |px: f64, py: f64| self.undistort((px - camera.cx) / camera.fx, (py - camera.cy) / camera.fy);
        let (mut left, mut right) = (f64::NEG_INFINITY, f64::INFINITY);
        let (mut top, mut bottom) = (f64::NEG_INFINITY, f64::INFINITY);
        for step in 0..=EDGE_SAMPLES {
            let share = f64::from(step) / f64::from(EDGE_SAMPLES);
            left = left.max(ideal(0.0, share * height)?.0);
            right = right.min(ideal(width, share * height)?.0);
            top = top.max(ideal(share * width, 0.0)?.1);
            bottom = bottom.min(ideal(share * width, height)?.1);
        }
        let (width, cx) = side(left * camera.fx, right * camera.fx, width)?;
        let (height, cy) = side(top * camera.fy, bottom * camera.fy, height)?;
        let camera = Camera { width, height, cx, cy, ..*camera };
        camera.check().ok().map(|()| camera)
    }
}

/// Whole pixels between `low` and `high`, which are seen from the principal point, and where that
/// lies from the first; what is left over goes to both ends.
fn side(low: f64, high: f64, photo: f64) -> Option<(u32, f64)> {
    // A side that comes out as a whole number but for rounding keeps it.
    let length = (high - low + 1e-6).floor().min(MAX_SIDE_RATIO * photo);
    (length >= 1.0).then_some((length as u32, 0.5 * (length - high - low)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn camera() -> Camera {
        Camera::pinhole((640, 480), [500.0, 510.0], [310.0, 250.0])
    }

    #[test]
    fn the_slope_is_the_derivative() {
        let lens = Distortion::of([0.1, -0.05, 0.01, -0.02, 0.03]);
        let (x, y, h) = (0.4, -0.3, 1e-6);
        let [a, b, c] = lens.slope(x, y);
        let along = |dx: f64, dy: f64| {
            let (p, q) = (lens.distort(x + dx, y + dy), lens.distort(x - dx, y - dy));
            ((p.0 - q.0) / (2.0 * h), (p.1 - q.1) / (2.0 * h))
        };
        let (dx, dy) = (along(h, 0.0), along(0.0, h));
        for (found, expected) in [(a, dx.0), (b, dx.1), (b, dy.0), (c, dy.1)] {
            assert!((found - expected).abs() < 1e-9);
        }
    }

    #[test]
    fn a_fold_is_told() {
        // The radius r + k1 r^3 is largest at 1 / sqrt(3 |k1|) = 0.577, and 0.385 there.
        let lens = Distortion::of([-1.0, 0.0, 0.0, 0.0, 0.0]);
        assert!(lens.undistort(0.38, 0.0).is_some());
        assert_eq!(lens.undistort(0.39, 0.0), None);
        assert_eq!(lens.undistorted(&camera()), None);
    }

    #[test]
    fn a_pinhole_stays_as_it_is() {
        assert_eq!(Distortion::None.undistorted(&camera()), Some(camera()));
        let almost = Distortion::of([1e-12, 0.0, 0.0, 0.0, 0.0]).undistorted(&camera()).unwrap();
        assert_eq!((almost.width, almost.height), (640, 480));
        assert!((almost.cx - 310.0).abs() < 1e-6 && (almost.cy - 250.0).abs() < 1e-6);
    }

    proptest! {
        #[test]
        fn undistortion_inverts_distortion(
            k1 in -0.3..0.3f64, k2 in -0.05..0.05f64, p1 in -0.01..0.01f64, p2 in -0.01..0.01f64, k3 in -0.01..0.01f64,
            x in -0.7..0.7f64, y in -0.5..0.5f64,
        ) {
            let lens = Distortion::of([k1, k2, p1, p2, k3]);
            let (u, v) = lens.distort(x, y);
            let (back_x, back_y) = lens.undistort(u, v).unwrap();
            // 1e-12 on the plane is 1e-9 px at a focal length of 1000 px.
            prop_assert!((back_x - x).abs() < 1e-12 && (back_y - y).abs() < 1e-12, "{} {}", back_x - x, back_y - y);
        }

        #[test]
        fn every_pixel_of_the_undistorted_picture_is_in_the_photo(
            k1 in -0.15..0.2f64, k2 in -0.02..0.03f64, p1 in -0.005..0.005f64, p2 in -0.005..0.005f64,
            k3 in -0.005..0.005f64,
        ) {
            let (lens, photo) = (Distortion::of([k1, k2, p1, p2, k3]), camera());
            let ideal = lens.undistorted(&photo).unwrap();
            for (px, py) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0), (0.5, 0.0), (0.0, 0.5), (1.0, 0.5), (0.3, 1.0)] {
                let x = (px * f64::from(ideal.width) - ideal.cx) / ideal.fx;
                let y = (py * f64::from(ideal.height) - ideal.cy) / ideal.fy;
                let (u, v) = lens.distort(x, y);
                let (u, v) = (u * photo.fx + photo.cx, v * photo.fy + photo.cy);
                // Between two of the points looked at along an edge the curve may bend by this
                // much.
                let slack = 0.05;
                prop_assert!(u > -slack && u < 640.0 + slack && v > -slack && v < 480.0 + slack, "{u} {v}");
            }
            prop_assert!(ideal.width > 400 && ideal.height > 300);
        }

        #[test]
        fn no_coefficients_panic(values in prop::array::uniform5(prop::num::f64::ANY)) {
            if let Some(ideal) = Distortion::of(values).undistorted(&camera()) {
                prop_assert!(ideal.check().is_ok());
            }
        }
    }
}
