//! Changes of a scene on its way to another format: cropped, turned, scaled, reduced.

use crate::reduce::{ReducedScene, reduce};
use crate::{Error, Progress, Result};
use glam::DVec3;
use wm_render::Differentiable;
use wm_scene::similarity::Similarity;
use wm_scene::survey::{Confidence, Survey, label_sky};
use wm_scene::{Metadata, Scene};

/// A box along the axes, between two corners.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CropBox {
    /// The corner with the least coordinates.
    pub low: DVec3,
    /// The corner with the greatest coordinates.
    pub high: DVec3,
}

impl CropBox {
    /// The box between any two opposite corners.
    #[must_use]
    pub fn between(a: DVec3, b: DVec3) -> Self {
        Self { low: a.min(b), high: a.max(b) }
    }

    /// Returns true if a point is inside.
    #[must_use]
    pub fn holds(&self, point: [f32; 3]) -> bool {
        let point = DVec3::from_array(point.map(f64::from));
        point.cmpge(self.low).all() && point.cmple(self.high).all()
    }
}

/// A change of scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LengthScale {
    /// All lengths become this many times as long.
    Factor(f64),
    /// A unit becomes a metre, by the scale that the scene knows.
    Metres,
}

/// Changes of a scene, applied in the order of the fields.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SceneChange {
    /// Keeps what is in a box, in the axes of the scene as it is, in the world.
    pub crop: Option<CropBox>,
    /// Turns the scene so that its up becomes this direction.
    pub up: Option<DVec3>,
    /// Up in the axes of the scene as it is, for `up`; else from the scene.
    pub up_now: Option<DVec3>,
    /// Changes lengths.
    pub scale: Option<LengthScale>,
    /// Leaves out SH above this degree, 0-3.
    pub sh_degree: Option<u8>,
    /// Reduces to this many splats, 1 or more.
    pub max_splats: Option<u64>,
}

impl SceneChange {
    /// Changes a scene, and returns a line for each thing that its user should know. `renderer` is
    /// asked for only to reduce the scene.
    ///
    /// # Errors
    /// [`Error::Unsupported`] if no splat is in the box, or the scale is not known; an error of
    /// `renderer`.
    pub fn apply<'r>(
        &self,
        scene: &mut Scene,
        renderer: impl FnOnce() -> Result<Box<dyn Differentiable + 'r>>,
        progress: &mut dyn Progress,
    ) -> Result<Vec<String>> {
        let mut notes = Vec::new();
        if let Some(crop) = self.crop {
            let origin = scene.metadata.origin_or_zero();
            let kept = CropBox { low: crop.low - origin, high: crop.high - origin };
            let indices: Vec<usize> =
                (0..scene.splats.len()).filter(|i| kept.holds(scene.splats.means[*i])).collect();
            if indices.is_empty() {
                let (low, high) = (crop.low, crop.high);
                return Err(Error::Unsupported(format!(
                    "--crop: no splat is in the box from {low} to {high}"
                )));
            }
            scene.splats = scene.splats.select(&indices);
        }
        if let Some(up) = self.up {
            let given = Metadata { up: self.up_now, ..Metadata::default() };
            let now = Survey::of(scene, &given).up;
            notes.push(format!("up was {:.3} ({})", now.value, now.source));
            scene.metadata.up = Some(now.value);
            scene.metadata.up_confidence = Some(now.confidence).filter(|known| *known != Confidence::Sure);
            scene.metadata.level_north();
            Similarity::turning(now.value, up).apply(scene);
        }
        match self.scale {
            None => {}
            Some(LengthScale::Factor(scale)) => Similarity { scale, ..Similarity::IDENTITY }.apply(scene),
            Some(LengthScale::Metres) => {
                let Some(scale) = scene.metadata.metres_per_unit else {
                    return Err(Error::Unsupported(
                        "--scale metres: its scale is not known; give a factor, or `inspect --save-metadata` first"
                            .into(),
                    ));
                };
                Similarity { scale, ..Similarity::IDENTITY }.apply(scene);
            }
        }
        if let Some(degree) = self.sh_degree {
            scene.splats.limit_sh(degree);
        }
        if let Some(most) = self.max_splats.filter(|most| *most < scene.splats.len() as u64) {
            label_sky(&mut scene.splats);
            let ReducedScene { splats, note } = reduce(scene, most as usize, renderer()?.as_mut(), progress)?;
            scene.splats = splats;
            notes.push(note);
        }
        Ok(notes)
    }
}
