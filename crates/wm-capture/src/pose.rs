//! Rigid poses.

use glam::{DMat3, DMat4, DQuat, DVec3};

/// A rotation and a translation, m: `a_from_b` takes points of frame b to frame a.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigidPose {
    /// The rotation, of length 1.
    pub rotation: DQuat,
    /// The origin of b in a, m.
    pub translation: DVec3,
}

impl RigidPose {
    /// The pose that changes nothing.
    pub const IDENTITY: Self = Self { rotation: DQuat::IDENTITY, translation: DVec3::ZERO };

    /// A pose from the axes of b in a (columns) and its origin.
    #[must_use]
    pub fn new(axes: DMat3, translation: DVec3) -> Self {
        Self { rotation: DQuat::from_mat3(&axes).normalize(), translation }
    }

    /// Returns the motion as a 4x4 matrix.
    #[must_use]
    pub fn matrix(&self) -> DMat4 {
        DMat4::from_rotation_translation(self.rotation, self.translation)
    }

    /// `b_from_a`.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.conjugate();
        Self { rotation, translation: -(rotation * self.translation) }
    }

    /// `a_from_c`, of `self` as `a_from_b` and `b_from_c`.
    #[must_use]
    pub fn then(&self, b_from_c: &Self) -> Self {
        Self {
            rotation: (self.rotation * b_from_c.rotation).normalize(),
            translation: self.point(b_from_c.translation),
        }
    }

    /// A point of b in a.
    #[must_use]
    pub fn point(&self, point: DVec3) -> DVec3 {
        self.rotation * point + self.translation
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poses_compose_and_invert() {
        let a = RigidPose { rotation: DQuat::from_rotation_z(0.4), translation: DVec3::new(1.0, 2.0, 3.0) };
        let b = RigidPose { rotation: DQuat::from_rotation_x(-1.1), translation: DVec3::new(-4.0, 0.5, 9.0) };
        let p = DVec3::new(0.3, -7.0, 2.0);
        assert!(a.then(&b).point(p).distance(a.point(b.point(p))) < 1e-12);
        assert!(a.inverse().point(a.point(p)).distance(p) < 1e-12);
        assert!(a.matrix().transform_point3(p).distance(a.point(p)) < 1e-12);
        assert!(
            RigidPose::new(DMat3::from_quat(a.rotation), a.translation).point(p).distance(a.point(p)) < 1e-12
        );
    }
}
