//! The running video: a frame at a time, between other tasks.

use crate::viewer::videos::{VideoWriter, ViewerVideo};
use anyhow::Result;
use std::sync::Arc;
use std::time::Instant;
use weather_magician::{Camera, CameraMotion, FrameRequest, PictureSize, PreparedPlace, Renderer, video};
use wm_viewer::View;

/// A video that is being rendered.
pub(super) struct ActiveVideo {
    pub(super) view: Arc<View>,
    motion: CameraMotion,
    pub(super) video: Arc<ViewerVideo>,
    writer: VideoWriter,
    next: u32,
    pub(super) last: Instant,
}

impl ActiveVideo {
    /// Begins a video of a view along its motion, with `tags` in its file.
    pub(super) fn begin(
        view: &Arc<View>,
        motion: CameraMotion,
        video: &Arc<ViewerVideo>,
        place: &mut PreparedPlace,
        tags: Vec<(String, String)>,
    ) -> Result<Self> {
        let (width, height) = view.size();
        let mut settings = video::VideoSettings::new(PictureSize::new(width, height), video.rate);
        settings.tags = tags;
        let writer = VideoWriter::new(video::create_video(&video.path(), settings)?, video);
        let mut view = (**view).clone();
        view.weather = Arc::new(place.weather_of_shot(&view.weather, &motion.camera(0.0)));
        let (view, video) = (Arc::new(view), Arc::clone(video));
        Ok(Self { view, motion, video, writer, next: 0, last: Instant::now() })
    }

    /// Returns true if a frame is left to render, and nobody has stopped the video.
    pub(super) fn has_next(&self) -> bool {
        !self.video.is_stopped() && self.next < self.video.frames
    }

    /// Returns the time of the next frame, seconds.
    pub(super) fn time(&self) -> f64 {
        self.video.rate.seconds(u64::from(self.next))
    }

    /// Returns the camera of the next frame.
    pub(super) fn camera(&self) -> Camera {
        self.motion.camera(self.time())
    }

    /// Renders the next frame; returns false if the writer has stopped.
    pub(super) fn render_next(&mut self, renderer: &mut Renderer, place: &mut PreparedPlace) -> Result<bool> {
        let time = self.time();
        let mut picture = self.writer.blank_picture();
        let camera = self.motion.at(time, place.site().metres_per_unit);
        let request = FrameRequest::new(&self.view.weather, camera, time);
        renderer.render_into(place, &request, &mut picture, &mut ())?;
        self.next += 1;
        Ok(self.writer.push_frame(picture))
    }

    /// Ends the video after its last frame.
    pub(super) fn finish(self) {
        self.video.end(self.writer.finish());
    }
}
