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
    let place = Place::new();
    place.put("walk.mp4", "no video");
    fs::create_dir(place.at("empty")).unwrap();
    let mut command = place.command(reconstruct("walk.mp4", &[]));
    command.env("PATH", place.at("empty"));
    place.refused_by(
        &mut command,
        &["walk.mp4: a video needs ffmpeg, which is not installed; install it with `"],
    );
}

#[test]
fn what_is_no_video_or_stands_still_is_told() {
    let place = Place::new();
    if !write_video(
        &place.at("still.mp4"),
        "testsrc=size=160x120:rate=10:duration=1",
        "trim=end_frame=1,loop=9:1",
    ) {
        return;
    }
    place.refused("still.mp4", &[], &["still.mp4: 1 of its frames differ, at least 3 are needed"]);
    place.put("text.mp4", "a film about a street");
    place.refused("text.mp4", &[], &["text.mp4: ffmpeg reads no video in it (", "give a video that plays"]);
    let whole = place.read("still.mp4");
    place.put("cut.mp4", &whole[..whole.len() / 3]);
    place.refused("cut.mp4", &[], &["cut.mp4: ffmpeg reads no video in it ("]);
    // The first box of an MP4 and nothing else; an MP4 whose film is empty.
    place.put("header.mp4", b"\0\0\0\x18ftypisom\0\0\x02\0isomiso2");
    place.refused("header.mp4", &[], &["header.mp4: ffmpeg reads no video in it ("]);
    place.put("empty.mp4", b"\0\0\0\x18ftypisom\0\0\x02\0isomiso2\0\0\0\x08moov\0\0\0\x08mdat");
    place.refused("empty.mp4", &[], &["empty.mp4: ffmpeg reads no video in it ("]);
    place.put("nothing.mp4", "");
    place.refused("nothing.mp4", &[], &["nothing.mp4: "]);
    let mut sound = Command::new("ffmpeg");
    sound
        .args(["-v", "error", "-nostdin", "-f", "lavfi", "-i", "sine=duration=1"])
        .arg(place.at("sound.mp4"));
    assert!(sound.status().unwrap().success());
    place.refused("sound.mp4", &[], &["sound.mp4: ffmpeg reads no video in it (it holds sound alone)"]);
}

#[test]
fn frames_of_a_video_are_photos() {
    let place = Place::new();
    let pan = "crop=320:240:x='6*n':y=80";
    if !write_video(&place.at("walk.mp4"), "testsrc2=size=960x400:rate=10:duration=8", pan) {
        return;
    }
    let begin = |place: &Place| {
        let mut command = place.command(reconstruct("walk.mp4", &["--overwrite"]));
        command.env("COLMAP", "no/such");
        fails(&mut command, &["no/such: cannot be started"])
    };
    let said = begin(&place);
    let frames = listing(&place.at("scene.ply.run/frames"));
    let photos = frames.keys().filter(|path| path.extension() == Some(OsStr::new("jpg"))).count();
    assert!((10..=80).contains(&photos) && frames.len() == photos + 1, "{photos}: {said}");
    // They are taken once.
    let before = fs::metadata(place.at("scene.ply.run/frames/00001.jpg")).unwrap().modified().unwrap();
    begin(&place);
    let after = fs::metadata(place.at("scene.ply.run/frames/00001.jpg")).unwrap().modified().unwrap();
    assert_eq!(before, after);
}
