//! The examples of the library, run as a reader would run them.

use std::path::{Path, PathBuf};
use std::process::Command;

/// The programs that `cargo test` builds of the examples.
fn example(name: &str) -> PathBuf {
    let program = Path::new(env!("CARGO_BIN_EXE_weather-magician"));
    let path = program.with_file_name("examples").join(name).with_extension(std::env::consts::EXE_EXTENSION);
    assert!(path.exists(), "{} is not built: run `cargo test --workspace`", path.display());
    path
}

fn run(name: &str, args: &[&str]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let output = Command::new(example(name)).args(args).current_dir(&folder).output().unwrap();
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{name}: {text}");
    folder
}

/// The examples are short enough to be read at a glance.
#[test]
fn examples_have_at_most_40_lines() {
    for name in ["fog_picture", "rain_video", "snow_bake", "reconstruct"] {
        let path =
            Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples").join(name).with_extension("rs");
        let lines = std::fs::read_to_string(&path).unwrap().lines().count();
        assert!(lines <= 40, "{} has {lines} lines", path.display());
    }
}

#[test]
fn a_picture_in_fog() {
    let folder = run("fog_picture", &[]);
    assert!(std::fs::metadata(folder.path().join("fog.png")).unwrap().len() > 20_000);
}

#[cfg(feature = "h264")]
#[test]
fn a_video_in_rain() {
    let folder = run("rain_video", &["rain.mp4", "0.2"]);
    assert!(std::fs::metadata(folder.path().join("rain.mp4")).unwrap().len() > 5_000);
}

#[test]
fn a_scene_with_snow() {
    let folder = run("snow_bake", &[]);
    let baked = weather_magician::Scene::open(folder.path().join("snow.ply")).unwrap();
    assert!(baked.splats.len() > 10_000);
}

#[test]
fn a_scene_from_photos() {
    let folder = run("reconstruct", &[]);
    let scene = weather_magician::Scene::open(folder.path().join("place.ply")).unwrap();
    assert!(scene.splats.len() > 100 && scene.views.len() > 1);
}
