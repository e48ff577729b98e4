//! A scene: splats, metadata, and the views that came with it.

use crate::health::{NonFiniteSplats, Repairs};
use crate::{Camera, Metadata, Remark, Splats};
use glam::DVec3;

/// The content of a scene file or folder.
///
/// ```
/// use wm_scene::Scene;
/// # use wm_scene::{Group, splats::Splat};
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("garden.ply");
/// # let mut scene = Scene::default();
/// # scene.splats.push(&Splat {
/// #     mean: [0.0; 3], quat: [1.0, 0.0, 0.0, 0.0], log_scale: [-3.0; 3], logit_opacity: 2.0,
/// #     rgb: [0.5; 3], group: Group::Scene,
/// # });
/// # scene.save(&path)?;
/// let scene = Scene::open(&path)?.metres_per_unit(0.4).up([0.0, 0.0, 1.0]).ground(-0.2);
/// scene.save(path.with_extension("spz"))?;
/// assert_eq!(Scene::open(path.with_extension("spz"))?.metadata.metres_per_unit, Some(0.4));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// The Gaussians.
    pub splats: Splats,
    /// Facts about the place: scale, up, ground, sky.
    pub metadata: Metadata,
    /// The photographed views, if the file or folder has them, in their order.
    pub views: Vec<SceneView>,
    /// The origin that the reader chose, beside that which the file states, scene units; zero if it
    /// chose none. Never written.
    pub moved_by: DVec3,
    /// Lines on what the reader guessed, ignored or passed over; empty for a scene that was made in
    /// memory. Never written.
    pub remarks: Vec<Remark>,
}

/// A named camera, such as that of a photo.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneView {
    /// The photo's file name.
    pub name: String,
    /// The camera.
    pub camera: Camera,
}

impl Scene {
    /// The scene without the splats that cannot be drawn, and a count of what was removed; see
    /// [`Splats::repaired`].
    #[must_use]
    pub fn repaired(self) -> (Self, Repairs) {
        let (splats, repairs) = self.splats.repaired();
        (Self { splats, ..self }, repairs)
    }

    /// Checks that every splat can be drawn; see [`Splats::check_finite`].
    ///
    /// # Errors
    /// [`NonFiniteSplats`] counts the splats that cannot.
    pub fn check_finite(&self) -> Result<(), NonFiniteSplats> {
        self.splats.check_finite()
    }

    /// Sets the scale, metres per scene unit, finite and above 0 ([`Metadata::fault`] says if it is
    /// not).
    #[must_use]
    pub fn metres_per_unit(mut self, metres: f64) -> Self {
        self.metadata.metres_per_unit = Some(metres);
        self.metadata.scale_source = None;
        self.metadata.scale_confidence = None;
        self
    }

    /// Sets the direction against gravity, world axes, of any length but 0;
    /// [`Metadata::level_north`] follows it.
    #[must_use]
    pub fn up(mut self, up: impl Into<DVec3>) -> Self {
        self.metadata.up = Some(up.into().normalize_or_zero());
        self.metadata.up_source = None;
        self.metadata.up_confidence = None;
        self.metadata.level_north();
        self
    }

    /// Sets the height of the ground along up, scene units: points `p` with `up . p = height` are
    /// on it.
    #[must_use]
    pub fn ground(mut self, height: f64) -> Self {
        self.metadata.ground = Some(height);
        self.metadata.ground_confidence = None;
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::{ReadOptions, read_scene};
    use crate::synthetic::rippled;
    use tempfile::tempdir;
    use wm_base::Problem;

    #[test]
    fn broken_splats_are_refused_by_name_and_can_be_repaired() {
        let folder = tempdir().unwrap();
        let path = folder.path().join("a.ply");
        let mut scene = Scene { splats: rippled(10, 0), ..Scene::default() };
        scene.splats.means[3][1] = f32::NAN;
        scene.splats.quats[5] = [0.0; 4];
        scene.save(&path).unwrap();
        let error = Scene::open(&path).unwrap_err();
        assert_eq!(error.path, path);
        assert!(matches!(error.problem, Problem::NonFinite(_)), "{error}");
        assert!(
            error
                .to_string()
                .contains("1 of 10 splats hold NaN, infinite or absurd numbers (1 in positions)")
        );
        let (repaired, repairs) = read_scene(&path, &ReadOptions::default()).unwrap().repaired();
        assert_eq!((repaired.splats.len(), repairs.dropped, repairs.turned), (9, 1, 1));
        assert_eq!(repaired.check_finite(), Ok(()));
    }

    #[test]
    fn facts_are_set_and_written() {
        let folder = tempdir().unwrap();
        let path = folder.path().join("a.ply");
        let scene = Scene { splats: rippled(4, 0), ..Scene::default() };
        let scene = scene.metres_per_unit(0.4).up([0.0, 0.0, 2.0]).ground(-1.5);
        assert_eq!(scene.metadata.up, Some(DVec3::Z));
        scene.save(&path).unwrap();
        assert_eq!(Scene::open(&path).unwrap().metadata, scene.metadata);
        assert!(scene.clone().up([0.0; 3]).save(&path).is_err());
        assert!(scene.metres_per_unit(-1.0).save(&path).is_err());
    }
}
