//! The primitives of the place, each with its closed forms: crossing, bounds, area, points.

use glam::DVec3;
use std::f64::consts::{PI, TAU};

/// The part of a [`Shape::Flat`]'s unit square `(a, b)` that is covered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Outline {
    /// All of it.
    Parallelogram,
    /// `a + b <= 1`.
    Triangle,
    /// The ellipse that fits in.
    Ellipse,
    /// Between two parabolas that meet in points at `a` 0 and 1: a leaf, its rib along `u`.
    Leaf,
}

impl Outline {
    fn contains(self, a: f64, b: f64) -> bool {
        if !((0.0..=1.0).contains(&a) && (0.0..=1.0).contains(&b)) {
            return false;
        }
        match self {
            Self::Parallelogram => true,
            Self::Triangle => a + b <= 1.0,
            Self::Ellipse => (2.0 * a - 1.0).powi(2) + (2.0 * b - 1.0).powi(2) <= 1.0,
            Self::Leaf => (b - 0.5).abs() <= 2.0 * a * (1.0 - a),
        }
    }

    /// The area of the covered part of the unit square.
    fn area(self) -> f64 {
        match self {
            Self::Parallelogram => 1.0,
            Self::Triangle => 0.5,
            Self::Ellipse => PI / 4.0,
            Self::Leaf => 2.0 / 3.0,
        }
    }
}

/// A surface, metres, world axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Shape {
    /// `corner + a u + b v` for the `(a, b)` of `outline`; its outside is where `u x v` points.
    Flat { corner: DVec3, u: DVec3, v: DVec3, outline: Outline },
    /// The side of a stump between two points, of the radii at them; it has no caps.
    Stump { from: DVec3, to: DVec3, radii: [f64; 2] },
    /// An ellipsoid along the world axes.
    Ellipsoid { center: DVec3, radii: DVec3 },
}

/// The crossing of a ray with a shape: `a`, `b` are the surface coordinates, both 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Crossing {
    pub(crate) t: f64,
    pub(crate) a: f64,
    pub(crate) b: f64,
}

/// A point of a surface with its outward normal and its tangents by `a` and `b`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spot {
    pub(crate) point: DVec3,
    pub(crate) normal: DVec3,
    pub(crate) along_a: DVec3,
    pub(crate) along_b: DVec3,
}

impl Shape {
    /// The nearest crossing with `low < t < high`; `direction` has length 1.
    pub(super) fn crossing(&self, origin: DVec3, direction: DVec3, low: f64, high: f64) -> Option<Crossing> {
        match *self {
            Self::Flat { corner, u, v, outline } => {
                let p = direction.cross(v);
                let det = u.dot(p);
                if det.abs() < 1e-14 {
                    return None;
                }
                let s = origin - corner;
                let across = s.dot(p);
                // Most rays miss: without a division, and with room for its rounding.
                if across * det < 0.0 || across.abs() > det.abs() * (1.0 + 1e-9) {
                    return None;
                }
                let inverse = 1.0 / det;
                let a = across * inverse;
                if !(0.0..=1.0).contains(&a) {
                    return None;
                }
                let q = s.cross(u);
                let (b, t) = (direction.dot(q) * inverse, v.dot(q) * inverse);
                (t > low && t < high && outline.contains(a, b)).then_some(Crossing { t, a, b })
            }
            Self::Stump { from, to, radii } => {
                let axis = to - from;
                let length = axis.length();
                let w = axis / length;
                let slope = (radii[1] - radii[0]) / length;
                let s = origin - from;
                let (sw, dw) = (s.dot(w), direction.dot(w));
                // Distance from the axis = radii[0] + slope * height, squared on both sides.
                let r = radii[0] + slope * sw;
                let qa = 1.0 - dw * dw * (1.0 + slope * slope);
                let qb = s.dot(direction) - sw * dw - slope * dw * r;
                let qc = s.length_squared() - sw * sw - r * r;
                for t in roots(qa, qb, qc)? {
                    let height = sw + t * dw;
                    if t > low && t < high && (0.0..=length).contains(&height) && r + slope * t * dw >= 0.0 {
                        let (x, y) = around(w);
                        let radial = s + direction * t - w * height;
                        let angle = radial.dot(y).atan2(radial.dot(x));
                        return Some(Crossing { t, a: (angle / TAU).rem_euclid(1.0), b: height / length });
                    }
                }
                None
            }
            Self::Ellipsoid { center, radii } => {
                let (s, d) = ((origin - center) / radii, direction / radii);
                let qc = s.length_squared() - 1.0;
                let t =
                    roots(d.length_squared(), s.dot(d), qc)?.into_iter().find(|t| *t > low && *t < high)?;
                let p = s + d * t;
                let a = (p.y.atan2(p.x) / TAU).rem_euclid(1.0);
                Some(Crossing { t, a, b: (0.5 - 0.5 * p.z).clamp(0.0, 1.0) })
            }
        }
    }

    /// The point at `(a, b)`, or `None` outside the outline.
    pub(super) fn spot(&self, a: f64, b: f64) -> Option<Spot> {
        match self {
            Self::Flat { outline, .. } if !outline.contains(a, b) => None,
            _ => Some(self.spot_anywhere(a, b)),
        }
    }

    /// The point at `(a, b)` without regard to the outline. On ellipsoids `b` is even in height.
    pub(super) fn spot_anywhere(&self, a: f64, b: f64) -> Spot {
        match *self {
            Self::Flat { corner, u, v, .. } => {
                Spot { point: corner + u * a + v * b, normal: u.cross(v).normalize(), along_a: u, along_b: v }
            }
            Self::Stump { from, to, radii } => {
                let axis = to - from;
                let length = axis.length();
                let w = axis / length;
                let (x, y) = around(w);
                let (sin, cos) = (a * TAU).sin_cos();
                let radial = x * cos + y * sin;
                let r = radii[0] + (radii[1] - radii[0]) * b;
                let normal = (radial - w * ((radii[1] - radii[0]) / length)).normalize();
                Spot {
                    point: from + axis * b + radial * r,
                    normal,
                    along_a: (y * cos - x * sin) * (TAU * r),
                    along_b: axis + radial * (radii[1] - radii[0]),
                }
            }
            Self::Ellipsoid { center, radii } => {
                let z = 1.0 - 2.0 * b;
                let r = (1.0 - z * z).max(0.0).sqrt();
                let (sin, cos) = (a * TAU).sin_cos();
                let p = DVec3::new(r * cos, r * sin, z);
                let normal = (p / radii).normalize();
                let along_a = (DVec3::new(-sin, cos, 0.0) * radii * TAU * r.max(0.05)).reject_from(normal);
                let along_b = normal.cross(along_a.normalize()) * (PI * radii.element_sum() / 3.0);
                Spot { point: center + p * radii, normal, along_a, along_b }
            }
        }
    }

    /// The distance of `(a, b)` from the outline's edges, along `a` and along `b`, in their units.
    pub(super) fn room(&self, a: f64, b: f64) -> (f64, f64) {
        let Self::Flat { outline, .. } = self else { return (1.0, 1.0) };
        let beside = |a: f64, b: f64| match outline {
            Outline::Parallelogram => a.min(1.0 - a),
            Outline::Triangle => a.min(1.0 - a - b),
            Outline::Ellipse => (0.25 - (b - 0.5).powi(2)).max(0.0).sqrt() - (a - 0.5).abs(),
            Outline::Leaf => 0.5,
        };
        (beside(a, b), beside(b, a))
    }

    /// Lowest and highest corner of the axis-aligned box around it.
    pub(super) fn bounds(&self) -> (DVec3, DVec3) {
        match *self {
            Self::Flat { corner, u, v, outline } => {
                let (p, q) = (corner + u, corner + v);
                let (low, high) = (corner.min(p).min(q), corner.max(p).max(q));
                if outline == Outline::Triangle {
                    return (low, high);
                }
                (low.min(p + v), high.max(p + v))
            }
            Self::Stump { from, to, radii } => {
                let w = (to - from).normalize();
                let spread = (DVec3::ONE - w * w).max(DVec3::ZERO).map(f64::sqrt);
                let low = (from - spread * radii[0]).min(to - spread * radii[1]);
                (low, (from + spread * radii[0]).max(to + spread * radii[1]))
            }
            Self::Ellipsoid { center, radii } => (center - radii, center + radii),
        }
    }

    /// Surface area, m^2; of an ellipsoid to about 1 %.
    pub(super) fn area(&self) -> f64 {
        match *self {
            Self::Flat { u, v, outline, .. } => u.cross(v).length() * outline.area(),
            Self::Stump { from, to, radii } => {
                let slant = (to - from).length().hypot(radii[1] - radii[0]);
                PI * (radii[0] + radii[1]) * slant
            }
            Self::Ellipsoid { radii, .. } => {
                // Knud Thomsen's approximation.
                let p = 1.6075;
                let [x, y, z] = radii.to_array().map(|r| r.powf(p));
                4.0 * PI * ((x * y + x * z + y * z) / 3.0).powf(1.0 / p)
            }
        }
    }
}

/// The real roots of `qa t^2 + 2 qb t + qc`, the smaller first.
fn roots(qa: f64, qb: f64, qc: f64) -> Option<[f64; 2]> {
    let discriminant = qb * qb - qa * qc;
    if discriminant < 0.0 || qa == 0.0 {
        return None;
    }
    // The larger root in magnitude first: no cancellation.
    let q = -(qb + discriminant.sqrt().copysign(qb));
    let (first, second) = (q / qa, if q == 0.0 { 0.0 } else { qc / q });
    Some(if first < second { [first, second] } else { [second, first] })
}

/// Two unit vectors that make a right-handed frame with the unit vector `w`.
pub(super) fn around(w: DVec3) -> (DVec3, DVec3) {
    let x = if w.z.abs() > 0.9 { DVec3::X.reject_from(w) } else { DVec3::Z.cross(w) }.normalize();
    (x, w.cross(x))
}

#[cfg(test)]
mod tests {
    use super::super::hash::Dice;
    use super::*;

    fn shapes(dice: &mut Dice) -> Vec<Shape> {
        let mut point = || DVec3::new(dice.range(-3.0, 3.0), dice.range(-3.0, 3.0), dice.range(-3.0, 3.0));
        let (corner, u, v, to) = (point(), point(), point(), point());
        let radii = point().abs() + 0.2;
        let mut all: Vec<Shape> =
            [Outline::Parallelogram, Outline::Triangle, Outline::Ellipse, Outline::Leaf]
                .into_iter()
                .map(|outline| Shape::Flat { corner, u, v, outline })
                .collect();
        all.push(Shape::Stump { from: corner, to, radii: [radii.x, radii.y] });
        all.push(Shape::Ellipsoid { center: corner, radii });
        all
    }

    /// From a point just off the surface, back along the normal, the ray meets that point.
    #[test]
    fn rays_meet_the_spots_they_are_aimed_at() {
        let mut dice = Dice::new(3, 0);
        for _ in 0..200 {
            for shape in shapes(&mut dice) {
                let (a, b) = (dice.range(0.01, 0.99), dice.range(0.01, 0.99));
                let Some(spot) = shape.spot(a, b) else { continue };
                let (low, high) = shape.bounds();
                assert!(
                    (spot.point - low).min_element() > -1e-9 && (high - spot.point).min_element() > -1e-9
                );
                let crossing = shape
                    .crossing(spot.point + spot.normal * 0.01, -spot.normal, 0.0, 1.0)
                    .unwrap_or_else(|| panic!("{shape:?} at {a} {b}"));
                assert!((crossing.t - 0.01).abs() < 1e-9, "{shape:?} {crossing:?}");
                assert!(
                    (crossing.a - a).abs() < 1e-6 && (crossing.b - b).abs() < 1e-6,
                    "{shape:?} {crossing:?}"
                );
                assert!(spot.normal.dot(spot.along_a.normalize()).abs() < 1e-9);
                assert!(spot.normal.dot(spot.along_b.normalize()).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn crossings_have_their_closed_forms() {
        let along = |shape: &Shape, y: f64, z: f64| {
            shape.crossing(DVec3::new(-10.0, y, z), DVec3::X, 0.0, f64::INFINITY).map(|c| c.t)
        };
        let wall = |outline| Shape::Flat { corner: DVec3::X, u: DVec3::Y * 4.0, v: DVec3::Z * 2.0, outline };
        assert_eq!(along(&wall(Outline::Parallelogram), 3.9, 1.9), Some(11.0));
        assert_eq!(along(&wall(Outline::Parallelogram), 4.1, 1.0), None);
        assert_eq!(along(&wall(Outline::Triangle), 1.9, 0.9), Some(11.0));
        assert_eq!(along(&wall(Outline::Triangle), 2.1, 1.1), None);
        assert_eq!(along(&wall(Outline::Ellipse), 2.0, 1.99), Some(11.0));
        assert_eq!(along(&wall(Outline::Ellipse), 3.5, 1.8), None);
        assert_eq!(along(&wall(Outline::Leaf), 2.0, 1.99), Some(11.0));
        assert_eq!(along(&wall(Outline::Leaf), 0.1, 1.3), None);
        let close =
            |got: Option<f64>, want: f64| assert!((got.unwrap() - want).abs() < 1e-12, "{got:?} {want}");
        // A cylinder and a cone about the z axis, a stretched ball.
        let stump = |top| Shape::Stump { from: DVec3::ZERO, to: DVec3::Z * 3.0, radii: [1.0, top] };
        close(along(&stump(1.0), 0.6, 1.5), 10.0 - 0.8);
        close(along(&stump(0.0), 0.0, 1.5), 10.0 - 0.5);
        assert_eq!(along(&stump(1.0), 0.0, 3.1), None);
        let ball = Shape::Ellipsoid { center: DVec3::ZERO, radii: DVec3::new(2.0, 1.0, 1.0) };
        close(along(&ball, 0.6, 0.0), 10.0 - 2.0 * 0.8);
        // From within, the far side.
        let inside = ball.crossing(DVec3::ZERO, DVec3::X, 1e-9, f64::INFINITY);
        close(inside.map(|c| c.t), 2.0);
    }

    /// Areas against sums of `|along_a x along_b|` over a grid of 200 x 200 (the ellipsoid's own
    /// tangents are only roughly scaled, so it is held against balls).
    #[test]
    fn areas_are_those_of_the_tangents() {
        let mut dice = Dice::new(4, 0);
        for shape in shapes(&mut dice).into_iter().take(5) {
            let n = 200;
            let mut sum = 0.0;
            for i in 0..n * n {
                let (a, b) =
                    ((f64::from(i % n) + 0.5) / f64::from(n), (f64::from(i / n) + 0.5) / f64::from(n));
                if let Some(spot) = shape.spot(a, b) {
                    sum += spot.along_a.cross(spot.along_b).length() / f64::from(n * n);
                }
            }
            assert!((sum / shape.area() - 1.0).abs() < 0.01, "{shape:?}: {sum} {}", shape.area());
        }
        let ball = Shape::Ellipsoid { center: DVec3::ONE, radii: DVec3::splat(0.5) };
        assert!((ball.area() / PI - 1.0).abs() < 1e-9);
    }
}
