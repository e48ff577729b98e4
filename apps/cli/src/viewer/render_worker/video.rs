//! The running video: a frame at a time, between other tasks.

use super::RenderWorker;
use super::assets::AssetOwner;
use crate::viewer::videos::{VideoWriter, ViewerVideo};
use anyhow::Result;
use std::sync::Arc;
use std::time::Instant;
use weather_magician::{CameraMotion, FrameRequest, PictureSize, video};
use wm_viewer::View;

/// A video that is being rendered.
pub(super) struct ActiveVideo {
    view: Arc<View>,
    motion: CameraMotion,
    pub(super) video: Arc<ViewerVideo>,
    writer: VideoWriter,
    next: u32,
    pub(super) last: Instant,
}

impl RenderWorker {
    pub(super) fn start_video(&mut self, view: &Arc<View>, video: &Arc<ViewerVideo>) -> Result<()> {
        let motion = view.motion();
        let (width, height) = view.size();
        let mut settings = video::VideoSettings::new(PictureSize::new(width, height), video.rate);
        settings.tags = self.style(view, &motion.camera(0.0), 0.0).tags;
        let writer = VideoWriter::new(video::create_video(&video.path(), settings)?, video);
        let mut view = (**view).clone();
        view.weather = Arc::new(self.place.weather_of_shot(&view.weather, &motion.camera(0.0)));
        let (view, video) = (Arc::new(view), Arc::clone(video));
        self.video = Some(ActiveVideo { view, motion, video, writer, next: 0, last: Instant::now() });
        Ok(())
    }

    /// Renders the next frame of the running video, if any.
    pub(super) fn render_video_frame(&mut self) {
        let Some(mut active) = self.video.take() else { return };
        active.last = Instant::now();
        if !active.video.is_stopped() && active.next < active.video.frames {
            match self.attempt(|worker| worker.try_video_frame(&mut active)) {
                Ok(true) => return self.video = Some(active),
                // The writer ended, and says why.
                Ok(false) => {}
                Err(why) => return active.video.end(Err(why)),
            }
        }
        active.video.end(active.writer.finish());
    }

    /// Renders a frame of the video once its assets exist; returns false if the writer has stopped.
    pub(super) fn try_video_frame(&mut self, active: &mut ActiveVideo) -> Result<bool> {
        let time = active.video.rate.seconds(u64::from(active.next));
        let camera = active.motion.camera(time);
        if !self.ensure_assets(&active.view.weather, &camera, time, AssetOwner::Video)? {
            return Ok(true);
        }
        let mut picture = active.writer.blank_picture();
        let camera = active.motion.at(time, self.place.site().metres_per_unit);
        let request = FrameRequest::new(&active.view.weather, camera, time);
        let Self { renderer, place, .. } = self;
        renderer.render_into(place, &request, &mut picture, &mut ())?;
        active.next += 1;
        Ok(active.writer.push_frame(picture))
    }
}
