//! `--encoder ffmpeg`: planes through a pipe to the user's ffmpeg, libx264.
//!
//! The planes are our own, so that colours and dither equal the built-in encoder's; ffmpeg only
//! encodes. Without a bitrate it runs at CRF 18.

use std::fs;
use std::io::{self, Read, Write};
use std::path::Path;
use std::process::{Child, ChildStderr, ChildStdin, Command, ExitStatus, Stdio};
use std::thread::{self, JoinHandle};

use wm_base::files::TempFile;

use super::settings::{
    KEYFRAME_INTERVAL_S, VideoReport, VideoSettings, VideoSink, comment, one_line, temporary,
};
use super::yuv::Yuv420;
use crate::{MediaError, PictureSize};

/// Most bytes of FFmpeg's messages that are kept.
const MAX_MESSAGE_BYTES: u64 = 1 << 16;

/// Passes frame by frame.
pub(crate) struct FfmpegSink {
    settings: VideoSettings,
    yuv: Yuv420,
    output: TempFile,
    frames: u64,
    /// `None` once it has ended.
    running: Option<Running>,
}

struct Running {
    child: Child,
    planes: ChildStdin,
    /// Reads along, since ffmpeg would wait for it when the pipe is full.
    messages: JoinHandle<String>,
}

impl FfmpegSink {
    /// Starts the video `path`.
    ///
    /// # Errors
    /// ffmpeg is not on PATH; the file cannot be made.
    pub(crate) fn create(path: &Path, settings: VideoSettings) -> Result<Self, MediaError> {
        Self::start("ffmpeg", path, settings)
    }

    pub(super) fn start(program: &str, path: &Path, settings: VideoSettings) -> Result<Self, MediaError> {
        let output = temporary(path)?;
        let mut child = command(program, output.path(), &settings)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|reason| MediaError::NoFfmpeg { path: path.to_path_buf(), reason })?;
        let planes = child.stdin.take().expect("piped above");
        let stderr = child.stderr.take().expect("piped above");
        let messages = thread::spawn(|| read_messages(stderr));
        Ok(Self {
            yuv: Yuv420::new(settings.size, settings.dither),
            settings,
            output,
            frames: 0,
            running: Some(Running { child, planes, messages }),
        })
    }

    /// Ends the input, waits, and returns how it ended and what it said; `None` if it has ended
    /// before.
    fn end(&mut self) -> Option<(io::Result<ExitStatus>, String)> {
        let Running { mut child, planes, messages } = self.running.take()?;
        drop(planes);
        let status = child.wait();
        Some((status, messages.join().unwrap_or_default()))
    }

    fn failed(&mut self, error: &io::Error) -> MediaError {
        let said = self.end().map(|(_, said)| said).unwrap_or_default();
        // Its own words say more than "broken pipe".
        let reason = if said.trim().is_empty() { error.to_string() } else { said };
        self.error(&reason)
    }

    fn error(&self, reason: &str) -> MediaError {
        MediaError::Encode {
            path: self.output.target().to_path_buf(),
            encoder: "ffmpeg",
            frame: self.frames,
            reason: one_line(reason),
        }
    }
}

impl VideoSink for FfmpegSink {
    fn frame(&mut self, rgb: &[f32]) -> Result<(), MediaError> {
        self.yuv.convert(rgb);
        let Some(running) = &mut self.running else {
            return Err(self.error("it has ended"));
        };
        match running.planes.write_all(self.yuv.bytes()) {
            Ok(()) => self.frames += 1,
            Err(error) => return Err(self.failed(&error)),
        }
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> Result<VideoReport, MediaError> {
        let path = self.output.target().to_path_buf();
        if self.frames == 0 {
            return Err(MediaError::NoFrames(path));
        }
        match self.end() {
            Some((Ok(status), _)) if status.success() => {}
            Some((Ok(status), said)) if said.trim().is_empty() => return Err(self.error(&status.to_string())),
            Some((Ok(_), said)) => return Err(self.error(&said)),
            Some((Err(error), _)) => return Err(self.error(&error.to_string())),
            None => return Err(self.error("it has ended")),
        }
        let Self { output, settings, frames, .. } = &mut *self;
        let bytes = fs::metadata(output.path()).map_err(|source| MediaError::write(&path, source))?.len();
        let report = VideoReport {
            path,
            encoder: settings.encoder,
            frames: *frames,
            seconds: settings.frame_rate.seconds(*frames),
            bytes,
        };
        output.rename().map_err(|fault| MediaError::write(&report.path, fault))?;
        Ok(report)
    }
}

impl Drop for FfmpegSink {
    fn drop(&mut self) {
        if let Some(mut running) = self.running.take() {
            // Not asked to finish: it must not go on with half a video. If it cannot be stopped it
            // has ended by itself.
            let _ = running.child.kill();
            let _ = running.child.wait();
        }
    }
}

fn command(program: &str, output: &Path, settings: &VideoSettings) -> Command {
    const BT_709: [&str; 8] =
        ["-color_range", "tv", "-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "bt709"];
    let PictureSize { width, height } = settings.size;
    let keyframes = settings.frame_rate.frames_within(KEYFRAME_INTERVAL_S);
    let mut command = Command::new(program);
    command
        .args(["-hide_banner", "-loglevel", "error", "-nostdin", "-y"])
        .args(["-f", "rawvideo", "-pix_fmt", "yuv420p"])
        .args(["-video_size", &format!("{width}x{height}")])
        .args(["-framerate", &settings.frame_rate.to_string()])
        .args(BT_709)
        .args(["-i", "pipe:0"])
        .args(["-c:v", "libx264", "-pix_fmt", "yuv420p", "-g", &keyframes.to_string()])
        .args(BT_709)
        .args(["-chroma_sample_location", "left"]);
    match settings.bitrate {
        None => command.args(["-crf", "18"]),
        Some(bitrate) => command.args(["-b:v", &bitrate.to_string()]),
    };
    if !settings.tags.is_empty() {
        command.args(["-metadata", &format!("comment={}", comment(&settings.tags))]);
    }
    command.args(["-movflags", "+faststart", "-f", "mp4"]).arg(output);
    command
}

/// All it says, of which the beginning is kept: that is where the reason stands.
fn read_messages(mut stderr: ChildStderr) -> String {
    let mut kept = Vec::new();
    // What cannot be read is not there to be shown.
    let _ = stderr.by_ref().take(MAX_MESSAGE_BYTES).read_to_end(&mut kept);
    let _ = io::copy(&mut stderr, &mut io::sink());
    String::from_utf8_lossy(&kept).into_owned()
}
