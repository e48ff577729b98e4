//! Settings of a video, and what its encoders share.

use super::frame_rate::FrameRate;
use crate::color::Dither;
use crate::{MediaError, PictureSize, Tags};
use std::path::{Path, PathBuf};
use wm_base::files::TempFile;

/// Longest time between keyframes, which are where a player can jump to.
pub(super) const KEYFRAME_INTERVAL_S: f64 = 2.0;

/// The H.264 encoder of a video.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum VideoEncoder {
    /// OpenH264, built into this program: Constrained Baseline profile. The same frames give the
    /// same bytes.
    #[default]
    Builtin,
    /// The program `ffmpeg` with libx264, from PATH: High profile, files about a third the size.
    Ffmpeg,
}

/// The settings of a video.
#[derive(Clone, Debug)]
pub struct VideoSettings {
    /// Size of every frame; both sides even.
    pub size: PictureSize,
    /// Frames per second.
    pub frame_rate: FrameRate,
    /// The encoder.
    pub encoder: VideoEncoder,
    /// Bits per second to aim at; `None` for the same good quality whatever it takes, which is what
    /// suits fog: see the encoders.
    pub bitrate: Option<u32>,
    /// The quantisation of the planes.
    pub dither: Dither,
    /// Written as the file's comment.
    pub tags: Vec<(String, String)>,
}

impl VideoSettings {
    /// Settings with the built-in encoder, constant quality, dither and no tags.
    #[must_use]
    pub fn new(size: PictureSize, frame_rate: FrameRate) -> Self {
        Self {
            size,
            frame_rate,
            encoder: VideoEncoder::default(),
            bitrate: None,
            dither: Dither::default(),
            tags: Vec::new(),
        }
    }
}

/// A video being written. Dropping it before [`VideoSink::finish`] leaves no file.
pub trait VideoSink: Send {
    /// Adds a frame: `rgb [H, W, 3]`, sRGB-encoded 0-1; what lies outside is clipped. Panics if the
    /// length does not fit the size in the settings.
    ///
    /// # Errors
    /// The encoder or the disk refuses; the sink is of no use then.
    fn frame(&mut self, rgb: &[f32]) -> Result<(), MediaError>;

    /// Completes the file and puts it under its name.
    ///
    /// # Errors
    /// No frame was added; the encoder or the disk refuses. No file is left then.
    fn finish(self: Box<Self>) -> Result<VideoReport, MediaError>;
}

/// A finished video file.
#[derive(Clone, Debug, PartialEq)]
pub struct VideoReport {
    /// The file.
    pub path: PathBuf,
    /// The encoder that was used.
    pub encoder: VideoEncoder,
    /// Frames.
    pub frames: u64,
    /// Frames over frames per second.
    pub seconds: f64,
    /// Bytes of the file.
    pub bytes: u64,
}

/// A file for a video that is being written.
pub(super) fn temporary(path: &Path) -> Result<TempFile, MediaError> {
    TempFile::beside(path).map_err(|fault| MediaError::write(path, fault))
}

/// `key = value`, a line each: what players show as the comment.
pub(super) fn comment(tags: &Tags) -> String {
    let lines: Vec<_> = tags.iter().map(|(key, text)| format!("{key} = {text}")).collect();
    lines.join("\n")
}

/// The message of an encoder, shortened to one line.
pub(super) fn one_line(text: &str) -> String {
    const MAX_CHARACTERS: usize = 400;
    let lines: Vec<_> = text.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
    let line = lines.join("; ");
    match line.char_indices().nth(MAX_CHARACTERS) {
        Some((end, _)) => format!("{} ...", &line[..end]),
        None if line.is_empty() => "it did not say why".to_owned(),
        None => line,
    }
}
