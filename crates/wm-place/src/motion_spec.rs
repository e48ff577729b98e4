//! Cameras and their ways as files and command lines name them.

use crate::view::moves::{self, PathSpec};
use crate::view::path::CameraPath;
use crate::view::spec::{CameraSpec, text_of};
use crate::view::{ViewOptions, choose};
use crate::{CameraMotion, PreparedPlace, Renderer, Result};
use wm_scene::Camera;

/// The way of a camera or of a rig.
#[derive(Clone, Debug, Default)]
pub struct MotionSpec {
    /// The start; `None` for a view that suits the scene.
    pub camera: Option<CameraSpec>,
    /// The path; `None` to stay.
    pub path: Option<PathSpec>,
    /// Length of a dolly, m; `None` for as far as the way is free.
    pub distance: Option<f64>,
    /// Forward speed without a path, m/s.
    pub speed: Option<f64>,
    /// Duration of a path that has none of its own, s.
    pub seconds: f64,
}

impl MotionSpec {
    /// Finds the way in a place. `chosen` is called with the text of a view that was chosen, and
    /// how.
    ///
    /// # Errors
    /// [`crate::Error::View`] if there is no such photo, or the numbers make no path.
    pub fn motion(
        &self,
        renderer: &mut Renderer,
        place: &PreparedPlace,
        options: &ViewOptions,
        chosen: &mut dyn FnMut(String),
    ) -> Result<CameraMotion> {
        let path = match &self.path {
            None => {
                let camera = Box::new(self.start(renderer, place, options, chosen)?);
                return Ok(CameraMotion::Still { camera, speed: self.speed.unwrap_or(0.0) });
            }
            Some(PathSpec::File(file)) => CameraPath::read(file, place.survey(), options)?,
            Some(PathSpec::Capture) => {
                moves::capture(&place.scene().views, place.survey(), options, self.seconds)?
            }
            Some(moving) => {
                let start = self.start(renderer, place, options, chosen)?;
                let units = self.distance.map(|metres| metres / place.survey().metres_per_unit.value);
                let of_start = ViewOptions { size: Some((start.width, start.height)), ..*options };
                let mut search = renderer.view_search(place, of_start);
                match moving {
                    PathSpec::Orbit => moves::orbit(&search, &start, self.seconds)?,
                    _ => moves::dolly(&mut search, &start, units, self.seconds)?,
                }
            }
        };
        let size = options.size.or(path.size()).unwrap_or_else(|| options.size());
        Ok(CameraMotion::Along { path, size })
    }

    /// Finds its beginning.
    ///
    /// # Errors
    /// As [`Self::motion`].
    pub fn start(
        &self,
        renderer: &mut Renderer,
        place: &PreparedPlace,
        options: &ViewOptions,
        chosen: &mut dyn FnMut(String),
    ) -> Result<Camera> {
        if let Some(spec) = &self.camera {
            return Ok(spec.camera(&place.scene().views, place.survey(), options)?);
        }
        let found = choose::choose(&mut renderer.view_search(place, *options))?;
        chosen(format!("{} ({})", text_of(&found.camera, place.survey().origin), found.how));
        Ok(found.camera)
    }
}
