//! Camera paths: a camera as a pure function of time, so that any frame renders alone.
//!
//! A path is a row of keyframes. Between them the eye runs along a cubic Hermite spline whose
//! velocity at a key is that of the parabola through the key and its neighbours (Catmull-Rom for
//! uneven times): position and velocity are continuous. The velocity at a key is cut to three times
//! the slower of the two mean speeds beside it, so that a path that stops does not swing past its
//! stop. A path that ends where it began is a loop and runs smoothly through that point too.
//! Rotations are interpolated by slerp, the short way round; the field of view linearly.
//!
//! The file format is JSON, described in docs/guide/camera-paths.md:
//!
//! ```json
//! {
//!   "up": [0, 0, 1], "fov": 50, "near": 0.2,
//!   "keyframes": [
//!     {"time": 0, "eye": [4, -60, 3], "target": [4, -31, 2.5]},
//!     {"time": 5, "eye": [4, -40, 3], "rotation": [0.7071, -0.7071, 0, 0], "fov": 40}
//!   ]
//! }
//! ```

use super::ViewError;
use glam::{DMat3, DQuat, DVec3};
use wm_scene::{Camera, camera::FOV_RANGE_DEG, values::MAX_SCENE_COORDINATE};

/// A camera at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathKey {
    /// Seconds.
    pub time: f64,
    /// The camera centre, world axes, scene units.
    pub eye: DVec3,
    /// `camera_from_world`, length 1, OpenCV axes.
    pub rotation: DQuat,
    /// Vertical field of view, degrees.
    pub fov: f64,
}

impl PathKey {
    /// The place of a camera at a time. Its principal point is taken as the picture's middle.
    #[must_use]
    pub fn of(camera: &Camera, time: f64) -> Self {
        let rotation = DQuat::from_mat3(&camera.rotation()).normalize();
        Self { time, eye: camera.center(), rotation, fov: camera.fov_y() }
    }
}

/// A camera as a function of time.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraPath {
    keys: Vec<PathKey>,
    /// Velocity of the eye at each key, units/s.
    velocities: Vec<DVec3>,
    near: f64,
    /// The size of pictures that its file states, px.
    size: Option<(u32, u32)>,
}

impl CameraPath {
    /// A path through keyframes in the order of their times.
    ///
    /// # Errors
    /// [`ViewError::Path`] if there are none, a time is not after the one before, or a number
    /// cannot be used.
    pub fn new(keys: Vec<PathKey>, near: f64) -> Result<Self, ViewError> {
        let fault = |message: String| Err(ViewError::Path(message));
        if keys.is_empty() {
            return fault("there are no keyframes".into());
        }
        if !(near.is_finite() && near > 0.0) {
            return fault(format!("near is {near}: it must be finite and above 0"));
        }
        for (index, key) in keys.iter().enumerate() {
            let number = index + 1;
            let PathKey { time, eye, rotation, fov } = *key;
            if !(time.is_finite() && eye.is_finite() && rotation.is_finite() && rotation.is_normalized()) {
                return fault(format!("keyframe {number} has a number that is not finite"));
            }
            if eye.abs().max_element() > MAX_SCENE_COORDINATE.into() {
                return fault(format!("keyframe {number}: coordinates must be within 10^10 of zero"));
            }
            if !FOV_RANGE_DEG.contains(&fov) {
                return fault(format!("keyframe {number}: fov is {fov}: it must be 0.1 to 170 degrees"));
            }
            if let Some(before) = index.checked_sub(1).map(|before| keys[before].time)
                && time <= before
            {
                return fault(format!(
                    "keyframe {number}: its time, {time}, is not after that of the one before, {before}"
                ));
            }
        }
        let path = Self { velocities: velocities(&keys), keys, near, size: None };
        // Finite keys may still be too far apart, in distance or too near in time.
        if path.velocities.iter().all(|v| v.is_finite()) { Ok(path) } else { fault("it is too fast".into()) }
    }

    /// The path for pictures of a size, px.
    pub(super) fn with_size(self, size: Option<(u32, u32)>) -> Self {
        Self { size, ..self }
    }

    /// Returns the size of pictures that the file of the path states, px.
    #[must_use]
    pub fn size(&self) -> Option<(u32, u32)> {
        self.size
    }

    /// The path with every eye moved.
    #[must_use]
    pub fn moved(&self, by: DVec3) -> Self {
        let keys = self.keys.iter().map(|key| PathKey { eye: key.eye + by, ..*key }).collect();
        Self { keys, velocities: self.velocities.clone(), ..*self }
    }

    /// The keyframes, in the order of their times; at least one.
    #[must_use]
    pub fn keys(&self) -> &[PathKey] {
        &self.keys
    }

    /// Near plane, scene units.
    #[must_use]
    pub fn near(&self) -> f64 {
        self.near
    }

    /// Time of the first key, seconds.
    #[must_use]
    pub fn start(&self) -> f64 {
        self.keys[0].time
    }

    /// Time from the first key to the last, seconds; 0 if there is one.
    #[must_use]
    pub fn duration(&self) -> f64 {
        self.keys[self.keys.len() - 1].time - self.start()
    }

    /// The camera at `time` (seconds) for a picture of `size` (px); before the first key and after
    /// the last it stands still.
    #[must_use]
    pub fn at(&self, time: f64, size: (u32, u32)) -> Camera {
        let PathKey { eye, rotation, fov, .. } = self.key_at(time);
        Camera { near: self.near, ..Camera::posed(size, fov, eye, DMat3::from_quat(rotation)) }
    }

    /// The interpolated key at `time`, seconds.
    pub(crate) fn key_at(&self, time: f64) -> PathKey {
        let next = self.keys.partition_point(|key| key.time <= time);
        if next == 0 {
            return self.keys[0];
        }
        let (a, va) = (self.keys[next - 1], self.velocities[next - 1]);
        let Some((b, vb)) = self.keys.get(next).zip(self.velocities.get(next)) else { return a };
        let span = b.time - a.time;
        let t = (time - a.time) / span;
        let (tt, ttt) = (t * t, t * t * t);
        let step = 3.0 * tt - 2.0 * ttt;
        let eye = a.eye + (b.eye - a.eye) * step + (va * (t - 2.0 * tt + ttt) + *vb * (ttt - tt)) * span;
        let rotation = a.rotation.slerp(b.rotation, t).normalize();
        PathKey { time, eye, rotation, fov: a.fov + (b.fov - a.fov) * t }
    }
}

/// Velocity of the eye at each key, units/s.
fn velocities(keys: &[PathKey]) -> Vec<DVec3> {
    let spans: Vec<Span> = keys
        .windows(2)
        .map(|pair| (pair[1].time - pair[0].time, pair[1].eye - pair[0].eye))
        .map(|(time, way)| Span { time, velocity: way / time })
        .collect();
    let (Some(first), Some(last)) = (spans.first(), spans.last()) else { return vec![DVec3::ZERO] };
    let mut inner: Vec<DVec3> = spans.windows(2).map(|pair| between(&pair[0], &pair[1])).collect();
    let is_loop = keys.len() > 3 && keys[0].eye == keys[keys.len() - 1].eye;
    let ends = if is_loop {
        [between(last, first); 2]
    } else {
        // No force at the ends: the second derivative is 0 there.
        let end = |span: &Span, inner: Option<&DVec3>| {
            cut(1.5 * span.velocity - 0.5 * *inner.unwrap_or(&span.velocity), span.velocity.length())
        };
        [end(first, inner.first()), end(last, inner.last())]
    };
    inner.insert(0, ends[0]);
    inner.push(ends[1]);
    inner
}

/// The time between two keys, seconds, and the mean velocity, units/s.
struct Span {
    time: f64,
    velocity: DVec3,
}

/// Velocity at a key between two spans: that of the parabola through the three keys.
fn between(before: &Span, after: &Span) -> DVec3 {
    let velocity = (before.velocity * after.time + after.velocity * before.time) / (before.time + after.time);
    cut(velocity, before.velocity.length().min(after.velocity.length()))
}

/// At most three times the mean speed beside it: the limit at which a cubic does not overshoot.
fn cut(velocity: DVec3, speed: f64) -> DVec3 {
    // clamp_length_max needs a limit above 0.
    if speed > 0.0 { velocity.clamp_length_max(3.0 * speed) } else { DVec3::ZERO }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn keys(values: &[[f64; 8]]) -> Vec<PathKey> {
        let mut time = 0.0;
        let key = |v: &[f64; 8]| {
            time += 0.5 + v[0].abs();
            let rotation = DQuat::from_xyzw(v[4], v[5], v[6], 0.3 + v[7].abs()).normalize();
            PathKey { time, eye: DVec3::new(v[1], v[2], v[3]), rotation, fov: 50.0 + v[4] }
        };
        values.iter().map(key).collect()
    }

    fn walk(eyes: &[(f64, f64)]) -> CameraPath {
        let key = |(time, x): &(f64, f64)| PathKey {
            time: *time,
            eye: DVec3::X * *x,
            rotation: DQuat::IDENTITY,
            fov: 50.0,
        };
        CameraPath::new(eyes.iter().map(key).collect(), 0.2).unwrap()
    }

    proptest! {
        #[test]
        fn it_passes_through_its_keys_smoothly(
            values in prop::collection::vec(prop::array::uniform8(-3.0..3.0f64), 1..7),
        ) {
            let keys = keys(&values);
            let path = CameraPath::new(keys.clone(), 0.1).unwrap();
            for (index, key) in keys.iter().enumerate() {
                let at = path.key_at(key.time);
                prop_assert!((at.eye - key.eye).length() < 1e-9);
                prop_assert!(at.rotation.angle_between(key.rotation) < 1e-6);
                prop_assert!((at.fov - key.fov).abs() < 1e-9);
                // Equal velocities from both sides, by differences; accelerations are below 500.
                let h = 1e-6;
                let eye = |t: f64| path.key_at(t).eye;
                if index > 0 && index + 1 < keys.len() {
                    let before = (eye(key.time) - eye(key.time - h)) / h;
                    let after = (eye(key.time + h) - eye(key.time)) / h;
                    prop_assert!((before - after).length() < 5e-3, "{before} {after}");
                }
            }
            for i in 0..=50 {
                let time = path.start() - 0.5 + (path.duration() + 1.0) * f64::from(i) / 50.0;
                let camera = path.at(time, (64, 48));
                prop_assert!(camera.check().is_ok());
                prop_assert!((camera.center() - path.key_at(time).eye).length() < 1e-9);
            }
        }
    }

    #[test]
    fn even_keys_on_a_line_are_an_even_walk() {
        let path = walk(&[(0.0, 0.0), (1.0, 2.0), (3.0, 6.0), (3.5, 7.0)]);
        for i in 0..=70 {
            let time = 0.05 * f64::from(i);
            assert!((path.key_at(time).eye.x - 2.0 * time).abs() < 1e-9);
        }
    }

    #[test]
    fn a_stop_is_a_stop() {
        let path = walk(&[(0.0, 0.0), (1.0, 5.0), (4.0, 5.0), (5.0, 9.0)]);
        for i in 0..=50 {
            let x = path.key_at(0.1 * f64::from(i)).eye.x;
            assert!((-1e-9..=9.0 + 1e-9).contains(&x));
            if (10..=40).contains(&i) {
                assert!((x - 5.0).abs() < 1e-9, "{i} {x}");
            }
        }
        // Slow beside fast does not swing back either.
        let path = walk(&[(0.0, 0.0), (1.0, 0.01), (2.0, 10.0), (3.0, 10.01)]);
        let xs: Vec<f64> = (0..=300).map(|i| path.key_at(0.01 * f64::from(i)).eye.x).collect();
        assert!(xs.windows(2).all(|pair| pair[1] >= pair[0] - 1e-9));
    }

    #[test]
    fn turns_go_the_short_way() {
        let key = |time, angle: f64| PathKey {
            time,
            eye: DVec3::ZERO,
            rotation: DQuat::from_rotation_y(angle.to_radians()),
            fov: 50.0,
        };
        let path = CameraPath::new(vec![key(0.0, 170.0), key(1.0, -170.0)], 0.2).unwrap();
        let middle = path.key_at(0.5).rotation;
        assert!(middle.angle_between(DQuat::from_rotation_y(std::f64::consts::PI)) < 1e-6);
    }

    #[test]
    fn what_makes_no_path_is_told() {
        let key = |time| PathKey { time, eye: DVec3::ZERO, rotation: DQuat::IDENTITY, fov: 50.0 };
        let say = |keys: Vec<PathKey>| CameraPath::new(keys, 0.2).unwrap_err().to_string();
        assert_eq!(say(vec![]), "camera path: there are no keyframes");
        assert_eq!(
            say(vec![key(0.0), key(2.0), key(2.0)]),
            "camera path: keyframe 3: its time, 2, is not after that of the one before, 2"
        );
        assert_eq!(say(vec![key(f64::NAN)]), "camera path: keyframe 1 has a number that is not finite");
        assert_eq!(
            say(vec![PathKey { fov: 180.0, ..key(0.0) }]),
            "camera path: keyframe 1: fov is 180: it must be 0.1 to 170 degrees"
        );
        let far = PathKey { eye: DVec3::X * 1e300, ..key(1.0) };
        assert_eq!(
            say(vec![key(0.0), far]),
            "camera path: keyframe 2: coordinates must be within 10^10 of zero"
        );
        let fast = PathKey { eye: DVec3::X * 1e9, ..key(1e-301) };
        assert_eq!(say(vec![key(0.0), fast]), "camera path: it is too fast");
        assert!(CameraPath::new(vec![key(0.0)], 0.0).is_err());
    }
}
