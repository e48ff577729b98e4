//! Frames over time: rendered in order while another thread writes those before, and videos of
//! them.

use crate::levels::shot_cameras;
use crate::motion::CameraMotion;
use crate::place::PreparedPlace;
use crate::tags::picture_tags;
use crate::{Error, FrameRequest, Picture, Progress, Renderer, Result};
use std::path::Path;
use std::sync::mpsc::{channel, sync_channel};
use wm_image::PictureSize;
use wm_image::video::{VideoReport, VideoSettings, create_video};
use wm_weather::Weather;

/// Frames between renderer and writer; more would only take memory.
const MAX_WAITING_FRAMES: usize = 2;

/// Renders `frames` in order while another thread writes; `T` is what holds the picture of a frame.
/// Returns the number of frames that were written: fewer than all if `progress` asked to stop.
///
/// # Errors
/// The first that `render` or `write` gives.
///
/// # Panics
/// If `write` panics.
pub fn render_and_write<T: Default + Send, E: Send>(
    frames: &[u32],
    render: &mut dyn FnMut(u32, &mut T) -> Result<(), E>,
    write: &mut (dyn FnMut(u32, &T) -> Result<(), E> + Send),
    progress: &mut dyn Progress,
) -> Result<u32, E> {
    progress.begin("frames", Some(frames.len() as u64));
    let outcome = std::thread::scope(|scope| {
        let (send, receive) = sync_channel::<(u32, T)>(MAX_WAITING_FRAMES);
        let (give_back, returned) = channel::<T>();
        let writer = scope.spawn(move || -> Result<u32, E> {
            let mut written = 0;
            for (index, frame) in receive {
                write(index, &frame)?;
                written += 1;
                // The renderer may be done and its end closed.
                let _ = give_back.send(frame);
            }
            Ok(written)
        });
        let mut fault = None;
        for index in frames {
            if progress.is_stopped() {
                break;
            }
            let mut frame = returned.try_recv().unwrap_or_default();
            if let Err(error) = render(*index, &mut frame) {
                fault = Some(error);
                break;
            }
            // A closed end means that the writer failed: its error is the one to tell.
            if send.send((*index, frame)).is_err() {
                break;
            }
            progress.advance(1);
        }
        drop(send);
        let written = match writer.join() {
            Ok(written) => written?,
            Err(panic) => std::panic::resume_unwind(panic),
        };
        match fault {
            Some(error) => Err(error),
            None => Ok(written),
        }
    });
    progress.end();
    outcome
}

/// A video to write.
#[derive(Clone, Debug)]
pub struct VideoFile<'a> {
    /// The MP4.
    pub path: &'a Path,
    /// Length, s.
    pub seconds: f64,
    /// Frame rate, encoder and tags; the size is that of the camera.
    pub settings: VideoSettings,
}

impl Renderer {
    /// Renders a video into a file: frame `i` shows the weather and the camera at `i` over the
    /// frame rate. The tags of the settings are kept; the weather, the camera and the renderer are
    /// added where there are none. A place in levels of detail that has no shot
    /// ([`PreparedPlace::set_shot`]) is drawn from one cut for all frames.
    ///
    /// # Errors
    /// [`Error::Media`] if the video cannot be written, [`Error::Stopped`] if `progress` asked to
    /// stop: no file is left then.
    pub fn render_video(
        &mut self,
        place: &mut PreparedPlace,
        weather: &Weather,
        motion: &CameraMotion,
        video: VideoFile<'_>,
        progress: &mut dyn Progress,
    ) -> Result<VideoReport> {
        let VideoFile { path, seconds, mut settings } = video;
        let (rate, scale) = (settings.frame_rate, place.site().metres_per_unit);
        let first = motion.camera(0.0);
        settings.size = PictureSize::new(first.width.max(1), first.height.max(1));
        if settings.tags.is_empty() {
            settings.tags = picture_tags("", place.site(), self.backend(), weather, 0.0, &first);
        }
        let mut sink = create_video(path, settings)?;
        let frames: Vec<u32> = (0..rate.frames_within(seconds).max(1)).collect();
        let has_own_shot = place.has_levels() && !place.has_shot();
        if has_own_shot {
            let camera = |frame: u32| motion.camera(rate.seconds(u64::from(frame)));
            place.set_shot(&shot_cameras(frames.len() as u32, camera, false));
        }
        let weather = &place.weather_of_shot(weather, &first);
        self.prepare(place, weather, progress)?;
        let mut render = |index: u32, picture: &mut Picture| -> Result<()> {
            let time = rate.seconds(u64::from(index));
            let request = FrameRequest::new(weather, motion.at(time, scale), time);
            self.render_into(place, &request, picture, &mut ()).map(drop)
        };
        let mut write = |_: u32, picture: &Picture| -> Result<()> { Ok(sink.frame(&picture.frame.rgb)?) };
        let written = render_and_write(&frames, &mut render, &mut write, progress);
        if has_own_shot {
            place.set_shot(&[]);
        }
        if (written? as usize) < frames.len() {
            return Err(Error::Stopped);
        }
        Ok(sink.finish()?)
    }
}
