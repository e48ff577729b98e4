//! The demo from end to end, as small as it goes.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

fn demo(out: &Path, options: &[&str]) -> Output {
    let mut all = options.to_vec();
    let sampled: &[(&str, &str)] =
        if options.contains(&"--steps") { &[] } else { &[("--detail", "0.1"), ("--sampled", "")] };
    for (name, value) in [("--size", "96x64"), ("--seconds", "0.5")].iter().chain(sampled) {
        if !options.contains(name) {
            all.extend([name, value].into_iter().filter(|word| !word.is_empty()));
        }
    }
    run(&["--out"], out, &all)
}

fn run(before: &[&str], folder: &Path, options: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_weather-magician"))
        .arg("demo")
        .args(before)
        .arg(folder)
        .args(options)
        .output()
        .unwrap()
}

/// Names in a folder, sorted.
fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<String> =
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn it_writes_a_scene_a_sheet_and_a_film() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("made here");
    let output = demo(&out, if cfg!(feature = "h264") { &[] } else { &["--only", "scene,sheet"] });
    let said = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success(), "{said}{}", String::from_utf8_lossy(&output.stderr));

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
    let options = ["--steps", "12", "--count", "5", "--only", "scene,sheet", "--overwrite"];
    for options in [&options[..6], &options] {
        // The second time it takes the place of the first.
        let output = demo(folder.path(), options);
        let said = String::from_utf8(output.stdout).unwrap();
        assert!(output.status.success(), "{said}{}", String::from_utf8_lossy(&output.stderr));
        assert!(said.contains("5 photos, 48x32") && said.contains("12 steps in"), "{said}");
    }
    assert_eq!(
        names(folder.path()),
        ["photos", "sheet.png", "street.ply", "street.ply.assets", "street.ply.cameras.json", "street.run"]
    );
    assert_eq!(names(&folder.path().join("photos")), ["images", "made-up.txt", "sparse"]);
    for (gone, left) in [("none", "street.ply"), ("street.ply", "street.run/checkpoint.wmtrain")] {
        let _ = fs::remove_file(folder.path().join(gone));
        let output = demo(folder.path(), &options[..6]);
        let said = String::from_utf8(output.stderr).unwrap();
        let says = "exists already; give another folder with --out, or replace it with --overwrite";
        assert!(!output.status.success() && said.contains(&format!("{left}: {says}")), "{said}");
        assert_eq!(said.lines().count(), 1);
    }
}

#[test]
fn photos_alone_come_with_the_truth_and_replace_no_others() {
    let folder = tempfile::tempdir().unwrap();
    let photos = folder.path().join("orbit");
    let options = ["--count", "4", "--size", "30x20", "--route", "orbit"];
    let output = run(&["--photos"], &photos, &options);
    let said = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success() && said.contains("weather-magician reconstruct"), "{said}");
    assert_eq!(names(&photos), ["images", "made-up.txt", "sparse", "truth"]);
    assert_eq!(names(&photos.join("truth")), ["depth", "normal", "sky"]);
    assert_eq!(names(&photos.join("truth/sky")).len(), 4);

    fs::remove_file(photos.join("made-up.txt")).unwrap();
    let output = run(&["--photos"], &photos, &options);
    assert!(!output.status.success());
    assert!(String::from_utf8(output.stderr).unwrap().contains("name another folder"));
    assert_eq!(names(&photos.join("images")).len(), 4);
}

#[test]
fn captures_come_with_their_truth_and_bad_options_are_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let photos = folder.path().join("flight");
    let options = [
        "--place",
        "park",
        "--capture",
        "nadir",
        "--count",
        "5",
        "--few",
        "3",
        "--size",
        "24x16",
        "--wrong-exif=zero",
    ];
    let output = run(&["--photos"], &photos, &options);
    let said = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success(), "{said}{}", String::from_utf8_lossy(&output.stderr));
    assert!(said.contains("3 photos, 24x16") && !said.contains("--metres-per-unit"), "{said}");
    assert_eq!(names(&photos), ["images", "made-up.txt", "sparse", "truth", "truth.json"]);
    assert_eq!(names(&photos.join("truth")), ["clean", "depth", "label", "normal", "sky"]);
    for (options, problem) in [
        (["--capture", "walk", "--haze-on-photos", "2"], "haze 2 m: must be 10 to 100000"),
        (["--capture", "walk", "--blur", "nan"], "blur NaN px: must be 0 to 50"),
    ] {
        let output = run(&["--photos"], &folder.path().join("none"), &options);
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(!output.status.success() && said.trim_end().ends_with(problem), "{said}");
        assert_eq!(said.lines().count(), 1);
    }
    assert!(!folder.path().join("none").exists());
}

#[test]
fn it_writes_only_what_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    assert!(demo(folder.path(), &["--only", "sheet"]).status.success());
    assert_eq!(names(folder.path()), ["sheet.png"]);
}

#[test]
fn what_cannot_work_is_told_at_once() {
    let folder = tempfile::tempdir().unwrap();
    for (options, problem) in [
        (["--seconds", "0"], "--seconds 0: must be 0.1 to 600"),
        (["--detail", "9"], "--detail 9: must be 0.1 to 4"),
        (["--detail", "nan"], "--detail NaN: must be 0.1 to 4"),
    ] {
        let output = demo(folder.path(), &options);
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(!output.status.success() && said.trim_end().ends_with(problem), "{said}");
        assert_eq!(said.lines().count(), 1);
    }
    if cfg!(feature = "h264") {
        let output = demo(folder.path(), &["--size", "95x64"]);
        assert!(!output.status.success());
        assert!(String::from_utf8(output.stderr).unwrap().contains("95x64"));
    }
    assert_eq!(names(folder.path()), [""; 0]);
}
