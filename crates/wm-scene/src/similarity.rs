//! Turning, scaling and moving a whole scene.

use crate::{Camera, Scene, Splats, camera::viewmat_of, quat, sh};
use glam::{DMat3, DQuat, DVec3};

/// `p -> scale * rotation * p + translation`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Similarity {
    /// The scale, above 0.
    pub scale: f64,
    /// The rotation.
    pub rotation: DMat3,
    /// The translation after the rotation, scene units.
    pub translation: DVec3,
}

impl Similarity {
    /// The identity.
    pub const IDENTITY: Self = Self { scale: 1.0, rotation: DMat3::IDENTITY, translation: DVec3::ZERO };

    /// The rotation that takes the unit vector `from` to `to` by the shortest way.
    #[must_use]
    pub fn turning(from: DVec3, to: DVec3) -> Self {
        Self { rotation: DMat3::from_quat(DQuat::from_rotation_arc(from, to)), ..Self::IDENTITY }
    }

    /// The transform that applies `other` first, then this one.
    #[must_use]
    pub(crate) fn after(&self, other: &Self) -> Self {
        Self {
            scale: self.scale * other.scale,
            rotation: self.rotation * other.rotation,
            translation: self.point(other.translation),
        }
    }

    /// Transforms a point.
    #[must_use]
    pub fn point(&self, p: DVec3) -> DVec3 {
        self.scale * (self.rotation * p) + self.translation
    }

    /// Transforms a camera: afterwards it sees the transformed scene as it saw the scene before.
    #[must_use]
    pub fn camera(&self, camera: &Camera) -> Camera {
        let rotation = camera.rotation() * self.rotation.transpose();
        let center = self.point(camera.center());
        let viewmat = viewmat_of(rotation, -(rotation * center));
        Camera { viewmat, near: camera.near * self.scale, ..*camera }
    }

    /// Transforms a scene: splats, metadata and views. The translation of one with an origin moves
    /// the origin, which keeps it exact.
    pub fn apply(&self, scene: &mut Scene) {
        match scene.metadata.origin {
            None => self.apply_local(scene),
            Some(origin) => {
                scene.metadata.origin = Some(self.point(origin));
                Self { translation: DVec3::ZERO, ..*self }.apply_local(scene);
            }
        }
    }

    /// Transforms a scene relative to its origin, which stays.
    pub(crate) fn apply_local(&self, scene: &mut Scene) {
        self.apply_to(&mut scene.splats);
        let metadata = &mut scene.metadata;
        metadata.metres_per_unit = metadata.metres_per_unit.map(|metres| metres / self.scale);
        metadata.camera_height = metadata.camera_height.map(|height| height * self.scale);
        metadata.haze_extinction = metadata.haze_extinction.map(|extinction| extinction / self.scale);
        metadata.haze_extinction_error = metadata.haze_extinction_error.map(|error| error / self.scale);
        metadata.haze_shown_extinction = metadata.haze_shown_extinction.map(|shown| shown / self.scale);
        for corner in metadata.water.iter_mut().flatten().flatten() {
            *corner = self.point(DVec3::from_array(*corner)).to_array();
        }
        for lamp in metadata.lamps.iter_mut().flatten() {
            lamp.at = self.point(DVec3::from_array(lamp.at)).to_array();
            lamp.aim = lamp.aim.map(|aim| (self.rotation * DVec3::from_array(aim)).to_array());
        }
        for window in metadata.windows.iter_mut().flatten() {
            window.corner = self.point(DVec3::from_array(window.corner)).to_array();
            for edge in [&mut window.across, &mut window.upwards] {
                *edge = (self.scale * (self.rotation * DVec3::from_array(*edge))).to_array();
            }
        }
        metadata.up = metadata.up.map(|up| (self.rotation * up).normalize());
        metadata.north = metadata.north.map(|north| (self.rotation * north).normalize());
        metadata.sun = metadata.sun.map(|sun| sun.map(|towards| (self.rotation * towards).normalize()));
        // Without up the ground has no meaning.
        metadata.ground =
            metadata.ground.zip(metadata.up).map(|(g, up)| g * self.scale + up.dot(self.translation));
        for view in &mut scene.views {
            view.camera = self.camera(&view.camera);
        }
    }

    /// Transforms splats.
    pub fn apply_to(&self, splats: &mut Splats) {
        if *self == Self::IDENTITY {
            return;
        }
        for mean in &mut splats.means {
            *mean = self.point(DVec3::from_array(mean.map(f64::from))).to_array().map(|v| v as f32);
        }
        let larger = self.scale.ln() as f32;
        splats.log_scales.as_flattened_mut().iter_mut().for_each(|v| *v += larger);
        if self.rotation == DMat3::IDENTITY {
            return;
        }
        let turn = DQuat::from_mat3(&self.rotation);
        for stored in &mut splats.quats {
            let [w, x, y, z] = quat::normalize(stored.map(f64::from));
            let turned = turn * DQuat::from_xyzw(x, y, z, w);
            *stored = [turned.w, turned.x, turned.y, turned.z].map(|v| v as f32);
        }
        let stride = splats.sh_stride();
        if stride > 3 {
            let matrix = sh_rotation(self.rotation);
            for sh in splats.sh.chunks_exact_mut(stride) {
                rotate_sh(&matrix, splats.sh_degree, sh);
            }
        }
    }
}

/// The matrix by which a rotation mixes SH coefficients, `[new][old]`; between degrees it is 0.
///
/// The rotated function is f(R' d), whose coefficients are integrals over the sphere of basis j
/// times the turned basis k: polynomials of degree 6, which [`sh::QUADRATURE`] integrates exactly.
fn sh_rotation(rotation: DMat3) -> [[f64; 16]; 16] {
    let mut matrix = [[0.0; 16]; 16];
    for (z, weight) in sh::QUADRATURE {
        let radius = (1.0 - z * z).sqrt();
        for step in 0..8 {
            let (sin, cos) = (f64::from(step) * std::f64::consts::FRAC_PI_4).sin_cos();
            let direction = DVec3::new(radius * cos, radius * sin, z);
            let new = sh::basis(direction.to_array());
            let old = sh::basis((rotation.transpose() * direction).to_array());
            let area = weight * std::f64::consts::FRAC_PI_4;
            for (row, new) in matrix.iter_mut().zip(new) {
                for (entry, old) in row.iter_mut().zip(old) {
                    *entry += area * new * old;
                }
            }
        }
    }
    matrix
}

fn rotate_sh(matrix: &[[f64; 16]; 16], degree: u8, sh: &mut [f32]) {
    for d in 1..=usize::from(degree) {
        let band = d * d..(d + 1) * (d + 1);
        let mut turned = [[0.0; 3]; 7];
        for (out, new) in turned.iter_mut().zip(band.clone()) {
            for old in band.clone() {
                for (channel, out) in out.iter_mut().enumerate() {
                    *out += matrix[new][old] * f64::from(sh[old * 3 + channel]);
                }
            }
        }
        let slots = sh[band.start * 3..band.end * 3].iter_mut();
        slots.zip(turned.as_flattened()).for_each(|(slot, v)| *slot = *v as f32);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Camera, Metadata, SceneView};
    use proptest::prelude::*;

    fn similarity() -> impl Strategy<Value = Similarity> {
        let numbers = prop::array::uniform4(-1.0..1.0f64);
        (numbers, 0.1..10.0f64, prop::array::uniform3(-5.0..5.0f64)).prop_filter_map(
            "no rotation",
            |(q, scale, t)| {
                let q = DQuat::from_array(q);
                (q.length() > 0.1).then(|| Similarity {
                    scale,
                    rotation: DMat3::from_quat(q.normalize()),
                    translation: DVec3::from_array(t),
                })
            },
        )
    }

    proptest! {
        /// Colours stay where they are seen from the turned direction, to rounding of f32.
        #[test]
        fn colours_turn_with_the_scene(
            similarity in similarity(),
            sh in prop::collection::vec(-1.0..1.0f32, 48),
            direction in prop::array::uniform3(-1.0..1.0f64),
        ) {
            let direction = DVec3::from_array(direction);
            prop_assume!(direction.length() > 0.1);
            let direction = direction.normalize();
            let mut turned = sh.clone();
            rotate_sh(&sh_rotation(similarity.rotation), 3, &mut turned);
            let seen = sh::color(&turned, (similarity.rotation * direction).to_array());
            for (a, b) in sh::color(&sh, direction.to_array()).iter().zip(seen) {
                prop_assert!((a - b).abs() < 1e-5, "{a} {b}");
            }
        }

        #[test]
        fn one_after_another_is_their_product(a in similarity(), b in similarity(), p in prop::array::uniform3(-5.0..5.0f64)) {
            let p = DVec3::from_array(p);
            prop_assert!((a.after(&b).point(p) - a.point(b.point(p))).length() < 1e-9);
        }
    }

    #[test]
    fn the_ground_stays_under_the_splats() {
        let mut splats = Splats::zeroed(1, 0);
        splats.means[0] = [1.0, 2.0, 3.0];
        let metadata = Metadata {
            up: Some(DVec3::NEG_Y),
            north: Some(DVec3::X),
            ground: Some(-2.5),
            metres_per_unit: Some(4.0),
            ..Metadata::default()
        };
        let camera = Camera::looking((4, 3), 60.0, DVec3::ONE, DVec3::ZERO, DVec3::NEG_Y).unwrap();
        let views = vec![SceneView { name: "a".into(), camera: Camera { near: 0.25, ..camera } }];
        let mut scene = Scene { splats, metadata, views, ..Scene::default() };
        let turn = Similarity {
            scale: 2.0,
            translation: DVec3::new(7.0, 8.0, 9.0),
            ..Similarity::turning(DVec3::NEG_Y, DVec3::Z)
        };
        turn.apply(&mut scene);
        let up = scene.metadata.up.unwrap();
        assert!((up - DVec3::Z).length() < 1e-12);
        assert!((scene.metadata.north.unwrap() - turn.rotation * DVec3::X).length() < 1e-12);
        let height =
            up.dot(DVec3::from_array(scene.splats.means[0].map(f64::from))) - scene.metadata.ground.unwrap();
        // Half a unit above the ground before, twice as large now.
        assert!((height - 1.0).abs() < 1e-6, "{height}");
        assert_eq!(scene.metadata.metres_per_unit, Some(2.0));
        assert_eq!(scene.views[0].camera.near, 0.5);
    }
}
