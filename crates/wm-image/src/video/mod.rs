//! Videos: frames in, one MP4 out, frame by frame.
//!
//! Two encoders behind one trait: OpenH264, built in (feature `h264`), and ffmpeg, a program of the
//! user. Both get the same planes from `yuv`: BT.709, limited range, dithered so that fog does not
//! band. Memory does not grow with the length of the video, but for a few bytes a frame.

mod ffmpeg;
mod frame_rate;
#[cfg(feature = "h264")]
mod h264;
#[cfg(feature = "h264")]
mod mp4;
mod settings;
#[cfg(test)]
mod tests;
mod yuv;

use super::{MediaError, PictureSize};
pub use frame_rate::FrameRate;
pub use settings::{VideoEncoder, VideoReport, VideoSettings, VideoSink};
use std::path::Path;

/// Starts the video `path` (`.mp4`).
///
/// # Errors
/// A side is odd or too large for the encoder; the encoder is not there; the file cannot be made.
pub fn create_video(path: &Path, settings: VideoSettings) -> Result<Box<dyn VideoSink>, MediaError> {
    let PictureSize { width, height } = settings.size;
    if !width.is_multiple_of(2) || !height.is_multiple_of(2) {
        return Err(MediaError::OddSize { path: path.to_path_buf(), width, height });
    }
    match settings.encoder {
        #[cfg(feature = "h264")]
        VideoEncoder::Builtin => Ok(Box::new(h264::H264Sink::create(path, settings)?)),
        #[cfg(not(feature = "h264"))]
        VideoEncoder::Builtin => Err(MediaError::NoBuiltinEncoder(path.to_path_buf())),
        VideoEncoder::Ffmpeg => Ok(Box::new(ffmpeg::FfmpegSink::create(path, settings)?)),
    }
}
