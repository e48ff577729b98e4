//! Frames do not know each other: any instant rendered alone is the frame of a sequence, and a sequence that
//! was interrupted goes on to the same bytes.

mod common;

use common::*;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::Duration;

const SIZE: (u32, u32) = (96, 64);
/// Twelve frames, the last begins at 1.375 s.
const SEQUENCE: &str = "-w fog-closing-in --seconds 1.5 --fps 8";

/// The yard, and a camera that moves and turns through it for two seconds.
fn shot(workshop: &Workshop) -> (PathBuf, ViewArgs) {
    let scene = workshop.scene("yard", yard().build(), &yard_metadata(1.0));
    let path = workshop.path("way.json");
    let keyframes = r#"{"fov": 50, "keyframes": [
        {"time": 0, "eye": [0.5, -12, 1.8], "target": [0, 4, 2.2]},
        {"time": 2, "eye": [2.0, -8, 2.6], "target": [-3, 4, 1.2]}
    ]}"#;
    std::fs::write(&path, keyframes).expect("the path is written");
    (scene, ViewArgs::along(&path, SIZE))
}

/// Name and bytes of the frames in a folder.
fn frames(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = std::fs::read_dir(folder).expect("the folder is there");
    let names = entries.map(|entry| entry.expect("it is read").file_name().into_string().expect("a name"));
    names
        .filter(|name| name.ends_with(".png"))
        .map(|name| (name.clone(), std::fs::read(folder.join(name)).expect("it is read")))
        .collect()
}

#[test]
fn a_frame_alone_is_the_frame_of_the_sequence() {
    let workshop = Workshop::new();
    let (scene, view) = shot(&workshop);
    let folder = workshop.render(&scene, &view, "frames", SEQUENCE);
    assert_eq!(frames(&folder).len(), 12);
    for (frame, time) in [(0, 0.0), (5, 0.625), (11, 1.375)] {
        let options = format!("-w fog-closing-in --time {time}");
        let alone = read_png(&workshop.render(&scene, &view, "alone.png", &options));
        assert!(alone == read_png(&folder.join(format!("{frame:05}.png"))), "frame {frame}");
    }
    // A sequence that begins later has the same frames.
    let later = workshop.render(&scene, &view, "later", "-w fog-closing-in --time 0.5 --seconds 1 --fps 8");
    let (all, part) = (frames(&folder), frames(&later));
    assert_eq!(part.len(), 8);
    for (index, bytes) in part.values().enumerate() {
        assert!(*bytes == all[&format!("{:05}.png", index + 4)], "frame {index}");
    }
    // They are frames of something that moves.
    let different: std::collections::BTreeSet<&Vec<u8>> = all.values().collect();
    assert_eq!(different.len(), 12);
}

#[test]
fn a_folder_is_gone_on_with_to_the_same_bytes() {
    let workshop = Workshop::new();
    let (scene, view) = shot(&workshop);
    let whole = frames(&workshop.render(&scene, &view, "whole", SEQUENCE));

    // Frames that were deleted come back, the others are not touched.
    let folder = workshop.path("whole");
    let kept = folder.join("00003.png");
    let written = |path: &Path| path.metadata().and_then(|about| about.modified()).expect("a time");
    let before = written(&kept);
    for name in ["00000.png", "00004.png", "00011.png"] {
        std::fs::remove_file(folder.join(name)).expect("it is there");
    }
    workshop.render(&scene, &view, "whole", SEQUENCE);
    assert!(frames(&folder) == whole);
    assert_eq!(written(&kept), before);

    // Killed in the midst of it, whenever that was.
    let folder = workshop.path("killed");
    let mut child = binary()
        .args(workshop.words(&scene, &view, "killed", SEQUENCE))
        .args(["--threads", "1"])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("the binary starts");
    while !folder.join("00001.png").exists() && child.try_wait().expect("it can be asked").is_none() {
        std::thread::sleep(Duration::from_millis(1));
    }
    // It may have ended by itself.
    let _ = child.kill();
    child.wait().expect("it ends");
    println!("killed after {} of 12 frames", frames(&folder).len());
    workshop.render(&scene, &view, "killed", SEQUENCE);
    assert!(frames(&folder) == whole);
}
