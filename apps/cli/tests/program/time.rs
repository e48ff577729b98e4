//! Frames do not know each other: any instant rendered alone is the frame of a sequence, and a
//! sequence that was interrupted goes on to the same bytes.

use crate::common::*;
use crate::process::{begin, printed, succeeds};
use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

const SIZE: (u32, u32) = (96, 64);
/// Twelve frames, the last begins at 1.375 s.
const SEQUENCE: &str = "-w fog-closing-in --seconds 1.5 --fps 8";

/// The yard, and a camera that moves and turns through it for two seconds.
fn shot() -> Shot {
    let mut yard = Shot::yard(SIZE);
    let keyframes = r#"{"fov": 50, "keyframes": [
        {"time": 0, "eye": [0.5, -12, 1.8], "target": [0, 4, 2.2]},
        {"time": 2, "eye": [2.0, -8, 2.6], "target": [-3, 4, 1.2]}
    ]}"#;
    yard.view = ViewArgs::along(&yard.put("way.json", keyframes), SIZE);
    yard
}

/// Name and bytes of the frames in a folder.
fn frames(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let all = files(folder).into_iter().map(|(path, bytes)| (path.display().to_string(), bytes));
    all.filter(|(name, _)| name.ends_with(".png")).collect()
}

#[test]
fn a_frame_alone_is_the_frame_of_the_sequence() {
    let shot = shot();
    let folder = shot.render("frames", SEQUENCE);
    assert_eq!(frames(&folder).len(), 12);
    for (frame, time) in [(0, 0.0), (5, 0.625), (11, 1.375)] {
        let alone = shot.png(&format!("-w fog-closing-in --time {time}"));
        assert!(alone == read_png(&folder.join(format!("{frame:05}.png"))), "frame {frame}");
    }
    // A sequence that begins later has the same frames.
    let later = shot.render("later", "-w fog-closing-in --time 0.5 --seconds 1 --fps 8");
    let (all, part) = (frames(&folder), frames(&later));
    assert_eq!(part.len(), 8);
    for (index, bytes) in part.values().enumerate() {
        assert!(*bytes == all[&format!("{:05}.png", index + 4)], "frame {index}");
    }
    // They are frames of something that moves.
    let different: std::collections::BTreeSet<&Vec<u8>> = all.values().collect();
    assert_eq!(different.len(), 12);
}

/// A range of frames has the bytes of the whole sequence, on any number of threads, and goes into
/// the same folder.
#[test]
fn frames_of_a_range_are_those_of_the_sequence() {
    let shot = shot();
    // Not a second is whole at this rate, and the length of the path is its own.
    let moving =
        "--set fog.mor=0:2000:smooth,2:60 --set look.exposure=0:0:hold,1:-0.5:ease-out,2:-1 --fps 7.5";
    let whole = frames(&shot.render("whole", moving));
    assert_eq!(whole.len(), 15);
    for (threads, out) in [(1, "one"), (2, "two")] {
        for (range, names) in
            [("7..=8", vec![7, 8]), ("13..", vec![13, 14]), ("2..9 --frame-step 3", vec![2, 5, 8])]
        {
            let out = format!("{out}-{}", names[0]);
            let options = format!("{moving} --threads {threads} --frames {range}");
            let part = frames(&shot.render(&out, &options));
            let want: Vec<String> = names.iter().map(|index| format!("{index:05}.png")).collect();
            assert_eq!(part.keys().collect::<Vec<_>>(), want.iter().collect::<Vec<_>>(), "{range}");
            for (name, bytes) in &part {
                assert!(*bytes == whole[name], "{range}, {threads} threads: {name}");
            }
        }
    }
    // Several runs fill one folder.
    for range in ["0..5", "10..15", "4..12"] {
        shot.render("filled", &format!("{moving} --frames {range}"));
    }
    assert!(frames(&shot.path("filled")) == whole);
}

/// A video of a range is its frames, and as long as they are.
#[test]
#[cfg(feature = "h264")]
fn a_video_may_be_a_range() {
    let shot = shot();
    for (range, length) in [("3..9", "6 frames, 0.8 s"), ("0..=9 --frame-step 3", "4 frames, 0.5 s")] {
        let options = format!("{SEQUENCE} --frames {range}");
        let said = printed(&succeeds(&mut shot.command("part.mp4", &options)));
        assert!(said.contains(length), "{range}: {said}");
    }
    // The bytes of the sequence that has no others.
    let film = |options: &str| std::fs::read(shot.render("film.mp4", options)).expect("it is read");
    let alone = film("-w fog-closing-in --time 0.375 --seconds 0.75 --fps 8");
    assert!(film(&format!("{SEQUENCE} --frames 3..9")) == alone);
}

#[test]
fn a_folder_is_gone_on_with_to_the_same_bytes() {
    let shot = shot();
    let whole = frames(&shot.render("whole", SEQUENCE));

    // Frames that were deleted come back, the others are not touched.
    let folder = shot.path("whole");
    let kept = folder.join("00003.png");
    let written = |path: &Path| path.metadata().and_then(|about| about.modified()).expect("a time");
    let before = written(&kept);
    for name in ["00000.png", "00004.png", "00011.png"] {
        std::fs::remove_file(folder.join(name)).expect("it is there");
    }
    shot.render("whole", SEQUENCE);
    assert!(frames(&folder) == whole);
    assert_eq!(written(&kept), before);

    // Killed in the midst of it, whenever that was.
    let folder = shot.path("killed");
    let mut child = begin(shot.command("killed", SEQUENCE).args(["--threads", "1"]));
    while !folder.join("00001.png").exists() && child.try_wait().expect("it can be asked").is_none() {
        std::thread::sleep(Duration::from_millis(1));
    }
    // It may have ended by itself.
    let _ = child.kill();
    child.wait().expect("it ends");
    println!("killed after {} of 12 frames", frames(&folder).len());
    shot.render("killed", SEQUENCE);
    assert!(frames(&folder) == whole);
}
