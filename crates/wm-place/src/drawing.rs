//! The pictures of one frame.

use crate::place::PreparedPlace;
use crate::shot::PinholeShot;
use crate::{Picture, Progress, Renderer, Result};
use wm_render::Stats;

/// A frame of a place that is being drawn: of one picture or of several.
pub(crate) struct Drawing<'a> {
    pub renderer: &'a mut Renderer,
    pub place: &'a mut PreparedPlace,
    pub progress: &'a mut dyn Progress,
}

impl Drawing<'_> {
    /// Draws a pinhole picture.
    pub async fn pinhole(&mut self, shot: &PinholeShot<'_>, picture: &mut Picture) -> Result<Stats> {
        let (backend, memory) = self.renderer.drawing();
        self.place.draw(backend, memory, shot, picture, self.progress).await
    }
}
