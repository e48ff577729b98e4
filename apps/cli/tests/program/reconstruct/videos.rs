//! Videos in place of photos.

use super::*;

/// Writes a video with ffmpeg's own source of pictures; false, with a word, if there is no ffmpeg.
fn write_video(path: &Path, source: &str, filter: &str) -> bool {
    let mut command = Command::new("ffmpeg");
    command.args(["-v", "error", "-nostdin", "-f", "lavfi", "-i", source, "-vf", filter]).arg(path);
    let written = command.status().is_ok_and(|status| status.success());
    if !written {
        eprintln!("skipped: ffmpeg is not installed, or writes no videos");
    }
    written
}

#[test]
fn a_video_needs_ffmpeg() {
    let place = place();
    place.put("walk.mp4", "no video");
    fs::create_dir(place.path("empty")).unwrap();
    let mut command = place.program(reconstruct("walk.mp4", &[]));
    command.env("PATH", place.path("empty"));
    let says = "walk.mp4: a video needs ffmpeg, which is not installed; install it with `";
    place.refused_by(&mut command, &[says]);
}

#[test]
fn what_is_no_video_or_stands_still_is_told() {
    let place = place();
    let source = "testsrc=size=160x120:rate=10:duration=1";
    if !write_video(&place.path("still.mp4"), source, "trim=end_frame=1,loop=9:1") {
        return;
    }
    place.untrained("still.mp4", &[], &["still.mp4: 1 of its frames differ, at least 3 are needed"]);
    let whole = place.read("still.mp4");
    // The first box of an MP4 and nothing else; an MP4 whose film is empty.
    let first = b"\0\0\0\x18ftypisom\0\0\x02\0isomiso2";
    let empty = [&first[..], b"\0\0\0\x08moov\0\0\0\x08mdat"].concat();
    for (name, content, more) in [
        ("text.mp4", &b"a film about a street"[..], "give a video that plays"),
        ("cut.mp4", &whole[..whole.len() / 3], ""),
        ("header.mp4", first, ""),
        ("empty.mp4", &empty, ""),
    ] {
        place.put(name, content);
        place.untrained(name, &[], &[&format!("{name}: ffmpeg reads no video in it ("), more]);
    }
    place.put("nothing.mp4", "");
    place.untrained("nothing.mp4", &[], &["nothing.mp4: "]);
    let mut sound = Command::new("ffmpeg");
    sound
        .args(["-v", "error", "-nostdin", "-f", "lavfi", "-i", "sine=duration=1"])
        .arg(place.path("sound.mp4"));
    assert!(sound.status().unwrap().success());
    place.untrained("sound.mp4", &[], &["sound.mp4: ffmpeg reads no video in it (it holds sound alone)"]);
}

#[test]
fn frames_of_a_video_are_photos() {
    let place = place();
    let pan = "crop=320:240:x='6*n':y=80";
    if !write_video(&place.path("walk.mp4"), "testsrc2=size=960x400:rate=10:duration=8", pan) {
        return;
    }
    let begin = |place: &Workshop| {
        let mut command = place.program(reconstruct("walk.mp4", &["--overwrite"]));
        command.env("COLMAP", "no/such");
        fails(&mut command, &["no/such: cannot be started"])
    };
    let said = begin(&place);
    let frames = listing(&place.path("scene.ply.run/frames"));
    let photos = frames.keys().filter(|path| path.extension() == Some(OsStr::new("jpg"))).count();
    assert!((10..=80).contains(&photos) && frames.len() == photos + 1, "{photos}: {said}");
    // They are taken once.
    let before = fs::metadata(place.path("scene.ply.run/frames/00001.jpg")).unwrap().modified().unwrap();
    begin(&place);
    let after = fs::metadata(place.path("scene.ply.run/frames/00001.jpg")).unwrap().modified().unwrap();
    assert_eq!(before, after);
}
