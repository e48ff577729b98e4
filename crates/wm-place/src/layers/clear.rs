//! The view without any weather.

use super::row::{LaterFrame, LayerForm, LayerSpan, RGB, Row, Source};
use crate::drawing::Drawing;
use crate::shot::PinholeShot;
use crate::{Picture, Result};
use wm_render::{Outputs, Stats};
use wm_weather::Weather;

pub(super) const ROW: Row = Row {
    note: "the view without any weather: one more",
    channels: RGB,
    source: Source::Later(|drawing, frame, picture| Box::pin(drawing.clear(frame, picture))),
    span: LayerSpan::Exposure,
    form: LayerForm::Color,
    values: |picture| (&picture.clear).into(),
};

impl Drawing<'_> {
    /// Draws the frame without weather.
    async fn clear(&mut self, frame: &LaterFrame<'_>, picture: &mut Picture) -> Result<Stats> {
        let weather = &Weather::clear();
        let outputs = Outputs::default();
        let shot = PinholeShot { weather, outputs, parts: &[], stages: false, ..frame.shot };
        let mut clear = std::mem::take(&mut self.renderer.clear);
        let stats = self.of_camera(frame.camera, frame.index, &shot, &mut clear).await?;
        std::mem::swap(&mut picture.clear, &mut clear.frame.rgb);
        self.renderer.clear = clear;
        Ok(stats)
    }
}
