//! A picture with the parts that it is made of, as far as they are asked for.

use crate::studio::{Moving, Studio};
use anyhow::Result;
use wm_render::parts::{PicturePart, PictureParts, render_with_parts};
use wm_render::{Frame, Stats};
use wm_weather::Weather;

/// A frame and its parts.
#[derive(Clone, Debug, Default)]
pub struct Picture {
    /// Colour, geometry and what falls.
    pub frame: Frame,
    /// What takes renders of its own.
    pub parts: PictureParts,
}

impl Studio {
    /// Renders the instant `time` of a weather with the parts that are `wanted`.
    pub fn render_parts(
        &mut self,
        weather: &Weather,
        time: f64,
        moving: Moving,
        wanted: &[PicturePart],
        picture: &mut Picture,
    ) -> Result<Stats> {
        if wanted.is_empty() {
            return self.render(weather, time, moving, &mut picture.frame);
        }
        self.with_job(weather, time, moving, |renderer, job| {
            let (stats, parts) = render_with_parts(renderer, job, wanted, &mut picture.frame)?;
            picture.parts = parts;
            Ok(stats)
        })
    }
}
