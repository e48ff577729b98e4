//! The encoder ffmpeg, and ffmpeg as a judge of the built-in one; skipped where it is not
//! installed.

use std::process::{Command, Stdio};

use super::*;

/// Returns true if the program can be started; prints a line if not.
pub(super) fn found(program: &str) -> bool {
    let run = Command::new(program).arg("-version").stdout(Stdio::null()).stderr(Stdio::null()).status();
    let found = run.is_ok_and(|status| status.success());
    if !found {
        println!("skipped: no {program} on PATH");
    }
    found
}

/// Values of the first video stream, in the order of `entries`.
pub(super) fn probe(path: &Path, entries: &[&str]) -> Vec<String> {
    entries
        .iter()
        .map(|entry| {
            let output = Command::new("ffprobe")
                .args(["-v", "error", "-select_streams", "v:0", "-count_packets", "-of", "csv=p=0"])
                .args(["-show_entries", &format!("stream={entry}")])
                .arg(path)
                .output()
                .unwrap();
            String::from_utf8(output.stdout).unwrap().trim().trim_end_matches(',').to_owned()
        })
        .collect()
}

/// The planes of all frames, if the video decodes without a complaint.
pub(super) fn decode(path: &Path) -> Vec<u8> {
    let output = Command::new("ffmpeg")
        .args(["-v", "error", "-i"])
        .arg(path)
        .args(["-f", "rawvideo", "-pix_fmt", "yuv420p", "-"])
        .output()
        .unwrap();
    assert!(output.status.success() && output.stderr.is_empty(), "{output:?}");
    output.stdout
}

#[test]
fn encodes_and_tags() {
    if !found("ffmpeg") || !found("ffprobe") {
        return;
    }
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.mp4");
    let size = PictureSize::new(128, 96);
    let tags = vec![("scene".to_owned(), "a".to_owned())];
    let settings = VideoSettings { encoder: VideoEncoder::Ffmpeg, tags, ..settings(size, "29.97") };
    let frames: Vec<_> = (0..7).map(|i| foggy(size, i as f32 / 30.0)).collect();
    let report = write(&path, settings, &frames);
    assert_eq!((report.frames, report.bytes), (7, fs::metadata(&path).unwrap().len()));
    let entries = ["codec_name", "r_frame_rate", "nb_read_packets", "color_range", "color_space"];
    assert_eq!(probe(&path, &entries), ["h264", "30000/1001", "7", "tv", "bt709"]);
    assert_eq!(decode(&path).len(), 7 * size.pixels() * 3 / 2);
    assert_eq!(fs::read_dir(&directory).unwrap().count(), 1);
}

#[test]
fn says_what_is_wrong_in_one_line_and_cleans_up() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.mp4");
    let size = PictureSize::new(64, 64);
    let missing = ffmpeg::FfmpegSink::start("no-such-ffmpeg", &path, settings(size, "30"));
    let missing = missing.err().unwrap().to_string();
    assert!(missing.contains("install") && !missing.contains('\n'), "{missing}");
    // Where there is a program `false`, it ends at once, without a word and without reading: the
    // pipe breaks sooner or later.
    if let Ok(mut sink) = ffmpeg::FfmpegSink::start("false", &path, settings(size, "30")) {
        let frame = foggy(size, 0.0);
        let broken = (0..100).find_map(|_| sink.frame(&frame).err());
        let broken = broken.unwrap_or_else(|| Box::new(sink).finish().unwrap_err()).to_string();
        assert!(broken.contains("ffmpeg failed") && !broken.contains('\n'), "{broken}");
    }
    assert!(is_empty(directory.path()));
    if !found("ffmpeg") {
        return;
    }
    // Dropped in the middle, and without a frame.
    let settings = VideoSettings { encoder: VideoEncoder::Ffmpeg, ..settings(size, "30") };
    let mut sink = create_video(&path, settings.clone()).unwrap();
    sink.frame(&foggy(size, 0.0)).unwrap();
    drop(sink);
    let error = create_video(&path, settings).unwrap().finish().unwrap_err();
    assert!(matches!(error, MediaError::NoFrames(_)), "{error}");
    assert!(is_empty(directory.path()));
}
