//! Axes of formats: the one place where they are turned.
//!
//! A [`Scene`] has the axes of a 3DGS PLY: those of the COLMAP model that it was trained on, mostly
//! x right, y down, z forward; which way is up is in its metadata or found. Formats that prescribe
//! y up are half a turn away from that, so that signs change and nothing else: what others'
//! converters do too, which is why files fit each other.
//!
//! Half a turn D about an axis takes a splat's covariance R S S' R' to (D R D) S S' (D R D)', since
//! D commutes with the diagonal S: its quaternion changes signs as its mean does. Every basis
//! function of [`crate::sh`] is even or odd in each of x, y and z, so its coefficient keeps or
//! changes its sign.

use crate::{Metadata, Scene, Splats, camera::viewmat_of, sh};
use glam::{DMat3, DVec3};

/// The axes that a format's files have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axes {
    /// The axes of a 3DGS PLY.
    Ply,
    /// y up, z back: half a turn about x from the PLY (SPZ calls it RUB).
    YUpZBack,
    /// y up, z forward: half a turn about z from the PLY (SPZ calls it LUF; glTF).
    YUpZForward,
}

impl Axes {
    /// Signs of x, y, z against those of a PLY.
    fn signs(self) -> [f32; 3] {
        match self {
            Self::Ply => [1.0, 1.0, 1.0],
            Self::YUpZBack => [1.0, -1.0, -1.0],
            Self::YUpZForward => [-1.0, -1.0, 1.0],
        }
    }

    /// A mean or any other vector, from or to a PLY: half a turn is its own inverse.
    #[must_use]
    pub(crate) fn vector(self, v: [f32; 3]) -> [f32; 3] {
        let s = self.signs();
        [v[0] * s[0], v[1] * s[1], v[2] * s[2]]
    }

    /// A mean or any other vector, from or to a PLY, in double precision.
    #[must_use]
    pub fn direction(self, v: DVec3) -> DVec3 {
        v * DVec3::from_array(self.signs().map(f64::from))
    }

    /// A quaternion (wxyz), from or to a PLY.
    #[must_use]
    pub(crate) fn quat(self, q: [f32; 4]) -> [f32; 4] {
        let [x, y, z] = self.vector([q[1], q[2], q[3]]);
        [q[0], x, y, z]
    }

    /// Signs of the 16 SH coefficients, from or to a PLY.
    #[must_use]
    pub(crate) fn sh_signs(self) -> [f32; 16] {
        // Evaluated where no basis function is 0.
        let direction = [0.3, 0.5, 0.7];
        let turned = self.vector(direction.map(|v| v as f32)).map(f64::from);
        let (here, there) = (sh::basis(direction), sh::basis(turned));
        std::array::from_fn(|k| if (here[k] > 0.0) == (there[k] > 0.0) { 1.0 } else { -1.0 })
    }

    /// Turns a scene that was just read to the axes of a PLY: splats, metadata and views.
    pub(crate) fn turn(self, scene: &mut Scene) {
        if self == Self::Ply {
            return;
        }
        self.turn_splats(&mut scene.splats);
        let signs = DVec3::from_array(self.signs().map(f64::from));
        scene.moved_by = self.direction(scene.moved_by);
        self.turn_facts(&mut scene.metadata);
        for view in &mut scene.views {
            let (rotation, center) = (view.camera.rotation(), view.camera.center() * signs);
            let rotation = rotation * DMat3::from_diagonal(signs);
            view.camera.viewmat = viewmat_of(rotation, -(rotation * center));
        }
    }

    /// Turns the directions and the origin in metadata, from or to a PLY.
    pub(super) fn turn_facts(self, metadata: &mut Metadata) {
        for vector in [&mut metadata.origin, &mut metadata.up, &mut metadata.north].into_iter().flatten() {
            *vector = self.direction(*vector);
        }
        metadata.sun = metadata.sun.map(|sun| sun.map(|towards| self.direction(towards)));
    }

    fn turn_splats(self, splats: &mut Splats) {
        for mean in &mut splats.means {
            *mean = self.vector(*mean);
        }
        for quat in &mut splats.quats {
            *quat = self.quat(*quat);
        }
        let signs = self.sh_signs();
        let stride = splats.sh_stride();
        if stride > 3 {
            for splat in splats.sh.chunks_exact_mut(stride) {
                for (coefficient, sign) in splat.chunks_exact_mut(3).zip(signs) {
                    coefficient.iter_mut().for_each(|v| *v *= sign);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Camera, SceneView, testing::any_scene};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn turning_twice_changes_nothing(scene in any_scene(5)) {
            for axes in [Axes::YUpZBack, Axes::YUpZForward] {
                let mut turned = scene.clone();
                axes.turn(&mut turned);
                axes.turn(&mut turned);
                prop_assert_eq!(crate::testing::bits(&turned.splats), crate::testing::bits(&scene.splats));
                prop_assert_eq!(&turned.metadata, &scene.metadata);
            }
        }

        /// Colour, covariance and picture of a splat go with the axes.
        #[test]
        fn what_is_seen_stays(
            q in prop::array::uniform4(-1.0..1.0f32),
            direction in prop::array::uniform3(-1.0..1.0f64),
            sh in prop::collection::vec(-1.0..1.0f32, 48),
        ) {
            prop_assume!(q.iter().map(|v| v * v).sum::<f32>() > 0.1);
            for axes in [Axes::YUpZBack, Axes::YUpZForward] {
                let signs = axes.sh_signs();
                let turned: Vec<f32> =
                    sh.chunks_exact(3).zip(signs).flat_map(|(c, s)| [c[0] * s, c[1] * s, c[2] * s]).collect();
                let there = axes.vector(direction.map(|v| v as f32)).map(f64::from);
                let here = direction.map(|v| f64::from(v as f32));
                for (a, b) in sh::color(&sh, here).iter().zip(sh::color(&turned, there)) {
                    prop_assert!((a - b).abs() < 1e-9);
                }
                let (m, t) = (crate::quat::to_matrix(q.map(f64::from)), crate::quat::to_matrix(axes.quat(q).map(f64::from)));
                let s = axes.signs().map(f64::from);
                for i in 0..3 {
                    for j in 0..3 {
                        prop_assert!((t[i][j] - s[i] * m[i][j] * s[j]).abs() < 1e-12);
                    }
                }
            }
        }
    }

    #[test]
    fn views_turn_with_the_splats() {
        let eye = DVec3::new(1.0, 2.0, 3.0);
        let camera = Camera::looking((40, 30), 1.0, eye, DVec3::new(4.0, 0.0, 1.0), DVec3::NEG_Y).unwrap();
        let point = DVec3::new(3.0, 0.5, 1.5);
        let before = camera.viewmat.transform_point3(point);
        let mut scene = Scene { views: vec![SceneView { name: "a".into(), camera }], ..Scene::default() };
        Axes::YUpZBack.turn(&mut scene);
        let after = scene.views[0].camera.viewmat.transform_point3(point * DVec3::new(1.0, -1.0, -1.0));
        assert!((before - after).length() < 1e-12);
    }
}
