//! Photos out of a video: frames that are sharp and overlap evenly, by the ffmpeg that is
//! installed.
//!
//! ffmpeg plays the video twice. The first time it gives small grey frames, a few a second. Of
//! these each says how sharp it is (the mean square of its gradient), and how far its parts moved
//! since the last frame that was chosen (the shift of blocks that fits best). Frames are chosen
//! after equal ways, the sharpest of each window: a video that stands still gives few of them, one
//! that is blurred for a moment gives those beside. The second time the chosen frames are written
//! in full size.
//! ```text
//! 00001.jpg ...   the frames that were chosen, in their order
//! frames.txt      the video, and the times of its frames; written last
//! ```

use crate::colmap::{Running, on_path};
use rayon::prelude::*;
use std::fs;
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::UNIX_EPOCH;
use thiserror::Error;
use wm_base::FormatError;
use wm_base::files::write_atomically;

/// Most frames that are chosen.
pub(crate) const MAX_FRAMES: usize = 250;
/// Wanted number of frames: if the camera moves little, frames are taken after shorter shifts.
const WANTED_FRAMES: usize = 40;
/// Fewest frames of a capture.
const MIN_FRAMES: usize = 3;
/// Most frames that are examined, and the highest rate, 1/s.
const MAX_CANDIDATES: f64 = 3000.0;
const MAX_RATE_HZ: f64 = 10.0;
/// Size of the examined frames, px.
const GREY_SIZE_PX: (usize, usize) = (576, 324);
/// Size of a thumbnail, px, in which shifts are measured.
const THUMBNAIL_SIZE_PX: (usize, usize) = (96, 54);
/// Pixels of a grey frame along a side of a pixel of a thumbnail.
const THUMBNAIL_REDUCTION: usize = GREY_SIZE_PX.0 / THUMBNAIL_SIZE_PX.0;
/// Longest shift that is measured, px of a thumbnail.
const MAX_SHIFT_PX: i32 = 12;
/// Blocks of a thumbnail along each side.
const BLOCKS_PER_SIDE: usize = 3;
/// Width and height of a block, px of the small frame.
const BLOCK_SIZE: (usize, usize) =
    (THUMBNAIL_SIZE_PX.0 / BLOCKS_PER_SIDE, THUMBNAIL_SIZE_PX.1 / BLOCKS_PER_SIDE);
/// Tried shifts between two frames, as fractions of the width: the first that gives enough frames
/// is used.
const FRAME_SHIFTS: [f64; 5] = [0.08, 0.06, 0.04, 0.03, 0.02];
/// Start of the window of a frame, as a fraction of the shift.
const WINDOW_START: f64 = 0.6;
/// Least mean difference of two frames, 0-255.
const MIN_DIFFERENCE: f64 = 1.5;

/// File name extensions of videos.
const EXTENSIONS: [&str; 12] =
    ["mp4", "mov", "m4v", "mkv", "webm", "avi", "mts", "m2ts", "mpg", "mpeg", "3gp", "wmv"];

/// The file that says that all frames are there.
const DONE_FILE: &str = "frames.txt";

/// A reason why a video gives no photos.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum VideoError {
    /// There is no ffmpeg.
    #[error("{}: a video needs ffmpeg, which is not installed; install it with `{INSTALL}`, or give a folder of photos", .0.display())]
    NotInstalled(PathBuf),
    /// The video cannot be read.
    #[error("{}: cannot be read: {reason}", path.display())]
    Read {
        /// The video.
        path: PathBuf,
        /// The error of the system.
        reason: std::io::Error,
    },
    /// It is no video, or damaged.
    #[error("{}: ffmpeg reads no video in it ({said}); give a video that plays, or a folder of photos", path.display())]
    NotVideo {
        /// The file.
        path: PathBuf,
        /// The last line of ffmpeg.
        said: String,
    },
    /// It does not move, or ends at once.
    #[error(
        "{}: {frames} of its frames differ, at least 3 are needed; give a longer video, in which the camera moves", path.display()
    )]
    FewFrames {
        /// The video.
        path: PathBuf,
        /// Frames that differ.
        frames: usize,
    },
    /// ffmpeg does not start or cannot be read from.
    #[error("{}: cannot be run: {reason}", program.display())]
    Run {
        /// The program.
        program: PathBuf,
        /// The error of the system.
        reason: std::io::Error,
    },
    /// The folder cannot be written.
    #[error("{}: {reason}", path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// The error of the system.
        reason: std::io::Error,
    },
    /// A file cannot be written.
    #[error(transparent)]
    Format(#[from] FormatError),
    /// The caller stopped it.
    #[error("stopped while reading the video")]
    Stopped,
}

const INSTALL: &str = if cfg!(target_os = "macos") {
    "brew install ffmpeg"
} else if cfg!(windows) {
    "winget install ffmpeg"
} else {
    "sudo apt install ffmpeg"
};

/// The progress of a video: frames that were looked at, and of how many, once that is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VideoProgress {
    /// Frames that were looked at.
    pub done: usize,
    /// The approximate number of items in all, once that is known.
    pub total: Option<usize>,
}

/// Returns true if the path is a file with the extension of a video.
pub(crate) fn is_video(path: &Path) -> bool {
    let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
    path.is_file() && EXTENSIONS.iter().any(|known| known.eq_ignore_ascii_case(extension))
}

/// Writes frames of a video into a folder, and returns how many; does nothing if they are there.
///
/// `progress` is called often; when `is_stopped` says so, ffmpeg is ended.
///
/// # Errors
/// [`VideoError`] in one line.
pub(crate) fn write_frames(
    video: &Path,
    folder: &Path,
    progress: &mut dyn FnMut(VideoProgress),
    is_stopped: &dyn Fn() -> bool,
) -> Result<usize, VideoError> {
    let about = fs::metadata(video).map_err(|reason| VideoError::Read { path: video.into(), reason })?;
    let changed = about.modified().ok().and_then(|time| time.duration_since(UNIX_EPOCH).ok());
    let title =
        format!("{}, {} bytes, {}", video.display(), about.len(), changed.map_or(0, |t| t.as_nanos()));
    let there = fs::read_to_string(folder.join(DONE_FILE)).unwrap_or_default();
    let mut lines = there.lines();
    if lines.next() == Some(title.as_str()) {
        return Ok(lines.count());
    }
    let program = on_path(if cfg!(windows) { "ffmpeg.exe" } else { "ffmpeg" });
    let program = program.ok_or_else(|| VideoError::NotInstalled(video.into()))?;
    let ffmpeg = Ffmpeg { program, video, is_stopped };
    let rate = ffmpeg.rate()?;
    let candidates = ffmpeg.candidates(&rate, progress)?;
    let chosen = choose(&candidates);
    if chosen.len() < MIN_FRAMES {
        return Err(VideoError::FewFrames { path: video.into(), frames: chosen.len() });
    }
    let fault = |reason| VideoError::Folder { path: folder.into(), reason };
    // Frames of an earlier video, or of a choice that was not completed.
    match fs::remove_dir_all(folder) {
        Err(error) if error.kind() != ErrorKind::NotFound => return Err(fault(error)),
        _ => {}
    }
    fs::create_dir_all(folder).map_err(fault)?;
    let written = ffmpeg.write(&rate, &chosen, folder)?;
    if written < chosen.len() {
        return Err(ffmpeg.no_video(&format!("{written} of {} frames came out", chosen.len())));
    }
    write_atomically(&folder.join(DONE_FILE), |out| {
        writeln!(out, "{title}")?;
        for frame in &chosen {
            writeln!(out, "{:.2} s", *frame as f64 / rate.frames_per_second)?;
        }
        Ok(())
    })?;
    Ok(chosen.len())
}

/// The rate at which a video is looked at.
struct Rate {
    frames_per_second: f64,
    /// Frames in all, if the video says how long it is.
    total: Option<usize>,
}

/// ffmpeg on a video.
struct Ffmpeg<'a> {
    program: PathBuf,
    video: &'a Path,
    is_stopped: &'a dyn Fn() -> bool,
}

impl Ffmpeg<'_> {
    fn command(&self) -> Command {
        let mut command = Command::new(&self.program);
        command.args(["-hide_banner", "-nostdin"]).stdin(Stdio::null());
        command
    }

    fn run_error(&self, reason: std::io::Error) -> VideoError {
        VideoError::Run { program: self.program.clone(), reason }
    }

    fn no_video(&self, said: &str) -> VideoError {
        let line = said.lines().map(str::trim).rfind(|line| !line.is_empty()).unwrap_or("it says nothing");
        let said = line.chars().filter(|c| !c.is_control()).take(200).collect();
        VideoError::NotVideo { path: self.video.into(), said }
    }

    /// Returns the rate for the length and the frame rate that the video states.
    fn rate(&self) -> Result<Rate, VideoError> {
        let output = self.command().arg("-i").arg(self.video).output();
        let output = output.map_err(|error| self.run_error(error))?;
        let said = String::from_utf8_lossy(&output.stderr);
        if !said.contains("Video:") {
            // ffmpeg ends with a word on the output that is not given here.
            let fault = said
                .lines()
                .rfind(|line| !line.contains("At least one output file") && !line.trim().is_empty());
            let is_sound = said.contains("Audio:");
            return Err(self.no_video(if is_sound {
                "it holds sound alone"
            } else {
                fault.unwrap_or_default()
            }));
        }
        Ok(stated_rate(&said))
    }

    /// The filter that gives frames at a rate.
    fn filter(rate: &Rate) -> String {
        format!("fps={:.6}", rate.frames_per_second)
    }

    /// Looks at the frames of the video.
    fn candidates(
        &self,
        rate: &Rate,
        progress: &mut dyn FnMut(VideoProgress),
    ) -> Result<Vec<Candidate>, VideoError> {
        let mut command = self.command();
        command.args(["-v", "error", "-i"]).arg(self.video).args(["-map", "0:v:0", "-an", "-sn"]);
        let filter =
            format!("{},scale={}:{},format=gray", Self::filter(rate), GREY_SIZE_PX.0, GREY_SIZE_PX.1);
        command.args(["-vf", &filter, "-f", "rawvideo", "-"]);
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = Running(command.spawn().map_err(|error| self.run_error(error))?);
        let (out, said) = (child.0.stdout.take(), child.0.stderr.take());
        // Read beside, since ffmpeg would wait for a reader.
        let said = std::thread::spawn(move || {
            let mut text = Vec::new();
            // What cannot be read is not told.
            let _ = said.map(|said| said.take(1 << 16).read_to_end(&mut text));
            String::from_utf8_lossy(&text).into_owned()
        });
        let mut out = out.ok_or_else(|| self.run_error(ErrorKind::BrokenPipe.into()))?;
        let mut candidates = Vec::new();
        let mut grey = vec![0; GREY_SIZE_PX.0 * GREY_SIZE_PX.1];
        loop {
            match out.read_exact(&mut grey) {
                Ok(()) => candidates.push(Candidate::of(&grey)),
                Err(error) if error.kind() == ErrorKind::UnexpectedEof => break,
                Err(error) => return Err(self.run_error(error)),
            }
            progress(VideoProgress { done: candidates.len(), total: rate.total });
            if (self.is_stopped)() {
                return Err(VideoError::Stopped);
            }
        }
        drop(out);
        drop(child);
        if candidates.is_empty() {
            return Err(self.no_video(&said.join().unwrap_or_default()));
        }
        Ok(candidates)
    }

    /// Writes frames, by their numbers at the rate; returns how many.
    fn write(&self, rate: &Rate, chosen: &[usize], folder: &Path) -> Result<usize, VideoError> {
        let numbers: Vec<String> = chosen.iter().map(|frame| format!("eq(n\\,{frame})")).collect();
        let mut command = self.command();
        command.args(["-v", "error", "-i"]).arg(self.video).args(["-map", "0:v:0", "-an", "-sn"]);
        command.args(["-vf", &format!("{},select={}", Self::filter(rate), numbers.join("+"))]);
        command.args(["-vsync", "passthrough", "-q:v", "2", "-f", "image2"]).arg(folder.join("%05d.jpg"));
        command.stdout(Stdio::null()).stderr(Stdio::null());
        let mut child = Running(command.spawn().map_err(|error| self.run_error(error))?);
        while child.0.try_wait().map_err(|error| self.run_error(error))?.is_none() {
            if (self.is_stopped)() {
                return Err(VideoError::Stopped);
            }
            std::thread::sleep(std::time::Duration::from_millis(50));
        }
        Ok((1..=chosen.len()).take_while(|frame| folder.join(format!("{frame:05}.jpg")).is_file()).count())
    }
}

/// Returns the rate for what ffmpeg says of a video: `Duration: 00:01:02.50` and `29.97 fps`.
fn stated_rate(said: &str) -> Rate {
    let clock = said.split("Duration: ").nth(1).and_then(|rest| rest.split(',').next()).unwrap_or_default();
    let parts: Option<Vec<f64>> = clock.trim().split(':').map(|part| part.parse().ok()).collect();
    let seconds = parts.filter(|parts| parts.len() == 3);
    let seconds = seconds.map(|parts| parts.iter().fold(0.0, |sum, part| 60.0 * sum + part));
    let seconds = seconds.filter(|seconds| seconds.is_finite() && *seconds > 0.0);
    let native = said.split(" fps").next().and_then(|before| before.rsplit([' ', ',']).next());
    let native = native.and_then(|rate| rate.parse().ok()).filter(|rate: &f64| *rate > 0.0);
    let most = seconds.map_or(MAX_RATE_HZ / 2.0, |seconds| MAX_CANDIDATES / seconds);
    let frames_per_second = most.min(MAX_RATE_HZ).min(native.unwrap_or(MAX_RATE_HZ));
    let total = seconds.map(|seconds| (seconds * frames_per_second).ceil() as usize);
    Rate { frames_per_second, total }
}

/// A frame of the video, as far as it is looked at.
#[derive(Clone, Debug)]
struct Candidate {
    /// Mean square of the gradient.
    sharpness: f64,
    /// `[54, 96]`.
    small: Vec<u8>,
}

impl Candidate {
    /// Looks at a grey frame `[324, 576]`.
    fn of(grey: &[u8]) -> Self {
        let width = GREY_SIZE_PX.0;
        let rows: Vec<f64> = (1..GREY_SIZE_PX.1)
            .into_par_iter()
            .map(|y| {
                let (row, above) = (&grey[y * width..][..width], &grey[(y - 1) * width..][..width]);
                let square = |a: u8, b: u8| (f64::from(a) - f64::from(b)).powi(2);
                let along: f64 = row.windows(2).map(|pair| square(pair[0], pair[1])).sum();
                along + row.iter().zip(above).map(|(a, b)| square(*a, *b)).sum::<f64>()
            })
            .collect();
        let small = (0..THUMBNAIL_SIZE_PX.0 * THUMBNAIL_SIZE_PX.1).map(|i| {
            let (x, y) = (
                THUMBNAIL_REDUCTION * (i % THUMBNAIL_SIZE_PX.0),
                THUMBNAIL_REDUCTION * (i / THUMBNAIL_SIZE_PX.0),
            );
            let sum: u32 = (y..y + THUMBNAIL_REDUCTION)
                .map(|row| {
                    grey[row * width + x..][..THUMBNAIL_REDUCTION].iter().map(|v| u32::from(*v)).sum::<u32>()
                })
                .sum();
            (sum / (THUMBNAIL_REDUCTION * THUMBNAIL_REDUCTION) as u32) as u8
        });
        Self { sharpness: rows.iter().sum::<f64>() / grey.len() as f64, small: small.collect() }
    }

    /// Returns the mean difference to another frame, 0-255.
    fn change(&self, other: &Self) -> f64 {
        let sum: u32 = self.small.iter().zip(&other.small).map(|(a, b)| u32::from(a.abs_diff(*b))).sum();
        f64::from(sum) / self.small.len() as f64
    }

    /// Returns how far the parts of a picture moved to another frame: the mean length of the shifts
    /// of its blocks, as a fraction of the width. A block that fits nowhere, or best at the end of
    /// the search, counts with the longest shift.
    fn motion(&self, other: &Self) -> f64 {
        let (width, height) = BLOCK_SIZE;
        let lengths: Vec<f64> = (0..BLOCKS_PER_SIDE * BLOCKS_PER_SIDE)
            .into_par_iter()
            .map(|block| {
                let (x, y) = (width * (block % BLOCKS_PER_SIDE), height * (block / BLOCKS_PER_SIDE));
                let mut best = (u64::MAX, 0);
                for dy in -MAX_SHIFT_PX..=MAX_SHIFT_PX {
                    for dx in -MAX_SHIFT_PX..=MAX_SHIFT_PX {
                        let Some(sum) = self.difference(other, x, y, dx, dy) else { continue };
                        best = best.min((sum, dx * dx + dy * dy));
                    }
                }
                f64::from(best.1).sqrt()
            })
            .collect();
        lengths.iter().sum::<f64>() / lengths.len() as f64 / THUMBNAIL_SIZE_PX.0 as f64
    }

    /// Returns the mean difference, times 256, of the block at (x, y) and another frame's at
    /// (x + dx, y + dy), over the pixels that are in both frames; `None` if those are too few.
    fn difference(&self, other: &Self, x: usize, y: usize, dx: i32, dy: i32) -> Option<u64> {
        let (width, height) = BLOCK_SIZE;
        let inside = |from: usize, size: usize, shift: i32, side: usize| {
            let begin = (from as i32).max(-shift);
            let end = ((from + size) as i32).min(side as i32 - shift);
            (begin < end).then_some((begin as usize, end as usize))
        };
        let (left, right) = inside(x, width, dx, THUMBNAIL_SIZE_PX.0)?;
        let (top, bottom) = inside(y, height, dy, THUMBNAIL_SIZE_PX.1)?;
        let count = (right - left) * (bottom - top);
        if 2 * count < width * height {
            return None;
        }
        let sum: u64 = (top..bottom)
            .map(|row| {
                let there = (row as i32 + dy) as usize * THUMBNAIL_SIZE_PX.0;
                let a = &self.small[row * THUMBNAIL_SIZE_PX.0 + left..row * THUMBNAIL_SIZE_PX.0 + right];
                let b = &other.small[there + (left as i32 + dx) as usize..][..right - left];
                a.iter().zip(b).map(|(a, b)| u64::from(a.abs_diff(*b))).sum::<u64>()
            })
            .sum();
        Some(256 * sum / count as u64)
    }
}

/// Chooses frames, by their numbers, ascending.
fn choose(candidates: &[Candidate]) -> Vec<usize> {
    let mut chosen = Vec::new();
    for way in FRAME_SHIFTS {
        chosen = chosen_after(candidates, way);
        if chosen.len() >= WANTED_FRAMES {
            break;
        }
    }
    if chosen.len() > MAX_FRAMES {
        let all = chosen.len();
        chosen = (0..MAX_FRAMES).map(|i| chosen[i * all / MAX_FRAMES]).collect();
    }
    chosen
}

/// Chooses frames after equal ways: the sharpest of those that are about as far from the last.
fn chosen_after(candidates: &[Candidate], way: f64) -> Vec<usize> {
    let sharpest = |from: usize, end: usize| {
        (from..end.min(candidates.len()))
            .max_by(|a, b| candidates[*a].sharpness.total_cmp(&candidates[*b].sharpness))
    };
    let mut chosen: Vec<usize> = Vec::new();
    // The first window: what lies within a part of the way from the start.
    let begin = candidates
        .iter()
        .take_while(|other| candidates[0].motion(other) < (1.0 - WINDOW_START) * way)
        .count();
    let Some(mut last) = sharpest(0, begin.max(1)) else { return chosen };
    chosen.push(last);
    let mut window = None;
    let mut next = last + 1;
    while next < candidates.len() {
        let moved = candidates[last].motion(&candidates[next]);
        if window.is_none() && moved >= WINDOW_START * way {
            window = Some(next);
        }
        if let Some(from) = window
            && (moved >= way || next + 1 == candidates.len())
            && let Some(best) = sharpest(from, next + 1)
        {
            window = None;
            if candidates[best].change(&candidates[last]) >= MIN_DIFFERENCE {
                chosen.push(best);
                last = best;
                next = best;
            }
        }
        next += 1;
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall with a fixed pattern, seen from a place along it, px of the grey frame; blurred along
    /// by some pixels.
    fn frame(place: f64, blur: usize) -> Candidate {
        let value = |x: f64, y: f64| {
            let (u, v) = (x / 23.0, y / 19.0);
            127.0
                + 60.0 * ((u * 1.3).sin() * (v * 0.9).cos())
                + 50.0 * ((u * 0.37 + v * 0.61).sin())
                + 8.0 * (0.9 * x).sin()
        };
        let pixel = |i: usize| {
            let (x, y) = ((i % GREY_SIZE_PX.0) as f64 + place, (i / GREY_SIZE_PX.0) as f64);
            let sum: f64 = (0..=blur).map(|step| value(x + step as f64, y)).sum();
            (sum / (blur + 1) as f64).clamp(0.0, 255.0) as u8
        };
        Candidate::of(&(0..GREY_SIZE_PX.0 * GREY_SIZE_PX.1).map(pixel).collect::<Vec<_>>())
    }

    #[test]
    fn ways_are_fractions_of_the_width() {
        let start = frame(0.0, 0);
        assert_eq!(start.motion(&start), 0.0);
        for pixels in [6.0, 24.0, 48.0] {
            let way = start.motion(&frame(pixels, 0));
            assert!((way - pixels / GREY_SIZE_PX.0 as f64).abs() < 0.012, "{pixels}: {way}");
        }
        assert!(frame(0.0, 0).sharpness > 1.2 * frame(0.0, 20).sharpness);
    }

    #[test]
    fn sharp_frames_are_chosen_after_equal_ways() {
        // It stands for 30 frames, moves by 12 px a frame for 60, and every third frame is blurred.
        let candidates: Vec<Candidate> = (0..90usize)
            .map(|i| frame(12.0 * i.saturating_sub(30) as f64, if i % 3 == 0 { 12 } else { 0 }))
            .collect();
        let chosen = chosen_after(&candidates, 0.08);
        assert!(chosen.is_sorted() && chosen.iter().filter(|i| **i < 31).count() <= 2, "{chosen:?}");
        assert!(chosen.iter().skip(1).all(|i| i % 3 != 0), "{chosen:?}");
        // 720 px in steps of 28 to 58.
        assert!((12..=26).contains(&chosen.len()), "{chosen:?}");
        assert!(chosen.windows(2).skip(1).all(|pair| pair[1] - pair[0] <= 5), "{chosen:?}");
        // Where it stands, one frame is enough.
        assert_eq!(choose(&candidates[..30]).len(), 1);
    }

    #[test]
    fn what_ffmpeg_says_gives_the_rate() {
        let said = "Input #0, mov\n  Duration: 00:10:00.00, start: 0.000000, bitrate: 1 kb/s\n    Stream #0:0: Video: h264, 2x2, \
                    29.97 fps, 29.97 tbr";
        let rate = stated_rate(said);
        assert_eq!((rate.frames_per_second, rate.total), (5.0, Some(3000)));
        let slow = stated_rate("Duration: 00:00:02.50, x\nVideo: h264, 4 fps,");
        assert_eq!((slow.frames_per_second, slow.total), (4.0, Some(10)));
        let unknown = stated_rate("Duration: N/A, x\nVideo: h264, 25 fps,");
        assert_eq!((unknown.frames_per_second, unknown.total), (5.0, None));
    }
}
