//! The demo from end to end, as small as it goes.

use crate::common::{binary, names};
use crate::process::{printed, said};
use std::fs;
use std::path::Path;
use std::process::Output;

fn demo(out: &Path, options: &str) -> Output {
    let usual = ["--size 96x64", "--seconds 0.5", "--detail 0.1", "--sampled"];
    let usual = &usual[..if options.contains("--steps") { 2 } else { 4 }];
    let is_left = |word: &&&str| !options.contains(word.split(' ').next().unwrap());
    let usual: Vec<&str> = usual.iter().filter(is_left).copied().collect();
    run("--out", out, &format!("{options} {}", usual.join(" ")))
}

fn run(before: &str, folder: &Path, options: &str) -> Output {
    binary().args(["demo", before]).arg(folder).args(options.split_whitespace()).output().unwrap()
}

/// Returns what a run printed that must have succeeded.
fn succeeds(output: &Output) -> String {
    assert!(output.status.success(), "{}{}", printed(output), said(output));
    printed(output)
}

/// Checks that a run failed with one line that ends so.
fn fails(output: &Output, end: &str) {
    let said = said(output);
    assert!(!output.status.success() && said.trim_end().ends_with(end), "{said}");
    assert_eq!(said.lines().count(), 1);
}

#[test]
fn it_writes_a_scene_a_sheet_and_a_film() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("made here");
    let said = succeeds(&demo(&out, if cfg!(feature = "h264") { "" } else { "--only scene,sheet" }));

    let sheet = fs::read(out.join("sheet.png")).unwrap();
    let side = |at: usize| u32::from_be_bytes(sheet[at..at + 4].try_into().unwrap());
    assert_eq!((side(16), side(20)), (3 * 96 + 2, 2 * 64 + 1));
    assert!(sheet.len() > 10_000, "{}", sheet.len());
    let scene = fs::read(out.join("street.ply")).unwrap();
    assert!(scene.starts_with(b"ply\n") && scene.len() > 1_000_000, "{}", scene.len());
    assert!(said.contains("render \"") && said.contains("--weather"), "{said}");
    if cfg!(feature = "h264") {
        let film = fs::read(out.join("fog.mp4")).unwrap();
        assert_eq!(&film[4..8], b"ftyp");
        assert!(film.len() > 10_000, "{}", film.len());
        assert_eq!(names(&out), ["fog.mp4", "sheet.png", "street.ply"]);
    }
}

#[test]
fn photos_are_taken_reconstructed_and_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let options = "--steps 12 --count 5 --only scene,sheet";
    for options in [options, &format!("{options} --overwrite")] {
        // The second time it takes the place of the first.
        let said = succeeds(&demo(folder.path(), options));
        assert!(said.contains("5 photos, 48x32") && said.contains("12 steps in"), "{said}");
    }
    assert_eq!(
        names(folder.path()),
        ["photos", "sheet.png", "street.ply", "street.ply.assets", "street.ply.cameras.json", "street.run"]
    );
    assert_eq!(names(&folder.path().join("photos")), ["images", "made-up.txt", "sparse"]);
    for (gone, left) in [("none", "street.ply"), ("street.ply", "street.run/checkpoint.wmtrain")] {
        let _ = fs::remove_file(folder.path().join(gone));
        let says = "exists already; give another folder with --out, or replace it with --overwrite";
        fails(&demo(folder.path(), options), &format!("{left}: {says}"));
    }
}

#[test]
fn photos_alone_come_with_the_truth_and_replace_no_others() {
    let folder = tempfile::tempdir().unwrap();
    let photos = folder.path().join("orbit");
    let run = || run("--photos", &photos, "--count 4 --size 30x20 --route orbit");
    let said = succeeds(&run());
    assert!(said.contains("weather-magician reconstruct"), "{said}");
    assert_eq!(names(&photos), ["images", "made-up.txt", "sparse", "truth"]);
    assert_eq!(names(&photos.join("truth")), ["depth", "normal", "sky"]);
    assert_eq!(names(&photos.join("truth/sky")).len(), 4);

    fs::remove_file(photos.join("made-up.txt")).unwrap();
    let output = run();
    assert!(!output.status.success() && crate::process::said(&output).contains("name another folder"));
    assert_eq!(names(&photos.join("images")).len(), 4);
}

#[test]
fn captures_come_with_their_truth_and_bad_options_are_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let photos = folder.path().join("flight");
    let options = "--place park --capture nadir --count 5 --few 3 --size 24x16 --wrong-exif=zero";
    let said = succeeds(&run("--photos", &photos, options));
    assert!(said.contains("3 photos, 24x16") && !said.contains("--metres-per-unit"), "{said}");
    assert_eq!(names(&photos), ["images", "made-up.txt", "sparse", "truth", "truth.json"]);
    assert_eq!(names(&photos.join("truth")), ["clean", "depth", "label", "normal", "sky"]);
    let none = folder.path().join("none");
    for (options, problem) in [
        ("--capture walk --haze-on-photos 2", "haze 2 m: must be 10 to 100000"),
        ("--capture walk --blur nan", "blur NaN px: must be 0 to 50"),
    ] {
        fails(&run("--photos", &none, options), problem);
    }
    assert!(!none.exists());
}

#[test]
fn it_writes_only_what_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    succeeds(&demo(folder.path(), "--only sheet"));
    assert_eq!(names(folder.path()), ["sheet.png"]);
}

#[test]
fn what_cannot_work_is_told_at_once() {
    let folder = tempfile::tempdir().unwrap();
    for (options, problem) in [
        ("--seconds 0", "--seconds 0: must be 0.1 to 600"),
        ("--detail 9", "--detail 9: must be 0.1 to 4"),
        ("--detail nan", "--detail NaN: must be 0.1 to 4"),
    ] {
        fails(&demo(folder.path(), options), problem);
    }
    if cfg!(feature = "h264") {
        let output = demo(folder.path(), "--size 95x64");
        assert!(!output.status.success() && said(&output).contains("95x64"));
    }
    assert_eq!(names(folder.path()), [""; 0]);
}
